"""``reuse check``: runs a method on a small synthetic sequence; ``reuse new``: writes an example method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taubench_gl.data_files import read_bytes
from taubench_gl.errors import OutputError
from taubench_gl.gpu.context import Gpu
from taubench_gl.outputs import cannot_write, write_atomically
from taubench_gl.paths import PACKAGE
from taubench_gl.reuse.contract import Method, Value
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.synthetic import Uploader, synthetic_steps

SIZE, FRAMES, CUT_AT, NOISE = (96, 54), 12, 8, 0.3
_TEMPLATE = PACKAGE / "reuse" / "template"


@dataclass(frozen=True, slots=True)
class CheckReport:
    """Result of a test run.  Errors are RMS errors of linear radiance against the noise-free frames."""

    method: Method
    frames: int
    size: tuple[int, int]
    error: float
    error_without_reuse: float
    reused: float | None  # mean weight of history, None if not reported


def check_method(
    gpu: Gpu, source: str | Path | type | Method, settings: Mapping[str, Value] | None = None
) -> CheckReport:
    """Run a method, as for ``load_method``, over FRAMES noisy frames with a cut.  Raises MethodError."""
    method = load_method(source)
    squares, plain, reused = [], [], []
    with MethodRunner(gpu, method, SIZE, settings) as runner, Uploader(gpu, SIZE) as uploader:
        for step in synthetic_steps(SIZE, FRAMES, noise=NOISE, cut_at=CUT_AT):
            result = read_result(runner.step(uploader.frame(step)))
            squares.append(np.mean((result[..., :3] - step.clean) ** 2, dtype=np.float64))
            plain.append(np.mean((step.inputs["radiance"][..., :3] - step.clean) ** 2))
            reused.append(result[..., 3])
    weight = np.stack(reused)
    return CheckReport(
        method=method,
        frames=FRAMES,
        size=SIZE,
        error=float(np.sqrt(np.mean(squares))),
        error_without_reuse=float(np.sqrt(np.mean(plain))),
        reused=None if (weight < 0).all() else float(weight[weight >= 0].mean(dtype=np.float64)),
    )


def write_example(path: Path, python: bool = False) -> list[Path]:
    """A working method at ``path``: a folder with method.toml and GLSL, or for ``python`` one file.

    -> the files.  Raises OutputError if the path exists or cannot be written.
    """
    path = path.with_name(f"{path.name}.py") if python and path.suffix != ".py" else path
    if path.exists():
        raise OutputError("exists", where=str(path), hint="choose another name")
    templates = {"method.py": path} if python else {name: path / name for name in ("method.toml", "reuse.glsl")}
    new_files: list[Path] = []
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not python:
            path.mkdir()
        for name, target in templates.items():
            write_atomically(target, read_bytes(_TEMPLATE / name))
            new_files.append(target)
    except (OSError, OutputError) as error:
        for target in new_files:
            target.unlink(missing_ok=True)
        if not python and path.is_dir() and not any(path.iterdir()):
            path.rmdir()
        raise (cannot_write(path, error) if isinstance(error, OSError) else error) from None
    return new_files
