"""Every demo runs once at a small size, shared by the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from taubench_gl.demos.demo import Demo, Result
from taubench_gl.demos.gallery import Shown, run_demos
from taubench_gl.demos.lessons import DEMOS
from taubench_gl.demos.stage import LitPair, Stage

SIZE = (160, 90)
SLOW = ("cost", "jitter", "lock", "noise", "reservoirs", "samples")


class Runs:
    """Pages and pairs of demos, made on first use."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._kept: dict[tuple[str, str], Any] = {}

    def _once(self, kind: str, demo: Demo, gpu, make: Callable[[Stage], Any]) -> Any:
        if (kind, demo.name) not in self._kept:
            stage = Stage(gpu, SIZE)
            try:
                self._kept[kind, demo.name] = make(stage)
            finally:
                stage.release()
                gpu.collect()
        return self._kept[kind, demo.name]

    def shown(self, demo: Demo, gpu) -> Shown:
        """The demo with its result and its page, which has no neighbors."""
        return self._once("page", demo, gpu, lambda stage: run_demos(stage, [demo], self.folder)[0])

    def of(self, demo: Demo, gpu) -> Result:
        """The numbers and the figure of a demo."""
        return self.shown(demo, gpu).result

    def pair(self, demo: Demo, gpu) -> LitPair:
        """The pair that the page opens at."""
        return self._once("pair", demo, gpu, demo.open_pair)


@pytest.fixture(scope="session")
def runs(tmp_path_factory) -> Runs:
    return Runs(tmp_path_factory.mktemp("demos"))


@pytest.fixture(params=[pytest.param(name, marks=pytest.mark.long if name in SLOW else ()) for name in DEMOS])
def demo(request) -> Demo:
    """Each demo in turn."""
    return DEMOS[request.param]
