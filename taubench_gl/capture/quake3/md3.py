"""Models of the Quake 3 family (MD3, version 15), their tags, skins and the table of a player's animations.

A model has vertices for every frame, and tags: places where other models are attached.  Layout: ioquake3
(``code/qcommon/qfiles.h``); animations: ``code/cgame/cg_players.c``.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, replace

import numpy as np

from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import require

Array = np.ndarray

TAG = np.dtype([("name", "S64"), ("place", "<f4", 3), ("axes", "<f4", (3, 3))])
CORNER = np.dtype([("place", "<i2", 3), ("normal", "u1", 2)])
UNITS = 1 / 64
"""World units of the integers of a vertex."""
MAX_FRAMES, MAX_SURFACES = 4096, 256


@dataclass(frozen=True)
class Surface:
    """Triangles with one shader.  ``triangles``: (t, 3), clockwise."""

    name: str
    shader: str
    triangles: Array
    uvs: Array  # (n, 2)
    corners: Array  # (frames, n) of CORNER

    def shape(self, frame: int) -> tuple[Array, Array]:
        """(n, 3) places and (n, 3) unit normals of a frame, in world units and the model's axes."""
        corners = self.corners[frame]
        around, down = (corners["normal"][:, k] * (2 * np.pi / 255) for k in (1, 0))
        flat = np.sin(down)
        normals = np.stack([np.cos(around) * flat, np.sin(around) * flat, np.cos(down)], 1)
        return corners["place"] * UNITS, normals


class Md3:
    """A model.  ``tags``: name -> (frames, 3) places and (frames, 3, 3) rows forward, left, up.  Raises SceneError."""

    def __init__(self, data: bytes, where: str):
        def check(good: bool | np.bool_, what: str) -> None:
            if not good:
                raise SceneError(what, where=where, hint="the model is damaged, or of another game")

        def array(kind: np.dtype | str, count: int, at: int) -> Array:
            inside = count >= 0 and at >= 0 and at + count * np.dtype(kind).itemsize <= len(data)
            check(inside, f"a part at byte {at} lies outside the file")
            return np.frombuffer(data, kind, count, at)

        check(len(data) >= 108 and data[:8] == b"IDP3\x0f\0\0\0", "is no model of Quake 3 (IDP3, version 15)")
        self.frames, tags, surfaces, _, _, tags_at, at, _ = struct.unpack_from("<8i", data, 76)
        few = 0 < self.frames <= MAX_FRAMES and 0 <= tags <= 64 and 0 <= surfaces <= MAX_SURFACES
        check(few, f"declares {self.frames} frames, {surfaces} surfaces")
        table = array(TAG, self.frames * tags, tags_at).reshape(self.frames, tags)
        finite = np.isfinite(table["place"]).all() and np.isfinite(table["axes"]).all()
        check(finite, "a tag has values that are no numbers")
        self.tags = {
            _text(table["name"][0, k]): (table["place"][:, k].astype(float), table["axes"][:, k].astype(float))
            for k in range(tags)
        }
        self.surfaces = []
        for _ in range(surfaces):
            array("u1", 108, at)
            name, *numbers = struct.unpack_from("<4x64s4x10i", data, at)
            frames, shaders, vertices, count, triangles_at, shaders_at, uvs_at, corners_at, end = numbers[:9]
            fits = frames == self.frames and 0 <= vertices <= 1 << 16
            check(fits, f"a surface has {frames} frames of {self.frames} and {vertices} vertices")
            require(frames * vertices * CORNER.itemsize, "a surface", SceneError, where)
            triangles = array("<i4", 3 * count, at + triangles_at).reshape(-1, 3)
            uvs = array("<f4", 2 * vertices, at + uvs_at).reshape(-1, 2)
            corners = array(CORNER, frames * vertices, at + corners_at).reshape(frames, vertices)
            check(np.isfinite(uvs).all(), "a surface has texture coordinates that are no numbers")
            check(((triangles >= 0) & (triangles < vertices)).all(), "a triangle has a corner outside its surface")
            shader = _text(array("S64", 1, at + shaders_at)[0]) if shaders > 0 else ""
            self.surfaces.append(Surface(_text(name), shader, triangles, uvs, corners))
            if end <= 0:
                break
            at += end


def _text(name: bytes) -> str:
    return bytes(name).split(b"\0")[0].decode("latin-1").lower().replace("\\", "/")


@dataclass(frozen=True)
class Clip:
    """An animation: ``first`` of ``count`` frames at ``fps``; the last ``loop`` repeat."""

    first: int
    count: int
    loop: int
    fps: float
    backward: bool


_CLIP = re.compile(r"^[ \t]*(\d{1,5})[ \t]+(-?\d{1,5})[ \t]+(\d{1,5})[ \t]+(\d{1,5}(?:\.\d{0,5})?)", re.MULTILINE)
LEGS, TORSO = 13, 6
"""Rows of a table of animations from which on the legs, and before them the torso alone, move."""
BACK_CROUCHED, BACK_WALK, IDLE = 32, 33, 22
"""Numbers of animations that follow the table: two of its rows, played backward; the row used for unknown numbers."""


def read_clips(text: str, where: str) -> dict[int, Clip]:
    """Number of each animation -> clip, from ``animation.cfg``.  Raises SceneError.

    The frames of the legs do not count those of the torso alone, which the file numbers before them.
    """
    rows = [[float(word) for word in match] for match in _CLIP.findall(text)]
    if len(rows) < 25:
        raise SceneError(f"has {len(rows)} animations of 25", where=where, hint="the player's model is incomplete")
    skipped = rows[LEGS][0] - rows[TORSO][0]
    out = {}
    for i, (first, count, loop, fps) in enumerate(rows[:25]):
        first -= skipped if i >= LEGS else 0
        out[i] = Clip(max(int(first), 0), int(abs(count)) or 1, int(loop), fps or 1.0, count < 0)
    for extra, row in ((BACK_CROUCHED, 13), (BACK_WALK, 14)):
        out[extra] = replace(out[row], backward=not out[row].backward)
    return out


def read_skin(text: str) -> dict[str, str]:
    """Surface -> shader, from a .skin file."""
    pairs = (line.partition(",") for line in text.splitlines())
    return {name.strip().lower(): shader.strip().lower() for name, _, shader in pairs if name.strip()}
