"""A made scene of hundreds of lights, for benches and tests of many lights."""

from __future__ import annotations

import dataclasses

import numpy as np

from taubench_gl import math3d
from taubench_gl.scene.builder import SceneBuilder, quad, turn_x
from taubench_gl.scene.model import Scene

Array = np.ndarray


def lamp_field(
    static: int = 73, moving: int = 617, *, reach: float = np.inf, intensity: float = 0.5, cells: int = 48
) -> Scene:
    """A hilly ground of 40 x 40 m below point lights, and a moving camera; one second long, deterministic.

    The defaults are the numbers of point lights of the paper's scene with most lights.  ``reach``: range of
    every light, meters; ``intensity``: candela.  Lights are 0.3 to 1.5 m above the ground; the moving ones move by up
    to half a meter per axis.
    """
    b = SceneBuilder()
    ground = quad(20.0, 20.0, cells=(cells, cells), material=b.material(metallic=0.0, roughness=0.8))

    def height(x: Array, z: Array) -> Array:
        return 0.8 * np.sin(0.45 * x) * np.cos(0.35 * z)

    x, z = ground.positions[:, 0].astype(np.float64), -ground.positions[:, 1].astype(np.float64)
    slope_x, slope_z = 0.36 * np.cos(0.45 * x) * np.cos(0.35 * z), -0.28 * np.sin(0.45 * x) * np.sin(0.35 * z)
    normals = math3d.normalize(np.stack([-slope_x, np.ones_like(x), -slope_z], axis=-1))
    positions = np.stack([x, height(x, z), z], axis=-1)
    b.node(mesh=b.mesh(dataclasses.replace(
        ground, positions=positions.astype(np.float32), normals=normals.astype(np.float32)
    )))  # fmt: skip
    rng = np.random.default_rng(690)
    for i in range(static + moving):
        at = rng.uniform(-19.0, 19.0, 2)
        position = np.array([at[0], height(*at) + rng.uniform(0.3, 1.5), at[1]])
        color = 0.3 + 0.7 * rng.random(3)
        node = b.light(translation=position, color=tuple(color), intensity=intensity, range=reach)
        drift = rng.uniform(-0.5, 0.5, 3)
        if i >= static:
            b.animate(node, "translation", [0.0, 1.0], [position, position + drift])
    camera = b.camera(rotation=turn_x(-12.0), yfov=np.radians(60.0), znear=0.05)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 2.5, 16.0), (0.5, 2.5, 14.5)])
    return b.build()
