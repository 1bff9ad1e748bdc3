"""Reuse methods as configurations: the error of their images, and the time of shading and reuse.

Their errors are errors of images, not of discard columns, so they have their own Pareto fronts and recommendations and
are in no preset.  A time is that of shading the input plus that of the method's passes.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from taubench_gl.animation import CameraTrack
from taubench_gl.cost.analysis import Time, compare_times, error_increase, pareto_front, time_of
from taubench_gl.errors import SettingsError
from taubench_gl.reuse.contract import Method
from taubench_gl.reuse.evaluate import MethodSpec, evaluate_methods, method_settings
from taubench_gl.reuse.fit import parse_range
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.quality import MEASURES
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

PREFIX = "method:"
INPUTS = ("noisy+jittered",)
MEASURED = ("flip", "relmse")
"""Of ``reuse.quality.MEASURES``; lower is better in both."""

NO_REUSE = "none"
MAX_METHODS = 48
"""Methods of one input are all held open at once."""

TIMED = 6
"""Frames of a timing run; the first has no history and is not counted."""


@dataclass(frozen=True, slots=True)
class MethodConfiguration:
    """A reuse method with settings, on one input."""

    spec: MethodSpec
    input: str

    @property
    def name(self) -> str:
        return f"{PREFIX}{self.spec.label} on {self.input}"

    @property
    def label(self) -> str:
        return f"{'no reuse' if self.spec.label == NO_REUSE else self.spec.label} on {self.input}"


def split_parameters(names: Sequence[str] | None) -> tuple[list[str] | None, list[str]]:
    """``--parameters`` split into parameters of the renderer (None: all) and methods without their prefix."""
    if names is None:
        return None, []
    methods = [name.removeprefix(PREFIX) for name in names if name.startswith(PREFIX)]
    return [name for name in names if not name.startswith(PREFIX)], methods


def method_configurations(methods: Sequence[str], inputs: Sequence[str] = INPUTS) -> tuple[MethodConfiguration, ...]:
    """``NAME@setting=V``, V a value, ``lo:hi:n`` or ``a/b/c``; several settings make a grid.  On each of ``inputs``.

    The method ``none``, which reuses nothing, is always the first.  Raises MethodError, SettingsError.
    """
    if not methods:
        return ()
    kinds = [parse_input(text) for text in inputs]
    if any(kind.files is not None for kind in kinds):
        hint = "choose rendered inputs; see 'reuse evaluate'"
        raise SettingsError("files have no shading time", hint=hint)
    if len({(kind.noisy, kind.path_samples > 0) for kind in kinds}) > 1:
        hint = "their references differ: study them separately"
        raise SettingsError("noisy, path-traced and exact inputs are not comparable", hint=hint)
    specs = {NO_REUSE: MethodSpec(NO_REUSE, NO_REUSE)}
    for text in methods:
        specs |= {spec.label: spec for spec in _expand(text)}
    texts = dict.fromkeys(kind.text for kind in kinds)
    found = tuple(MethodConfiguration(spec, text) for text in texts for spec in specs.values())
    if len(found) > MAX_METHODS:
        hint = "give fewer values or inputs"
        raise SettingsError(f"{len(found)} method configurations are more than {MAX_METHODS}", hint=hint)
    return found


def _expand(text: str) -> list[MethodSpec]:
    spec = MethodSpec.parse(text)
    method = load_method(spec.method)
    lists = {name: _values(method, name, str(value)) for name, value in spec.settings.items()}
    out = []
    for values in itertools.product(*lists.values()):
        given = dict(zip(lists, values))
        method_settings(method, given)  # raises for invalid values before anything is measured
        label = "@".join([str(spec.method), *(f"{n}={v}" for n, v in given.items())])
        out.append(MethodSpec(label, method, given))
    return out


def _values(method: Method, name: str, text: str) -> list[str]:
    if ":" in text:
        return [f"{value:.6g}" for value in parse_range(f"{name}={text}", method).values]
    return [part for part in text.split("/") if part] or [text]


def measure_images(
    scene: Scene, camera: CameraTrack, baseline: Settings, chosen: Sequence[MethodConfiguration], reference: str
) -> dict[str, Any]:
    """Image errors of all methods on one input: label -> measure -> frame -> error; bytes; settings."""
    specs, kind = [c.spec for c in chosen], chosen[0].input
    run = evaluate_methods(
        scene, specs, _settings(baseline), input=kind, reference=reference, metrics=("flip",), camera=camera
    )
    described, samples = run.summary["methods"], run.summary["reference"]["samples"]
    light = "exact light" if run.summary["reference"]["kind"] == "max" else "path-traced"
    errors = {}
    for label, method in described.items():
        rows = [r for r in run.rows if r["method"] == label][1:]  # the first frame has no history
        if not method["failed"]:
            errors[label] = {m: {str(r["frame"]): r[m] for r in rows} for m in MEASURED}
    return {
        "errors": errors,
        "failed": run.failed,
        "bytes": {label: m["memory_bytes"] for label, m in described.items()},
        "settings": {label: m["settings"] for label, m in described.items()},
        "reference": "path-traced" if samples is None else f"{light}, {samples} samples per pixel",
    }


def time_methods(
    scene: Scene, camera: CameraTrack, baseline: Settings, frames: range, chosen: Sequence[MethodConfiguration]
) -> dict[str, Any]:
    """One round: milliseconds of shading, and of every method, medians over the same frames from the middle.

    The methods are interleaved within each frame, and their order changes from frame to frame.
    """
    count = min(TIMED, len(frames))
    start = frames.start + (len(frames) - count) // 2
    settings = _settings(baseline).replace(frames=(start, start + count))
    specs, kind = [c.spec for c in chosen], chosen[0].input
    reference = "path-traced@1" if parse_input(kind).path_samples else "max"
    run = evaluate_methods(
        scene, specs, settings, input=kind, reference=reference, reference_samples=1, metrics=(), camera=camera
    )
    times = {label: m["time_ms"] for label, m in run.summary["methods"].items() if not m["failed"]}
    return {"shading_ms": run.summary["input"]["shading_ms"], "method_ms": times, "clock": run.summary["clock"]}


def _settings(baseline: Settings) -> Settings:
    """As 'reuse evaluate' runs: with motion reprojection, without settings of discard counts."""
    return baseline.replace(pairs="all", samples_per_pixel=1, reprojection="motion")


@dataclass(frozen=True, slots=True)
class MethodPoint:
    """A measured method.  ``errors``: measure -> frame -> error.  ``failed``: one line; then nothing else is known."""

    name: str
    label: str
    input: str
    errors: Mapping[str, Mapping[str, float]]
    time: Time | None
    shading_ms: float | None
    method_ms: float | None
    bytes: int | None
    settings: Mapping[str, Any] | None = None
    clock: str = ""
    reference: str = ""
    failed: str | None = None
    role: str = "method"

    def error(self, measure: str) -> float | None:
        """Mean over frames; None where the method failed."""
        values = self.errors.get(measure)
        return math.fsum(values.values()) / len(values) if values else None


def method_points(
    chosen: Sequence[MethodConfiguration], records: Iterable[Mapping[str, Any]], repeats: int
) -> list[MethodPoint]:
    """Points from records of the kinds ``images`` and ``image_time``."""
    records = list(records)
    images = {r["input"]: r for r in records if r["kind"] == "images"}
    out = []
    for c in chosen:
        label, found = c.spec.label, images[c.input]
        rounds = [r for r in records if r["kind"] == "image_time" and r["input"] == c.input][:repeats]
        pairs = [(r["shading_ms"], r["method_ms"][label]) for r in rounds if label in r["method_ms"]]
        failed = found["failed"].get(label)
        if failed or not pairs:
            out.append(MethodPoint(c.name, c.label, c.input, {}, None, None, None, None, failed=failed or "no time"))
            continue
        shading, method = map(statistics.median, zip(*pairs))
        out.append(
            MethodPoint(
                c.name,
                c.label,
                c.input,
                found["errors"][label],
                time_of([s + m for s, m in pairs]),
                shading,
                method,
                found["bytes"].get(label),
                found["settings"].get(label),
                rounds[0]["clock"],
                found["reference"],
            )
        )
    return out


def recommend(points: Sequence[MethodPoint], measure: str) -> str:
    """In words: the smallest error, the fastest method that is as good within the noise of the frames, and no reuse."""
    measured = [p for p in points if p.error(measure) is not None and p.time is not None]
    if not measured:
        return f"{measure}: nothing was measured"
    best = min(measured, key=lambda p: p.error(measure))
    words = f"{measure}: smallest error: {_describe(best, measure)}"
    faster = [p for p in measured if compare_times(best.time, p.time) > 0 and _as_good(p, best, measure)]
    if faster:
        cheap = min(faster, key=lambda p: p.time.median)
        ratio = best.time.median / cheap.time.median
        words += f"; as good within the noise of the frames, {ratio:.3g}x as fast: {_describe(cheap, measure)}"
    plain = _no_reuse(best, points)
    if plain is best:
        return f"{words}; no measured method is better"
    return words if plain is None else f"{words}; without reuse {plain.error(measure):.3g}, {plain.time.median:.3g} ms"


def _as_good(point: MethodPoint, best: MethodPoint, measure: str) -> bool:
    """The error is not larger by more than twice the standard error over frames."""
    here, there = (p.errors[measure] for p in (point, best))
    mean, error = error_increase(there, here, dict.fromkeys(here, 0.0))
    return math.isfinite(error) and mean <= 2.0 * error


def _no_reuse(point: MethodPoint, points: Sequence[MethodPoint]) -> MethodPoint | None:
    """The method that reuses nothing, on the same input."""
    return next((p for p in points if p.label == f"no reuse on {point.input}"), None)


def _describe(p: MethodPoint, measure: str) -> str:
    spread = "" if p.time.spread is None else f" ± {p.time.spread:.2g}"
    parts = f"shading {p.shading_ms:.3g}, method {p.method_ms:.3g}"
    return f"{p.label} ({p.error(measure):.3g}, {p.time.median:.3g}{spread} ms: {parts})"


def methods_json(points: Sequence[MethodPoint]) -> dict[str, Any] | None:
    """The block ``methods`` of study.json; None without methods."""
    if not points:
        return None
    rows = []
    for p in points:
        row = {k: v for k, v in asdict(p).items() if k not in ("time", "errors")}
        plain = _no_reuse(p, points)
        row["against_baseline"] = None if plain is None else against(p.time, plain.time)
        row["ms"] = None if p.time is None else asdict(p.time)
        rows.append(row | {"errors": {m: p.error(m) for m in MEASURED}})
    return {
        "measures": {m: MEASURES[m].doc for m in MEASURED},
        "points": rows,
        "fronts": {m: [p.name for p in pareto_front(points, m)] for m in MEASURED},
        "recommendations": [recommend(points, m) for m in MEASURED],
    }


def against(time: Time | None, baseline: Time | None) -> dict[str, Any] | None:
    """Ratio of two times, and whether they differ by ``analysis.RULE``; None where one is not known."""
    if time is None or baseline is None:
        return None
    return {"ratio": time.median / baseline.median, "different": compare_times(time, baseline) != 0}
