"""Runs in Blender's Python: builds four small scenes with punctual lights, exports and renders them.

    python blender_scenes.py FOLDER SAMPLES [NAME...]

Writes FOLDER/NAME.glb with Blender's exporter (default light mode), and FOLDER/NAME/frame_NNNN.exr and
FOLDER/NAME/views.json with Cycles: direct light only, pixel centers, the same noise in every frame.  Frame f is at
f / 24 s.  Imports only bpy and the standard library; tools/blender_references starts it.
"""

import json
import math
import os
import random
import sys

import bpy
from mathutils import Matrix, Vector

SIZE = (96, 54)
FPS, FIRST, LAST = 24, 1, 16  # of the animation
FRAMES = range(1, 6)  # rendered
GLTF_FROM_BLENDER = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))
CRISP_FILTER_PX = 0.01


def material(name, color, roughness=0.6, metallic=0.0, image=None):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes = made.node_tree.nodes
    surface = nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = (*color, 1.0)
    surface.inputs["Roughness"].default_value = roughness
    surface.inputs["Metallic"].default_value = metallic
    if image is not None:
        texture = nodes.new("ShaderNodeTexImage")
        texture.image = image
        made.node_tree.links.new(texture.outputs["Color"], surface.inputs["Base Color"])
    return made


def checker(name, cells=16, pixels_per_cell=4):
    """Squares of random grays and browns, packed into the file."""
    size = cells * pixels_per_cell
    image = bpy.data.images.new(name, size, size)
    draw = random.Random(7)
    grid = [[0.25 + 0.6 * draw.random() for _ in range(cells)] for _ in range(cells)]
    values = []
    for y in range(size):
        for x in range(size):
            shade = grid[y // pixels_per_cell][x // pixels_per_cell]
            values += [shade, 0.9 * shade, 0.7 * shade, 1.0]
    image.pixels = values
    image.pack()
    return image


def finish(mesh, surface, name, location=(0, 0, 0), rotation=(0, 0, 0), scale=(1, 1, 1)):
    mesh.name = mesh.data.name = name
    mesh.data.materials.append(surface)
    mesh.location, mesh.rotation_euler, mesh.scale = location, rotation, scale
    return mesh


def box(surface, name, size, location, rotation=(0, 0, 0)):
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    return finish(bpy.context.object, surface, name, location, rotation, size)


def plane(surface, name, size, location=(0, 0, 0), rotation=(0, 0, 0)):
    bpy.ops.mesh.primitive_plane_add(size=1.0)
    return finish(bpy.context.object, surface, name, location, rotation, (*size, 1.0))


def ball(surface, name, radius, location):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=16, radius=radius)
    for polygon in bpy.context.object.data.polygons:
        polygon.use_smooth = True
    return finish(bpy.context.object, surface, name, location)


def light(kind, name, power, color, location=(0, 0, 0), rotation=(0, 0, 0), **values):
    """``power``: watts of a point or spot light, W/m2 of a sun."""
    data = bpy.data.lights.new(name, kind)
    data.energy, data.color = power, color
    if kind == "SUN":
        data.angle = 0.0
    else:
        data.shadow_soft_size = 0.0
    for key, value in values.items():
        setattr(data, key, value)
    owner = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(owner)
    owner.location, owner.rotation_euler = location, rotation
    return owner


def move(owner, path, values):
    """Key ``path`` at equal intervals from FIRST to LAST; Blender's default interpolation (Bezier)."""
    for i, value in enumerate(values):
        setattr(owner, path, value)
        owner.keyframe_insert(path, frame=FIRST + round(i * (LAST - FIRST) / (len(values) - 1)))


def camera(places, targets, degrees=60.0):
    """A camera that moves along ``places`` and looks at ``targets``."""
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.angle = "HORIZONTAL", math.radians(degrees)
    owner = bpy.data.objects.new("camera", data)
    bpy.context.collection.objects.link(owner)
    owner.rotation_mode = "QUATERNION"
    turns = [(Vector(t) - Vector(p)).to_track_quat("-Z", "Y") for p, t in zip(places, targets, strict=True)]
    move(owner, "location", places)
    move(owner, "rotation_quaternion", turns)
    bpy.context.scene.camera = owner


def room():
    """A closed room, two point lights, one of them moving, and a moving box."""
    white, red, green = (material(n, c) for n, c in (("white", (0.7, 0.7, 0.7)), ("red", (0.6, 0.1, 0.08)),
                                                     ("green", (0.1, 0.45, 0.12))))  # fmt: skip
    plane(white, "floor", (6, 6))
    plane(white, "ceiling", (6, 6), (0, 0, 3))
    for name, at, turn, surface in (("back", (0, 3, 1.5), 0, white), ("front", (0, -3, 1.5), 0, white),
                                    ("left", (-3, 0, 1.5), 90, red), ("right", (3, 0, 1.5), 90, green)):  # fmt: skip
        plane(surface, name, (6, 3), at, (math.radians(90), 0, math.radians(turn)))
    box(white, "tall", (0.9, 0.9, 1.7), (-1.1, 0.9, 0.85), (0, 0, 0.3))
    box(white, "table", (1.0, 1.4, 0.7), (1.2, -0.2, 0.35), (0, 0, -0.4))
    crate = box(red, "crate", (0.5, 0.5, 0.5), (0, 0, 0))
    move(crate, "location", [(-1.8, -1.0, 0.25), (1.8, 0.6, 0.25)])
    move(crate, "rotation_euler", [(0, 0, 0), (0, 0, 2.0)])
    light("POINT", "ceiling light", 250.0, (1.0, 0.9, 0.75), (0.6, 0.2, 2.6))
    lamp = light("POINT", "lamp", 300.0, (0.7, 0.85, 1.0))
    move(lamp, "location", [(-1.6, -1.2, 1.5), (0.0, -0.4, 1.9), (1.6, 1.2, 1.5)])
    camera([(-0.9, -2.6, 1.7), (0.7, -2.5, 1.5)], [(0.0, 0.6, 0.9), (0.3, 0.6, 0.8)])


def market():
    """Twenty point lights over a floor with columns; half of them and two balls move."""
    stone, wood, metal = (material("stone", (0.6, 0.58, 0.55)), material("wood", (0.5, 0.3, 0.15), 0.5),
                          material("metal", (0.8, 0.7, 0.5), 0.35, 1.0))  # fmt: skip
    plane(stone, "floor", (14, 14))
    for x in range(-2, 3):
        for y in range(-1, 3):
            box(wood, f"column {x} {y}", (0.35, 0.35, 1.6 + 0.2 * ((x + y) % 3)), (2.2 * x, 2.0 * y, 0.8))
    for i in range(2):
        moving = ball((metal, stone)[i], f"ball {i}", 0.4, (0, 0, 0))
        move(moving, "location", [(-2.5 + 2 * i, -1.0 + 2 * i, 0.4), (2.0 - 3 * i, 0.9 + i, 0.4)])
    draw = random.Random(11)
    for i in range(20):
        color = [(1.0, 0.55, 0.3), (0.5, 0.7, 1.0), (1.0, 0.95, 0.7), (0.6, 1.0, 0.6)][i % 4]
        at = Vector((-4.4 + 2.2 * (i % 5), -1.6 + 2.0 * (i // 5), 0.7 + 0.9 * draw.random()))
        lamp = light("POINT", f"lamp {i}", 40.0 + 40.0 * draw.random(), color, at)
        if i % 2:
            angle = 2.0 * math.pi * draw.random()
            step = Vector((math.cos(angle), math.sin(angle), 0.3))
            move(lamp, "location", [at, at + 1.2 * step, at])
    camera([(-1.4, -5.2, 2.2), (1.2, -4.9, 2.0)], [(0.0, 0.0, 0.5), (0.4, 0.4, 0.4)])


def yard():
    """A sinking sun over a textured ground, turning and sliding blocks, and a moving point light."""
    ground = material("ground", (1, 1, 1), 0.9, image=checker("stones"))
    plaster, metal = material("plaster", (0.75, 0.72, 0.65), 0.8), material("metal", (0.7, 0.72, 0.75), 0.4, 1.0)
    plane(ground, "ground", (16, 16))
    for i, (x, y, z) in enumerate(((-2.5, 1.5, 2.2), (0.4, 2.6, 1.2), (2.8, 0.8, 1.7), (-0.6, -0.8, 0.6))):
        block = box((plaster, metal)[i == 1], f"block {i}", (0.9, 0.9, z), (x, y, z / 2), (0, 0, 0.5 * i))
        if i == 3:
            move(block, "location", [(x, y, z / 2), (x + 2.4, y + 0.5, z / 2)])
        elif i == 2:
            move(block, "rotation_euler", [(0, 0, 0.0), (0, 0, 2.5)])
    sun = light("SUN", "sun", 5.0, (1.0, 0.93, 0.82))
    move(sun, "rotation_euler", [(0.75, 0.1, 0.5), (1.15, 0.1, 1.1)])
    lamp = light("POINT", "lamp", 400.0, (0.6, 0.75, 1.0))
    move(lamp, "location", [(-1.6, -1.6, 0.9), (1.8, -1.2, 1.1)])
    camera([(-1.5, -6.0, 2.4), (1.5, -5.6, 2.1)], [(0.0, 0.5, 0.6), (0.6, 0.5, 0.5)])


def stage():
    """Four spots of different blend sweep over a stage with balls and columns."""
    floor, wall, gold = (material("floor", (0.5, 0.45, 0.4), 0.5), material("wall", (0.6, 0.6, 0.65)),
                         material("gold", (0.9, 0.7, 0.3), 0.3, 1.0))  # fmt: skip
    plane(floor, "floor", (12, 10))
    plane(wall, "back", (12, 5), (0, 3, 2.5), (math.radians(90), 0, 0))
    for i in range(3):
        moving = ball((wall, gold, wall)[i], f"ball {i}", 0.5, (0, 0, 0))
        x = -2.2 + 2.2 * i
        move(moving, "location", [(x, 0.2 - 0.6 * i, 0.5), (x + 1.0, 0.8 - 0.6 * i, 0.5 + 0.8 * (i == 1))])
    for i in range(4):
        box(wall, f"column {i}", (0.3, 0.3, 2.6), (-3.6 + 2.4 * i, 2.0, 1.3))
    blends = (0.0, 0.15, 0.5, 1.0)  # 0.15 is Blender's default
    for i, blend in enumerate(blends):
        color = [(1.0, 0.6, 0.4), (0.5, 0.7, 1.0), (1.0, 1.0, 0.9), (0.7, 1.0, 0.6)][i]
        at = (-3.6 + 2.4 * i, -2.6, 3.6)
        spot = light("SPOT", f"spot {i}", 3000.0, color, at, spot_size=math.radians(26 + 5 * i), spot_blend=blend)
        side = -0.35 if i % 2 else 0.35
        move(spot, "rotation_euler", [(0.72, 0.0, -side), (0.66, 0.0, 0.2 * side), (0.7, 0.0, side)])
    camera([(-0.8, -5.8, 1.9), (0.8, -5.5, 1.7)], [(0.0, 0.5, 1.0), (0.2, 0.5, 0.9)])


SCENES = {"room": room, "market": market, "yard": yard, "stage": stage}


def configure(scene, samples):
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed = "CPU", samples, 0
    cycles.use_animated_seed = cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces = 0  # direct light only
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", CRISP_FILTER_PX
    render = scene.render
    render.use_motion_blur = render.film_transparent = False
    render.resolution_x, render.resolution_y = SIZE
    render.resolution_percentage = 100
    layer = scene.view_layers[0]
    layer.use_pass_z = True
    for lobe in ("diffuse", "glossy", "transmission"):
        for what in ("direct", "color"):
            setattr(layer, f"use_pass_{lobe}_{what}", True)
    render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    render.image_settings.color_depth, render.image_settings.exr_codec = "32", "ZIP"


def view(scene):
    """world_from_view with glTF axes, row by row, and the vertical field of view."""
    owner = scene.camera
    matrix = GLTF_FROM_BLENDER @ owner.matrix_world
    yfov = 2.0 * math.atan(math.tan(0.5 * owner.data.angle) * SIZE[1] / SIZE[0])
    return {"world_from_view": [list(row) for row in matrix], "yfov": yfov}


def main():
    folder, samples, names = sys.argv[1], int(sys.argv[2]), sys.argv[3:] or list(SCENES)
    for name in names:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene = bpy.context.scene
        scene.render.fps, scene.frame_start, scene.frame_end = FPS, FIRST, LAST
        scene.render.resolution_x, scene.render.resolution_y = SIZE
        SCENES[name]()
        bpy.ops.export_scene.gltf(filepath=os.path.join(folder, f"{name}.glb"), export_cameras=True, export_lights=True)
        configure(scene, samples)
        views = {}
        for frame in FRAMES:
            scene.frame_set(frame)
            views[frame] = view(scene)
            scene.render.filepath = os.path.join(folder, name, f"frame_{frame:04d}.exr")
            bpy.ops.render.render(write_still=True)
        with open(os.path.join(folder, name, "views.json"), "w", encoding="utf-8") as file:
            json.dump({"blender": bpy.app.version_string, "samples": samples, "fps": FPS, "views": views}, file)
    sys.stdout.flush()
    os._exit(0)  # Blender's threads can hang the interpreter's shutdown


if __name__ == "__main__":
    main()
