"""Response time: the frames after an event until a method's error is a tenth of its peak above its noise floor.

An event is a frame in which history becomes wrong for one of the reasons of EVENTS.  Its pixels are followed along the
motion until a mask discards their history.  Error: squared, linear radiance, mean over these pixels and over seeds.
Noise floor: median of the last quarter of the frames that follow them.  docs/reuse-evaluation.md, Response time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.metrics.bootstrap import CONFIDENCE
from taubench_gl.reuse.comparison import FEW_SEEDS, MIN_SEEDS
from taubench_gl.reuse.quality import history_of, reusable

Array = np.ndarray

EVENTS: dict[str, tuple[int, str | None, str]] = {
    "cut": (int(Reason.CUT), None, "a declared cut"),
    "disoccluded": (int(Reason.DISOCCLUDED), None, "was hidden in the previous frame"),
    "light_born": (int(Reason.LIT), "born", "direct light increased in a frame in which a light goes on"),
    "light_killed": (int(Reason.SHADOWED), "killed", "direct light decreased in a frame in which a light goes off"),
    "light_moved": (int(Reason.DIRECT), "moved", "direct light changed in a frame in which a light moves"),
}
"""Name -> (bits of the exact mask, change of lights that the frame must have, meaning).  A pixel has the first one."""

TENTH = 0.1
ABOVE = 2.0
"""An error that is at no time above this multiple of its noise floor has not been disturbed: 0 frames."""

MIN_PIXELS = 16
"""Fewer pixels of an event do not show its error."""

MIN_AGES = 8
"""An event that is followed for fewer frames gives no noise floor."""

DRAWS = 199
"""Bootstrap draws of seeds for an interval."""

TOO_SHORT = f"no such event is followed for {MIN_AGES} frames"
NOT_REACHED = "not reached in the first half of the frames after it; the last quarter gives the noise floor"


class EventTracker:
    """Which event each pixel of a frame has had last, along the frames of a sequence.

    ``changes``: ``born``, ``moved`` and ``killed`` -> number of lights per pair of frames, as of
    ``effects.census``; empty: not known.
    """

    def __init__(self, changes: Mapping[str, Sequence[int]]):
        self._changes, self._events, self._index = changes, None, 0

    def begin(self) -> None:
        """The next frame is the first of the sequence."""
        self._events, self._index = None, 0

    def advance(self, mask: Array, motion_px: Array) -> Array:
        """Key of the event of each pixel, (h, w) int64: its frame x len(EVENTS) + place in EVENTS; -1: none.

        ``mask`` (h, w): exact reason words; ``motion_px`` (h, w, 2).
        """
        if self._events is None:
            events = np.full(mask.shape, -1)
        else:
            events = np.where(reusable(mask), history_of(self._events, motion_px), -1)
            for place, (bits, change, _) in reversed(list(enumerate(EVENTS.values()))):
                if change is None or any(self._changes.get(change, ())[self._index - 1 : self._index]):
                    events[(mask & np.uint32(bits)) != 0] = self._index * len(EVENTS) + place
        self._events, self._index = events, self._index + 1
        return events


def response_frames(errors: Array, floor: Array | float | None = None) -> Array:
    """Frames until ``errors`` (..., ages) are a tenth of their peak above ``floor``; nan: never.  -> (...,) float64.

    ``floor``: None: the median of the last quarter; then the peak is that of the first quarter, and a response has to
    be in the first half.
    """
    errors, ages = np.asarray(errors, dtype=np.float64), np.shape(errors)[-1]
    early, seen = errors, errors
    if floor is None:
        early, seen, late = errors[..., : ages // 4], errors[..., : ages // 2], errors[..., -(ages // 4) :]
        floor = np.median(late, axis=-1)
    floor = np.broadcast_to(floor, errors.shape[:-1])
    start, peak = early.argmax(axis=-1), early.max(axis=-1)
    level = floor + TENTH * (peak - floor)
    reached = (seen <= level[..., None]) & (np.arange(seen.shape[-1]) >= start[..., None])
    frames = np.where(reached.any(axis=-1), reached.argmax(axis=-1), np.nan)
    return np.where(peak > ABOVE * floor, frames, 0.0)


@dataclass(slots=True)
class ResponseRecord:
    """Errors of one method after events, seed by seed and frame by frame."""

    _seeds: list[list[tuple[Array, Array, Array]]] = field(default_factory=list)  # keys, pixels, sums of their errors

    def begin(self) -> None:
        """The next frame is the first of the sequence of another seed."""
        self._seeds.append([])

    def add(self, events: Array, error: Array) -> None:
        """Add one frame: ``events`` of ``EventTracker``, -1 where a pixel does not count; ``error`` (h, w)."""
        keys, at = np.unique(events[events >= 0], return_inverse=True)
        self._seeds[-1].append((keys, np.bincount(at), np.bincount(at, error[events >= 0])))

    def curves(self) -> dict[int, tuple[Array, Array]]:
        """Key -> pixels (ages,) and mean errors (seeds, ages) of an event, as long as it has MIN_PIXELS."""
        found: dict[int, list[tuple[int, list[float]]]] = {}
        for steps in zip(*self._seeds, strict=True):
            keys, counts, _ = steps[0]
            for place, (key, count) in enumerate(zip(keys.tolist(), counts.tolist(), strict=True)):
                found.setdefault(key, []).append((count, [sums[place] / count for *_, sums in steps]))
        out = {}
        for key, ages in found.items():
            few = next((age for age, (count, _) in enumerate(ages) if count < MIN_PIXELS), len(ages))
            if few:
                out[key] = np.array([count for count, _ in ages[:few]]), np.array([e for _, e in ages[:few]]).T
        return out

    def summary(self) -> dict[str, Any]:
        """The block ``response`` of a method in reuse.json: event -> frames, their interval over seeds, and the curve.

        Empty without events.
        """
        curves, out = self.curves(), {}
        for place, name in enumerate(EVENTS):
            events = [curve for key, curve in curves.items() if key % len(EVENTS) == place]
            if events:
                out[name] = _summary(events)
        return out


def _summary(events: Sequence[tuple[Array, Array]]) -> dict[str, Any]:
    """What ``ResponseRecord.summary`` says of the events of one reason: pixels (ages,) and errors (seeds, ages)."""
    errors = [of_event for _, of_event in events if of_event.shape[1] >= MIN_AGES]
    seeds, low, high, interval_reason = len(events[0][1]), None, None, FEW_SEEDS
    frames = np.array([response_frames(of_event.mean(axis=0)) for of_event in errors])
    reached = frames[np.isfinite(frames)]
    if seeds >= MIN_SEEDS and len(reached):
        draws = np.random.default_rng(0).integers(seeds, size=(DRAWS, seeds))
        drawn = np.stack([response_frames(of_event[draws].mean(axis=1)) for of_event in errors])
        count = np.isfinite(drawn).sum(axis=0)
        interval_reason = None if count.all() else NOT_REACHED
        if count.all():
            ends = 50.0 * (1.0 - CONFIDENCE), 50.0 * (1.0 + CONFIDENCE)
            low, high = np.percentile(np.nansum(drawn, axis=0) / count, ends).tolist()
    longest = max(len(pixels) for pixels, _ in events)
    total = np.zeros((2, longest))
    for pixels, of_event in events:
        total[:, : len(pixels)] += pixels, pixels * of_event.mean(axis=0)
    return {
        "events": len(events), "followed": len(errors),
        "frames": float(reached.mean()) if len(reached) else None, "low": low, "high": high,
        "never_percent": 100.0 * float(np.mean(np.isnan(frames))) if len(errors) else None,
        "reason": None if len(reached) else NOT_REACHED if errors else TOO_SHORT, "interval_reason": interval_reason,
        "curve": (total[1] / total[0]).tolist(),
    }  # fmt: skip
