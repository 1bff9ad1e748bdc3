"""A notebook gives the bits of the command line; a killed notebook leaves nothing half-written."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taubench_gl.folder_lock import lock_holder
from taubench_gl.paths import PACKAGE
from taubench_gl.run import SUMMARY_FILE, load_run

DEMO = PACKAGE.parent / "assets" / "demo.glb"
SETTINGS: dict[str, Any] = {
    "width": 48, "height": 27, "frames": (0, 5), "light_unit": "candela", "exposure": 1.0, "environment": "none",
    "indirect": "none", "shadow_size": 64, "light": "preview", "save": ("masks",),
}  # fmt: skip
OPTIONS = ("--size", "48x27", "--frames", "0:5", "--light-unit", "candela", "--exposure", "1", "--environment", "none",
           "--indirect", "none", "--shadow-size", "64", "--light", "preview", "--save", "masks")  # fmt: skip


def evaluate_by_command(out: Path) -> None:
    command = [sys.executable, "-m", "taubench_gl", "evaluate", str(DEMO), "--out", str(out), *OPTIONS]
    subprocess.run(command, check=True, capture_output=True)


def results(out: Path) -> tuple[list[dict[str, Any]], Any, dict[str, bytes]]:
    """Rows, statistics and masks of a run."""
    run = load_run(out)
    masks = {path.name: path.read_bytes() for path in sorted(out.glob("masks/mask_*.png"))}
    for path in sorted(out.glob("masks/mask_*.npz")):
        with np.load(path) as arrays:
            masks |= {f"{path.name}/{name}": arrays[name].tobytes() for name in arrays}
    assert len(masks) >= 8
    return run.frames, run.summary["curves"], masks


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    out = tmp_path_factory.mktemp("command") / "out"
    evaluate_by_command(out)
    return results(out)


@pytest.fixture
def kernel():
    """(manager, client) of a Python kernel without a notebook around it."""
    pytest.importorskip("ipykernel")
    from jupyter_client.manager import start_new_kernel

    manager, client = start_new_kernel()
    yield manager, client
    client.stop_channels()
    manager.shutdown_kernel(now=True)


def cell(out: Path, **changes: Any) -> str:
    settings = SETTINGS | changes
    return f"from taubench_gl.api import evaluate\nevaluate({str(DEMO)!r}, out={str(out)!r}, **{settings!r})"


@pytest.mark.long
def test_a_notebook_gives_the_bits_of_the_command_line(kernel, expected, tmp_path):
    _, client = kernel
    reply = client.execute_interactive(cell(tmp_path / "out"), timeout=300, output_hook=lambda _: None)
    assert reply["content"]["status"] == "ok", reply["content"]
    assert results(tmp_path / "out") == expected


@pytest.mark.long
def test_a_killed_notebook_leaves_nothing_half_written(kernel, expected, tmp_path):
    """The kernel holds the folder when it is killed; the command line then finishes the run in it."""
    manager, client = kernel
    out = tmp_path / "out"
    client.execute(cell(out, frames=(0, 40)))
    while lock_holder(out) is None:
        assert manager.is_alive()
    while not list(out.glob("masks/mask_*.npz")):
        assert manager.is_alive()
    manager.signal_kernel(signal.SIGKILL)
    manager.provisioner.process.wait()
    assert lock_holder(out) is None and not (out / SUMMARY_FILE).exists()
    for path in out.glob("masks/mask_*.npz"):  # what was being written has a name of its own, beginning with a dot
        with np.load(path) as arrays:
            assert all(arrays[name].size for name in arrays)
    evaluate_by_command(out)
    assert results(out) == expected and not list(out.rglob(".*"))
