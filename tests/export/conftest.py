"""Frames shared by the tests of formats and motion."""

from __future__ import annotations

import pytest
from export_tools import drawn

from taubench_gl.export.frames import ExportFrame


@pytest.fixture(scope="session")
def frames() -> dict[int, ExportFrame]:
    """Frames 8 to 10 with every channel."""
    return {frame.number: frame for frame in drawn(range(8, 11))}
