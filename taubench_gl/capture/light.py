"""The light of games in one unit.

Sun, surfaces, light entities and dynamic lights keep the ratios that the map compiler of Quake 3 (q3map), the engine
of Cube 2, and the game give them: a byte of a lightmap is irradiance, so each can be written as one.  One factor is
free, LUX; the exposure of an evaluation cancels it.
"""

from __future__ import annotations

import numpy as np

LUX = 10.0
"""Lux per unit of irradiance, of which 255 saturates a lightmap: 2,550 lx, an overcast day."""
FULL_BRIGHT = 255 * LUX / np.pi
"""Luminance, cd/m^2, of white that the game draws without light: a white wall in irradiance of 255."""


def sun_lux(intensity: float) -> float:
    """Illuminance in lux of the sun that ``q3map_sun`` declares with ``intensity``."""
    return intensity * LUX


def entity_candela(light: float, meters: float) -> float:
    """Intensity of a light entity, cd: its irradiance at d units is 7500 times ``light`` / d^2.  ``meters``: of a
    unit.
    """
    return 7500 * light * LUX * meters**2


def surface_luminance(light: float) -> float:
    """Luminance, cd/m^2, of ``q3map_surfacelight``: q3map sends a quarter of it per unit of area, with both cosines."""
    return light / 4 * LUX


def linear_candela(radius: float, irradiance: float, meters: float) -> float:
    """Intensity, cd, of a light of Cube 2, which falls off linearly from ``irradiance`` to 0 at its radius, in units:
    the same at half the radius, brighter before it and darker after it.
    """
    return irradiance / 2 * (radius / 2) ** 2 * LUX * meters**2


def dynamic_candela(radius: np.ndarray | float, meters: float) -> np.ndarray | float:
    """Intensity, cd, of a light that the game adds while it runs: 16 units of irradiance at its ``radius``, in
    units.
    """
    return 16 * np.asarray(radius, dtype=float) ** 2 * LUX * meters**2
