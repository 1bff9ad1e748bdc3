"""``cost``: what accuracy costs in time, for one scene.  The whole road on one page."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from taubench_gl.animation import CameraTrack, Poser, choose_camera
from taubench_gl.conventions import COLUMNS
from taubench_gl.effects.decide import decide
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import frame_range
from taubench_gl.frame.plan import bound_times, significant_lights
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.timing import WALL_CLOCK, probe_timer
from taubench_gl.provenance import provenance
from taubench_gl.reference.sequence import is_sequence
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings
from taubench_gl.study import quality
from taubench_gl.study import rungs as truth
from taubench_gl.study.clock import pass_timer
from taubench_gl.study.column_errors import column_errors
from taubench_gl.study.job import Job, Progress
from taubench_gl.study.knobs import KNOBS, Situation
from taubench_gl.study.laps import ROUGH, Laps, nothing_tried
from taubench_gl.study.plan import BASE, BEST, Plan, fingerprint, identity, make_plan
from taubench_gl.study.result import ALL, CostStudy, assemble, fronts_of
from taubench_gl.study.search import FRONT, Search
from taubench_gl.study.store import RECORDS_FILE, Records

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
    front: int = FRONT,
    fresh: bool = False,
    check: bool = True,
    progress: Progress | None = None,
    now: Callable[[], float] = time.perf_counter,
    **overrides: Any,
) -> CostStudy:
    """Measure error and time of every setting of the plan, and say which to use.

    ``settings`` (and ``overrides``, fields of it) are the base that the knobs turn away from.  ``reference``: "best",
    all accuracy knobs at their best, or ``exr:DIR``, path-traced renders (``study.rungs``).  ``within`` points and
    ``budget_ms`` choose the preset, for ``choose_for`` (all columns).  ``repeats``: rounds, in which every setting
    is timed in turn.  ``front``: settings wanted on the front of each of those columns and of their worst; until they
    are there, settings between neighbours on the fronts are tried (``study.search``).  0: the declared ones alone.
    ``knobs``: names of ``KNOBS`` (None: all of them) and ``method:NAME@setting=VALUES``, reuse methods judged by their
    pictures on each of ``method_inputs`` (``study.quality``).
    ``out`` holds the records: called again, the study goes on where it stopped; ``fresh`` starts anew.  ``check`` runs
    the chosen preset again and holds it against its promise.  ``now``: seconds, the clock of frames.
    Raises TaubenchError.
    """
    base = replace(settings or Settings(), **overrides)
    if knobs is not None and not knobs:
        raise SettingsError("no knob is given", hint=f"choose from {', '.join(KNOBS)}, method:NAME")
    _check_wishes(within, budget_ms, choose_for, base.columns, repeats, front)
    dials, methods = quality.split_knobs(knobs)
    contest = quality.candidates(methods, method_inputs)
    out = Path(out)
    if not isinstance(scene, Scene):
        scene = load_scene(scene, scene=base.scene, animation=base.animation)
    ladder = None
    if is_sequence(reference):
        ladder = truth.find_ladder(reference)
        base = truth.fitting(base, ladder)
    elif reference != REFERENCE_BEST:
        raise SettingsError(f"no reference is named {reference!r}", hint="choose best, or exr:DIR")
    camera = choose_camera(scene, base.camera)
    frames = frame_range(scene, camera, base)
    if len(frames) < 2:
        raise SettingsError("the scene gives no pair of frames", hint="give more --frames, or an animated scene")
    gpu = open_gpu(base.backend, base.device)
    ranked = tuple(significant_lights(scene, Poser(scene), camera, bound_times(scene)))
    limit = gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
    situation = Situation(scene, decide(scene, base), base, len(frames) - 1, ranked, limit)
    plan = make_plan(situation, dials, bare=bool(contest))
    with gpu:
        verdict = probe_timer(gpu)
        clock = pass_timer(gpu, verdict).clock
    about = _about(gpu, scene, camera, frames, base, plan, reference, ladder, clock)
    if fresh:
        (out / RECORDS_FILE).unlink(missing_ok=True)
    key = identity(plan, scene.sha256, frames, about["reference"]["identity"], about["camera"])
    if contest:
        key["methods"] = fingerprint([c.name for c in contest])
    records = Records(out, {"identity": key, "machine": about["machine"], "about": about})
    job = Job(gpu, scene, camera, frames, plan, contest, ladder, records, repeats, verdict, progress, now)
    try:
        job.measure_errors()
        laps = None
        if front and repeats >= ROUGH:
            laps = _laps(plan, situation, records, choose_for, front, ladder, len(frames) - 1)
        if laps is None:
            job.measure_times()
        passed = 0 if laps is None else job.fill(laps)
        job.measure_methods()
        study = assemble(about, job.plan, ladder, records.lines, repeats, passed)
        study.sanity = [job.explain(s) for s in study.sanity]
        study.methods = quality.method_points(contest, records.lines, repeats)
        study = study.with_choices(within, budget_ms, choose_for)
        if laps is not None:
            study.search = laps.report(study.points)
        elif front:
            study.search = nothing_tried(front, study.fronts)
        if check:
            study = study.with_check(job.check)
    finally:
        records.close()
    study.out = out
    return study


def _laps(
    plan: Plan,
    situation: Situation,
    records: Records,
    asked: Sequence[str] | None,
    front: int,
    ladder: truth.Ladder | None,
    pairs: int,
) -> Laps:
    """The search that fills the fronts.  Two errors are told apart where they differ by a pixel of one pair, and by
    more than the noise of the reference."""
    reference = BEST if ladder is None else ladder.reference.name
    errors = {r["setting"]: r for r in records.of("error")}
    measured = column_errors(errors[BASE], errors[reference], same_pairs=True)
    fronts = fronts_of([c for c in COLUMNS if measured[c].error is not None], tuple(asked or ()))
    noise, base = errors[reference].get("floor") or {}, situation.base
    pixel = 100.0 / (base.width * base.height * pairs)
    floors = {name: max(pixel, *(noise.get(c) or 0.0 for c in columns)) for name, columns in fronts.items()}
    wanted = tuple(f for f in fronts if not asked or f in asked or f == ALL)
    dials = tuple(n for n in plan.knobs if KNOBS[n].kind == "accuracy")
    search = Search(situation, dials, wanted, front, floors, plan.named(BEST).choice, (ALL,))
    return Laps(search, plan, fronts, records, reference, ladder)


def _about(
    gpu: Gpu,
    scene: Scene,
    camera: CameraTrack,
    frames: range,
    base: Settings,
    plan: Plan,
    reference: str,
    ladder: truth.Ladder | None,
    pass_clock: str,
) -> dict[str, Any]:
    """What every figure of the study is to be printed with."""
    if ladder is None:
        told = {"kind": REFERENCE_BEST, "name": BEST, "identity": REFERENCE_BEST}
    else:
        hashes = [r.sequence.sha256()[:16] for r in (*ladder.rungs, *filter(None, (ladder.second,)))]
        told = {"kind": "path-traced", "name": ladder.reference.name, "identity": " ".join(hashes), "path": reference}
    return {
        "scene": {"name": scene.name, "sha256": scene.sha256, "stand_in": scene.stand_in},
        "camera": camera.describe(),
        "size": [base.width, base.height],
        "fps": base.fps,
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
    front: int,
) -> None:
    if within is not None and not within >= 0:
        raise SettingsError(f"within is {within}", hint="give points of at least 0")
    if budget_ms is not None and not budget_ms > 0:
        raise SettingsError(f"budget is {budget_ms} ms", hint="give milliseconds above 0")
    if repeats < 1:
        raise SettingsError(f"repeats is {repeats}", hint="give 1 or more; 3 for a spread")
    if front < 0:
        raise SettingsError(
            f"front is {front}", hint="give the settings wanted on a front, 0 to measure declared ones alone"
        )
    for column in choose_for or ():
        if column not in COLUMNS:
            raise SettingsError(f"no column is named {column!r}", hint=f"choose from {', '.join(COLUMNS)}")
        if column not in measured:
            raise SettingsError(f"nothing can be chosen for {column}", hint="it is not among the columns to measure")
