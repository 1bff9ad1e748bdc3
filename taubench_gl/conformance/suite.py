"""The suite on disk: scenes, the list of frames and the text of every case."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from taubench_gl.conformance.cases import CAMERA, FPS, FRAMES, Case
from taubench_gl.conformance.truth import Truth
from taubench_gl.data_files import read_bytes
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.pathtraced.cameras import camera_entry

SCHEMA = "taubench-gl/conformance-suite/1"
SUITE_FILE, README, SCENES = "suite.json", "README.md", "scenes"


def case_entry(case: Case, size: tuple[int, int]) -> dict[str, Any]:
    """A case as ``suite.json`` has it: its frames with times, offsets, cuts and cameras."""
    truth, offsets = Truth(case, size), case.offsets(size)
    frames = [
        {"time_s": k / FPS, "jitter_px": (offsets[k] * [1.0, -1.0] + 0.0).tolist(), "cut": k == case.cut,
         "camera": camera_entry(truth.view(k))}
        for k in range(FRAMES)
    ]  # fmt: skip
    return {"name": case.name, "scene": f"{SCENES}/{case.name}.glb", "text": case.text, "classes": list(case.about),
            "scored": "edges" if case.edges else "away from edges", "extensions": list(case.extensions),
            "frames": frames}  # fmt: skip


def write_suite(cases: Sequence[Case], out: str | Path, size: tuple[int, int]) -> Path:
    """Write ``cases`` to the folder ``out``; ``size``: width and height of the frames, pixels.  Raises OutputError."""
    out = output_folder(out)
    output_folder(out / SCENES)
    for case in cases:
        write_atomically(out / SCENES / case.file.name, read_bytes(case.file))
    width, height = size
    head = {"schema": SCHEMA, "width": width, "height": height, "fps": FPS, "camera": CAMERA}
    entries = [case_entry(case, size) for case in cases]
    write_atomically(out / SUITE_FILE, json.dumps(head | {"cases": entries}, indent=1) + "\n")
    listed = "\n\n".join(case_text(case) for case in cases)
    template = resources.files(__package__).joinpath("suite.md").read_text(encoding="utf-8")
    write_atomically(out / README, template.format(
        count=len(cases), frames=FRAMES, width=width, height=height, camera=CAMERA, cases=listed))  # fmt: skip
    return out


def case_text(case: Case) -> str:
    """The page of a case, Markdown."""
    needs = f" Extensions: {', '.join(case.extensions)}." if case.extensions else ""
    scored = "pixels at outlines" if case.edges else "pixels away from outlines"
    cut = f" Frame {case.cut} begins a new shot." if case.cut is not None else ""
    return f"## {case.name}\n\n{case.text}\n\nClasses: {', '.join(case.about)}; scored: {scored}.{needs}{cut}"
