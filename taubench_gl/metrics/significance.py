"""Holm's correction for many comparisons."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def holm_adjusted(p_values: Array) -> Array:
    """Holm's adjusted p-values: Holm's method rejects at every significance from them on.  -> float64, same shape.

    The i-th smallest of m values becomes the largest of (m - j + 1) p_j over j <= i, at most 1 (Holm 1979).
    """
    flat = np.asarray(p_values, dtype=np.float64).ravel()
    order = np.argsort(flat, kind="stable")
    raised = np.maximum.accumulate(flat[order] * (len(flat) - np.arange(len(flat))))
    adjusted = np.empty(len(flat))
    adjusted[order] = np.minimum(raised, 1.0)
    return adjusted.reshape(np.shape(p_values))
