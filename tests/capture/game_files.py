"""Writes small maps, models and archives of the Quake 3 family, for tests."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from PIL import Image

from taubench_gl.capture.quake3.bsp import MODEL, SHADER, SURFACE, VERTEX
from taubench_gl.capture.quake3.md3 import CORNER, TAG

QUAD = np.array([0, 1, 2, 0, 2, 3])


def vertices(places, normal, uvs=None):
    out = np.zeros(len(places), VERTEX)
    out["place"], out["normal"] = places, normal
    out["uv"] = np.zeros((len(places), 2)) if uvs is None else uvs
    return out


def map_bytes(surfaces, entities="{}", models=((0, None),)):
    """A map of ``surfaces``: (shader, kind, vertices, indices, (width, height)); ``models``: (first, number)."""
    names = list(dict.fromkeys(surface[0] for surface in surfaces))
    shaders = np.zeros(len(names), SHADER)
    shaders["name"] = [name.encode("latin-1") for name in names]
    rows, corners, indices = np.zeros(len(surfaces), SURFACE), [], []
    first = begin = 0
    for row, (name, kind, points, index, size) in zip(rows, surfaces, strict=True):
        row["shader"], row["kind"] = names.index(name), kind
        row["vertex"], row["vertices"], row["index"], row["indices"] = first, len(points), begin, len(index)
        row["width"], row["height"] = size
        corners.append(points)
        indices.append(index)
        first, begin = first + len(points), begin + len(index)
    parts = np.zeros(len(models), MODEL)
    for part, (start, number) in zip(parts, models, strict=True):
        part["surface"], part["surfaces"] = start, len(surfaces) - start if number is None else number
    lumps = {0: entities.encode("latin-1") + b"\0", 1: shaders.tobytes(), 7: parts.tobytes(),
             10: np.concatenate(corners).tobytes(), 11: np.concatenate(indices).astype("<i4").tobytes(),
             13: rows.tobytes()}  # fmt: skip
    table, body, at = b"", b"", 8 + 17 * 8
    for lump in range(17):
        data = lumps.get(lump, b"")
        table += struct.pack("<ii", at + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    return b"IBSP" + struct.pack("<i", 46) + table + body


def quad(center, u, v, normal, shader, size=1.0):
    """A planar surface; its triangles are clockwise seen from its normal, as the game's are."""
    center, u, v = (np.asarray(x, float) for x in (center, u, v))
    corners = [center - u - v, center - u + v, center + u + v, center + u - v]
    if np.dot(np.cross(corners[1] - corners[0], corners[2] - corners[0]), normal) > 0:
        corners.reverse()
    uvs = np.array([[0, 0], [0, 1], [1, 1], [1, 0]]) * size
    return shader, 1, vertices(corners, normal, uvs), QUAD, (0, 0)


def room(half=256.0, entities='{"classname" "worldspawn"}'):
    """A floor, a sky, a curved wall and a door, which is model 1."""
    grid = np.array([[[x, y, z] for x, z in ((-64, 0), (0, 128), (64, 0))] for y in (100, 100, 100)], float)
    grid[..., 1] += np.arange(3)[:, None] * 32
    curve = ("textures/wall", 2, vertices(grid.reshape(-1, 3), [0, 0, 1]), np.zeros(0, int), (3, 3))
    surfaces = [
        quad([0, 0, 0], [half, 0, 0], [0, half, 0], [0, 0, 1], "textures/floor"),
        quad([0, 0, 512], [half, 0, 0], [0, half, 0], [0, 0, -1], "textures/sky"),
        quad([0, half, 256], [half, 0, 0], [0, 0, 256], [0, -1, 0], "textures/lamp"),
        curve,
        quad([0, -64, 32], [16, 0, 0], [0, 0, 32], [0, 1, 0], "textures/door"),
    ]
    return map_bytes(surfaces, entities, ((0, 4), (4, 1)))


def model_bytes(surfaces, tags=None, frames=1):
    """A model.  ``surfaces``: (name, shader, triangles, uvs, (frames, n, 3) places); ``tags``: name -> per frame
    (place, rows)."""
    tags = tags or {}
    table = np.zeros((frames, len(tags)), TAG)
    for k, (name, values) in enumerate(tags.items()):
        for f, (place, rows) in enumerate(values):
            table[f, k] = (name.encode(), place, rows)
    body = b""
    for name, shader, triangles, uvs, places in surfaces:
        corners = np.zeros(np.shape(places)[:2], CORNER)
        corners["place"] = np.round(np.asarray(places) * 64)
        n = len(uvs)
        named = np.array([(shader, 0)], [("n", "S64"), ("i", "<i4")]).tobytes()
        parts = [np.asarray(triangles, "<i4").tobytes(), named,
                 np.asarray(uvs, "<f4").tobytes(), corners.tobytes()]  # fmt: skip
        at = [108 + sum(map(len, parts[:k])) for k in range(5)]
        head = struct.pack("<4s64si", b"IDP3", name.encode(), 0)
        body += head + struct.pack("<9i", frames, 1, n, len(triangles), *at) + b"".join(parts)
    tags_at = 108 + 56 * frames
    ends = (tags_at, tags_at + table.nbytes, tags_at + table.nbytes + len(body))
    head = struct.pack("<4si64si4i4i", b"IDP3", 15, b"model", 0, frames, len(tags), len(surfaces), 0, 108, *ends)
    return head + bytes(56 * frames) + table.tobytes() + body


def box_model(frames=1, tags=None, shader="models/box", shift=(0, 0, 1.0)):
    """A triangle that moves by ``shift`` each frame."""
    places = np.array([[0, 0, 0], [0, 8, 0], [8, 0, 0]], float)
    moved = places + np.arange(frames)[:, None, None] * np.asarray(shift)
    return model_bytes([("box", shader, [[0, 1, 2]], [[0, 0], [1, 0], [0, 1]], moved)], tags, frames)


def image_bytes(color, size=(4, 4), kind="TGA", alpha=None):
    image = Image.new("RGB" if alpha is None else "RGBA", size, color if alpha is None else (*color, alpha))
    data = io.BytesIO()
    image.save(data, kind)
    return data.getvalue()


def write_pak(path: Path, files: Mapping[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)


ANIMATIONS = "\n".join(f"{i * 2} 2 2 20 // row {i}" for i in range(25))
"""Two frames for each animation; the legs' begin where the torso's end."""

SCRIPT = """
textures/floor
{
  { map textures/floor.tga }
}
textures/sky // the end of a line
{
  surfaceparm sky
  q3map_sun 1 .5 .25 100 0 90
  q3map_surfacelight 40 /* a path where a number belongs is 0 */
  skyparms env/sky - -
}
textures/lamp
{
  q3map_surfacelight 4000
  { map textures/lamp.tga }
}
"""


def game_files(level: bytes) -> dict[str, bytes]:
    """The archive of a game with one map, ``tiny``, a player, a rocket and an item."""
    frames = 60
    eye = [((0, 0, 24.0), np.eye(3))] * frames
    return {
        "maps/tiny.bsp": level,
        "scripts/tiny.shader": SCRIPT.encode(),
        "textures/floor.tga": image_bytes((200, 100, 50)),
        "textures/wall.jpg": image_bytes((10, 20, 30), kind="JPEG"),
        "textures/lamp.tga": image_bytes((255, 255, 255)),
        "textures/sky.tga": image_bytes((0, 0, 255)),
        "models/box.tga": image_bytes((9, 9, 9)),
        "models/players/sarge/lower.md3": box_model(frames, {"tag_torso": eye}),
        "models/players/sarge/upper.md3": box_model(frames, {"tag_head": eye, "tag_weapon": eye}),
        "models/players/sarge/head.md3": box_model(),
        "models/players/sarge/animation.cfg": ANIMATIONS.encode(),
        "models/players/sarge/lower_default.skin": b"box,models/box.tga\n",
        "models/weapons2/rocketl/rocketl.md3": box_model(),
        "models/weapons2/rocketl/rocketl_hand.md3": box_model(1, {"tag_weapon": [((8.0, -4, -8), np.eye(3))]}),
        "models/ammo/rocket/rocket.md3": box_model(),
        "models/powerups/armor/shard.md3": box_model(),
    }
