"""Sample numbers of the path tracer: an Owen-scrambled Sobol sequence.

Source: Owen, Randomly permuted (t,m,s)-nets and (t,s)-sequences, 1995 (SciPy's scrambling).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

Array = np.ndarray

BLOCKS_PER_VERTEX = 3
"""Blocks of four dimensions for each vertex of a path: scattering; emitters; environment and punctual lights."""

VERTICES = 13
"""Vertices that have numbers: the camera's and one for each of up to 12 bounces."""

SUBPATH_VERTEX = VERTICES - 1
"""The vertex whose numbers for scattering light subpaths have: the last one does not scatter."""

LEAST, LIMIT = 64, 1024
"""Samples of every pixel that is decided, and most samples of one."""

PARTS = 16
"""Number of parts that ``part_table`` divides a sample sequence into."""

HALVES = np.array(
    [
        [part for part in range(PARTS) if (part & row).bit_count() % 2 == side]
        for row in range(PARTS // 2, PARTS)
        for side in (0, 1)
    ]
)
"""Parts of 16 halves of the samples: (16, PARTS / 2) int64.  Each two that follow one another have all parts.

The splits are rows of a Hadamard matrix (balanced half samples: K. M. Wolter, *Introduction to Variance Estimation*,
2nd edition, Springer 2007, chapter 3)."""

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


@lru_cache(maxsize=4)
def part_table(first: int, count: int) -> Array:
    """Numbers as of ``sample_table``, for samples in PARTS parts with independent numbers: each part has a sequence of
    its own.

    The first LEAST samples are the first ones of each part, one part after another; the samples from LEAST 2^k to
    LEAST 2^(k + 1) are as many more of each part.  The spread of means over the parts is the error of their mean, and
    falls as fast as the means of longer sequences converge (randomized quasi-Monte Carlo: Owen 1995).
    """
    number = np.arange(first, first + count)
    start = np.where(number < LEAST, 0, LEAST << np.log2(np.maximum(number // LEAST, 1)).astype(np.int64))
    length = np.maximum(start, LEAST) // PARTS  # samples of each part that begin at ``start``
    part, within = np.divmod(number - start, length)
    at = start // PARTS + within
    return _part_sequences(max(1 << int(at.max()).bit_length(), LIMIT // PARTS))[part, at]


@lru_cache(maxsize=1)
def _part_sequences(count: int) -> Array:
    """The first ``count`` numbers of every part: (PARTS, count, VERTICES * BLOCKS_PER_VERTEX, 4) uint32."""
    return np.stack([sample_table.__wrapped__(0, count, part) for part in range(PARTS)])
