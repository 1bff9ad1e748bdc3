"""Kochanek-Bartels keys against closed forms and a second implementation."""

from __future__ import annotations

import numpy as np
import pytest
from aff_files import rotation_spline, spline
from scipy.spatial.transform import Rotation

from taubench_gl.animation.curves import sample_channel
from taubench_gl.scene.aff.splines import ROTATION_ERROR, key_window, position_keys, rotation_keys, visible_keys
from taubench_gl.scene.model import Channel

NONE = np.zeros(3)


def channel(path: str, keys) -> Channel:
    return Channel("node", 0, path, "CUBICSPLINE", *keys)


EXACT = 1e9
"""A rate at which no time moves to a key."""


def rotation_at(curve: Channel, t: float) -> Rotation:
    return Rotation.from_quat(sample_channel(curve, t, EXACT))


@pytest.mark.parametrize("seed", range(6))
def test_positions(seed):
    """Exact for every tension, continuity, bias and uneven keys."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 12))
    times = np.cumsum(rng.uniform(0.05, 2.0, count)) - 1.0
    values, tcb = rng.normal(size=(count, 3)) * 10, rng.uniform(-1, 1, (count, 3))
    window = key_window(times)
    curve = channel("translation", position_keys(times, values, tcb, window))
    assert len(curve.times) == count - 2, "one key for each key"
    for t in np.linspace(times[0] - 1, times[-1] + 1, 200):
        got = sample_channel(curve, t - window[0], EXACT)
        np.testing.assert_allclose(got, spline(times, values, tcb, t), atol=1e-11)


def test_window_clips_exactly():
    times, rng = np.arange(8.0), np.random.default_rng(1)
    values, tcb = rng.normal(size=(8, 3)), rng.uniform(-0.9, 0.9, (8, 3))
    curve = channel("translation", position_keys(times, values, tcb, (2.25, 4.5)))
    assert curve.times[0] == 0.0 and curve.times[-1] == 2.25
    for t in np.linspace(2.25, 4.5, 50):
        np.testing.assert_allclose(sample_channel(curve, t - 2.25, EXACT), spline(times, values, tcb, t), atol=1e-12)


@pytest.mark.parametrize(("low", "high", "value"), [(-9.0, -5.0, 1.0), (20.0, 30.0, 6.0), (5.0, 5.0, 5.0)])
def test_window_outside_the_keys_is_constant(low, high, value):
    values = np.repeat(np.arange(8.0)[:, None], 3, axis=1)
    times, keys = position_keys(np.arange(8.0), values, np.zeros((8, 3)), (low, high))
    assert times[0] == 0.0
    np.testing.assert_array_equal(keys[0, 1], np.full(3, value))


@pytest.mark.parametrize("last", [180.0, 270.0, 359.0, 720.0, -1000.0, 3600.0])
def test_rotation_about_one_axis_is_the_spline_of_the_angle(last):
    """Half turns, whole turns and more: by the full difference, not the shorter arc; the axis has any length."""
    times, tcb = np.array([-1.0, 0.0, 1.0, 2.5, 3.0]), np.zeros((5, 3))
    tcb[2] = 0.3, -0.2, 0.1
    degrees = np.array([0.0, 0.0, last, last / 2, last])
    axes = np.tile([0.0, 3.0, 4.0], (5, 1))
    curve = channel("rotation", rotation_keys(times, axes, degrees, tcb, (0.0, 2.5)))
    for t in np.linspace(0.0, 2.5, 301):
        angle = spline(times, np.radians(degrees)[:, None], tcb, t)[0]
        error = (Rotation.from_rotvec(angle * np.array([0, 0.6, 0.8])).inv() * rotation_at(curve, t)).magnitude()
        assert error <= 2 * ROTATION_ERROR


@pytest.mark.parametrize("seed", range(5))
def test_rotations_about_any_axes(seed):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.2, 1.5, 8))
    tcb = rng.uniform(-0.8, 0.8, (8, 3))
    turn = [Rotation.random(random_state=seed)]
    for _ in range(7):
        turn.append(turn[-1] * Rotation.from_rotvec(rng.normal(size=3) * 0.7))
    vectors = Rotation.concatenate(turn).as_rotvec()
    degrees = np.degrees(np.linalg.norm(vectors, axis=1))
    axes = vectors * rng.uniform(0.1, 9.0, (8, 1))
    window = key_window(times)
    curve = channel("rotation", rotation_keys(times, axes, degrees, tcb, window))
    for t in np.linspace(*window, 300):
        expected = rotation_spline(times, Rotation.concatenate(turn), tcb, t)
        assert (expected.inv() * rotation_at(curve, t - window[0])).magnitude() <= 2 * ROTATION_ERROR
    assert np.all(np.diff(curve.times) > 0)


def test_reversed_axis_takes_the_shorter_arc():
    """170 degrees about +Y, then 170 about -Y: a rotation by 20 degrees."""
    axes = np.array([[0, 1, 0], [0, 1, 0], [0, -1, 0], [0, -1, 0]], dtype=float)
    curve = channel("rotation", rotation_keys(np.arange(4.0), axes, np.full(4, 170.0), np.zeros((4, 3)), (1.0, 2.0)))
    half = Rotation.from_euler("y", 180, degrees=True)
    assert (half.inv() * rotation_at(curve, 0.5)).magnitude() < 1e-9


@pytest.mark.parametrize("kind", ["translation", "rotation"])
def test_constant_keys_are_constant_bit_for_bit(kind):
    times = np.array([0.0, 1.0, 1.7, 2.9, 4.0, 5.0])
    axes, degrees = np.tile([0.2, -0.9, 0.3], (6, 1)), np.full(6, -128.0)
    tcb = np.zeros((6, 3))
    if kind == "translation":
        curve = channel(kind, position_keys(times, axes, tcb, (1.0, 4.0)))
    else:
        curve = channel(kind, rotation_keys(times, axes, degrees, tcb, (1.0, 4.0)))
    samples = np.array([sample_channel(curve, t) for t in np.linspace(0, 3, 100)])
    np.testing.assert_array_equal(samples, np.broadcast_to(samples[0], samples.shape))


def test_equal_key_times_are_a_jump():
    """0 1 | 1 2: the segment of length 0 is never evaluated."""
    times = np.array([-1.0, 0.0, 1.0, 1.0, 2.0, 3.0])
    values = np.array([0.0, 0, 1, 5, 6, 6])[:, None] * np.ones(3)
    tcb = np.zeros((6, 3))
    tcb[:, 0] = 1.0  # full tension: zero tangents
    curve = channel("translation", position_keys(times, values, tcb, (0.0, 2.0)))
    assert curve.times.tolist() == [0.0, 1.0, 1.0, 2.0]
    assert sample_channel(curve, 1.0 - 1e-3)[0] == pytest.approx(1.0, abs=1e-5)
    assert sample_channel(curve, 1.0)[0] == sample_channel(curve, 1.0 - 1e-6)[0] == 5.0
    assert sample_channel(curve, 1.5)[0] == pytest.approx(5.5)


def test_decreasing_key_times_as_in_bart():
    """The first segment that ends after t is evaluated: 1..2, then 1.5..3 from t = 2."""
    times = np.array([0.0, 1.0, 2.0, 1.5, 3.0, 4.0])
    values = np.array([0.0, 0, 10, 20, 30, 30])[:, None] * np.ones(3)
    tcb = np.zeros((6, 3))
    tcb[:, 0] = 1.0
    curve = channel("translation", position_keys(times, values, tcb, (1.0, 3.0)))

    def ease(s: float) -> float:
        return 3 * s * s - 2 * s**3

    for t in np.linspace(1.0, 3.0, 81):
        expected = 10 * ease(t - 1) if t < 2 else 20 + 10 * ease((t - 1.5) / 1.5)
        assert sample_channel(curve, t - 1.0)[0] == pytest.approx(expected, abs=1e-9), t


def test_value_without_segments_is_a_key():
    values = np.arange(4.0)[:, None] * np.ones(3)
    times, keys = position_keys(np.ones(4), values, np.zeros((4, 3)), (0.0, 2.0))
    assert len(times) == 1 and keys[0, 1, 0] == 2.0


def test_visible_until_the_first_key():
    times, values = visible_keys(np.array([1.0, 2.0, 1.5, 9.0]), np.array([0.0, 1, 0, 1]), (0.5, 5.0))
    np.testing.assert_array_equal(times, [0.0, 0.5, 1.5])
    np.testing.assert_array_equal(values[:, 0], [1.0, 0.0, 0.0])
