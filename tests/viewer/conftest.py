"""A viewer without a window for most tests, and a display of its own (Xvfb) for those that need one."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from viewer_tools import DEMO, QUIET, Driven

from taubench_gl.settings import Settings


@pytest.fixture
def drive(gpu, tmp_path) -> Iterator[Callable[..., Driven]]:
    """drive(scene=DEMO, settings=QUIET, ...) -> Driven; closed at the end."""
    pytest.importorskip("imgui_bundle", reason="the viewer extra is not installed")
    from taubench_gl.viewer.feeds import OpenRequest

    opened = []

    def start(
        scene: Path | str = DEMO, settings: Settings = QUIET, *, window=(700, 500), folder=None, light=None, **more
    ) -> Driven:
        driven = Driven(gpu, OpenRequest(str(scene), settings, **more), window, folder, light)
        driven.viewer.screenshots = tmp_path
        opened.append(driven)
        return driven

    yield start
    for driven in opened:
        driven.close()


@pytest.fixture(scope="session")
def display() -> Iterator[dict[str, str]]:
    """Environment with an X display of its own."""
    pytest.importorskip("glfw", reason="the viewer extra is not installed")
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x800x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as answer:
            number = answer.readline().strip()  # waits until the server is ready; empty where it ended instead
        if not number:
            pytest.skip("Xvfb does not start")
        yield {**os.environ, "DISPLAY": f":{number}", "LP_NUM_THREADS": "1"}
    finally:
        server.terminate()
        server.wait()
