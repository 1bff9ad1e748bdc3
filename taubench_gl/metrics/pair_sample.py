"""Sampling of frame pairs, and confidence intervals of the sampled means.

Source: W. G. Cochran, *Sampling Techniques*, 3rd edition, Wiley 1977.  A sequence of N pairs is a finite population: a
sample of all N pairs has no error, so every variance contains the finite-population correction 1 - n/N.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

Array = np.ndarray

PER_STRATUM = 2
"""Pairs sampled per stratum: the fewest with a sample variance."""

SEED = 20260101
"""Seed of the default sample: equal settings sample equal pairs."""


@dataclass(frozen=True, slots=True)
class PairSample:
    """``strata``: for each stratum its size N_h and the sampled positions, in 0 .. N-1, ascending."""

    total: int  # N
    strata: tuple[tuple[int, tuple[int, ...]], ...]

    @property
    def positions(self) -> tuple[int, ...]:
        """Sampled positions of all strata, ascending."""
        return tuple(sorted(p for _, sampled in self.strata for p in sampled))

    @property
    def weights(self) -> Array:
        """Weight of each of ``positions`` in an estimated mean.  (n,) float64, with the sum 1."""
        pair_weights = {p: size / self.total / len(sampled) for size, sampled in self.strata for p in sampled}
        return np.array([pair_weights[p] for p in self.positions], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimated mean of the population, in the unit of the values."""

    mean: float
    half_width: float | None  # of the confidence interval; None where a stratum has one pair
    level: float


def sample_pairs(total: int, scheme: str, number: int = 1, rng: np.random.Generator | None = None) -> PairSample:
    """Sample of the pairs 0 .. ``total`` - 1.

    ``scheme`` "all"; "every": each ``number``-th pair; "strata": ``number`` strata of equal length, PER_STRATUM random
    pairs of each (all pairs of a shorter stratum).  ``rng`` selects the first pair (every) or the pairs (strata); None:
    the middle of the first interval, or a generator seeded with SEED.
    """
    if scheme == "all" or total <= 1:
        return PairSample(total, ((total, tuple(range(total))),))
    if scheme == "every":
        step = min(number, total)
        start = (step - 1) // 2 if rng is None else int(rng.integers(step))
        return PairSample(total, ((total, tuple(range(start, total, step))),))
    rng = rng or np.random.default_rng(SEED)
    strata = []
    for stratum in np.array_split(np.arange(total), min(number, total)):
        sampled = np.sort(rng.choice(stratum, size=min(PER_STRATUM, len(stratum)), replace=False))
        strata.append((len(stratum), tuple(int(p) for p in sampled)))
    return PairSample(total, tuple(strata))


def estimate(sample: PairSample, values: Array, level: float = 0.95) -> Estimate:
    """The population's mean and its confidence interval, from ``values`` (n,) in the order of ``sample.positions``.

    mean = sum_h W_h mean_h with W_h = N_h / N (Cochran Eq. 5.1); variance = sum_h W_h^2 (1 - n_h / N_h) s_h^2 / n_h
    (Eq. 5.13 as estimated from the sample; one stratum: Eq. 2.20); half width = t sqrt(variance), t of Student at
    Satterthwaite's degrees of freedom (Eq. 5.16).

    Every k-th pair counts as a random sample of its size.  The interval is then too wide for a sequence with a trend
    (section 8.5), and too narrow for one whose period divides k pairs, which no sample can detect.
    """
    at = {p: float(v) for p, v in zip(sample.positions, np.asarray(values, dtype=np.float64), strict=True)}
    mean = variance = spread = 0.0
    unknown = False
    for size, sampled in sample.strata:
        y = np.array([at[p] for p in sampled])
        weight, n = size / sample.total, len(y)
        mean += weight * float(y.mean())
        if n == size:
            continue  # the whole stratum: no error
        if n < 2:
            unknown = True
            continue
        part = weight**2 * (1.0 - n / size) * float(y.var(ddof=1)) / n
        variance += part
        spread += part**2 / (n - 1)
    if unknown or spread == 0.0:  # also where the square of a variance is below the least float64
        return Estimate(mean, None if unknown else 0.0, level)
    from scipy.special import stdtrit  # imported late: 0.3 s

    t = float(stdtrit(variance**2 / spread, 0.5 + 0.5 * level))
    return Estimate(mean, t * math.sqrt(variance), level)


def share_ends(percent: float, half_width: float | None) -> list[float] | None:
    """Ends of the confidence interval of an estimated share of ``percent``, within 0 to 100; None without a half width.

    Symmetric for logit(p) = ln(p / (1 - p)), whose standard error is that of p divided by p (1 - p): logit(p) ±
    ``half_width`` / (p (1 - p)) (Korn and Graubard, Survey Methodology 24, 1998, section 2).  A share of 0 or of 100 %
    is its own interval: no sampled pair differs from it.
    """
    if half_width is None:
        return None
    p = percent / 100.0
    spread = p * (1.0 - p)
    if spread <= 0.0:
        return [percent, percent]
    middle, half = math.log(p / (1.0 - p)), half_width / 100.0 / spread
    return [50.0 * (1.0 + math.tanh(0.5 * (middle + sign * half))) for sign in (-1.0, 1.0)]
