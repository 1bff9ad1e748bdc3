"""``cost``: what accuracy costs in time, for one scene.  The whole road on one page."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from taubench_gl.animation import CameraTrack, Poser, choose_camera
from taubench_gl.conventions import COLUMNS
from taubench_gl.cost import methods as quality
from taubench_gl.cost.clock import pass_timer
from taubench_gl.cost.job import Job, Progress
from taubench_gl.cost.parameters import KNOBS, Situation
from taubench_gl.cost.plan import BEST, Plan, fingerprint, identity, make_plan
from taubench_gl.cost.records import RECORDS_FILE, Records
from taubench_gl.cost.result import CostStudy, assemble
from taubench_gl.effects.decide import decide
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import frame_range
from taubench_gl.frame.plan import bound_times, significant_lights
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.timing import WALL_CLOCK, probe_timer
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.pathtraced.series import SampleCountSeries, find_series
from taubench_gl.provenance import provenance
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

REFERENCE_BEST = "best"
REPEATS = 5


def cost(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    *,
    out: str | Path,
    knobs: Sequence[str] | None = None,
    method_inputs: Sequence[str] = quality.INPUTS,
    reference: str = REFERENCE_BEST,
    within: float | None = None,
    budget_ms: float | None = None,
    choose_for: Sequence[str] | None = None,
    repeats: int = REPEATS,
    fresh: bool = False,
    check: bool = True,
    progress: Progress | None = None,
    now: Callable[[], float] = time.perf_counter,
    **overrides: Any,
) -> CostStudy:
    """Measure error and time of every setting of the plan, and say which to use.

    ``settings`` (and ``overrides``, fields of it) are the base that the knobs turn away from.  ``reference``: "best",
    all accuracy knobs at their best, or ``exr:DIR``, path-traced renders.  ``within`` points and
    ``budget_ms`` choose the preset, for ``choose_for`` (all columns).  ``repeats``: rounds, in which every setting
    is timed in turn.
    ``knobs``: names of ``KNOBS`` (None: all of them) and ``method:NAME@setting=VALUES``, reuse methods judged by their
    pictures on each of ``method_inputs`` (``study.quality``).
    ``out`` holds the records: called again, the study goes on where it stopped; ``fresh`` starts anew.  ``check`` runs
    the chosen preset again and holds it against its promise.  ``now``: seconds, the clock of frames.
    Raises TaubenchError.
    """
    base = (settings or Settings()).replace(**overrides)
    if knobs is not None and not knobs:
        raise SettingsError("no knob is given", hint=f"choose from {', '.join(KNOBS)}, method:NAME")
    _check_wishes(within, budget_ms, choose_for, base.metrics.columns, repeats)
    dials, methods = quality.split_knobs(knobs)
    contest = quality.candidates(methods, method_inputs)
    out = Path(out)
    if not isinstance(scene, Scene):
        scene = load_scene(scene, scene=base.sequence.scene, animation=base.sequence.animation)
    series = None
    if is_sequence(reference):
        series = find_series(reference)
        base = series.settings(base)
    elif reference != REFERENCE_BEST:
        raise SettingsError(f"no reference is named {reference!r}", hint="choose best, or exr:DIR")
    camera = choose_camera(scene, base.sequence.camera)
    frames = frame_range(scene, camera, base)
    if len(frames) < 2:
        raise SettingsError("the scene gives no pair of frames", hint="give more --frames, or an animated scene")
    gpu = open_gpu(base.device.backend, base.device.device)
    ranked = tuple(significant_lights(scene, Poser(scene), camera, bound_times(scene)))
    limit = gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
    situation = Situation(scene, decide(scene, base), base, len(frames) - 1, ranked, limit)
    plan = make_plan(situation, dials, bare=bool(contest))
    with gpu:
        verdict = probe_timer(gpu)
        clock = pass_timer(gpu, verdict).clock
    about = _about(gpu, scene, camera, frames, base, plan, reference, series, clock)
    if fresh:
        (out / RECORDS_FILE).unlink(missing_ok=True)
    key = identity(plan, scene.sha256, frames, about["reference"]["identity"], about["camera"])
    if contest:
        key["methods"] = fingerprint([c.name for c in contest])
    records = Records(out, {"identity": key, "machine": about["machine"], "about": about})
    job = Job(gpu, scene, camera, frames, plan, contest, series, records, repeats, verdict, progress, now)
    try:
        job.measure_errors()
        job.measure_times()
        job.measure_methods()
        study = assemble(about, plan, series, records.lines, repeats)
        study.methods = quality.method_points(contest, records.lines, repeats)
        study = study.with_choices(within, budget_ms, choose_for)
        if check:
            study = study.with_check(job.check)
    finally:
        records.close()
    study.out = out
    return study


def _about(
    gpu: Gpu,
    scene: Scene,
    camera: CameraTrack,
    frames: range,
    base: Settings,
    plan: Plan,
    reference: str,
    series: SampleCountSeries | None,
    pass_clock: str,
) -> dict[str, Any]:
    """What every figure of the study is to be printed with."""
    if series is None:
        told = {"kind": REFERENCE_BEST, "name": BEST, "identity": REFERENCE_BEST}
    else:
        hashes = [r.sequence.sha256()[:16] for r in (*series.renders, *filter(None, (series.second,)))]
        told = {"kind": "path-traced", "name": series.reference.name, "identity": " ".join(hashes), "path": reference}
    return {
        "scene": {"name": scene.name, "sha256": scene.sha256, "stand_in": scene.stand_in},
        "camera": camera.describe(),
        "size": [base.sequence.width, base.sequence.height],
        "fps": base.sequence.fps,
        "frames": [frames.start, frames.stop],
        "pairs": len(frames) - 1,
        "reference": told,
        "machine": {
            "renderer": gpu.renderer,
            "driver": gpu.version,
            "processor": _processor(),
            "cores": os.cpu_count(),
        },
        "provenance": provenance(gpu, WALL_CLOCK),
        "clock": WALL_CLOCK,  # of frames, which hold what the CPU does too
        "pass_clock": pass_clock,
        "knobs": list(plan.knobs),
        "skipped": dict(plan.skipped),
    }


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _check_wishes(
    within: float | None,
    budget_ms: float | None,
    choose_for: Sequence[str] | None,
    measured: Sequence[str],
    repeats: int,
) -> None:
    if within is not None and not within >= 0:
        raise SettingsError(f"within is {within}", hint="give points of at least 0")
    if budget_ms is not None and not budget_ms > 0:
        raise SettingsError(f"budget is {budget_ms} ms", hint="give milliseconds above 0")
    if repeats < 1:
        raise SettingsError(f"repeats is {repeats}", hint="give 1 or more; 3 for a spread")
    for column in choose_for or ():
        if column not in COLUMNS:
            raise SettingsError(f"no column is named {column!r}", hint=f"choose from {', '.join(COLUMNS)}")
        if column not in measured:
            raise SettingsError(f"nothing can be chosen for {column}", hint="it is not among the columns to measure")
