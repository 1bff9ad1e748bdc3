"""Twelve small scenes for the comparison of path-traced light with Cycles, written as glTF.

Six of ``suite_scenes``, and those with what these lack: a skin, the image of a sky, and glass.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR
from light_kit import (
    SECONDS,
    Tracks,
    block,
    camera,
    emitter,
    extend,
    light,
    move,
    place,
    surface,
    times,
    turn,
)
from make_assets import add_tentacle
from shapes import quad, sphere
from suite_scenes import SCENES as MADE
from suite_scenes import LightScene, make_light_scene

from taubench_gl.datasets.gltf_writer import Writer


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


def glass(w: Writer, name: str, roughness: float, ior: float = 1.5, color=None, distance: float = 1.0) -> int:
    """White glass that bounds a volume; ``color``: of white light after ``distance`` meters."""
    material = w.material(name, (1.0, 1.0, 1.0), 0.0, roughness, doubleSided=True)
    extend(w, material, "KHR_materials_transmission", {"transmissionFactor": 1.0})
    extend(w, material, "KHR_materials_ior", {"ior": ior})
    volume = {"thicknessFactor": 1.0}
    if color is not None:
        volume |= {"attenuationColor": list(color), "attenuationDistance": distance}
    extend(w, material, "KHR_materials_volume", volume)
    return material


def table(w: Writer, back=(0.6, 0.55, 0.5)) -> None:
    """A floor and a back wall of two colors."""
    floor, wall, stripe = (
        surface(w, "floor", (0.6, 0.6, 0.62)),
        surface(w, "wall", back),
        surface(w, "stripe", (0.2, 0.3, 0.6)),
    )
    place(w, "floor", quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), floor)
    place(w, "back", quad((-4, 0, -1.5), (8, 0, 0), (0, 4, 0)), wall)
    for i in range(4):
        place(w, f"stripe {i}", quad((-2.0 + i, 0.0, -1.49), (0.4, 0, 0), (0, 3, 0)), stripe)


def glass_ball(w: Writer) -> Tracks:
    """A clear ball that moves, and a still one of a high index, before stripes below a panel and a dim sky."""
    table(w)
    ball = place(w, "ball", sphere(0.6, 48, 72), glass(w, "clear", 0.2), smooth=True)
    place(w, "other", sphere(0.4, 48, 72), glass(w, "dense", 0.2, 1.9), smooth=True, translation=[0.9, 0.41, 0.6])
    panel = emitter(w, "panel", (1.0, 0.95, 0.85), 6.0)
    place(w, "panel", quad((-1.2, 2.9, 0.4), (2.4, 0, 0), (0, 0, 1.2)), panel)
    return [
        move(ball, "translation", [[-0.8, 0.61, 0.2], [0.0, 0.75, 0.2]]),
        *camera(w, [[-0.1, 1.1, 3.6], [0.2, 1.1, 3.5]], [0.0, 4.0], -8.0),
    ]


def glass_panes(w: Writer) -> Tracks:
    """Thick panes of tinted glass, one of which turns, and a crate that moves behind them, below a bright sky."""
    table(w)
    crate = block(w, "crate", (0.6, 0.8, 0.4), surface(w, "crate", (0.75, 0.3, 0.2)), (0, 0, 0))
    tints = ((0.9, 0.5, 0.4), (0.4, 0.8, 0.5))
    for i, tint in enumerate(tints):
        material = glass(w, f"tint {i}", 0.15, 1.5, tint, 0.25)
        pane = block(w, f"pane {i}", (1.0, 1.4, 0.18), material, (1.1 * i - 0.6, 0.01, 0.9), 15 - 30 * i)
    return [
        move(crate, "translation", [[-0.9, 0.0, -0.2], [0.6, 0.0, -0.4]]),
        move(pane, "translation", [[0.5, 0.01, 0.9], [0.8, 0.01, 0.8]]),
        *camera(w, [[0.0, 1.0, 3.4], [0.1, 1.1, 3.3]], [1.0, -2.0], -6.0),
    ]


def rough_glass(w: Writer) -> Tracks:
    """Rough balls and a rough block of glass, below a panel and a lamp that moves."""
    table(w, (0.7, 0.68, 0.6))
    for i, roughness in enumerate((0.35, 0.5, 0.7)):
        material = glass(w, f"rough {i}", roughness)
        place(w, f"ball {i}", sphere(0.4, 48, 72), material, smooth=True, translation=[1.0 * i - 1.0, 0.41, 0.5])
    block(w, "block", (0.5, 0.9, 0.5), glass(w, "block", 0.4, 1.33), (0.4, 0.01, -0.5), 25)
    panel = emitter(w, "panel", (0.9, 0.95, 1.0), 5.0)
    place(w, "panel", quad((-1.5, 2.7, 0.0), (3.0, 0, 0), (0, 0, 1.0)), panel)
    lamp = light(w, "lamp", "point", 6.0, (1.0, 0.8, 0.6))
    return [
        move(lamp, "translation", [[-1.5, 1.5, 1.6], [0.5, 1.8, 1.4]]),
        *camera(w, [[0.0, 1.2, 3.5], [0.2, 1.2, 3.4]], [0.0, 3.0], -10.0),
    ]


def amber(w: Writer) -> Tracks:
    """An absorbing block with an opaque one inside that turns, and a tinted ball, below a sky and a panel."""
    table(w)
    inner = surface(w, "inner", (0.8, 0.75, 0.3))
    block(w, "amber", (1.0, 1.0, 0.8), glass(w, "amber", 0.15, 1.5, (0.9, 0.55, 0.15), 0.5), (-0.5, 0.01, 0.3), 20)
    core = block(w, "core", (0.3, 0.3, 0.3), inner, (-0.5, 0.35, 0.3))
    material = glass(w, "blue", 0.2, 1.45, (0.3, 0.5, 0.9), 0.6)
    ball = place(w, "ball", sphere(0.45, 48, 72), material, smooth=True)
    panel = emitter(w, "panel", (1.0, 1.0, 1.0), 4.0)
    place(w, "panel", quad((-1.5, 2.9, 0.2), (3.0, 0, 0), (0, 0, 1.0)), panel)
    return [
        (core, "rotation", times(3), turn("y", [0.0, 60.0, 120.0]), "LINEAR"),
        move(ball, "translation", [[1.2, 0.46, 0.4], [0.6, 0.6, 0.6]]),
        *camera(w, [[0.0, 1.2, 3.4], [0.1, 1.3, 3.3]], [0.0, 3.0], -10.0),
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


SCENES = {
    **{name: MADE[name] for name in ("many_lights", "emitters", "sun_and_sky", "glossy_metal")},
    "skinned_movers": LightScene(skinned_movers),
    **{name: MADE[name] for name in ("foliage", "interior")},
    "image_sky": LightScene(image_sky, "image"),  # the file of ``write_sky``
    "glass_ball": LightScene(glass_ball, (0.15, 0.18, 0.22)),
    "glass_panes": LightScene(glass_panes, (0.9, 1.0, 1.1)),
    "rough_glass": LightScene(rough_glass),
    "amber": LightScene(amber, (0.4, 0.45, 0.5)),
}

SAMPLES = {"many_lights": 512, "interior": 256}
"""Per pixel and seed of the references that Cycles finds hard; the others have 128."""


def make(
    name: str, folder: Path, scenes: Mapping[str, LightScene] = SCENES, by: str = "light_transport_scenes"
) -> Path:
    """Write ``folder/NAME.glb``, and ``folder/NAME.exr`` where the environment is an image.

    ``by``: the file that has ``scenes``.
    """
    path = folder / f"{name}.glb"
    make_light_scene(scenes[name], path, f"taubench-gl tools/{by}.py")
    if scenes[name].environment == "image":
        write_sky(path.with_suffix(".exr"))
    return path
