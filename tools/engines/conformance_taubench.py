"""Frames of the conformance suite by this project's own rasterizer: the control.

    python tools/engines/conformance_taubench.py SUITE FRAMES [CASE ...]

SUITE: the folder of ``taubench-gl conformance write``; FRAMES: the folder that gets CASE/frame_0000.exr and so on.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from taubench_gl.export.formats import ExportSpec, ExrWriter
from taubench_gl.export.frames import FrameSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

CHANNELS = ("position", "depth", "normal", "motion")


def draw(gpu: Gpu, path: Path, size: tuple[int, int], offsets: np.ndarray) -> list:
    """The frames of one scene as ``ExportFrame``; ``offsets``: (frames, 2) pixels, +x right, +y up."""
    settings = Settings(
        width=size[0], height=size[1], frames=(0, len(offsets)), columns=("frustum",), environment="none", exposure=1.0
    )
    jitter = (lambda frame: offsets[frame]) if np.any(offsets) else "none"
    source = FrameSource(gpu, AnimatedScene(load_scene(path)), settings, CHANNELS, jitter=jitter)
    try:
        return list(source.frames(range(len(offsets))))
    finally:
        source.release()


def main(suite: Path, frames: Path, names: list[str]) -> None:
    """Draw the cases of ``suite``, those of ``names`` alone where there are any."""
    listed = json.loads((suite / "suite.json").read_text(encoding="utf-8"))
    size = (listed["width"], listed["height"])
    with open_gpu() as gpu:
        for case in listed["cases"]:
            if names and case["name"] not in names:
                continue
            offsets = np.array([frame["jitter_px"] for frame in case["frames"]]) * [1.0, -1.0]
            drawn = draw(gpu, suite / case["scene"], size, offsets)
            spec = ExportSpec(case["name"], size, listed["fps"], range(len(drawn)), CHANNELS, "float")
            writer = ExrWriter(frames / case["name"], spec)
            for frame in drawn:
                writer.write(frame)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
