#!/usr/bin/env bash
# Mesa's software rasterizer ends each loop of a shader after 65,535 iterations and reports nothing.
# Needs EGL with Mesa's llvmpipe (Debian: libegl1 and libgl1-mesa-dri).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install moderngl==5.13.0 numpy==2.4.6 || exit 2
cd "$folder" && "$folder/venv/bin/python" - <<'PYTHON'
import moderngl
import numpy as np

context = moderngl.create_context(standalone=True, backend="egl")
result = context.buffer(reserve=4)
result.bind_to_storage_buffer(0)
shader = context.compute_shader("""#version 430
layout(local_size_x = 1) in;
layout(std430, binding = 0) buffer Result { uint result; };
uniform uint count;
void main() {
    uint counted = 0u;
    for (uint i = 0u; i < count; ++i) counted += 1u;
    result = counted;
}""")
counted = {}
for count in (1_000, 65_535, 65_536, 100_000):
    shader["count"] = count
    shader.run(1, 1, 1)
    context.finish()
    counted[count] = int(np.frombuffer(result.read(), np.uint32)[0])
    print(f"{count:7,} iterations asked, {counted[count]:7,} counted, error {context.error}")
print(context.info["GL_RENDERER"], context.info["GL_VERSION"])
raise SystemExit(not all(n == min(count, 65_535) for count, n in counted.items()))
PYTHON
