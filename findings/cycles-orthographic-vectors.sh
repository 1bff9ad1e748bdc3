#!/usr/bin/env bash
# A moving orthographic camera over a still plane: Cycles' Vector pass projects the previous frame in perspective.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
for package in bpy==4.5.15 OpenEXR==3.5.3; do # each with the NumPy that it needs
  python3.11 -m venv "$folder/${package%%=*}" || exit 2
  "$folder/${package%%=*}/bin/pip" -q --disable-pip-version-check install "$package" || exit 2
done
cd "$folder"
cat >render.py <<'PYTHON'
import os

import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
bpy.ops.mesh.primitive_plane_add(size=20)
lens = bpy.data.cameras.new("camera")
lens.type, lens.ortho_scale = "ORTHO", 4.0  # meters across 64 pixels
camera = bpy.data.objects.new("camera", lens)
scene.collection.objects.link(camera)
scene.camera = camera
for frame in range(12):
    camera.location = (0.1 * frame, 0.0, 8.0)  # 0.1 m a frame: 1.6 pixels
    camera.keyframe_insert("location", frame=frame)
scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 1, "CPU"
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 64, 32, 100
scene.view_layers[0].use_pass_vector = True
scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
scene.frame_set(5)
scene.render.filepath = os.path.abspath("vectors.exr")
bpy.ops.render.render(write_still=True)
os._exit(0)
PYTHON
bpy/bin/python render.py >/dev/null 2>&1 || exit 2
OpenEXR/bin/python - <<'PYTHON'
import OpenEXR

channels = OpenEXR.File("vectors.exr", separate_channels=True).channels()
row = channels["ViewLayer.Vector.X"].pixels[16]
print(f"Cycles of bpy 4.5.15: vectors along one row, all of which should be 1.6 px: {row[::9].round(2).tolist()}")
raise SystemExit(not row.max() - row.min() > 5.0)
PYTHON
