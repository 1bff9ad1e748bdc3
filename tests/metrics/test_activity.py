"""Eqs. (1) and (2): SciPy's Euler angles away from the poles, closed forms at the poles, and tiny motion."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taubench_gl.metrics.activity import camera_activity, describe, summarize, translation, wrap_degrees


def rotations(yaw, pitch=0.0, roll=0.0):
    """Intrinsic Y-X-Z by SciPy, degrees; broadcasts.  -> (N, 3, 3)."""
    angles = np.stack(np.broadcast_arrays(*np.atleast_1d(yaw, pitch, roll)), axis=-1).astype(float)
    return Rotation.from_euler("YXZ", angles, degrees=True).as_matrix()


def activity(yaw, pitch=0.0, roll=0.0):
    r = rotations(yaw, pitch, roll)
    return camera_activity(np.zeros((len(r), 3)), r)


# --- Eq. (1) -------------------------------------------------------------------------------------------------------


def test_translation_is_the_euclidean_distance():
    assert translation([[0, 0, 0], [3, 4, 0], [3, 4, 0], [3, 4, -2]]).tolist() == [5, 0, 2]
    assert translation([[0, 0, 0], [3e-170, 4e-170, 0]])[0] == pytest.approx(5e-170)  # squares underflow
    assert translation([[0, 0, 0], [3e200, 4e200, 0]])[0] == pytest.approx(5e200)


# --- wrapping ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("difference", "expected"),
    [(1 - 359, 2), (359 - 1, -2), (180, 180), (-180, 180), (180.5, -179.5), (-180.5, 179.5), (540, 180), (-540, 180),
     (360, 0), (0, 0), (1e-12, 1e-12), (-1e-300, -1e-300)],
)  # fmt: skip
def test_wrap(difference, expected):
    assert wrap_degrees(difference) == expected


# --- Eq. (2) -------------------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_angle_differences_against_scipy(seed):
    r = Rotation.from_quat(np.random.default_rng(seed).normal(size=(20, 4)))
    a = camera_activity(np.zeros((20, 3)), r.as_matrix())
    degrees = r.as_euler("YXZ", degrees=True)
    expected = np.abs((np.diff(degrees, axis=0) + 180) % 360 - 180)
    ours = np.stack([a.yaw, a.pitch, a.roll], axis=-1)
    assert np.allclose(ours[~a.gimbal], expected[~a.gimbal], atol=1e-6)
    assert np.allclose(a.angle, np.degrees((r[:-1].inv() * r[1:]).magnitude()), atol=1e-6)


def test_yaw_of_a_tilted_camera_is_about_world_up():
    a = activity([20, 50], pitch=60, roll=15)
    assert np.allclose([a.yaw, a.pitch, a.roll], [[30], [0], [0]], atol=1e-12)


@pytest.mark.parametrize("degrees", [10.0, -3.0, 1e-3, 1e-5, 1e-8])
@pytest.mark.parametrize("axis", ["yaw", "pitch", "roll"])
def test_one_axis_turns_alone_also_by_tiny_steps(degrees, axis):
    steps = 30.0 + degrees * np.arange(5)
    # Exact reference: differences of the float64 angles of the matrices.
    a, exact = activity(**{"yaw": 20.0, "pitch": 10.0, axis: steps}), np.abs(np.diff(steps))
    for name in ("yaw", "pitch", "roll"):
        assert np.allclose(getattr(a, name), exact if name == axis else 0, rtol=0, atol=1e-13)
    assert np.allclose(a.angle, exact, rtol=0, atol=1e-13)


def test_geodesic_angle_where_acos_has_no_precision():
    tiny = np.degrees(1e-9)
    assert activity([0.0, tiny]).angle[0] == pytest.approx(tiny, rel=1e-6)


def test_still_camera_has_exactly_zero_activity():
    for r in Rotation.from_quat(np.random.default_rng(1).normal(size=(50, 4))).as_matrix():
        for still in (r, rotations(30, 90, 20)[0], rotations(30, -89.7, 20)[0]):
            a = camera_activity(np.full((4, 3), 1e7 / 3), np.tile(still, (4, 1, 1)))
            for name in ("position", "yaw", "pitch", "roll", "angle"):
                assert np.all(getattr(a, name) == 0.0)


# --- poles ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0.3, 0.5, 1.0, 3.0, 7.0, 15.0])
@pytest.mark.parametrize("roll", [0.0, 25.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_pitch_through_90_degrees_without_jumps(step, roll, sign):
    pitch = sign * (90 + step * (np.arange(-12, 12) + 0.4))
    a = activity(40.0, pitch, roll)
    assert np.allclose(a.pitch, step, atol=0.05)
    assert np.all(a.yaw < 0.6) and np.all(a.roll < 0.6)
    assert np.any(a.gimbal) and not a.gimbal[0] and not a.gimbal[-1]


def test_pitch_through_exactly_90():
    a = activity(40.0, [80, 85, 90, 95, 100])
    assert np.allclose(a.pitch, 5, atol=1e-6) and np.allclose(a.yaw, 0, atol=1e-6) and np.allclose(a.roll, 0, atol=1e-6)
    assert a.gimbal.tolist() == [False, True, True, False]


def test_turn_while_looking_straight_down_is_yaw():
    a = activity([0, 10, 30, 60], -90.0)
    assert np.allclose(a.yaw, [10, 20, 30]) and np.allclose(a.roll, 0) and np.allclose(a.pitch, 0, atol=1e-6)
    assert a.gimbal.all()


@settings(deadline=None)
@given(st.floats(0.1, 179.0), st.floats(-85, 85), st.floats(-85, 85))
def test_motion_away_from_the_poles_is_not_flagged(yaw, first, second):
    assert not activity([0.0, yaw / 2], [first, second]).gimbal.any()


def test_wide_turn_near_the_pole_is_not_flagged():
    # 180 degrees of yaw at pitch 60 is also a turn by 60 degrees over the pole: the path is ambiguous.
    a = activity([0, 180], 60.0)
    assert a.yaw[0] == pytest.approx(180) and not a.gimbal[0]


# --- statistics ----------------------------------------------------------------------------------------------------


def test_describe_uses_the_population_variance():
    assert describe([1.0, 2.0, 3.0, 10.0]) == {
        "mean": 4.0, "variance": 12.5, "max": 10.0, "median": 2.5, "p95": pytest.approx(8.95)
    }  # fmt: skip


def test_describe_of_a_small_variance_around_a_large_mean():
    assert describe(1e9 + np.array([-1.0, 1.0] * 500))["variance"] == 1.0


def test_summary_block():
    r = rotations([0, 10, 30, 30])
    a = camera_activity([[0, 0, 0], [1, 0, 0], [9, 0, 0], [9, 0, 0]], r)
    block = summarize(a, np.array([False, True, False]), fps=60, first_frame=100)
    assert list(block) == ["position", "yaw", "pitch", "roll", "angle", "fps", "samples", "cuts", "gimbal_pairs"]
    assert (block["fps"], block["samples"], block["cuts"], block["gimbal_pairs"]) == (60.0, 3, [102], [])
    assert block["position"]["mean"] == 3.0 and block["position"]["max"] == 8.0
    assert block["position"]["without_cuts"]["mean"] == 0.5
    assert list(block["yaw"]) == ["mean", "variance", "max", "median", "p95", "without_cuts"]
    assert block["yaw"]["without_cuts"]["max"] == pytest.approx(10)
    json.dumps(block, allow_nan=False)
    assert summarize(a, None, 24)["cuts"] == []


@pytest.mark.parametrize("frames", [0, 1])
def test_statistics_without_pairs_are_null(frames):
    block = summarize(camera_activity(np.zeros((frames, 3)), np.tile(np.eye(3), (frames, 1, 1))), None, 24)
    assert block["samples"] == 0 and block["cuts"] == [] and block["gimbal_pairs"] == []
    for name in ("position", "yaw", "pitch", "roll", "angle"):
        nothing = dict.fromkeys(("mean", "variance", "max", "median", "p95"))
        assert block[name] == {**nothing, "without_cuts": nothing}


def test_different_lengths_are_refused():
    with pytest.raises(ValueError, match=r"3 .*2 "):
        camera_activity(np.zeros((3, 3)), np.tile(np.eye(3), (2, 1, 1)))
    with pytest.raises(ValueError, match="cuts"):
        summarize(activity([0, 1, 2]), [True], 24)
