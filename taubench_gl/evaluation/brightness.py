"""Pixels that clip, are black, noisy or behind culled backs: counts of the first, middle and last frame of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from taubench_gl.evaluation.schedule import Schedule, first_middle_last
from taubench_gl.frame.sources import Source
from taubench_gl.frame.targets import read_channel
from taubench_gl.settings import Settings

BLACK = 0.5 / 255.0
"""Display color, in every channel, below which a pixel is black."""

BLACK_RADIANCE = BLACK / 12.92
"""Radiance times exposure that sRGB encodes as ``BLACK``."""

WHITE = 1.0 - 1e-4
"""Display color, or radiance times exposure, from which a channel clips: 1 less rounding."""

MOST_CLIPPED, MOST_BLACK, MOST_NOISY, MOST_BEHIND = 0.2, 0.9, 0.01, 0.01
"""Shares above which a run has a note: clipped of lit pixels; black, noisy and behind culled backs of all."""


@dataclass(slots=True)
class Brightness:
    """Counts of pixels in the checked frames of a run.

    Lit: of a surface, not black.  Clipped: lit, a channel is at white.

    Noisy: the standard error of path-traced direct or indirect luminance, times exposure and sqrt(2) for the difference
    of two frames, is above the threshold.  Behind: seen through a culled back of a face that casts shadows.
    """

    frames: int = 0
    pixels: int = 0
    black: int = 0
    lit: int = 0
    clipped: int = 0
    noisy: int = 0
    behind: int = 0

    def add(self, other: Mapping[str, int]) -> None:
        """Add the counts that ``as_dict`` of another one returned."""
        for name, count in other.items():
            setattr(self, name, getattr(self, name) + count)

    def count(self, source: Source, settings: Settings) -> None:
        """Add the current frame of ``source``: its color, or without one its light times exposure."""
        textures = source.current
        if "color" in textures:
            value, black = read_channel(textures["color"], "color")[..., :3], BLACK
        else:
            channels = [read_channel(textures[n], n)[..., :3] for n in ("direct", "indirect") if n in textures]
            if not channels:
                return
            value = sum(channels[1:], channels[0]).astype(np.float64) * settings.lighting.exposure_factor
            black = BLACK_RADIANCE
        top = value.max(axis=-1)
        surface = read_channel(textures["position"], "position")[..., 3] > 0.0
        dark = top < black
        lit = surface & ~dark & np.isfinite(top)
        clipped = lit & (top >= WHITE)
        noisy = np.zeros(0)
        if "path_info" in textures:
            noisy = noise_of_a_sample(textures, settings) > np.sqrt(settings.lighting.path_samples)
        counts = {"pixels": top.size, "lit": lit.sum(), "clipped": clipped.sum()}
        counts["black"] = dark.sum() if surface.any() else 0  # where nothing is drawn, no light can be wrong
        counts |= {"noisy": noisy.sum(), "behind": source.hidden_backs()}
        self.add({"frames": 1} | {name: int(count) for name, count in counts.items()})

    def as_dict(self) -> dict[str, int]:
        """The counts by name, as JSON values."""
        return asdict(self)

    def notes(self, settings: Settings, unit_reason: str = "", of_images: bool = True) -> list[str]:
        """Notes on an unusual image, at most one line for each kind.

        ``unit_reason``: why the light unit was chosen; ``of_images``: whether light columns are those of images, whose
        noise reaches them.
        """
        exposure = f"exposure {settings.lighting.exposure_factor:.4g}"
        where = f"in {self.frames} frame{'s' if self.frames != 1 else ''}"
        notes = []
        if self.clipped > MOST_CLIPPED * self.lit:
            share = 100.0 * self.clipped / self.lit
            notes.append(f"{share:.0f} % of lit pixels clip {where} at {exposure}: give a lower --exposure")
        if self.black > MOST_BLACK * self.pixels:
            share = 100.0 * self.black / self.pixels
            note = f"{share:.0f} % of pixels are black {where} at {exposure}"
            if settings.lighting.light_unit == "watt":
                unit = f" ({unit_reason})" if unit_reason else ""
                notes.append(f"{note} and light unit watt{unit}: intensities in candela need --light-unit candela")
            else:
                notes.append(f"{note}: a higher --exposure or an --environment may be needed")
        if self.noisy > MOST_NOISY * self.pixels and of_images:
            share = 100.0 * self.noisy / self.pixels
            spp = settings.lighting.path_samples
            note = f"noise of path-traced light exceeds a threshold in {share:.0f} % of pixels {where} at {spp} samples"
            notes.append(f"{note}: where something moves, columns of light are too high; give a higher --spp")
        if self.behind > MOST_BEHIND * self.pixels:
            share = 100.0 * self.behind / self.pixels
            note = f"{share:.0f} % of pixels {where} are seen through backs of single-sided faces"
            notes.append(f"{note}, which cast shadows but are not drawn: --culling none draws them")
        return notes


def noise_of_a_sample(textures: Mapping[str, Any], settings: Settings) -> np.ndarray:
    """Standard deviation of the difference of two path-traced samples over its threshold, the larger of direct's and
    indirect's.  (h, w) float64; 0 where one sample was taken, which has no variance, and where nothing is drawn;
    infinite where the threshold is 0 and samples differ.

    Of n samples it is sqrt(n) smaller.
    """
    info = read_channel(textures["path_info"], "path_info").astype(np.float64)
    deviation = np.sqrt(2.0 * np.maximum(info[..., 2:4], 0.0) * info[..., 1:2]) * settings.lighting.exposure_factor
    limits = np.array([settings.metrics.threshold(feature) for feature in ("direct", "indirect")])
    ratio = np.where(deviation > 0.0, np.inf, 0.0)
    np.divide(deviation, limits, out=ratio, where=limits > 0.0)
    surface = read_channel(textures["position"], "position")[..., 3] > 0.0
    return np.where(surface, ratio.max(axis=-1), 0.0)


def checked_frames(schedule: Schedule) -> frozenset[int]:
    """First, middle and last evaluated frame of the schedule of a whole run."""
    return frozenset(first_middle_last([frame for frame, evaluated in schedule if evaluated]))


def describe_brightness(
    summary: dict[str, Any], brightness: Brightness, settings: Settings, of_images: bool = True
) -> None:
    """Add the block ``brightness`` and its notes to a summary whose other notes are complete.  ``of_images``: as for
    ``Brightness.notes``."""
    reason = (summary.get("lighting") or {}).get("light_unit", "")
    summary["brightness"] = brightness.as_dict()
    summary["notes"] += brightness.notes(settings, reason, of_images)
