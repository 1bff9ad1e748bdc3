"""Motion and modifiers that glTF cannot express, as meshes, shape keys and objects.  Runs in Blender's Python.

The scene is evaluated once at every frame.  Objects with modifiers get their evaluated mesh: with their own shape keys
where the modifiers are linear in them, else with one shape key per distinct shape.  Instances become objects.  An
armature stays a modifier, after all others.
"""

import hashlib

import bpy
import numpy as np
from convert_curves import is_animated, key_values
from mathutils import Matrix
from script_shared import fcurves_of

CONVERTED = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
"""Types of objects that are evaluated to meshes."""

CURVES = {"CURVE", "SURFACE", "FONT", "META"}
"""Types of objects whose own mesh Blender lists as an instance."""

LINEAR_ERROR = 1e-5
"""Largest departure of a mesh from its shape keys, relative to its size, that counts as rounding."""

MAX_BYTES = 2 << 30
"""Limit on the sampled vertices of all objects together."""

MAX_INSTANCES = 20_000


class Deformed:
    """One object whose evaluated mesh replaces its own: vertices and shape-key values at every frame."""

    def __init__(self, item):
        self.item = item
        self.shapes = []  # distinct vertices (V, 3) float32
        self.at = []  # index of the shape of each frame
        self.topologies = set()
        keys = getattr(item.data, "shape_keys", None)
        self.keys = keys if keys is not None and keys.use_relative else None
        self.values = []  # of the key blocks at each frame

    @property
    def bytes(self):
        """Bytes of the shapes that are kept."""
        return sum(shape.nbytes for shape in self.shapes)

    def keep_first(self, frames):
        """Forget every shape but the first, at all ``frames``."""
        del self.shapes[1:]
        self.at, self.keys = [0] * len(frames), None

    def record(self, depsgraph):
        """Add the shape of the frame at which ``depsgraph`` is evaluated."""
        points, topology = vertices_of(self.item, depsgraph)
        self.topologies.add(topology)
        if self.keys is not None:
            self.values.append([0.0 if k.mute else k.value for k in self.keys.key_blocks])
        if self.shapes and self.shapes[-1].shape == points.shape and np.array_equal(self.shapes[-1], points):
            self.at.append(len(self.shapes) - 1)
            return
        self.shapes.append(points)
        self.at.append(len(self.shapes) - 1)


def vertices_of(item, depsgraph):
    """Vertices (V, 3) float32 of the evaluated mesh, and a number that identifies its topology."""
    evaluated = item.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    if mesh is None:
        return np.zeros((0, 3), dtype=np.float32), 0
    points = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    corners = np.empty(len(mesh.loops), dtype=np.int32)
    mesh.vertices.foreach_get("co", points)
    mesh.loops.foreach_get("vertex_index", corners)
    topology = hash((len(mesh.vertices), len(mesh.polygons), corners.tobytes()))
    evaluated.to_mesh_clear()
    return points.reshape(-1, 3), topology


def bake_motion(scene, losses):
    """Rebuild the scene so that Blender's exporter writes all of its motion.

    -> ``animated``: whether anything moves; ``visible``: object name -> whether it is shown at each frame.
    """
    as_rendered(scene)
    frames = list(range(scene.frame_start, scene.frame_end + 1)) if moves(scene) else [scene.frame_start]
    armatures = detach_armatures(scene)
    deformed = [Deformed(item) for item in scene.objects if is_deformed(item)]
    switched = {o: [] for o in scene.objects if is_animated(o, "hide_render")}
    instances, shown, recorded = Instances(), set(), list(deformed)
    bpy.context.view_layer.update()
    for frame in frames:
        scene.frame_set(frame)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for item in recorded:
            item.record(depsgraph)
        while recorded and sum(item.bytes for item in recorded) > MAX_BYTES:
            largest = max(recorded, key=lambda item: item.bytes)
            losses.add("deforming meshes beyond 2 GiB keep their first shape", [largest.item.name])
            largest.keep_first(frames)
            recorded.remove(largest)
        for item, states in switched.items():
            states.append(not item.hide_render)
        shown |= instances.record(depsgraph, frame, losses)
    scene.frame_set(frames[0])

    kinds = CONVERTED | {"LIGHT"}
    drawn = {o for o in scene.objects if o.type in kinds and not o.hide_render and o not in switched}
    for item in drawn - {bpy.data.objects[name] for name in shown}:
        if item.name not in instances.sources:
            losses.add("objects that are hidden in renders are left out", [item.name])
        item.hide_render = True  # Blender draws nothing, or its instances instead
    for item in deformed:
        rebuild(item, frames, losses)
    for modifier in armatures:
        modifier.show_viewport = True
    visible = {item.name: states for item, states in switched.items() if len(set(states)) > 1}
    for item, states in switched.items():
        remove_curves(item, "hide_render")
        item.hide_render = not any(states)
    visible |= instances.build(scene, frames, losses)
    for item in scene.objects:
        item.instance_type = "NONE"
    return {"animated": len(frames) > 1, "visible": visible}


def as_rendered(scene):
    """Show in the viewport, which the exporter evaluates, what a render shows."""
    open_ = [bpy.context.view_layer.layer_collection]
    while open_:
        layer = open_.pop()
        open_ += layer.children
        layer.hide_viewport = False
        if layer.collection is not scene.collection:
            layer.collection.hide_viewport = layer.collection.hide_render
    for item in scene.objects:
        if not item.hide_render or is_animated(item, "hide_render"):
            item.hide_viewport = False
            if item.name in bpy.context.view_layer.objects:
                item.hide_set(False)
        for modifier in item.modifiers:
            modifier.show_viewport = modifier.show_render
            if modifier.type in ("SUBSURF", "MULTIRES"):
                modifier.levels = modifier.render_levels


def moves(scene):
    """Whether anything in the file can change over time."""
    owners = [*bpy.data.objects, *bpy.data.shape_keys, *bpy.data.cameras, *bpy.data.lights, *bpy.data.materials]
    owners += [*bpy.data.meshes, *bpy.data.armatures, *bpy.data.node_groups, *bpy.data.curves, *bpy.data.lattices]
    owners += [m.node_tree for m in bpy.data.materials if m.node_tree]
    timed = {"MESH_SEQUENCE_CACHE", "MESH_CACHE", "WAVE", "OCEAN", "BUILD", "CLOTH", "SOFT_BODY", "FLUID", "EXPLODE",
             "DYNAMIC_PAINT", "PARTICLE_SYSTEM", "NODES"}  # fmt: skip
    return (
        any(o.animation_data and (o.animation_data.action or o.animation_data.drivers or o.animation_data.nla_tracks)
            for o in owners)
        or any(m.type in timed for o in scene.objects for m in o.modifiers)
        or any(c.type == "TRANSFORM_CACHE" for o in scene.objects for c in o.constraints)
        or any(o.rigid_body for o in scene.objects)
    )  # fmt: skip


def is_deformed(item):
    """Whether the exporter would not write the shape of an object as it is evaluated."""
    if item.hide_render and not is_animated(item, "hide_render"):
        return False
    others = [m for m in item.modifiers if m.type != "ARMATURE" and m.show_render]
    if item.type == "MESH":
        keys = item.data.shape_keys
        return bool(others) or (keys is not None and not keys.use_relative)
    return item.type in CONVERTED


def detach_armatures(scene):
    """Switch off the armatures of objects that get new meshes.  -> the modifiers."""
    matching = [
        m for o in scene.objects if is_deformed(o) for m in o.modifiers if m.type == "ARMATURE" and m.show_viewport
    ]
    for modifier in matching:
        modifier.show_viewport = False
    return matching


def rebuild(deformed, frames, losses):
    """Give the object its evaluated mesh and the shape keys that it needs."""
    item = deformed.item
    if len(deformed.topologies) > 1:
        losses.add("meshes whose faces change over time keep their first shape", [item.name])
        deformed.at = deformed.at[:1] * len(frames)
    used = sorted(set(deformed.at))
    keys = own_keys(deformed, used) if len(used) > 1 and deformed.keys is not None else None
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mesh = bpy.data.meshes.new_from_object(
        item.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
    )
    item = as_mesh_object(item, mesh)
    if keys is not None:
        names, shapes, values = keys
        add_keys(item, names, shapes, frames, values)
    elif len(used) > 1:
        names = ["Basis", *(f"frame {frames[deformed.at.index(k)]}" for k in used[1:])]
        values = np.array([[float(at == k) for k in used] for at in deformed.at])
        add_keys(item, names, [deformed.shapes[k] for k in used], frames, values)


def own_keys(deformed, used):
    """Names, shapes and values per frame of the object's own shape keys behind its modifiers.

    None where the modifiers are not linear in them.
    """
    item, keys = deformed.item, deformed.keys
    values = np.array(deformed.values)
    keys.animation_data_clear()
    for block in keys.key_blocks:
        block.slider_max, block.value = max(block.slider_max, 1.0), 0.0

    def evaluated():
        keys.update_tag()
        item.update_tag()
        bpy.context.view_layer.update()
        return vertices_of(item, bpy.context.evaluated_depsgraph_get())

    basis, topology = evaluated()
    shapes = [basis]
    for block in keys.key_blocks[1:]:
        block.mute = False
        block.value = 1.0
        shape, other = evaluated()
        block.value = 0.0
        if other != topology:
            return None
        shapes.append(shape)
    evaluated()
    moved = np.stack(shapes[1:]).astype(np.float64) - basis if len(shapes) > 1 else np.zeros((0, *basis.shape))
    size = max(float(np.ptp(basis, axis=0).max(initial=0.0)), 1e-9)
    for k in used:
        at = values[deformed.at.index(k), 1:]
        if deformed.shapes[k].shape != basis.shape:
            return None
        away = basis + np.tensordot(at, moved, axes=1) - deformed.shapes[k]
        if np.abs(away).max(initial=0.0) > LINEAR_ERROR * size:
            return None
    return [block.name for block in keys.key_blocks], shapes, values


def as_mesh_object(item, mesh):
    """``item`` with ``mesh`` as its data and only its armatures as modifiers; a new object in place of a curve."""
    for modifier in list(item.modifiers):
        if modifier.type != "ARMATURE":
            item.modifiers.remove(modifier)
    if item.type == "MESH":
        item.data = mesh
        return item
    mesh_object = bpy.data.objects.new(f"{item.name} mesh", mesh)
    for collection in item.users_collection:
        collection.objects.link(mesh_object)
    mesh_object.parent = item  # the pose, animated or not, stays that of the curve
    item.data = bpy.data.metaballs.new("none") if item.type == "META" else bpy.data.curves.new("none", item.type)
    if item.type == "FONT":
        item.data.body = ""
    name = item.name
    item.name, mesh_object.name = f"{name} place", name
    return mesh_object


def add_keys(item, names, shapes, frames, values):
    """Shape keys of the given names and vertices; ``values`` (frames, keys) keyed linearly."""
    for name, shape in zip(names, shapes):
        block = item.shape_key_add(name=name, from_mix=False)
        block.slider_min, block.slider_max = -10.0, 10.0
        block.data.foreach_set("co", np.ascontiguousarray(shape, dtype=np.float32).ravel())
    for k, block in enumerate(item.data.shape_keys.key_blocks):
        if k and np.ptp(values[:, k]) > 0:
            full = f'key_blocks["{bpy.utils.escape_identifier(block.name)}"].value'
            key_values(block, "value", full, frames, values[:, k])
        elif k:
            block.value = values[0, k]


def remove_curves(item, path):
    """Remove what animates one property of an object."""
    animation = item.animation_data
    if animation is None:
        return
    item.driver_remove(path)
    if animation.action is not None:
        for layer in getattr(animation.action, "layers", ()):
            for strip in layer.strips:
                for bag in strip.channelbags:
                    for curve in [c for c in bag.fcurves if c.data_path == path]:
                        bag.fcurves.remove(curve)
        if not getattr(animation.action, "layers", ()):
            for curve in [c for c in fcurves_of(animation.action) if c.data_path == path]:
                animation.action.fcurves.remove(curve)
    for track in animation.nla_tracks:
        for strip in track.strips:
            if strip.action and any(c.data_path == path for c in fcurves_of(strip.action)):
                strip.mute = True


class Instances:
    """Instances of geometry nodes, collections, particles, vertices and faces, followed by their numbers."""

    def __init__(self):
        self._poses = {}  # (instancer, numbers, source) -> {frame: matrix}
        self._data = {}  # the same -> mesh or light data
        self._meshes = {}  # content -> mesh
        self.sources = set()  # names of the objects that instances show

    def record(self, depsgraph, frame, losses):
        """Note the poses at one frame.  -> names of the objects that are drawn themselves."""
        shown, contents = set(), {}
        for entry in depsgraph.object_instances:
            source = entry.object
            if not entry.is_instance:
                if entry.show_self:
                    shown.add(source.original.name)
                continue
            if source.type not in CONVERTED | {"LIGHT"} or source.original.hide_render:
                if source.type not in CONVERTED | {"LIGHT", "EMPTY", "ARMATURE", "LATTICE", "CAMERA"}:
                    losses.add("instances of a type that glTF has no form for", [source.type.lower()])
                continue
            parent = entry.parent
            of_curve = parent.type in CURVES and source.original == parent.original
            if of_curve and entry.matrix_world == parent.matrix_world:
                continue  # the mesh of the curve itself, which is a deformed object
            key = (parent.original.name, tuple(entry.persistent_id), source.original.name, source.type)
            if key not in self._poses and len(self._poses) >= MAX_INSTANCES:
                losses.add(f"instances beyond {MAX_INSTANCES}")
                continue
            self._poses.setdefault(key, {})[frame] = np.array(entry.matrix_world)
            self.sources.add(source.original.name)
            if source.type == "LIGHT":
                self._data.setdefault(key, source.original.data)
                continue
            mesh = self._mesh(source, contents)
            if self._data.setdefault(key, mesh) is not mesh:
                losses.add("instances whose shape changes keep their first shape", [source.original.name])
        return shown

    def _mesh(self, source, contents):
        """The mesh of a source, one for equal content.  ``contents``: those of this frame."""
        pointer = source.data.as_pointer() if source.data is not None else source.as_pointer()
        if pointer not in contents:
            mesh = source.to_mesh()
            digest, count = hashlib.sha1(), len(mesh.vertices)
            for data, name, width, kind in (
                (mesh.vertices, "co", 3, np.float32), (mesh.loops, "vertex_index", 1, np.int32),
                (mesh.polygons, "material_index", 1, np.int32),
            ):  # fmt: skip
                values = np.empty(width * len(data), dtype=kind)
                data.foreach_get(name, values)
                digest.update(values.tobytes())
            digest.update(repr([m and m.name for m in mesh.materials]).encode())
            source.to_mesh_clear()
            content = digest.digest()
            if content not in self._meshes:
                new_mesh = bpy.data.meshes.new_from_object(source, preserve_all_data_layers=True)
                # Objects that geometry nodes make exist in the evaluation only: their mesh is copied from there.
                self._meshes[content] = new_mesh if len(new_mesh.vertices) == count else source.data.copy()
            contents[pointer] = self._meshes[content]
        return contents[pointer]

    def build(self, scene, frames, losses):
        """Make the objects.  -> object name -> whether it is shown at each frame, where that changes."""
        visible = {}
        for number, (key, poses) in enumerate(self._poses.items()):
            item = bpy.data.objects.new(f"{key[0]} instance {number}", self._data[key])
            scene.collection.objects.link(item)
            if len(poses) < len(frames):
                visible[item.name] = [frame in poses for frame in frames]
            place(item, poses, losses)
        return visible


def place(item, poses, losses):
    """Set or key the pose of an object: frame -> (4, 4) world matrix."""
    item.rotation_mode = "QUATERNION"
    frames, parts, last = list(poses), [], None
    for matrix in poses.values():
        position, rotation, scale = Matrix(matrix).decompose()
        if last is not None and last.dot(rotation) < 0:
            rotation.negate()
        last = rotation
        parts.append((*position, *rotation, *scale))
        back = np.array(Matrix.LocRotScale(position, rotation, scale))
        if np.abs(back - matrix).max() > 1e-4 * max(np.abs(matrix[:3, :3]).max(), 1e-9):
            losses.add("shear of instances", [item.name.split(" instance ")[0]])
    parts = np.array(parts)
    item.location, item.rotation_quaternion, item.scale = parts[0, :3], parts[0, 3:7], parts[0, 7:]
    for path, columns in (("location", parts[:, :3]), ("rotation_quaternion", parts[:, 3:7]), ("scale", parts[:, 7:])):
        if len(frames) > 1 and np.any(np.ptp(columns, axis=0) > 0):
            key_values(item, path, path, frames, columns)
