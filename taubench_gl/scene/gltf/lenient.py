"""Repairs of JSON that glTF's schema does not allow, driven by the types of ``schema``.

Members that are null, empty, out of range, of another type or an unknown word are limited or left out where glTF has a
default for them.  What decides where data lies or which surface it describes is never changed: there the typed decoder
raises.  An integral float where the schema wants an integer is converted before, as JSON does not distinguish the two.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec.inspect as types

from taubench_gl.errors import SceneError
from taubench_gl.scene.notes import Notes

GEOMETRY: dict[str, frozenset[str]] = {
    "Accessor": frozenset({"componentType", "count", "type", "byteOffset", "bufferView", "normalized", "sparse"}),
    "BufferView": frozenset({"buffer", "byteLength", "byteOffset", "byteStride"}),
    "Buffer": frozenset({"byteLength", "uri"}),
    "Primitive": frozenset({"attributes", "indices", "mode"}),
    "Node": frozenset({"children", "mesh", "translation", "rotation", "scale", "matrix"}),
    "Scene": frozenset({"nodes"}),
    "Skin": frozenset({"joints", "inverseBindMatrices"}),
    "Channel": frozenset({"sampler"}),
    "AnimationSampler": frozenset({"input", "output"}),
    "Root": frozenset(
        {"nodes", "meshes", "accessors", "bufferViews", "buffers", "skins", "scenes", "scene", "animations", "cameras"}
    ),
}
"""Struct -> members that are not left out for a wrong value; null and empty ones are."""

INSTEAD: dict[tuple[str, str], Any] = {
    ("Camera", "type"): "perspective",
    ("Perspective", "yfov"): math.pi / 4,
    ("Perspective", "znear"): 0.1,
    ("Orthographic", "znear"): 0.0,
}
"""Required members without a default -> value in place of a wrong one (those of ``model.Camera``)."""


class Lenient:
    """Repairs the JSON of one document or extension at ``pointer``; ``notes`` counts the repairs."""

    def __init__(self, notes: Notes, pointer: str):
        self.notes, self.pointer = notes, pointer

    def conform(self, value: Any, kind: type) -> Any:
        """``value``, decoded JSON, changed so that more of it fits ``kind``."""
        return self._walk(value, types.type_info(kind), self.pointer)[0]

    def _repaired(self, kind: str, pointer: str, detail: str) -> None:
        # Only lenient documents come here, so the error is never raised.
        self.notes.repair(kind, SceneError(kind, where=pointer), detail=detail, where=pointer or "/")

    def _walk(self, value: Any, kind: types.Type, pointer: str) -> tuple[Any, str]:
        """The repaired value, and a kind of repair if it does not fit and the member must be left out."""
        if isinstance(kind, types.UnionType):
            if value is None and kind.includes_none:
                return value, ""
            results = [self._walk(value, k, pointer) for k in kind.types if not isinstance(k, types.NoneType)]
            return next((result for result in results if not result[1]), results[0])
        if value is None and not isinstance(kind, types.AnyType):
            return value, "null-member"
        if isinstance(kind, types.StructType):
            return self._struct(value, kind, pointer)
        if isinstance(kind, types.ListType):
            return self._list(value, kind, pointer)
        if isinstance(kind, types.TupleType):
            return self._tuple(value, kind, pointer)
        if isinstance(kind, types.DictType):
            return self._dict(value, kind, pointer)
        return self._scalar(value, kind, pointer)

    def _struct(self, value: Any, kind: types.StructType, pointer: str) -> tuple[Any, str]:
        if not isinstance(value, dict):
            return value, "null-member" if value is None else "wrong-type"
        name, out = kind.cls.__name__, dict(value)
        required_members, unfit = GEOMETRY.get(name, frozenset()), False
        for field in kind.fields:
            member = field.encode_name
            if member not in out:
                continue
            where = f"{pointer}/{member}"
            new, fault = self._walk(out[member], field.type, where)
            out[member] = new
            if not fault:
                continue
            omitted = not field.required and (member not in required_members or fault in ("null-member", "empty-array"))
            if omitted:
                del out[member]
            elif (name, member) in INSTEAD:
                out[member] = INSTEAD[name, member]
            else:
                unfit = True  # the owner is left out, or the decoder raises
                continue
            self._repaired(fault, where, member)
        unfit = unfit or any(field.required and field.encode_name not in out for field in kind.fields)
        return out, "wrong-type" if unfit else ""

    def _list(self, value: Any, kind: types.ListType, pointer: str) -> tuple[Any, str]:
        if not isinstance(value, list):
            return value, "wrong-type"
        if not value and kind.min_length:
            return value, "empty-array"
        if len(value) < (kind.min_length or 0) or (kind.max_length and len(value) > kind.max_length):
            return value, "wrong-type"
        items = [self._walk(item, kind.item_type, f"{pointer}/{i}") for i, item in enumerate(value)]
        return [item for item, _ in items], next((fault for _, fault in items if fault), "")

    def _tuple(self, value: Any, kind: types.TupleType, pointer: str) -> tuple[Any, str]:
        if not isinstance(value, list) or len(value) != len(kind.item_types):
            return value, "wrong-type"
        items = [self._walk(v, k, f"{pointer}/{i}") for i, (v, k) in enumerate(zip(value, kind.item_types))]
        return [item for item, _ in items], next((fault for _, fault in items if fault), "")

    def _dict(self, value: Any, kind: types.DictType, pointer: str) -> tuple[Any, str]:
        if not isinstance(value, dict):
            return value, "wrong-type"
        if not value and kind.min_length:
            return value, "empty-array"
        out = {}
        for key, item in value.items():
            new, fault = self._walk(item, kind.value_type, f"{pointer}/{key}")
            if fault and isinstance(kind.value_type, types.DictType):  # an extension that is no object
                self._repaired(fault, f"{pointer}/{key}", key)
                continue
            if fault:
                return value, fault
            out[key] = new
        return out, ""

    def _scalar(self, value: Any, kind: types.Type, pointer: str) -> tuple[Any, str]:
        if isinstance(kind, types.LiteralType):
            return value, "" if value in kind.values and not isinstance(value, bool) else "unknown-word"
        if isinstance(kind, types.IntType | types.FloatType):
            expected_types = int if isinstance(kind, types.IntType) else int | float
            if not isinstance(value, expected_types) or isinstance(value, bool):
                return value, "wrong-type"
            return self._number(value, kind, pointer)
        if isinstance(kind, types.StrType):
            return value, "" if isinstance(value, str) else "wrong-type"
        if isinstance(kind, types.BoolType):
            return value, "" if isinstance(value, bool) else "wrong-type"
        return value, ""

    def _number(self, value: Any, kind: types.IntType | types.FloatType, pointer: str) -> tuple[Any, str]:
        low = kind.ge is not None and value < kind.ge
        high = kind.le is not None and value > kind.le
        if isinstance(kind, types.FloatType) and (low or high):
            self._repaired("factor-range", pointer, next(p for p in pointer.split("/")[::-1] if not p.isdigit()))
            return kind.ge if low else kind.le, ""
        outside = kind.gt is not None and value <= kind.gt
        return value, "value-range" if low or high or outside else ""
