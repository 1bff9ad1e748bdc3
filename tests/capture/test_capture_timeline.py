"""Between snapshots: trajectories, interpolation, jumps, the eye, events, and the windows of a recording."""

from __future__ import annotations

import re

import numpy as np
import pytest
from demo_encoder import entity_state, game, player_state

from taubench_gl.capture.quake3 import demo as wire
from taubench_gl.capture.quake3 import timeline as tl
from taubench_gl.capture.quake3.md3 import Clip
from taubench_gl.capture.quake3.players import shown_frames, swing
from taubench_gl.capture.quake3.scene import as_recording
from taubench_gl.capture.recording import EXACT_RATE, Choice, best_window, key_times, stretches, windows
from taubench_gl.errors import SceneError, SettingsError


def at(states, times):
    """A timeline of (time, player, entities) at ``times`` in seconds."""
    return tl.Timeline(wire.decode(game(states), "test"), np.asarray(times, float))


def moving(n=21, step=50, **player):
    """n snapshots of a player who walks along x at 320 units a second."""
    return [(1000 + step * i, player_state(x=16.0 * i, vx=320.0, **player), {}) for i in range(n)]


@pytest.mark.parametrize(
    "path, seconds, expected",
    [
        (tl.STILL, 2.0, [1, 2, 3]),
        (tl.INTERPOLATED, 2.0, [1, 2, 3]),
        (tl.LINEAR, 2.0, [21, 42, 63]),
        (tl.LINEAR_STOP, 2.0, [11, 22, 33]),
        (tl.LINEAR_STOP, -1.0, [1, 2, 3]),
        (tl.SINE, 0.25, [11, 22, 33]),
        (tl.FALLING, 2.0, [21, 42, 63 - 1600]),
    ],
)
def test_trajectories(path, seconds, expected):
    state = entity_state(path=path, x=1.0, y=2.0, z=3.0, vx=10.0, vy=20.0, vz=30.0, time=5000, duration=1000)
    place = tl.trajectory(np.array([state], float), np.array([5000 + 1000 * seconds]))
    assert np.allclose(place[0], expected)


def test_axes_look_along_pitch_yaw_and_roll():
    assert np.allclose(tl.axes(np.zeros(3)), np.eye(3))
    assert np.allclose(tl.axes(np.array([0.0, 90, 0]))[0], [0, 1, 0])
    assert np.allclose(tl.axes(np.array([30.0, 0, 0]))[0], [np.cos(np.pi / 6), 0, -0.5])  # down
    assert np.allclose(tl.axes(np.array([0.0, 0, 90]))[1], [0, 0, 1])
    for angles in np.random.default_rng(0).uniform(-180, 180, (20, 3)):
        rows = tl.axes(angles)
        assert np.allclose(rows @ rows.T, np.eye(3)) and np.isclose(np.linalg.det(rows), 1)


@pytest.mark.parametrize("change", [{"flags": wire.TELEPORT}, {"client": 3}])
def test_a_teleport_and_a_change_of_player_are_jumps(change):
    there = player_state(x=900.0, **change)
    states = [(1000, player_state(), {}), (1050, there, {}), (1100, there, {})]
    eye = at(states, [0, 0.02, 0.04, 0.06, 0.08]).eye()
    assert eye.places[:, 0].tolist() == [0, 0, 0, 900, 900]
    assert eye.jumps.tolist() == [False, False, False, True, False]


def test_bob_landing_steps_and_ducking_move_the_eye():
    # 127/2 of a walk's cycle is its highest point: 0.005 of the speed, at most 6 units.
    bob = at([(1000, player_state(bob=64, vx=320.0), {}), (1050, player_state(bob=64, vx=320.0), {})], [0.0])
    assert np.isclose(bob.eye(roll=False).places[0, 2] - 26, 320 * 0.005 * np.sin(64 / 127 * np.pi))
    fall = [(1000, player_state(), {})]
    fall += [(1000 + 50 * i, player_state(events=1, event0=tl.LAND_EVENTS[1]), {}) for i in range(1, 21)]
    heights = at(fall, [0.05, 0.125, 0.2, 0.35, 0.5, 0.6]).eye().places[:, 2] - 26
    assert np.allclose(heights, [0, -8, -16, -8, 0, 0])
    step = [(1000, player_state(), {})]
    step += [(1000 + 50 * i, player_state(events=1, event0=tl.STEP_EVENTS[1], z=8.0), {}) for i in range(1, 21)]
    heights = at(step, [0.05, 0.15, 0.25]).eye().places[:, 2] - 26
    assert np.allclose(heights, [0, 4, 8])
    duck = [(1000, player_state(), {}), *((1000 + 50 * i, player_state(view_height=12), {}) for i in range(1, 9))]
    assert np.allclose(at(duck, [0.05, 0.1, 0.15]).eye().places[:, 2], [26, 19, 12])


def test_running_sideways_leans_the_view_unless_it_is_left_out():
    states = [(1000, player_state(vy=320.0), {}), (1050, player_state(vy=320.0), {})]
    rolled, level = (at(states, [0.0]).eye(roll).axes[0] for roll in (True, False))
    assert np.allclose(level, np.eye(3))
    assert np.isclose(np.degrees(np.arccos(rolled[2, 2])), 1.6)  # 0.005 degrees per unit a second


def test_a_dead_player_looks_at_fixed_angles():
    dead = player_state(health=0, mode=3, view_height=-16)
    timeline = at([(1000, dead, {}), (1050, dead, {})], [0.0])
    eye = timeline.eye()
    assert not eye.alive[0] and eye.places[0, 2] == -16
    assert np.allclose(eye.axes[0], tl.axes(np.array([-15.0, 0, 40])))


def test_entities_move_between_snapshots_but_not_across_a_teleport():
    def other(x, flags=0, path=tl.INTERPOLATED):
        return {5: entity_state(kind=tl.PLAYER_KIND, x=float(x), yaw=350.0 + x, path=path, turn_path=path, flags=flags)}

    p = player_state()
    each = [other(0), other(20), other(900, wire.TELEPORT), {}, other(0)]
    states = [(1000 + 100 * i, p, entities) for i, entities in enumerate(each)]
    track = at(states, [0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.35, 0.4]).tracks(tl.PLAYER_KIND)[(5,)]
    assert track.places[:, 0].tolist() == [0, 10, 20, 20, 900, 900, 900, 0]
    assert track.angles[:2, 1].tolist() == [350, 360]
    assert track.present.tolist() == [True] * 5 + [False, False, True]
    assert track.jumps[4] and track.jumps[7] and not track.jumps[1:4].any()


def test_a_missile_flies_by_its_trajectory_and_a_reused_number_is_another():
    def rocket(x, time):
        return {70: entity_state(kind=tl.MISSILE_KIND, weapon=5, path=tl.LINEAR, x=float(x), vx=900.0, time=time)}

    p = player_state()
    each = [rocket(0, 1000), rocket(0, 1000), rocket(500, 1100), rocket(500, 1100)]
    states = [(1000 + 50 * i, p, entities) for i, entities in enumerate(each)]
    tracks = at(states, [0, 0.025, 0.05, 0.11]).tracks(tl.MISSILE_KIND, ("weapon", "time"))
    assert set(tracks) == {(70, 5, 1000), (70, 5, 1100)}
    assert np.allclose(tracks[70, 5, 1000].places[:3, 0], [0, 22.5, 45])
    assert tracks[70, 5, 1000].present.tolist() == [True, True, True, False]
    assert np.allclose(tracks[70, 5, 1100].places[3, 0], 509)


def test_an_event_stays_300_ms_and_happened_once():
    p = player_state()
    shot = entity_state(kind=tl.PLAYER_KIND, event=tl.FIRE)
    again = entity_state(kind=tl.PLAYER_KIND, event=tl.FIRE | 0x100)  # its two bits say that it is another
    boom = entity_state(kind=tl.FIRST_EVENT + 51)
    states = [(1000 + 50 * i, p, {5: shot if i < 4 else again} | ({80: boom} if i > 2 else {})) for i in range(8)]
    events = tl.find_events(wire.decode(game(states), "test").snapshots)
    assert [(e.time, e.number, e.kind) for e in events] == [(1000, 5, 23), (1150, 80, 51), (1200, 5, 23)]


def test_an_event_of_an_entity_that_was_out_of_sight_is_the_same_for_300_ms():
    shot = {5: entity_state(kind=tl.PLAYER_KIND, event=tl.FIRE)}
    for hidden, times in ((5, [1000]), (7, [1000, 1400])):
        states = [(1000 + 50 * i, player_state(), {} if 1 <= i <= hidden else shot) for i in range(hidden + 2)]
        assert [e.time for e in tl.find_events(wire.decode(game(states), "test").snapshots)] == times


def test_the_recording_players_events_are_numbered():
    counts = [0, 1, 3, 3, 6]
    states = [(1000 + 50 * i, player_state(events=n, event0=10 + n, event1=40 + n), {}) for i, n in enumerate(counts)]
    events = tl.find_events(wire.decode(game(states), "test").snapshots)
    # Two of the last three are still there.
    assert [(e.time, e.kind) for e in events] == [(1050, 11), (1100, 43), (1100, 13), (1200, 16), (1200, 46)]
    assert {e.number for e in events} == {-1}


def test_a_change_of_player_is_no_event():
    seen = [(0, 1), (0, 1), (4, 9), (4, 10)]  # (client, its number of events)
    states = [
        (1000 + 50 * i, player_state(client=client, events=n, event0=tl.FIRE, event1=tl.FIRE), {})
        for i, (client, n) in enumerate(seen)
    ]
    events = tl.find_events(wire.decode(game(states), "test").snapshots)
    assert [event.time for event in events] == [1150]


def test_values_that_are_no_numbers_are_refused():
    with pytest.raises(SceneError):
        at([(1000, player_state(x=float("nan")), {}), (1050, player_state(), {})], [0.0])
    states = [(1000, player_state(), {5: entity_state(kind=1, x=float("inf"))})] * 1
    with pytest.raises(SceneError):
        at([*states, (1050, player_state(), {})], [0.0]).tracks(1)


# ------------------------------------------------------------------------------------------------------- animation
def test_the_shown_frames_are_the_engines_interpolation():
    clips = {0: Clip(10, 4, 4, 20.0, False), 1: Clip(30, 3, 0, 10.0, False), 22: Clip(0, 1, 0, 1.0, False)}
    ms = np.arange(0, 1000, 10.0)
    frames = shown_frames(clips, np.zeros(len(ms)), ms)
    # At 20 frames a second, a frame fades in over 50 ms while the one before fades out; the first waits as long.
    old, new, back = frames.T
    step = np.floor(ms / 50)
    assert np.array_equal(new, 10 + step % 4)
    assert np.array_equal(old[ms >= 50], 10 + (step[ms >= 50] - 1) % 4) and (old[ms < 50] == 10).all()
    assert np.allclose(back, 1 - ms % 50 / 50)
    once = shown_frames(clips, np.ones(len(ms)), ms)
    assert (once[ms > 400][:, 1] == 32).all()  # the last frame of an animation that does not repeat stays


def test_a_part_follows_when_it_is_far_behind():
    n = 100
    steps, quiet = np.full(n, 10.0), np.zeros(n, bool)
    fresh = np.arange(n) == 0
    goal = np.where(np.arange(n) > 10, 20.0, 0.0)
    assert (swing(goal, quiet, fresh, steps, 25, 90, 0.3) == 0).all()  # within the slack nothing turns
    far = swing(goal * 3, quiet, fresh, steps, 25, 90, 0.3)
    assert far[10] == 0 and np.isclose(far[11], 6) and far[-1] == 60 and (np.diff(far) >= 0).all()
    sharp = swing(goal * 8, quiet, fresh, steps, 25, 90, 0.3)
    assert np.isclose(sharp[11], 160 - 89)  # never more than the most behind


# --------------------------------------------------------------------------------------------------------- windows
def test_keys_lie_on_the_frames_of_both_rates():
    times = key_times(Choice(0.0, 6.0, 60.0), 6.0, "x")
    for rate in (60.0, EXACT_RATE):
        frames = np.arange(int(6 * rate) + 1) / rate
        assert np.abs(times[:, None] - frames).min(0).max() < 1e-12
    assert len(times) == 361 + 145 - 73 and (np.diff(times) > 1e-3).all()
    assert len(key_times(Choice(0.0, 1.0, 24.0), 6.0, "x")) == 25


def turning(seconds=20, fast=(8, 14), dead=()):
    """A player who turns 90 degrees a second, 180 within ``fast`` seconds, and is dead within ``dead`` seconds."""
    states, yaw = [], 0.0
    for i in range(seconds * 20 + 1):
        t = i / 20
        gone = any(a <= t < b for a, b in dead)
        alive = {"health": 0, "mode": 3} if gone else {}
        states.append((1000 + 50 * i, player_state(yaw=(yaw + 180) % 360 - 180, x=16.0 * i, **alive), {}))
        yaw += (180 if fast[0] <= t < fast[1] else 90) / 20
    return as_recording(wire.decode(game(states), "test"))


def test_the_best_window_has_the_most_rotation_of_those_in_which_the_player_lives():
    recording = turning()
    found = windows(recording, 6.0)
    assert [window.start for window in found] == list(range(15))
    rates = {window.start: window.rotation for window in found}
    assert np.isclose(rates[8], 180, rtol=1e-3) and np.isclose(rates[0], 90, rtol=1e-3)
    assert np.isclose(found[0].moved, 320 / 32, rtol=1e-3) and not any(window.jumps for window in found)
    assert best_window(recording, 6.0).start == 8
    hurt = turning(dead=[(12, 12.5)])
    alive = {window.start for window in windows(hurt, 6.0) if window.alive}
    assert alive == {0, 1, 2, 3, 4, 5, 13, 14} and best_window(hurt, 6.0).start == 5
    assert np.allclose(stretches(hurt.eye.times, hurt.eye.alive), [(0, 12), (12.5, 20)], atol=0.06)
    with pytest.raises(SettingsError) as error:
        best_window(turning(dead=[(0, 20.1)]), 6.0)
    assert not re.findall(r"[0-9]", error.value.hint), "no life, no time within it"
    with pytest.raises(SettingsError) as error:
        best_window(turning(dead=[(5, 5.5), (11, 20.1)]), 6.0)
    assert re.findall(r"[0-9.]+", error.value.hint)[:2] == ["5.50", "10.98"]  # eyes are seen every 1/60 s


def test_what_happens_in_a_window_is_counted():
    shot = {1: {5: entity_state(kind=1, event=tl.FIRE)}}
    states = [(1000 + 50 * i, player_state(), shot.get(i // 20, {})) for i in range(161)]
    recording = as_recording(wire.decode(game(states), "test"))
    counts = {window.start: window.counts["shots"] for window in windows(recording, 6.0)}
    assert counts == {0: 1, 1: 1, 2: 0}
