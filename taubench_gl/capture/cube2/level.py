"""Maps of Cube 2 (.ogz), versions 20 to 33: header, variables, entities, texture slots, cubes.

Layout: the engine's ``src/engine/worldio.cpp``.  Lightmaps and visibility, which follow, are not read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.capture.cube2.octree import Cubes, read_cubes
from taubench_gl.capture.cube2.packed import Reader, unpacked
from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import require

Array = np.ndarray

LIGHT, MODEL, SPOTLIGHT = 1, 2, 7
"""Kinds of entities."""
OLDEST, OLDEST_WHOLE, CURRENT = 20, 29, 33
"""Versions: the first that is read, the first that is read whole, and the engine's."""
_CHANGES = (("scale", "f"), ("rotation", "i"), ("offset", "2i"), ("scroll", "2f"), ("layer", "i"), ("alpha", "2f"),
            ("color", "3f"))  # fmt: skip


@dataclass(frozen=True)
class Level:
    """A map.  ``entities``: ``place``, ``values`` (5), ``kind``; ``slots``: by the number that
    faces have, the slot that each is a change of, -1: none, and what is changed."""

    version: int
    variables: dict[str, Any]
    entities: Array
    slots: list[tuple[int, dict[str, Any]]]
    cubes: Cubes


def read_level(data: bytes, where: str) -> Level:
    """A map of the file ``where``.  Raises SceneError for what is none, damaged, or of another version."""
    content, _ = unpacked(data, where, "map of Cube 2 (.ogz)")
    r = Reader(content, where)
    if content[:4] != b"OCTA":
        raise SceneError("is no map of Cube 2 (.ogz)", where=where, hint="it does not begin with OCTA")
    r.bytes(4)
    version, header, size, entities, _, _ = r.get("6i")
    if not OLDEST <= version <= CURRENT:
        hint = f"save it again in Cube 2: versions {OLDEST} to {CURRENT} are read"
        raise SceneError(f"is a map of version {version}", where=where, hint=hint)
    if not 2 <= size <= 1 << 16 or size & (size - 1):
        raise r.bad(f"has a size of {size} cubes")
    variables, slots = {}, 0
    if version > 28:
        _, count, slots = (*r.get("2i"), 0) if version == 29 else r.get("3i")
        variables = _read_variables(r, count)
    else:
        r.at = 0
        r.bytes(header)
    r.text(r.get("B") + 1)
    extra, more = r.get("2H")
    r.bytes(more)
    r.bytes(2 * r.get("H"))
    fields = [("place", "<f4", 3), ("values", "<i2", 5), ("kind", "u1"), ("pad", "u1"), ("extra", "u1", (extra,))]
    row = np.dtype(fields)
    table = np.frombuffer(r.bytes(max(entities, 0) * row.itemsize), row)
    if not np.isfinite(table["place"]).all():
        raise r.bad("has entities whose places are no numbers")
    read = _read_slots(r, slots)
    return Level(version, variables, table, read, read_cubes(r, size, version))


def _read_variables(r: Reader, count: int) -> dict[str, Any]:
    """Settings of the map by name: integers, numbers and texts."""
    out: dict[str, Any] = {}
    for _ in range(count):
        kind, length = r.get("BH")
        name = r.text(length)
        if kind > 2:
            raise r.bad(f"has a variable of unknown kind {kind}")
        out[name] = r.text(r.get("H")) if kind == 2 else r.get("if"[kind])
    return out


def _read_slots(r: Reader, count: int) -> list[tuple[int, dict[str, Any]]]:
    """Changed uses of textures are stored; a negative number stands for that many without changes."""
    out: list[tuple[int, dict[str, Any]]] = []
    while count > 0:
        changed = r.get("i")
        if changed < 0:
            require((len(out) - changed) * 200, "its texture slots", SceneError, r.where)
            out += [(-1, {})] * min(-changed, count)
            count += changed
            continue
        previous, changes = r.get("i"), {}
        if changed >> 8:
            raise r.bad(f"has a texture slot of unknown kind {changed}")
        for _ in range(r.get("H") if changed & 1 else 0):
            r.bytes(r.get("H") + 16)  # a parameter of a shader
        for bit, (name, form) in enumerate(_CHANGES, 1):
            if changed >> bit & 1:
                changes[name] = r.get(form)
        out.append((previous, changes))
        count -= 1
    return out
