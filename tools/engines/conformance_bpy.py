"""Frames of the conformance suite by Blender's Cycles or EEVEE, in the Python of Blender (bpy).

    python tools/engines/conformance_bpy.py SUITE FRAMES [--eevee] [CASE ...]

SUITE: the folder of ``taubench-gl conformance write``; FRAMES: the folder that gets CASE/frame_0000.exr and so on.  One
sample at the center of each pixel.  Score with the mapping ``blender``:

    taubench-gl conformance score exr:FRAMES --mapping blender
"""

import json
import os
import sys

import bpy

CRISP_FILTER_PX = 0.01  # the smallest filter width of Cycles


def load(path):
    """Import a scene; every object plays its own action, with its keys on frames from 0."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 24, 1.0
    bpy.ops.import_scene.gltf(filepath=path, import_shading="NORMALS")
    for owner in [*bpy.data.objects, *bpy.data.shape_keys]:
        animation = owner.animation_data
        if animation is None:
            continue
        # The importer leaves actions in muted tracks whose strips start at frame 1.
        for track in animation.nla_tracks:
            track.mute = True
            if animation.action is None and track.strips:
                animation.action = track.strips[0].action
                if hasattr(track.strips[0], "action_slot"):
                    animation.action_slot = track.strips[0].action_slot
    for action in bpy.data.actions:
        for curve in curves_of(action):
            for key in curve.keyframe_points:
                if abs(key.co.x - round(key.co.x)) < 0.01:  # float32 seconds
                    key.co.x = round(key.co.x)
            curve.update()
    return scene


def curves_of(action):
    """F-curves of an action, of all its slots."""
    if not hasattr(action, "layers") or not action.layers:
        return list(action.fcurves)
    return [curve for layer in action.layers for strip in layer.strips for bag in strip.channelbags
            for curve in bag.fcurves]  # fmt: skip


def cull_back_faces():
    """Hide back faces of single-sided materials from the camera, as glTF requires."""
    for material in bpy.data.materials:
        if not material.use_backface_culling or not material.use_nodes:
            continue
        nodes, links = material.node_tree.nodes, material.node_tree.links
        output = next(n for n in nodes if n.type == "OUTPUT_MATERIAL")
        surface = output.inputs["Surface"].links[0].from_socket
        mix = nodes.new("ShaderNodeMixShader")
        links.new(nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], mix.inputs[0])
        links.new(surface, mix.inputs[1])
        links.new(nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[2])
        links.new(mix.outputs[0], output.inputs["Surface"])


def configure(scene, size):
    """One sample per pixel at its center, and the passes that are scored."""
    render, cycles = scene.render, scene.cycles
    if "--eevee" in sys.argv:
        render.engine = "BLENDER_EEVEE_NEXT" if bpy.app.version < (5, 0) else "BLENDER_EEVEE"
        scene.eevee.taa_render_samples, render.filter_size = 1, 0.0
    else:
        render.engine = "CYCLES"
    cycles.device, cycles.samples, cycles.max_bounces = "CPU", 1, 0
    cycles.transparent_max_bounces = 64
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", CRISP_FILTER_PX
    render.use_motion_blur = render.film_transparent = False
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage, render.threads_mode, render.threads = 100, "FIXED", 1
    layer = scene.view_layers[0]
    for name in ("z", "position", "normal", "vector"):
        setattr(layer, f"use_pass_{name}", True)
    settings = render.image_settings
    if hasattr(settings, "media_type"):  # Blender 5
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth, settings.exr_codec = "OPEN_EXR_MULTILAYER", "32", "ZIP"


def main(suite, frames, names):
    with open(os.path.join(suite, "suite.json"), encoding="utf-8") as file:
        listed = json.load(file)
    size = (listed["width"], listed["height"])
    for case in listed["cases"]:
        if names and case["name"] not in names:
            continue
        scene = load(os.path.join(suite, case["scene"]))
        scene.camera = next(o for o in bpy.data.objects if o.type == "CAMERA")
        configure(scene, size)
        if "--eevee" not in sys.argv:  # EEVEE culls by itself
            cull_back_faces()
        for number, frame in enumerate(case["frames"]):
            lens, (right, down) = scene.camera.data, frame["jitter_px"]
            # The unit of the shift is the side that the sensor is fitted to.
            side = size[1] if lens.sensor_fit == "VERTICAL" else max(size)
            lens.shift_x, lens.shift_y = right / side, -down / side
            scene.frame_set(number)
            scene.render.filepath = os.path.join(frames, case["name"], f"frame_{number:04d}.exr")
            bpy.ops.render.render(write_still=True)
        print(case["name"], bpy.app.version_string, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], os.path.abspath(sys.argv[2]), [name for name in sys.argv[3:] if name != "--eevee"])
    sys.stdout.flush()
    os._exit(0)  # the module of Blender can crash when the interpreter ends
