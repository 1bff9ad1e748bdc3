"""Which pairs of a sequence a sampled run looks at, and how far its means may be from the full run's.

Source: W. G. Cochran, *Sampling Techniques*, 3rd edition, Wiley 1977.  A sequence of N pairs is a finite population: a
sample that holds all of it has no error, so every variance carries the finite-population correction 1 - n/N.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from taubench_gl.metrics.student import student_quantile

Array = np.ndarray

PER_STRATUM = 2
"""Pairs taken of each stratum: the fewest whose spread can be seen."""

SEED = 20260101
"""Of the default draw: the same settings look at the same pairs."""


@dataclass(frozen=True, slots=True)
class PairSample:
    """``strata``: for each stratum its size N_h and the drawn positions, 0-based in 0 .. N-1, ascending."""

    total: int  # N
    strata: tuple[tuple[int, tuple[int, ...]], ...]

    @property
    def positions(self) -> tuple[int, ...]:
        """All drawn positions, ascending."""
        return tuple(sorted(p for _, drawn in self.strata for p in drawn))


@dataclass(frozen=True, slots=True)
class Estimate:
    """Mean of the population as the sample tells it, in the unit of the values."""

    mean: float
    half_width: float | None  # of the confidence interval; None where one pair says nothing of the spread
    level: float
    drawn: int  # n
    total: int  # N


def sample_pairs(total: int, scheme: str, number: int = 1, rng: np.random.Generator | None = None) -> PairSample:
    """``scheme`` "all"; "every": each ``number``-th pair; "strata": ``number`` stretches of equal length, PER_STRATUM
    pairs drawn at random from each (all of a stretch that has no more).

    ``rng``: of the start (every) or the draw (strata); None: the middle start, and a generator seeded with SEED.
    """
    if scheme == "all" or total <= 1:
        return PairSample(total, ((total, tuple(range(total))),))
    if scheme == "every":
        step = min(number, total)
        start = (step - 1) // 2 if rng is None else int(rng.integers(step))
        return PairSample(total, ((total, tuple(range(start, total, step))),))
    rng = rng or np.random.default_rng(SEED)
    strata = []
    for stretch in np.array_split(np.arange(total), min(number, total)):
        drawn = np.sort(rng.choice(stretch, size=min(PER_STRATUM, len(stretch)), replace=False))
        strata.append((len(stretch), tuple(int(p) for p in drawn)))
    return PairSample(total, tuple(strata))


def estimate(sample: PairSample, values: Array, level: float = 0.95) -> Estimate:
    """The population's mean and its confidence interval, from ``values`` (n,) in the order of ``sample.positions``.

    mean = sum_h W_h mean_h with W_h = N_h / N (Cochran Eq. 5.1); variance = sum_h W_h^2 (1 - n_h / N_h) s_h^2 / n_h
    (Eq. 5.13 as estimated from the sample; one stratum: Eq. 2.20); half width = t sqrt(variance), t of Student at
    Satterthwaite's degrees of freedom (Eq. 5.16).  Every k-th pair is judged as a random sample of its size: on a
    sequence with a trend that is too wide rather than too narrow (section 8.5); on one whose period is a multiple of
    k steps it is too narrow, and no sample can tell.
    """
    at = {p: float(v) for p, v in zip(sample.positions, np.asarray(values, dtype=np.float64), strict=True)}
    mean = variance = spread = 0.0
    unknown = False
    for size, drawn in sample.strata:
        y = np.array([at[p] for p in drawn])
        weight, n = size / sample.total, len(y)
        mean += weight * float(y.mean())
        if n == size:
            continue  # nothing left to chance
        if n < 2:
            unknown = True
            continue
        part = weight**2 * (1.0 - n / size) * float(y.var(ddof=1)) / n
        variance += part
        spread += part**2 / (n - 1)
    count = len(at)
    if unknown:
        return Estimate(mean, None, level, count, sample.total)
    if variance == 0.0:
        return Estimate(mean, 0.0, level, count, sample.total)
    t = student_quantile(0.5 + 0.5 * level, variance**2 / spread)
    return Estimate(mean, t * math.sqrt(variance), level, count, sample.total)


def expected_half_width(sample: PairSample, population: Array, level: float = 0.95) -> float:
    """How far the mean of such a sample may be from the population's, over all draws, where all values are known.

    ``population``: (N,).  variance = sum_h W_h^2 (1 - n_h / N_h) S_h^2 / n_h with the S_h of the strata themselves
    (Cochran Eq. 5.6); half width = z sqrt(variance), z of the normal distribution.  One draw may show less spread than
    there is; this does not depend on the draw.
    """
    values = np.asarray(population, dtype=np.float64)
    variance, start = 0.0, 0
    for size, drawn in sample.strata:
        part = values[start : start + size]
        start += size
        if len(drawn) < size:
            variance += (size / sample.total) ** 2 * (1.0 - len(drawn) / size) * float(part.var(ddof=1)) / len(drawn)
    return NormalDist().inv_cdf(0.5 + 0.5 * level) * math.sqrt(variance)
