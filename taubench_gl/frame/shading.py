"""Shading that is not exact at every pixel: shading rates, and numbers of random samples."""

from __future__ import annotations

from dataclasses import dataclass

from taubench_gl.errors import SettingsError
from taubench_gl.metrics.shading_rate import RATES

MAX_SAMPLES = 4096
"""Most random samples of a pixel: far below ``tuning.LOOP_LIMIT``."""


@dataclass(frozen=True, slots=True)
class Shading:
    """How light differs from exact light at every pixel.  Unless ``exact`` there is no tone-mapped ``color``."""

    rate: str = "full"  # one of metrics.shading_rate.RATES
    light_samples: int = 0  # light samples per pixel; 0: all lights, exactly
    indirect_samples: int = 0  # VPL samples per pixel; 0 with ``light_samples`` 0: exact
    seed: int = 0  # seed of the random numbers, 16 bits
    gather_each: bool = False  # method rsm: every pixel gathers, which is the expectation of the stochastic estimate
    both_frames: bool = False  # path-traced: rays can also be traced in the previous frame, for what shades later
    one_light: bool = False  # path-traced: a sample of the visible surface chooses one punctual light, not every one
    every_light: bool = False  # path-traced: every punctual light has a shadow ray at the visible surface

    def __post_init__(self) -> None:
        if self.rate not in RATES:
            raise SettingsError(f"shading rate is {self.rate!r}", hint=f"choose from {', '.join(RATES)}")
        for name, value in (("light samples", self.light_samples), ("indirect samples", self.indirect_samples)):
            if not 0 <= value <= MAX_SAMPLES:
                raise SettingsError(f"{name} is {value}", hint=f"give 0 to {MAX_SAMPLES}")
        if not 0 <= self.seed < 1 << 16:
            raise SettingsError(f"seed is {self.seed}", hint="give 0 to 65535")
        if (self.light_samples > 0) != (self.indirect_samples > 0):
            raise SettingsError("direct and indirect light are both sampled or both exact", hint="give both or neither")

    @property
    def exact(self) -> bool:
        """Whether every pixel gets its exact light, so that it has a color."""
        return self.rate == "full" and not self.stochastic

    @property
    def stochastic(self) -> bool:
        return self.light_samples > 0
