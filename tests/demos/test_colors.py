"""The colors of masks against those of the objects that they lie on: distances in CIELAB."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.report.palette import color_of

CLEAR = 25.0
"""Least distance (CIE 1976) of a mask's color; about 2.3 is just visible."""
RGB_TO_XYZ = np.array([
    [0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041],
])  # fmt: skip
WHITE = np.array([0.95047, 1.0, 1.08883])  # D65


def cielab(rgb) -> np.ndarray:
    """8-bit sRGB (..., 3) -> L*, a*, b*.  CIE 15:2004, Eq. 8.3."""
    encoded = np.asarray(rgb, dtype=np.float64) / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    t = linear @ RGB_TO_XYZ.T / WHITE
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def test_cielab_of_known_colors():
    """White, and the primaries by B. Lindbloom's tables."""
    known = {(255, 255, 255): (100, 0, 0), (255, 0, 0): (53.24, 80.09, 67.20), (0, 0, 255): (32.30, 79.19, -107.86)}
    for rgb, lab in known.items():
        assert cielab(rgb) == pytest.approx(lab, abs=0.03)


def test_mask_colors_differ_from_the_objects(demo, runs, gpu):
    """In both frames of a lesson, all but 0.5 % of the pixels, which noise may color."""
    pair = runs.pair(demo, gpu)
    for frame in (pair.before, pair.now):
        objects = cielab(np.round(255.0 * np.clip(frame["color"][..., :3], 0.0, 1.0)))
        for mask in demo.opening.masks:
            close = np.linalg.norm(objects - cielab(color_of(mask)), axis=-1) < CLEAR
            assert close.mean() <= 0.005, f"{demo.name}: {100 * close.mean():.1f} % look like {mask!r}"
