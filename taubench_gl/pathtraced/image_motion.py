"""Which reading of a motion pass the images support, where there is neither geometry nor a camera.

The previous image is warped by the motion of each reading and compared with the current one.
"""

from __future__ import annotations

import numpy as np

from taubench_gl.pathtraced.passes import PassMap, PathTracedFrame
from taubench_gl.pathtraced.readings import Reading, corrected_motion, motion_readings

Array = np.ndarray

DIFFERENT_PX = 0.1
"""Median difference, pixels, of two readings that this motion distinguishes."""

BLOCK = 6
"""Side, pixels, of the blocks whose mean errors are compared."""


def compare_images(
    frame: PathTracedFrame, previous: PathTracedFrame, mapping: PassMap
) -> tuple[Reading, tuple[float, float, float]] | str:
    """The reading of the motion pass whose images agree best; or as text why there is none.

    With the mean absolute difference of log(1 + radiance): as the mapping reads the pass, corrected, and by the best
    reading that differs, which must be clearly worse.
    """
    if frame.motion is None or frame.combined is None or previous.combined is None:
        return "there is no motion pass" if frame.motion is None else "there is no combined pass to compare"
    height, width = frame.motion.shape[:2]
    now, before = (np.log1p(np.clip(np.nan_to_num(f.combined[..., :3].astype(np.float64)), 0, None))
                   for f in (frame, previous))  # fmt: skip
    rows, columns = np.indices((height, width))
    valid = np.isfinite(frame.motion).all(axis=-1)
    motion = np.where(valid[..., None], frame.motion, 0.0).astype(np.float64).reshape(-1, 2)
    readings = [reading for reading in motion_readings(mapping) if not reading.zero]
    maps: dict[Reading, Array] = {}
    moved: dict[Reading, Array] = {}
    for reading in readings:
        moved[reading] = corrected_motion(motion, [reading], mapping, frame.size)[0].reshape(height, width, 2)
        x = np.clip(columns + moved[reading][..., 0], -1e6, 1e6)
        y = np.clip(rows + moved[reading][..., 1], -1e6, 1e6)
        inside = valid & (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
        if inside.sum() >= 0.25 * inside.size:
            difference = np.abs(_bilinear(before, x, y) - now).mean(axis=-1)
            maps[reading] = np.where(inside, difference, np.nan)
    if readings[0] not in maps:
        return "most motion leads out of the image as the mapping reads it"
    errors = {reading: float(np.nanmean(m)) for reading, m in maps.items()}
    best = min(errors, key=errors.get)
    differs = [r for r in errors if np.median(np.linalg.norm((moved[r] - moved[best])[valid], axis=-1)) > DIFFERENT_PX]
    if not differs:
        return "most pixels hardly move: every reading is alike"
    if not all(_clearly_less(maps[best], maps[r]) for r in differs):
        return "images of several readings are alike"
    return best, (errors[readings[0]], errors[best], min(errors[r] for r in differs))


def _clearly_less(first: Array, second: Array) -> bool:
    """Whether the mean of ``first`` is below that of ``second`` by three standard errors.

    Over pixels that both have; neighbors depend on one another, so the means of blocks are taken as the sample.
    """
    difference = second - first
    height, width = (n // BLOCK * BLOCK for n in difference.shape)
    blocks = difference[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK)
    blocks = blocks.transpose(0, 2, 1, 3).reshape(-1, BLOCK * BLOCK)
    blocks = blocks[np.isfinite(blocks).sum(axis=1) > BLOCK * BLOCK // 2]
    means = np.nanmean(blocks, axis=1) if len(blocks) else np.zeros(0)
    return len(means) > 8 and float(means.mean()) > 3.0 * float(means.std(ddof=1)) / np.sqrt(len(means))


def _bilinear(image: Array, x: Array, y: Array) -> Array:
    """``image`` (h, w, c) at pixel coordinates, clamped to its edge."""
    height, width = image.shape[:2]
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    x0, y0 = np.minimum(x.astype(int), max(width - 2, 0)), np.minimum(y.astype(int), max(height - 2, 0))
    x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
    fx, fy = (x - x0)[..., None], (y - y0)[..., None]
    top = image[y0, x0] * (1 - fx) + image[y0, x1] * fx
    return top * (1 - fy) + (image[y1, x0] * (1 - fx) + image[y1, x1] * fx) * fy
