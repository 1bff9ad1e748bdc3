"""Every demo runs once at a small size, shared by the tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.demos.demo import Demo, Result
from taubench_gl.demos.lessons import demos
from taubench_gl.demos.stage import Stage

SIZE = (160, 90)


class Runs:
    """Results by name, computed on first use."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._results: dict[str, Result] = {}

    def of(self, demo: Demo, gpu) -> Result:
        if demo.name not in self._results:
            stage = Stage(gpu, SIZE)
            try:
                self._results[demo.name] = demo.run(stage, self.folder)
            finally:
                stage.release()
                gpu.collect()
        return self._results[demo.name]


@pytest.fixture(scope="session")
def runs(tmp_path_factory) -> Runs:
    return Runs(tmp_path_factory.mktemp("demos"))


@pytest.fixture(params=[d.name for d in demos()])
def demo(request) -> Demo:
    return next(d for d in demos() if d.name == request.param)
