"""Runs in Blender's Python: converts an FBX or .blend file to .glb.  Imports only bpy and the standard library.

    python convert_script.py job.json

Reports events as lines that start with ``@tb `` and hold one JSON object.  All other output is Blender's.
"""

import json
import os
import sys

import bpy


def report(**values):
    print("@tb " + json.dumps(values), flush=True)


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        job = json.load(file)
    try:
        read(job["source"])
    except Exception as error:  # the importer raises any type of exception for broken files
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        named = [line for line in lines if line.startswith("Error")] or lines[-1:] or [type(error).__name__]
        report(event="failed", why=named[-1].removeprefix("Error:").strip())
        stop(3)
    counts = {kind: sum(o.type == kind for o in bpy.data.objects) for kind in ("MESH", "CAMERA", "LIGHT", "ARMATURE")}
    bpy.ops.export_scene.gltf(
        filepath=job["target"],
        export_format="GLB",
        export_yup=True,
        export_cameras=True,
        export_lights=True,
        export_animations=True,
        export_animation_mode="ACTIONS",  # every action of every object, also on muted tracks
        export_tangents=False,  # the scene reader computes the same tangents
        export_apply=not any(o.type == "MESH" and o.data.shape_keys for o in bpy.data.objects),
        export_import_convert_lighting_mode=job["lights"],
    )
    report(event="done", blender=bpy.app.version_string, counts=counts, actions=len(bpy.data.actions))
    stop(0)


def read(source):
    if source.lower().endswith(".blend"):
        bpy.ops.wm.open_mainfile(filepath=source, load_ui=False, use_scripts=False)
    else:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.import_scene.fbx(filepath=source, anim_offset=0.0)  # the default is one frame late


def stop(code):
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # Blender's threads can hang the interpreter's shutdown


if __name__ == "__main__":
    main()
