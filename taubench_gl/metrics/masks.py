"""Feature masks f_B (section 3.2) of one frame pair in float64.  Reference for shaders/masks/masks.comp.glsl."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taubench_gl.conventions import HISTOGRAM_BINS, NO_HISTORY, NOT_COMPARABLE, Reason
from taubench_gl.features import FEATURE, FEATURE_BIT, FEATURES, GEOMETRY, MASK_WORDS, VALUES, Distance
from taubench_gl.metrics.counts import bin_of
from taubench_gl.metrics.reprojection import Reprojection, reproject
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class PixelDistances:
    """What the mask pass compares with the thresholds, (h, w) float32 each, row 0 at the top.

    0 where a pixel is not comparable.
    """

    features: Mapping[str, Array]  # feature -> distance in its unit (position: scene units); inf: sky against surface
    depth: Array  # distance of the point from the previous camera less that of the history surface; inf as above
    luminance: Array  # change of direct luminance, radiance x exposure


@dataclass(frozen=True, slots=True)
class PairMasks:
    """Result per pixel, (h, w, ...), row 0 at the top."""

    mask: Array  # (h, w) uint32 of conventions.Reason
    motion_px: Array  # (h, w, 2) float64, +y down; NaN where behind
    at_px: Array  # (h, w, 2) float64 previous coordinates, as ``motion_px``
    distances: Mapping[str, Array]  # feature -> (h, w) float64; NaN where not compared
    changes: Mapping[str, Array]  # depth, luminance -> (h, w) float64, as in ``PixelDistances``; NaN where not compared

    def mask_histogram(self) -> Array:
        """Pixel counts per reason word.  (MASK_WORDS,) int64."""
        return np.bincount(self.mask.ravel(), minlength=MASK_WORDS)

    def histogram(self, feature: str) -> Array:
        """Distance histogram of comparable pixels, (HISTOGRAM_BINS,) int64.  Sky on sky has distance 0."""
        comparable = (self.mask & NOT_COMPARABLE) == 0
        distance = np.nan_to_num(self.distances[feature][comparable], nan=0.0, posinf=np.inf)
        return np.bincount(bin_of(distance), minlength=HISTOGRAM_BINS)


def pair_masks(
    current: Mapping[str, Array],
    history: Mapping[str, Array],
    pair: Reprojection,
    thresholds: Mapping[str, float],
    *,
    sampling: str = "nearest",
    reprojection: str = "camera",
    exposure: float = 1.0,
) -> PairMasks:
    """Reason bits of every pixel.

    ``current`` and ``history`` contain ``position`` (h, w, 4) and ``normal`` (h, w, >=3), optionally ``direct``,
    ``indirect`` and ``color`` (h, w, >=3).  ``current`` also contains ``prev_position`` (h, w, >=3) for ``motion``
    reprojection, maybe ``vectors`` (see ``reproject``), and ``ids`` (h, w, 2) uint32 where some are NO_HISTORY.
    """
    names = [n for n in (*GEOMETRY, *VALUES) if FEATURE[n].channel in current and FEATURE[n].channel in history]
    now = {n: value_of(n, current[FEATURE[n].channel]) for n in names}
    prev_position = np.asarray(current["prev_position"], np.float64) if reprojection == "motion" else None
    surface = now["position"][..., 3] > 0
    invalid = ~_finite(now)
    if prev_position is not None:
        invalid |= surface & ~np.isfinite(prev_position[..., :3]).all(axis=-1)
    moved = reproject(pair, now["position"], prev_position, current.get("vectors"))
    not_finite = ~invalid & ~moved.behind & ~np.isfinite(moved.motion_px).all(axis=-1)
    cut = np.zeros_like(surface)
    if "ids" in current:
        cut = surface & ~invalid & ((np.asarray(current["ids"])[..., 1] & np.uint32(NO_HISTORY)) != 0)
        not_finite &= ~cut
    behind, outside = moved.behind & ~invalid & ~cut, moved.outside & ~invalid & ~not_finite & ~cut
    sampled_pixels = ~(invalid | not_finite | cut | behind | outside)

    previous = {n: value_of(n, history[FEATURE[n].channel]) for n in names}
    rows, columns = np.nonzero(sampled_pixels)
    sampled = sample_history(sampling, previous, moved.at_px[rows, columns], surface[rows, columns])
    finite = _finite(sampled)

    sky = ~surface & np.isfinite(now["position"]).all(axis=-1)
    mask = np.where(sky, Reason.SKY, 0).astype(np.uint32)
    mask[invalid | not_finite] |= np.uint32(Reason.INVALID)
    mask[cut] |= np.uint32(Reason.CUT)
    mask[behind] |= np.uint32(Reason.BEHIND)
    mask[outside] |= np.uint32(Reason.OUTSIDE)
    mask[rows[~finite], columns[~finite]] |= np.uint32(Reason.INVALID)
    rows, columns = rows[finite], columns[finite]
    sampled = {n: v[finite] for n, v in sampled.items()}
    here = {n: v[rows, columns] for n, v in now.items()}
    bits, compared = compare(here, moved.q[rows, columns], sampled, thresholds, exposure)
    mask[rows, columns] |= bits

    def image(values: Array) -> Array:
        whole = np.full(mask.shape, np.nan)
        whole[rows, columns] = values
        return whole

    depth, luminance = changes(here, moved.q[rows, columns], sampled, exposure)
    return PairMasks(
        mask, moved.motion_px, moved.at_px, {feature: image(values) for feature, values in compared.items()},
        {"depth": image(depth), "luminance": image(luminance)},
    )  # fmt: skip


def value_of(feature: str, channel: Array) -> Array:
    """The components of its channel that ``feature`` compares.  (..., m) -> (..., n) float64."""
    return np.asarray(channel, dtype=np.float64)[..., ["xyzw".index(c) for c in FEATURE[feature].part]]


def compare(
    now: Mapping[str, Array],
    q: Array,
    before: Mapping[str, Array],
    thresholds: Mapping[str, float],
    exposure: float = 1.0,
) -> tuple[Array, dict[str, Array]]:
    """f_B of K pixels: reason bits (K,) uint32 and the distance of each feature (K,), NaN for sky on sky.

    ``q`` (K, 3): previous position of each surface point, relative to the previous camera.
    """
    surface, history_surface = now["position"][:, 3] > 0, before["position"][:, 3] > 0
    bits = np.where(history_surface, 0, Reason.HISTORY_SKY).astype(np.uint32)
    both, differ = surface & history_surface, surface != history_surface
    distances = {}
    for feature, a, b in (("position", q, before["position"][:, :3]), ("normal", now["normal"], before["normal"])):
        distance = np.where(both, np.linalg.norm(a - b, axis=-1), np.where(differ, np.inf, np.nan))
        distances[feature] = distance
        bits[distance > thresholds[feature]] |= np.uint32(FEATURE_BIT[feature])
    depth, luminance = changes(now, q, before, exposure)
    discard = distances["position"] > thresholds["position"]
    bits[discard & (depth > thresholds["position"])] |= np.uint32(Reason.DISOCCLUDED)
    bits[discard & (-depth > thresholds["position"])] |= np.uint32(Reason.OCCLUDING)
    for feature in VALUES:
        if feature not in now:
            continue
        change = now[feature] - before[feature]
        if FEATURE[feature].distance is Distance.RADIANCE:
            distances[feature] = np.linalg.norm(change, axis=-1) * exposure
        else:
            distances[feature] = np.abs(change).max(axis=-1)
        over = distances[feature] > thresholds[feature]
        bits[over] |= np.uint32(FEATURE_BIT[feature])
        if feature == "direct":
            bits[over & (luminance > 0)] |= np.uint32(Reason.LIT)
            bits[over & (luminance < 0)] |= np.uint32(Reason.SHADOWED)
    return bits, {f: distances[f] for f in FEATURES if f in distances}


def changes(
    now: Mapping[str, Array], q: Array, before: Mapping[str, Array], exposure: float = 1.0
) -> tuple[Array, Array]:
    """Signed changes of K pixels, arguments as for ``compare``: depth and direct luminance, (K,) each.

    Depth: ``PixelDistances.depth``, NaN for sky on sky.  Luminance: 0 where direct was not measured.
    """
    surface, history_surface = now["position"][:, 3] > 0, before["position"][:, 3] > 0
    depth = np.linalg.norm(q, axis=-1) - np.linalg.norm(before["position"][:, :3], axis=-1)
    one_sky = np.where(surface, -np.inf, np.inf)
    depth = np.where(surface & history_surface, depth, np.where(surface != history_surface, one_sky, np.nan))
    if "direct" not in now:
        return depth, np.zeros(len(depth))
    return depth, exposure * ((now["direct"] - before["direct"]) @ LUMINANCE)


def _finite(channels: Mapping[str, Array]) -> Array:
    return np.logical_and.reduce([np.isfinite(v).all(axis=-1) for v in channels.values()])


def history_taps(
    sampling: str, at_px: Array, surface: Array, history_surface: Array, finite: Array
) -> tuple[Array, Array]:
    """Pixels of the previous frame that the history at K positions is made of, and their weights.

    ``at_px`` (K, 2): previous coordinates, y down; ``surface`` (K,) bool: whether the current pixel shows a surface;
    ``history_surface``, ``finite`` (h, w) bool: of the previous frame.  Returns (K, T, 2) int64 columns and rows from
    the top, and (K, T) float64 weights with the sum 1; NaN where no tap is finite.

    nearest: floor(x + 0.5), y up as on the GPU (docs/conventions.md).  bilinear: the taps that are inside, finite and
    of the same kind (surface or sky); else the heaviest finite one.
    """
    h, w = history_surface.shape
    x, y = at_px[:, 0], (h - 1) - at_px[:, 1]
    if sampling == "nearest":
        column = np.clip(np.floor(x + 0.5).astype(np.int64), 0, w - 1)
        up = np.clip(np.floor(y + 0.5).astype(np.int64), 0, h - 1)
        return np.stack([column, h - 1 - up], axis=-1)[:, None], np.ones((len(x), 1))
    corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
    base = np.floor(np.stack([x, y], axis=-1)).astype(np.int64)
    part = np.stack([x, y], axis=-1) - base
    at = base[:, None] + corners
    weight = np.where(corners == 1, part[:, None], 1.0 - part[:, None]).prod(axis=-1)
    inside = (weight > 0) & (at >= 0).all(axis=-1) & (at < [w, h]).all(axis=-1)
    column, row = np.clip(at[..., 0], 0, w - 1), h - 1 - np.clip(at[..., 1], 0, h - 1)
    possible = inside & finite[row, column]
    used = np.where(possible & (history_surface[row, column] == surface[:, None]), weight, 0.0)
    total = used.sum(axis=-1, keepdims=True)
    heaviest = np.eye(4)[np.argmax(np.where(possible, weight, -1.0), axis=-1)]
    heaviest[~possible.any(axis=-1)] = np.nan
    weights = np.where(total > 0, used / np.where(total > 0, total, 1.0), heaviest)
    return np.stack([column, row], axis=-1), weights


def blend(values: Array, weights: Array) -> Array:
    """Sum of taps (..., T, n) by ``weights`` (..., T); what has no weight may be NaN or infinite."""
    weights = weights[..., None]
    return np.where(weights == 0.0, 0.0, weights * values).sum(axis=-2)


def sample_history(sampling: str, history: Mapping[str, Array], at_px: Array, surface: Array) -> dict[str, Array]:
    """Values of ``history``, which contains ``position`` (h, w, 4), at K positions; arguments as of ``history_taps``.

    {name: (K, n)}; blended normals are unit vectors.
    """
    taps, weights = history_taps(sampling, at_px, surface, history["position"][..., 3] > 0, _finite(history))
    out = {n: blend(v[taps[..., 1], taps[..., 0]], weights) for n, v in history.items()}
    if sampling == "bilinear" and "normal" in out:
        length = np.linalg.norm(out["normal"], axis=-1, keepdims=True)
        out["normal"] = out["normal"] / np.where(length > 0, length, 1.0)
    return out
