"""Compute programs made of the project's includes and a few lines of a test."""

from __future__ import annotations

import moderngl
import numpy as np

from taubench_gl.gpu import shader
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import Source, compile_compute, resolve
from taubench_gl.paths import SHADERS

ROWS = """
layout(local_size_x = 64) in;
layout(std430, binding = {first}) readonly buffer In {{ vec4 rows[]; }};
layout(std430, binding = {second}) writeonly buffer Out {{ vec4 results[]; }};
uniform uint count;
"""


def rows_glsl(main: str, first: int = 0) -> str:
    """GLSL that has rows in buffer ``first`` and results in the next, then the text ``main``."""
    return ROWS.format(first=first, second=first + 1) + main


def with_main(
    gpu: Gpu, includes: str, main: str, defines: dict[str, object] | None = None, preamble: str = ""
) -> moderngl.ComputeShader:
    """A program of ``includes`` (paths from the shaders folder, a space between them) and the text ``main``."""
    first, *rest = includes.split()
    source = resolve(first, defines, preamble)
    lines, origin = source.text.splitlines(), list(source.origin)
    for include in rest:
        seen = {line.rpartition(":")[0] for line in origin}
        shader._expand(include, (SHADERS,), lines, origin, seen, ())
    origin += [f"main:{i}" for i in range(1, len(main.splitlines()) + 1)]
    return compile_compute(gpu.ctx, Source("\n".join([*lines, main]) + "\n", tuple(origin)))


def map_rows(gpu: Gpu, program: moderngl.ComputeShader, rows: np.ndarray, width: int) -> np.ndarray:
    """Run ``program`` (buffer 0 in, buffer 1 out, uniform ``count``) over ``rows`` (N, ...) float32 -> (N, width)."""
    source = gpu.ctx.buffer(np.ascontiguousarray(rows, dtype=np.float32).tobytes())
    out = gpu.ctx.buffer(reserve=4 * width * len(rows))
    source.bind_to_storage_buffer(0)
    out.bind_to_storage_buffer(1)
    program["count"] = len(rows)
    program.run(-(-len(rows) // 64))
    gpu.ctx.finish()
    values = np.frombuffer(out.read(), dtype=np.float32).reshape(len(rows), width)
    for item in (source, out, program):
        item.release()
    return values
