"""What the pairs of one evaluation add up to: the rows of frames.csv, and the sums from which summary.json is made.

A Session fills a Tally while it draws; a batch fills one from the records of its workers.  Equal pairs in the same
order give equal files, bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from taubench_gl.animation import View
from taubench_gl.conventions import COUNTED, HISTOGRAM_BINS
from taubench_gl.evaluation.brightness import Brightness, describe_brightness
from taubench_gl.evaluation.lighting import LightPlan
from taubench_gl.evaluation.lobes import BOUNCES, measured_lobes
from taubench_gl.evaluation.sampled_light import SampledLight
from taubench_gl.evaluation.scale import describe_scale
from taubench_gl.evaluation.summary import assemble_summary
from taubench_gl.features import COLUMNS, FEATURES
from taubench_gl.metrics.activity import camera_activity
from taubench_gl.metrics.counts import Counts
from taubench_gl.metrics.exact_rates import exact_summary
from taubench_gl.metrics.sampled_light import decided_summary, sampled_columns
from taubench_gl.metrics.sequence_stats import SequenceStats, with_reprojections
from taubench_gl.settings import Settings


class Tally:
    """Rows and sums of the pairs that were added, in their order.

    ``brightness`` and ``depths`` (scene units) are of the checked frames; ``sampled`` is the light at random pixels,
    None where no column is sampled.
    """

    def __init__(
        self,
        settings: Settings,
        frames: range,
        light: LightPlan,
        unmeasured: Mapping[str, str],
        reprojection: str,
        other: str,
        missing_lobes: Mapping[str, Mapping[str, str]],
    ):
        """``unmeasured``: column of the source -> why it is null; ``reprojection``, ``other``: of the source;
        ``missing_lobes``: requested lobe -> {direct or indirect: why it is null}."""
        self.settings, self.frames, self.light = settings, frames, light
        self._unmeasured, self._reprojection = dict(unmeasured), reprojection
        self.rows: list[dict[str, Any]] = []
        self.stats = SequenceStats(tuple(c for c in COLUMNS if c not in unmeasured), self._unmeasured, other)
        self._lobes = {
            lobe: SequenceStats(tuple(b for b in BOUNCES if b not in reasons), dict(reasons))
            for lobe, reasons in missing_lobes.items()
        }
        self.brightness, self.depths = Brightness(), []
        self.sampled: SampledLight | None = None
        if light is LightPlan.SAMPLED and sampled_columns(unmeasured, settings.metrics.columns):
            self.sampled = SampledLight(settings, frames, unmeasured, measured_lobes(missing_lobes), other == COUNTED)

    def add(
        self,
        frame: int,
        counts: Counts,
        views: tuple[View, View],
        lobes: Mapping[str, np.ndarray],
        row: dict[str, Any],
    ) -> None:
        """Add the pair of ``frame`` with the frame before, and complete its ``row`` of frames.csv.

        ``views``: of the camera in both frames; ``lobes``: mask histogram (MASK_WORDS,) by lobe; ``row``: has the
        columns of column groups.
        """
        if self.sampled is not None:
            self.sampled.add(frame - 1 - self.frames[0], counts)
        for lobe, histogram in lobes.items():
            no_distances = np.zeros((len(FEATURES), HISTOGRAM_BINS), dtype=np.int64)
            self._lobes[lobe].add(Counts(histogram, no_distances))
        row |= {"frame": frame, "time_s": frame / self.settings.sequence.fps}
        row |= self.stats.add(counts) | _camera_row(views, self.settings.metrics.unit_scale)
        self.rows.append(row)

    def summary(self, static: Mapping[str, Any], views: list[View], source: Mapping[str, Any]) -> dict[str, Any]:
        """The content of summary.json for the pairs that were added, without timing and provenance.

        ``static``: what needs no pair (``summary.static_summary``); ``views``: of all frames; ``source``: what the
        source of the frames says of itself (``Source.describe``).
        """
        settings = self.settings
        columns = () if self.sampled is None else self.sampled.estimate.columns
        summary = assemble_summary(static, self.frames, settings, views, self.stats, columns)
        summary["notes"] += source.get("notes", [])
        summary |= {name: block for name, block in source.items() if name != "notes"}
        of_images = self.light in (LightPlan.PREVIEW, LightPlan.FIXED)
        describe_brightness(summary, self.brightness, settings, of_images)
        describe_scale(summary, self.depths, settings)
        if self.light is LightPlan.DECIDED:
            summary["decided_light"] = decided_summary(self.rows)
        if self._lobes:
            summary["lobes"] = {lobe: _of_bounces(stats) for lobe, stats in self._lobes.items()}
        if settings.metrics.exact:
            summary["exact"] = exact_summary(self.rows, self._unmeasured, self._reprojection)
        previewed = sampled_columns(self._unmeasured, settings.metrics.columns)
        if self.light is LightPlan.PREVIEW and previewed:
            note = "of the preview, whose light is approximate; evaluate --light auto estimates the truth"
            summary["notes"].append(f"{', '.join(previewed)}: {note}")
        if self.sampled is not None:
            self.sampled.finish(summary, self.rows, self.frames)
        summary["reusable"] = with_reprojections(summary["reusable"])
        return summary


def _of_bounces(stats: SequenceStats) -> dict[str, Any]:
    discard = stats.discard(np.zeros(stats.pairs, dtype=bool))
    return {bounce: discard[bounce] for bounce in BOUNCES}


def _camera_row(views: tuple[View, View], unit_scale: float) -> dict[str, Any]:
    """How the camera moved between two frames, as columns of frames.csv; ``unit_scale``: scene units per meter."""
    activity = camera_activity(np.array([v.position for v in views]), np.array([v.world_from_view for v in views]))
    return {
        "translation_m": float(activity.position[0]) / unit_scale,
        "yaw_deg": float(activity.yaw[0]),
        "pitch_deg": float(activity.pitch[0]),
        "roll_deg": float(activity.roll[0]),
        "angle_deg": float(activity.angle[0]),
        "gimbal": bool(activity.gimbal[0]),
    }
