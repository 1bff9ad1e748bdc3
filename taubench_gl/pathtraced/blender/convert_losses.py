"""What a conversion loses, one counted line for each kind.  Runs in Blender's Python."""

import itertools
import os

import bpy
from convert_curves import is_animated

MAX_NAMES = 5

NO_FORM = {"VOLUME", "GPENCIL", "GREASEPENCIL", "CURVES", "POINTCLOUD", "LIGHT_PROBE", "SPEAKER", "LATTICE"}
"""Types of objects that glTF has no form for.  A lattice deforms others and is baked with them."""

SIMULATED = {"CLOTH", "SOFT_BODY", "DYNAMIC_PAINT", "OCEAN", "PARTICLE_SYSTEM", "EXPLODE"}
"""Modifiers whose result is simulated from the first frame on when the file is converted."""

KNOWN_NODES = {
    "OUTPUT_MATERIAL", "BSDF_PRINCIPLED", "EMISSION", "BACKGROUND", "TEX_IMAGE", "NORMAL_MAP", "UVMAP", "MAPPING",
    "TEX_COORD", "VERTEX_COLOR", "SEPARATE_COLOR", "SEPRGB", "RGB", "VALUE", "REROUTE", "FRAME", "BSDF_TRANSPARENT",
    "MIX_SHADER", "LIGHT_PATH", "MATH",
}  # fmt: skip
"""Shader nodes that Blender's exporter can write, in the arrangements that it knows."""


class Losses:
    def __init__(self):
        self._found = {}

    def add(self, loss, names=()):
        self._found.setdefault(loss, {}).update(dict.fromkeys(names))

    def lines(self):
        """One line for each kind, with the number and the first names of what it concerns."""
        out = []
        for loss, names in self._found.items():
            shown = ", ".join(sorted(names)[:MAX_NAMES])
            others = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
            out.append(f"{loss} ({len(names)}: {shown}{others})" if names else loss)
        return out

    def of_scene(self, scene):
        """Record what the file holds that the written file cannot."""
        if len(bpy.data.scenes) > 1:
            others = [s.name for s in bpy.data.scenes if s is not scene]
            self.add(f"only the scene {scene.name!r} is written, others are left out", others)
        if scene.timeline_markers and any(marker.camera for marker in scene.timeline_markers):
            self.add("cameras that markers switch to are not followed: the active camera is kept")
        for item in scene.objects:
            self._of_object(item)
        for image in bpy.data.images:
            missing = image.source == "FILE" and image.packed_file is None and image.users
            if missing and not os.path.isfile(bpy.path.abspath(image.filepath)):
                self.add("images whose files are missing", [image.name])
        for library in bpy.data.libraries:
            if not os.path.isfile(bpy.path.abspath(library.filepath)):
                self.add("linked files that are missing", [os.path.basename(library.filepath)])
        used = {slot.material for item in scene.objects if not item.hide_render for slot in item.material_slots}
        for material in filter(None, used):
            self._of_material(material)

    def _of_object(self, item):
        if item.hide_render and not is_animated(item, "hide_render"):
            self.add("objects that are hidden in renders are left out", [item.name])
            return
        if item.type in NO_FORM:
            self.add("objects of a type that glTF has no form for", [f"{item.name}: {item.type.lower()}"])
        stack = [modifier.type == "ARMATURE" for modifier in item.modifiers if modifier.show_render]
        if any(first and not second for first, second in itertools.pairwise(stack)):
            self.add("modifiers that follow an armature are applied before it", [item.name])
        for modifier in item.modifiers:
            kind = modifier.type
            if kind == "FLUID" and modifier.fluid_type == "DOMAIN":
                self.add("fluid and smoke are not simulated: the domain keeps its first shape", [item.name])
            elif kind == "PARTICLE_SYSTEM" and modifier.particle_system.settings.type == "HAIR":
                continue
            elif kind in SIMULATED and modifier.show_render:
                self.add("simulated as Blender does it without its caches, from the first frame on", [item.name])
        for system in item.particle_systems:
            if system.settings.render_type in ("PATH", "HALO", "LINE"):
                self.add("particles and hair that are not instances of objects", [item.name])
        if item.rigid_body is not None and item.rigid_body.type == "ACTIVE":
            self.add("simulated as Blender does it without its caches, from the first frame on", [item.name])
        if item.type == "CAMERA":
            self._of_camera(item.data)
        elif item.type == "LIGHT":
            self._of_light(item.data)

    def _of_camera(self, camera):
        if camera.type == "PANO":
            self.add("panoramic cameras", [camera.name])
        if camera.shift_x or camera.shift_y:
            self.add("the lens shift of cameras", [camera.name])
        if camera.dof.use_dof:
            self.add("the depth of field of cameras", [camera.name])

    def _of_light(self, light):
        if light.type == "SUN":
            if light.angle > 0:
                self.add("the size of lights: their shadows have hard edges", [light.name])
        elif light.type != "AREA" and light.shadow_soft_size > 0:
            self.add("the size of lights: their shadows have hard edges", [light.name])
        if light.use_nodes and light.node_tree and len(light.node_tree.nodes) > 2:
            self.add("the shader nodes of lights", [light.name])

    def _of_material(self, material):
        if not material.use_nodes or material.node_tree is None:
            return
        output = next((n for n in material.node_tree.nodes if n.type == "OUTPUT_MATERIAL" and n.is_active_output), None)
        if output is None:
            return
        for name, loss in (("Displacement", "displacement of materials"), ("Volume", "volumes of materials")):
            if output.inputs[name].is_linked:
                self.add(loss, [material.name])
        unknown = sorted(_upstream(output.inputs["Surface"]) - KNOWN_NODES)
        if unknown:
            listed = ", ".join(kind.lower() for kind in unknown[:4])
            self.add("materials with shader nodes that glTF has no form for", [f"{material.name}: {listed}"])
        tree = material.node_tree.animation_data
        if tree is not None and (tree.action or tree.drivers or tree.nla_tracks):
            self.add("the animation of materials is written, but not played", [material.name])


def _upstream(socket):
    """Types of all nodes that a socket depends on, groups replaced by what is inside them."""
    types, open_ = set(), [link.from_node for link in socket.links]
    visited = set()
    while open_:
        node = open_.pop()
        if node in visited:
            continue
        visited.add(node)
        if node.type == "GROUP" and node.node_tree is not None:
            open_ += [n for n in node.node_tree.nodes if n.type not in ("GROUP_INPUT", "GROUP_OUTPUT")]
        elif node.type not in ("GROUP_INPUT", "GROUP_OUTPUT"):
            types.add(node.type)
        open_ += [link.from_node for other in node.inputs for link in other.links]
    return types
