"""Which accessor formats vertex attributes may have (glTF 2.0 section 3.7.2 and KHR_mesh_quantization)."""

from __future__ import annotations

import re

from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.accessors import Accessors
from taubench_gl.scene.gltf.document import Document

BYTE, UBYTE, SHORT, USHORT, FLOAT = 5120, 5121, 5122, 5123, 5126
_FLOAT = {(FLOAT, False)}
_UNSIGNED = {(UBYTE, True), (USHORT, True)}
_SIGNED = {(BYTE, True), (SHORT, True)}
_ANY = {(c, n) for c in (BYTE, UBYTE, SHORT, USHORT) for n in (False, True)}

Formats = dict[str, tuple[tuple[str, ...], set[tuple[int, bool]], set[tuple[int, bool]]]]

FORMATS: Formats = {
    "POSITION": (("VEC3",), _FLOAT, _ANY),
    "NORMAL": (("VEC3",), _FLOAT, _SIGNED),
    "TANGENT": (("VEC4",), _FLOAT, _SIGNED),
    "TEXCOORD": (("VEC2",), _FLOAT | _UNSIGNED, _ANY),
    "COLOR": (("VEC3", "VEC4"), _FLOAT | _UNSIGNED, set()),
    "JOINTS": (("VEC4",), {(UBYTE, False), (USHORT, False)}, set()),
    "WEIGHTS": (("VEC4",), _FLOAT | _UNSIGNED, set()),
}
"""Semantic -> accessor types, (component, normalized) of the core specification, those quantization adds."""

TARGET_FORMATS: Formats = {
    "POSITION": (("VEC3",), _FLOAT, {(c, n) for c in (BYTE, SHORT) for n in (False, True)}),
    "NORMAL": (("VEC3",), _FLOAT, _SIGNED),
    "TANGENT": (("VEC3",), _FLOAT, _SIGNED),
    "TEXCOORD": (("VEC2",), _FLOAT | _UNSIGNED | _SIGNED, _ANY),
    "COLOR": (("VEC3", "VEC4"), _FLOAT | _UNSIGNED | _SIGNED, set()),
}

_SEMANTIC = re.compile(r"POSITION|NORMAL|TANGENT|(?:TEXCOORD|COLOR|JOINTS|WEIGHTS)_(?:0|[1-9]\d{0,3})")


def check_semantics(document: Document, primitive: schema.Primitive, pointer: str) -> None:
    """Attribute names are glTF's or begin with an underscore; numbered ones count from 0 without a gap."""
    sets: dict[str, set[int]] = {}
    for name in primitive.attributes:
        if name.startswith("_"):
            continue
        where = f"{pointer}/attributes/{name}"
        if _SEMANTIC.fullmatch(name) is None:
            raise document.error("is no attribute of glTF 2.0", where, "names of your own begin with an underscore")
        base, _, number = name.partition("_")
        if number:
            sets.setdefault(base, set()).add(int(number))
    for base, numbers in sets.items():
        if max(numbers) != len(numbers) - 1:
            raise document.error(f"numbers of {base}_n do not count from 0 without a gap", f"{pointer}/attributes")
    if sets.get("JOINTS", set()) != sets.get("WEIGHTS", set()):
        raise document.error("JOINTS_n and WEIGHTS_n do not come in pairs", f"{pointer}/attributes")


def check_format(
    document: Document, accessors: Accessors, name: str, index: int, formats: Formats, pointer: str
) -> None:
    """The accessor's type, component type and normalization are among those its semantic may have."""
    accessor = accessors.get(index, pointer)
    if accessor.component_type == 5125:
        raise document.error("vertex attributes cannot be UNSIGNED_INT", pointer)
    if name.startswith("_"):
        return
    semantic = name.partition("_")[0]
    if semantic not in formats:
        raise document.error("is no attribute of a morph target", pointer)
    types, core, quantized = formats[semantic]
    allowed = core | quantized if "KHR_mesh_quantization" in (document.root.extensions_used or []) else core
    if accessor.type not in types or (accessor.component_type, accessor.normalized) not in allowed:
        hint = "KHR_mesh_quantization is not declared" if quantized and allowed is core else None
        raise document.error(f"{semantic} is {accessors.describe(index, pointer)}, which glTF does not allow", pointer,
                             hint)  # fmt: skip
