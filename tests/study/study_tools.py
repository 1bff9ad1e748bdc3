"""Helpers shared by the tests of this folder."""

from __future__ import annotations

import functools
import math
import random
from pathlib import Path
from typing import Any

from taubench_gl.effects.decide import decide
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings
from taubench_gl.study.analysis import ColumnError, Point
from taubench_gl.study.clock import Time
from taubench_gl.study.forecast import Seen
from taubench_gl.study.knobs import Situation

DEMO = Path(__file__).resolve().parents[2] / "assets" / "demo.glb"

SMALL: dict[str, Any] = {
    "width": 48,
    "height": 28,
    "frames": (20, 27),
    "columns": ("frustum", "position", "normal"),
    "choose_for": ("position", "normal"),
    "repeats": 3,
    "front": 0,
    "knobs": ("scale", "pairs", "storage", "histogram_bits", "summation", "fps"),
}
"""A study of geometry alone, which needs no light."""


def point(name: str, error: float, ms: float, spread: float | None = 0.01, **more: Any) -> Point:
    """A point with one column, ``direct``."""
    role = more.pop("role", "one")
    column = ColumnError(10.0 + error, error, more.pop("half_width", None))
    return Point(name, name, role, {}, {"direct": column}, Time(ms, spread, 5), "a clock", **more)


def seen(name: str, time: float, error: float, choice: Any = None, *, timed: bool = True, **errors: float) -> Seen:
    """A setting ``time`` times as slow as the base, ``error`` points off in the column ``direct``."""
    return Seen(name, {} if choice is None else choice, math.log(time), {"direct": error} | errors, timed)


@functools.cache
def _demo() -> Scene:
    return load_scene(DEMO)


def situation_of(pairs: int = 10, **settings: Any) -> Situation:
    """The demo scene's, as far as dials ask for it."""
    scene, base = _demo(), Settings(width=64, height=36, **settings)
    return Situation(scene, decide(scene, base), base, pairs)


class ModelClock:
    """Seconds of a machine on which a frame takes 400 ms times its share of pixels and its samples, give or take 1 %.

    ``listen`` hears which setting is in hand.  What a sampled run leaves out, the study takes off itself.  The same
    visit always takes the same time.
    """

    def __init__(self) -> None:
        self.seconds, self.step = 0.0, 0.0

    def __call__(self) -> float:
        self.seconds += self.step
        return self.seconds

    def listen(self, step: Any) -> None:
        words, _, name = step.what.partition(": ")
        if "round" in words or "try" in words:
            choice = dict(part.split("=") for part in name.split(", ") if "=" in part)
            samples = float(choice.get("samples_per_pixel", 16 if name == "best" else 1))
            model = 400e-3 * float(choice.get("scale", 1.0)) ** 2 * samples
            self.step = model * random.Random(step.what).uniform(0.99, 1.01)
