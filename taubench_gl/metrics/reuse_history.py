"""Reading, judging and blending history, float64: twins of the reuse methods' shaders (taubench_gl/reuse/methods).

Arrays are (h, w, ...), row 0 at the top; ``at_px`` (h, w, 2) is (column, row) of where each point was.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from taubench_gl.conventions import GUARD_PX

Array = np.ndarray


def previous_px(motion_px: Array) -> Array:
    """Where each pixel's point was: (column, row) + motion (previous - current, +y down).  (h, w, 2) -> (h, w, 2)."""
    h, w = motion_px.shape[:2]
    return np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1) + np.asarray(motion_px, dtype=np.float64)


def inside(at_px: Array, size: tuple[int, int]) -> Array:
    """Eq. (3) of TauBench: within [0, w-1] x [0, h-1], with the guard.  ``size`` (width, height).  -> (h, w) bool."""
    last = np.array(size) - 1
    return np.all((at_px >= -GUARD_PX) & (at_px <= last + GUARD_PX), axis=-1)


def nearest_surface(depth: Array) -> Array:
    """Karis 2014: of each 3x3 neighbourhood the pixel nearest to the camera, itself where none is nearer.

    ``depth`` (h, w) planar, 0 = sky.  -> (h, w, 2) int (column, row); of equally near ones the lower, then left one.
    """
    h, w = depth.shape
    rows, columns = np.mgrid[:h, :w]
    best, found = np.where(depth > 0, depth, 1e30), np.stack([columns, rows], axis=-1)
    for dy in (1, 0, -1):
        for dx in (-1, 0, 1):
            row, column = np.clip(rows + dy, 0, h - 1), np.clip(columns + dx, 0, w - 1)
            other = depth[row, column]
            nearer = (other > 0) & (other < best)
            best = np.where(nearer, other, best)
            found[nearer] = np.stack([column, row], axis=-1)[nearer]
    return found


def catmull_rom_weights(f: Array) -> Array:
    """Keys 1981, a = -1/2: weights of the taps at -1, 0, 1, 2 for points ``f`` in [0, 1).  (...) -> (..., 4)."""
    f = np.asarray(f, dtype=np.float64)
    return np.stack(
        [
            -0.5 * f**3 + f**2 - 0.5 * f,
            1.5 * f**3 - 2.5 * f**2 + 1.0,
            -1.5 * f**3 + 2.0 * f**2 + 0.5 * f,
            0.5 * f**3 - 0.5 * f**2,
        ],
        axis=-1,
    )


def _fetch(values: Array, column: Array, up: Array) -> Array:
    """Pixels by column and row from the bottom, the outermost repeated."""
    h, w = values.shape[:2]
    return values[h - 1 - np.clip(up, 0, h - 1), np.clip(column, 0, w - 1)]


def sample_history(values: Array, at_px: Array, filtering: str = "bilinear") -> Array:
    """``values`` (h, w, c) at ``at_px``: nearest (floor(x + 0.5), y up), bilinear or catmull_rom.  -> (h, w, c)."""
    values = np.asarray(values, dtype=np.float64)
    x, y = at_px[..., 0], (values.shape[0] - 1) - at_px[..., 1]
    if filtering == "nearest":
        return _fetch(values, np.floor(x + 0.5).astype(np.int64), np.floor(y + 0.5).astype(np.int64))
    base_x, base_y = np.floor(x), np.floor(y)
    fx, fy = x - base_x, y - base_y
    if filtering == "bilinear":
        wx, wy, first = np.stack([1 - fx, fx], -1), np.stack([1 - fy, fy], -1), 0
    else:
        wx, wy, first = catmull_rom_weights(fx), catmull_rom_weights(fy), -1
    out = np.zeros((*x.shape, values.shape[-1]))
    for j in range(wy.shape[-1]):
        for i in range(wx.shape[-1]):
            tap = _fetch(values, (base_x + first + i).astype(np.int64), (base_y + first + j).astype(np.int64))
            out += (wx[..., i] * wy[..., j])[..., None] * tap
    return out


def consistent_blend(values: Array, at_px: Array, accept: Callable[[Array, Array], Array]) -> tuple[Array, Array]:
    """Bilinear taps that lie inside and that ``accept(row, column)`` (each (h, w) int) -> (h, w) bool lets through,
    weights renormalised (Schied 2017, section 4.1; Koskela 2019).

    -> blend (h, w, c), 0 where no tap passed, and the sum of weights before that (h, w).
    """
    values = np.asarray(values, dtype=np.float64)
    h, w = values.shape[:2]
    base = np.floor(at_px).astype(np.int64)
    f = at_px - base
    sums, total = np.zeros((*at_px.shape[:2], values.shape[-1])), np.zeros(at_px.shape[:2])
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        column, row = base[..., 0] + dx, base[..., 1] + dy
        weight = (f[..., 0] if dx else 1 - f[..., 0]) * (f[..., 1] if dy else 1 - f[..., 1])
        good = (weight > 0) & (column >= 0) & (column < w) & (row >= 0) & (row < h)
        row, column = np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)
        weight = np.where(good & accept(row, column), weight, 0.0)
        sums += weight[..., None] * values[row, column]
        total += weight
    return sums / np.where(total > 0, total, 1.0)[..., None], total


def exponential_average(now: Array, history: Array, alpha: Array | float) -> Array:
    """Yang et al. 2020, Eq. (1): alpha now + (1 - alpha) history."""
    return history + alpha * (now - history)


def running_mean(now: Array, mean: Array, count: Array, cap: int) -> tuple[Array, Array]:
    """One more frame in a mean of ``count``: Welford's update; the count never passes ``cap``.

    (h, w, 3), (h, w, 3), (h, w) -> mean, count; variance of unchanging noise falls as 1 / count.
    """
    count = np.minimum(count, cap - 1) + 1.0
    return exponential_average(now, mean, 1.0 / count[..., None]), count


def cache_hit(expected: Array, cached_depth: Array, threshold: float) -> Array:
    """Nehab et al. 2007: the cached planar depth is the expected one, to a share of it; expected 0 is sky."""
    near = np.abs(cached_depth - expected) <= threshold * expected
    return np.where(expected > 0, near, cached_depth <= 0)


def refresh_due(index: int, size: tuple[int, int], block: int, refresh: int) -> Array:
    """Nehab et al. 2007: which pixels frame ``index`` shades anew: blocks in turn, once in ``refresh`` frames.

    -> (h, w) bool.
    """
    w, h = size
    x, up = np.meshgrid(np.arange(w) // block, np.arange(h - 1, -1, -1) // block)
    return (5 * x + 3 * up + index) % refresh == 0


def timewarp_px(clip_from_view: Array, key_from_view: Array, size: tuple[int, int]) -> Array:
    """Where each pixel's view ray meets a picture taken from the same place under another rotation (homography
    K R_key^T R_now K^-1; Hartley and Zisserman 2004, section 8.4).

    ``clip_from_view`` (4, 4) of both cameras (perspective); ``key_from_view`` (3, 3) rotation from this camera's axes
    to the key camera's.  -> (h, w, 2) (column, row); NaN where the ray points behind the key camera.
    """
    w, h = size
    # Pixel indices, y up, from view axes: ndc = -K x / z, index = (ndc + 1) size / 2 - 1/2.
    to_index = np.array([[0.5 * w, 0, 0.5 * w - 0.5], [0, 0.5 * h, 0.5 * h - 0.5], [0, 0, 1]])
    intrinsic = to_index @ clip_from_view[np.ix_([0, 1, 3], [0, 1, 2])]
    homography = intrinsic @ key_from_view @ np.linalg.inv(intrinsic)
    x, up = np.meshgrid(np.arange(w, dtype=np.float64), np.arange(h - 1, -1, -1, dtype=np.float64))
    q = np.stack([x, up, np.ones_like(x)], axis=-1) @ homography.T
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.where(q[..., 2:] > 0, q[..., :2] / q[..., 2:], np.nan)
    return np.stack([at[..., 0], (h - 1) - at[..., 1]], axis=-1)


def new_samples(radiance: Array, jitter_px: Array, reach: float) -> tuple[Array, Array, Array]:
    """Yang et al. 2020, section 5: shaded samples of 5x5 pixels under a tent of half width ``reach`` pixels.

    ``radiance`` (h, w, 4), alpha 1 where shaded; ``jitter_px`` (2,) +y down.  -> weighted mean (h, w, 3), sum of
    weights (h, w), largest weight (h, w).
    """
    h, w = radiance.shape[:2]
    wide = np.pad(np.asarray(radiance, dtype=np.float64), ((2, 2), (2, 2), (0, 0)))  # outside: alpha 0, not shaded
    sums, total, best = np.zeros((h, w, 3)), np.zeros((h, w)), np.zeros((h, w))
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            tap = wide[2 + dy : 2 + dy + h, 2 + dx : 2 + dx + w]
            tent = np.maximum(1.0 - np.abs(np.array([dx, dy]) + jitter_px) / reach, 0.0)
            weight = np.where(tap[..., 3] >= 0.5, tent.prod(), 0.0)
            sums += weight[..., None] * tap[..., :3]
            total += weight
            best = np.maximum(best, weight)
    return sums / np.where(total > 0, total, 1.0)[..., None], total, best


def upsample_blend(
    now: Array, confidence: Array, history: Array, gathered: Array, alpha: float
) -> tuple[Array, Array, Array]:
    """Yang et al. 2020, section 5: f_n = a b s_n + (1 - a b) f_(n-1), a = max(alpha, 1 / confidence gathered).

    ``now``, ``history`` (..., 3); ``confidence`` b and ``gathered`` (...).  -> picture, gathered, weight of history.
    """
    gathered = gathered + confidence
    share = np.where(
        gathered > 0, np.maximum(confidence / np.where(gathered > 0, gathered, 1.0), alpha * confidence), 0.5
    )
    return exponential_average(now, history, share[..., None]), np.minimum(gathered, 1.0 / alpha), 1.0 - share
