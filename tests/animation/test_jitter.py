"""Sub-pixel jitter: closed forms of the sequence and of its effect on a projection."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from taubench_gl.animation import View
from taubench_gl.animation.jitter import HALTON_PERIOD, grid_offsets, halton_jitter, radical_inverse
from taubench_gl.animation.pairs import reprojection
from taubench_gl.metrics.reprojection import reproject
from taubench_gl.scene.model import Camera

SIZE = (64, 36)
LENSES = [
    Camera(yfov=np.radians(50.0)),
    Camera(kind="orthographic", ymag=2.0, xmag=2.0, znear=0.1, zfar=50.0),
]


def pixels(view: View, points) -> np.ndarray:
    """Pixel-index coordinates, y up, of points relative to the camera."""
    clip = np.column_stack([points, np.ones(len(points))]) @ view.clip_from_relative(*SIZE).T
    return (clip[:, :2] / clip[:, 3:] + 1.0) * 0.5 * SIZE - 0.5


def test_halton_sequence():
    assert [Fraction(radical_inverse(i, 2)) for i in range(1, 6)] == [Fraction(n, 8) for n in (4, 2, 6, 1, 5)]
    thirds = [radical_inverse(i, 3) for i in range(1, 6)]
    assert thirds == pytest.approx([1 / 3, 2 / 3, 1 / 9, 4 / 9, 7 / 9], abs=1e-15)


def test_period_covers_the_pixel_evenly():
    offsets = np.array([halton_jitter(i) for i in range(HALTON_PERIOD)])
    assert offsets.min() >= -0.5 and offsets.max() < 0.5
    # 16 elements of base 2: one in each half, quarter and eighth (element 16 wraps into the first again).
    assert np.bincount(np.floor((offsets[:, 0] + 0.5) * 8).astype(int), minlength=8).tolist() == [2] * 8
    np.testing.assert_array_equal(halton_jitter(3), halton_jitter(3 + HALTON_PERIOD))


@pytest.mark.parametrize("samples", [1, 2, 4, 6, 7, 16])
def test_grid_offsets_are_distinct_and_centered(samples):
    offsets = grid_offsets(samples)
    assert len({tuple(o) for o in offsets}) == len(offsets) == samples
    assert np.abs(offsets).max() < 0.5 and np.abs(offsets.mean(axis=0)).max() < 1e-15


@pytest.mark.parametrize("lens", LENSES, ids=["perspective", "orthographic"])
def test_point_at_i_plus_jitter_is_drawn_at_i(lens):
    view = View(np.zeros(3), np.eye(3), lens)
    jittered = replace(view, jitter_px=np.array([0.375, -0.25]))
    points = np.array([[0.1, 0.2, -1.0], [-1.0, 0.4, -7.0], [0.5, -0.6, -20.0]])
    np.testing.assert_allclose(pixels(jittered, points), pixels(view, points) - [0.375, -0.25], atol=1e-10)
    assert jittered.centered().clip_from_view(*SIZE).tobytes() == view.clip_from_view(*SIZE).tobytes()


@pytest.mark.parametrize("lens", LENSES, ids=["perspective", "orthographic"])
def test_sky_rays_pass_through_the_samples(lens):
    view = View(np.zeros(3), np.eye(3), lens, np.array([0.375, -0.25]))
    pair = reprojection(view, view, *SIZE)
    x, y = 11, 23
    ray = pair.sky_origin + x * pair.sky_dx + y * pair.sky_dy
    np.testing.assert_allclose(pixels(view, ray[None, :3] * [1, 1, 1]), [[x, y]], atol=1e-9)


@pytest.mark.parametrize("lens", LENSES, ids=["perspective", "orthographic"])
def test_motion_without_jitter_is_zero_for_a_still_image(lens):
    now = View(np.zeros(3), np.eye(3), lens, np.array([0.375, -0.25]))
    then = replace(now, jitter_px=np.array([-0.125, 0.4375]))
    position = np.zeros((SIZE[1], SIZE[0], 4))
    position[:, :20] = 0.5, -0.25, -3.0, 3.0
    still = reproject(reprojection(now, then, *SIZE, jitter=False), position)
    assert not still.motion_px.any()
    seen = reproject(reprojection(now, then, *SIZE), position)
    expected = np.broadcast_to((now.jitter_px - then.jitter_px) * [1, -1], seen.motion_px.shape)
    np.testing.assert_allclose(seen.motion_px, expected, atol=1e-9)
