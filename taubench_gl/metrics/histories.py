"""Pixels with two histories, the last frame and the other eye: which one a renderer would take."""

from __future__ import annotations

from functools import cache

import numpy as np

from taubench_gl.conventions import NOT_COMPARABLE
from taubench_gl.features import MASK_WORDS
from taubench_gl.metrics.reuse_rate import RATE_BITS

Array = np.ndarray


@cache
def _ranks() -> Array:
    """How good the history of each reason word is, 0 the best.  (MASK_WORDS,) int8.

    0: no reason of the rate ``shading``; 1: none of ``surface``; 2: comparable; 3: not comparable.
    """
    words = np.arange(MASK_WORDS)
    worse = (words & int(RATE_BITS["shading"])) != 0, (words & int(RATE_BITS["surface"])) != 0
    return sum(bits.astype(np.int8) for bits in (*worse, (words & int(NOT_COMPARABLE)) != 0))


def uses_other_eye(frame: Array, eye: Array) -> Array:
    """Pixels that take the other eye: its history is better than that of the last frame.  (...) bool.

    ``frame``, ``eye``: reason words of the pixels with each history.  So a pixel is reusable if either history is, in
    both rates.
    """
    return _ranks()[eye] < _ranks()[frame]
