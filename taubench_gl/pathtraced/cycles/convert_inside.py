"""Runs inside Blender's Python: one FBX or .blend file -> one .glb.  Imports nothing but bpy and the library.

    python convert_inside.py job.json

Speaks lines that start with ``@tb `` and hold one JSON object; everything else on its output is Blender's own.
"""

import json
import os
import sys

import bpy


def say(**values):
    print("@tb " + json.dumps(values), flush=True)


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        job = json.load(file)
    try:
        read(job["source"])
    except Exception as error:  # the importer was written for whole files: a broken one surfaces as anything
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        named = [line for line in lines if line.startswith("Error")] or lines[-1:] or [type(error).__name__]
        say(event="failed", why=named[-1].removeprefix("Error:").strip())
        stop(3)
    counts = {kind: sum(o.type == kind for o in bpy.data.objects) for kind in ("MESH", "CAMERA", "LIGHT", "ARMATURE")}
    bpy.ops.export_scene.gltf(
        filepath=job["target"],
        export_format="GLB",
        export_yup=True,
        export_cameras=True,
        export_lights=True,
        export_animations=True,
        export_animation_mode="ACTIONS",  # every action of every object, muted ones on tracks too
        export_tangents=False,  # ours are made as the exporter's would be
        export_apply=not any(o.type == "MESH" and o.data.shape_keys for o in bpy.data.objects),
        export_import_convert_lighting_mode=job["lights"],
    )
    say(event="done", blender=bpy.app.version_string, counts=counts, actions=len(bpy.data.actions))
    stop(0)


def read(source):
    if source.lower().endswith(".blend"):
        bpy.ops.wm.open_mainfile(filepath=source, load_ui=False, use_scripts=False)
    else:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.import_scene.fbx(filepath=source, anim_offset=0.0)  # its default is one frame late


def stop(code):
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # Blender's own threads have been seen to hang the interpreter's shutdown


if __name__ == "__main__":
    main()
