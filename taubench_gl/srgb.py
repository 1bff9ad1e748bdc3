"""The sRGB transfer function, and luminance."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Luminance of linear Rec. 709 RGB is the dot product with this.  GLSL: common/luminance.glsl."""


def srgb_encode(linear: Array) -> Array:
    """The sRGB transfer function (IEC 61966-2-1) of values in [0, 1].  (...) -> (...)."""
    linear = np.asarray(linear)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def srgb_decode(encoded: Array) -> Array:
    """Linear values of sRGB-encoded ones in [0, 1].  (...) -> (...) float64."""
    encoded = np.asarray(encoded, dtype=np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
