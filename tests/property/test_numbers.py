"""Properties of the CPU math on random input: quaternions, angles, sums, histogram bins, key search."""

from __future__ import annotations

import math
import statistics

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from worlds import relaxed

from taubench_gl import math3d
from taubench_gl.animation import curves
from taubench_gl.conventions import DEFAULT_FPS
from taubench_gl.metrics.activity import camera_activity, euler_yxz, wrap_degrees
from taubench_gl.metrics.counts import bin_of, edges
from taubench_gl.metrics.streaming import Welford

numbers = st.floats(-1e3, 1e3)
quaternions = st.tuples(*[st.floats(-1.0, 1.0)] * 4).map(np.array).filter(lambda q: np.linalg.norm(q) > 1e-3)
fractions = st.floats(0.0, 1.0)


@relaxed
@given(quaternions, quaternions, fractions)
def test_slerp_is_a_unit_quaternion_on_the_short_arc(a, b, u):
    a, b = math3d.normalize(a), math3d.normalize(b)
    q = curves.slerp(a, b, np.array(u))
    angle = math3d.quat_angle(a, b)
    assert abs(np.linalg.norm(q) - 1.0) < 1e-9
    assert abs(math3d.quat_angle(a, q) - u * angle) < 1e-7


@relaxed
@given(quaternions, quaternions, fractions)
def test_slerp_is_symmetric(a, b, u):
    a, b = math3d.normalize(a), math3d.normalize(b)
    if abs(a @ b) > 1e-6:  # both arcs of a half turn are shortest
        forward, backward = curves.slerp(a, b, np.array(u)), curves.slerp(b, a, np.array(1.0 - u))
        assert math3d.quat_angle(forward, backward) < 1e-7


@relaxed
@given(quaternions)
def test_quaternion_matrix_round_trip(q):
    m = math3d.mat3_from_quat(q)
    assert np.abs(m @ m.T - np.eye(3)).max() < 1e-14 and abs(np.linalg.det(m) - 1.0) < 1e-14
    assert math3d.quat_angle(math3d.quat_from_mat3(m), q) < 1e-14


@relaxed
@given(quaternions)
def test_euler_angle_round_trip(q):
    m = math3d.mat3_from_quat(q)
    yaw, pitch, roll = euler_yxz(m)
    axes = [((0.0, 1.0, 0.0), yaw), ((1.0, 0.0, 0.0), pitch), ((0.0, 0.0, 1.0), roll)]
    y, x, z = (math3d.mat3_from_quat(math3d.quat_from_axis_angle(np.array(axis), angle)) for axis, angle in axes)
    assert np.abs(y @ x @ z - m).max() < 1e-7


@relaxed
@given(st.lists(quaternions, min_size=2, max_size=9), st.tuples(numbers, numbers, numbers))
def test_camera_activity_does_not_depend_on_the_origin(path, offset):
    rotations = math3d.mat3_from_quat(np.array(path))
    steps = np.cumsum(np.ones((len(path), 3)), axis=0)
    a = camera_activity(steps, rotations)
    b = camera_activity(steps + np.round(offset), rotations)
    assert np.array_equal(a.position, b.position) and np.array_equal(a.angle, b.angle)
    assert (a.angle >= 0).all() and (a.angle <= 180 + 1e-9).all()
    for name in ("yaw", "pitch", "roll"):
        assert (getattr(a, name) >= 0).all() and (getattr(a, name) <= 180).all()


@relaxed
@given(st.floats(-1e6, 1e6))
def test_wrapped_angles_differ_by_whole_turns(difference):
    wrapped = float(wrap_degrees(difference))
    assert -180.0 < wrapped <= 180.0
    turns = (difference - wrapped) / 360.0
    assert abs(turns - round(turns)) < 1e-8
    if abs(difference) < 180.0:
        assert wrapped == difference


@relaxed
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60), st.integers(0, 60))
def test_welford_in_blocks_of_any_size(values, cut):
    whole, parts = Welford(), Welford()
    for value in values:
        whole.add(value)
    parts.add_many(np.array(values[:cut]))
    parts.add_many(np.array(values[cut:]))
    exact = statistics.pvariance(values)
    size = max(abs(v) for v in values)
    for w in (whole, parts):
        assert w.count == len(values) and w.min == min(values) and w.max == max(values)
        assert abs(w.mean - math.fsum(values) / len(values)) <= 1e-12 * max(size, 1.0)
        assert abs(w.variance - exact) <= 1e-11 * max(exact, 1e-12 * size * size, 1e-300)


@relaxed
@given(st.floats(0.0, 1e6, width=32))
def test_bin_index_matches_the_bin_edges(distance):
    found, lower = int(bin_of(np.float32(distance))), edges()
    assert found == int(np.searchsorted(lower, float(np.float32(distance)), side="right"))


@relaxed
@given(st.lists(st.floats(0.0, 100.0), min_size=1, max_size=12, unique=True), st.floats(-1.0, 101.0))
def test_key_segment_contains_its_time(times, t):
    times = np.sort(np.array(times))
    i, j, u, dt = curves.segment(times, t)
    assert 0 <= i <= j <= min(i + 1, len(times) - 1) and 0.0 <= u <= 1.0 and dt >= 0.0
    tolerance = curves.key_tolerance(t, DEFAULT_FPS)
    if i != j:
        assert times[i] - tolerance <= t < times[j] and dt == times[j] - times[i]
    else:
        assert t <= times[0] or t >= times[-1] - tolerance


@relaxed
@given(quaternions, st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_transformed_normal_stays_perpendicular(q, scale, tangent):
    """Under any scale a transformed normal is perpendicular to transformed tangents."""
    m = math3d.trs(np.zeros(3), q, np.array(scale))[:3, :3]
    normal = math3d.normalize(np.array([0.3, -0.5, 0.8]))
    along = np.cross(normal, np.array(tangent))
    turned, moved = math3d.normal_matrix(m) @ normal, m @ along
    assert abs(turned @ moved) <= 1e-12 * max(np.linalg.norm(turned) * np.linalg.norm(moved), 1e-300) + 1e-14
