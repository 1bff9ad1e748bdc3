"""Four small diffuse scenes with moving lights, for the comparison of direct and indirect light with Cycles.

Every surface is Lambertian (KHR_materials_specular, factor 0), so that both renderers have the same BRDF.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from make_assets import LICENSE, add_tentacle, turn
from shapes import Shape, box, join, moved, quad, sphere

from taubench_gl.datasets.gltf_writer import Writer

SECONDS = 2.5


def times(count: int) -> np.ndarray:
    return np.linspace(0.0, SECONDS, count)


def matte(w: Writer, name: str, color: tuple[float, float, float]) -> int:
    material = w.material(name, color, roughness=1.0, doubleSided=True)
    extension = "KHR_materials_specular"
    w.gltf.materials[material].extensions = {extension: {"specularFactor": 0.0}}
    if extension not in w.gltf.extensionsUsed:
        w.gltf.extensionsUsed.append(extension)
    return material


def place(w: Writer, name: str, shape: Shape, material: int, **where) -> int:
    return w.node(name, mesh=w.mesh(name, w.primitive(shape, material)), **where)


def camera(w: Writer, path: np.ndarray, degrees: np.ndarray, tilt: float = 0.0) -> list[tuple]:
    """A camera that moves along ``path`` (K, 3) while turning by ``degrees`` (K,) about +Y, tilted by ``tilt``."""
    walker = w.node("walker")
    w.node("eye", walker, camera=w.camera("eye", math.radians(60), 0.05, 200.0), rotation=turn("x", tilt).tolist())
    t = times(len(path))
    return [(walker, "translation", t, path, "LINEAR"), (walker, "rotation", t, turn("y", degrees), "LINEAR")]


def orbit(radius: float, height: float, phase: float = 0.0, count: int = 21, center=(0.0, 0.0)) -> np.ndarray:
    a = 2 * math.pi * np.linspace(0, 1, count) + phase
    return np.stack([center[0] + radius * np.cos(a), np.full(count, height), center[1] + radius * np.sin(a)], axis=-1)


def room(w: Writer) -> list[tuple]:
    """A closed box with a red and a green wall, two blocks, and one light that circles below the ceiling."""
    white, red, green = (matte(w, n, c) for n, c in (("white", (0.73,) * 3), ("red", (0.6, 0.06, 0.05)),
                                                    ("green", (0.12, 0.45, 0.09))))  # fmt: skip
    place(w, "shell", box((-2, 0, -2), (2, 3, 2), inside=True, faces="yYzZ"), white)
    place(w, "left", box((-2, 0, -2), (2, 3, 2), inside=True, faces="x"), red)
    place(w, "right", box((-2, 0, -2), (2, 3, 2), inside=True, faces="X"), green)
    tall, low = turn("y", 18).tolist(), turn("y", -20).tolist()
    place(w, "tall", box((-0.4, 0, -0.4), (0.4, 1.6, 0.4)), white, translation=[-0.7, 0, -0.6], rotation=tall)
    place(w, "low", box((-0.4, 0, -0.4), (0.4, 0.8, 0.4)), white, translation=[0.7, 0, 0.2], rotation=low)
    lamp = w.node("lamp", extensions=w.light(type="point", name="lamp", intensity=3.0))
    eye = camera(w, np.array([[-0.4, 1.5, 1.8], [0.4, 1.4, 1.8]]), np.array([-4.0, 4.0]))
    return [(lamp, "translation", times(21), orbit(1.0, 2.4), "LINEAR"), *eye]


def yard(w: Writer) -> list[tuple]:
    """Ground and blocks under a setting sun, and a light that moves between the blocks."""
    earth, stone = matte(w, "earth", (0.35, 0.3, 0.25)), matte(w, "stone", (0.65, 0.62, 0.58))
    place(w, "ground", quad((-8, 0, 8), (16, 0, 0), (0, 0, -16)), earth)
    rng = np.random.default_rng(3)
    blocks = []
    for x in range(-2, 3):
        for z in range(-2, 3):
            size = rng.uniform([0.4, 0.5, 0.4], [0.9, 2.2, 0.9])
            blocks.append(moved(box((-size[0], 0, -size[2]), tuple(size)), (2.8 * x, 0, 2.8 * z)))
    place(w, "blocks", join(blocks), stone)
    sun = w.node("sun", extensions=w.light(type="directional", name="sun", color=[1.0, 0.93, 0.8], intensity=2.0))
    lamp = w.node("lamp", extensions=w.light(type="point", name="lamp", color=[0.6, 0.8, 1.0], intensity=4.0))
    down = np.array([turned(30.0, a) for a in (-35.0, -50.0)])
    eye = camera(w, np.array([[0.6, 2.6, 7.6], [1.8, 2.6, 7.0]]), np.array([0.0, 12.0]), -14.0)
    walk = np.array([[-4.2, 1.2, 1.4], [1.4, 1.2, 1.4], [1.4, 1.2, 4.2], [4.2, 1.2, 4.2]])
    return [(sun, "rotation", times(2), down, "LINEAR"), (lamp, "translation", times(4), walk, "LINEAR"), *eye]


def turned(about_y: float, about_x: float) -> np.ndarray:
    """Quaternion xyzw: first about local X, then about +Y."""
    y, x = turn("y", about_y), turn("x", about_x)
    vector = y[3] * x[:3] + x[3] * y[:3] + np.cross(y[:3], x[:3])
    return np.append(vector, y[3] * x[3] - y[:3] @ x[:3])


def stage(w: Writer) -> list[tuple]:
    """Two spots sweep over balls and columns on a stage with a back wall."""
    floor, wall, ball = (matte(w, n, c) for n, c in (("floor", (0.5, 0.45, 0.4)), ("wall", (0.6, 0.6, 0.65)),
                                                    ("ball", (0.8, 0.7, 0.3))))  # fmt: skip
    place(w, "floor", quad((-5, 0, 3), (10, 0, 0), (0, 0, -6)), floor)
    place(w, "back", quad((-5, 0, -3), (10, 0, 0), (0, 4, 0)), wall)
    for i, x in enumerate((-2.0, 0.0, 2.0)):
        place(w, f"ball {i}", sphere(0.6, 32, 48), ball, translation=[x, 0.6, -0.4 + 0.5 * (i % 2)])
    place(w, "columns", join([box((x, 0, -2), (x + 0.3, 3.2, -1.7)) for x in (-3.4, -1.2, 0.9, 3.1)]), wall)
    tracks = []
    for i, (x, color) in enumerate(((-3.0, [1.0, 0.6, 0.4]), (3.0, [0.5, 0.7, 1.0]))):
        cone = {"innerConeAngle": 0.30, "outerConeAngle": 0.32}
        light = w.light(type="spot", name=f"spot {i}", color=color, intensity=45.0, spot=cone)
        node = w.node(f"spot {i}", translation=[x, 4.0, 2.0], extensions=light)
        sweep = np.array([turned(a if i else -a, -52.0) for a in (5.0, 50.0, 15.0)])
        tracks.append((node, "rotation", times(3), sweep, "LINEAR"))
    eye = camera(w, np.array([[-0.6, 1.7, 5.6], [0.6, 1.7, 5.4]]), np.array([-3.0, 3.0]), -6.0)
    return [*tracks, *eye]


def figure(w: Writer) -> list[tuple]:
    """A skinned figure and four lights that circle it, on a floor with a low wall."""
    floor, skin = matte(w, "floor", (0.6, 0.6, 0.6)), matte(w, "skin", (0.55, 0.25, 0.6))
    place(w, "floor", quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), floor)
    place(w, "wall", box((-2.5, 0, -2.2), (2.5, 1.0, -1.9)), floor)
    tracks = add_tentacle(w, skin, (0.0, 0.0, 0.0))
    colors = ([1.0, 0.5, 0.4], [0.5, 1.0, 0.5], [0.4, 0.6, 1.0], [1.0, 1.0, 0.7])
    for i, color in enumerate(colors):
        node = w.node(f"lamp {i}", extensions=w.light(type="point", name=f"lamp {i}", color=color, intensity=1.6))
        path = orbit(1.2 + 0.4 * i, 1.2 + 0.4 * i, 0.5 * math.pi * i)
        tracks.append((node, "translation", times(21), path if i % 2 else path[::-1], "LINEAR"))
    return [*tracks, *camera(w, np.array([[-0.5, 1.5, 4.6], [0.5, 1.6, 4.4]]), np.array([-5.0, 5.0]), -4.0)]


SCENES = {"room": room, "yard": yard, "stage": stage, "figure": figure}


def make(folder: Path) -> dict[str, Path]:
    """Write every scene as ``folder/NAME.glb``."""
    out = {}
    for name, build in SCENES.items():
        writer = Writer(LICENSE, "taubench-gl tools/light_scenes.py")
        writer.animation("all", *build(writer))
        out[name] = folder / f"{name}.glb"
        writer.save(out[name])
    return out
