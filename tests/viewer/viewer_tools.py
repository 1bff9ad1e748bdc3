"""Helpers of the viewer tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from fixed import fixed_settings

from taubench_gl.run_schema import COUNT_COLUMNS
from taubench_gl.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "assets" / "demo.glb"
SIZE = (96, 54)
QUIET = fixed_settings(width=SIZE[0], height=SIZE[1], columns=("frustum", "position", "normal"))


_ROWS: dict[tuple[int, str], dict] = {}


def evaluated(frame: int, settings: Settings = QUIET) -> dict:
    """The row of frames.csv that ``evaluate`` gives for ``frame`` of the demo; evaluated once."""
    from taubench_gl.evaluation import evaluate_scene

    key = frame, str(settings.to_dict())
    if key not in _ROWS:
        _ROWS[key] = evaluate_scene(DEMO, settings.replace(frames=(frame - 1, frame + 1))).frames[0]
    return _ROWS[key]


class Driven:
    """A viewer that draws into a framebuffer, driven by a ScriptRunner."""

    def __init__(self, gpu, request, window, folder, light):
        from taubench_gl.viewer.app import Viewer
        from taubench_gl.viewer.script import ScriptRunner

        self.viewer = Viewer(gpu, request, light=light, folder=folder)
        self.viewer.window_size = window
        self._texture = gpu.ctx.texture((1280, 720), 4)
        self._framebuffer = gpu.ctx.framebuffer([self._texture])
        self.lines: list[str] = []
        self.runner = ScriptRunner(
            self.viewer, lambda: self.viewer.draw(self._framebuffer), lambda w, h: (w, h), self.lines.append
        )
        self._gpu = gpu

    def run(self, text: str) -> None:
        from taubench_gl.viewer.script import parse

        path = Path(self.viewer.screenshots) / "script.txt"
        path.write_text(text)
        self.runner.run(parse(path))

    @property
    def state(self):
        return self.viewer.state

    @property
    def engine(self):
        return self.viewer.engine

    def counts_are_those_of(self, row: dict, *names: str) -> bool:
        """Whether the counts of the pair shown are those of a row: all that were measured, or only ``names``."""
        columns = names or COUNT_COLUMNS
        return [self.engine.counts[n] for n in columns if row[n] is not None] == [
            row[n] for n in columns if row[n] is not None
        ]

    def close(self) -> None:
        self.viewer.close()
        self._gpu.unbind_framebuffer()
        self._framebuffer.release()
        self._texture.release()


def pixels(path: Path) -> np.ndarray:
    import imageio.v3 as iio

    return iio.imread(path)
