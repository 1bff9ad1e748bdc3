"""Keys on frames: any rate, any frame, keys as files hold them; jumps; keys one float32 step apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_scenes import make_channel, make_scene, triangle_mesh

from taubench_gl.animation import Poser
from taubench_gl.animation.curves import Timeline, key_tolerance, sample_channel, segment
from taubench_gl.animation.key_notes import frame_of_key, key_notes
from taubench_gl.conventions import KEY_TOLERANCE
from taubench_gl.scene.model import Camera, Light, MorphTarget, Scene

rates = st.one_of(st.integers(1, 240).map(float), st.floats(1.0, 240.0))


def key_of_frame(frames: np.ndarray, fps: float, kind: str) -> np.ndarray:
    exact = frames / fps
    return exact if kind == "float64" else exact.astype(np.float32).astype(np.float64)


def sampled(channel, t: float, fps: float) -> float:
    """The value, by the scalar reference and by the vectorized timeline, which are equal."""
    value = sample_channel(channel, t, fps)
    ((_, values),) = Timeline([channel], fps).sample(t)
    assert np.array_equal(values[0], value)
    return float(value[0])


@settings(deadline=None, max_examples=100)
@given(rates, st.integers(1, 100_000), st.sampled_from(["float32", "float64"]))
def test_a_step_key_is_seen_in_its_frame(fps, frame, kind):
    frames = np.arange(frame - 1, frame + 2)
    channel = make_channel(0, "translation", key_of_frame(frames, fps, kind), frames[:, None] * np.ones(3), "STEP")
    assert [sampled(channel, n / fps, fps) for n in frames.tolist()] == frames.tolist()


@settings(deadline=None, max_examples=30)
@given(rates, st.integers(1, 500))
def test_step_keys_accumulated_in_float32(fps, count):
    steps = np.full(count, np.float32(1.0 / fps), dtype=np.float32)
    times = np.concatenate([[0.0], np.add.accumulate(steps, dtype=np.float32)]).astype(np.float64)
    channel = make_channel(0, "translation", times, np.arange(count + 1.0)[:, None] * np.ones(3), "STEP")
    timeline = Timeline([channel], fps)
    got = [timeline.sample(n / fps)[0][1][0, 0] for n in range(count + 1)]
    assert got == list(range(count + 1))


@settings(deadline=None, max_examples=80)
@given(rates, st.integers(0, 100_000))
def test_keys_one_float32_step_apart_keep_their_order(fps, frame):
    """The second key is that of the frame: a hold until the frame, as some exporters write it."""
    key = np.float32(max(frame, 1) / fps)
    times = np.array([0.0, np.nextafter(key, np.float32(0)), key], dtype=np.float64)
    channel = make_channel(0, "translation", times, np.array([[0.0] * 3, [1.0] * 3, [2.0] * 3]), "STEP")
    assert [sampled(channel, t, fps) for t in times.tolist()] == [0.0, 1.0, 2.0]
    assert sampled(channel, max(frame, 1) / fps, fps) == 2.0


@settings(deadline=None, max_examples=80)
@given(
    st.lists(st.sampled_from([0.0, 1e-7, 1e-4, 0.01, 0.5]), min_size=0, max_size=8),
    rates,
    st.lists(st.floats(-0.1, 4.0), min_size=2, max_size=12),
    st.sampled_from(["STEP", "LINEAR", "CUBICSPLINE"]),
)
def test_the_sampled_key_never_goes_back(steps, fps, asked, interpolation):
    """Later times see the same or a later key, with keys at one time and close to each other; timeline = reference."""
    times = np.concatenate([[0.0], np.cumsum(steps)])
    values = np.arange(len(times) * (9.0 if interpolation == "CUBICSPLINE" else 3.0))
    shape = (len(times), 3, 3) if interpolation == "CUBICSPLINE" else (len(times), 3)
    channel = make_channel(0, "translation", times, values.reshape(shape), interpolation)
    places = []
    for t in sorted([*asked, *times.tolist()]):
        sampled(channel, t, fps)
        i, _, u, dt = segment(times, t, fps)
        at = times[i] + u * dt
        assert abs(at - np.clip(t, times[0], times[-1])) <= key_tolerance(t, fps) * (1 + 1e-9)
        places.append(i + u)
    assert places == sorted(places)


@pytest.mark.parametrize("interpolation", ["STEP", "LINEAR", "CUBICSPLINE"])
@pytest.mark.parametrize("path", ["translation", "scale", "rotation", "weights"])
def test_two_keys_at_one_time_are_a_jump(interpolation, path):
    """A holds up to the jump, and B from it, at it, and a tolerance before it."""
    a, b = ([0.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 0.0]) if path == "rotation" else ([1.0] * 3, [5.0] * 3)
    keys = np.array([a, a, b, b])
    if interpolation == "CUBICSPLINE":
        keys = np.stack([keys * 0, keys, keys * 0], axis=1)
    channel = make_channel(0, path, [0.0, 0.31, 0.31, 2.0], keys, interpolation)
    tolerance = KEY_TOLERANCE / 24.0
    for t in (-1.0, 0.0, 0.2, 0.31 - 1.01 * tolerance):
        assert sample_channel(channel, t, 24.0).tolist() == a
    for t in (0.31 - 0.99 * tolerance, 0.31, 0.32, 2.0, 9.0):
        assert sample_channel(channel, t, 24.0).tolist() == b


def test_a_jump_at_the_first_and_last_key():
    channel = make_channel(0, "translation", [1.0, 1.0, 2.0, 2.0], [[k] * 3 for k in (1.0, 2.0, 3.0, 4.0)])
    assert [sampled(channel, t, 24.0) for t in (0.5, 1.0, 1.5, 2.0, 3.0)] == [1.0, 2.0, 2.5, 4.0, 4.0]


def test_the_tolerance_is_of_the_run_and_holds_between_frames():
    channel = make_channel(0, "translation", [0.0, 0.5, 1.0], [[0.0] * 3, [1.0] * 3, [2.0] * 3], "STEP")
    early = 0.5 - 0.002
    assert sampled(channel, early, 24.0) == 0.0, "a hundredth of a frame is 0.0004 s"
    assert sampled(channel, early, 4.0) == 1.0, "a hundredth of a frame is 0.0025 s"
    assert sampled(channel, 0.49, 4.0) == 0.0


def test_keys_that_a_reader_added_do_not_attract_times():
    times = np.array([0.0, 1.0, 2.0])
    channel = make_channel(0, "translation", times, times[:, None] * np.ones(3))
    t = 1.0 - 0.5 * KEY_TOLERANCE
    assert sampled(channel, t, 1.0) == 1.0
    added = type(channel)(*(getattr(channel, n) for n in channel.__slots__[:-1]), np.array([False, True, False]))
    assert sampled(added, t, 1.0) == pytest.approx(t, abs=1e-15)


def animated(*channels) -> Scene:
    return make_scene([-1], channels)


def test_every_property_of_a_pose_uses_the_rule():
    """Transform, weights, visibility, camera and light: STEP keys one float32 step late are seen in their frame."""
    late = float(np.nextafter(np.float32(7 / 24), np.float32(1)))
    targets = [("node", path, n) for path, n in (("translation", 3), ("scale", 3), ("visible", 1), ("weights", 1))]
    targets += [("camera", "yfov", 1), ("light", "intensity", 1), ("light", "color", 3)]
    channels = [
        make_channel(0, path, [0.0, late], np.array([[0.5 * (path == "yfov")] * n, [1.0] * n]), "STEP", target)
        for target, path, n in targets
    ]
    morph = triangle_mesh(targets=(MorphTarget(np.ones((3, 3), np.float32)),))
    scene = make_scene([-1], channels, meshes=[morph], mesh=[0], cameras=[Camera()], lights=[Light()])
    for frame, value in ((6, 0.0), (7, 1.0)):
        state = Poser(scene, 24.0).sample(frame / 24)
        light = state.lights[0]
        got = [state.world[0, 0, 3], state.world[0, 0, 0], state.visible[0], *state.weights[0]]
        assert got + [light.intensity, *light.color] == [value] * 8
        assert state.cameras[0].yfov == max(value, 0.5)


# --- notes ---------------------------------------------------------------------------------------------------------


def moving(times, interpolation="LINEAR") -> Scene:
    return animated(make_channel(0, "translation", times, np.arange(len(times) * 3.0).reshape(-1, 3), interpolation))


def test_time_before_the_first_key_is_noted():
    times = np.float32(np.arange(101, 150) / 24).astype(np.float64)
    (note,) = key_notes(moving(times), range(150), 24.0)
    assert "101 pairs" in note and "--frames 101:150" in note
    (note,) = key_notes(moving(times), range(40, 120), 24.0)
    assert "61 pairs" in note and "--frames 101:120" in note
    (note,) = key_notes(moving(times), range(90), 24.0)
    assert "89 pairs" in note and "--frames" not in note
    assert key_notes(moving(times), range(101, 150), 24.0) == []
    assert key_notes(moving(np.arange(10) / 24), range(10), 24.0) == []
    assert [frame_of_key(float(np.float32(n / fps)), fps) for n, fps in ((7, 24.0), (99_999, 30.0))] == [7, 99_999]


def test_keys_beside_frames_are_counted():
    """Four keys off by 0.05 frames; a spline, keys on frames and keys at another rate are not meant."""
    times = np.arange(10) / 24
    times[3:7] += 0.05 / 24
    (note,) = key_notes(moving(times), range(10), 24.0)
    assert note.startswith("4 keys ")
    assert key_notes(moving(np.arange(10) / 30), range(8), 24.0) == []
    assert key_notes(moving(np.float32(np.arange(5000) / 24).astype(np.float64)), range(5000), 24.0) == []
