"""A map in a scene file: its textures, faces and lights, and what is left out.

Of the configurations (.cfg) of a map, the commands ``exec``, ``texturereset`` and ``texture`` are read; nothing in them
is executed.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from taubench_gl.capture import light
from taubench_gl.capture.cube2.level import ALPHA, LIGHT, MODEL, SPOTLIGHT, Level, drawn_triangles
from taubench_gl.capture.parts import MIRROR, SceneFile, texture_pixels
from taubench_gl.data_files import opened, read_bytes
from taubench_gl.errors import SceneError
from taubench_gl.math3d import normalize

Array = np.ndarray

DEBIAN_DATA = Path("/usr/share/games/cube2")
"""Where Debian's package cube2-data puts the game's data files."""
INSTALL = "apt-get install cube2 cube2-data"
TEXTURE = 512
"""Most pixels a side of a texture."""
MAX_LINES = 100_000
"""Most lines that are read of all configurations of a map together."""
_EXEC, _NUMBER = re.compile(r'\s*exec\s+"?([^"\s]+)'), re.compile(r"-?(?:\d{1,6}\.?\d{0,6}|\.\d{1,6})")
_TEXTURE = re.compile(r'\s*texture\s+"?(\w+)"?\s+"?(?:<[^>]*>)*([^"\s]+)"?(.*)')
_FLIPS = np.array([[0, 0, 0], [0, 1, 1], [1, 1, 0], [1, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], bool)
"""Rotation of a texture -> whether it is mirrored across, mirrored down, and its axes exchanged, (8, 3) bool."""


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
        """Open the game's data in ``folder``.  Raises SceneError for a folder without maps."""
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
        """Pixels of an image, (h, w, 4) uint8, at most ``most`` a side.  Raises SceneError for one that is missing or
        damaged.
        """
        path = self.path(image)
        if path is None:
            raise SceneError(f"has no {image:.200}", where=str(self.folder))
        return texture_pixels(path, str(path), most)


def read_textures(level: Level, files: Files, map_name: str) -> dict[int, Texture]:
    """Number of a slot, as faces have it -> its texture."""
    plain, count = _configured(files, map_name), len(level.slots)
    # The n-th slot of the map without changes is the n-th of the configuration; maps before version 30 have none.
    unchanged = [number for number, (_, changes) in enumerate(level.slots) if not changes]
    out = dict(zip([*unchanged, *range(count, count + len(plain))], plain, strict=False))
    root = np.array(
        [slot if changes and 0 <= slot < count else i for i, (slot, changes) in enumerate(level.slots)], int
    )
    for _ in range(20):  # twice as far back each time
        root = root[root]
    for number, (_, changes) in enumerate(level.slots):
        if changes and root[number] in out:
            known = {name: value for name, value in changes.items() if name in Texture.__dataclass_fields__}
            out[number] = replace(out[root[number]], **known)
    return out


def _configured(files: Files, map_name: str) -> list[Texture]:
    """The textures of a map's configuration, after the default one."""
    out: list[Texture] = []
    lines = [f"exec packages/base/{map_name}.cfg", "exec data/default_map_settings.cfg"]
    left, in_material = MAX_LINES, False
    while lines:
        line = lines.pop().partition("//")[0]
        if found := _EXEC.match(line):
            included = (files.read(found[1]) or b"").decode("latin-1").splitlines()[:left]
            left -= len(included)
            lines += included[::-1]
        elif line.strip() == "texturereset":
            out.clear()
        elif found := _TEXTURE.match(line):
            kind, image, rest = found.groups()
            first = kind in ("0", "c")
            in_material = not first and (in_material or len(kind) > 1)  # the images of water and lava
            if first:
                rotation, x, y, scale = [*map(float, _NUMBER.findall(rest)), 0.0, 0.0, 0.0, 0.0][:4]
                out.append(Texture(f"packages/{image}", None, int(rotation), (int(x), int(y)), scale))
            elif kind == "n" and out and not in_material:
                out[-1] = replace(out[-1], normal=f"packages/{image}")
    return out


def texture_coordinates(places: Array, sides: Array, texture: Texture, size: tuple[int, int]) -> Array:
    """Texture coordinates (n, 2) of ``places`` (n, 3), cubes, engine's axes, on faces of ``sides`` (n,); ``size``:
    pixels of the image.
    """
    across, down, exchanged = _FLIPS[min(max(texture.rotation, 0), 7)]
    w, h = size[0] * (-1 if across else 1), size[1] * (-1 if down else 1)
    x, y = texture.offset[::-1] if exchanged else texture.offset
    dim = sides >> 1
    a, b = np.where(dim == 0, places[:, 1], places[:, 0]), np.where(dim == 2, places[:, 1], places[:, 2])
    per_cube = 8 / (texture.scale if 1e-3 < abs(texture.scale) < 1e6 else 1.0)
    if exchanged:
        return np.stack([b * np.where(dim < 2, -per_cube, per_cube) / w - x / w, a * per_cube / h - y / h], 1)
    return np.stack([a * per_cube / w - x / w, b * np.where(dim < 2, -per_cube, per_cube) / h - y / h], 1)


# ------------------------------------------------------------------------------------------------ in the scene file
RIGHT_HANDED = [1, 0, 2]
"""Axes of ``capture.recording`` from the engine's: along +y, and +x to the left."""


def add_world(file: SceneFile, level: Level, files: Files, map_name: str) -> None:
    """Add the node of the map, the first of the file, and count what the file cannot have."""
    textures = read_textures(level, files, map_name)
    slots, sides, places = drawn_triangles(level.cubes)
    normals = normalize(np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]))
    primitives = []
    for slot in np.unique(slots).tolist():
        of_slot = slots == slot
        corners, turned = places[of_slot].reshape(-1, 3), np.repeat(normals[of_slot], 3, 0)
        material, uvs = _material(file, files, slot, textures.get(slot), corners, np.repeat(sides[of_slot], 3))
        triangles = np.arange(len(corners)).reshape(-1, 3)[:, MIRROR]
        axes = (values[:, RIGHT_HANDED] for values in (corners, turned))
        primitives.append(file.primitive(*axes, uvs, triangles, material))
    file.counts["triangles of the map"] += len(slots)
    file.writer.node("world", **({"mesh": file.writer.mesh(map_name, *primitives)} if primitives else {}))
    material, kind = level.cubes.material, level.entities["kind"]
    lost = {
        "cubes of water, lava or glass": material & 7 > 0,
        "see-through cubes, which are opaque": material & ALPHA > 0,
        "models of the map": kind == MODEL,
        "spotlights": kind == SPOTLIGHT,
        "items, teleports and other things of the map": kind > SPOTLIGHT,
    }
    file.lost.update({name: int(found.sum()) for name, found in lost.items()})


def _material(
    file: SceneFile, files: Files, slot: int, texture: Texture | None, places: Array, sides: Array
) -> tuple[int, Array]:
    """The material of a slot, and the texture coordinates of its corners."""

    def pixels(name: str | None) -> Array | None:
        try:
            return None if name is None else files.pixels(name)[..., :3]
        except SceneError as error:  # one image of many: the game goes on as well
            file.lost[f"image {name}: {error.what}"] += 1
            return None

    image = pixels(None if texture is None else texture.image)
    if texture is None or image is None:
        file.lost["textures of the map, which are gray"] += 1
        return file.writer.material(f"slot {slot}", (0.5, 0.5, 0.5)), np.zeros((len(places), 2))
    bumps, normal = pixels(texture.normal), None
    if bumps is not None:  # green of the game's normal maps points down the image, that of glTF up
        normal = file.writer.texture((bumps * [1, -1, 1] + [0, 255, 0]).astype(np.uint8))
        file.counts["normal maps"] += 1
    color, shown = file.writer.texture(np.ascontiguousarray(image), lossy=True), np.clip(texture.color, 0, 1).tolist()
    material = file.writer.material(f"slot {slot}", tuple(shown), roughness=0.9, texture=color, normal=normal)
    return material, texture_coordinates(places, sides, texture, files.size(texture.image))


def add_lights(file: SceneFile, level: Level) -> None:
    """Add the light entities of the map."""
    for entity in level.entities[level.entities["kind"] == LIGHT]:
        radius, *color = (float(value) for value in entity["values"][:4])
        # A light of radius 0 does not fall off: it is as bright at half the map's size as it should be.
        radius = radius if radius > 0 else float(level.cubes.size)
        place = entity["place"][None, RIGHT_HANDED].astype(float)
        add_point(file, "light", "light entities", place, np.array(color) / 255, radius, np.ones(1))
    names = ("sunlight", "ambient", "skylight")
    file.lost["light of the whole map (sunlight, ambient, skylight)"] += sum(name in level.variables for name in names)


def add_point(file: SceneFile, name: str, kind: str, places: Array, color: Array, radius: float, levels: Array) -> None:
    """Add a light of the engine: ``color`` 1 saturates, and it falls off linearly to 0 at ``radius`` cubes; ``levels``:
    of its brightness at each key.
    """
    brightest = max(float(np.max(color)), 0.0)
    candela = light.linear_candela(radius, 255 * brightest, file.unit) * levels
    shown = tuple(np.clip(color / max(brightest, 1e-9), 0, 1))
    file.point_light(name, kind, places, shown, candela, range=radius * file.unit)
