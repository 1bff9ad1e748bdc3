"""Runs one of the scripts of this package with the Python interpreter that has bpy."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from taubench_gl.errors import PathTracedError
from taubench_gl.outputs import write_atomically

INTERPRETER = "TAUBENCH_BLENDER_PYTHON"
HOW_TO_GET_BPY = (
    f"install bpy 4.5 with Python 3.11 (pip install 'bpy==4.5.*', best in an environment of its own) and point "
    f"{INTERPRETER} at that interpreter"
)
_EVENT = "@tb "
"""Start of the lines by which a script reports events, as JSON; all other output is Blender's."""

_KEPT_LINES = 100


def blender_python() -> str:
    """The interpreter to use: ``TAUBENCH_BLENDER_PYTHON``, else this one.  Not checked for bpy."""
    return os.environ.get(INTERPRETER) or sys.executable


def blender_version(python: str | None = None) -> str | None:
    """Version of the bpy that ``python`` imports; None if it has none."""
    code = f"import bpy; print({_EVENT!r} + bpy.app.version_string)"
    try:
        process = subprocess.run([python or blender_python(), "-c", code], capture_output=True, text=True, timeout=300)
    except (OSError, subprocess.SubprocessError):
        return None
    lines = [line for line in process.stdout.splitlines() if line.startswith(_EVENT)]
    return lines[0].removeprefix(_EVENT).strip() if process.returncode == 0 and lines else None


def require_blender(python: str) -> str:
    """Version of the bpy of ``python``.  Raises PathTracedError if it has none."""
    version = blender_version(python)
    if version is None:
        raise PathTracedError(f"{python} cannot import bpy, Blender's Python module", hint=HOW_TO_GET_BPY)
    return version


def run_script(
    python: str,
    script: str,
    job: dict[str, Any],
    folder: Path,
    on_event: Callable[[dict[str, Any]], None],
    on_line: Callable[[str], None] = lambda line: None,
) -> str | None:
    """Run ``script`` of this package with ``job``, which is written to ``folder``.

    ``on_event`` receives the script's events, ``on_line`` every other line of output.  -> None, or what failed.  If a
    callback raises, the process is terminated; if this process is killed, it ends too.
    """
    job_file = folder / "job.json"
    write_atomically(job_file, json.dumps(job))
    command = [python, str(Path(__file__).with_name(script)), str(job_file)]
    tail: deque[str] = deque(maxlen=_KEPT_LINES)
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,  # closed by the system when this process ends: ``script_shared.py``
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        bufsize=1,
    )
    try:
        for line in process.stdout:
            if line.startswith(_EVENT):
                on_event(json.loads(line.removeprefix(_EVENT)))
                continue
            on_line(line)
            if line.strip():
                tail.append(line.strip())
        code = process.wait()
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait()
        process.stdin.close()
    if code == 0:
        return None
    last = next((line for line in reversed(tail) if "Error" in line), tail[-1] if tail else "no output")
    return f"Blender stopped with code {code}: {last}"
