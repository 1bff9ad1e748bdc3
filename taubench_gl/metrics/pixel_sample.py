"""Shares of pixels estimated at random pixels of random pairs, with a cheap mask of every pixel as control.

Every pixel has a cheap value x (of the preview's mask) and, where it was asked for, a true value y (of the path-traced
mask).  The share of y is the known share of x plus the mean of d = y - x at random pixels: the difference estimator (W.
G.  Cochran, *Sampling Techniques*, 3rd edition, Wiley 1977, section 7.2 and chapter 9), whose variance is that of the
disagreement, not that of the share.  The sample has two stages, random pairs and random pixels in them (chapter 10),
and the pixels of a pair are drawn from strata.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from taubench_gl.metrics.pair_sample import PairSample, estimate

Array = np.ndarray

LEVEL = 0.95

RULE_OF_THREE = 3.0
"""Without a case among n, its probability is below 3 / n at 95 % (Hanley and Lippman-Hand, JAMA 1983)."""

NORMAL_95 = NormalDist().inv_cdf(0.5 + 0.5 * LEVEL)


@dataclass(frozen=True, slots=True)
class PixelStrata:
    """The pixels of one pair that are sampled, in a random order within each stratum.

    Pixels of no stratum are known without a sample: there y = x.
    """

    order: tuple[Array, ...]  # of each stratum the flat indices of its pixels, in the order of the draw

    @classmethod
    def of(cls, strata: Array, count: int, seed: Sequence[int]) -> PixelStrata:
        """``strata`` (h, w) integers: stratum 0 .. ``count`` - 1 of each pixel, negative: of none."""
        rng, flat = np.random.default_rng(list(seed)), strata.ravel()
        return cls(tuple(rng.permutation(np.flatnonzero(flat == k)) for k in range(count)))

    @property
    def sizes(self) -> Array:
        """Pixels of each stratum.  (strata,) int64."""
        return np.array([len(indices) for indices in self.order])

    def counts(self, density: Array, count: int) -> Array:
        """How many of about ``count`` pixels each stratum has: by size times ``density`` (strata,), at least one of a
        stratum that has any (optimum allocation, Cochran Eq. 5.26)."""
        demand = self.sizes * density
        share = demand / max(demand.sum(), 1e-300)
        return np.minimum(np.maximum(np.rint(share * count).astype(int), np.minimum(self.sizes, 1)), self.sizes)

    def take(self, visit: int, counts: Array) -> tuple[Array, Array]:
        """Pixels of one visit, flat indices (n,) and their strata (n,): ``counts`` of each stratum that no visit before
        has had.  ``visit``: 0, 1, ...; a stratum that is used up gives fewer."""
        parts = [indices[visit * n : (visit + 1) * n] for indices, n in zip(self.order, counts, strict=True)]
        return np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts])


@dataclass(frozen=True, slots=True)
class SampledPair:
    """Sampled pixels of one visited pair, of all its visits.

    ``difference`` (n, k): y - x of k statistics, -1, 0 or 1 of a mask; with audited pixels an unbiased estimate of it.
    """

    pixels: int  # of the image
    sizes: Array  # (strata,) pixels of each stratum
    stratum: Array  # (n,) of each sampled pixel
    difference: Array


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate and its confidence interval at LEVEL, in the unit of the values.

    ``of_pixels``: half width that remains if the pairs whose preview is known are all pairs: what more pixels can
    narrow.
    """

    mean: float
    half_width: float
    of_pixels: float
    least: float = 0.0
    most: float = math.inf

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end of the interval, limited to ``least`` .. ``most``, what is possible."""
        return tuple(min(max(self.mean + s * self.half_width, self.least), self.most) for s in (-1.0, 1.0))


def stratum_variances(pairs: Sequence[SampledPair]) -> tuple[Array, Array]:
    """Mean and variance of the difference in each stratum, over all pairs.  (strata, k) float64 each.

    The variance is at least that of an interval of half width 3 / n (RULE_OF_THREE): a small sample without a
    difference, or of equal ones, proves little.
    """
    strata, k = len(pairs[0].sizes), pairs[0].difference.shape[1]
    every, stratum = np.concatenate([p.difference for p in pairs]), np.concatenate([p.stratum for p in pairs])
    means, variances = np.zeros((strata, k)), np.ones((strata, k))
    for h in range(strata):
        values = every[stratum == h]
        count = len(values)
        if not count:
            continue
        means[h] = values.mean(axis=0)
        spread = values.var(axis=0) * count / max(count - 1, 1)
        variances[h] = np.maximum(spread, min(count * (RULE_OF_THREE / count / NORMAL_95) ** 2, 1.0))
    return means, variances


def pair_differences(pairs: Sequence[SampledPair]) -> tuple[Array, Array]:
    """Mean of d over the pixels of each pair, and its variance.  (pairs, k) float64 each.

    mean = sum_h W_h mean_h, variance = sum_h W_h^2 (1 - n_h / N_h) s_h^2 / n_h (Cochran Eqs. 5.1 and 5.7) with s_h^2
    over all pairs.  A stratum of a pair without a sampled pixel has the mean of the stratum in the other pairs.
    """
    means, variances = stratum_variances(pairs)
    out, within = np.zeros((len(pairs), means.shape[1])), np.zeros((len(pairs), means.shape[1]))
    for i, pair in enumerate(pairs):
        for h in np.flatnonzero(pair.sizes):
            values, weight = pair.difference[pair.stratum == h], pair.sizes[h] / pair.pixels
            count = len(values)
            out[i] += weight * (values.mean(axis=0) if count else means[h])
            within[i] += weight**2 * (1.0 - count / pair.sizes[h]) * variances[h] / max(count, 1)
    return out, within


def estimate_share(
    sample: PairSample,
    control: Array,
    visited: Sequence[int],
    differences: Array,
    within: Array,
    base: Array | None = None,
) -> Interval:
    """Mean of y over all pairs, or its total over the total of ``base``.

    ``sample``: the pairs whose x is known, of N pairs; ``control`` (n',): their x; ``visited``: the rows of these n
    pairs among ``control``, which are random; ``differences``, ``within`` (n,): of ``pair_differences``; ``base``
    (n',): known.

    mean = mean(x) + mean(d).  variance = v(x) + (1/n - 1/N) s_d^2 + v_w / N + 2 (1/n' - 1/N) max(s_xd, 0): of the pairs
    in ``sample`` (``pair_sample.estimate``), between the visited ones (Cochran Eq. 10.14), within them, and the
    covariance where both are samples.  s_d^2, which contains v_w, is at least that.  Student's t at Satterthwaite's
    degrees of freedom.
    """
    n, total = len(visited), sample.total
    base = np.ones(len(control)) if base is None else base
    whole = float(sample.weights @ base)
    mean = (float(sample.weights @ control) + float(differences.mean())) / whole
    known = estimate(sample, control - mean * base, LEVEL)  # 0 where x of all pairs is known
    if known.half_width is None:
        return Interval(mean, math.inf, math.inf)
    inner = float(within.mean())
    between = max(float(differences.var(ddof=1)), inner) if n > 1 else math.inf
    shared = 0.0
    if n > 1:
        covariance = float(np.cov(control[list(visited)], differences)[0, 1])
        shared = 2.0 * (1.0 / len(control) - 1.0 / total) * max(covariance, 0.0)
    half = _half_width(between, inner, n, total, shared)
    of_pixels = _half_width(between, inner, n, len(control), 0.0)
    return Interval(mean, math.hypot(half, known.half_width) / whole, of_pixels / whole)


def _half_width(between: float, inner: float, n: int, total: int, shared: float) -> float:
    """Half width from n random pairs of ``total``: variance ``between`` pairs, within (``inner``), and ``shared``."""
    of_pairs = (1.0 / n - 1.0 / total) * between if n < total else 0.0
    variance = of_pairs + inner / total + shared
    if not math.isfinite(variance):
        return math.inf
    if not of_pairs:
        return NORMAL_95 * math.sqrt(variance)
    from scipy.special import stdtrit  # imported late: 0.3 s

    return float(stdtrit(variance**2 / of_pairs**2 * (n - 1), 0.5 + 0.5 * LEVEL)) * math.sqrt(variance)
