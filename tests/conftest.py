"""Shared fixtures: the folder of real scenes, which is only read, the GL context, and the browser."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from taubench_gl.gpu.context import Gpu


def _shared_data() -> Path | None:
    """Folder of third-party scenes: TAUBENCH_DATA, else shared/data beside the checkout."""
    candidates = [os.environ.get("TAUBENCH_DATA"), Path(__file__).resolve().parents[2] / "shared" / "data"]
    for candidate in candidates:
        if candidate and Path(candidate).is_dir():
            return Path(candidate)
    return None


DATA = _shared_data()


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of real scenes; tests that need it are skipped without it."""
    if DATA is None:
        pytest.skip("no folder of real scenes; set TAUBENCH_DATA")
    return DATA


@pytest.fixture(scope="session")
def session_gpu() -> Gpu:
    from taubench_gl.gpu.context import open_gpu

    return open_gpu()


@pytest.fixture
def gpu(session_gpu: Gpu) -> Iterator[Gpu]:
    """The current GL context; the test fails on a GL error."""
    with session_gpu:
        assert session_gpu.ctx.error == "GL_NO_ERROR"
        yield session_gpu
        session_gpu.check("the test")


CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Headless Chromium; skips where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    with playwright.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


def _fix_lighting_defaults() -> None:
    """Settings made in tests have the lighting of ``FIXED_LIGHTING`` and the raster method unless they name another.

    Numbers of most tests are for intensities as written, exposure 1, no environment and no path-traced light.
    Tests of ``auto`` name it; those that start a process get the defaults of users.
    """
    from taubench_gl.settings import FIXED_LIGHTING, LightingSettings

    init = LightingSettings.__init__
    names = init.__code__.co_varnames[1 : init.__code__.co_argcount]
    fixed = FIXED_LIGHTING | {"light": "raster"}
    given = zip(names, init.__defaults__, strict=True)
    init.__defaults__ = tuple(fixed.get(name, default) for name, default in given)


_fix_lighting_defaults()
