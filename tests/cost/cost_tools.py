"""Helpers shared by the tests of this folder."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

from taubench_gl.cost.analysis import ColumnError, Point
from taubench_gl.cost.clock import Time
from taubench_gl.cost.parameters import Situation
from taubench_gl.effects.decide import decide
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

DEMO = Path(__file__).resolve().parents[2] / "assets" / "demo.glb"

SMALL: dict[str, Any] = {
    "width": 48,
    "height": 28,
    "frames": (20, 27),
    "columns": ("frustum", "position", "normal"),
    "choose_for": ("position", "normal"),
    "repeats": 3,
    "knobs": ("scale", "pairs", "storage", "samples_per_pixel", "fps"),
}
"""A study of geometry alone, which needs no light."""


def point(name: str, error: float, ms: float, spread: float | None = 0.01, **more: Any) -> Point:
    """A point with one column, ``direct``."""
    role = more.pop("role", "one")
    column = ColumnError(10.0 + error, error, more.pop("half_width", None))
    return Point(name, name, role, {}, {"direct": column}, Time(ms, spread, 5), "a clock", **more)


@functools.cache
def _demo() -> Scene:
    return load_scene(DEMO)


def situation_of(pairs: int = 10, **settings: Any) -> Situation:
    """The demo scene's, as far as dials ask for it."""
    scene, base = _demo(), Settings.of(width=64, height=36, **settings)
    return Situation(scene, decide(scene, base), base, pairs)
