"""How far a picture is from its reference: one function per measure, float64, no OpenGL (docs/reuse-evaluation.md).

``picture`` and ``reference``: (h, w, 3) linear radiance, exposure applied, row 0 at the top; ``shown`` ones are what
``display`` makes of them, in [0, 1].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taubench_gl.conventions import FEATURE_BIT, NOT_COMPARABLE
from taubench_gl.metrics.color import display_color

Array = np.ndarray

RELMSE_EPSILON = 1e-2
"""Added to the squared reference, as usual since Rousselle et al. 2011, so that black pixels do not decide alone."""

SSIM_SIGMA, SSIM_SIDE = 1.5, 11
"""Wang et al. 2004: Gaussian window of standard deviation 1.5, 11 pixels wide."""

DISCARDS = int(NOT_COMPARABLE) | sum(int(bit) for bit in FEATURE_BIT.values())
"""Any of these bits of the noise-free mask, and the truth says that history does not hold in the pixel."""


@dataclass(frozen=True, slots=True)
class Measure:
    """One number of a frame.  ``better``: higher or lower; ``digits`` after the point in tables."""

    name: str
    unit: str
    better: str
    digits: int
    doc: str


MEASURES: dict[str, Measure] = {
    m.name: m
    for m in (
        Measure("psnr_db", "dB", "higher", 2, "10 log10(1 / MSE) of shown colours; over frames: of the mean MSE"),
        Measure("ssim", "", "higher", 4, "mean structural similarity of shown colours (Wang et al. 2004)"),
        Measure("flip", "", "lower", 4, "mean LDR-FLIP of shown colours, 67 pixels per degree (Andersson 2020)"),
        Measure("relmse", "", "lower", 5, "mean of (picture - reference)^2 / (reference^2 + 0.01), linear radiance"),
        Measure("tpsnr_db", "dB", "higher", 2, "PSNR of the change since the last frame against the reference's"),
        Measure("flicker", "", "lower", 5, "mean |change along motion - the reference's| where history holds"),
    )
}  # fmt: skip

CHOICES = ("psnr", "ssim", "flip", "relmse", "tpsnr", "flicker")
"""As a user names them; PSNR and relMSE cost nothing and are always there."""


def display(radiance: Array, curve: str = "linear") -> Array:
    """Shown colours in [0, 1], (h, w, 3) float64: tone curve and sRGB, exposure being applied already."""
    return display_color(np.asarray(radiance, dtype=np.float64), 1.0, curve)


def psnr(mse: float) -> float | None:
    """10 log10(1 / MSE), dB; None for pictures that are equal, whose PSNR is infinite."""
    return 10.0 * math.log10(1.0 / mse) if mse > 0 else None


def squared_error(shown: Array, reference: Array) -> Array:
    """Mean over channels of the squared difference of shown colours.  -> (h, w) float64."""
    return np.mean((shown - reference) ** 2, axis=-1)


def relative_squared_error(picture: Array, reference: Array) -> Array:
    """Mean over channels of (picture - reference)^2 / (reference^2 + RELMSE_EPSILON).  -> (h, w) float64."""
    picture, reference = (np.asarray(x, dtype=np.float64) for x in (picture, reference))
    return np.mean((picture - reference) ** 2 / (reference**2 + RELMSE_EPSILON), axis=-1)


def ssim(shown: Array, reference: Array) -> float | None:
    """Mean structural similarity; None for pictures smaller than its window of 11 pixels."""
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
    import flip_evaluator

    for values in (shown, reference):
        if not np.isfinite(values).all():  # the evaluator would swallow them
            raise ValueError("FLIP needs finite colours")
    images = (np.ascontiguousarray(x, dtype=np.float32) for x in (reference, shown))
    error, _, _ = flip_evaluator.evaluate(*images, "LDR", applyMagma=False, computeMeanError=False)
    return np.asarray(error, dtype=np.float64)[..., 0]


def temporal_squared_error(shown: Array, before: Array, reference: Array, reference_before: Array) -> Array:
    """Squared difference between a picture's change since the last frame and the reference's.  -> (h, w) float64."""
    return np.mean(((shown - before) - (reference - reference_before)) ** 2, axis=-1)


def history_of(image: Array, motion_px: Array) -> Array:
    """``image`` of the last frame where each pixel's surface was: nearest pixel, as the masks sample it.

    ``motion_px`` (h, w, 2) previous - current, +y down; what was outside takes the border.  -> as ``image``.
    """
    h, w = image.shape[:2]
    y, x = np.indices((h, w))
    far = np.clip(motion_px, -4 * (h + w), 4 * (h + w))
    at_x = np.floor(x + far[..., 0] + 0.5).astype(np.int64)
    at_y = np.ceil(y + far[..., 1] - 0.5).astype(np.int64)  # the masks round half up in GL's rows, which count upwards
    return image[np.clip(at_y, 0, h - 1), np.clip(at_x, 0, w - 1)]


def flicker(
    shown: Array, before: Array, reference: Array, reference_before: Array, motion_px: Array, reusable: Array
) -> float | None:
    """Mean over ``reusable`` pixels of |change along the motion - the reference's change along it|; None without any.

    The warping error of Lai et al. 2018 (Learning Blind Video Temporal Consistency) with two departures: the mask is
    the noise-free truth's, not one from estimated flow, and the reference's own change (highlights, resampling) is
    taken out, so the reference has 0.
    """
    if not reusable.any():
        return None
    change = shown - history_of(before, motion_px)
    expected = reference - history_of(reference_before, motion_px)
    return float(np.abs(change - expected)[reusable].mean())


def reusable(mask: Array) -> Array:
    """(h, w) bool: pixels whose history the noise-free truth does not discard for any reason."""
    return (mask & np.uint32(DISCARDS)) == 0
