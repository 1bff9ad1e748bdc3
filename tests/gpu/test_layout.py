"""Structs shared with GLSL: every field, written in Python, is read back from the GPU bit for bit."""

from __future__ import annotations

import importlib
import pkgutil

import numpy as np
import pytest

import taubench_gl.frame
from taubench_gl.gpu.layout import TYPES, Field, Struct

WORDS = {name: int(np.prod(shape, dtype=int)) for name, (_, shape, _) in TYPES.items()}


def all_structs() -> dict[str, Struct]:
    """Every Struct a module of ``frame`` declares, by its GLSL name."""
    found = {}
    for info in pkgutil.walk_packages(taubench_gl.frame.__path__, "taubench_gl.frame."):
        for value in vars(importlib.import_module(info.name)).values():
            if isinstance(value, Struct):
                found[value.name] = value
    return found


STRUCTS = all_structs() | {
    "Awkward": Struct(
        "Awkward",
        Field("a", "float", ""),
        Field("b", "vec2", ""),
        Field("c", "uint", ""),
        Field("d", "mat4", ""),
        Field("e", "float", "", 3),
        Field("f", "vec2", "", 2),
        Field("g", "int", ""),
        Field("h", "ivec4", "", 2),
        Field("i", "uvec4", ""),
        Field("j", "float", ""),
    )
}


def words_of(field: Field, access: str) -> list[str]:
    """GLSL expressions for the 32-bit words of one element."""
    bits = {"f": "floatBitsToUint({})", "i": "uint({})", "u": "{}"}
    kind = bits[np.dtype(TYPES[field.type][0]).kind]
    if field.type == "mat4":
        return [kind.format(f"{access}[{column}][{row}]") for column in range(4) for row in range(4)]
    if WORDS[field.type] == 1:
        return [kind.format(access)]
    return [kind.format(f"{access}[{i}]") for i in range(WORDS[field.type])]


def echo_source(struct: Struct) -> tuple[str, int]:
    lines = []
    for field in struct.fields:
        for i in range(max(field.count, 1)):
            access = f"items[i].{field.name}" + (f"[{i}]" if field.count else "")
            lines += words_of(field, access)
    body = "\n".join(f"    words[base + {n}u] = {expression};" for n, expression in enumerate(lines))
    source = f"""#version 450
layout(local_size_x = 1) in;
{struct.glsl}
layout(std430, binding = 0) readonly buffer Items {{ {struct.name} items[]; }};
layout(std430, binding = 1) writeonly buffer Words {{ uint words[]; }};
void main() {{
    uint i = gl_GlobalInvocationID.x, base = i * {len(lines)}u;
{body}
}}
"""
    return source, len(lines)


def test_the_frame_package_has_structs() -> None:
    assert {"DrawRecord", "MaterialRecord", "FrameRecord", "Reprojection", "DeformJob", "MorphUse"} <= set(STRUCTS)


@pytest.mark.parametrize("name", sorted(STRUCTS))
def test_every_field_comes_back_bit_for_bit(gpu, name: str) -> None:
    struct, count = STRUCTS[name], 3
    rng = np.random.default_rng(7)
    items = struct.zeros(count)
    expected = []
    for item in items:
        for field in struct.fields:
            base, shape, _ = TYPES[field.type]
            shape = (field.count, *shape) if field.count else shape
            # Exponents away from NaN, Inf and denormals, which a copy through a float register may not keep.
            bits = rng.integers(0x01000000, 0x70000000, shape, dtype=np.uint32)
            item[field.name] = bits.view(base)
            expected.append(np.asarray(bits).reshape(-1))
    source, words = echo_source(struct)
    program = gpu.ctx.compute_shader(source)
    source_buffer, sink = gpu.ctx.buffer(items.tobytes()), gpu.ctx.buffer(reserve=4 * words * count)
    source_buffer.bind_to_storage_buffer(0)
    sink.bind_to_storage_buffer(1)
    program.run(count)
    gpu.ctx.memory_barrier()
    got = np.frombuffer(sink.read(), dtype=np.uint32)
    for item in (program, source_buffer, sink):
        item.release()
    np.testing.assert_array_equal(got, np.concatenate(expected))
