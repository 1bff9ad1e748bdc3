"""Rays that leave rasterized surfaces: convex shapes never shade themselves, at any angle, scale and place; what lies
close above a surface shades it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frame_tools import looking_at, make_scene, quad, still_camera
from ray_tools import traced

from taubench_gl.frame.raytracing.texels import FAR_SLACK, HALF_GRID
from taubench_gl.scene.builder import sphere
from taubench_gl.scene.model import Camera, Channel

Array = np.ndarray
BALL = replace(sphere(1.0, 12), normals=None)
"""Convex."""


def surface(t, size: int) -> tuple[Array, Array]:
    """Position and geometric normal of the pixels that show something, (N, 3) each.

    Not those at a silhouette whose triangle is drawn although it faces away, because corners snap to 1/256 pixel.
    """
    p, n = (t.renderer.read(name)[..., :3].reshape(-1, 3) for name in ("position", "geometric_normal"))
    seen = np.sum(p * n, axis=1) < 0.0
    assert seen.sum() > size
    return p[seen], n[seen]


def grazing(n: Array, seed: int) -> Array:
    """Directions from 0.1 to 90 degrees above the surfaces with normals ``n``, which are stored with 16 bits."""
    rng = np.random.default_rng(seed)
    tangent = np.cross(n, rng.normal(size=n.shape))
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    angle = np.radians(10.0 ** rng.uniform(-1, np.log10(90), len(n)))[:, None]
    return np.cos(angle) * tangent + np.sin(angle) * n


@pytest.mark.parametrize("moving", [False, True], ids=["merged", "instance"])
@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_convex_shapes_never_shade_themselves(gpu, scale, offset, moving):
    center = np.full(3, offset)
    matrix = np.diag([-scale, 0.7 * scale, scale, 1.0])
    scene = make_scene(BALL, matrices=[matrix], origin=tuple(center))
    if moving:
        keys = np.stack([center, center + scale])
        scene = replace(scene, channels=(Channel("node", 0, "translation", "LINEAR", np.array([0.0, 1.0]), keys),))
    eye = np.array([1.4, 0.6, 1.2]) * scale
    camera = still_camera(Camera(znear=0.01 * scale), center + eye, looking_at(eye, np.zeros(3)))
    with traced(gpu, scene, camera, size=(96, 96)) as t:
        p, n = surface(t, 2000)
        for seed in range(8):
            hits = t.query(p, grazing(n, seed), normals=n, any_hit=True)
            assert not (hits.draw >= 0).any()


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_wide_terrain_does_not_shade_itself(gpu, tilt):
    """20 km of terrain, whose corners float32 moves by a millimeter, below a ball of 2 m that needs finer offsets."""
    side = 1e4
    plane = quad((-side, -tilt * side - 3, -side), (0, 0, 2 * side), (2 * side, 2 * tilt * side, 0))
    eye = np.array([1.0, 0.7, 5.0])
    camera = still_camera(Camera(znear=0.01), eye, looking_at(eye, np.array([0.5, -1.5, 0.0])))
    with traced(gpu, make_scene(BALL, plane), camera, size=(96, 96)) as t:
        assert len(t.structure.table.merged) == 2
        p, n = surface(t, 4000)
        terrain = t.query(p + 0.1 * n, -n).draw == 1
        assert 1000 < terrain.sum() < len(p) - 500
        for seed in range(4):
            hits = t.query(p, grazing(n, seed), normals=n)
            assert not ((hits.draw == 1) & terrain).any()  # a plane
            assert not ((hits.draw == 0) & ~terrain).any()  # convex


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_far_wall_is_missed_within_the_rounding_of_its_coordinates(gpu, axis, side):
    """A hall of 20 km around a ball.  Rays that begin just behind one wall cross the hall; farther behind, they hit."""
    half, walls = 1e4, []
    for k in range(3):
        for sign in (-1.0, 1.0):
            corner, u, v = np.full(3, -half), np.zeros(3), np.zeros(3)
            corner[k], u[(k + 1) % 3], v[(k + 2) % 3] = sign * half, 2 * half, 2 * half
            walls.append(quad(corner, u, v))
    wall, opposite = (1 + 2 * axis + int(sign > 0.0) for sign in (side, -side))
    slack = FAR_SLACK * half / HALF_GRID
    p = np.random.default_rng(2).uniform(-0.5, 0.5, (200, 3)) * half
    d = np.zeros_like(p)
    d[:, axis] = -side
    with traced(gpu, make_scene(BALL, *walls)) as t:
        for behind, first in ((0.6 * slack, opposite), (2.0 * slack, wall)):
            p[:, axis] = side * (half + behind)
            assert (t.query(p, d).draw == first).all()
