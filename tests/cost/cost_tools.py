"""Helpers shared by the tests of this folder."""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np

from taubench_gl.cost.analysis import MaskError, Point, Time
from taubench_gl.option_groups import OVERALL

SMALL: dict[str, Any] = {
    "width": 48,
    "height": 28,
    "frames": (20, 27),
    "columns": ("frustum", "position", "normal"),
    "repeats": 3,
    "parameters": ("storage", "scale", "pairs"),
}
"""A study of geometry alone, which needs no light."""


SCATTER = (0.0, 0.6745, -0.6745, 1.2, -1.2)
"""Five rounds, standard deviations from the median: 1.4826 times their median absolute deviation is 1."""


def point(name: str, wrong: Any, ms: float, spread: float = 0.01, **more: Any) -> Point:
    """A point with one column, ``direct``, of 1000 pixels.  ``wrong``: how many are, the first ones, or which.

    Its times scatter by ``spread``, in another order than those of other names.
    """
    role = more.pop("role", "baseline" if name == "baseline" else "single")
    mask = np.zeros(1000, dtype=bool)
    mask[slice(wrong) if isinstance(wrong, int) else wrong] = True
    share = 100.0 * float(mask.mean())
    error = MaskError(mask, share, 0.0)
    order = random.Random(name).sample(SCATTER, len(SCATTER))
    time = Time(ms, spread, 5, tuple(ms * math.exp(z * spread / ms) for z in order))
    return Point(name, name, role, {}, {"direct": error, OVERALL: error}, time=time, **more)


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
        noise = random.Random(step.what).uniform(0.99, 1.01)
        self.step = (
            20e-3 * float(values.get("scale", 1.0)) ** 2 * (0.5 if values.get("storage") == "half" else 1) * noise
        )
