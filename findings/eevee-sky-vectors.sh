#!/usr/bin/env bash
# A camera that turns and then stands still: EEVEE's Vector pass of the sky forgets the motion from the frame before.
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
scene.world = bpy.data.worlds.new("sky")
bpy.ops.mesh.primitive_plane_add(size=18, location=(0, 0, -1))
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(camera)
scene.camera = camera
for frame in (1, 2, 3):  # turns by 0.02 radians a frame until frame 3
    camera.rotation_euler = (1.5, 0.0, 0.02 * (frame - 1))
    camera.keyframe_insert("rotation_euler", frame=frame)
scene.render.engine, scene.eevee.taa_render_samples = "BLENDER_EEVEE_NEXT", 1
scene.render.resolution_x, scene.render.resolution_y = 32, 18
scene.view_layers[0].use_pass_vector = True
scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
for frame in (2, 3):
    scene.frame_set(frame)
    scene.render.filepath = os.path.abspath(f"frame_{frame}.exr")
    bpy.ops.render.render(write_still=True)
os._exit(0)
PYTHON
bpy/bin/python render.py >/dev/null 2>&1 || exit 2
OpenEXR/bin/python - <<'PYTHON'
import OpenEXR

sky, floor = {}, {}
for frame in (2, 3):
    across = OpenEXR.File(f"frame_{frame}.exr", separate_channels=True).channels()["ViewLayer.Vector.X"].pixels
    sky[frame], floor[frame] = float(across[1, 16]), float(across[17, 16])
    print(f"EEVEE of bpy 4.5.15, frame {frame}: previous - current, sky {sky[frame]:.2f} px, floor {floor[frame]:.2f} px")
raise SystemExit(not (sky[2] < -0.5 and floor[3] < -0.5 and sky[3] == 0.0))
PYTHON
