"""Runs a game without a screen."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

_DISPLAY = {"SDL_VIDEODRIVER": "offscreen", "SDL_AUDIODRIVER": "dummy", "LIBGL_ALWAYS_SOFTWARE": "1"}


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
