"""Area lights as emissive quads, and the world as an environment image.  Runs in Blender's Python."""

import math

import bpy
from convert_curves import is_animated
from mathutils import Vector

BACK_DISTANCE = 1e-3
"""Distance of the black back of an area light from its front, as a share of its smaller side."""
ROUND_SIDES = 32
MAX_WIDTH, SKY_WIDTH = 8192, 1024
"""Largest width of an environment image in pixels, and the width of a world without images."""
SKY_SAMPLES = 32


def replace_area_lights(scene, losses):
    """Give every area light a child that emits its power from one side.

    Radiance: power / (pi area), so that a diffuse emitter of that area has the same power.  The back is black: a second
    surface behind the first, because renderers differ in whether an emitter shines from both sides.
    """
    for light in [o for o in scene.objects if o.type == "LIGHT" and o.data.type == "AREA" and not o.hide_render]:
        data = light.data
        losses.add("area lights become panels, which the camera sees and which block light", [light.name])
        if getattr(data, "spread", math.pi) < math.pi - 1e-3:
            losses.add("the spread of area lights: they shine to all sides of their front", [light.name])
        if any(is_animated(data, path) for path in ("energy", "color", "size", "size_y")):
            losses.add("animated power, color or size of area lights: the first frame counts", [light.name])
        outline, area = outline_of(data, light.matrix_world)
        power = data.energy * 2.0 ** getattr(data, "exposure", 0.0)
        if not getattr(data, "normalize", True):
            power *= area
        radiance = power / (math.pi * area) if area > 0 else 0.0
        strongest = max(data.color) or 1.0
        front = emissive_material(f"{light.name} front", [c / strongest for c in data.color], radiance * strongest)
        back = emissive_material(f"{light.name} back", (0.0, 0.0, 0.0), 0.0)
        gap = BACK_DISTANCE * min(data.size, data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size)
        n = len(outline)
        vertices = [(x, y, 0.0) for x, y in outline] + [(x, y, gap) for x, y in outline]
        mesh = bpy.data.meshes.new(f"{light.name} emitter")
        # A light shines along -Z, where a counterclockwise outline seen from +Z has its back.
        mesh.from_pydata(vertices, [], [tuple(range(n))[::-1], tuple(range(n, 2 * n))])
        mesh.materials.append(front)
        mesh.materials.append(back)
        mesh.polygons[1].material_index = 1
        emitter = bpy.data.objects.new(f"{light.name} emitter", mesh)
        scene.collection.objects.link(emitter)
        emitter.parent = light


def outline_of(data, matrix):
    """Corners (x, y) of an area light in its own space, and its area in square meters."""
    x, y = 0.5 * data.size, 0.5 * (data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size)
    if data.shape in ("SQUARE", "RECTANGLE"):
        corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
        share = 4.0
    else:
        turns = [2.0 * math.pi * i / ROUND_SIDES for i in range(ROUND_SIDES)]
        corners = [(x * math.cos(a), y * math.sin(a)) for a in turns]
        share = 0.5 * ROUND_SIDES * math.sin(2.0 * math.pi / ROUND_SIDES)
    across = (matrix.to_3x3() @ Vector((1, 0, 0))).cross(matrix.to_3x3() @ Vector((0, 1, 0))).length
    return corners, share * x * y * across


def emissive_material(name, color, strength):
    """A black single-sided surface of the radiance ``color`` x ``strength``."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.use_backface_culling = True
    principled = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    principled.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    principled.inputs["Roughness"].default_value = 1.0
    principled.inputs["Specular IOR Level"].default_value = 0.0
    principled.inputs["Emission Color"].default_value = (*color, 1.0)
    principled.inputs["Emission Strength"].default_value = strength
    return material


def bake_world(scene, path, losses):
    """The world as the environment of the written file: None, [r, g, b], or ``path`` of an image that is written.

    The image is equirectangular with +X at its center, as Blender's: a panorama of an empty scene by Cycles.
    """
    world = scene.world
    if world is None:
        return None
    animated = world.animation_data or (world.node_tree and world.node_tree.animation_data)
    if animated and (animated.action or animated.drivers or animated.nla_tracks):
        losses.add("the animation of the world: its first frame is the environment")
    if not world.use_nodes:
        return list(world.color) if any(world.color) else None
    nodes = world.node_tree.nodes
    output = next((n for n in nodes if n.type == "OUTPUT_WORLD" and n.is_active_output), None)
    if output is None or not output.inputs["Surface"].links:
        return None
    if output.inputs["Volume"].is_linked:
        losses.add("the volume of the world")
    surface = output.inputs["Surface"].links[0].from_node
    if surface.type == "BACKGROUND" and not any(s.is_linked for s in surface.inputs):
        strength = surface.inputs["Strength"].default_value
        color = [strength * c for c in surface.inputs["Color"].default_value[:3]]
        return color if any(c > 0 for c in color) else None
    images = [n.image for n in nodes if n.type == "TEX_ENVIRONMENT" and n.image is not None]
    width = min(max((image.size[0] for image in images), default=SKY_WIDTH) or SKY_WIDTH, MAX_WIDTH) // 2 * 2
    _panorama(world, path, width, crisp=bool(images))
    return path


def _panorama(world, path, width, crisp):
    """Write the radiance of ``world`` as OpenEXR.  ``crisp``: at pixel centers, else the mean of each pixel."""
    scene = bpy.data.scenes.new("taubench world")
    scene.world = world
    camera = bpy.data.cameras.new("taubench world")
    camera.type = "PANO"
    holder = camera if hasattr(camera, "panorama_type") else camera.cycles
    holder.panorama_type = "EQUIRECTANGULAR"
    eye = bpy.data.objects.new("taubench world", camera)
    eye.rotation_euler = (0.5 * math.pi, 0.0, -0.5 * math.pi)  # towards +X, up is +Z
    scene.collection.objects.link(eye)
    scene.camera = eye
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, width // 2, 100
    render.film_transparent = False
    cycles.device = "CPU"
    cycles.samples = 1 if crisp else SKY_SAMPLES
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_direct = 0.0
    cycles.pixel_filter_type = "BLACKMAN_HARRIS" if crisp else "BOX"
    if crisp:
        cycles.filter_width = 0.01
    settings = render.image_settings
    if hasattr(settings, "media_type"):  # Blender 5
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    settings.exr_codec = "ZIP"
    render.filepath = path
    bpy.ops.render.render(write_still=True, scene=scene.name)
    bpy.data.scenes.remove(scene)
