"""The valley of the stand-ins: a height field with ridges, trees, rocks, huts and grass.  Original, CC0."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from shapes import Shape, box, grid_indices, join, moved, quad, sphere, tube

from taubench_gl.datasets.camera_path import quat_about
from taubench_gl.datasets.gltf_writer import Writer

Array = np.ndarray

HALF_LENGTH, HALF_WIDTH = 190.0, 130.0
"""Half the extent of the terrain along x and z, meters."""

FLOOR_END, FLOOR_SIDE = 140.0, 40.0
"""Extent of the valley floor along x, and to either side of its middle line, meters."""

CELL = 4.0

ROUGHNESS = 1.0
"""Root mean square slope of the ground's bump map."""

TILE = 6.0
"""Period of the ground texture, meters."""

EYE_HEIGHT = 1.75

_WAVES = np.random.default_rng(20).uniform([0.012, 0.012, 0.0], [0.055, 0.055, 2 * np.pi], (14, 3))
_CRAGS = np.random.default_rng(21).uniform([0.05, 0.05, 0.0], [0.16, 0.16, 2 * np.pi], (14, 3))


def middle(x: Array) -> Array:
    """z of the valley's middle line at ``x``, meters; same shape as ``x``."""
    return 14.0 * np.sin(np.asarray(x) / 46.0)


def height(x: Array, z: Array) -> Array:
    """y of the ground, meters.  Broadcasts x and z, meters."""
    x, z = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
    side = np.abs(z - middle(x)) - FLOOR_SIDE
    # The southern ridge, towards the sun, is higher: its shadow covers half of the floor.
    crest = np.where(z < middle(x), 50.0, 40.0)
    rise = np.maximum(_smooth(side / 44.0), _smooth((np.abs(x) - FLOOR_END) / 42.0))
    rolling = _waves(_WAVES, x, z)
    crags = _waves(_CRAGS, x, z)
    return 0.9 * rolling + rise * (crest + 6.0 * rolling + 3.2 * crags)


def _smooth(t: Array) -> Array:
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3 - 2 * t)


def _waves(waves: Array, x: Array, z: Array) -> Array:
    kx, kz, phase = waves.T
    kx = np.where(np.arange(len(waves)) % 2, kx, -kx)  # so that the waves cross
    return np.sin(x[..., None] * kx + z[..., None] * kz + phase).sum(axis=-1) / math.sqrt(len(waves))


@dataclass(frozen=True)
class ValleySpace:
    """``FreeSpace`` on the valley floor at eye height, outside the obstacles.

    ``obstacles`` (K, 3): x, z and radius.  ``begin`` (x, z) and ``yaw``: the first pose; ``reach``: limit along x.
    """

    obstacles: Array
    begin: tuple[float, float]
    yaw: float
    reach: float = FLOOR_END - 8.0

    def start(self) -> tuple[Array, float]:
        x, z = self.begin
        return np.array([x, float(height(x, z)) + EYE_HEIGHT, z]), self.yaw

    def resolution(self) -> float:
        return 0.5

    def look_at(self) -> None:
        return None

    def step(self, position: Array, angles: Array, length: float) -> Array:
        """Steps on the ground: the horizontal part is solved for, so that the step has the full length."""
        dx, dz = -np.sin(angles), -np.cos(angles)
        low, high = np.zeros(len(angles)), np.full(len(angles), float(length))
        for _ in range(52):
            r = 0.5 * (low + high)
            climb = height(position[0] + r * dx, position[2] + r * dz) + EYE_HEIGHT - position[1]
            short = r * r + climb * climb < length * length
            low, high = np.where(short, r, low), np.where(short, high, r)
        x, z = position[0] + low * dx, position[2] + low * dz
        return np.stack([x, height(x, z) + EYE_HEIGHT, z], axis=-1)

    def clearance(self, points: Array) -> Array:
        points = np.asarray(points)
        x, z = points[..., 0], points[..., 2]
        side = FLOOR_SIDE - 4.0 - np.abs(z - middle(x))
        end = self.reach - np.abs(x - (self.begin[0] if self.reach < 100 else 0.0))
        away = np.hypot(x[..., None] - self.obstacles[:, 0], z[..., None] - self.obstacles[:, 1]) - self.obstacles[:, 2]
        return np.minimum(np.minimum(side, end) / 12.0, np.minimum(away.min(axis=-1) / 3.0, 1.0))


def terrain() -> Shape:
    """The ground, colored by height and slope; texture coordinates have the period ``TILE``."""
    rows, columns = int(2 * HALF_WIDTH / CELL), int(2 * HALF_LENGTH / CELL)
    lines = np.linspace(-HALF_WIDTH, HALF_WIDTH, rows + 1), np.linspace(-HALF_LENGTH, HALF_LENGTH, columns + 1)
    z, x = np.meshgrid(*lines, indexing="ij")
    y, step = height(x, z), 0.25
    slope_x = (height(x + step, z) - height(x - step, z)) / (2 * step)
    slope_z = (height(x, z + step) - height(x, z - step)) / (2 * step)
    normal = np.stack([-slope_x, np.ones_like(x), -slope_z], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    steep = _smooth((1.0 - normal[..., 1]) / 0.22)[..., None]
    dry = (0.5 + 0.5 * np.sin(x / 17.0 + np.cos(z / 13.0)))[..., None]
    grass = (1 - dry) * np.array([0.13, 0.24, 0.06]) + dry * np.array([0.30, 0.28, 0.10])
    snow = _smooth((y - 44.0) / 9.0)[..., None]
    color = (1 - steep) * grass + steep * np.array([0.19, 0.17, 0.15])
    path = np.exp(-(((z - middle(x) - 5 * np.sin(x / 21)) / 2.6) ** 2))[..., None] * (np.abs(x) < FLOOR_END)[..., None]
    color = (1 - 0.8 * path) * color + 0.8 * path * np.array([0.36, 0.28, 0.19])
    color = (1 - snow) * color + snow * 0.5
    return {
        "POSITION": np.stack([x, y, z], axis=-1).reshape(-1, 3),
        "NORMAL": normal.reshape(-1, 3),
        "TEXCOORD_0": np.stack([x, z], axis=-1).reshape(-1, 2) / TILE,
        "COLOR_0": np.concatenate([color, np.ones_like(snow)], axis=-1).reshape(-1, 4),
        "indices": grid_indices(rows, columns),
    }


def mottled(size: int = 512) -> tuple[Array, Array]:
    """A seamless color texture and normal map of rough ground.  -> two (size, size, 3) uint8.

    The bumps have the same slope at every scale, so that adjacent pixels differ at every distance.
    """
    rng = np.random.default_rng(22)
    frequency = np.fft.fftfreq(size, 1.0 / size)
    turns = np.hypot(frequency[:, None], frequency[None, :])
    # The slope energy is equal in every octave if the amplitude falls with the square of the frequency.
    falling = np.where((turns >= 2) & (turns <= size / 3), 1.0, 0.0) / np.maximum(turns, 1.0) ** 2
    bumps, spots = (
        np.fft.ifft2(np.fft.fft2(rng.normal(size=(size, size))) * f).real for f in (falling, np.sqrt(falling))
    )
    slope = [np.roll(bumps, -1, a) - np.roll(bumps, 1, a) for a in (1, 0)]
    steep = ROUGHNESS / np.sqrt(np.mean(slope[0] ** 2 + slope[1] ** 2))
    normal = np.stack([-steep * slope[0], steep * slope[1], np.ones_like(bumps)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    color = np.repeat((150 + 50 * spots / spots.std()).clip(32, 255)[..., None], 3, axis=-1)
    return (color // 8 * 8).astype(np.uint8), np.round(normal * 127.5 + 127.5).astype(np.uint8)


def colored(shape: Shape, color: tuple[float, float, float]) -> Shape:
    """``shape`` with one vertex color and without texture coordinates."""
    plain = {name: values for name, values in shape.items() if name != "TEXCOORD_0"}
    return plain | {"COLOR_0": np.tile([*color, 1.0], (len(shape["POSITION"]), 1))}


def tree() -> Shape:
    """A conifer about 7 m high, its base at the origin."""
    bark = colored(tube(np.array([0.32, 0.2, 0.14]), np.array([-0.5, 1.5, 3.0]), 7), (0.20, 0.12, 0.07))
    crowns = [
        colored(tube(np.array([0.05, r, 0.02]), np.array([y - 0.05, y, top]), 9), (0.05, 0.15 + 0.02 * i, 0.06))
        for i, (r, y, top) in enumerate(((1.9, 1.6, 4.2), (1.5, 3.1, 5.6), (1.0, 4.6, 7.0)))
    ]
    return join([bark, *crowns])


def rock(seed: int) -> Shape:
    """A rock of about 1 m radius."""
    ball, rng = sphere(1.0, 8, 12), np.random.default_rng(seed)
    p = ball["POSITION"]
    lobes = rng.normal(size=(6, 3))
    bulge = 1 + 0.16 * np.sin(p @ lobes.T * 2.0).sum(axis=1)
    return colored(ball | {"POSITION": p * bulge[:, None] * [1.0, 0.75, 1.0]}, (0.33, 0.31, 0.28))


def hut() -> Shape:
    """A small house, 5 m by 4 m, its base at the origin."""
    walls = colored(box((-2.5, -0.6, -2.0), (2.5, 2.6, 2.0)), (0.42, 0.34, 0.24))
    door = colored(box((-0.5, 0, 2.0), (0.5, 2.0, 2.06)), (0.14, 0.08, 0.05))
    slope = [quad((-2.9, 2.3, s * 2.6), (s * 5.8, 0, 0), (0, 1.9, -s * 2.6)) for s in (1,)]
    slope.append(quad((2.9, 2.3, -2.6), (-5.8, 0, 0), (0, 1.9, 2.6)))
    gables = [colored(box((x, 2.5, -0.9), (x + 0.1, 3.5, 0.9)), (0.42, 0.34, 0.24)) for x in (-2.5, 2.4)]
    return join([walls, door, *gables, *(colored(s, (0.30, 0.11, 0.08)) for s in slope)])


def grass(seed: int) -> Shape:
    """Grass blades on a disk of 2.5 m radius, one triangle each."""
    rng = np.random.default_rng(seed)
    count = 90
    turn, out = rng.uniform(0, 2 * np.pi, count), 2.5 * np.sqrt(rng.uniform(0, 1, count))
    foot = np.stack([out * np.cos(turn), np.full(count, -0.1), out * np.sin(turn)], axis=-1)
    facing = rng.uniform(0, 2 * np.pi, count)
    wide = 0.05 * np.stack([np.cos(facing), np.zeros(count), np.sin(facing)], axis=-1)
    lean = rng.normal(0, 0.15, (count, 3)) * [1, 0, 1]
    tip = foot + lean + np.array([0, 1, 0]) * rng.uniform(0.35, 0.75, count)[:, None]
    p = np.stack([foot - wide, foot + wide, tip], axis=1)
    n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    return {
        "POSITION": p.reshape(-1, 3),
        "NORMAL": np.repeat(n, 3, axis=0),
        "COLOR_0": np.tile([[0.08, 0.16, 0.04, 1], [0.08, 0.16, 0.04, 1], [0.30, 0.36, 0.12, 1]], (count, 1)),
        "indices": np.arange(3 * count).reshape(-1, 3),
    }


def post() -> Shape:
    """A lantern post, 2.6 m high; the light hangs in front of it."""
    arm = box((-0.05, 2.4, -0.05), (0.05, 2.5, 0.7))
    return colored(join([box((-0.07, -0.4, -0.07), (0.07, 2.6, 0.07)), arm]), (0.10, 0.09, 0.08))


def scatter(rng: np.random.Generator, count: int, occupied: list[tuple[float, float, float]], radius: float,
            where: Callable[[Array, Array], Array]) -> list[tuple[float, float]]:  # fmt: skip
    """Random positions (x, z) with ``where(x, z)`` and away from ``occupied``, to which they are added."""
    out: list[tuple[float, float]] = []
    while len(out) < count:
        x, z = rng.uniform([-HALF_LENGTH + 6, -HALF_WIDTH + 6], [HALF_LENGTH - 6, HALF_WIDTH - 6])
        if bool(where(x, z)) and all(math.hypot(x - a, z - b) > radius + r for a, b, r in occupied):
            out.append((float(x), float(z)))
            occupied.append((float(x), float(z), radius))
    return out


def on_floor(x: Array, z: Array) -> Array:
    return (np.abs(z - middle(x)) < FLOOR_SIDE) & (np.abs(x) < FLOOR_END)


def build_valley(w: Writer, rng: np.random.Generator, keep_free: tuple[float, float], albedo: float) -> Array:
    """Ground, plants, rocks, huts and sun.  -> (K, 3) obstacles that a camera must avoid: x, z, radius.

    ``albedo``: factor on all colors.
    """
    color, bumps = (w.texture(pixels) for pixels in mottled())
    ground = w.material("ground", (albedo,) * 3, roughness=0.95, texture=color, normal=bumps)
    plain = w.material("plain", (albedo,) * 3, roughness=0.9)
    blades = w.material("grass", (albedo,) * 3, roughness=0.9, doubleSided=True)
    w.node("valley", mesh=w.mesh("valley", w.primitive(terrain(), ground)))
    occupied = [(*keep_free, 9.0)]
    kinds = (
        ("hut", [hut()], 9, 3.4, 9.0, on_floor, (1.0, 1.2), plain),
        ("tree", [tree()], 70, 1.0, 6.0, on_floor, (0.7, 1.3), plain),
        ("tree", [tree()], 170, 0.0, 2.5, lambda x, z: ~on_floor(x, z) & (height(x, z) < 34), (0.7, 1.5), plain),
        ("rock", [rock(1), rock(2), rock(3)], 60, 1.5, 4.0, on_floor, (0.5, 1.3), plain),
        ("grass", [grass(4), grass(5), grass(6)], 300, 0.0, -99.0, on_floor, (0.8, 1.2), blades),
    )
    obstacles = []
    for name, shapes, count, solid, spread, where, sizes, material in kinds:
        meshes = [w.mesh(name, w.primitive(shape, material)) for shape in shapes]
        for i, (x, z) in enumerate(scatter(rng, count, occupied if spread > 0 else [], spread, where)):
            size = float(rng.uniform(*sizes))
            w.node(
                f"{name} {i}",
                mesh=meshes[i % len(meshes)],
                translation=[x, float(height(x, z)), z],
                rotation=quat_about("y", float(rng.uniform(0, 360))).tolist(),
                scale=[size] * 3,
            )
            if solid:
                obstacles.append((x, z, solid * size + 0.4))
    sun = w.light(type="directional", name="sun", color=[1.0, 0.9, 0.72], intensity=52.0)
    # From the south (-z), 30 degrees high.
    w.node("sun", rotation=_product(quat_about("y", 196.0), quat_about("x", -30.0)).tolist(), extensions=sun)
    sky = w.light(type="directional", name="sky", color=[0.55, 0.72, 1.0], intensity=30.0)
    # The bright part of the sky, from the north, 35 degrees high: it lights the shadowed half.
    w.node("sky", rotation=_product(quat_about("y", 25.0), quat_about("x", -35.0)).tolist(), extensions=sky)
    return np.array(obstacles)


def glowing(w: Writer, name: str, color: tuple[float, float, float]) -> int:
    """A material that shows ``color`` and reflects nothing.

    A light hangs within centimeters of what has it: whatever that reflected would be noise of path-traced light.
    """
    return w.material(name, (0.0, 0.0, 0.0), metallic=1.0, emissiveFactor=list(color))


def add_lanterns(w: Writer, rng: np.random.Generator, count: int, obstacles: Array, albedo: float) -> None:
    """``count`` static point lights on posts along the path and at the huts; ``albedo`` of ``build_valley``."""
    metal = w.material("iron", (albedo,) * 3, roughness=0.6)
    glow = glowing(w, "lantern", (1.0, 0.65, 0.3))
    stand = w.mesh("post", w.primitive(post(), metal))
    flame = w.mesh("lantern", w.primitive(moved(sphere(0.11, 6, 10), (0, 2.36, 0.62)), glow))
    light = w.light(type="point", name="lantern", color=[1.0, 0.68, 0.36], intensity=27.0, range=14.0)
    occupied = [tuple(o) for o in obstacles.tolist()]
    for i, (x, z) in enumerate(scatter(rng, count, occupied, 3.0, on_floor)):
        turn = quat_about("y", float(rng.uniform(0, 360))).tolist()
        at = w.node(f"post {i}", mesh=stand, translation=[x, float(height(x, z)), z], rotation=turn)
        w.node("flame", at, mesh=flame)
        # Below the flame: inside it, the flame's mesh would shadow the light.
        w.node("lantern", at, translation=[0.0, 2.2, 0.62], extensions=light)


def _product(a: Array, b: Array) -> Array:
    """The rotation b followed by a; quaternions xyzw."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])
