"""A visit: what of its turns counts, by a clock of ours."""

from __future__ import annotations

import pytest
from cost_tools import situation_of

from taubench_gl.animation import choose_camera
from taubench_gl.cost.plan import setting_of
from taubench_gl.cost.sessions import TIMED, TURNS, WARM, Session
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.frame.passes.masks import MaskPass
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.settings import Settings

SMALL = Settings.of(width=16, height=9, frames=(0, 10), columns=("frustum", "position"))


READINGS = 1 + TIMED
"""Readings of the clock in a turn: before the first timed frame, and after each timed frame."""


class Turns:
    """A clock on which every frame of turn number i takes ``ms[i]`` milliseconds, the last one's from there on."""

    def __init__(self, *ms: float):
        self.seconds, self.readings, self._ms = 0.0, 0, ms

    @property
    def drawn(self) -> int:
        return self.readings // READINGS

    def __call__(self) -> float:
        self.seconds += 1e-3 * self._ms[min(self.drawn, len(self._ms) - 1)]
        self.readings += 1
        return self.seconds


@pytest.fixture(scope="module")
def visited():
    """Visits one setting, by a clock of turns; returns what it told and how many turns were drawn."""
    scene = situation_of().scene
    gpu = open_gpu("auto", None)

    def visit(*ms, **choice):
        clock = Turns(0.5, *ms)  # the first turn compiles shaders and times passes
        with gpu:
            session = Session(
                gpu, scene, choose_camera(scene, None), setting_of("one", choice, SMALL), PassTimer(gpu), clock
            )
            told = session.visit()
            session.release()
        return told, clock.drawn - 1

    return visit


def test_the_fastest_turn_counts(visited):
    told, turns = visited(5.0, 9.0, 2.0, 3.0, 100.0)
    assert told["drawn_ms"] == pytest.approx([2.0] * TIMED)
    assert told["frame_ms"] == pytest.approx(2.0)
    assert turns == 5


def test_long_frames_are_drawn_once_and_short_ones_not_for_ever(visited):
    assert visited(80.0)[1] == 1, "four frames of 80 ms are long enough"
    assert visited(0.01)[1] == TURNS


def test_a_sampled_run_costs_what_it_draws(visited):
    # Of 10 frames every third pair draws six: pairs 1, 4 and 7.
    told, _ = visited(20.0, pairs="every:3")
    assert told["drawn_ms"] == pytest.approx([20.0] * TIMED)
    assert told["frame_ms"] == pytest.approx(20.0 * 6 / 10)


def test_timed_loop_reads_counts_as_late_as_an_evaluation(monkeypatch):
    """Counts are read one pair late in both: while the mask pass works on the next pair."""
    lags: list[int] = []  # runs submitted after the one that is read
    read = MaskPass.read

    def spy(self, run=None):
        lags.append(self._runs - (self._runs if run is None else run))
        return read(self, run)

    monkeypatch.setattr(MaskPass, "read", spy)
    scene, frames = situation_of().scene, WARM + TIMED
    settings = SMALL.replace(frames=(0, frames))
    evaluate_scene(scene, settings)
    assert lags == [1] * (frames - 2) + [0], "the last pair has no next one"
    lags.clear()
    gpu = open_gpu("auto", None)
    with gpu:
        session = Session(gpu, scene, choose_camera(scene, None), setting_of("one", {}, settings), PassTimer(gpu))
        session.visit()
        session.release()
    assert len(lags) >= 2 * (frames - 2) and set(lags) == {1}
