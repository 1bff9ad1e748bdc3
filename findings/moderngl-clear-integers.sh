#!/usr/bin/env bash
# Clearing an integer attachment: moderngl hands floats to glClear, whose result there OpenGL leaves undefined.
# Needs EGL with any driver (Debian: libegl1 and libgl1-mesa-dri).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install moderngl==5.13.0 numpy==2.4.6 || exit 2
cd "$folder" && "$folder/venv/bin/python" - <<'PYTHON'
import moderngl
import numpy as np

context = moderngl.create_context(standalone=True, backend="egl")
texture = context.texture((4, 4), 1, dtype="u4")
context.framebuffer([texture]).clear(1.0, 0.0, 0.0, 0.0)
found = int(np.frombuffer(texture.read(), np.uint32)[0])
print(f"moderngl 5.13.0 on {context.info['GL_RENDERER']}: clear(1.0) of a u4 texture gives {found} = {found:#x}")
raise SystemExit(found != 0x3F800000)
PYTHON
