"""The closed forms of the demos, and the sums and histograms of demo 12, against independent ones."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest

from taubench_gl import math3d
from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.conventions import DEFAULT_THRESHOLD
from taubench_gl.demos import theory
from taubench_gl.demos.lessons import half, jitter
from taubench_gl.demos.lessons.counting import compensated_sum, plain_sums, rounded_sum
from taubench_gl.demos.lessons.noise import expected_many_samples, expected_one_sample
from taubench_gl.metrics.counts import bin_of, edges
from taubench_gl.scene.builder import turn

SIZE = (480, 270)
YFOV = math.radians(55.0)


def test_a_static_camera_discards_only_the_outermost_half_pixel():
    share, _ = theory.frustum_share(np.eye(3), YFOV, SIZE)
    # The range of Eq. (3) ends at the outermost pixel centers, half a pixel inside the image.
    assert share == pytest.approx(100 * (1 - (1 - 1 / SIZE[0]) * (1 - 1 / SIZE[1])))


def test_a_yaw_of_100_degrees_discards_everything_and_a_roll_of_180_degrees_nothing():
    across, round_ = (math3d.mat3_from_quat(turn(a, d)) for a, d in (((0, 1, 0), 100.0), ((0, 0, 1), 180.0)))
    assert theory.frustum_share(across, YFOV, SIZE)[0] == 100.0
    assert theory.frustum_share(round_, YFOV, SIZE)[0] < 0.7


TURNS = [((1, 0, 0), 25.0), ((0, 1, 0), -25.0), ((0, 0, 1), 25.0), ((1, 2, 3), 17.0)]


@pytest.mark.parametrize(("axis", "degrees"), TURNS)
def test_frustum_share_equals_counted_rays(axis, degrees):
    rotation = math3d.mat3_from_quat(turn(axis, degrees))
    then = theory.pixel_rays(SIZE, YFOV) @ rotation.T
    x, y = (math.tan(0.5 * YFOV) * s for s in ((1 - 1 / SIZE[0]) * SIZE[0] / SIZE[1], 1 - 1 / SIZE[1]))
    at = np.abs(then[..., :2] / -then[..., 2:])
    inside = (then[..., 2] < 0) & (at[..., 0] <= x) & (at[..., 1] <= y)
    share, slack = theory.frustum_share(rotation, YFOV, SIZE)
    assert abs(100.0 * (1 - inside.mean()) - share) < min(slack, 0.2)


def test_form_factors():
    """Two unit squares a unit apart: 0.1998 (Howell, A Catalog of Radiation Heat Transfer Configuration Factors).

    Half of the sky: one half.
    """
    n = 40
    u = (np.arange(n) + 0.5) / n
    points = np.stack([*np.meshgrid(u, u), np.zeros((n, n))], axis=-1)
    square = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float)
    found = theory.form_factor(points, np.array([0.0, 0.0, 1.0]), square)
    assert found.mean() == pytest.approx(0.1998, abs=2e-4)
    far = np.array([[0, -1e6, 0], [0, 1e6, 0], [0, 1e6, 1e6], [0, -1e6, 1e6]], dtype=float)
    found = theory.form_factor(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), far)
    assert found == pytest.approx(0.5, abs=1e-5)


def test_hit_sphere():
    rays = np.array([[0, 0, -1.0], [0, 2, -1.0], [0, 0, 1.0]])
    assert theory.hit_sphere(np.zeros(3), rays, np.array([0, 0, -5.0]), 2.0).tolist() == [3.0, np.inf, np.inf]


def test_maxwell_tail_equals_sampled_vectors():
    lengths = np.linalg.norm(np.random.default_rng(1).normal(0.0, 0.3, (400_000, 3)), axis=1)
    for threshold in (0.1, 0.4, 0.9):
        assert theory.maxwell_tail(threshold, 0.3) == pytest.approx((lengths > threshold).mean(), abs=0.004)
    assert theory.maxwell_tail(0.0, 1.0) == 1.0


def test_discard_rate_of_random_light_samples():
    """One pixel, two lamps of 0 and 1: one sample gives 0 or 2, so two frames differ with probability 1/2."""
    per_lamp = np.zeros((2, 1, 1, 3))
    per_lamp[1] = 1.0 / math.sqrt(3.0)
    assert expected_one_sample(per_lamp) == 50.0
    assert expected_many_samples(per_lamp, 10_000) == pytest.approx(0.0, abs=1e-3)
    change = NormalDist(0.0, math.sqrt(2.0 / 4.0))  # difference of two means of four samples with sigma 1
    assert expected_many_samples(per_lamp, 4) == pytest.approx(200.0 * change.cdf(-DEFAULT_THRESHOLD))


def test_innermost_pixel_of_a_region():
    region = np.zeros((20, 30), dtype=bool)
    region[2:9, 3:20] = True
    region[12:14, 3:5] = True
    x, row = theory.innermost_pixel(region)
    assert row == 5 and 6 <= x <= 16
    with pytest.raises(ValueError):
        theory.innermost_pixel(np.zeros((3, 3), dtype=bool))


def test_ground_is_kept_where_no_row_changes():
    """One row: at y = 0.5 the ground is 193 m away; 0.1 m closer is the same row, 0.2 m is another distance."""
    assert not np.any(theory.ground_distance((1, 90), 1.6, 96.5, 0.0) > 1e-9)
    assert theory.ground_distance((1, 2), 1.0, 96.5, 0.1)[:, 0] == pytest.approx([0.0, 0.1])
    assert theory.ground_distance((1, 2), 1.0, 96.5, 0.2)[:, 0] == pytest.approx([0.0, 0.2])


def test_ground_distances_are_those_of_the_nearest_rows():
    """In the middle column the lateral part vanishes: the row nearest to eye focal / (z + step) shows its own z."""
    height, eye, focal, step = 400, 1.6, 300.0, 1.3
    column = theory.ground_distance((1, height), eye, focal, step)[:, 0]
    then = eye * focal / np.arange(0.5, height / 2) + step
    nearest = np.floor(eye * focal / then) + 0.5
    assert column[height // 2 :] == pytest.approx(np.abs(eye * focal / nearest - then))
    assert np.all(column[: height // 2] == 0.0)


@pytest.mark.parametrize("bits", [8, 11])
def test_share_of_other_pixels_by_precision(bits):
    """The law of demo 5 against rounding random motion of up to half a pixel of spacing."""
    rng = np.random.default_rng(bits)
    motion = rng.uniform(-100.0, 100.0, (200_000, 2)).astype(np.float32)
    moved = np.floor(half.in_half(motion, bits).astype(np.float64) + 0.5) != np.floor(motion.astype(np.float64) + 0.5)
    share = 100.0 * float(moved.any(axis=-1).mean())
    assert share == pytest.approx(half.law(motion, bits), abs=0.15)


def test_in_half_is_float16_at_11_bits():
    motion = np.random.default_rng(2).uniform(-300.0, 300.0, 1000).astype(np.float32)
    assert np.array_equal(half.in_half(motion, 11), motion.astype(np.float16).astype(np.float32))


def test_spread_of_a_still_edge_is_that_of_offsets_and_pixels():
    """Equal weights of one period: the variance of the offsets, and 1/12 of the rounding to pixels."""
    offsets = np.array([halton_jitter(i) for i in range(16)])
    u = offsets[:, 0] - jitter.SLOPE * offsets[:, 1]
    weights = np.array([(1 - 0.3) ** (15 - i) * (0.3 if i else 1.0) for i in range(16)])
    mean = -(weights @ u)
    found = jitter.predicted(lambda now, before: np.zeros(2), 0.3, 16)
    assert weights.sum() == pytest.approx(1.0)
    assert found.shift == pytest.approx(mean)
    assert found.sigma**2 == pytest.approx(weights @ u**2 + 1 / 12 - mean**2)


def test_bilinear_history_adds_the_variance_of_its_weights():
    """A constant error of half a pixel: 1/4 px^2 a frame, and half a pixel of shift."""
    found = jitter.predicted(lambda now, before: np.array([0.5, 0.0]), 1e-9, 9)
    start = jitter.predicted(lambda now, before: np.zeros(2), 1e-9, 1)
    assert found.sigma**2 == pytest.approx(start.sigma**2 + 8 * 0.25, rel=1e-6)
    assert found.shift == pytest.approx(start.shift - 8 * 0.5, rel=1e-6)


def test_plain_float32_sum_loses_counts_and_the_compensated_sum_does_not():
    rng = np.random.default_rng(3)
    counts = rng.integers(1, 2_000_001, size=4000)  # a run of 4000 pairs at 1920x1080
    exact = int(counts.sum())
    plain = abs(float(plain_sums(counts)[-1]) - exact) / exact
    assert plain > 2.0**-24 >= abs(compensated_sum(counts) - exact) / exact


def test_float32_counter_stops_at_2_to_the_24():
    counts = np.append([1 << 24], np.ones(2000, dtype=int))
    assert plain_sums(counts)[-1] == 1 << 24
    assert compensated_sum(counts) == (1 << 24) + 2000
    assert compensated_sum(np.array([], dtype=int)) == 0.0


@pytest.mark.parametrize("term", [1, 3, 13841, 129600, 2_073_600])
def test_rounded_integer_sum_equals_the_float32_sum(term):
    assert rounded_sum(term, 5000) == plain_sums(np.full(5000, term))[-1]


@pytest.mark.parametrize("bits", [0, 1])
def test_coarse_bins_are_sums_of_fine_bins(bits):
    distance = np.random.default_rng(5).lognormal(-2.0, 2.0, size=5000).astype(np.float32)
    coarse, fine = (np.bincount(bin_of(distance, b), minlength=len(edges(b)) + 1) for b in (bits, 3))
    inner = fine[1:-1].reshape(-1, 1 << (3 - bits)).sum(axis=1)
    assert np.array_equal(coarse, [fine[0], *inner, fine[-1]])
