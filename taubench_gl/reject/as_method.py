"""A rejection test as a reuse method: a folder with method.toml and reuse.glsl, for ``reuse evaluate``.  No OpenGL.

The method is a running mean; what differs between two of them is the history that they reject.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from taubench_gl.errors import OutputError
from taubench_gl.gpu.shader import resolve
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.reject.contract import RejectionTest, constants

READS = (
    "radiance", "motion", "position", "normal", "prev_position", "ids", "history_position", "history_normal",
    "history_ids",
)  # fmt: skip

TOML = """\
title = "Running mean, history rejected by {title}"
reads = [{reads}]

[history]
accumulated = "rgba32f" # rgb: mean, a: frames in it
moved = "rg32f"         # motion of the frame

[settings.threshold]
default = {threshold!r}
min = 0.0
max = {most!r}
doc = "history is rejected above it"

[settings.cap]
default = 16
min = 1
max = 1000000
scale = "log"
doc = "limit on the frames in the mean"

[[pass]]
shader = "reuse.glsl"
writes = ["accumulated", "moved", "result", "reprojected_history"]
"""


def method_files(test: RejectionTest) -> dict[str, str]:
    """File name -> text of the method's folder."""
    title = test.title.replace('"', "'").replace("\\", "/")
    most = max(1e6, 10.0 * test.threshold)
    reads = ", ".join(f'"{name}"' for name in READS)
    toml = TOML.format(title=title, reads=reads, threshold=float(test.threshold), most=most)
    contract, accumulate = (
        "\n".join(resolve(f"reject/{name}.glsl").text.splitlines()[1:]) for name in ("contract", "accumulate")
    )
    return {"method.toml": toml, "reuse.glsl": "\n\n".join([contract, _difference(test), accumulate]) + "\n"}


def _difference(test: RejectionTest) -> str:
    """``difference`` of a test; of a combination the largest of its parts, each divided by its threshold."""
    if not test.parts:
        return f"{constants(test)}\n{test.shader}"
    texts, values = [], []
    for i, part in enumerate(test.parts):
        text = f"{constants(part)}\n{part.shader}"
        for name in ("difference", *part.settings):
            text = re.sub(rf"\b{name}\b", f"{name}_{i}", text)
        texts.append(text)
        values.append(f"difference_{i}(now, history, pixel) / {max(part.threshold, 1e-30)!r}")
    largest = values[0]
    for value in values[1:]:
        largest = f"max({largest}, {value})"
    entry = f"float difference(Point now, Point history, Pixel pixel) {{ return {largest}; }}"
    return "\n".join([*texts, entry])


def write_methods(tests: Sequence[RejectionTest], out: Path) -> list[Path]:
    """Write a folder for each test into ``out``; the folders.  Raises OutputError for one that exists."""
    folders = [out / f"reject_{test.name.replace('+', '_and_')}" for test in tests]
    for folder in folders:
        if folder.exists():
            raise OutputError("exists", where=str(folder), hint="give --out a new folder")
    for folder, test in zip(folders, tests, strict=True):
        output_folder(folder)
        for name, text in method_files(test).items():
            write_atomically(folder / name, text)
    return folders
