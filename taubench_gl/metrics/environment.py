"""Light of an environment image in float64: irradiance, GGX-prefiltered radiance, and lookups.

References for shaders/common/environment.glsl, which looks up the same maps.  Sources: Ramamoorthi and Hanrahan, An
Efficient Representation for Irradiance Environment Maps, 2001; Karis, Real Shading in Unreal Engine 4, 2013 (radiance
prefiltered with the GGX lobe for a viewer along the normal, times the directional albedo of the lobe).

Maps are equirectangular, (h, 2 h, 3), row 0 at +Y.  The center of an image is +X, three quarters of its width +Z.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taubench_gl.metrics.lighting import MIN_ALPHA
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

LOBE_HEIGHT = 128
"""Rows of the irradiance map and of each prefiltered map; they are twice as wide."""

LOBE_LEVELS = 8
"""Prefiltered maps, for perceptual roughness k / LOBE_LEVELS, k = 1 .. LOBE_LEVELS.  Roughness 0: the image itself."""

SEEN_HEIGHT = 1024
"""Most rows of the image as it is seen directly and in mirrors; larger images are box-filtered."""


@dataclass(frozen=True)
class EnvironmentMaps:
    """Maps of an environment image.  ``seen`` (h, 2 h, 3): the radiance itself.  ``lobes`` (LOBE_LEVELS + 1,
    LOBE_HEIGHT, 2 LOBE_HEIGHT, 3): first the radiance that a white diffuse surface with that normal reflects, then the
    prefiltered maps, by mirror direction.
    """

    seen: Array
    lobes: Array


def directions(height: int) -> Array:
    """Unit directions at the centers of the pixels of a map, world axes.  (h, 2 h, 3)."""
    theta = (np.arange(height) + 0.5) * np.pi / height
    phi = ((np.arange(2 * height) + 0.5) / (2 * height) - 0.5) * 2.0 * np.pi
    sine, cosine = np.sin(theta)[:, None], np.cos(theta)[:, None]
    return np.stack([sine * np.cos(phi), np.broadcast_to(cosine, (height, 2 * height)), sine * np.sin(phi)], axis=-1)


def solid_angles(height: int) -> Array:
    """Solid angle of a pixel of each row, sr.  (h,)."""
    edges = np.cos(np.linspace(0.0, np.pi, height + 1))
    return -np.diff(edges) * np.pi / height


def lookup(radiance: Array, direction: Array) -> Array:
    """Bilinear value of a map (h, 2 h, 3) in unit directions (..., 3); it wraps at the sides and ends at the poles."""
    h, w = radiance.shape[:2]
    x, y, z = np.moveaxis(np.asarray(direction, dtype=np.float64), -1, 0)
    column = (np.arctan2(z, x) / (2.0 * np.pi) + 0.5) * w - 0.5
    row = np.arctan2(np.hypot(x, z), y) / np.pi * h - 0.5
    left, top = np.floor(column).astype(int), np.floor(row).astype(int)
    fx, fy = (column - left)[..., None], (row - top)[..., None]
    rows = np.clip([top, top + 1], 0, h - 1)
    low, high = (radiance[r, left % w] * (1.0 - fx) + radiance[r, (left + 1) % w] * fx for r in rows)
    return low * (1.0 - fy) + high * fy


def resized(radiance: Array, height: int) -> Array:
    """Mean radiance over each pixel of a map of ``height`` rows, weighted by solid angle.  (h, w, 3) -> (H, 2 H, 3)."""
    h, w = radiance.shape[:2]
    angle = np.linspace(0.0, np.pi, h + 1)
    # Sums up to each edge, along one axis and then the other; a sum between pixels' edges is linear in solid angle.
    up_to = np.zeros((h + 1, w, 3))
    np.cumsum(radiance * solid_angles(h)[:, None, None], axis=0, out=up_to[1:])
    rows = _between(np.cos(angle)[::-1], up_to[::-1], np.cos(np.linspace(0.0, np.pi, height + 1))[::-1])[::-1]
    rows = np.diff(rows, axis=0) / solid_angles(height)[:, None, None] * (h / height)
    across = np.zeros((height, w + 1, 3))
    np.cumsum(rows, axis=1, out=across[:, 1:])
    edges = np.linspace(0.0, 1.0, w + 1)
    columns = _between(edges, np.swapaxes(across, 0, 1), np.linspace(0.0, 1.0, 2 * height + 1))
    return np.swapaxes(np.diff(columns, axis=0), 0, 1) * (2 * height / w)


def _between(at: Array, values: Array, where: Array) -> Array:
    """``values`` (n, ...), known ``at`` (n,) ascending, interpolated linearly at ``where`` (k,) -> (k, ...)."""
    i = np.clip(np.searchsorted(at, where, side="right") - 1, 0, len(at) - 2)
    f = np.clip((where - at[i]) / (at[i + 1] - at[i]), 0.0, 1.0)
    f = f.reshape(-1, *[1] * (values.ndim - 1))
    return values[i] * (1.0 - f) + values[i + 1] * f


def zonal_filter(radiance: Array, kernel: Callable[[Array], Array], height: int) -> Array:
    """Mean of ``radiance`` (h, 2 h, 3) around every direction of a map of ``height`` rows, h a multiple of it.

    ``kernel``: weight by the cosine of the angle to that direction; weights are normalized, so a uniform map stays as
    it is.  A convolution along each row, by fast Fourier transforms.  -> (height, 2 height, 3).
    """
    h, w = radiance.shape[:2]
    stride = h // height
    theta = (np.arange(h) + 0.5) * np.pi / h
    turn = np.cos((np.arange(w) + 0.5 - 0.5 * stride) * 2.0 * np.pi / w)  # from the first column of the result
    weight = solid_angles(h)[:, None]
    spectrum = np.fft.rfft(radiance, axis=1)
    out = np.empty((height, w // stride, 3))
    for i, center in enumerate((np.arange(height) + 0.5) * np.pi / height):
        cosine = np.cos(center) * np.cos(theta)[:, None] + np.sin(center) * np.sin(theta)[:, None] * turn
        k = kernel(np.clip(cosine, -1.0, 1.0)) * weight
        row = np.einsum("jm,jmc->mc", np.conj(np.fft.rfft(k, axis=1)), spectrum)
        out[i] = np.fft.irfft(row, n=w, axis=0)[::stride] / k.sum()
    return np.maximum(out, 0.0)  # rounding


def cosine_lobe(cosine: Array) -> Array:
    """Kernel of diffuse reflection, without its factor 1 / pi."""
    return np.maximum(cosine, 0.0)


def ggx_lobe(roughness: float) -> Callable[[Array], Array]:
    """Kernel of the GGX lobe for a viewer along the normal, by the cosine of the angle to the mirror direction, times
    n.l; not normalized.  The half vector is at half that angle."""
    a2 = max(roughness**2, MIN_ALPHA) ** 2

    def kernel(cosine: Array) -> Array:
        n_h2 = 0.5 * (1.0 + cosine)
        return np.maximum(cosine, 0.0) / (n_h2 * (a2 - 1.0) + 1.0) ** 2

    return kernel


def seen_map(radiance: Array) -> Array:
    """An image (h, 2 h, 3) with at most SEEN_HEIGHT rows."""
    return resized(radiance, SEEN_HEIGHT) if len(radiance) > SEEN_HEIGHT else np.asarray(radiance, dtype=np.float64)


def environment_maps(radiance: Array) -> EnvironmentMaps:
    """Maps of an image (h, 2 h, 3)."""
    seen = seen_map(radiance)
    # The narrowest lobe is about two pixels of its map wide, so it is taken from a finer image.
    fine, coarse = resized(seen, 2 * LOBE_HEIGHT), resized(seen, LOBE_HEIGHT)
    lobes = [zonal_filter(coarse, cosine_lobe, LOBE_HEIGHT)]
    for k in range(1, LOBE_LEVELS + 1):
        lobes.append(zonal_filter(fine if k == 1 else coarse, ggx_lobe(k / LOBE_LEVELS), LOBE_HEIGHT))
    return EnvironmentMaps(seen, np.stack(lobes))


CELLS = 256
"""Most rows of the cells from which directions towards an environment image are sampled; twice as many columns."""


def direction_choice(radiance: Array) -> Array:
    """Where to sample the directions of a map (h, 2 h, 3): cells chosen by their power, (n, 2 n + 1, 2) float32.

    Power is that of the bilinear value: a sun of one pixel also lights half of each pixel around it.

    ``[row, column, 0]``: cumulative probability of the columns of a row; ``[row, 2 n, 0]``: of the rows; ``[..., 1]``:
    pdf of the directions of a cell, 1/sr.  Cells have equal steps of latitude and longitude, n = min(h, CELLS).
    Probabilities are differences of the rounded cumulative ones.
    """
    n = min(len(radiance), CELLS)
    means = _bilinear_means(np.asarray(radiance, dtype=np.float64))
    cells = resized(means, n) if n < len(means) else means
    area = solid_angles(n)[:, None]
    power = np.maximum(cells, 0.0) @ LUMINANCE * area
    if not power.sum() > 0:
        power = np.broadcast_to(area, power.shape)
    row_power = power.sum(axis=1)
    out = np.zeros((n, 2 * n + 1, 2), dtype=np.float32)
    out[:, 2 * n, 0] = _cumulative(row_power)
    shares = np.where(row_power[:, None] > 0, power, 1.0)
    out[:, : 2 * n, 0] = [_cumulative(row) for row in shares]
    rows = np.diff(out[:, 2 * n, 0].astype(np.float64), prepend=0.0)
    columns = np.diff(out[:, : 2 * n, 0].astype(np.float64), axis=1, prepend=0.0)
    out[:, : 2 * n, 1] = rows[:, None] * columns / area
    return out


def _bilinear_means(radiance: Array) -> Array:
    """Mean over each pixel of the bilinear value of a map (h, 2 h, 3): weights 1/8, 3/4, 1/8 along each axis."""
    above, below = np.concatenate([radiance[:1], radiance[:-1]]), np.concatenate([radiance[1:], radiance[-1:]])
    rows = 0.75 * radiance + 0.125 * (above + below)
    return 0.75 * rows + 0.125 * (np.roll(rows, 1, axis=1) + np.roll(rows, -1, axis=1))


def _cumulative(weights: Array) -> Array:
    """Cumulative shares of ``weights`` (n,), 1 from the last positive one on."""
    total = np.cumsum(weights) / np.sum(weights)
    total[np.flatnonzero(weights)[-1] :] = 1.0
    return total
