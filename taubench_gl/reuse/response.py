"""Response time: the frames after an event until a method's error is a tenth of its peak above its noise floor.

An event is a frame in which history becomes wrong for one of the reasons of EVENTS.  Its pixels are followed along the
motion until a mask discards their history.  Error: squared, linear radiance, mean over the same pixels in all frames
and over seeds.  Noise floor: median of the last quarter of these frames.  docs/reuse-evaluation.md, Response time.
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
ABOVE, DEVIATIONS = 2.0, 3.0
"""A peak below this multiple of the noise floor, or nearer to it than as many standard deviations of the error in the
second half of the frames, is noise: 0 frames."""

MIN_PIXELS, MOST_PIXELS = 16, 1024
"""Pixels of an event below which its error is not measured, and above which evenly spaced ones are followed."""

MIN_AGES = 8
"""Least number of frames for which an event is followed to give a noise floor."""

DRAWS = 199
"""Bootstrap draws of seeds for an interval."""

TOO_SHORT = f"no such event is followed for {MIN_AGES} frames"
NOT_REACHED = "not reached in the first half of the frames after it; the last quarter gives the noise floor"


class EventTracker:
    """Follows the pixels of events through the frames of a sequence.

    ``changes``: ``born``, ``moved`` and ``killed`` -> number of lights per pair of frames, as of
    ``effects.census``; empty: not known.
    """

    def __init__(self, changes: Mapping[str, Sequence[int]]):
        self._changes = changes
        self.begin()

    def begin(self) -> None:
        """The next frame is the first of the sequence."""
        self._ids, self._index = None, 0

    def advance(self, mask: Array, motion_px: Array, scored: Array) -> Array:
        """Number of the followed point that each pixel shows, (h, w) int64, -1: none; // MOST_PIXELS is its event: the
        frame x len(EVENTS) + the place in EVENTS.

        ``mask`` (h, w): exact reason words; ``motion_px`` (h, w, 2); ``scored`` (h, w) bool: pixels that events have.
        """
        ids = np.full(mask.shape, -1)
        if self._ids is not None:
            ids = np.where(reusable(mask), history_of(self._ids, motion_px), -1)
            free = scored.copy()
            for place, (bits, change, _) in enumerate(EVENTS.values()):
                if change is None or any(self._changes.get(change, ())[self._index - 1 : self._index]):
                    found = free & ((mask & np.uint32(bits)) != 0)
                    ids[found], free[found] = -1, False
                    at = np.flatnonzero(found)
                    at = at[:: -(-len(at) // MOST_PIXELS) or 1]
                    ids.flat[at] = (self._index * len(EVENTS) + place) * MOST_PIXELS + np.arange(len(at))
        self._ids, self._index = ids, self._index + 1
        return ids


def response_frames(errors: Array, floor: float | None = None) -> Array:
    """Frames until ``errors`` (..., ages) are a tenth of their peak above ``floor``; nan: never.  -> (...,) float64.

    ``floor``: None: the median of the last quarter; then the peak is that of the first quarter, and a response has to
    be in the first half.
    """
    errors, ages = np.asarray(errors, dtype=np.float64), np.shape(errors)[-1]
    early, seen, base, noise = errors, errors, np.full(errors.shape[:-1], floor or 0.0), 0.0
    if floor is None:
        early, seen, late = errors[..., : ages // 4], errors[..., : ages // 2], errors[..., ages // 2 :]
        base, noise = np.median(errors[..., -(ages // 4) :], axis=-1), DEVIATIONS * late.std(axis=-1)
    start, peak = early.argmax(axis=-1), early.max(axis=-1)
    level = base + TENTH * (peak - base)
    reached = (seen <= level[..., None]) & (np.arange(seen.shape[-1]) >= start[..., None])
    frames = np.where(reached.any(axis=-1), reached.argmax(axis=-1), np.nan)
    return np.where((peak > ABOVE * base) & (peak - base > noise), frames, 0.0)


@dataclass(slots=True)
class ResponseRecord:
    """Errors of one method after events, seed by seed and frame by frame."""

    _seeds: list[dict[int, Array]] = field(default_factory=list)  # event -> mean errors (ages,)
    _errors: dict[int, list[Array]] = field(default_factory=dict)  # of the present seed, by age and point; nan: lost

    def add(self, ids: Array, error: Array) -> None:
        """Add one frame: ``ids`` of ``EventTracker``; ``error`` (h, w)."""
        points, at = np.unique(ids[ids >= 0], return_inverse=True)
        means, events = np.bincount(at, error[ids >= 0]) / np.bincount(at), points // MOST_PIXELS
        for event in np.unique(events).tolist():
            of_event = events == event
            if np.count_nonzero(of_event) >= MIN_PIXELS:
                by_point = np.full(MOST_PIXELS, np.nan, dtype=np.float32)
                by_point[points[of_event] % MOST_PIXELS] = means[of_event]
                self._errors.setdefault(event, []).append(by_point)

    def end(self) -> None:
        """The sequence of a seed is complete: mean errors of the MIN_PIXELS or more points followed longest."""
        tables = {event: np.stack(errors) for event, errors in self._errors.items()}
        self._seeds.append({e: t[:, np.isfinite(t[-1])].mean(axis=1, dtype=np.float64) for e, t in tables.items()})
        self._errors = {}

    def summary(self) -> dict[str, Any]:
        """The block ``response`` of a method in reuse.json: event -> frames, their interval over seeds, and the curve.

        Empty without events.
        """
        out: dict[str, Any] = {}
        for place, name in enumerate(EVENTS):
            events = [event for event in (self._seeds or [{}])[0] if event % len(EVENTS) == place]
            if events:
                out[name] = _summary([np.stack([curves[event] for curves in self._seeds]) for event in events])
        return out


def _summary(events: Sequence[Array]) -> dict[str, Any]:
    """What ``ResponseRecord.summary`` says of the events of one reason: errors (seeds, ages) of each."""
    errors = [of_event for of_event in events if of_event.shape[1] >= MIN_AGES]
    seeds, low, high, interval_reason = len(events[0]), None, None, FEW_SEEDS
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
    ages = int(np.median([of_event.shape[1] for of_event in errors])) if errors else 0
    long = [of_event[:, :ages].mean(axis=0) for of_event in errors if of_event.shape[1] >= ages]
    return {
        "events": len(events), "followed": len(errors),
        "frames": float(reached.mean()) if len(reached) else None, "low": low, "high": high,
        "never_percent": 100.0 * float(np.mean(np.isnan(frames))) if len(errors) else None,
        "reason": None if len(reached) else NOT_REACHED if errors else TOO_SHORT, "interval_reason": interval_reason,
        "curve": np.mean(long, axis=0).tolist() if long else [],
    }  # fmt: skip
