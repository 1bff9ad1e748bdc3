"""Settings whose light is as the file gives it."""

from __future__ import annotations

from typing import Any

from taubench_gl.settings import FIXED_LIGHTING, Settings

FIXED: dict[str, Any] = {**FIXED_LIGHTING, "light": "raster", "shadow_size": 256}
"""Intensities as written, exposure 1, no environment, rasterized light: nothing is metered, no path is traced.

Shadow maps are small: to make and clear those of the usual size takes half of the time of a few small frames."""


def fixed_settings(**values: Any) -> Settings:
    """Settings with ``values``, and FIXED where they name nothing else."""
    return Settings(**{**FIXED, **values})
