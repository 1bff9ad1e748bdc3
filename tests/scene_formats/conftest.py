"""Gives access to the float64 ray caster of the frame tests."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "frame"))
