"""What the renderer's arithmetic avoids: a table recorded by tools/record numerics, which no study measures again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from taubench_gl.data_files import read_json

PATH = Path(__file__).with_name("numerics.json")
SCHEMA = "taubench-gl/numerics/1"


def recorded() -> dict[str, Any]:
    """``renderer``, ``driver``, ``date``, ``size``, and ``rows``: rule, case, its error with the rule and without."""
    return read_json(PATH)
