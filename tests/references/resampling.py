"""Resampling of images to another size, the float64 reference of ``reuse/resample.comp.glsl``."""

from __future__ import annotations

import numpy as np

from references.reuse_methods.fsr2 import Grids, pixels
from references.reuse_methods.history import sample_history

Array = np.ndarray


def resample_bilinear(image: Array, size: tuple[int, int]) -> Array:
    """(h, w, c) -> (height, width, c) float64 for ``size`` (width, height): bilinear between pixel centers.

    Beyond the outer pixel centers the image continues with its edge.
    """
    grids = Grids(image.shape[1::-1], size)
    return sample_history(image, grids.input_from_output(pixels(size)))
