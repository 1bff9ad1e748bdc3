"""The bound of a method: its own reprojected history and input, blended by the best weight of every pixel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.metrics.blending import (
    blend,
    channels,
    effective_weight,
    nearest_clipped_weight,
    nearest_weight,
    on_segment,
    used_history,
)
from taubench_gl.reuse.comparison import over_frames, over_seeds
from taubench_gl.reuse.quality import WHITE, tail

Array = np.ndarray

NO_HISTORY = (
    "the method does not report reprojected_history, the color that it fetched along the motion (or, if its input has "
    "another size, blend_input)"
)
EXACT = "the bound equals the reference"
NO_PIXEL = "no pixel has history"


def decibels(error: float, bound: float) -> float | None:
    """10 log10(error / bound); None where the bound is 0 or nothing is left to gain from 0."""
    return float(10.0 * np.log10(error / bound)) if bound > 0 and error > 0 else None


@dataclass(frozen=True, slots=True)
class Blended:
    """What one method blended in one frame, linear radiance (h, w, 3).

    ``has_history`` (h, w) bool: the method fetched history there; ``fetched`` is the input elsewhere.  ``used``:
    history after rectification, None where the method does not report it.
    """

    now: Array
    fetched: Array
    has_history: Array
    used: Array | None

    @classmethod
    def of(cls, radiance: Array, reported: Mapping[str, Array], name: str = "reprojected_history") -> Blended | None:
        """What a method blended: ``radiance`` (h, w, 4) of its input and the images of ``MethodRunner.reported``.

        None where it does not report its history ``name`` in the size of the input.
        """
        history = reported.get(name)
        if history is None:
            return None
        now = reported.get("blend_input", radiance)[..., :3].astype(np.float64)
        if now.shape[:2] != history.shape[:2]:  # an upscaler
            return None
        has_history = history[..., 3] > 0.5
        used = reported.get("rectified_history")
        used = None if used is None else np.where(has_history[..., None], used[..., :3], now)
        return cls(now, np.where(has_history[..., None], history[..., :3], now), has_history, used)

    def masked(self, valid: Array) -> tuple[Blended, Array]:
        """Black outside ``valid`` and where input or history is not finite; and the other pixels, (h, w) bool."""
        keep = valid & channels(np.logical_and, np.isfinite(self.now) & np.isfinite(self.fetched))
        if keep.all():
            return self, keep
        now, fetched, used = (
            None if x is None else np.where(keep[..., None], x, 0.0) for x in (self.now, self.fetched, self.used)
        )
        return Blended(now, fetched, self.has_history & keep, used), keep

    def best(self, reference: Array) -> tuple[Array, Array]:
        """The blend nearest to ``reference`` (h, w, 3) in every pixel, and its weight of history, (h, w)."""
        weight = nearest_weight(reference, self.now, self.fetched)
        return blend(self.now, self.fetched, weight), weight


@dataclass(frozen=True, slots=True)
class BoundFrame:
    """The bound of one frame.  Mean squared errors are means over channels and the scored pixels, linear radiance.

    ``mse`` of the bound, ``method_mse`` of the method over the same pixels; ``clipped_*``: of radiance clipped at
    WHITE, by the weights best for it; ``weight``: mean of the best weight; ``blended_percent``: pixels whose result is
    a blend of input and history; ``effective_weight``: mean over all pixels, None where the method reports no weight;
    ``tail``: of the bound's squared error, ``quality.tail``.
    """

    mse: float
    method_mse: float
    clipped_mse: float
    method_clipped_mse: float
    weight: float
    blended_percent: float
    effective_weight: float | None
    tail: tuple[float, float]

    @property
    def row(self) -> dict[str, float | None]:
        """The numbers of this frame by their columns of frames.csv."""
        return {
            "bound_linear_mse": self.mse,
            "headroom_db": decibels(self.method_mse, self.mse),
            "bound_clipped_mse": self.clipped_mse,
            "clipped_headroom_db": decibels(self.method_clipped_mse, self.clipped_mse),
            "bound_weight": self.weight,
            "blended_percent": self.blended_percent,
            "effective_weight": self.effective_weight,
        }


def bound_of_frame(
    blended: Blended, result: Array, reference: Array, valid: Array, emitters: Array | None = None
) -> BoundFrame:
    """The bound of one frame, and the errors of the method beside it.

    ``result`` (h, w, 4): radiance and weight of history; ``reference`` (h, w, 3); ``valid`` (h, w) bool: pixels that
    count, the others are black;
    ``emitters`` (h, w) bool: pixels that errors leave out.
    """
    blended, keep = blended.masked(valid)
    shown, reference = (np.where(keep[..., None], x, 0.0) for x in (result[..., :3].astype(np.float64), reference))
    now, fetched, (image, best) = blended.now, blended.fetched, blended.best(reference)
    clipped = blend(now, fetched, nearest_clipped_weight(reference, now, fetched, WHITE, best))
    scored = np.full(keep.shape, True) if emitters is None or emitters.all() else ~emitters
    errors = [(x - reference)[scored] ** 2 for x in (image, shown)]
    white = np.minimum(reference, WHITE)
    errors += [(np.minimum(x, WHITE) - white)[scored] ** 2 for x in (clipped, shown)]
    effective = None
    if not (result[..., 3] < 0).any():
        weight = np.where(blended.has_history, result[..., 3], 0.0).astype(np.float64)
        used = used_history(shown, now, fetched, weight) if blended.used is None else blended.used
        effective = float(effective_weight(weight, now, fetched, used).mean())
    share = 100.0 * float(np.mean(on_segment(shown, now, fetched)))
    means = (float(np.mean(error)) for error in errors)
    return BoundFrame(*means, float(best.mean()), share, effective, tail(errors[0].mean(axis=-1)))


@dataclass(slots=True)
class BoundRecord:
    """Bounds of the counted frames of one method, by seed."""

    seeds: dict[int, list[BoundFrame]] = field(default_factory=dict)

    def summary(self) -> dict[str, Any] | None:
        """The block ``bound`` of a method in reuse.json; None where it reports no history.

        ``blends``: every pixel of every frame is a blend, so the method cannot be better than its bound;
        ``tail_percent``: share of the bound's squared error in the TAIL_SHARE of the pixels of each frame with most.
        """
        frames = [frame for sequence in self.seeds.values() for frame in sequence]
        if not frames:
            return None

        def mean(name: str) -> float:
            return float(np.mean([getattr(f, name) for f in frames]))

        most, whole = (sum(f.tail[k] for f in frames) for k in (0, 1))
        bound, method_mse = mean("mse"), mean("method_mse")
        return {
            "linear_mse": bound,
            "method_linear_mse": method_mse,
            "headroom_linear_mse": method_mse - bound,
            "headroom_db": decibels(method_mse, bound),
            "clipped_mse": mean("clipped_mse"),
            "method_clipped_mse": mean("method_clipped_mse"),
            "clipped_headroom_db": decibels(mean("method_clipped_mse"), mean("clipped_mse")),
            "tail_percent": 100.0 * most / whole if whole > 0 else None,
            "intervals": {
                "linear_mse": self._interval("mse"),
                "clipped_mse": self._interval("clipped_mse"),
                "headroom_db": self._interval("method_mse", "mse"),
                "clipped_headroom_db": self._interval("method_clipped_mse", "clipped_mse"),
            },
            "weight": mean("weight"),
            "blended_percent": mean("blended_percent"),
            "blends": all(f.blended_percent == 100.0 for f in frames),
        }

    def _interval(self, *names: str) -> dict[str, Any]:
        """Intervals over frames and over seeds of the mean of one field, or of 10 log10 of the ratio of two means."""
        table = np.array([[[getattr(f, n) for n in names] for f in sequence] for sequence in self.seeds.values()])
        if len(names) == 2 and not (table > 0).all():
            return over_frames(table[0, :0], len, table) | over_seeds(table[0, :0])  # no ratio, no interval

        def statistic(means: Array) -> Array:
            return means[..., 0] if len(names) == 1 else 10.0 * np.log10(means[..., 0] / means[..., 1])

        columns = table.mean(axis=0)
        series = columns[:, 0] if len(names) == 1 else np.log(columns[:, 0] / columns[:, 1])
        return over_frames(columns, statistic, series) | over_seeds(statistic(table.mean(axis=1)))
