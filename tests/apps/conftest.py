"""The command line in this process, with an evaluation that renders nothing."""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import pytest

from taubench_gl.errors import SceneError
from taubench_gl.run import Progress, Run, RunWriter
from taubench_gl.run_schema import COUNT_COLUMNS


class FakeEvaluate:
    """Replaces ``taubench_gl.api.evaluate``: same signature, files written by RunWriter.

    A scene called ``bad*`` raises SceneError, ``bug*`` a ZeroDivisionError, ``slow*`` is interrupted after two pairs.
    """

    pairs = 4
    duration = 1.0  # seconds

    def __init__(self) -> None:
        self.calls: list[dict[str, Any]] = []

    def __call__(self, scene, settings=None, *, out=None, save=(), progress=None, **overrides) -> Run:
        name = Path(scene).stem
        self.calls.append({"scene": scene, "settings": settings, "out": out, "save": tuple(save), **overrides})
        if name.startswith("bad"):
            raise SceneError("no such thing", where=f"{scene}#/nodes/3", hint="repair it")
        if name.startswith("bug"):
            raise ZeroDivisionError("oops")
        empty = dict.fromkeys(COUNT_COLUMNS, 0) | {"pixels": 10, "camera_cut": 0}
        times = {i: i / settings.sequence.fps for i in range(1, self.pairs + 1)}
        rows = [
            empty | {"frame": i, "time_s": time, "outside": i, "frustum": i, "comparable": 10 - i}
            for i, time in times.items()
        ]
        summary = {
            "schema": "taubench-gl/summary/2",
            "scene": {"name": name, "duration_s": self.duration},
            "settings": {"width": 5, "height": 2, "fps": settings.sequence.fps, "thresholds": {}},
            "pairs": self.pairs,
            "discard": {"frustum": {"mean_percent": 25.0}},
            "notes": [f"a note about {name}"],
        }
        writer = RunWriter(out) if out else None
        if writer:
            writer.__enter__()
        for i, row in enumerate(rows, start=1):
            if name.startswith("slow") and i == 3:
                raise KeyboardInterrupt
            if writer:
                writer.write_row(row)
            if progress:
                progress(Progress(name, i, self.pairs, 0.5))
        if writer:
            writer.write_summary(summary)
            writer.__exit__(None, None, None)
        return Run(summary, rows, out)


@pytest.fixture
def evaluate(monkeypatch) -> FakeEvaluate:
    fake = FakeEvaluate()
    module = types.ModuleType("taubench_gl.api")
    module.evaluate = fake
    monkeypatch.setitem(sys.modules, "taubench_gl.api", module)
    return fake
