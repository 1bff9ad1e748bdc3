"""Previous positions, history samples and means over frames: what all reuse methods share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from taubench_gl.conventions import GUARD_PX

Array = np.ndarray


def previous_px(motion_px: Array) -> Array:
    """Previous position of each pixel, (column, row) + motion (previous - current, +y down).  (h, w, 2) -> same."""
    h, w = motion_px.shape[:2]
    return np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1) + np.asarray(motion_px, dtype=np.float64)


def inside(at_px: Array, size: tuple[int, int]) -> Array:
    """Eq. (3) of TauBench: inside [0, w-1] x [0, h-1], with a guard of GUARD_PX.  ``size`` (width, height).

    -> (h, w) bool.
    """
    last = np.array(size) - 1
    return np.all((at_px >= -GUARD_PX) & (at_px <= last + GUARD_PX), axis=-1)


def nearest_surface(depth: Array) -> Array:
    """Karis 2014: the pixel of each 3x3 neighborhood that is nearest to the camera.

    ``depth`` (h, w) planar, 0 = sky.  -> (h, w, 2) int (column, row).  Ties: the pixel itself, then the lower, then the
    left one.
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
    """Pixels by column and by row from the bottom; the image edge is repeated."""
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
    """Schied 2017, section 4.1; Koskela 2019: bilinear blend of accepted taps inside the image, weights renormalized.

    ``accept``: (h, w) int, (h, w) int -> (h, w) bool.  -> blend (h, w, c), 0 without an accepted tap, and the sum of
    the weights before renormalization (h, w).
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


def shifted(values: Array, dx: int, dy: int) -> tuple[Array, Array]:
    """``values`` at pixel (column + dx, row + dy), and whether that pixel exists.  -> (h, w, ...), (h, w) bool."""
    h, w = values.shape[:2]
    row, column = np.mgrid[:h, :w]
    row, column = row + dy, column + dx
    exists = (row >= 0) & (row < h) & (column >= 0) & (column < w)
    return values[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)], exists


def neighbors(image: Array) -> dict[tuple[int, int], Array]:
    """The 3x3 neighborhood: (row offset, column offset) -> (h, w, c)."""
    h, w = image.shape[:2]
    wide = np.pad(np.asarray(image, dtype=np.float64), ((1, 1), (1, 1), (0, 0)), mode="edge")
    return {(dy, dx): wide[1 + dy : 1 + dy + h, 1 + dx : 1 + dx + w] for dy in (-1, 0, 1) for dx in (-1, 0, 1)}


def exponential_average(now: Array, history: Array, alpha: Array | float) -> Array:
    """Yang et al. 2020, Eq. (1): alpha now + (1 - alpha) history."""
    return history + alpha * (now - history)


def running_mean(now: Array, mean: Array, count: Array, cap: int) -> tuple[Array, Array]:
    """Welford's update: adds one frame to a mean of ``count`` frames; the count is limited to ``cap``.

    (h, w, 3), (h, w, 3), (h, w) -> mean, count.  The variance of stationary noise decreases as 1 / count.
    """
    count = np.minimum(count, cap - 1) + 1.0
    return exponential_average(now, mean, 1.0 / count[..., None]), count
