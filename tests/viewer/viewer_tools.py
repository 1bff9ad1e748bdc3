"""Helpers of the viewer tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from taubench_gl.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "assets" / "demo.glb"
SIZE = (96, 54)
QUIET = Settings(width=SIZE[0], height=SIZE[1], columns=("frustum", "position", "normal"))


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

    def close(self) -> None:
        self.viewer.close()
        self._gpu.unbind_framebuffer()
        self._framebuffer.release()
        self._texture.release()


def pixels(path: Path) -> np.ndarray:
    import imageio.v3 as iio

    return iio.imread(path)
