"""Sample numbers of the path tracer: an Owen-scrambled Sobol sequence, and the shift that makes pixels independent.

Reference for shaders/pathtracing/numbers.glsl, equal bit for bit.  Sources: Owen, Randomly permuted (t,m,s)-nets and
(t,s)-sequences, 1995 (SciPy's scrambling); Kollig and Keller, Efficient multidimensional sampling, 2002 (digital
shift).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from taubench_gl.metrics.stochastic import pcg4d

Array = np.ndarray

BLOCKS_PER_VERTEX = 3
"""Blocks of four dimensions for each vertex of a path: scattering; emitters; environment and punctual lights."""

VERTICES = 13
"""Vertices that have numbers: the camera's and one for each of up to 12 bounces."""

SUBPATH_VERTEX = VERTICES - 1
"""The vertex whose numbers for scattering light subpaths have: the last one does not scatter."""

_BITS = 30


@lru_cache(maxsize=4)
def sample_table(first: int, count: int, seed: int = 0) -> Array:
    """Numbers of samples ``first`` .. ``first + count - 1``: (count, VERTICES * BLOCKS_PER_VERTEX, 4) uint32.

    A number u in [0, 1) is the word divided by 2^32.  ``seed`` scrambles the whole sequence.  A longer table starts
    with the shorter one.
    """
    from scipy.stats import qmc  # takes a second to import

    engine = qmc.Sobol(VERTICES * BLOCKS_PER_VERTEX * 4, scramble=True, bits=_BITS, rng=np.random.default_rng(seed))
    if first:
        engine.fast_forward(first)
    rows = engine.random(1 << (count - 1).bit_length())[:count]  # SciPy warns unless it is a power of two
    words = np.minimum(rows * 2.0**_BITS, 2.0**_BITS - 1).astype(np.uint32) << np.uint32(32 - _BITS)
    table = words.reshape(count, -1, 4)
    table.flags.writeable = False
    return table


def numbers(table: Array, sample: int, column: int, pixel: Array | None = None, frame: int = 0, seed: int = 0) -> Array:
    """The four numbers of a block, in [0, 1), multiples of 2^-24.

    ``pixel`` (..., 2): column and row, row 0 at the *bottom*; None: pattern ``fixed``.  -> (4,) or (..., 4) float64.
    """
    words = table[sample, column]
    if pixel is not None:
        x, y = (np.asarray(pixel[..., k], dtype=np.uint32) for k in range(2))
        parts = [x | y << np.uint32(16), *(np.full(x.shape, value, np.uint32) for value in (frame, seed, column))]
        words = words ^ pcg4d(np.stack(parts, axis=-1))
    return (words >> np.uint32(8)).astype(np.float64) / (1 << 24)
