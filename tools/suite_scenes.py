"""assets/light (``tools/record assets``): fourteen small scenes for path-traced light, 12 frames each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from light_kit import (
    Tracks,
    block,
    brick_colors,
    camera,
    down,
    emitter,
    leaves,
    light,
    move,
    place,
    surface,
    tiled,
    turn,
)
from make_stand_ins import LICENSE
from shapes import Shape, box, join, quad, sphere

from taubench_gl.datasets.gltf_writer import Writer


def surfaces(w: Writer, **colors: tuple[float, float, float]) -> list[int]:
    """Rough dielectrics by name and base color, in this order."""
    return [surface(w, name, color) for name, color in colors.items()]


def leaf_card(along: np.ndarray, size: float) -> Shape:
    """An upright square of side ``size`` that stands on the origin, parallel to the unit vector ``along``."""
    card = quad(-0.5 * size * along, size * along, (0, size, 0))
    card["TEXCOORD_0"] = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=float)
    return card


def many_lights(w: Writer) -> Tracks:
    """A hall with columns: 28 point lights, half of them moving, three spots and a sun."""
    stone, red, blue = surfaces(w, stone=(0.7, 0.68, 0.65), red=(0.65, 0.2, 0.15), blue=(0.2, 0.3, 0.65))
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
    white, red, green = surfaces(w, white=(0.75,) * 3, red=(0.63, 0.06, 0.05), green=(0.14, 0.45, 0.09))
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
    earth, stone, brick = surfaces(w, earth=(0.45, 0.4, 0.33), stone=(0.7, 0.68, 0.62), brick=(0.6, 0.3, 0.2))
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
    gold = surface(w, "gold", (0.95, 0.75, 0.35), 1.0, 0.3)
    copper = surface(w, "copper", (0.9, 0.55, 0.4), 1.0, 0.6)
    silver = surface(w, "silver", (0.9, 0.9, 0.88), 1.0, 0.15)
    iron = surface(w, "iron", (0.55, 0.55, 0.58), 1.0, 0.45)
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
        angles = [math.pi * k / 3 for k in range(3)]
        cards = [leaf_card(np.array([math.cos(a), 0.0, math.sin(a)]), 0.9) for a in angles]
        at = [rng.uniform(-2.4, 2.4), rng.uniform(0.0, 1.5), rng.uniform(-1.5, 1.2)]
        branch = place(w, f"branch {i}", join(cards), leaf, translation=at)
        start, step = rng.uniform(0, 60), rng.uniform(-40, 40)
        tracks.append(move(branch, "rotation", turn("y", [start, start + step])))
    sun = light(w, "sun", "directional", 5.0, (1.0, 0.94, 0.82))
    tracks.append(move(sun, "rotation", [down(30, -42), down(45, -48)]))
    return [*tracks, *camera(w, [[-0.3, 1.3, 3.6], [0.3, 1.4, 3.5]], [-3.0, 4.0], -5.0)]


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


def punctual(w: Writer) -> Tracks:
    """A corner with steps; a point light rises, a spot turns, a third one stands."""
    stone, ochre, teal = surfaces(w, stone=(0.66, 0.64, 0.6), ochre=(0.7, 0.5, 0.22), teal=(0.2, 0.5, 0.5))
    place(w, "floor", quad((-5, 0, 5), (10, 0, 0), (0, 0, -10)), stone)
    place(w, "back", quad((-5, 0, -3), (10, 0, 0), (0, 4, 0)), ochre)
    place(w, "side", quad((-3, 0, 5), (0, 0, -10), (0, 4, 0)), teal)
    for i in range(4):
        block(w, f"step {i}", (2.0, 0.3 * (i + 1), 0.6), stone, (1.2, 0, 0.4 - 0.6 * i))
    ball = place(w, "ball", sphere(0.4, 12, 18), ochre)
    rising = light(w, "rising", "point", 6.0, (1.0, 0.8, 0.6))
    turning = light(w, "turning", "spot", 25.0, (0.7, 0.85, 1.0), spot=(0.3, 0.5), translation=[-1.5, 3.5, 2.0])
    light(w, "standing", "point", 4.0, translation=[2.5, 2.8, 1.0])
    return [
        move(rising, "translation", [[-0.6, 0.8, 0.8], [-0.2, 1.9, 0.3]]),
        move(turning, "rotation", [down(-20, -50), down(10, -62)]),
        move(ball, "translation", [[-1.4, 0.4, 0.2], [-0.6, 0.4, -0.6]]),
        *camera(w, [[0.2, 1.5, 4.2], [0.8, 1.6, 4.0]], [2.0, 9.0], -8.0),
    ]


def sun_court(w: Writer) -> Tracks:
    """A court of white walls below a uniform sky; the sun moves, a gate opens."""
    white, clay = surface(w, "white", (0.8, 0.78, 0.74)), surface(w, "clay", (0.62, 0.36, 0.24))
    place(w, "ground", quad((-9, 0, 9), (18, 0, 0), (0, 0, -18)), clay)
    place(w, "back", box((-4, 0, -4.3), (4, 2.6, -4)), white)
    place(w, "left", box((-4.3, 0, -4), (-4, 2.6, 2)), white)
    place(w, "arcade", box((-4, 1.9, -4), (4, 2.1, -2.6)), white)
    for i in range(5):
        block(w, f"pillar {i}", (0.3, 1.9, 0.3), white, (1.8 * i - 3.6, 0, -2.7))
    gate = place(w, "gate", box((0, 0, -0.04), (1.5, 2.0, 0.04)), clay, translation=[-3.9, 0, 1.0])
    cart = block(w, "cart", (0.9, 0.7, 0.6), clay, (0, 0, 0))
    sun = light(w, "sun", "directional", 5.0, (1.0, 0.93, 0.82))
    return [
        move(sun, "rotation", [down(-25, -48), down(-45, -40)]),
        move(gate, "rotation", turn("y", [10.0, -35.0])),
        move(cart, "translation", [[0.4, 0.0, -0.6], [-0.8, 0.0, -1.2]]),
        *camera(w, [[0.8, 1.6, 4.4], [0.2, 1.6, 4.3]], [6.0, 14.0], -7.0),
    ]


def panels(w: Writer) -> Tracks:
    """A corridor that four panels light; one slides, a cart passes."""
    wall, floor = surface(w, "wall", (0.72, 0.72, 0.7)), surface(w, "floor", (0.4, 0.38, 0.36))
    place(w, "shell", box((-1.5, 0, -6), (1.5, 2.6, 4), inside=True, faces="xXYzZ"), wall)
    place(w, "floor", quad((-1.5, 0.001, 4), (3, 0, 0), (0, 0, -10)), floor)
    colors = ((1.0, 0.9, 0.75), (0.8, 0.9, 1.0), (1.0, 0.7, 0.5))
    for i, color in enumerate(colors):
        panel = quad((-0.4, 2.58, -4.8 + 2.6 * i), (0.8, 0, 0), (0, 0, 0.5))
        place(w, f"panel {i}", panel, emitter(w, f"panel {i}", color, 11.0))
    slide = place(w, "slide", quad((-1.49, 0, 0), (0, 0, -0.7), (0, 0.5, 0)), emitter(w, "slide", (0.6, 1.0, 0.8), 9.0))
    cart = block(w, "cart", (0.6, 0.8, 0.9), wall, (0, 0, 0), 12)
    block(w, "cabinet", (0.5, 1.7, 0.9), floor, (1.2, 0, -2.5))
    return [
        move(slide, "translation", [[0.0, 0.8, 0.6], [0.0, 1.1, -0.9]]),
        move(cart, "translation", [[-0.5, 0.0, -1.2], [0.2, 0.0, -0.4]]),
        *camera(w, [[0.2, 1.5, 3.6], [0.0, 1.5, 3.2]], [2.0, -5.0], -6.0),
    ]


def lanterns(w: Writer) -> Tracks:
    """A street with 40 lanterns, a third of which swing."""
    road, brick = surface(w, "road", (0.35, 0.35, 0.37)), surface(w, "house", (0.6, 0.45, 0.35))
    place(w, "road", quad((-8, 0, 8), (16, 0, 0), (0, 0, -16)), road)
    for i in range(8):
        side = -1 if i % 2 else 1
        block(w, f"house {i}", (2.2, 2.4 + 0.4 * (i % 3), 2.6), brick, (side * 3.4, 0, 3.0 - 3.0 * (i // 2)))
    rng, tracks = np.random.default_rng(17), []
    for i in range(40):
        at = np.array([rng.uniform(-2.1, 2.1), rng.uniform(1.2, 2.4), rng.uniform(-7.0, 3.0)])
        color = [(1.0, 0.7, 0.4), (1.0, 0.5, 0.45), (0.6, 0.8, 1.0)][i % 3]
        lamp = light(w, f"lantern {i}", "point", rng.uniform(0.6, 1.8), color, translation=at.tolist())
        if i % 3 == 0:
            tracks.append(move(lamp, "translation", [at, at + rng.uniform(-0.6, 0.6, 3) * [1, 0.2, 1]]))
    return [*tracks, *camera(w, [[0.0, 1.6, 5.0], [0.3, 1.6, 4.6]], [0.0, 6.0], -5.0)]


def dark(w: Writer) -> Tracks:
    """A white room that the lamp of the next room lights through a door that moves: nearly all light is indirect."""
    white, dull = surface(w, "white", (0.82, 0.82, 0.8)), surface(w, "dull", (0.5, 0.42, 0.35))
    place(w, "rooms", box((-2.5, 0, -5.5), (2.5, 2.6, 3), inside=True, faces="xXyYzZ"), white)
    parts = [box((-2.5, 0, -1.6), (-0.3, 2.6, -1.5)), box((0.9, 0, -1.6), (2.5, 2.6, -1.5)),
             box((-0.3, 2.0, -1.6), (0.9, 2.6, -1.5))]  # fmt: skip
    place(w, "wall", join(parts), white)
    door = place(w, "door", box((0, 0, -0.03), (1.2, 2.0, 0.03)), dull, translation=[-0.3, 0, -1.5])
    chair = block(w, "chair", (0.5, 0.8, 0.5), dull, (0, 0, 0))
    light(w, "lamp", "point", 40.0, (1.0, 0.88, 0.7), translation=[-1.2, 2.0, -3.5])
    return [
        move(door, "rotation", turn("y", [55.0, 25.0])),
        move(chair, "translation", [[1.2, 0.0, 0.2], [0.5, 0.0, 0.5]]),
        *camera(w, [[-0.2, 1.5, 2.7], [0.2, 1.5, 2.6]], [0.0, 6.0], -5.0),
    ]


def textured_metals(w: Writer) -> Tracks:
    """Metals between tiled walls; a lamp and a box of polished metal move."""
    tiles, wall = tiled(w, brick_colors()), surface(w, "wall", (0.7, 0.7, 0.72))
    place(w, "floor", box((-3, -0.1, -3), (3, 0, 3), uv_scale=0.5), tiles)
    place(w, "walls", box((-3, 0, -3), (3, 3, 3), inside=True, faces="xXYzZ"), wall)
    brass, steel, zinc = (surface(w, n, c, 1.0, r) for n, c, r in (("brass", (0.9, 0.75, 0.45), 0.35),
                          ("steel", (0.7, 0.7, 0.72), 0.25), ("zinc", (0.6, 0.62, 0.65), 0.55)))  # fmt: skip
    place(w, "ball", sphere(0.45, 16, 24), brass, translation=[-0.9, 0.45, -0.6])
    mover = block(w, "mover", (0.7, 0.9, 0.7), steel, (0, 0, 0), 25)
    block(w, "tank", (0.9, 1.5, 0.6), zinc, (1.6, 0, -1.6), -15)
    lamp = light(w, "lamp", "point", 6.0, (1.0, 0.9, 0.75))
    light(w, "fill", "point", 3.0, (0.75, 0.85, 1.0), translation=[-2.2, 2.2, 1.8])
    return [
        move(lamp, "translation", [[1.2, 2.3, 0.8], [0.2, 2.5, 0.2]]),
        move(mover, "translation", [[0.6, 0.0, 0.4], [0.1, 0.0, -0.2]]),
        *camera(w, [[0.0, 1.5, 2.8], [0.4, 1.5, 2.6]], [0.0, 8.0], -10.0),
    ]


def thicket(w: Writer) -> Tracks:
    """Alpha-masked leaves before two walls, below a sky without a sun and a lamp that moves through them."""
    earth, wall = surface(w, "earth", (0.45, 0.4, 0.32)), surface(w, "wall", (0.68, 0.66, 0.7))
    leaf = surface(w, "leaf", (1.0, 1.0, 1.0), texture=w.texture(leaves()), alphaMode="MASK")
    w.gltf.materials[leaf].alphaCutoff = 0.5
    place(w, "ground", quad((-7, 0, 7), (14, 0, 0), (0, 0, -14)), earth)
    place(w, "walls", join([box((-4, 0, -2.4), (4, 2.6, -2.2)), box((-3.2, 0, -2.2), (-3, 2.6, 2))]), wall)
    rng, tracks = np.random.default_rng(23), []
    for i in range(16):
        angle = rng.uniform(0, np.pi)
        u = np.array([np.cos(angle), 0.0, np.sin(angle)])
        cards = [leaf_card(v, 0.8) for v in (u, np.array([-u[2], 0.0, u[0]]))]
        at = [rng.uniform(-2.2, 2.2), rng.uniform(0.0, 1.3), rng.uniform(-1.6, 1.0)]
        bush = place(w, f"bush {i}", join(cards), leaf, translation=at)
        if i % 2:
            tracks.append(move(bush, "translation", [at, (np.array(at) + rng.uniform(-0.25, 0.25, 3)).tolist()]))
    lamp = light(w, "lamp", "point", 3.0, (1.0, 0.8, 0.55))
    tracks.append(move(lamp, "translation", [[-1.2, 1.0, 0.4], [0.2, 1.3, 0.1]]))
    return [*tracks, *camera(w, [[0.3, 1.3, 3.6], [-0.2, 1.3, 3.4]], [2.0, -5.0], -5.0)]


def closed_box(w: Writer) -> Tracks:
    """The box of Cornell with a lamp below its ceiling that moves, and a block that turns."""
    white, red, green = surfaces(w, white=(0.74,) * 3, red=(0.62, 0.07, 0.06), green=(0.13, 0.46, 0.1))
    place(w, "shell", box((-1.4, 0, -1.4), (1.4, 2.8, 1.4), inside=True, faces="yYzZ"), white)
    place(w, "left", box((-1.4, 0, -1.4), (1.4, 2.8, 1.4), inside=True, faces="x"), red)
    place(w, "right", box((-1.4, 0, -1.4), (1.4, 2.8, 1.4), inside=True, faces="X"), green)
    tall = block(w, "tall", (0.8, 1.5, 0.8), white, (-0.5, 0, -0.5))
    block(w, "low", (0.7, 0.7, 0.7), white, (0.5, 0, 0.3), -18)
    lamp = light(w, "lamp", "point", 2.5, (1.0, 0.95, 0.85))
    return [
        move(lamp, "translation", [[-0.3, 2.5, 0.1], [0.5, 2.4, -0.2]]),
        move(tall, "rotation", turn("y", [15.0, 35.0])),
        *camera(w, [[0.0, 1.4, 1.35], [0.15, 1.4, 1.3]], [0.0, 4.0], -3.0),
    ]


@dataclass(frozen=True, slots=True)
class LightScene:
    """A scene of lights: ``build`` adds it to a file and returns its animation; ``environment``: the setting for it."""

    build: Callable[[Writer], Tracks]
    environment: str | tuple[float, float, float] = "none"


SCENES = {
    "many_lights": LightScene(many_lights),
    "emitters": LightScene(emitters),
    "sun_and_sky": LightScene(sun_and_sky, (0.7, 0.9, 1.3)),
    "glossy_metal": LightScene(glossy_metal),
    "foliage": LightScene(foliage, (0.6, 0.75, 1.0)),
    "interior": LightScene(interior, (1.2, 1.5, 2.0)),
    "punctual": LightScene(punctual),
    "sun_court": LightScene(sun_court, (0.6, 0.8, 1.2)),
    "panels": LightScene(panels),
    "lanterns": LightScene(lanterns),
    "dark": LightScene(dark),
    "textured_metals": LightScene(textured_metals),
    "thicket": LightScene(thicket, (0.7, 0.85, 1.1)),
    "closed_box": LightScene(closed_box),
}


def make_light_scene(scene: LightScene, path: Path, generator: str = "taubench-gl") -> None:
    """Write ``scene`` as the binary glTF file ``path``."""
    writer = Writer(LICENSE, generator, share=True)
    writer.animation("all", *scene.build(writer))
    writer.save(path)
