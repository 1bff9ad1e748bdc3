#!/usr/bin/env bash
# A USD file of 48 time codes a second: Blender plays it at 24, and leaves out samples of visibility and of light.
# Needs Python 3.11, for which bpy 4.5 is published.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python=$(command -v python3.11 || command -v python3)
"$python" -m venv env && env/bin/pip install --quiet bpy==4.5.15 || exit 2
cat >in.usda <<'USD'
#usda 1.0
(
    timeCodesPerSecond = 48
    startTimeCode = 0
    endTimeCode = 48
)
def Mesh "blink"
{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    token visibility.timeSamples = { 0: "inherited", 24: "invisible" }
    double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 48: (1, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "lamp"
{
    float inputs:intensity.timeSamples = { 0: 10, 48: 30 }
    float inputs:radius = 0.5
}
def DistantLight "sun"
{
    float inputs:intensity = 2
    bool inputs:normalize = 1
}
USD
cat >look.py <<'PY'
import os, sys
import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath="in.usda")
scene, data = bpy.context.scene, bpy.data
rate, last = scene.render.fps / scene.render.fps_base, scene.frame_end
scene.frame_set(36)
hidden = data.objects["blink"].hide_render or data.objects["blink"].hide_viewport
lamp, sun = data.lights["lamp"], data.lights["sun"]
animated = bool(lamp.animation_data and (lamp.animation_data.action or lamp.animation_data.drivers))
print(f"Blender {bpy.app.version_string}: 1 s of 48 time codes has {last} frames at {rate:g} per second, {last / rate:g} s; "
      f"hidden at code 36: {hidden}; lamp animated: {animated}; a normalized sun of intensity 2 has {sun.energy:g} W/m2")
sys.stdout.flush()
os._exit(0 if (rate, last, hidden, animated, sun.energy) == (24.0, 48, False, False, 8.0) else 1)
PY
env/bin/python look.py 2>/dev/null | grep '^Blender'
