"""Exact visibility beside the masks: which discards rays and the light of the same points confirm.  On request only."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from taubench_gl.conventions import CHANGED_LIGHT, Visibility
from taubench_gl.evaluation.brightness import checked_frames
from taubench_gl.evaluation.pairs import Pair
from taubench_gl.evaluation.previous_shading import LIGHT, PointLight, PreviousShading, Variant, needed
from taubench_gl.evaluation.schedule import frame_schedule
from taubench_gl.features import FEATURE_BIT, FEATURES, GEOMETRY
from taubench_gl.frame.passes.visibility import CHANNEL
from taubench_gl.frame.sources import RasterSource
from taubench_gl.metrics.exact_rates import CHANGES, CLASSES, class_column, light_reasons
from taubench_gl.metrics.reuse_rate import RATE_BITS
from taubench_gl.run_schema import EXACT_COLUMNS
from taubench_gl.settings import Settings

Array = np.ndarray


def exact_channels() -> tuple[str, ...]:
    """Channels that a source must draw for ``ExactReasons`` besides those of its columns."""
    return (CHANNEL, *needed())


@dataclass(frozen=True, slots=True)
class Reasons:
    """Why history is right or wrong in every pixel of one pair.

    ``bits`` (h, w) uint32 of ``Visibility``, with CHANGED_LIGHT; ``light``: None where light is not compared.
    """

    bits: Array
    light: PointLight | None


class ExactReasons:
    """Why history is wrong, for every pixel of the pairs of a source: rays, and the light of the same points."""

    def __init__(
        self,
        variant: Variant,
        settings: Settings,
        radiance: Collection[str],
        *,
        without: tuple[str, ...] = (),
    ):
        """``variant``: opens a source beside that of the pairs; ``radiance``: those of direct, indirect and color that
        the source of the pairs has.

        ``without``: effects not to simulate.
        """
        self._thresholds = {name: settings.metrics.threshold(name) for name in LIGHT}
        lit = {*LIGHT, "color"} & set(radiance)
        self._shading = PreviousShading(variant, settings, without) if lit else None

    @property
    def lit(self) -> bool:
        """Whether light is compared."""
        return self._shading is not None

    def of(self, source: RasterSource, frame: int, *, noise: bool = False) -> Reasons:
        """The reasons of the pair that ``source`` holds with ``exact_channels``; ``frame``: of its current frame.

        ``noise``: also take other samples of path-traced light, to tell its noise.
        """
        bits = source.read(CHANNEL)[..., 0]
        if self._shading is None:
            return Reasons(bits, None)
        light = self._shading.of(source, frame, noise=noise)
        seen = (bits & (Visibility.VISIBLE | Visibility.SKY)) == Visibility.VISIBLE
        return Reasons(bits | light_reasons(light.total, light.by_direction, self._thresholds, seen), light)


def misregistered(mask: Array, reasons: Reasons, column: str, settings: Settings, reprojection: str) -> Array:
    """Pixels that ``column`` (of FEATURES) discards although the previous camera saw their surface point.  (h, w).

    What a point's own motion explains is left out: under camera reprojection, and in normal always; and for columns of
    light where the point's own value changed by more than the threshold.
    """
    bits = reasons.bits
    wrong = ((mask & FEATURE_BIT[column]) != 0) & ((bits & Visibility.VISIBLE) != 0)
    if column == "normal" or reprojection == "camera":
        wrong &= (bits & Visibility.MOVED) == 0
    if column in LIGHT:
        wrong &= np.linalg.norm(reasons.light.total[column], axis=-1) <= settings.metrics.threshold(column)
    if column == "color":
        wrong &= reasons.light.color <= settings.metrics.threshold(column)
    return wrong


def missed(mask: Array, bits: Array) -> Array:
    """Pixels whose point was occluded, and that no geometric column discards.  (h, w) bool."""
    return ((bits & Visibility.OCCLUDED) != 0) & ((mask & RATE_BITS["surface"]) == 0)


class ExactColumns:
    """Adds EXACT_COLUMNS to the row of every pair."""

    columns, distances = EXACT_COLUMNS, False

    def __init__(
        self,
        reasons: ExactReasons,
        unmeasured: Mapping[str, str],
        settings: Settings,
        reprojection: str,
        noisy: Collection[int] = (),
    ):
        """``unmeasured``: column -> why it is null; ``reprojection``: of the source; ``noisy``: frames at which the
        noise of path-traced light is measured."""
        self._reasons, self._settings, self._reprojection, self._noisy = reasons, settings, reprojection, noisy
        self._measured = tuple(c for c in FEATURES if c not in unmeasured)

    @classmethod
    def of_source(cls, variant: Variant, settings: Settings, source: RasterSource, frames: range) -> ExactColumns:
        """The column group for the pairs of ``source``, drawn with ``exact_channels``; ``frames``: of the whole run."""
        reasons = ExactReasons(variant, settings, source.radiance)
        noisy = checked_frames(frame_schedule(frames, settings))
        return cls(reasons, source.unmeasured, settings, source.reprojection, noisy)

    def fill_row(self, pair: Pair) -> None:
        """Add EXACT_COLUMNS to the row of ``pair``."""
        reasons = self._reasons.of(pair.source, pair.frame, noise=pair.frame in self._noisy)
        pair.row.update(self.row(pair.mask, reasons))

    def row(self, mask: Array, reasons: Reasons) -> dict[str, int | None]:
        """The values of EXACT_COLUMNS for a pair with the ``mask`` (h, w); None for what was not measured."""
        bits, row = reasons.bits, dict.fromkeys(EXACT_COLUMNS)
        counts: dict[str, Array] = {class_column(name): bits & bit for name, bit in CLASSES.items()}
        for column in self._measured:
            counts[f"misregistered_{column}"] = misregistered(mask, reasons, column, self._settings, self._reprojection)
        if set(GEOMETRY) <= set(self._measured):
            counts["missed"] = missed(mask, bits)
        if reasons.light is not None and reasons.light.total:
            counts |= {name: bits & bit for name, bit in CHANGES.items()}
        if reasons.light is not None and reasons.light.noise is not None:
            counts["light_noise"] = self._noise(reasons)
        return row | {name: int(np.count_nonzero(pixels)) for name, pixels in counts.items()}

    def _noise(self, reasons: Reasons) -> Array:
        limits = {name: self._settings.metrics.threshold(name) for name in LIGHT}
        above = [np.linalg.norm(v, axis=-1) > limits[name] for name, v in reasons.light.noise.items()]
        return np.logical_or.reduce(above) & ((reasons.bits & Visibility.VISIBLE) != 0)


def changed_light(bits: Array) -> Array:
    """Visible points whose light changed by more than a threshold, for whatever reason.  (h, w) bool."""
    return (bits & CHANGED_LIGHT) != 0
