"""A map in a scene file: its faces by texture, its lights, and what is left out."""

from __future__ import annotations

import numpy as np

from taubench_gl.capture import light
from taubench_gl.capture.cube2.faces import drawn_triangles
from taubench_gl.capture.cube2.level import ALPHA, LIGHT, MODEL, SPOTLIGHT, Level
from taubench_gl.capture.cube2.textures import Files, Texture, read_textures, texture_coordinates
from taubench_gl.capture.parts import MIRROR, SceneFile
from taubench_gl.errors import SceneError
from taubench_gl.math3d import normalize

Array = np.ndarray

RIGHT_HANDED = [1, 0, 2]
"""Axes of ``capture.recording`` from the engine's: along +y, and +x to the left."""


def add_world(file: SceneFile, level: Level, files: Files, map_name: str) -> None:
    """The node of the map, the first of the file."""
    textures = read_textures(level, files, map_name)
    slots, sides, places = drawn_triangles(level.cubes)
    normals = normalize(np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]))
    primitives = []
    for slot in np.unique(slots).tolist():
        own = slots == slot
        corners, turned = places[own].reshape(-1, 3), np.repeat(normals[own], 3, 0)
        material, uvs = _material(file, files, slot, textures.get(slot), corners, np.repeat(sides[own], 3))
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
    """The light entities, and the sun of the map's variables."""
    for entity in level.entities[level.entities["kind"] == LIGHT]:
        radius, *color = (float(value) for value in entity["values"][:4])
        # A light of radius 0 does not fall off: it is as bright at half the map's size as it should be.
        radius = radius if radius > 0 else float(level.cubes.size)
        place = entity["place"][None, RIGHT_HANDED].astype(float)
        add_point(file, "light", "light entities", place, np.array(color) / 255, radius, np.ones(1))
    known = level.variables.get
    color, scale = _rgb(known("sunlight")), known("sunlightscale", 1.0)
    if color.any() and isinstance(scale, float) and 0 < scale < 1e3:
        yaw, pitch = (np.radians(float(known(name, 0))) for name in ("sunlightyaw", "sunlightpitch"))
        toward = np.array([np.cos(yaw) * np.cos(pitch), -np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        file.sun(toward, tuple(color / color.max()), light.sun_lux(255 * scale * float(color.max())))
        file.counts["suns"] += 1
    file.lost["light from all sides (ambient, skylight)"] += int(any(known(name) for name in ("ambient", "skylight")))


def _rgb(value: object) -> Array:
    """(3,) of a color of a map's variables; one below 256 is gray."""
    number = value if isinstance(value, int) and value > 0 else 0
    return np.array([number >> 16 & 255, number >> 8 & 255, number & 255] if number > 255 else [number] * 3) / 255


def add_point(file: SceneFile, name: str, kind: str, places: Array, color: Array, radius: float, levels: Array) -> None:
    """A light of the engine: ``color`` 1 saturates, and it falls off linearly to 0 at ``radius`` cubes; ``levels``: of
    its brightness at each key."""
    brightest = max(float(np.max(color)), 0.0)
    candela = light.linear_candela(radius, 255 * brightest, file.unit) * levels
    shown = tuple(np.clip(color / max(brightest, 1e-9), 0, 1))
    file.point_light(name, kind, places, shown, candela, range=radius * file.unit)
