"""What must come out exactly: nothing for a still world, whole rows and columns for a shift by whole pixels."""

from __future__ import annotations

import numpy as np
import pytest
from frame_tools import (
    THRESHOLDS,
    FormulaCamera,
    draw_pair,
    find_scene,
    make_scene,
    picture,
    primitive,
    quad,
    rotation_about,
    still_camera,
)

from taubench_gl.animation import choose_camera
from taubench_gl.conventions import Reason
from taubench_gl.metrics.counts import counts_of
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera, Material, Sampler, Texture

MODES = [(r, s) for r in ("camera", "motion") for s in ("nearest", "bilinear")]
ZERO = dict.fromkeys(THRESHOLDS, 0.0)


def assert_still(result) -> None:
    """Not one pixel leaves, and with thresholds of 0 not one distance differs from 0."""
    counts = counts_of(result.counts.mask_histogram)
    assert counts["comparable"] == counts["pixels"] and counts["sky"] == counts["history_sky"]
    assert counts["reusable_surface"] == counts["reusable_shading"] == counts["pixels"] - counts["sky"]
    kinds = ("pixels", "comparable", "sky", "history_sky", "reusable_surface", "reusable_shading")
    assert {name: n for name, n in counts.items() if n and name not in kinds} == {}
    assert not result.counts.histograms[:, 1:].any()
    assert not result.motion.any()


def clutter(seed: int, count: int = 400):
    """Random triangles around the view axis, some near, some far: edges at every sub-pixel place, sky between."""
    rng = np.random.default_rng(seed)
    center = rng.uniform([-4, -3, -12], [4, 3, -1.5], (count, 1, 3))
    corners = center + rng.normal(0, 0.6, (count, 3, 3))
    return primitive(corners.reshape(-1, 3), np.arange(3 * count), material=0)


@pytest.mark.parametrize(("reprojection", "sampling"), MODES)
@pytest.mark.parametrize("offset", [(0, 0, 0), (1e6, -1e6, 1e6), (1234567.891, 0.1, -987654.321)])
def test_still_clutter_at_any_world_offset(gpu, reprojection: str, sampling: str, offset) -> None:
    scene = make_scene(clutter(1), materials=(Material(double_sided=True),), origin=offset)
    tilt = rotation_about("y", 13.7) @ rotation_about("x", -4.2) @ rotation_about("z", 31.3)
    for camera in (
        Camera(yfov=0.9, znear=0.1, zfar=1e4),
        Camera(yfov=0.9, znear=0.001),
        Camera(kind="orthographic", ymag=3.0, znear=0.0, zfar=50.0),
    ):
        track = still_camera(camera, np.add(offset, (0.1, 0.2, 0.3)), tilt)
        result = draw_pair(gpu, scene, track, (333, 187), (0.0, 1.0), reprojection=reprojection, sampling=sampling,
                           thresholds=ZERO)  # fmt: skip
        assert 0.05 < (result.mask & Reason.SKY > 0).mean() < 0.95  # both kinds of pixel take part
        assert_still(result)


@pytest.mark.parametrize(("reprojection", "sampling"), MODES)
@pytest.mark.parametrize("name", ["CesiumMan.glb", "AlphaBlendModeTest.glb", "MorphStressTest.glb", "Duck.glb"])
def test_still_real_scenes(gpu, data, name: str, reprojection: str, sampling: str) -> None:
    """Every frame is posed at the same time: skins and morphs stay unchanged, bit for bit."""
    scene = load_scene(find_scene(data, name))
    result = draw_pair(gpu, scene, choose_camera(scene), (320, 180), (0.7, 0.7), reprojection=reprojection,
                       sampling=sampling, thresholds=ZERO)  # fmt: skip
    assert_still(result)


def test_a_surface_cut_open_by_the_near_plane_stands_still(gpu) -> None:
    """Depth equals near there, up to rounding: no pixel may come out as BEHIND."""
    floor = quad((-50, -0.02, 50), (100, 0, 0), (0, 0, -100))
    for tilt in (0.0, 11.0, -33.3):
        track = still_camera(Camera(yfov=1.2, znear=0.1), rotation=rotation_about("z", tilt))
        assert_still(draw_pair(gpu, make_scene(floor), track, (200, 120), (0.0, 1.0), thresholds=ZERO))


def noise_wall(distance: float, half: float):
    """A wall across the view with a random texture, one color per texel, nearest filtering."""
    pixels = np.random.default_rng(3).integers(0, 256, (64, 64, 4))
    pixels[..., 3] = 255
    texture = Texture(0, Sampler(mag_filter=9728, min_filter=9728))
    # Off center by a little, so that no pixel center falls on the edge of a texel.
    wall = quad((-half + 0.0037, -half + 0.0041, -distance), (2 * half, 0, 0), (0, 2 * half, 0), material=0)
    return make_scene(wall, materials=(Material(base_color_texture=texture),), images=(picture(pixels),))


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("shift", [(1, 0), (-3, 0), (0, 2), (0, -5), (17, -9), (-160, 40)])
@pytest.mark.parametrize("sampling", ["nearest", "bilinear"])
def test_a_shift_by_whole_pixels_discards_its_rows_and_columns(gpu, kind: str, shift, sampling: str) -> None:
    w, h = 256, 144
    distance, half_height = 4.0, 2.0  # half the height of the view at the wall
    camera = Camera(kind=kind, ymag=half_height, yfov=2 * np.arctan(half_height / distance), znear=0.5, zfar=20.0)
    pixel = 2 * half_height / h
    right, up = shift  # the camera moves; the world goes the other way on screen

    def place(t):
        return np.array([right * pixel, up * pixel, 0.0]) * t, np.eye(3)

    scene = noise_wall(distance, 20.0)
    result = draw_pair(gpu, scene, FormulaCamera(camera, place), (w, h), (0.0, 1.0), sampling=sampling,
                       extra=("base_color",), thresholds=dict.fromkeys(THRESHOLDS, 1e-5))  # fmt: skip
    outside = np.zeros((h, w), dtype=bool)
    columns, rows = np.arange(w) + right, np.arange(h) - up  # row 0 is the top
    outside |= ((columns < 0) | (columns >= w))[None, :]
    outside |= ((rows < 0) | (rows >= h))[:, None]
    np.testing.assert_array_equal(result.mask, np.where(outside, Reason.OUTSIDE, 0))
    assert counts_of(result.counts.mask_histogram)["frustum"] == w * h - (w - abs(right)) * (h - abs(up))
    np.testing.assert_allclose(result.motion[..., 0], right, atol=2e-4)
    np.testing.assert_allclose(result.motion[..., 1], -up, atol=2e-4)
    # The texture went along: the color now is the color then at the place the motion points to.
    y, x = np.nonzero(~outside)
    now, then = result.current["base_color"][y, x], result.history["base_color"][y - up, x + right]
    assert (now == then).all()


def test_parallel_sky_shifts_with_the_camera(gpu) -> None:
    """A parallel projection's sky is a plane far away: it moves sideways as everything does."""
    scene = make_scene(quad((-1, -1, 50), (2, 0, 0), (0, 2, 0)))
    camera = Camera(kind="orthographic", ymag=4.5, znear=0.0, zfar=100.0)
    track = FormulaCamera(camera, lambda t: ((0.2 * t, 0, 0), np.eye(3)))  # two pixels of 0.1 m
    result = draw_pair(gpu, scene, track, (160, 90), (0.0, 1.0))
    assert counts_of(result.counts.mask_histogram)["outside"] == 2 * 90
    np.testing.assert_allclose(result.motion[..., 0], 2.0, atol=1e-4)
