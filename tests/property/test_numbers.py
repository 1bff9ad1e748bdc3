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
from taubench_gl.metrics.activity import camera_activity
from taubench_gl.metrics.counts import bin_of, edges
from taubench_gl.metrics.streaming import Welford

numbers = st.floats(-1e3, 1e3)
quaternions = st.tuples(*[st.floats(-1.0, 1.0)] * 4).map(np.array).filter(lambda q: np.linalg.norm(q) > 1e-3)


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
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60))
def test_welford_against_exact_sums(values):
    w = Welford()
    for value in values:
        w.add(value)
    exact = statistics.pvariance(values)
    size = max(abs(v) for v in values)
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
