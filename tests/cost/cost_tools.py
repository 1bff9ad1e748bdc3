"""Helpers shared by the tests of this folder."""

from __future__ import annotations

from typing import Any

from taubench_gl.cost.analysis import ColumnError, Point, Time

SMALL: dict[str, Any] = {
    "width": 48,
    "height": 28,
    "frames": (20, 27),
    "columns": ("frustum", "position", "normal"),
    "choose_for": ("position", "normal"),
    "repeats": 3,
    "parameters": ("scale", "pairs", "storage", "samples_per_pixel", "fps"),
}
"""A study of geometry alone, which needs no light."""


def point(name: str, error: float, ms: float, spread: float | None = 0.01, **more: Any) -> Point:
    """A point with one column, ``direct``."""
    role = more.pop("role", "baseline" if name == "baseline" else "single")
    column = ColumnError(10.0 + error, error, more.pop("half_width", None))
    return Point(name, name, role, {}, {"direct": column}, Time(ms, spread, 5), "a clock", **more)
