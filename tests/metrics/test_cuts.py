"""The cut rule on camera paths with the statistics of Tables 2 and 3."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taubench_gl.metrics.activity import WINDOW, Activity, detect_cuts, typical_change

SEEDS = range(40)


def path(position, angle=None) -> Activity:
    position = np.asarray(position, dtype=float)
    angle = np.zeros_like(position) if angle is None else np.asarray(angle, dtype=float)
    nothing = np.zeros_like(position)
    return Activity(position, angle, nothing, nothing, angle, np.zeros(len(position), dtype=bool))


def gamma(rng, mean, variance, n=360):
    return rng.gamma(mean**2 / variance, variance / mean, size=n)


def cuts_of(activity, **options):
    return np.flatnonzero(detect_cuts(activity, **options)).tolist()


@pytest.mark.parametrize("seed", SEEDS)
def test_only_the_teleport_of_the_vr_camera_is_a_cut(seed):
    rng = np.random.default_rng(seed)
    position, turns = gamma(rng, 0.021, 0.0004), gamma(rng, 8.222, 72.563)
    assert cuts_of(path(position, turns)) == []
    at = int(rng.integers(0, 360))
    position[at] = 7.163
    assert cuts_of(path(position, turns)) == [at]


@pytest.mark.parametrize("seed", SEEDS)
def test_fast_game_camera_has_no_cuts(seed):
    rng = np.random.default_rng(seed)
    position = gamma(rng, 1.892, 0.826)
    position[rng.integers(0, 360)] = 5.475
    assert cuts_of(path(np.minimum(position, 5.475), gamma(rng, 3.9, 11.0))) == []


def test_turn_after_a_lull_in_jitter_is_no_cut():
    angle = gamma(np.random.default_rng(3), 8.222, 72.563)
    angle[100:112] = 0.1
    angle[106] = 60.0
    assert cuts_of(path(np.zeros(360), angle)) == []


MOVING = np.repeat([0.0, 2.0, 0.0], (50, 30, 50))


@pytest.mark.parametrize(
    ("position", "angle"),
    [(np.zeros(20), np.zeros(20)), (MOVING, 20 * MOVING), (np.full(100, 50.0), np.full(100, 120.0)),
     *((np.full(n, 100.0), None) for n in range(3))],
    ids=["still", "starts and stops", "constant speed", "no pair", "one pair", "two pairs"],
)  # fmt: skip
def test_even_motion_has_no_cuts(position, angle):
    assert cuts_of(path(position, angle)) == []


@pytest.mark.parametrize("at", [0, 1, 7, 18, 19])
def test_jump_in_a_still_sequence_is_a_cut(at):
    still = np.zeros(20)
    still[at] = 1.0
    assert cuts_of(path(still)) == [at]
    assert cuts_of(path(np.zeros(20), 45 * still)) == [at]


def test_changes_below_the_floor_are_no_cuts():
    twitch = np.zeros(20)
    twitch[10] = 1.0
    assert cuts_of(path(0.2 * twitch, 25 * twitch)) == []
    assert cuts_of(path(0.2 * twitch), unit_scale=0.1) == [10]


def test_adjacent_cuts_are_both_found():
    position = np.full(60, 0.05)
    position[[20, 22, 23]] = [5.0, 8.0, 6.0]
    assert cuts_of(path(position)) == [20, 22, 23]


@settings(deadline=None)
@given(st.lists(st.floats(0, 100), min_size=3, max_size=40))
def test_typical_change_against_the_definition(values):
    values = np.array(values)
    for i, got in enumerate(typical_change(values)):
        before, after = values[max(0, i - WINDOW) : i], values[i + 1 : i + 1 + WINDOW]
        medians = [np.median(side) for side in (before, after) if len(side)]
        expected = max(*medians, np.percentile(np.delete(values, i), 75)) if medians else 0
        assert got == pytest.approx(expected, rel=1e-12, abs=1e-12)
