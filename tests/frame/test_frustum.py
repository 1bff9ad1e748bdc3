"""Eq. (3): a camera rotated about its axis inside a closed room loses pixels that geometry alone decides.

The answer is a float64 count over the pixel grid, which does not use the package.
"""

from __future__ import annotations

import numpy as np
import pytest
from frame_tools import FormulaCamera, draw_pair, find_scene, looking_at, make_scene, room, rotation_about
from repeated import few

from taubench_gl.metrics.counts import counts_of
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera

SIZE = (1920, 1080)
GUARD = 1 / 256
AXIS = {"yaw": "y", "pitch": "x", "roll": "z"}


def grid(size, yfov: float, prev_from_now: np.ndarray) -> float:
    """Percentage of pixel centers whose ray misses the previous pixel-center rectangle, float64."""
    w, h = size
    ty = np.tan(yfov / 2)
    scale = 2 * ty / h  # square pixels
    x, y = np.meshgrid(np.arange(w) - (w - 1) / 2, (h - 1) / 2 - np.arange(h))
    rays = np.stack([x * scale, y * scale, -np.ones_like(x)], axis=-1) @ prev_from_now.T
    ahead = rays[..., 2] < 0
    with np.errstate(divide="ignore", invalid="ignore"):
        at = rays[..., :2] / -rays[..., 2:] / scale
    inside = ahead & (np.abs(at[..., 0]) <= (w - 1) / 2 + GUARD) & (np.abs(at[..., 1]) <= (h - 1) / 2 + GUARD)
    return 100.0 * (1 - inside.mean())


def turning(yfov: float, axis: str, degrees: float, base: np.ndarray, position=(0.3, -0.2, 0.1)):
    """At t = 0 as ``base``; at t = 1 turned by ``degrees`` about its own axis."""
    step = rotation_about(AXIS[axis], degrees)
    camera = Camera(yfov=yfov, znear=0.01, zfar=100.0)
    return FormulaCamera(camera, lambda t: (position, base @ step if t >= 1 else base)), step


def measured(gpu, scene, camera, size) -> float:
    result = draw_pair(gpu, scene, camera, size, (0.0, 1.0), read=False)
    counts = counts_of(result.counts.mask_histogram)
    assert counts["invalid"] == 0
    assert counts["frustum"] + counts["comparable"] == size[0] * size[1]
    return 100.0 * counts["frustum"] / counts["pixels"]


@pytest.mark.parametrize("yfov", [35.0, 50.0, 80.0])
@pytest.mark.parametrize("axis", ["yaw", "pitch", "roll"])
@pytest.mark.parametrize("degrees", few([-7.3, 25.0, 0.4]))
def test_closed_room(gpu, yfov: float, axis: str, degrees: float) -> None:
    camera, step = turning(np.radians(yfov), axis, degrees, rotation_about("y", 20) @ rotation_about("x", 10))
    got = measured(gpu, make_scene(room()), camera, SIZE)
    # Pixel for pixel; what is left is rounding within the float32 of a boundary ray.
    assert got == pytest.approx(grid(SIZE, np.radians(yfov), step), abs=0.002)


@pytest.mark.parametrize("axis", few(["yaw", "pitch", "roll"]))
def test_sponza_as_in_figure_1(gpu, data, axis: str) -> None:
    """Figure 1 of the paper: 25 degrees in Sponza.  The sky takes part, so whether the roof is open does not matter."""
    eye = (4.0, 2.0, 0.3)
    camera, step = turning(np.radians(50.0), axis, 25.0, looking_at(eye, (-6.0, 2.5, -0.2)), position=eye)
    got = measured(gpu, load_scene(find_scene(data, "Sponza.gltf")), camera, SIZE)
    assert got == pytest.approx(grid(SIZE, np.radians(50.0), step), abs=0.002)
