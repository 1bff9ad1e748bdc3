"""The settings of a method, rejection thresholds say, with the least error on a scene: a grid, then finer grids."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.errors import MethodError, SettingsError
from taubench_gl.provenance import git_commit
from taubench_gl.reuse.contract import Method, Setting, Value
from taubench_gl.reuse.evaluate import MethodSpec, evaluate_methods, method_settings
from taubench_gl.reuse.evaluate_records import EQUAL
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.quality import MEASURES
from taubench_gl.run import Progress
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

SCHEMA = "taubench-gl/reuse-fit/1"
METRICS = {name.removesuffix("_db"): name for name in MEASURES}
"""As a user names them -> keys of MEASURES."""

DEFAULT_METRIC = "flip"
"""Bounded per pixel: one firefly cannot decide a fit, as it can with relMSE."""

DEFAULT_STEPS = 9
MAX_POINTS = 4096
TOGETHER = 12
"""Points that are run side by side over the same frames; each keeps history of its own."""


@dataclass(frozen=True, slots=True)
class Range:
    """Values of one setting to try: ``steps`` from ``low`` to ``high``, both included, linear or log as the setting."""

    name: str
    low: float
    high: float
    steps: int
    scale: str
    whole: bool

    @property
    def values(self) -> tuple[float, ...]:
        """In ascending order; whole numbers once each."""
        if self.steps == 1:
            return (self.low,)
        between = np.geomspace if self.scale == "log" else np.linspace
        values = between(self.low, self.high, self.steps)
        values[[0, -1]] = self.low, self.high  # geomspace rounds its ends
        if self.whole:
            return tuple(sorted({int(v) for v in np.round(values)}))
        return tuple(float(v) for v in values)

    def around(self, value: float) -> Range:
        """The same number of values between the neighbors of ``value``, within the first range."""
        grid = self.values
        at = grid.index(value)
        return Range(
            self.name, grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)], self.steps, self.scale, self.whole
        )


@dataclass(frozen=True, slots=True)
class Fit:
    """``summary``: fit.json (schema ``SCHEMA``): settings, points, best, default, notes."""

    summary: dict[str, Any]

    @property
    def best(self) -> dict[str, Value]:
        """Setting -> value with the least error."""
        return dict(self.summary["best"]["settings"])

    @property
    def notes(self) -> list[str]:
        return list(self.summary["notes"])


def parse_range(text: str, method: Method) -> Range:
    """``NAME``, ``NAME=lo:hi`` or ``NAME=lo:hi:n``; what is left out is the setting's own range and DEFAULT_STEPS.

    Raises MethodError for a setting the method has not, SettingsError for a range that cannot be meant.
    """
    name, _, rest = text.partition("=")
    name = name.strip()
    method.values({name: method.settings[name].default} if name in method.settings else {name: 0})
    setting = method.settings[name]
    if setting.kind not in ("float", "int"):
        raise SettingsError(f"setting {name} is no number", hint="a fit searches numbers")
    parts = rest.split(":") if rest else []
    try:
        ends = [float(p) for p in parts[:2]] or [setting.minimum, setting.maximum]
        steps = int(parts[2]) if len(parts) > 2 else DEFAULT_STEPS
        if len(ends) != 2 or len(parts) > 3:
            raise ValueError
    except ValueError:
        raise SettingsError(f"{text!r} is no range", hint="give NAME=lo:hi:n, such as alpha=0.05:0.5:10") from None
    return _checked(Range(name, *ends, steps, setting.scale, setting.kind == "int"), setting)


def _checked(wanted: Range, setting: Setting) -> Range:
    low, high = wanted.low, wanted.high
    if low is None or high is None:
        raise SettingsError(f"setting {wanted.name} has no range of its own", hint=f"give {wanted.name}=lo:hi")
    if not (math.isfinite(low) and math.isfinite(high) and low < high) or not 2 <= wanted.steps <= MAX_POINTS:
        hint = f"give lo < hi, and 2 to {MAX_POINTS} steps"
        raise SettingsError(f"range of {wanted.name} is {low:g} to {high:g} in {wanted.steps}", hint=hint)
    for value in (low, high):
        typed = int(value) if wanted.whole and float(value).is_integer() else value
        if fault := setting.fault(typed):
            raise SettingsError(f"range of {wanted.name}: {fault}")
    return wanted


def fit_setting(
    scene: Scene | str | Path,
    method: str | MethodSpec | Method,
    ranges: Sequence[str | Range],
    settings: Settings | None = None,
    *,
    metric: str = DEFAULT_METRIC,
    refine: int = 1,
    progress: Callable[[Progress], None] | None = None,
    **evaluation: Any,
) -> Fit:
    """The point of ``ranges`` with the least (for PSNR and SSIM: greatest) mean ``metric`` of METRICS.

    The whole grid is tried, then ``refine`` times the grid between the best point's neighbors.  ``evaluation``: as
    ``evaluate_methods`` takes, such as ``input``, ``reference``, ``camera``.  Raises TaubenchError.
    """
    if metric not in METRICS:
        raise SettingsError(f"no metric is named {metric!r}", hint=f"choose from {', '.join(METRICS)}")
    if refine < 0:
        raise SettingsError(f"refine is {refine}", hint="give 0 or more")
    spec = MethodSpec.parse(method) if isinstance(method, str) else method
    spec = MethodSpec(spec.name, spec) if isinstance(spec, Method) else spec
    loaded = load_method(spec.method)
    fixed = method_settings(loaded, spec.settings)
    chosen = [parse_range(r, loaded) if isinstance(r, str) else r for r in ranges]
    if not chosen:
        raise SettingsError("no setting to fit was named", hint=f"{loaded.label} has {', '.join(loaded.settings)}")
    if len({r.name for r in chosen}) < len(chosen):
        raise SettingsError("a setting is named twice")
    if math.prod(len(r.values) for r in chosen) > MAX_POINTS:
        raise SettingsError(f"the grid has more than {MAX_POINTS} points", hint="give fewer steps")
    if not isinstance(scene, Scene):
        settings = settings or Settings.of(reprojection="motion")
        scene = load_scene(scene, scene=settings.sequence.scene, animation=settings.sequence.animation)
    search = _Search(scene, loaded, fixed, settings, metric, progress, evaluation)
    default = {r.name: fixed[r.name] for r in chosen}
    search.run([default])
    grids = list(chosen)
    for turn in range(refine + 1):
        search.run(
            [dict(zip((r.name for r in grids), point)) for point in itertools.product(*(r.values for r in grids))]
        )
        if turn < refine:
            best = search.best(grids)
            grids = [r.around(best[r.name]) for r in grids]
            if all(len(r.values) <= 2 and r.whole for r in grids):
                break  # whole numbers: there is nothing between neighbors
    return Fit(search.summary(spec.label, chosen, default, refine))


def _quality(point: dict[str, Any]) -> float | None:
    """The point's value; infinite for a PSNR of equal pictures, which has no place in JSON; None where it failed."""
    return math.inf if point["failed"] == EQUAL else point["value"]


class _Search:
    """Tries points, each once, and remembers what came of them."""

    def __init__(
        self,
        scene: Scene,
        method: Method,
        fixed: dict[str, Value],
        settings: Settings | None,
        metric: str,
        progress: Callable[[Progress], None] | None,
        evaluation: dict[str, Any],
    ):
        self._scene, self._method, self._fixed, self._settings = scene, method, fixed, settings
        self._metric, self._progress, self._evaluation = metric, progress, evaluation
        self._sign = -1.0 if MEASURES[METRICS[metric]].better == "higher" else 1.0
        self.points: list[dict[str, Any]] = []
        self._last: dict[str, Any] = {}

    def run(self, points: Sequence[dict[str, Value]]) -> None:
        """Evaluate those that are new, TOGETHER at a time."""
        tried = [p["settings"] for p in self.points]
        new = [p for i, p in enumerate(points) if p not in tried and p not in points[:i]]
        for first in range(0, len(new), TOGETHER):
            self._run_some(new[first : first + TOGETHER])

    def _run_some(self, points: Sequence[dict[str, Value]]) -> None:
        specs = [MethodSpec(f"point {i}", self._method, self._fixed | p) for i, p in enumerate(points)]
        done = evaluate_methods(
            self._scene, specs, self._settings, metrics=(self._metric,), progress=self._progress, **self._evaluation
        )
        self._last = done.summary
        for spec, point in zip(specs, points, strict=True):
            told = done.summary["methods"][spec.label]
            value = None if told["failed"] else told["mean"][METRICS[self._metric]]
            why = told["failed"] or (None if value is not None else told["reasons"][METRICS[self._metric]])
            self.points.append({"settings": dict(point), "value": value, "failed": why})

    def best(self, ranges: Sequence[Range] = ()) -> dict[str, Value]:
        """The best point so far; of those on the grid of ``ranges`` where given.  Raises MethodError without any."""
        found = [p for p in self.points if _quality(p) is not None]
        grids = {r.name: r.values for r in ranges}
        found = [p for p in found if all(p["settings"][n] in values for n, values in grids.items())]
        if not found:
            why = next((p["failed"] for p in self.points if p["failed"]), "no frame could be judged")
            raise MethodError(f"no point of the grid has a value: {why}")
        return min(found, key=lambda p: self._sign * _quality(p))["settings"]

    def summary(self, label: str, ranges: Sequence[Range], default: dict[str, Value], refine: int) -> dict[str, Any]:
        best = self.best()
        by = {tuple(p["settings"].items()): p["value"] for p in self.points}
        measure = MEASURES[METRICS[self._metric]]
        searched = {r.name: {"low": r.low, "high": r.high, "steps": r.steps, "scale": r.scale} for r in ranges}
        last = self._last
        return {
            "schema": SCHEMA,
            "scene": last["scene"]["name"],
            "scene_sha256": last["scene"]["sha256"],
            "method": label,
            "metric": self._metric,
            "better": measure.better,
            "settings": searched,
            "refine": refine,
            "best": {"settings": best, "value": by[tuple(best.items())]},
            "default": {"settings": default, "value": by[tuple(default.items())]},
            "points": sorted(self.points, key=lambda p: [float(v) for v in p["settings"].values()]),
            "notes": self._notes(best, ranges, default),
            "evaluation": {k: last[k] for k in ("settings", "judged_frames", "input", "reference", "judged_by")},
            "provenance": last["provenance"] | {"git": git_commit()},
        }

    def _notes(self, best: dict[str, Value], ranges: Sequence[Range], default: dict[str, Value]) -> list[str]:
        out = []
        for r in ranges:
            value = best[r.name]
            if value <= r.low or value >= r.high:
                edge = "low" if value <= r.low else "high"
                setting = self._method.settings[r.name]
                bound = setting.minimum if edge == "low" else setting.maximum
                allowed = bound is not None and float(bound) == float(value)
                more = "no smaller or larger value is allowed" if allowed else "the optimum may lie beyond: widen it"
                out.append(f"{r.name}: the best value {value:g} is at the {edge} edge of its range; {more}")
        values = [p["value"] for p in self.points if p["value"] is not None]
        if len(values) > 1 and max(values) - min(values) <= 1e-6 * max(abs(max(values)), 1e-12):
            out.append("the metric does not change over the range: the setting has no effect here")
        if by_equal := [p for p in self.points if p["failed"] == EQUAL]:
            out.append(f"{len(by_equal)} of the points give pictures {EQUAL}")
        if best == default:
            out.append("the default is the best of what was tried")
        return out
