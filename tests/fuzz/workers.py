"""Worker process of the fuzz tests, with limits of memory and processor time.

``python workers.py gltf|exr|aff|obj FOLDER SECONDS GIBIBYTES``: reads every file of FOLDER in turn and prints one JSON
line each: ``{"file", "verdict", "error"}``, verdict one of ``read``, ``rejected``.  Other errors end the process.
"""

from __future__ import annotations

import json
import os
import resource
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("LP_NUM_THREADS", "1")


def evaluate_file(path: Path) -> None:
    """Load and evaluate a scene; the classes of every pair must add up."""
    import numpy as np

    from taubench_gl.evaluation import evaluate_scene
    from taubench_gl.metrics.counts import CLASSES
    from taubench_gl.settings import Settings

    columns = ("frustum", "position", "normal", "direct", "color")
    settings = Settings(
        width=24, height=16, fps=4, frames=(0, 3), reprojection="motion", columns=columns, shadow_size=32,
        indirect="none", exposure=1.0, light="raster", backend="egl",
    )  # fmt: skip
    with np.errstate(all="ignore"):
        run = evaluate_scene(path, settings)
    for row in run.frames:
        assert sum(row[name] for name in CLASSES) == row["pixels"] == 24 * 16, row
        assert row["position"] <= row["comparable"], row


def read_image(path: Path) -> None:
    """Read an EXR file; every channel must have the size of the image."""
    from taubench_gl.pathtraced.exr import read_exr

    image = read_exr(path)
    for name in image.names:
        assert image.plane(name).shape == (image.size[1], image.size[0])


KINDS = {"gltf": (".gltf", ".glb"), "exr": (".exr",), "aff": (".aff",), "obj": (".obj", ".seq")}
"""Suffixes of the files and folders to read, by kind."""


def main(kind: str, folder: str, seconds: str, gibibytes: str) -> None:
    limit = int(float(gibibytes) * 2**30)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds)))
    from taubench_gl.errors import TaubenchError

    read = {"exr": read_image}.get(kind, evaluate_file)
    for path in sorted(Path(folder).iterdir()):
        if path.suffix not in KINDS[kind] or path.name == "part.aff":
            continue
        print(json.dumps({"file": path.name}), flush=True)  # the last name printed is the file that ended the process
        error = None
        try:
            read(path)
        except TaubenchError as rejected:
            error = str(rejected)
            assert "\n" not in error and error
        print(json.dumps({"file": path.name, "verdict": "rejected" if error else "read", "error": error}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
