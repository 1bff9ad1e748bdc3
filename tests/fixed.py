"""Settings whose light is as the file gives it."""

from __future__ import annotations

from typing import Any

from taubench_gl.settings import FIXED_LIGHTING, Settings

FIXED: dict[str, Any] = {**FIXED_LIGHTING, "light": "raster", "shadow_size": 256, "probes": 96, "indirect_samples": 256}
"""Intensities as written, exposure 1, no environment, rasterized light: nothing is metered, no path is traced.

Shadow maps are small, probes and virtual lights few: the usual take two thirds of the time of a few small frames."""


def fixed_settings(**values: Any) -> Settings:
    """Settings with ``values``, and FIXED where they name nothing else."""
    return Settings(**{**FIXED, **values})
