"""Visits and rounds: which frames are drawn, what counts as their time, and where a study resumes."""

from __future__ import annotations

import math
import subprocess
import sys
import time

import psutil
import pytest

from taubench_gl.animation import choose_camera
from taubench_gl.cost.configurations import Configuration, configuration
from taubench_gl.cost.timing import (
    TIMED,
    TURNS,
    WARM,
    Deadline,
    OpenConfiguration,
    OtherWork,
    OutOfTime,
    Pool,
    due_visits,
    rounds_of,
)
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.frame.passes.masks import MaskPass
from taubench_gl.gpu.context import open_gpu
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

SMALL = Settings(width=16, height=9, frames=(0, 10), columns=("frustum", "position"))


class Turns:
    """A clock that is read before and after the timed frames of a turn: a frame of turn i takes ``ms[i]``."""

    def __init__(self, *ms: float):
        self.seconds, self.readings, self._ms = 0.0, 0, ms

    @property
    def drawn(self) -> int:
        return self.readings // 2

    def __call__(self) -> float:
        self.seconds += 1e-3 * TIMED * self._ms[min(self.drawn, len(self._ms) - 1)] * (self.readings % 2)
        self.readings += 1
        return self.seconds


@pytest.fixture(scope="module")
def scene(demo):
    return load_scene(demo)


@pytest.fixture
def visit(scene):
    """Visits one configuration with a clock of ``Turns``: the result, and the number of timed turns."""
    gpu = open_gpu("auto", None)

    def visit(*ms, **values):
        clock = Turns(0.5, *ms)  # the first turn compiles shaders
        with gpu:
            camera = choose_camera(scene, None)
            opened = OpenConfiguration(gpu, scene, camera, configuration("single", values, SMALL), clock)
            found = opened.visit()
            opened.release()
        return found, clock.drawn - 1

    return visit


def test_fastest_turn_counts(visit):
    found, turns = visit(5.0, 9.0, 2.0, 3.0, 100.0)
    assert found == pytest.approx(2.0)
    assert turns == 5


def test_number_of_turns_depends_on_their_time(visit):
    assert visit(80.0)[1] == 1, "four frames of 80 ms are long enough"
    assert visit(0.01)[1] == TURNS


def test_sampled_pairs_cost_the_frames_that_are_drawn(visit):
    # Of 10 frames every third pair draws six: pairs 1, 4 and 7.
    assert visit(20.0, pairs="every:3")[0] == pytest.approx(20.0 * 6 / 10)


def test_long_frames_are_timed_one_at_a_time(scene):
    """A frame of 1 s: one of two that are drawn is timed, after a first turn that compiles."""
    steps = []

    class Slow:
        seconds = 0.0

        def __call__(self):
            self.seconds += 1.0
            return self.seconds

    gpu = open_gpu("auto", None)
    with gpu:
        given = configuration("single", {}, SMALL)
        opened = OpenConfiguration(gpu, scene, choose_camera(scene, None), given, Slow(), lambda: steps.append(1))
        assert opened.visit() == opened.visit() == pytest.approx(1000.0)
        opened.release()
    assert len(steps) == WARM + 1 + 2 + 2


def test_a_deadline_ends_a_visit_between_frames(scene):
    gpu, left = open_gpu("auto", None), [3]

    def check():
        left[0] -= 1
        if left[0] < 0:
            raise OutOfTime

    with (
        gpu,
        Pool(
            lambda c: OpenConfiguration(gpu, scene, choose_camera(scene, None), c, check=check), software=True
        ) as pool,
        pytest.raises(OutOfTime),
    ):
        pool.visit(configuration("single", {}, SMALL))
    assert left == [-1], "no frame is drawn after the deadline"


def test_a_deadline_passes_by_share():
    whole = Deadline(1000.0)
    assert 0.0 < whole.left(0.5) <= 500.0 and Deadline(None).left() == math.inf
    whole.check()
    with pytest.raises(OutOfTime):
        Deadline(1000.0).check(share=-1.0)


def test_timed_loop_reads_counts_one_pair_late(scene, monkeypatch):
    lags: list[int] = []  # runs of the mask pass submitted after the one that is read
    read = MaskPass.read

    def spy(self, run=None):
        lags.append(self._runs - (self._runs if run is None else run))
        return read(self, run)

    monkeypatch.setattr(MaskPass, "read", spy)
    settings = SMALL.replace(frames=(0, WARM + TIMED))
    evaluate_scene(scene, settings)
    assert lags == [1] * (WARM + TIMED - 2) + [0], "the last pair has no next one"
    lags.clear()
    gpu = open_gpu("auto", None)
    with gpu:
        opened = OpenConfiguration(gpu, scene, choose_camera(scene, None), configuration("single", {}, settings))
        opened.visit()
        opened.release()
    assert len(lags) >= 2 * (WARM + TIMED - 2) and set(lags) == {1}


def test_work_of_other_processes_is_counted():
    """A process beside this one, which sleeps, until it has used 0.3 s of CPU time."""
    code = "import time\nwhile time.process_time() < 0.3: pass"
    with OtherWork() as work:
        subprocess.run([sys.executable, "-c", code], check=True)
    assert work.other_seconds > 0.2 and work.seconds >= 0.3


def test_own_work_is_not_that_of_others():
    """While this process works on one core, others can have the rest."""
    with OtherWork() as work:
        end = time.process_time() + 0.3
        while time.process_time() < end:
            pass
    assert -0.1 < work.other_seconds < psutil.cpu_count() * work.seconds - 0.2


class Opened:
    bytes = 1 << 60

    def __init__(self):
        self.released = False

    def visit(self):
        return 1.0

    def release(self):
        self.released = True


def test_pool_closes_configurations_when_memory_is_short():
    opened = []
    with Pool(lambda c: opened.append(Opened()) or opened[-1], software=True) as pool:
        for name in "aba":
            pool.visit(Configuration(name, "single", {}, SMALL))
        assert [o.released for o in opened] == [True, True, False]
    assert all(o.released for o in opened)


def due(done=(), names="abc"):
    configurations = [Configuration(n, "single", {}, SMALL, on_cpu=n == "x") for n in names]
    return [(r, c.name) for r, c in due_visits(configurations, 2, done)]


def test_visits_are_interleaved_and_resume():
    whole = due()
    assert whole == [(r, n) for r in range(2) for n in "abc"]
    for cut in (1, 4, len(whole)):
        assert due([{"configuration": n} for _, n in whole[:cut]]) == whole[cut:]


def test_what_takes_long_starts_after_three_rounds_of_the_others():
    configurations = [
        Configuration("a", "single", {}, SMALL),
        Configuration("g", "grid", {}, SMALL),
        Configuration("p", "path_traced", {}, SMALL.replace(light="path-traced")),
    ]
    order = "".join(c.name for _, c in due_visits(configurations, 4, ()))
    assert order == "aaapaggpgpgp"


def test_masks_on_the_cpu_are_not_timed():
    assert due(names="axbc") == due()


def test_rounds_are_in_order():
    visits = [{"configuration": n, "round": r, "frame_ms": 10.0 * r} for r in (1, 0) for n in "ab"]
    assert [v["frame_ms"] for v in rounds_of(visits, "a")] == [0.0, 10.0]
