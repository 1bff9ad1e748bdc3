"""Runs in Blender's Python: makes a .blend file with what a conversion must keep, and samples what Blender draws.

python bridge_scene.py make scene.blend
python bridge_scene.py sample scene.blend samples.npz
python bridge_scene.py export scene.blend scene.usdc|scene.abc
"""

import math
import os
import sys

import bpy
import numpy as np

FRAMES = (1, 13)
DRAWN = ("MESH", "META")
"""Types of what is drawn; curves and text are in the depsgraph as instances of their mesh, too."""
NOT_RENDERED = ("unseen",)
"""Objects of a collection that is hidden in renders."""


def key(owner, path, values):
    """Key ``path`` linearly: frame -> value."""
    for frame, value in values.items():
        setattr(owner, path, value)
        owner.keyframe_insert(path, frame=frame)
    for layer in owner.id_data.animation_data.action.layers:
        for strip in layer.strips:
            for bag in strip.channelbags:
                for curve in bag.fcurves:
                    for point in curve.keyframe_points:
                        point.interpolation = "LINEAR"


def mesh_object(name, vertices, faces, location=(0, 0, 0)):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    item = bpy.data.objects.new(name, mesh)
    item.location = location
    bpy.context.scene.collection.objects.link(item)
    return item


def cube(name, size=1.0, location=(0, 0, 0)):
    s = 0.5 * size
    corners = [(x, y, z) for x in (-s, s) for y in (-s, s) for z in (-s, s)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return mesh_object(name, corners, faces, location)


def shape_keys():
    # Shape keys behind an array, which is linear in them.
    bent = cube("bent", 0.8, (-4, 0, 1))
    bent.shape_key_add(name="Basis")
    tall = bent.shape_key_add(name='tall "key"')
    for point in tall.data:
        point.co.z *= 2.0 if point.co.z > 0 else 1.0
    for frame, value in ((1, 0.0), (7, 1.0), (13, 0.25)):
        tall.value = value
        tall.keyframe_insert("value", frame=frame)
    array = bent.modifiers.new("array", "ARRAY")
    array.count, array.relative_offset_displace = 3, (0.0, 1.4, 0.0)

    # Shape keys behind a modifier that is not linear in them, and a modifier that moves by itself.
    twisted = cube("twisted", 1.0, (-2, 2, 1))
    twisted.shape_key_add(name="Basis")
    wide = twisted.shape_key_add(name="wide")
    for point in wide.data:
        point.co.x *= 2.0
    for frame, value in ((1, 0.0), (13, 1.0)):
        wide.value = value
        wide.keyframe_insert("value", frame=frame)
    twist = twisted.modifiers.new("twist", "SIMPLE_DEFORM")
    twist.deform_method, twist.deform_axis, twist.angle = "TWIST", "X", 1.0


def curve(scene):
    """A tube along a curve, which moves and grows."""
    tube = bpy.data.objects.new("tube", bpy.data.curves.new("tube", "CURVE"))
    tube.data.dimensions, tube.data.bevel_depth = "3D", 0.1
    line = tube.data.splines.new("POLY")
    line.points.add(2)
    for point, place in zip(line.points, ((0, 0, 0), (0, 0, 1), (1, 0, 1)), strict=True):
        point.co = (*place, 1.0)
    scene.collection.objects.link(tube)
    key(tube, "location", {1: (-4, 4, 0), 13: (-4, 4.5, 0)})
    key(tube.data, "bevel_depth", {1: 0.1, 13: 0.2})


def not_rendered(scene):
    """A cube and a lamp in a collection that is hidden in renders."""
    left_out = bpy.data.collections.new("left out")
    scene.collection.children.link(left_out)
    left_out.hide_render = True
    lamp = bpy.data.objects.new("dark", bpy.data.lights.new("dark", "POINT"))
    for item in (cube("unseen", 3.0, (0, 0, 2)), lamp):
        left_out.objects.link(item)
        if item.name in scene.collection.objects:
            scene.collection.objects.unlink(item)


def make(path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = FRAMES
    scene.render.fps = 24
    floor = mesh_object("floor", [(-6, -6, 0), (6, -6, 0), (6, 6, 0), (-6, 6, 0)], [(0, 1, 2, 3)])
    floor.data.materials.append(bpy.data.materials.new("gray"))

    shape_keys()
    waves = mesh_object(
        "waves",
        [(0.2 * i - 1, 0.2 * j - 1, 0) for j in range(11) for i in range(11)],
        [(11 * j + i, 11 * j + i + 1, 11 * j + i + 12, 11 * j + i + 11) for j in range(10) for i in range(10)],
        (2.5, 2.5, 1.5),
    )
    waves.modifiers.new("wave", "WAVE")

    # An array without shape keys; it must stay although another object has some.
    row = cube("row", 0.4, (0, -3, 0.2))
    row.modifiers.new("array", "ARRAY").count = 4
    key(row, "location", {1: (0, -3, 0.2), 13: (1, -3, 0.2)})

    skinned()
    curve(scene)
    not_rendered(scene)
    instances(cube("seed", 0.2, (0, 0, -50)))
    follower = cube("follower", 0.5, (3, -2, 1))
    constraint = follower.constraints.new("TRACK_TO")
    constraint.target = row
    blink = cube("blink", 0.3, (0, 3, 2))
    for frame, hidden in ((1, False), (6, True), (10, False)):
        blink.hide_render = hidden
        blink.keyframe_insert("hide_render", frame=frame)
    hidden = cube("hidden", 2.0, (0, 0, 5))
    hidden.hide_render = True
    noisy = bpy.data.materials.new("noisy")
    noisy.use_nodes = True
    nodes, links = noisy.node_tree.nodes, noisy.node_tree.links
    links.new(nodes.new("ShaderNodeTexNoise").outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    follower.data.materials.append(noisy)

    lights_and_camera(scene)
    world(scene)
    bpy.ops.wm.save_as_mainfile(filepath=path)


def skinned():
    """A mirrored column that a bone bends; the mirror comes before the armature."""
    bones = bpy.data.armatures.new("bones")
    rig = bpy.data.objects.new("rig", bones)
    rig.location = (4, 3, 0)
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for name, low in (("lower", 0.0), ("upper", 1.0)):
        bone = bones.edit_bones.new(name)
        bone.head, bone.tail = (0, 0, low), (0, 0, low + 1)
    bones.edit_bones["upper"].parent = bones.edit_bones["lower"]
    bpy.ops.object.mode_set(mode="OBJECT")
    corners = [(x, y, z) for z in (0.0, 1.0, 2.0) for x, y in ((0.1, -0.2), (0.5, -0.2), (0.5, 0.2), (0.1, 0.2))]
    faces = [(4 * k + i, 4 * k + (i + 1) % 4, 4 * k + 4 + (i + 1) % 4, 4 * k + 4 + i) for k in (0, 1) for i in range(4)]
    column = mesh_object("column", corners, faces)
    column.parent = rig
    for name, weights in (("lower", (1.0, 0.5, 0.0)), ("upper", (0.0, 0.5, 1.0))):
        group = column.vertex_groups.new(name=name)
        for ring, weight in enumerate(weights):
            group.add(list(range(4 * ring, 4 * ring + 4)), weight, "REPLACE")
    column.modifiers.new("mirror", "MIRROR")
    column.modifiers.new("armature", "ARMATURE").object = rig
    bone = rig.pose.bones["upper"]
    bone.rotation_mode = "XYZ"
    for frame, angle in ((1, 0.0), (13, 1.0)):
        bone.rotation_euler = (angle, 0, 0)
        bone.keyframe_insert("rotation_euler", frame=frame)


def instances(seed):
    """Six copies of ``seed`` on a circle that turns with the scene's time, by geometry nodes."""
    tree = bpy.data.node_groups.new("ring", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    nodes, links = tree.nodes, tree.links
    circle = nodes.new("GeometryNodeMeshCircle")
    circle.inputs["Vertices"].default_value, circle.inputs["Radius"].default_value = 6, 1.5
    place, info = nodes.new("GeometryNodeInstanceOnPoints"), nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = seed
    info.transform_space = "ORIGINAL"
    turn, time = nodes.new("GeometryNodeRotateInstances"), nodes.new("GeometryNodeInputSceneTime")
    vector, out = nodes.new("ShaderNodeCombineXYZ"), nodes.new("NodeGroupOutput")
    move = nodes.new("GeometryNodeTranslateInstances")
    links.new(circle.outputs["Mesh"], place.inputs["Points"])
    links.new(info.outputs["Geometry"], place.inputs["Instance"])
    links.new(time.outputs["Seconds"], vector.inputs["Z"])
    links.new(place.outputs["Instances"], turn.inputs["Instances"])
    links.new(vector.outputs["Vector"], turn.inputs["Rotation"])
    links.new(turn.outputs["Instances"], move.inputs["Instances"])
    links.new(vector.outputs["Vector"], move.inputs["Translation"])
    links.new(move.outputs["Instances"], out.inputs["Geometry"])
    ring = mesh_object("ring", [(0, 0, 0)], [], (0, 0, 1))
    ring.modifiers.new("ring", "NODES").node_group = tree


def lights_and_camera(scene):
    area = bpy.data.lights.new("panel", "AREA")
    area.shape, area.size, area.size_y, area.energy, area.color = "RECTANGLE", 2.0, 1.0, 90.0, (1.0, 0.5, 0.25)
    panel = bpy.data.objects.new("panel", area)
    panel.location = (0, 0, 4)
    scene.collection.objects.link(panel)
    point = bpy.data.lights.new("lamp", "POINT")
    lamp = bpy.data.objects.new("lamp", point)
    lamp.location = (2, 0, 3)
    scene.collection.objects.link(lamp)
    key(point, "energy", {1: 50.0, 13: 200.0})
    lens = bpy.data.cameras.new("eye")
    eye = bpy.data.objects.new("eye", lens)
    eye.rotation_euler = (1.1, 0.0, 0.3)
    scene.collection.objects.link(eye)
    scene.camera = eye
    key(eye, "location", {1: (3, -9, 5), 13: (3.5, -8.5, 5)})
    key(lens, "lens", {1: 35.0, 13: 70.0})


def world(scene, width=64):
    """Equirectangular noise of strength 2, turned by 90 degrees about the vertical axis."""
    rng = np.random.default_rng(1)
    image = bpy.data.images.new("sky", width, width // 2, float_buffer=True)
    pixels = np.ones((width // 2, width, 4), dtype=np.float32)
    pixels[..., :3] = rng.random((width // 2, width, 3)) * np.linspace(0.1, 1.0, width // 2)[:, None, None]
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    nodes, links = scene.world.node_tree.nodes, scene.world.node_tree.links
    texture, mapping, where = (nodes.new(f"ShaderNode{n}") for n in ("TexEnvironment", "Mapping", "TexCoord"))
    texture.image = image
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, 0.5 * math.pi)
    links.new(where.outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], nodes["Background"].inputs["Color"])
    nodes["Background"].inputs["Strength"].default_value = 2.0


def sample(path, out):
    """What Blender draws at every frame: vertices in glTF's axes, camera, field of view, power of the lamp."""
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=False, use_scripts=False)
    scene, found = bpy.context.scene, {}
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        depsgraph, points = bpy.context.evaluated_depsgraph_get(), []
        for entry in depsgraph.object_instances:
            item = entry.object
            if (
                item.type not in DRAWN
                or item.original.hide_render
                or item.original.name in NOT_RENDERED
                or not (entry.is_instance or entry.show_self)
            ):
                continue
            mesh = item.to_mesh()
            vertices = np.empty(3 * len(mesh.vertices))
            mesh.vertices.foreach_get("co", vertices)
            matrix = np.array(entry.matrix_world, dtype=np.float64)
            if len(mesh.polygons):
                points.append(vertices.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])
            item.to_mesh_clear()
        x, y, z = np.concatenate(points).T
        eye = scene.camera.evaluated_get(depsgraph)
        found[f"points{frame}"] = np.stack([x, z, -y], axis=1)
        found[f"eye{frame}"] = np.array(eye.matrix_world)
        found[f"angle{frame}"] = eye.data.angle_x
        if "lamp" in bpy.data.lights:
            found[f"lamp{frame}"] = bpy.data.lights["lamp"].energy
    np.savez(out, **found)


NOT_EXPORTED = {
    ".abc": ("ring", "blink", "hidden", "twisted", "unseen", "dark", "tube"),
    ".usdc": ("ring", "blink", "hidden", "bent", "twisted", "column", "rig", "unseen", "dark", "tube"),
}
"""What Blender's exporters change: instances become empty meshes, shape keys of USD lose the modifiers behind them."""


def export(path, out):
    """Write the scene as ``out``, and what is in it as ``out`` + .blend."""
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=False, use_scripts=False)
    scene = bpy.context.scene
    for name in NOT_EXPORTED[os.path.splitext(out)[1]]:
        bpy.data.objects.remove(bpy.data.objects[name])
    bpy.ops.wm.save_as_mainfile(filepath=out + ".blend", copy=True)
    if out.endswith(".abc"):
        first, last = scene.frame_start, scene.frame_end
        bpy.ops.wm.alembic_export(
            filepath=out, start=first, end=last, as_background_job=False, evaluation_mode="RENDER"
        )
    else:
        bpy.ops.wm.usd_export(filepath=out, export_animation=True, evaluation_mode="RENDER")


def kinds(path):
    """Text, a metaball, instances of a collection and of particles, a parent; 29.97 frames a second from frame 3 on."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 3, 8
    scene.render.fps, scene.render.fps_base = 30, 1.001
    text = bpy.data.objects.new("text", bpy.data.curves.new("text", "FONT"))
    text.data.body, text.data.extrude = "Hi", 0.1
    ball = bpy.data.objects.new("ball", bpy.data.metaballs.new("ball"))
    ball.data.elements.new()
    ball.location = (3, 0, 0)
    for item in (text, ball):
        scene.collection.objects.link(item)
    key(text, "location", {3: (0, 0, 0), 8: (1, 0, 0)})
    group = bpy.data.collections.new("group")
    source = cube("source", 0.5)
    scene.collection.objects.unlink(source)
    group.objects.link(source)
    key(source, "location", {3: (0, 0, 0), 8: (0, 0, 1)})
    for k in range(3):
        copy = bpy.data.objects.new(f"copy{k}", None)
        copy.instance_type, copy.instance_collection, copy.location = "COLLECTION", group, (k, 3, 0)
        scene.collection.objects.link(copy)
    field = mesh_object("field", [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2, 3)], (0, -3, 0))
    field.modifiers.new("grains", "PARTICLE_SYSTEM")
    grains = field.particle_systems[0].settings
    grains.type, grains.count, grains.render_type = "HAIR", 20, "OBJECT"
    grains.instance_object = cube("grain", 0.1, (0, 0, -9))
    parent, child = cube("parent", 0.3, (5, 5, 0)), cube("child", 0.2, (1, 0, 0))
    child.parent, parent.scale = parent, (1, 2, 1)
    key(parent, "rotation_euler", {3: (0, 0, 0), 8: (0, 0, 2)})
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    eye.location = (0, -10, 3)
    scene.collection.objects.link(eye)
    scene.camera = eye
    bpy.ops.wm.save_as_mainfile(filepath=path)


if __name__ == "__main__":
    {"make": make, "sample": sample, "export": export, "kinds": kinds}[sys.argv[1]](*sys.argv[2:])
    sys.stdout.flush()
    os._exit(0)
