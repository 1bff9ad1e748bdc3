"""Files of Cube 2: maps, and the textures of their configurations (.cfg) by slot.

Of a configuration, the commands ``exec``, ``texturereset`` and ``texture`` are read; nothing in it is executed.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from taubench_gl.capture.cube2.level import Level
from taubench_gl.capture.parts import texture_pixels
from taubench_gl.data_files import opened, read_bytes
from taubench_gl.errors import SceneError

Array = np.ndarray

DEBIAN_DATA = Path("/usr/share/games/cube2")
"""Where Debian's package cube2-data puts the game's data files."""
INSTALL = "apt-get install cube2 cube2-data"
TEXTURE = 512
"""Most pixels a side of a texture."""
MAX_CONFIG, MAX_SLOTS, MAX_DEPTH = 1 << 20, 65536, 8
_WORD = re.compile(r'"([^"]*)"|([^\s"]+)')
_FLIPS = np.array([[0, 0, 0], [0, 1, 1], [1, 1, 0], [1, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], bool)
"""Mirrored across, mirrored down, axes exchanged; by the number of a rotation."""


@dataclass(frozen=True)
class Texture:
    """A slot: images, and how they lie on faces.  ``scale``: 1 is eight pixels a cube; ``offset``: pixels."""

    image: str
    normal: str | None = None
    rotation: int = 0
    offset: tuple[int, int] = (0, 0)
    scale: float = 1.0
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)


class Files:
    """The folder of the game's data, which holds ``packages``."""

    def __init__(self, folder: Path):
        """Raises SceneError for a folder without maps."""
        if not (folder / "packages" / "base").is_dir():
            hint = f"give --data the folder that holds packages; Debian's is {DEBIAN_DATA} after: {INSTALL}"
            raise SceneError("holds no packages/base", where=str(folder), hint=hint)
        self.folder = folder.resolve()

    def path(self, name: str) -> Path | None:
        """A file inside of the folder; None if there is none."""
        path = self.folder / name.replace("\\", "/")
        inside = "\0" not in name and path.resolve().is_relative_to(self.folder)
        return path if inside and path.is_file() else None

    def map_file(self, map_name: str) -> tuple[Path, str]:
        """The file of a map, and its name in the folder.  Raises SceneError if there is none."""
        name = f"packages/base/{map_name}.ogz"
        path = self.path(name)
        if path is None:
            raise SceneError(f"has no {name:.200}", where=str(self.folder), hint=f"put the map there, or: {INSTALL}")
        return path, name

    def read(self, name: str) -> bytes | None:
        """The content of a file; None if there is none."""
        path = self.path(name)
        return None if path is None else read_bytes(path, SceneError)

    def size(self, image: str) -> tuple[int, int]:
        """Pixels across and down by which coordinates count: of the .dds beside the image, which the engine prefers."""
        dds = self.path(str(Path(image).with_suffix(".dds")))
        if dds is not None:
            with opened(dds, SceneError) as file:
                head = file.read(20)
            if head[:4] == b"DDS " and len(head) == 20 and all(size := struct.unpack("<12xII", head)[::-1]):
                return size
        pixels = self.pixels(image, 1 << 14)
        return pixels.shape[1], pixels.shape[0]

    def pixels(self, image: str, most: int = TEXTURE) -> Array:
        """(h, w, 4) uint8.  Raises SceneError for one that is missing or damaged."""
        path = self.path(image)
        if path is None:
            raise SceneError(f"has no {image:.200}", where=str(self.folder))
        return texture_pixels(path, str(path), most)


def read_textures(level: Level, files: Files, map_name: str) -> dict[int, Texture]:
    """Number of a slot, as faces have it -> its texture."""
    plain: list[Texture] = []
    for name in ("data/default_map_settings.cfg", f"packages/base/{map_name}.cfg"):
        _run(files, name, plain, 0)
    # The n-th slot of the map without changes is the n-th of the configuration; maps before version 30 have none.
    count = len(level.slots)
    unchanged = [number for number, (_, changes) in enumerate(level.slots) if not changes]
    out = dict(zip([*unchanged, *range(count, count + len(plain))], plain, strict=False))
    for number, (root, changes) in enumerate(level.slots):
        for _ in range(count):  # back to the slot that is changed
            if 0 <= root < count and level.slots[root][1]:
                root = level.slots[root][0]
        if changes and root in out:
            known = {name: value for name, value in changes.items() if name in Texture.__dataclass_fields__}
            out[number] = replace(out[root], **known)
    return out


def _run(files: Files, name: str, slots: list[Texture], depth: int) -> None:
    path = files.path(name)
    if path is None or depth > MAX_DEPTH:
        return
    in_material = False
    for line in read_bytes(path, SceneError, max_bytes=MAX_CONFIG).decode("latin-1").splitlines():
        words = [a or b for a, b in _WORD.findall(line.partition("//")[0])]
        if words[:1] == ["exec"] and len(words) == 2:
            _run(files, words[1], slots, depth + 1)
        elif words == ["texturereset"]:
            slots.clear()
        elif words[:1] == ["texture"] and len(words) > 2 and len(slots) < MAX_SLOTS:
            image = "packages/" + re.sub("<[^>]*>", "", words[2])
            if words[1] in ("0", "c"):
                rotation, x, y, scale = (_number(word) for word in [*words[3:7], "0", "0", "0", "0"][:4])
                slots.append(Texture(image, None, int(rotation), (int(x), int(y)), scale))
            in_material = words[1] not in ("0", "c") and (in_material or len(words[1]) > 1)
            if words[1] == "n" and slots and not in_material:
                slots[-1] = replace(slots[-1], normal=image)


def _number(word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        return 0.0
    return value if abs(value) < 1e6 else 0.0


def texture_coordinates(places: Array, sides: Array, texture: Texture, size: tuple[int, int]) -> Array:
    """(n, 2) of (n, 3) places in cubes, engine's axes, on faces of (n,) sides; ``size``: pixels of the image."""
    across, down, exchanged = _FLIPS[min(max(texture.rotation, 0), 7)]
    w, h = size[0] * (-1 if across else 1), size[1] * (-1 if down else 1)
    x, y = texture.offset[::-1] if exchanged else texture.offset
    dim = sides >> 1
    a, b = np.where(dim == 0, places[:, 1], places[:, 0]), np.where(dim == 2, places[:, 1], places[:, 2])
    per_cube = 8 / (texture.scale if 1e-3 < abs(texture.scale) < 1e6 else 1.0)
    if exchanged:
        return np.stack([b * np.where(dim < 2, -per_cube, per_cube) / w - x / w, a * per_cube / h - y / h], 1)
    return np.stack([a * per_cube / w - x / w, b * np.where(dim < 2, -per_cube, per_cube) / h - y / h], 1)
