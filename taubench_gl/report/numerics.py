"""What the renderer's arithmetic avoids: a table recorded by tools/make_numerics.py, which no study measures again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

PATH = Path(__file__).with_name("numerics.json")
SCHEMA = "taubench-gl/numerics/1"


def recorded() -> dict[str, Any]:
    """``renderer``, ``driver``, ``date``, ``size``, and ``rows``: rule, case, its error with the rule and without."""
    return json.loads(PATH.read_text(encoding="utf-8"))
