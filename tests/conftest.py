"""Shared fixtures: where the real scenes lie (read, never copied) and the GL context."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def _shared_data() -> Path | None:
    """Real third-party scenes beside the checkout, or wherever TAUBENCH_DATA says."""
    candidates = [os.environ.get("TAUBENCH_DATA"), Path(__file__).resolve().parents[2] / "shared" / "data"]
    for candidate in candidates:
        if candidate and Path(candidate).is_dir():
            return Path(candidate)
    return None


DATA = _shared_data()


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of real scenes; tests that need it are skipped, by name, where it is absent."""
    if DATA is None:
        pytest.skip("no real scenes beside the checkout; set TAUBENCH_DATA to their folder")
    return DATA
