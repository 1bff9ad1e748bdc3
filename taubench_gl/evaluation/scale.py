"""Whether the position threshold and the camera fit the size of what is seen: a wrong unit or frame rate shows here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from taubench_gl.animation import Poser, bounding_sphere
from taubench_gl.conventions import DEFAULT_THRESHOLD
from taubench_gl.errors import SceneError
from taubench_gl.frame.sources import Source
from taubench_gl.scene.model import Scene
from taubench_gl.settings import LEAST_LENGTH, Settings

SMALLEST, LARGEST = 0.002, 0.2
"""Default position threshold over median depth, below or above which a run has a note: depths of 63 m and 0.63 m.

Of scenes in meters it is 0.004 (Sponza) to 0.13 (a fox at 1 m), of the fox in centimeters 0.001.
"""

FLOAT32_STEP = 2.0**-24
"""Relative step of float32."""

FASTEST = 0.5
"""Median step of the camera per frame over median depth, above which a run has a note."""

UNITS = {100.0: "centimeters", 1000.0: "millimeters", 0.001: "kilometers"}
"""Scene units per meter of units that files have, the more frequent first."""

USUAL_M = 0.5, 50.0
"""Median depth of usual scenes, meters: a unit that gives such a depth may be meant."""

USUAL_RATIO = 0.02
"""Position threshold over median depth of usual scenes."""


def require_scale(scene: Scene) -> None:
    """Raises SceneError for a scene in which a position threshold of 0 asks for distances whose squares vanish.

    The least distance that counts then is the step of float32 positions.  ``Settings`` refuses other thresholds that
    are too small.
    """
    span = 2.0 * bounding_sphere(Poser(scene), [0.0])[1]
    if span * FLOAT32_STEP < LEAST_LENGTH:
        message = f"the scene spans {span:.3g} units: squares of its smallest distances vanish in float32"
        hint = f"scale it to at least {LEAST_LENGTH / FLOAT32_STEP:.2g} units, or give a position threshold above 0"
        raise SceneError(message, where=scene.name, hint=hint)


def median_depths(source: Source) -> list[float]:
    """[median view depth of the current frame's surface pixels, scene units]; [] where nothing is drawn."""
    if "position" not in source.current:
        return []
    depth = source.read("position")[..., 3]
    depth = depth[(depth > 0.0) & np.isfinite(depth)]
    return [float(np.median(depth))] if depth.size else []


def describe_scale(summary: dict[str, Any], depths: Sequence[float], settings: Settings) -> None:
    """Add the block ``scale`` and its notes to a summary that has the block ``camera``.

    ``depths``: of ``median_depths`` of the checked frames; their median is the depth that counts.
    """
    depth = float(np.median(depths)) / settings.metrics.unit_scale if depths else None
    summary["scale"] = {"frames": len(depths), "median_depth_m": depth}
    if depth is not None:
        step = summary["camera"]["position"]["median"]
        rendered = summary.get("path_traced") is None
        summary["notes"] += [*_threshold_note(depth, settings), *_step_note(step, depth, settings, rendered)]


def _threshold_note(depth: float, settings: Settings) -> list[str]:
    """At most one note on the default position threshold; ``depth``: median depth, meters.

    A threshold other than the default was chosen for its scene, and is not checked.
    """
    metrics, threshold, unit = settings.metrics, DEFAULT_THRESHOLD, settings.metrics.unit_scale
    unchecked = "position" not in metrics.columns or metrics.thresholds["position"] != threshold
    if unchecked or SMALLEST * depth <= threshold <= LARGEST * depth:
        return []
    message = f"position threshold {threshold:.4g} m is {threshold / depth:.2g} of the median depth {depth:.3g} m"
    if not USUAL_M[0] <= depth <= USUAL_M[1]:
        for scale, name in UNITS.items():
            if USUAL_M[0] <= depth * unit / scale <= USUAL_M[1]:
                return [f"{message}: give --unit-scale {scale:g} if the scene is in {name}"]
    return [
        f"{message}: give --threshold position={USUAL_RATIO * depth:.1g}, or --unit-scale if its unit is not the meter"
    ]


def _step_note(step: float | None, depth: float, settings: Settings, rendered: bool) -> list[str]:
    """At most one note on a camera that moves far between two frames; ``step``, ``depth``: medians, meters.

    ``rendered``: frames are drawn at a rate that can be chosen.
    """
    if step is None or step <= FASTEST * depth:
        return []
    message = f"the camera moves {step:.3g} m per frame, {step / depth:.2g} of the median depth {depth:.3g} m"
    if not rendered:
        return [f"{message}: are frames left out?"]
    return [f"{message}: give --fps above {settings.sequence.fps:g} if the file has more frames per second"]
