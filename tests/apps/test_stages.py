"""What a command says before it has a number to show, and answers to what is typed wrongly."""

from __future__ import annotations

import logging
from typing import ClassVar

import pytest

from taubench_gl.apps import progress, stages
from taubench_gl.apps.progress import ProgressBar, StudyScreen
from taubench_gl.apps.stages import Stages
from taubench_gl.stage_log import lasting, progressed


@pytest.fixture
def logged(monkeypatch):
    """Handles the records of a logger of the test; lines that it says."""
    handler, said = Stages(), []
    monkeypatch.delenv(stages.VARIABLE, raising=False)
    monkeypatch.setattr(progress, "STAGES", handler)
    monkeypatch.setattr(stages, "note", said.append)
    logger = logging.Logger("taubench_gl.test", logging.INFO)
    logger.addHandler(handler)
    return handler, logger, said


def test_a_stage_that_ends_says_nothing(logged, monkeypatch):
    monkeypatch.setattr(stages, "STAGE_SECONDS", 3600.0)
    handler, logger, said = logged
    logger.info("reading")
    first = handler._timer
    logger.info("metering")
    second = handler._timer
    with ProgressBar("a.glb"):
        pass
    for timer in (first, second):
        timer.join()
    assert said == [] and handler._timer is None


class LaterTimer:
    """A timer that the test fires."""

    started: ClassVar[list[LaterTimer]] = []

    def __init__(self, seconds, function):
        self.seconds, self.fire = seconds, function
        self.started.append(self)

    def start(self):
        pass

    cancel = start


def test_work_that_goes_on_is_a_line_again_until_it_ends(logged, monkeypatch):
    """Lines after 1, 11 and 31 seconds of a clock that the timers move; none of a timer that fires too late."""
    handler, logger, said = logged
    clock = [100.0]
    monkeypatch.setattr(stages.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(stages.threading, "Timer", LaterTimer)
    LaterTimer.started.clear()
    handler.begin()

    def fire():
        timer = LaterTimer.started[-1]
        clock[0] += timer.seconds
        timer.fire()

    logger.setLevel(logging.DEBUG)
    with lasting(logger, "decoding %d images", 4):
        fire()
        progressed(0.25)
        fire()  # 11 seconds after it began
        assert said.pop() == "decoding 4 images ... 11 s, about 33 s left" and said.pop() == "decoding 4 images ..."
    handler.begin()
    with lasting(logger, "reading %s", "a.glb"):
        for _ in range(3):
            fire()
    assert said == ["reading a.glb ...", "reading a.glb ... 11 s", "reading a.glb ... 31 s"]
    fire()
    assert len(said) == 3 and handler._timer is None
    logger.info("metering")  # at once: nothing was said for long
    logger.debug("a detail")  # no stage
    fire()
    assert said[3:] == ["metering ..."] and len(LaterTimer.started) == 7


@pytest.mark.parametrize(("bar", "name"), [(ProgressBar("a.glb"), "a.glb"), (StudyScreen(), "all pairs")])
def test_a_bar_has_the_text_of_the_stage(logged, monkeypatch, bar, name):
    shown = []
    monkeypatch.setattr(progress.sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(bar, "set_bar", lambda *values, **more: shown.append(values))
    logged[1].setLevel(logging.DEBUG)
    with bar:
        logged[1].info("metering the exposure in %d frames", 9)
        assert shown[-1] == (name, 0, None, "metering the exposure in 9 frames")
        with lasting(logged[1], "decoding"):
            progressed(0.25)
    assert shown[-1] == (name, 0, None, "decoding, 25%") and logged[2] == []


@pytest.mark.parametrize(
    "arguments", [["scene.glb"], ["exr:frames"], ["A.OBJ", "--size", "64x36"], ["demo", "rotatoins"]]
)
def test_one_line_says_what_to_type(arguments, taubench):
    code, _, err = taubench(*arguments)
    (line,) = err.splitlines()
    assert code == 2
    assert ("did you mean rotations?" if arguments[0] == "demo" else f"evaluate {arguments[0]}") in line


def test_a_study_without_a_terminal_says_where_a_job_is(monkeypatch):
    monkeypatch.setattr(progress, "LINE_SECONDS", 0.0)
    screen, said = StudyScreen("images"), []
    monkeypatch.setattr(screen, "say", said.append)
    screen.advanced("a", 0)  # the head of a job, whose pairs are not known yet
    assert not said
    screen.job_known("a", "demo/noisy", 0, 12)
    screen.advanced("a", 3)
    (line,) = said
    assert "demo/noisy" in line and "3/12 images" in line
