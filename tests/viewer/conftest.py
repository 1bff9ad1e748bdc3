"""A viewer without a window; those that need one have ``display`` of tests/conftest.py."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from viewer_tools import DEMO, QUIET, Driven

from taubench_gl.settings import Settings

sys.path.append(str(Path(__file__).parents[1] / "pathtraced"))  # foreign_frames


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
