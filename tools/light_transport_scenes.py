"""Eight small scenes for the comparison of path-traced light with Cycles, written as glTF.

Where the two renderers agree by definition, the scenes stay: dielectrics are Lambertian (KHR_materials_specular, factor
0), metals and half-metals have a single-scatter GGX lobe, every surface is two-sided, textures are sampled nearest
(Cycles interpolates encoded sRGB, OpenGL decoded), and shading normals are those of the faces, because Blender rebuilds
the smooth normals of deformed meshes; one still-shaped ball is smooth.  Intensities are 683 times watts per
steradian, so that light unit watt and exposure 1 apply.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
import pygltflib as gl
from make_assets import LICENSE, add_tentacle, turn

from taubench_gl.datasets.gltf_writer import Writer
from taubench_gl.datasets.shapes import Shape, box, join, quad, sphere
from taubench_gl.effects.lighting import LUMENS_PER_WATT

SECONDS = 0.5
"""Duration: 12 frames at 24 fps."""

Tracks = list[tuple]


# ------------------------------------------------------------------------------------------------------------ materials
def surface(w: Writer, name: str, color, metallic: float = 0.0, roughness: float = 1.0, **rest) -> int:
    material = w.material(name, color, metallic, roughness, doubleSided=True, **rest)
    extend(w, material, "KHR_materials_specular", {"specularFactor": 0.0})
    return material


def tiled(w: Writer, pixels: np.ndarray) -> int:
    """A surface with a repeated texture without filtering."""
    w.gltf.samplers.append(gl.Sampler(magFilter=gl.NEAREST, minFilter=gl.NEAREST))
    w.gltf.textures.append(gl.Texture(source=w.image(pixels), sampler=len(w.gltf.samplers) - 1))
    return surface(w, "tiled", (1.0, 1.0, 1.0), texture=len(w.gltf.textures) - 1)


def brick_colors() -> np.ndarray:
    """(8, 8, 3) uint8."""
    return np.random.default_rng(4).integers(90, 230, (8, 8, 3)).astype(np.uint8)


def emitter(w: Writer, name: str, color, strength: float) -> int:
    """Black, with emitted radiance ``strength`` times ``color``."""
    material = surface(w, name, (0.0, 0.0, 0.0))
    w.gltf.materials[material].emissiveFactor = list(color)
    extend(w, material, "KHR_materials_emissive_strength", {"emissiveStrength": strength})
    return material


def extend(w: Writer, material: int, extension: str, values: dict) -> None:
    w.gltf.materials[material].extensions = {**w.gltf.materials[material].extensions, extension: values}
    if extension not in w.gltf.extensionsUsed:
        w.gltf.extensionsUsed.append(extension)


# ------------------------------------------------------------------------------------------------------------- geometry
def flat(shape: Shape) -> Shape:
    """Without normals: glTF and Blender then use those of the faces."""
    return {name: values for name, values in shape.items() if name != "NORMAL"}


def place(w: Writer, name: str, shape: Shape, material: int, smooth: bool = False, **where) -> int:
    return w.node(name, mesh=w.mesh(name, w.primitive(shape if smooth else flat(shape), material)), **where)


def block(w: Writer, name: str, size, material: int, at, degrees: float = 0.0) -> int:
    """A box on y = ``at[1]``, turned about +Y."""
    half = 0.5 * np.array(size)
    shape = box((-half[0], 0.0, -half[2]), (half[0], size[1], half[2]))
    return place(w, name, shape, material, translation=list(at), rotation=turn("y", degrees).tolist())


def times(count: int) -> np.ndarray:
    return np.linspace(0.0, SECONDS, count)


def move(node: int, path: str, values) -> tuple:
    return (node, path, times(len(values)), np.array(values, dtype=float), "LINEAR")


def camera(w: Writer, places, degrees, tilt: float = 0.0) -> Tracks:
    """Moves along ``places`` while it turns by ``degrees`` about +Y, tilted by ``tilt`` degrees."""
    walker = w.node("walker")
    w.node("eye", walker, camera=w.camera("eye", math.radians(50), 0.05, 100.0), rotation=turn("x", tilt).tolist())
    return [move(walker, "translation", places), move(walker, "rotation", turn("y", degrees))]


# --------------------------------------------------------------------------------------------------------------- lights
def light(w: Writer, name: str, kind: str, watts: float, color=(1.0, 1.0, 1.0), *, spot=None, **where) -> int:
    """``watts``: W/sr of a point or spot light, W/m2 of a directional one."""
    cone = {} if spot is None else {"spot": {"innerConeAngle": spot[0], "outerConeAngle": spot[1]}}
    extension = w.light(type=kind, name=name, color=list(color), intensity=watts * LUMENS_PER_WATT, **cone)
    return w.node(name, extensions=extension, **where)


def down(about_y: float, about_x: float) -> list[float]:
    """Rotation of a light: first about its X axis, then about +Y, in degrees."""
    y, x = turn("y", about_y), turn("x", about_x)
    vector = y[3] * x[:3] + x[3] * y[:3] + np.cross(y[:3], x[:3])
    return np.append(vector, y[3] * x[3] - y[:3] @ x[:3]).tolist()


# --------------------------------------------------------------------------------------------------------------- scenes
def many_lights(w: Writer) -> Tracks:
    """A hall with columns: 28 point lights, half of them moving, three spots and a sun."""
    stone, red, blue = (surface(w, n, c) for n, c in (("stone", (0.7, 0.68, 0.65)), ("red", (0.65, 0.2, 0.15)),
                                                      ("blue", (0.2, 0.3, 0.65))))  # fmt: skip
    place(w, "floor", quad((-6, 0, 6), (12, 0, 0), (0, 0, -12)), stone)
    place(w, "back", quad((-6, 0, -5), (12, 0, 0), (0, 4, 0)), red)
    place(w, "side", quad((-5, 0, 6), (0, 0, -12), (0, 4, 0)), blue)
    for i in range(12):
        block(w, f"column {i}", (0.4, 2.6, 0.4), (stone, red)[i % 2], (2.4 * (i % 4) - 3.6, 0, 2.4 * (i // 4) - 3.4))
    tracks = []
    rng = np.random.default_rng(5)
    for i in range(28):
        at = np.array([1.6 * (i % 7) - 4.6, rng.uniform(0.5, 2.2), 2.1 * (i // 7) - 4.3])
        color = [(1.0, 0.6, 0.35), (0.5, 0.7, 1.0), (1.0, 0.95, 0.75), (0.6, 1.0, 0.6)][i % 4]
        lamp = light(w, f"lamp {i}", "point", rng.uniform(1.2, 3.5), color, translation=at.tolist())
        if i % 2:
            step = rng.uniform(-0.9, 0.9, 3) * [1, 0.3, 1]
            tracks.append(move(lamp, "translation", [at, at + step]))
    for i in range(3):
        cone = (0.25 + 0.05 * i, 0.4 + 0.06 * i)
        node = light(w, f"spot {i}", "spot", 30.0, spot=cone, translation=[3.0 * i - 3.0, 3.6, 1.5])
        tracks.append(move(node, "rotation", [down(20 * i - 30, -65), down(20 * i - 10, -55)]))
    light(w, "sun", "directional", 1.2, (1.0, 0.9, 0.8), rotation=down(-35, -50))
    return [*tracks, *camera(w, [[0.8, 1.6, 5.4], [1.5, 1.7, 5.0]], [8.0, 20.0], -8.0)]


def emitters(w: Writer) -> Tracks:
    """A closed room that only surfaces light: a ceiling panel, a ball, and a bar that moves."""
    white, red, green = (surface(w, n, c) for n, c in (("white", (0.75,) * 3), ("red", (0.63, 0.06, 0.05)),
                                                       ("green", (0.14, 0.45, 0.09))))  # fmt: skip
    place(w, "shell", box((-2, 0, -2), (2, 3, 2), inside=True, faces="yYzZ"), white)
    place(w, "left", box((-2, 0, -2), (2, 3, 2), inside=True, faces="x"), red)
    place(w, "right", box((-2, 0, -2), (2, 3, 2), inside=True, faces="X"), green)
    block(w, "tall", (0.8, 1.6, 0.8), white, (-0.8, 0, -0.8), 18)
    low = block(w, "low", (0.7, 0.7, 0.7), white, (0.7, 0, 0.0), -20)
    place(w, "panel", quad((-0.5, 2.98, -0.5), (1.0, 0, 0), (0, 0, 0.8)), emitter(w, "panel", (1.0, 0.9, 0.75), 15.0))
    ball = emitter(w, "ball", (0.5, 0.75, 1.0), 12.0)
    place(w, "ball", sphere(0.16, 8, 12), ball, translation=[1.3, 0.9, -1.0])
    bar = emitter(w, "bar", (1.0, 0.5, 0.3), 20.0)
    bar = place(w, "bar", box((-0.4, -0.04, -0.04), (0.4, 0.04, 0.04)), bar)
    return [
        move(bar, "translation", [[-1.2, 0.9, 0.5], [0.6, 1.5, 0.2]]),
        move(low, "translation", [[0.7, 0.0, 0.0], [1.1, 0.0, 0.4]]),
        *camera(w, [[-0.3, 1.5, 1.9], [0.2, 1.4, 1.9]], [-3.0, 5.0], -6.0),
    ]


def sun_and_sky(w: Writer) -> Tracks:
    """A yard with an overhang below a uniform sky, and a sun that sinks."""
    earth, stone, brick = (surface(w, n, c) for n, c in (("earth", (0.45, 0.4, 0.33)), ("stone", (0.7, 0.68, 0.62)),
                                                         ("brick", (0.6, 0.3, 0.2))))  # fmt: skip
    place(w, "ground", quad((-12, 0, 12), (24, 0, 0), (0, 0, -24)), earth)
    place(w, "roof", box((-3, 2.2, -4), (3, 2.4, -1)), stone)
    place(w, "wall", box((-3, 0, -4.2), (3, 2.2, -4), uv_scale=0.25), tiled(w, brick_colors()))
    for i in range(4):
        block(w, f"post {i}", (0.25, 2.2, 0.25), stone, (2 * i - 3, 0, -1.2))
    block(w, "block", (1.2, 0.8, 1.2), brick, (1.8, 0, 0.6), 30)
    crate = block(w, "crate", (0.6, 0.6, 0.6), stone, (0, 0, 0))
    sun = light(w, "sun", "directional", 6.0, (1.0, 0.92, 0.8))
    return [
        move(sun, "rotation", [down(35, -40), down(60, -52)]),
        move(crate, "translation", [[-2.0, 0.0, -0.6], [-0.4, 0.0, -2.6]]),
        move(crate, "rotation", turn("y", [0.0, 70.0])),
        *camera(w, [[0.4, 1.6, 4.2], [1.1, 1.7, 4.0]], [2.0, 12.0], -10.0),
    ]


def glossy_metal(w: Writer) -> Tracks:
    """Metals of roughness 0.15 to 0.6, a half-metal floor, two lamps and a glowing panel."""
    wall = surface(w, "wall", (0.7, 0.7, 0.72))
    floor = surface(w, "floor", (0.6, 0.58, 0.55), 0.5, 0.4)
    place(w, "floor", quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), floor)
    place(w, "walls", box((-3, 0, -3), (3, 3, 3), inside=True, faces="xXYzZ"), wall)
    colors = {
        "gold": (0.95, 0.75, 0.35),
        "copper": (0.9, 0.55, 0.4),
        "silver": (0.9, 0.9, 0.88),
        "iron": (0.55, 0.55, 0.58),
    }
    gold, copper, silver, iron = (
        surface(w, name, color, 1.0, rough)
        for (name, color), rough in zip(colors.items(), (0.3, 0.6, 0.15, 0.45), strict=True)
    )
    ball = place(w, "ball", sphere(0.5, 16, 24), gold)
    block(w, "box", (0.8, 1.3, 0.8), copper, (1.3, 0, -0.9), 25)
    place(w, "mirror", box((-0.9, 0, -0.05), (0.9, 1.7, 0.05)), silver, translation=[-0.2, 0, -2.4],
          rotation=turn("y", 10).tolist())  # fmt: skip
    turner = block(w, "turner", (0.5, 0.5, 1.2), iron, (-1.6, 0.3, -0.2))
    place(w, "panel", quad((2.95, 0.7, 0.6), (0, 0, -1.4), (0, 1.2, 0)), emitter(w, "panel", (0.7, 0.85, 1.0), 8.0))
    lamp = light(w, "lamp", "point", 4.0, (1.0, 0.85, 0.65))
    light(w, "second lamp", "point", 3.0, (0.8, 0.9, 1.0), translation=[-1.8, 2.3, 1.5])
    return [
        move(ball, "translation", [[-0.6, 0.5, -0.9], [0.3, 0.6, -0.2]]),
        move(turner, "rotation", turn("y", [0.0, 60.0])),
        move(lamp, "translation", [[0.9, 2.2, 0.9], [0.0, 2.4, 0.5]]),
        *camera(w, [[0.2, 1.4, 2.8], [0.7, 1.5, 2.7]], [4.0, 12.0], -9.0),
    ]


def skinned_movers(w: Writer) -> Tracks:
    """Two skinned figures and two moving blocks in a corner of two walls, three lamps and a glowing ceiling strip."""
    floor, wall = surface(w, "floor", (0.65, 0.62, 0.6)), surface(w, "wall", (0.7, 0.7, 0.6))
    skin, other = surface(w, "skin", (0.7, 0.35, 0.6)), surface(w, "other", (0.35, 0.6, 0.45))
    place(w, "floor", quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), floor)
    place(w, "back", quad((-4, 0, -1.6), (8, 0, 0), (0, 3.2, 0)), wall)
    place(w, "side", quad((-2.2, 0, 4), (0, 0, -8), (0, 3.2, 0)), other)
    tracks = []
    for at, material in (((-0.9, 0.0, -0.4), skin), ((1.0, 0.0, -0.2), other)):
        tracks += skinned(w, material, at)
    for i in range(2):
        cube = block(w, f"cube {i}", (0.5, 0.5, 0.5), (wall, skin)[i], (0, 0, 0))
        x = 2.4 * i - 1.2
        tracks.append(move(cube, "translation", [[x, 0.0, 0.9], [x + 0.8, 0.4, 0.5]]))
    for i, color in enumerate(((1.0, 0.6, 0.4), (0.5, 0.7, 1.0), (0.9, 1.0, 0.7))):
        lamp = light(w, f"lamp {i}", "point", 5.0, color)
        x = 1.5 * i - 1.5
        tracks.append(move(lamp, "translation", [[x, 1.4 + 0.4 * i, 1.2], [x + 0.7 - 0.5 * i, 1.6, 0.5]]))
    strip = emitter(w, "strip", (1.0, 1.0, 0.9), 15.0)
    place(w, "strip", quad((-1.5, 3.1, -0.8), (3.0, 0, 0), (0, 0, 0.3)), strip)
    return [*tracks, *camera(w, [[-0.3, 1.4, 3.8], [0.3, 1.5, 3.6]], [-4.0, 4.0], -6.0)]


def skinned(w: Writer, material: int, at) -> Tracks:
    """The swaying tube of the demo at ``at``, five times as fast, with the normals of its faces."""
    first = len(w.gltf.nodes)
    tracks = add_tentacle(w, material, at, height=2.2)
    for mesh in w.gltf.meshes:
        for primitive in mesh.primitives:
            primitive.attributes.NORMAL = None
    assert all(node >= first for node, *_ in tracks)
    return [(node, path, t * SECONDS / t[-1], values, how) for node, path, t, values, how in tracks]


def foliage(w: Writer) -> Tracks:
    """Branches of alpha-masked leaf cards that sway before a wall, below a sun and a uniform sky."""
    earth, wall = surface(w, "earth", (0.5, 0.42, 0.35)), surface(w, "wall", (0.72, 0.7, 0.66))
    picture = w.texture(leaves())
    leaf = surface(w, "leaf", (1.0, 1.0, 1.0), texture=picture, alphaMode="MASK")
    w.gltf.materials[leaf].alphaCutoff = 0.5
    place(w, "ground", quad((-8, 0, 8), (16, 0, 0), (0, 0, -16)), earth)
    place(w, "wall", box((-4, 0, -2.2), (4, 3, -2)), wall)
    rng = np.random.default_rng(9)
    tracks = []
    for i in range(14):
        cards = []
        for k in range(3):
            angle = math.pi * k / 3
            u = np.array([math.cos(angle), 0.0, math.sin(angle)])
            card = quad(-0.45 * u, 0.9 * u, (0, 0.9, 0))
            card["TEXCOORD_0"] = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=float)
            cards.append(card)
        at = [rng.uniform(-2.4, 2.4), rng.uniform(0.0, 1.5), rng.uniform(-1.5, 1.2)]
        branch = place(w, f"branch {i}", join(cards), leaf, translation=at)
        start, step = rng.uniform(0, 60), rng.uniform(-40, 40)
        tracks.append(move(branch, "rotation", turn("y", [start, start + step])))
    sun = light(w, "sun", "directional", 5.0, (1.0, 0.94, 0.82))
    tracks.append(move(sun, "rotation", [down(30, -42), down(45, -48)]))
    return [*tracks, *camera(w, [[-0.3, 1.3, 3.6], [0.3, 1.4, 3.5]], [-3.0, 4.0], -5.0)]


def leaves(size: int = 64) -> np.ndarray:
    """(size, size, 4) uint8: leaves of one color, so that filtering changes alpha only."""
    y, x = (np.mgrid[0:size, 0:size] + 0.5) / size
    alpha = np.zeros((size, size))
    rng = np.random.default_rng(2)
    for cx, cy in rng.uniform(0.15, 0.85, (16, 2)):
        angle = rng.uniform(0, math.pi)
        along, across = (
            (x - cx) * math.cos(angle) + (y - cy) * math.sin(angle),
            (y - cy) * math.cos(angle) - (x - cx) * math.sin(angle),
        )
        alpha = np.maximum(alpha, np.clip(0.5 + 8.0 * (1.0 - (along / 0.14) ** 2 - (across / 0.05) ** 2), 0.0, 1.0))
    color = np.broadcast_to(np.array([110, 160, 70]), (size, size, 3))
    return np.dstack([color, np.round(255 * alpha)]).astype(np.uint8)


def interior(w: Writer) -> Tracks:
    """A bright room with a window and a door that closes: the sky outside lights it, over many bounces."""
    white, warm = surface(w, "white", (0.85, 0.85, 0.85)), surface(w, "warm", (0.85, 0.7, 0.5))
    place(w, "room", box((-2.5, 0, -3), (2.5, 2.8, 3), inside=True, faces="XyYZ"), white)
    window = [
        quad((-2.5, 0, 3), (0, 0, -6), (0, 0.8, 0)),
        quad((-2.5, 2.2, 3), (0, 0, -6), (0, 0.6, 0)),
        quad((-2.5, 0.8, 3), (0, 0, -2.0), (0, 1.4, 0)),
        quad((-2.5, 0.8, -1.5), (0, 0, -1.5), (0, 1.4, 0)),
    ]
    doorway = [
        quad((-2.5, 0, -3), (1.2, 0, 0), (0, 2.8, 0)),
        quad((0.4, 0, -3), (2.1, 0, 0), (0, 2.8, 0)),
        quad((-1.3, 2.2, -3), (1.7, 0, 0), (0, 0.6, 0)),
    ]
    place(w, "window wall", join(window), white)
    place(w, "door wall", join(doorway), white)
    door = place(w, "door", box((0, 0, -0.04), (1.7, 2.2, 0.04)), warm, translation=[-1.3, 0, -3.0])
    table = block(w, "table", (1.2, 0.7, 0.8), warm, (0.6, 0, -0.8), 15)
    block(w, "shelf", (0.4, 1.8, 1.2), warm, (2.2, 0, -1.8))
    light(w, "sun", "directional", 6.0, (1.0, 0.9, 0.75), rotation=down(-80, -30))
    return [
        move(door, "rotation", turn("y", [65.0, 20.0])),
        move(table, "translation", [[0.6, 0.0, -0.8], [0.2, 0.0, -0.4]]),
        *camera(w, [[0.5, 1.5, 2.7], [0.9, 1.5, 2.6]], [6.0, 14.0], -6.0),
    ]


def image_sky(w: Writer) -> Tracks:
    """Blocks, a metal ball and a moving crate below the image of a bright sky with a blurred sun."""
    ground, stone = surface(w, "ground", (0.5, 0.5, 0.48)), surface(w, "stone", (0.7, 0.62, 0.5))
    metal = surface(w, "metal", (0.9, 0.85, 0.75), 1.0, 0.35)
    place(w, "ground", quad((-10, 0, 10), (20, 0, 0), (0, 0, -20)), ground)
    for i in range(5):
        block(w, f"block {i}", (0.7, 0.8 + 0.3 * i, 0.7), stone, (1.3 * i - 2.6, 0, -1.2 - 0.4 * (i % 2)), 20 * i)
    ball = place(w, "ball", sphere(0.45, 24, 36), metal, smooth=True)
    crate = block(w, "crate", (0.6, 0.6, 0.6), stone, (0, 0, 0))
    return [
        move(ball, "translation", [[-1.3, 0.45, 0.4], [-0.4, 0.6, 0.2]]),
        move(crate, "translation", [[1.5, 0.0, 0.8], [0.6, 0.0, 0.3]]),
        *camera(w, [[-0.2, 1.4, 3.6], [0.6, 1.4, 3.4]], [-2.0, 8.0], -8.0),
    ]


def write_sky(path: Path, width: int = 128) -> None:
    """An equirectangular EXR: a gradient, a ground, and a lobe of radiance 40 in place of a sun."""
    height = width // 2
    polar = math.pi * (np.arange(height) + 0.5) / height
    turn_ = 2 * math.pi * ((np.arange(width) + 0.5) / width - 0.5)
    up = np.broadcast_to(np.cos(polar)[:, None], (height, width))
    sun = np.array([0.5, 0.6, 0.62]) / np.linalg.norm([0.5, 0.6, 0.62])
    x, z = np.sin(polar)[:, None] * np.cos(turn_), np.sin(polar)[:, None] * np.sin(turn_)
    lobe = 40.0 * np.exp(40.0 * (x * sun[0] + up * sun[1] + z * sun[2] - 1.0))
    sky = np.where(up[..., None] > 0, [0.35, 0.5, 0.8] + 0.3 * (1 - up[..., None]), [0.25, 0.22, 0.2])
    image = (sky + lobe[..., None] * [1.0, 0.85, 0.6]).astype(np.float32)
    channels = {letter: np.ascontiguousarray(image[..., i]) for i, letter in enumerate("RGB")}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


@dataclass(frozen=True)
class LightScene:
    build: Callable[[Writer], Tracks]
    environment: str | tuple[float, float, float] = "none"  # value of the setting; image: the file of ``write_sky``
    samples: int = 128  # per pixel and seed of the reference; those that Cycles finds hard need more


SCENES = {
    "many_lights": LightScene(many_lights, samples=512),
    "emitters": LightScene(emitters),
    "sun_and_sky": LightScene(sun_and_sky, (0.7, 0.9, 1.3)),
    "glossy_metal": LightScene(glossy_metal),
    "skinned_movers": LightScene(skinned_movers),
    "foliage": LightScene(foliage, (0.6, 0.75, 1.0)),
    "interior": LightScene(interior, (1.2, 1.5, 2.0), samples=256),
    "image_sky": LightScene(image_sky, "image"),
}


def make(
    name: str, folder: Path, scenes: Mapping[str, LightScene] = SCENES, by: str = "light_transport_scenes"
) -> Path:
    """Write ``folder/NAME.glb``, and ``folder/NAME.exr`` where the environment is an image.

    ``by``: the file that has ``scenes``.
    """
    writer = Writer(LICENSE, f"taubench-gl tools/{by}.py", share=True)
    writer.animation("all", *scenes[name].build(writer))
    path = folder / f"{name}.glb"
    writer.save(path)
    if scenes[name].environment == "image":
        write_sky(path.with_suffix(".exr"))
    return path
