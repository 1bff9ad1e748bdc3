"""Reuse methods as experiments: what their settings cost, and how far the picture they make is from the reference.

Nothing here approximates the discard columns: the errors are those of pictures, and a time is that of shading the input
and of the method's own passes.  So the points have a front and words of their own, and never get into a preset.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from taubench_gl.cost.analysis import pareto_front, rises
from taubench_gl.cost.clock import Time, slower_by, time_of
from taubench_gl.errors import SettingsError
from taubench_gl.reuse.contract import Method
from taubench_gl.reuse.evaluate import MethodSpec, evaluate_methods, method_settings
from taubench_gl.reuse.fit import parse_range
from taubench_gl.reuse.inputs_kind import parse_input
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.quality import MEASURES
from taubench_gl.settings import Settings

PREFIX = "method:"
INPUTS = ("noisy+jittered",)
MEASURED = ("flip", "relmse")
"""Of ``reuse.quality.MEASURES``; in both less is better."""

NO_REUSE, PLAIN = "none", "no reuse"
MOST = 48
"""Candidates of a study: all of one input are held ready side by side."""

TIMED = 6
"""Frames of a timing run; the first has no history and does not count."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A method with settings, on one input."""

    spec: MethodSpec
    input: str

    @property
    def name(self) -> str:
        return f"{PREFIX}{self.spec.label} on {self.input}"

    @property
    def label(self) -> str:
        return f"{PLAIN if self.spec.label == NO_REUSE else self.spec.label} on {self.input}"


def split_knobs(names: Sequence[str] | None) -> tuple[list[str] | None, list[str]]:
    """``--knobs`` apart: dials of the renderer (None: all, if no name is given at all), and methods."""
    if names is None:
        return None, []
    methods = [name.removeprefix(PREFIX) for name in names if name.startswith(PREFIX)]
    return [name for name in names if not name.startswith(PREFIX)], methods


def candidates(methods: Sequence[str], inputs: Sequence[str] = INPUTS) -> tuple[Candidate, ...]:
    """``NAME@setting=V``, V a value, ``lo:hi:n`` or ``a/b/c``; several settings make a grid.  On each of ``inputs``.

    ``none``, which reuses nothing, is always among them, first.  Raises MethodError, SettingsError.
    """
    if not methods:
        return ()
    kinds = [parse_input(text) for text in inputs]
    if any(kind.files is not None for kind in kinds):
        raise SettingsError("files take no time to shade", hint="choose inputs that are drawn; see 'reuse evaluate'")
    if len({kind.noisy for kind in kinds}) > 1:
        hint = "their references differ; choose noisy ones, or others, and study them apart"
        raise SettingsError("noisy inputs cannot stand beside exact ones", hint=hint)
    specs = {NO_REUSE: MethodSpec(NO_REUSE, NO_REUSE)}
    for text in methods:
        specs |= {spec.label: spec for spec in _expand(text)}
    found = tuple(Candidate(spec, text) for text in dict.fromkeys(k.text for k in kinds) for spec in specs.values())
    if len(found) > MOST:
        raise SettingsError(f"{len(found)} method settings are more than {MOST}", hint="give fewer values or inputs")
    return found


def _expand(text: str) -> list[MethodSpec]:
    spec = MethodSpec.parse(text)
    method = load_method(spec.method)
    lists = {name: _values(method, name, str(value)) for name, value in spec.settings.items()}
    out = []
    for values in itertools.product(*lists.values()):
        given = dict(zip(lists, values))
        method_settings(method, given)  # wrong ones are told of before anything is measured
        label = "@".join([str(spec.method), *(f"{n}={v}" for n, v in given.items())])
        out.append(MethodSpec(label, method, given))
    return out


def _values(method: Method, name: str, text: str) -> list[str]:
    if ":" in text:
        return [f"{value:.6g}" for value in parse_range(f"{name}={text}", method).values]
    return [part for part in text.split("/") if part] or [text]


def measure_pictures(
    scene: Any, camera: Any, base: Settings, chosen: Sequence[Candidate], reference: str = "max"
) -> dict[str, Any]:
    """Errors of one input's candidates over all frames, per frame: label -> measure -> frame -> error, and bytes."""
    run = evaluate_methods(
        scene,
        [c.spec for c in chosen],
        _settings(base),
        input=chosen[0].input,
        reference=reference,
        metrics=("flip",),
        camera=camera,
    )
    rows = {label: [r for r in run.rows if r["method"] == label][1:] for label in run.summary["methods"]}
    told = run.summary["methods"]
    errors = {
        label: {m: {str(r["frame"]): r[m] for r in rows[label]} for m in MEASURED}
        for label in told
        if not told[label]["failed"]
    }
    return {
        "errors": errors,
        "failed": run.failed,
        "bytes": {label: m["memory_bytes"] for label, m in told.items()},
        "settings": {label: m["settings"] for label, m in told.items()},
        "reference": _reference(run.summary["reference"]),
    }


def _reference(told: Mapping[str, Any]) -> str:
    return "path-traced" if told["samples"] is None else f"exact light, {told['samples']} samples per pixel"


def time_pictures(
    scene: Any, camera: Any, base: Settings, frames: range, chosen: Sequence[Candidate]
) -> dict[str, Any]:
    """One visit: milliseconds of shading, and of every method, medians over the same few frames.

    The methods take turns in every frame, and whose turn is first changes from frame to frame.
    """
    count = min(TIMED, len(frames))
    start = frames.start + (len(frames) - count) // 2
    settings = _settings(base).replace(frames=(start, start + count))
    run = evaluate_methods(
        scene,
        [c.spec for c in chosen],
        settings,
        input=chosen[0].input,
        reference_samples=1,
        metrics=(),
        camera=camera,
    )
    told = {label: m["time_ms"] for label, m in run.summary["methods"].items() if not m["failed"]}
    return {"shading_ms": run.summary["input"]["shading_ms"], "method_ms": told, "clock": run.summary["clock"]}


def _settings(base: Settings) -> Settings:
    """The base, with surfaces followed, as 'reuse evaluate' has it, and without what belongs to discard counts."""
    return base.replace(pairs="all", samples_per_pixel=1, reprojection="motion")


@dataclass(frozen=True, slots=True)
class MethodPoint:
    """A measured candidate.  ``errors``: measure -> frame -> error; ``failed``: one line, and then nothing else."""

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
        values = self.errors.get(measure) or {}
        return math.fsum(values.values()) / len(values) if values else None


def method_points(chosen: Sequence[Candidate], records: Iterable[Mapping[str, Any]], repeats: int) -> list[MethodPoint]:
    """Points out of records of the kinds ``quality`` and ``quality_time``."""
    records = list(records)
    pictures = {r["input"]: r for r in records if r["kind"] == "quality"}
    out = []
    for c in chosen:
        label, found = c.spec.label, pictures[c.input]
        visits = [r for r in records if r["kind"] == "quality_time" and r["input"] == c.input][:repeats]
        pairs = [(v["shading_ms"], v["method_ms"][label]) for v in visits if label in v["method_ms"]]
        failed = found["failed"].get(label)
        if failed or not pairs:
            out.append(MethodPoint(c.name, c.label, c.input, {}, None, None, None, None, failed=failed or "no time"))
            continue
        shading, method = (time_of(side, in_turn=False).median for side in zip(*pairs))
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
                visits[0]["clock"],
                found["reference"],
            )
        )
    return out


def recommend(points: Sequence[MethodPoint], measure: str) -> str:
    """In words: the least error, what is as good within the noise of the frames and faster, and no reuse beside it."""
    there = [p for p in points if p.error(measure) is not None and p.time is not None]
    if not there:
        return f"{measure}: nothing was measured"
    best = min(there, key=lambda p: p.error(measure))
    words = f"{measure}: least error by {_told(best, measure)}"
    equal = [p for p in there if p is not best and slower_by(best.time, p.time) > 0 and _as_good(p, best, measure)]
    if equal:
        cheap = min(equal, key=lambda p: p.time.median)
        ratio = best.time.median / cheap.time.median
        words += f"; no worse within the noise of the frames and {ratio:.3g}x as fast: {_told(cheap, measure)}"
    plain = next((p for p in there if p.label == f"{PLAIN} on {best.input}"), None)
    if plain is best:
        return f"{words}; no method measured is better than none"
    return words if plain is None else f"{words}; without reuse {plain.error(measure):.3g}, {plain.time.median:.3g} ms"


def _as_good(point: MethodPoint, best: MethodPoint, measure: str) -> bool:
    """No frame-by-frame rise above twice its standard error."""
    here, there = (p.errors[measure] for p in (point, best))
    mean, error = rises(there, here, dict.fromkeys(here, 0.0))
    return math.isfinite(error) and mean <= 2.0 * error


def _told(p: MethodPoint, measure: str) -> str:
    spread = "" if p.time.spread is None else f" ± {p.time.spread:.2g}"
    parts = f"shading {p.shading_ms:.3g}, method {p.method_ms:.3g}"
    return f"{p.label} ({p.error(measure):.3g}, {p.time.median:.3g}{spread} ms: {parts})"


def quality_json(points: Sequence[MethodPoint]) -> dict[str, Any] | None:
    """The block ``quality`` of study.json; None where no method was asked for."""
    if not points:
        return None
    rows = []
    for p in points:
        row = {k: v for k, v in asdict(p).items() if k not in ("time", "errors")}
        ms = None if p.time is None else asdict(p.time)
        rows.append(row | {"ms": ms, "against_base": _against(p, points), "errors": {m: p.error(m) for m in MEASURED}})
    return {
        "measures": {m: MEASURES[m].doc for m in MEASURED},
        "points": rows,
        "fronts": {m: [p.name for p in pareto_front(points, m)] for m in MEASURED},
        "recommendations": [recommend(points, m) for m in MEASURED],
    }


def _against(point: MethodPoint, points: Sequence[MethodPoint]) -> dict[str, Any] | None:
    """Time over that of no reuse on the same input."""
    plain = next((p for p in points if p.label == f"{PLAIN} on {point.input}"), None)
    if plain is None or plain.time is None or point.time is None:
        return None
    return {"ratio": point.time.median / plain.time.median, "different": slower_by(point.time, plain.time) != 0}


__all__ = ["Candidate", "MethodPoint", "candidates", "measure_pictures", "quality_json", "recommend", "time_pictures"]
