"""Records games that run without a screen."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from taubench_gl.capture.games import read_recording
from taubench_gl.data_files import opened
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.outputs import copy_atomically

_DISPLAY = {"SDL_VIDEODRIVER": "offscreen", "SDL_AUDIODRIVER": "dummy", "LIBGL_ALWAYS_SOFTWARE": "1"}


def recorded(attempt: Callable[[Path], Path | None], map_name: str, seconds: float, out: Path, tries: int) -> Any:
    """Put a recording of at least ``seconds`` to ``out``, and return it decoded.

    ``attempt``: plays in an empty folder -> the file that it made there, if any.  Raises SettingsError for what is no
    name of a map, SceneError if too little is recorded.
    """
    if not map_name.replace("_", "").replace("-", "").isalnum():
        raise SettingsError(f"{map_name!r:.60} is no name of a map", setting="map")
    for _ in range(tries):
        with tempfile.TemporaryDirectory() as home:
            made = attempt(Path(home))
            demo = None if made is None else read_recording(made)[1]
            if made is not None and demo.seconds > seconds - 0.1:
                with opened(made, SceneError) as file:
                    copy_atomically(file, out)
                return demo
    hint = "is it a map of the installed packages, with bots? else raise --limit"
    raise SceneError(f"the game recorded too little in {tries} attempts", where=map_name, hint=hint)


def play(command: list, home: Path, limit: float) -> bool:
    """Run the command in the folder ``home``; False: it was killed after ``limit`` seconds."""
    quiet = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    environment = {**os.environ, **_DISPLAY, "HOME": str(home)}
    process = subprocess.Popen(command, env=environment, cwd=home, start_new_session=True, **quiet)
    try:
        process.wait(limit)
    except subprocess.TimeoutExpired:
        return False
    finally:
        if process.poll() is None:  # it may ignore SIGTERM
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    return True
