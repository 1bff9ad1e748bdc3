"""Image quality against a reference: one function per measure, float64, no OpenGL (docs/reuse-evaluation.md).

``image`` and ``reference``: (h, w, 3) linear radiance, exposure applied, row 0 at the top; ``shown``: display colors in
[0, 1], of ``display``.
"""

from __future__ import annotations

import importlib
import math
import os
from pathlib import Path
from types import ModuleType

import numpy as np
from msgspec import Struct

from taubench_gl.conventions import NOT_COMPARABLE
from taubench_gl.data_files import read_toml
from taubench_gl.features import FEATURE_BIT
from taubench_gl.metrics.blending import channels
from taubench_gl.metrics.color import display_color
from taubench_gl.metrics.exposure import metered_exposure
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

RELMSE_EPSILON = 1e-2
"""Number added to the squared reference (Rousselle et al. 2011), so that black pixels do not dominate."""

SSIM_SIGMA, SSIM_SIDE = 1.5, 11
"""Wang et al. 2004: Gaussian window of standard deviation 1.5, 11 pixels wide."""

FLIP_PERCENTILES = (50, 95, 99)
FLIP_ACES = (0.6**2 * 2.51, 0.6 * 0.03, 0.6**2 * 2.43, 0.6 * 0.59, 0.14)
"""Coefficients a, b, c, d, e of HDR-FLIP's tone map (a x^2 + b x) / (c x^2 + d x + e)."""

FLIP_WHITE = 0.85
"""Tone-mapped luminance that the largest (first exposure) and the median luminance (last one) of the reference get."""

FLIP_DARK = float(np.finfo(np.float32).eps)
"""Least median luminance, as FLIP has it: the last exposure of a reference that is mostly black."""
TRIMMED_SHARE = 1e-3
"""Share of the pixels, those with the largest errors, that ``relmse_trimmed`` leaves out."""

WHITE = 4.0
"""Radiance at which the clipped measures clip image and reference: four times the white of the display, which is 1
with the exposure applied.  Two stops of highlights count; how far a lamp is above them does not."""

TAIL_SHARE = 1e-3
"""``tail`` is the share of an error that lies in this share of the pixels, those with the largest errors."""

DISCARDS = int(NOT_COMPARABLE) | sum(int(bit) for bit in FEATURE_BIT.values())
"""Bits of the exact mask: with any of them, the history of a pixel is invalid."""


class Measure(Struct, frozen=True, forbid_unknown_fields=True):
    """One number of a frame.  ``better``: higher or lower; ``digits`` after the point in tables; ``metric``: the name
    of option_groups.METRICS that requests it, empty: always computed."""

    unit: str
    better: str
    digits: int
    doc: str
    metric: str = ""


MEASURES = read_toml(Path(__file__).with_name("measures.toml"), dict[str, Measure])
"""The numbers of a frame by name, in the order of tables."""

ROBUST = {"linear_mse": "clipped_mse", "relmse": "clipped_relmse"}
"""Measure of unbounded radiance -> the same of clipped radiance, which rankings use instead."""

LINEAR = frozenset({*ROBUST, *ROBUST.values(), "relmse_trimmed"})
"""Measures of linear radiance of single pixels: those that show an emitting surface are left out."""


def display(radiance: Array, curve: str = "linear") -> Array:
    """Display colors in [0, 1], (h, w, 3) float64: tone map and sRGB of exposed radiance."""
    return display_color(np.asarray(radiance, dtype=np.float64), 1.0, curve)


def psnr(mse: float) -> float | None:
    """10 log10(1 / MSE), dB; None for equal images, whose PSNR is infinite."""
    return 10.0 * math.log10(1.0 / mse) if mse > 0 else None


def squared_error(shown: Array, reference: Array) -> Array:
    """Mean over channels of the squared difference of display colors.  -> (h, w) float64."""
    return channels(np.add, (shown - reference) ** 2) / 3.0


def linear_squared_error(image: Array, reference: Array) -> Array:
    """Mean over channels of (image - reference)^2 of linear radiance.  -> (h, w) float64."""
    image, reference = (np.asarray(x, dtype=np.float64) for x in (image, reference))
    return channels(np.add, (image - reference) ** 2) / 3.0


def independent_squared_error(image: Array, first: Array, second: Array) -> Array:
    """Mean over channels of (image - first)(image - second).  -> (h, w) float64.

    ``first``, ``second``: independent unbiased estimates of one truth, independent of ``image``: the expectation is the
    squared error against the truth, without the variance of the estimates.  Single values can be negative.
    """
    image, first, second = (np.asarray(x, dtype=np.float64) for x in (image, first, second))
    return channels(np.add, (image - first) * (image - second)) / 3.0


def tail(error: Array) -> tuple[float, float]:
    """Sum of the largest TAIL_SHARE of the values of ``error``, at least one value, and of all; none is negative."""
    values = error.ravel()
    most = math.ceil(TAIL_SHARE * values.size)
    return float(np.partition(values, values.size - most)[values.size - most :].sum()), float(values.sum())


def half_noise(first: Array, second: Array, curve: str, scored: Array) -> dict[str, float]:
    """Variance of the mean of two independent halves of a reference, in the unit of each squared measure.

    ``first``, ``second`` (h, w, 3): equal numbers of samples, so that the variance of their mean is (first - second)^2
    / 4; ``scored`` (h, w) bool: pixels that linear measures count.  -> the squared errors that noise of the reference
    adds to measures; ``psnr_db`` as mean squared error.
    """
    relative = 0.25 * (first - second) ** 2 / (0.25 * (first + second) ** 2 + RELMSE_EPSILON)
    low, high = (np.minimum(half, WHITE) for half in (first, second))
    clipped = 0.25 * (low - high) ** 2
    by_measure = {
        "psnr_db": 0.25 * (display(first, curve) - display(second, curve)) ** 2,
        "relmse": relative[scored],
        "linear_mse": 0.25 * (first - second)[scored] ** 2,
        "clipped_mse": clipped[scored],
        "clipped_relmse": (clipped / (0.25 * (low + high) ** 2 + RELMSE_EPSILON))[scored],
    }
    return {name: float(values.mean()) if values.size else 0.0 for name, values in by_measure.items()}


def relative_squared_error(image: Array, reference: Array) -> Array:
    """Mean over channels of (image - reference)^2 / (reference^2 + RELMSE_EPSILON).  -> (h, w) float64."""
    image, reference = (np.asarray(x, dtype=np.float64) for x in (image, reference))
    return channels(np.add, (image - reference) ** 2 / (reference**2 + RELMSE_EPSILON)) / 3.0


def linear_errors(image: Array, reference: Array) -> dict[str, Array]:
    """The maps of the measures in ROBUST, of all and of clipped radiance, (h, w) float64 each."""
    out = {"relmse": relative_squared_error(image, reference), "linear_mse": linear_squared_error(image, reference)}
    image, reference = np.minimum(image, WHITE), np.minimum(reference, WHITE)
    out["clipped_mse"] = linear_squared_error(image, reference)
    return out | {"clipped_relmse": relative_squared_error(image, reference)}


def fixed_gain(reference: Array) -> float | None:
    """The factor that meters a reference image (h, w, 3) to middle gray, see metrics.exposure; None if it is black."""
    return metered_exposure(np.asarray(reference, dtype=np.float64).reshape(-1, 3))


def trimmed_relative_error(image: Array, reference: Array, gain: float) -> float:
    """Mean relative squared error of radiance times ``gain``, without the TRIMMED_SHARE of pixels with the largest.

    The exposure fixes what the epsilon of relMSE means; the trim takes out fireflies, which it does not call an error.
    """
    error = relative_squared_error(gain * image, gain * reference).ravel()
    keep = error.size - math.ceil(TRIMMED_SHARE * error.size)
    return float(np.partition(error, keep - 1)[:keep].mean()) if keep > 0 else float(error.mean())


def ssim(shown: Array, reference: Array) -> float | None:
    """Mean structural similarity; None for images smaller than its window of 11 pixels."""
    from skimage.metrics import structural_similarity

    if min(shown.shape[:2]) < SSIM_SIDE:
        return None
    return float(
        structural_similarity(
            shown,
            reference,
            channel_axis=-1,
            data_range=1.0,
            gaussian_weights=True,
            sigma=SSIM_SIGMA,
            use_sample_covariance=False,
        )
    )


def flip_map(shown: Array, reference: Array) -> Array:
    """LDR-FLIP of every pixel, (h, w) float64 in [0, 1].  Raises ValueError for values that are not finite."""
    images = _finite_images(reference, shown)
    error, _, _ = _flip().evaluate(*images, "LDR", applyMagma=False, computeMeanError=False)
    return np.asarray(error, dtype=np.float64)[..., 0]


def flip_exposures(reference: Array) -> tuple[float, float] | None:
    """First and last exposure of HDR-FLIP in stops, from the reference (h, w, 3); None without light.

    Source: Andersson et al. 2021, Visualizing Errors in Rendered High Dynamic Range Images, section 3.2.
    """
    luminance = np.asarray(reference, np.float64) @ LUMINANCE
    most = float(luminance.max())
    if most < float(np.finfo(np.float32).tiny):
        return None
    a, b, c, d, e = FLIP_ACES
    p, q, r = a - FLIP_WHITE * c, b - FLIP_WHITE * d, -FLIP_WHITE * e
    white = (-q + math.sqrt(q * q - 4.0 * p * r)) / (2.0 * p)
    middle = min(max(float(np.median(luminance)), FLIP_DARK), most)
    return math.log2(white / most), math.log2(white / middle)


def hdr_flip(radiance: Array, reference: Array) -> float | None:
    """Mean HDR-FLIP of linear radiance (h, w, 3); None for a reference without light, which gives no exposures.

    Negative values count as 0.  Raises ValueError for values that are not finite.  FLIP's package ends the process
    where it finds no exposures, so they are computed here.
    """
    images = [np.maximum(x, 0.0) for x in _finite_images(reference, radiance)]
    exposures = flip_exposures(images[0])
    if exposures is None:
        return None
    parameters = dict(zip(("startExposure", "stopExposure"), exposures, strict=True))
    error, _, _ = _flip().evaluate(*images, "HDR", applyMagma=False, computeMeanError=False, parameters=parameters)
    return float(np.mean(error, dtype=np.float64))


def _flip() -> ModuleType:
    """FLIP's package.  Its OpenMP threads sleep between parallel loops: waiting in loops takes three times the time."""
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # read when the library is loaded
    return importlib.import_module("flip_evaluator")


def _finite_images(*images: Array) -> list[Array]:
    """``images`` as contiguous float32.  Raises ValueError for values that are not finite, which FLIP accepts
    silently.
    """
    for values in images:
        if not np.isfinite(values).all():
            raise ValueError("FLIP needs finite colors")
    return [np.ascontiguousarray(x, dtype=np.float32) for x in images]


def temporal_squared_error(shown: Array, before: Array, reference: Array, reference_before: Array) -> Array:
    """Squared difference of the frame-to-frame changes of an image and of the reference.  -> (h, w) float64."""
    return channels(np.add, ((shown - before) - (reference - reference_before)) ** 2) / 3.0


def history_of(image: Array, motion_px: Array) -> Array:
    """``image`` of the previous frame, reprojected by nearest sampling as in the masks.

    ``motion_px`` (h, w, 2) previous - current, +y down; outside the image, its edge is repeated.  -> as ``image``.
    """
    h, w = image.shape[:2]
    y, x = np.indices((h, w))
    far = np.clip(motion_px, -4 * (h + w), 4 * (h + w))
    at_x = np.floor(x + far[..., 0] + 0.5).astype(np.int64)
    at_y = np.ceil(y + far[..., 1] - 0.5).astype(np.int64)  # the masks round half up in GL's bottom-up rows
    return image[np.clip(at_y, 0, h - 1), np.clip(at_x, 0, w - 1)]


def flicker(
    shown: Array, before: Array, reference: Array, reference_before: Array, motion_px: Array, reusable: Array
) -> float | None:
    """Mean over ``reusable`` pixels of |change along motion - change of the reference|; None without such pixels.

    The warping error of Lai et al. 2018 (Learning Blind Video Temporal Consistency) with two differences: the mask is
    the exact mask instead of one from estimated flow, and the change of the reference (highlights, resampling) is
    subtracted, so that the reference has 0.
    """
    if not reusable.any():
        return None
    change = shown - history_of(before, motion_px)
    expected = reference - history_of(reference_before, motion_px)
    return float(np.abs(change - expected)[reusable].mean())


def warp_error(shown: Array, before: Array, motion_px: Array, reusable: Array) -> float | None:
    """Mean over ``reusable`` pixels and channels of (change along motion)^2; None without such pixels.

    The warping error of Lai et al. 2018, without a reference: it is also the smallest for a frozen or blurred image, so
    read it beside that of the reference.  The mask and the motion are exact instead of estimated.
    """
    if not reusable.any():
        return None
    return float(((shown - history_of(before, motion_px)) ** 2)[reusable].mean())


def reusable(mask: Array) -> Array:
    """Pixels whose history no bit of the exact ``mask`` (h, w) discards, (h, w) bool."""
    return (mask & np.uint32(DISCARDS)) == 0
