"""Forward warping of one image by splatting, for methods that generate frames: NumPy, row 0 at the top, y down.

The surface nearest to the camera wins a pixel, as with atomicMin on a buffer of packed depth and index.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.reuse.frame import FAR_AWAY_PX

Array = np.ndarray

REACH_PX = 0.6
"""A sample covers pixel centers up to this far in x and y: no cracks up to magnification 1.2; edges grow by 0.1."""

BACKGROUND = 1.1
"""Depths that differ by less than this factor are of one surface, or equally far."""


@dataclass(frozen=True, slots=True)
class Splatted:
    """An image seen from elsewhere.

    ``at`` (h, w, 2): the point of the source image that each pixel shows, and ``source`` the pixel that it is of; in
    holes the same pixel.  ``depth`` (h, w): of what it shows, inf in holes and for the sky; ``covered`` (h, w) bool:
    False in holes; ``nearness`` (h, w): 1 / depth of the source image.
    """

    at: Array
    source: Array
    depth: Array
    covered: Array
    nearness: Array

    def values(self, image: Array, helpers: Any) -> Array:
        """``image`` (h, w, n) of the source; holes have the values of their background.

        Bilinear between pixels, but not over edges, where depths differ.  ``helpers``: ``frame["helpers"]``.
        """
        near = 1.0 / self.depth
        mixed = np.abs(helpers.sample(self.nearness[..., None], self.at)[..., 0] - near) > (BACKGROUND - 1) * near
        values = helpers.sample(image, np.where(mixed[..., None], self.source, self.at))
        return values[tuple(background(self.covered, self.depth))]


def moving(motion: Array) -> Array:
    """Motion (h, w, 2) with 0 where a surface has no position in the other frame, pixels."""
    return np.where(np.abs(motion) < 0.5 * FAR_AWAY_PX, motion, 0.0)


def splat(at: Array, depth: Array) -> Splatted:
    """The image whose pixels move to ``at`` (h, w, 2), pixels, NaN: nowhere.

    ``depth`` (h, w): distance from the camera in the new image, 0 or inf: sky, behind everything.
    """
    height, width = depth.shape
    depth = np.where(depth > 0, depth, np.inf).astype(np.float32)
    number = np.arange(depth.size, dtype=np.uint64).reshape(depth.shape)
    packed, empty = depth.view(np.uint32).astype(np.uint64) << np.uint64(32) | number, np.uint64(2**64 - 1)
    buffer = np.full(depth.size, empty)
    low = np.floor(np.nan_to_num(at, nan=-2.0 * max(depth.shape)))
    for corner in ((0, 0), (1, 0), (0, 1), (1, 1)):
        pixel = low + corner
        hit = (np.abs(pixel - at) <= REACH_PX).all(axis=-1)
        hit &= ((pixel >= 0) & (pixel < [width, height])).all(axis=-1)
        x, y = pixel[hit].astype(np.int64).T
        np.minimum.at(buffer, y * width + x, packed[hit])
    buffer = buffer.reshape(depth.shape)
    covered = buffer != empty
    index = np.where(covered, buffer, number).astype(np.uint32)  # the lower half
    source, pixels = (np.stack([n % width, n // width], axis=-1).astype(np.float64) for n in (index, number))
    moved = np.where(covered[..., None], at.reshape(-1, 2)[index] - source, 0.0)
    shown = np.where(covered, depth.ravel()[index], np.inf)
    return Splatted(pixels - moved, source, shown, covered, 1.0 / depth)


def background(covered: Array, depth: Array) -> Array:
    """Row and column (2, h, w) of the pixel that fills each hole, covered pixels their own.

    Of the first covered pixels to the left, right, top and bottom it is the nearest of those that are as far from the
    camera as the farthest, up to BACKGROUND.  A hole without any has its own.
    """
    rows, columns = np.indices(covered.shape)
    pixels, depths, distances = [np.stack([rows, columns])], [np.full(covered.shape, -1.0)], [np.zeros(covered.shape)]
    for axis, place in enumerate((rows, columns)):
        size = covered.shape[axis]
        before = np.maximum.accumulate(np.where(covered, place, -1), axis)
        after = np.flip(np.minimum.accumulate(np.flip(np.where(covered, place, size), axis), axis), axis)
        for other in (before, after):
            known = (other >= 0) & (other < size)
            at = np.where(known, other, place)
            pixel = np.stack([at, columns] if axis == 0 else [rows, at])
            pixels.append(pixel)
            depths.append(np.where(known, depth[tuple(pixel)], -1.0))
            distances.append(np.abs(at - place))
    far = np.stack(depths)
    as_far = far >= np.maximum(far.max(axis=0) / BACKGROUND, -1.0)
    chosen = np.where(as_far, np.stack(distances), np.inf).argmin(axis=0)
    filled = np.take_along_axis(np.stack(pixels), chosen[None, None], axis=0)[0]
    return np.where(covered, np.stack([rows, columns]), filled)
