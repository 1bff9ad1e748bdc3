"""Helpers shared by the tests of this folder."""

from __future__ import annotations

import random
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


class ModelClock:
    """Seconds of a machine on which a visit takes 20 ms times its share of pixels and its samples, give or take 1 %.

    ``listen`` gets the progress of a study, so the same visit takes the same time in every run.
    """

    def __init__(self) -> None:
        self.seconds = self.step = 0.0

    def __call__(self) -> float:
        self.seconds += self.step
        return self.seconds

    def listen(self, step: Any) -> None:
        name = step.what.partition(": ")[2]
        values = dict(part.split("=") for part in name.split(", ") if "=" in part)
        samples = float(values.get("samples_per_pixel", 16 if name == "highest_quality" else 1))
        noise = random.Random(step.what).uniform(0.99, 1.01)
        self.step = 20e-3 * float(values.get("scale", 1.0)) ** 2 * samples * noise
