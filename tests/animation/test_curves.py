"""One channel at one time: closed forms, SciPy, and inputs where the textbook formula fails."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_scenes import make_channel
from scipy.interpolate import CubicHermiteSpline

from taubench_gl import math3d
from taubench_gl.animation import curves
from taubench_gl.conventions import DEFAULT_FPS, KEY_TOLERANCE

unit = st.floats(0.0, 1.0)
components = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 1e-3)


def quat(*q):
    return math3d.normalize(np.array(q, dtype=np.float64))


def about_y(degrees):
    return math3d.quat_from_axis_angle(np.array([0.0, 1.0, 0.0]), np.radians(degrees))


# --- clamping and the three interpolations -------------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", ["STEP", "LINEAR", "CUBICSPLINE"])
def test_values_at_and_outside_the_keys(interpolation):
    times, keys = [0.5, 1.0, 3.0], np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [-7.0, 8.0, 0.1]])
    values = np.stack([keys + 100, keys, keys - 100], axis=1) if interpolation == "CUBICSPLINE" else keys
    channel = make_channel(0, "translation", times, values, interpolation)
    for t, expected in [(-1, 0), (0.5, 0), (1.0, 1), (3.0, 2), (99, 2), (np.inf, 2), (-np.inf, 0)]:
        assert np.array_equal(curves.sample_channel(channel, t), keys[expected])


@pytest.mark.parametrize("interpolation", ["STEP", "LINEAR", "CUBICSPLINE"])
@pytest.mark.parametrize("path", ["translation", "rotation"])
def test_single_key_is_constant(interpolation, path):
    key = quat(1, 2, 3, 4) if path == "rotation" else np.array([1.0, 2.0, 3.0])
    values = np.stack([key * 9, key, key * 9])[None] if interpolation == "CUBICSPLINE" else key[None]
    channel = make_channel(0, path, [2.0], values, interpolation)
    for t in (-1.0, 2.0, 5.0):
        assert np.allclose(curves.sample_channel(channel, t), key, rtol=0, atol=1e-16)


@settings(deadline=None)
@given(
    st.lists(st.floats(0.01, 5.0), min_size=1, max_size=6),
    st.integers(0, 2**32 - 1),
    st.lists(unit, min_size=1, max_size=8),
)
def test_cubicspline_against_scipy(steps, seed, places):
    times = np.concatenate([[0.0], np.cumsum(steps)])
    values = np.random.default_rng(seed).normal(size=(len(times), 3, 3))
    channel = make_channel(0, "translation", times, values, "CUBICSPLINE")
    for place in places:
        t = place * times[-1]
        nearest = times[np.argmin(np.abs(times - t))]
        t = nearest if abs(t - nearest) < KEY_TOLERANCE / DEFAULT_FPS else t
        i = min(int(np.searchsorted(times, t, side="right")) - 1, len(times) - 2)
        # glTF has separate in- and out-tangents, so SciPy evaluates one segment at a time.
        expected = CubicHermiteSpline(times[i : i + 2], values[i : i + 2, 1], [values[i, 2], values[i + 1, 0]])
        assert np.allclose(curves.sample_channel(channel, t), expected(t), rtol=1e-10, atol=1e-10)


@settings(deadline=None)
@given(components, components, components, components, unit)
def test_cubicspline_rotations_have_unit_length(in1, a, b, out0, u):
    values = np.array([[a, a, out0], [in1, b, b]], dtype=float)
    q = curves.sample_channel(make_channel(0, "rotation", [0, 1], values, "CUBICSPLINE"), u)
    assert np.linalg.norm(q) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("dt", [5e-324, 1e-310, 1e-45, 1e-20])
@pytest.mark.parametrize("interpolation", ["STEP", "LINEAR", "CUBICSPLINE"])
@pytest.mark.parametrize("path", ["translation", "rotation"])
def test_denormal_time_steps_give_finite_values(dt, interpolation, path):
    n = 4 if path == "rotation" else 3
    keys = np.random.default_rng(1).normal(size=(3, n)).astype(np.float32).astype(float)
    keys[1] *= 3e38 if path == "translation" else 1.0
    values = np.stack([keys * 0 + 3e38, keys, keys * 0 - 3e38], axis=1) if interpolation == "CUBICSPLINE" else keys
    channel = make_channel(0, path, [0.0, dt, 1.0], values, interpolation)
    for t in (0.0, dt / 2, dt, np.nextafter(dt, 1), 0.5, 1.0):
        assert np.all(np.isfinite(curves.sample_channel(channel, t)))


# --- slerp ---------------------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(components, components, st.lists(unit, min_size=2, max_size=10))
def test_slerp_has_unit_length_and_constant_speed_along_the_shorter_arc(a, b, places):
    a, b = quat(*a), quat(*b)
    whole = math3d.quat_angle(a, b)  # not above 180 degrees: of the shorter arc
    assert np.array_equal(curves.slerp(a, b, 0.0), a)
    for u in [*places, 1.0]:
        q = curves.slerp(a, b, u)
        assert np.linalg.norm(q) == pytest.approx(1, abs=1e-14)
        assert math3d.quat_angle(a, q) == pytest.approx(u * whole, abs=1e-12)
        assert math3d.quat_angle(q, b) == pytest.approx((1 - u) * whole, abs=1e-12)


@pytest.mark.parametrize("degrees", [1e-3, 1e-5, 1e-7, 1e-9])
def test_slerp_of_tiny_turns(degrees):
    a, b = about_y(0), about_y(degrees)
    got = math3d.quat_angle(a, curves.slerp(a, b, 0.25))
    assert np.degrees(got) == pytest.approx(0.25 * degrees, rel=1e-6)  # an acos has no precision here


def test_zero_quaternion_is_no_rotation():
    channel = make_channel(0, "rotation", [0, 1], [[0, 0, 0, 0], about_y(90)])
    assert np.array_equal(curves.sample_channel(channel, 0.0), [0, 0, 0, 1])
    assert math3d.quat_angle(curves.sample_channel(channel, 0.5), about_y(45)) < 1e-14


@settings(deadline=None)
@given(st.lists(components, min_size=2, max_size=5), st.floats(-1, 6))
def test_rotation_keys_of_any_length(keys, t):
    keys = np.array(keys)
    lengths = np.linspace(0.2, 3, len(keys))[:, None]
    times = np.arange(len(keys))
    one = curves.sample_channel(make_channel(0, "rotation", times, keys), t)
    other = curves.sample_channel(make_channel(0, "rotation", times, keys * lengths), t)
    assert np.allclose(one, other, atol=1e-9)
