"""Search for the settings of a method with the smallest error: a grid, then finer grids."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.errors import MethodError, SettingsError
from taubench_gl.fields import declared, from_values
from taubench_gl.option_groups import FITTED_METRICS, FitOptions
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.provenance import git_commit
from taubench_gl.reuse.contract import Method, Parameter, Value
from taubench_gl.reuse.evaluate import TWICE, evaluate_methods
from taubench_gl.reuse.loading import MethodSpec, load_method, method_settings, method_text, short_name
from taubench_gl.reuse.quality import MEASURES
from taubench_gl.reuse.scores import EQUAL
from taubench_gl.run import Progress
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

SCHEMA = "taubench-gl/reuse-fit/2"
MEASURE_OF = {name.removesuffix("_db"): name for name in MEASURES if name.removesuffix("_db") in FITTED_METRICS}
"""Names of metrics for users -> keys of MEASURES."""

DEFAULT_STEPS = 9
MAX_POINTS = 4096
MAX_METHODS = 48
"""Methods of an evaluation, which are all held open at once."""

AT_LIMIT, MAY_BE_OUTSIDE = "the setting allows no other value there", "the optimum may be outside: widen it"
BATCH = 12
"""Points that are evaluated at once over the same frames."""


@dataclass(frozen=True, slots=True)
class Range:
    """Values of one setting: ``steps`` from ``low`` to ``high``, both included, on a linear or log scale."""

    name: str
    low: float
    high: float
    steps: int
    scale: str
    integer: bool

    @property
    def values(self) -> tuple[float, ...]:
        """The values of the setting in ascending order; integers without duplicates."""
        if self.steps == 1:
            return (self.low,)
        between = np.geomspace if self.scale == "log" else np.linspace
        values = between(self.low, self.high, self.steps)
        values[[0, -1]] = self.low, self.high  # geomspace rounds the ends
        if self.integer:
            return tuple(sorted({int(v) for v in np.round(values)}))
        return tuple(float(v) for v in values)

    def around(self, value: float) -> Range:
        """A range with the same number of values between the neighbors of ``value``."""
        grid = self.values
        at = grid.index(value)
        return Range(
            self.name, grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)], self.steps, self.scale, self.integer
        )


@dataclass(frozen=True, slots=True)
class Fit:
    """Result of a search.  ``summary``: fit.json (schema ``SCHEMA``): settings, points, best, default, notes."""

    summary: dict[str, Any]

    @property
    def best(self) -> dict[str, Value]:
        """The best value of every searched setting."""
        return dict(self.summary["best"]["settings"])

    @property
    def notes(self) -> list[str]:
        return list(self.summary["notes"])


def parse_range(text: str, method: Method) -> Range:
    """The range of ``NAME``, ``NAME=lo:hi`` or ``NAME=lo:hi:n``; by default of the setting, in DEFAULT_STEPS.

    Raises MethodError for an unknown setting, SettingsError for an invalid range.
    """
    name, _, numbers = text.partition("=")
    name = name.strip()
    method.values({name: method.settings[name].default} if name in method.settings else {name: 0})
    setting = method.settings[name]
    if setting.kind not in ("float", "int"):
        raise SettingsError(f"setting {name} is not a number", hint="a fit searches numbers")
    parts = numbers.split(":") if numbers else []
    try:
        ends = [float(p) for p in parts[:2]] or [setting.minimum, setting.maximum]
        steps = int(parts[2]) if len(parts) > 2 else DEFAULT_STEPS
        if len(ends) != 2 or len(parts) > 3:
            raise ValueError
    except ValueError:
        raise SettingsError(f"{text!r} is not a range", hint="give NAME=lo:hi:n, such as alpha=0.05:0.5:10") from None
    return _checked(Range(name, *ends, steps, setting.scale, setting.kind == "int"), setting)


def expand_methods(texts: Sequence[str]) -> list[MethodSpec]:
    """Methods of texts ``NAME@setting=V``, V a value, ``lo:hi:n`` or ``a/b/c``; several of these make a grid.

    Every setting of a grid is checked.  Raises MethodError, SettingsError.
    """
    specs: dict[str, MethodSpec] = {}
    for text in texts:
        spec = MethodSpec.parse(text)
        grid = isinstance(spec.method, str) and not is_sequence(spec.method)
        for variant in _grid(spec) if grid else (spec,):
            other = specs.setdefault(variant.label, variant).method
            if isinstance(other, str) and isinstance(variant.method, str) and other != variant.method:
                raise SettingsError(f"two methods have the name {variant.label!r}", hint=TWICE)
    if len(specs) > MAX_METHODS:
        raise SettingsError(f"{len(specs)} methods are more than {MAX_METHODS}", hint="give fewer values")
    return list(specs.values())


def _grid(spec: MethodSpec) -> list[MethodSpec]:
    several = {n: str(v) for n, v in spec.settings.items() if ":" in str(v) or "/" in str(v)}
    if not several:
        return [spec]
    method, out = load_method(spec.method), []
    values = [_values(method, name, text) for name, text in several.items()]
    for combination in itertools.product(*values):
        settings = {**spec.settings, **dict(zip(several, combination, strict=True))}
        method_settings(method, settings)  # raises for invalid values
        out.append(MethodSpec(method_text(short_name(str(spec.method)), settings), method, settings))
    return out


def _values(method: Method, name: str, text: str) -> list[str]:
    if ":" in text:
        return [f"{value:.6g}" for value in parse_range(f"{name}={text}", method).values]
    return [part for part in text.split("/") if part]


def _checked(requested: Range, setting: Parameter) -> Range:
    low, high = requested.low, requested.high
    if low is None or high is None:
        raise SettingsError(f"setting {requested.name} has no range", hint=f"give {requested.name}=lo:hi")
    if not (math.isfinite(low) and math.isfinite(high) and low < high) or not 2 <= requested.steps <= MAX_POINTS:
        hint = f"give lo < hi, and 2 to {MAX_POINTS} steps"
        raise SettingsError(f"range of {requested.name} is {low:g} to {high:g} in {requested.steps}", hint=hint)
    for value in (low, high):
        typed = int(value) if requested.integer and float(value).is_integer() else value
        if error := setting.error(typed):
            raise SettingsError(f"range of {requested.name}: {error}")
    return requested


def fit_setting(
    scene: Scene | str | Path,
    method: str | MethodSpec | Method,
    ranges: Sequence[str | Range],
    settings: Settings | None = None,
    *,
    progress: Callable[[Progress], None] | None = None,
    **options: Any,
) -> Fit:
    """The point of ``ranges`` with the smallest (for PSNR and SSIM: largest) mean ``metric``.

    Evaluates the whole grid, then ``refine`` times a grid between the neighbors of the best point.  ``options``: fields
    of ``FitOptions`` and arguments of ``evaluate_methods``, such as ``input``, ``reference``, ``camera``.  Raises
    TaubenchError.
    """
    search = from_values(FitOptions, {name: options.pop(name) for name in declared(FitOptions) if name in options})
    spec = MethodSpec.parse(method) if isinstance(method, str) else method
    spec = MethodSpec(spec.name, spec) if isinstance(spec, Method) else spec
    loaded = load_method(spec.method)
    fixed = method_settings(loaded, spec.settings)
    axes = [parse_range(r, loaded) if isinstance(r, str) else r for r in ranges]
    if not axes:
        raise SettingsError("there is no setting to fit", hint=f"{loaded.label} has {', '.join(loaded.settings)}")
    if len({r.name for r in axes}) < len(axes):
        raise SettingsError("a setting is given twice")
    if math.prod(len(r.values) for r in axes) > MAX_POINTS:
        raise SettingsError(f"the grid has more than {MAX_POINTS} points", hint="give fewer steps")
    if not isinstance(scene, Scene):
        settings = settings or Settings(reprojection="motion")
        scene = load_scene(scene, **settings.sequence.reading)
    points = _Search(scene, loaded, fixed, settings, search.metric, progress, options)
    default = {r.name: fixed[r.name] for r in axes}
    points.run([default])
    grids = list(axes)
    for turn in range(search.refine + 1):
        points.run(
            [dict(zip((r.name for r in grids), point)) for point in itertools.product(*(r.values for r in grids))]
        )
        if turn < search.refine:
            best = points.best(grids)
            grids = [r.around(best[r.name]) for r in grids]
            if all(len(r.values) <= 2 and r.integer for r in grids):
                break  # integers: no values between neighbors
    return Fit(points.summary(spec.label, axes, default, search.refine))


def _quality(point: dict[str, Any]) -> float | None:
    """The value of the point; infinite for the PSNR of equal images, which JSON cannot store; None if it failed."""
    return math.inf if point["failed"] == EQUAL else point["value"]


class _Search:
    """Evaluates points, each once, and records their values."""

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
        self._sign = -1.0 if MEASURES[MEASURE_OF[metric]].better == "higher" else 1.0
        self.points: list[dict[str, Any]] = []
        self._last: dict[str, Any] = {}

    def run(self, points: Sequence[dict[str, Value]]) -> None:
        """Evaluate new points, BATCH at a time."""
        evaluated = [p["settings"] for p in self.points]
        new = [p for i, p in enumerate(points) if p not in evaluated and p not in points[:i]]
        for first in range(0, len(new), BATCH):
            self._run_some(new[first : first + BATCH])

    def _run_some(self, points: Sequence[dict[str, Value]]) -> None:
        specs = [MethodSpec(f"point {i}", self._method, self._fixed | p) for i, p in enumerate(points)]
        evaluation = evaluate_methods(
            self._scene, specs, self._settings, progress=self._progress,
            **self._evaluation | {"metrics": (self._metric,), "statistics": False},
        )  # fmt: skip
        self._last = evaluation.summary
        for spec, point in zip(specs, points, strict=True):
            method = evaluation.summary["methods"][spec.label]
            value = None if method["failed"] else method["mean"][MEASURE_OF[self._metric]]
            why = method["failed"] or (None if value is not None else method["reasons"][MEASURE_OF[self._metric]])
            self.points.append({"settings": dict(point), "value": value, "failed": why})

    def best(self, ranges: Sequence[Range] = ()) -> dict[str, Value]:
        """The best point, on the grid of ``ranges`` if given.  Raises MethodError if no point has a value."""
        candidates = [p for p in self.points if _quality(p) is not None]
        grids = {r.name: r.values for r in ranges}
        candidates = [p for p in candidates if all(p["settings"][n] in values for n, values in grids.items())]
        if not candidates:
            why = next((p["failed"] for p in self.points if p["failed"]), "no frame was evaluated")
            raise MethodError(f"no point of the grid has a value: {why}")
        return min(candidates, key=lambda p: self._sign * _quality(p))["settings"]

    def summary(self, label: str, ranges: Sequence[Range], default: dict[str, Value], refine: int) -> dict[str, Any]:
        best = self.best()
        by = {tuple(p["settings"].items()): p["value"] for p in self.points}
        measure = MEASURES[MEASURE_OF[self._metric]]
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
            "evaluation": {k: last[k] for k in ("settings", "evaluated_frames", "input", "reference", "mask_source")},
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
                reason = AT_LIMIT if allowed else MAY_BE_OUTSIDE
                out.append(f"{r.name}: the best value {value:g} is at the {edge} edge of its range; {reason}")
        values = [p["value"] for p in self.points if p["value"] is not None]
        if len(values) > 1 and max(values) - min(values) <= 1e-6 * max(abs(max(values)), 1e-12):
            out.append("the metric is constant over the range: the setting has no effect on it")
        if by_equal := [p for p in self.points if p["failed"] == EQUAL]:
            out.append(f"{len(by_equal)} of the points give images {EQUAL}")
        if best == default:
            out.append("the default is the best evaluated point")
        return out
