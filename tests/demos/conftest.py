"""Every demo runs once at a small size, shared by the tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.demos.demo import Demo, Result
from taubench_gl.demos.gallery import Shown, open_pair, run_demos
from taubench_gl.demos.lessons import DEMOS
from taubench_gl.demos.stage import LitPair, Stage

SIZE = (160, 90)


class Runs:
    """Results by name, computed on first use."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._shown: dict[str, Shown] = {}
        self._pairs: dict[str, LitPair] = {}

    def of(self, demo: Demo, gpu) -> Result:
        return self.shown(demo, gpu).result

    def shown(self, demo: Demo, gpu) -> Shown:
        """The demo with its result and its page, which has no neighbors."""
        if demo.name not in self._shown:
            stage = Stage(gpu, SIZE)
            try:
                self._shown[demo.name] = run_demos(stage, [demo], self.folder)[0]
            finally:
                stage.release()
                gpu.collect()
        return self._shown[demo.name]

    def pair(self, demo: Demo, gpu) -> LitPair:
        """The pair that the page opens at."""
        if demo.name not in self._pairs:
            stage = Stage(gpu, SIZE)
            try:
                self._pairs[demo.name] = open_pair(stage, demo)
            finally:
                stage.release()
                gpu.collect()
        return self._pairs[demo.name]


@pytest.fixture(scope="session")
def runs(tmp_path_factory) -> Runs:
    return Runs(tmp_path_factory.mktemp("demos"))


SLOW = ("cost", "lock", "reservoirs", "samples")


@pytest.fixture(params=[pytest.param(name, marks=pytest.mark.long if name in SLOW else ()) for name in DEMOS])
def demo(request) -> Demo:
    """Each demo in turn."""
    return DEMOS[request.param]
