"""Renders the scene of scene.py with Blender: PYTHON_WITH_bpy blender.py SCENE OUT cycles|eevee."""

import json
import math
import sys
from pathlib import Path

import bpy
from mathutils import Matrix

Z_UP = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))  # glTF axes -> Blender's


def keyed(thing, values):
    """Keys of location and rotation in every frame."""
    thing.rotation_mode = "QUATERNION"
    for frame, matrix in values.items():
        thing.location, thing.rotation_quaternion, _ = matrix.decompose()
        thing.keyframe_insert("location", frame=frame)
        thing.keyframe_insert("rotation_quaternion", frame=frame)


def main(scene_folder, out, engine):
    """Render all frames to multilayer EXR files."""
    poses = json.loads((Path(scene_folder) / "poses.json").read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, layer = bpy.context.scene, bpy.context.view_layer
    frames = {int(n): entry for n, entry in poses["frames"].items()}
    for name, (positions, _, triangles) in poses["meshes"].items():
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata([(x, -z, y) for x, y, z in positions], [], triangles)
        thing = bpy.data.objects.new(name, mesh)
        scene.collection.objects.link(thing)
        keyed(thing, {n: Z_UP @ Matrix(entry[name]) @ Z_UP.inverted() for n, entry in frames.items()})
        if name in poses["morphs"]:
            thing.shape_key_add(name="Basis")
            key = thing.shape_key_add(name="up")
            for point, (x, y, z), (dx, dy, dz) in zip(key.data, positions, poses["morphs"][name], strict=True):
                point.co = (x + dx, -z - dz, y + dy)
            for n, entry in frames.items():
                key.value = entry["weight"]
                key.keyframe_insert("value", frame=n)
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.angle, camera.clip_start = "VERTICAL", poses["yfov"], poses["near"]
    view = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(view)
    keyed(view, {n: Z_UP @ Matrix(entry["camera"]) for n, entry in frames.items()})
    scene.camera = view
    light = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    light.rotation_euler = (0.5, 0.3, 0.0)
    scene.collection.objects.link(light)
    kinds = [item.identifier for item in scene.render.bl_rna.properties["engine"].enum_items]
    eevee = "BLENDER_EEVEE_NEXT" if "BLENDER_EEVEE_NEXT" in kinds else "BLENDER_EEVEE"
    scene.render.engine = "CYCLES" if engine == "cycles" else eevee
    if engine == "cycles":
        scene.cycles.samples, scene.cycles.use_denoising = 1, False
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BLACKMAN_HARRIS", 0.01
    else:
        scene.eevee.taa_render_samples = 16
    for name in ("position", "normal", "vector", "z"):
        setattr(layer, f"use_pass_{name}", True)
    render = scene.render
    render.resolution_x, render.resolution_y = poses["size"]
    render.fps, render.threads_mode, render.threads = 24, "FIXED", 1
    settings = render.image_settings
    if hasattr(settings, "media_type"):  # Blender 5
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    scene.frame_start, scene.frame_end = min(frames), max(frames)
    render.filepath = str(Path(out) / "frame_")
    assert math.isclose(camera.angle_y, poses["yfov"], rel_tol=1e-5)
    bpy.ops.render.render(animation=True)


if __name__ == "__main__":
    main(*sys.argv[1:4])
