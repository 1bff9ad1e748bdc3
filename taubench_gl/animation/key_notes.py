"""Notes on how the keys of a scene lie to the frames of a run."""

from __future__ import annotations

import math

import numpy as np

from taubench_gl.animation.curves import LINEAR, STEP, key_tolerance, varies
from taubench_gl.conventions import KEY_TOLERANCE
from taubench_gl.scene.model import Scene

BESIDE = 0.1
"""Distance from a frame, in frame intervals, below which a key was probably meant for the frame."""


def key_notes(scene: Scene, frames: range, fps: float) -> list[str]:
    """Notes on pairs before the first key and on keys beside frames; ``frames`` are those of a run at ``fps``."""
    channels = [channel for channel in scene.channels if varies(channel)]
    if not channels:
        return []
    first = min(float(channel.times[0]) for channel in channels)
    blended = {c.times.tobytes(): c.times for c in channels if c.interpolation in (STEP, LINEAR)}
    times = np.unique(np.concatenate([np.zeros(0), *blended.values()]))
    return [*_early_note(first, frames, fps), *_beside_note(times, fps)]


def frame_of_key(time: float, fps: float) -> int:
    """The first frame at which a key at ``time`` seconds is reached."""
    return max(math.ceil((time - key_tolerance(time, fps)) * fps), 0)


def _early_note(first: float, frames: range, fps: float) -> list[str]:
    begin = frame_of_key(first, fps)
    if len(frames) < 2 or begin <= frames[0]:
        return []
    pairs = min(begin, frames[-1]) - frames[0]
    what = "the first pair lies" if pairs == 1 else f"the first {pairs} pairs lie"
    note = f"{what} before the first key, at {first:.6g} s: no curve has begun"
    return [f"{note}; --frames {begin}:{frames.stop} leaves them out" if begin < frames[-1] else note]


def _beside_note(times: np.ndarray, fps: float) -> list[str]:
    """A note on keys that lie beside the frames; none if there are none.  ``times`` (K,): seconds of distinct keys."""
    off = np.abs(times * fps - np.round(times * fps))
    tolerance = np.maximum(KEY_TOLERANCE, fps * np.spacing(np.abs(times).astype(np.float32)).astype(np.float64))
    beside = (off > tolerance) & (off < BESIDE)
    count = int(np.count_nonzero(beside))
    if not count:
        return []
    keys = "1 key lies" if count == 1 else f"{count} keys lie"
    where = f"{'first: ' * (count > 1)}{times[beside][0]:.6g} s, off by {off[beside][0]:.2g} frames"
    return [f"{keys} beside a frame of {fps:g} fps ({where}), too far to be taken for a key of that frame"]
