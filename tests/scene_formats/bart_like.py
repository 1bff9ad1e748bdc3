"""AFF files of the size of BART's scenes, made from fixed seeds: robots, kitchen and museum.

Sizes follow the paper of BART (Lext, Assarsson, Moeller 2000): robots has 71,708 triangles in 161 moving parts, the
kitchen 110,561 triangles and moving lights, the museum 75,884 triangles of which 65,536 are animated one by one.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

Array = np.ndarray

ROBOTS, PARTS, KEYS = 10, 16, 120
"""Robots, moving parts of each, and keys of each part's rotation."""
SECONDS = 20.0


def rows(table: Array) -> str:
    return "\n".join(" ".join(f"{x:.6g}" for x in row) for row in table)


def rotation_track(rng: np.random.Generator, count: int = KEYS) -> Array:
    """(count, 8) keys of a limb: swings about changing axes, with some tension, continuity and bias."""
    times = np.linspace(-SECONDS / count, SECONDS + SECONDS / count, count)
    axis = np.array([1.0, 0.0, 0.0]) + rng.normal(size=(count, 3)) * 0.2
    degrees = 40.0 * np.sin(times * rng.uniform(2.0, 5.0) + rng.uniform(0.0, 6.0))
    return np.column_stack([times, axis, degrees, rng.uniform(-0.3, 0.3, (count, 3))])


def position_track(rng: np.random.Generator, count: int = KEYS) -> Array:
    """(count, 7) keys of a path on the ground."""
    times = np.linspace(-SECONDS / count, SECONDS + SECONDS / count, count)
    path = np.cumsum(rng.normal(size=(count, 3)) * [0.4, 0.0, 0.4], axis=0)
    return np.column_stack([times, path, np.zeros((count, 3))])


def track(kind: str, keys: Array) -> str:
    return f"{kind} {len(keys)}\n{rows(keys)}\n"


def grid_mesh(rng: np.random.Generator, triangles: int, center: Array, size: float) -> str:
    """A bumpy sheet of about ``triangles`` triangles with normals."""
    side = max(int(np.sqrt(triangles / 2)), 1)
    x, z = np.meshgrid(np.linspace(-size, size, side + 1), np.linspace(-size, size, side + 1))
    points = np.column_stack([x.ravel(), 0.1 * size * rng.random(x.size), z.ravel()]) + center
    normals = np.column_stack([0.2 * rng.normal(size=(x.size, 2)), np.ones(x.size)])[:, [0, 2, 1]]
    i = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    corners = np.concatenate([np.column_stack([i, i + side + 1, i + 1]),
                              np.column_stack([i + 1, i + side + 1, i + side + 2])])  # fmt: skip
    both = np.concatenate([corners, corners], axis=1)
    listed = "\n".join(" ".join(map(str, row)) for row in both.tolist())
    return (f"m vertices {len(points)}\n{rows(points)}\nnormals {len(normals)}\n{rows(normals)}\n"
            f"triangles {len(both)}\n{listed}\n")  # fmt: skip


VIEW = "v\nfrom 0 3 12\nat 0 1 0\nup 0 1 0\nangle 45\nhither 0.1\nresolution 800 600\n"


def robots(folder: Path) -> Path:
    """Ten robots of 16 parts over a city block; every fifth rotation track has key times that do not increase."""
    rng = np.random.default_rng(1)
    text = [f"a 0 {SECONDS:g} 800\n", VIEW, "l 0 50 0 1 1 1\n", "fm 0 0 0 .6 .6 .6 .2 .2 .2 10 0 1\n"]
    text.append(grid_mesh(rng, 24_000, np.zeros(3), 30.0))
    moves = []
    for robot in range(ROBOTS):
        text.append(f"x robot{robot} {{\n")
        for part in range(PARTS):
            name = f"robot{robot}part{part}"
            text.append(f"xs 1 1 1 0 1 0 0 {part % 4 - 1.5:g} {part // 4:g} 0 {{ x {name} {{\n")
            text.append(grid_mesh(rng, 288, np.zeros(3), 0.3) + "} }\n")
            keys = rotation_track(rng)
            if part % 5 == 0:
                keys[7, 0] = keys[6, 0]
            moves.append(f"k {name} {{\n{track('rot', keys)}}}\n")
        text.append("}\n")
        moves.append(
            f"k robot{robot} {{\n{track('transl', position_track(rng))}{track('rot', rotation_track(rng))}}}\n"
        )
    moves.append(f"k camera {{\n{track('transl', position_track(rng))}{track('rot', rotation_track(rng))}}}\n")
    return _write(folder, "robots.aff", text + moves)


def kitchen(folder: Path) -> Path:
    """Many static meshes in several files, a moving camera, a moving toy car and two moving lights."""
    rng = np.random.default_rng(2)
    text = [f"a 0 {SECONDS:g} 800\n", VIEW]
    for part in range(40):
        _write(folder, f"part{part}.aff", [f"fm 0 0 0 {rows(rng.random((1, 3)))} .1 .1 .1 10 0 1\n",
                                           grid_mesh(rng, 2800, rng.normal(size=3) * 4.0, 1.0)])  # fmt: skip
        text.append(f"i 0 part{part}.aff\n")
    text.append("x car {\ns 0 0.5 0 0.5\n}\nla lamp0 0 4 0 .7 .7 .7\nla lamp1 2 4 0 .3 .3 .3\nl 0 8 0 .4 .4 .4\n")
    for name in ("car", "lamp0", "lamp1", "camera"):
        text.append(f"k {name} {{\n{track('transl', position_track(rng))}{track('rot', rotation_track(rng))}}}\n")
    return _write(folder, "kitchen.aff", text)


def museum(folder: Path) -> Path:
    """A hall with two lights without falloff, and 65,536 triangles animated one by one over eleven times."""
    rng = np.random.default_rng(3)
    text = [f"a 0 {SECONDS:g} 300\n", VIEW, "l -8 7 6 .6 .6 .6\nl 8 7 6 .5 .5 .5\n", "fm 0 0 0 .7 .7 .7 0 0 0 1 0 1\n"]
    text.append(grid_mesh(rng, 10_000, np.zeros(3), 12.0))
    times = np.linspace(0.0, SECONDS, 11)
    centers = rng.normal(size=(65_536, 3)) * 1.5 + [0, 2, 0]
    corners = 0.02 * rng.normal(size=(65_536, 1, 3, 3)) + centers[:, None, None]
    frames = corners + 0.2 * rng.normal(size=(1, 11, 1, 3))
    keys = np.concatenate([frames, np.broadcast_to([0.0, 0.0, 1.0], frames.shape)], axis=-1)
    table = np.concatenate([np.broadcast_to(times[:, None], (65_536, 11, 1)), keys.reshape(65_536, 11, 18)], axis=-1)
    line = " ".join(["%.5g"] * 19)
    one = "tpa 11 " + "\n".join([line] * 11)
    text += [one % tuple(part.ravel().tolist()) + "\n" for part in table]
    walk = position_track(rng)
    walk[:, 1:4] = 0.1 * walk[:, 1:4] + [0.0, 3.0, 11.0]
    text.append(f"k camera {{\n{track('transl', walk)}}}\n")
    return _write(folder, "museum.aff", text)


def _write(folder: Path, name: str, parts: list[str]) -> Path:
    path = folder / name
    path.write_text("".join(parts))
    return path
