"""Resampling of images to another size, the float64 reference of ``reuse/resample.comp.glsl``."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def resample_bilinear(image: Array, size: tuple[int, int]) -> Array:
    """(h, w, c) -> (height, width, c) float64 for ``size`` (width, height): bilinear between pixel centers.

    Beyond the outer pixel centers the image continues with its edge.
    """
    out = np.asarray(image, dtype=np.float64)
    for axis, count in ((0, size[1]), (1, size[0])):
        own = out.shape[axis]
        at = (np.arange(count) + 0.5) * own / count - 0.5
        low = np.floor(at).astype(np.int64)
        share = (at - low).reshape([-1 if k == axis else 1 for k in range(out.ndim)])
        first, second = (np.take(out, np.clip(k, 0, own - 1), axis=axis) for k in (low, low + 1))
        out = first * (1.0 - share) + second * share
    return out
