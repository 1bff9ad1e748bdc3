#!/usr/bin/env bash
# Mesa's software rasterizer keeps the triangles of draws that wait for its threads, and their memory after they are drawn.
# Needs EGL with Mesa's llvmpipe (Debian: libegl1 and libgl1-mesa-dri), Linux with glibc.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install moderngl==5.13.0 numpy==2.4.6 || exit 2
cat > "$folder/draw.py" <<'PYTHON'
import ctypes
import sys

import moderngl
import numpy as np

DRAWS, TRIANGLES = 12, 100_000
wait = sys.argv[1] == "wait"


def resident():
    ctypes.CDLL(None).malloc_trim(0)
    return int(open("/proc/self/statm").read().split()[1]) * 4 // 1024


context = moderngl.create_context(standalone=True, backend="egl")
# Fragments take longer than the setup of a triangle, so that draws wait for the threads that rasterize.
program = context.program(
    vertex_shader="#version 330\nin vec2 p; void main() { gl_Position = vec4(p, 0.0, 1.0); }",
    fragment_shader="""#version 330
out float c;
void main() { float x = gl_FragCoord.x; for (int i = 0; i < 20; ++i) x = sin(x); c = x; }""",
)
corners = np.random.default_rng(1).uniform(-1, 1, (TRIANGLES, 1, 2)) + [[0, 0], [0.02, 0], [0, 0.02]]
array = context.vertex_array(program, context.buffer(corners.astype("f4")), "p")
context.framebuffer([context.texture((512, 512), 1, dtype="f4")]).use()
array.render(vertices=3)
context.finish()
before = resident()
for _ in range(DRAWS):
    array.render()
    if wait:
        context.finish()
context.finish()
print(resident() - before, context.info["GL_RENDERER"], context.info["GL_VERSION"])
PYTHON
cd "$folder"
export LP_NUM_THREADS=1
waited=$("$folder/venv/bin/python" draw.py wait) piled=$("$folder/venv/bin/python" draw.py pile)
echo "memory that 12 draws of 100,000 triangles leave behind once all is drawn and freed blocks are returned, MiB:"
echo "  glFinish after each draw: ${waited%% *}; after the last: ${piled}"
[ "${piled%% *}" -gt $((3 * ${waited%% *})) ]
