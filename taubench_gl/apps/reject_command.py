"""``taubench-gl reject``: rejection tests of history, scored against exact visibility."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from taubench_gl.apps.options import AS_JSON, FRAMES, GPU, Commands, command, option_group
from taubench_gl.apps.screen import show_json, show_list, show_tables
from taubench_gl.fields import REQUIRED, one_of, setting
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.settings import OUTPUT, Settings

if TYPE_CHECKING:
    from taubench_gl.reject.evaluate import Rejection

TESTS = setting(
    None,
    "Comma-separated: a built-in name or a folder, also NAME=THRESHOLD; several joined by + reject what any rejects",
    shown="all built-in ones",
)
SETTINGS = option_group(
    only=(*FRAMES, "thresholds", "unit_scale", "culling", "lighting", *GPU),
    without=("effects", "probes", "indirect_samples"),
    size="1280x720",
)


@click.group(cls=Commands)
def reject() -> None:
    """Rejection tests of history, scored against exact visibility (docs/reject.md)."""


@command("list")
def list_tests(*, as_json: bool = AS_JSON) -> None:
    """List the built-in tests.

    Examples:
      taubench-gl reject list
      taubench-gl reject list --json
    """
    from taubench_gl.reject.contract import builtin_tests, load_test

    tests = [load_test(name) for name in builtin_tests()]
    if as_json:
        rows = {t.name: {"title": t.title, "kind": t.kind, "unit": t.unit, "threshold": t.threshold} for t in tests}
        show_json(rows)
        return
    show_list({t.name: f"{t.kind:8}  above {t.threshold:g} {t.unit}: {t.title}" for t in tests})


@command(
    settings=SETTINGS,
    files=option_group(PathTracedOptions, without=("lobes", "second_seed", "camera_file")),
)
@click.argument("path", metavar="SCENE")
def evaluate(
    path: str,
    settings: Settings,
    files: PathTracedOptions,
    *,
    tests: tuple[str, ...] | None = TESTS,
    out: Path | None = setting(
        None, "Also write reject.json, tables, plots and report.html", group=OUTPUT, metavar="DIR"
    ),
) -> None:
    """Score rejection tests on SCENE: precision, recall, curves over thresholds; by distance, angle, object, motion.

    Examples:
      taubench-gl reject evaluate scene.glb --size 640x360 --frames 20:30
      taubench-gl reject evaluate scene.glb --tests position,plane_distance,footprint_plane+object_id --out results
      taubench-gl reject evaluate scene.glb --tests position=0.05,position=0.5 --tests ./my_test
      taubench-gl reject evaluate exr:frames --scene-file scene.glb --mapping engine.toml --tests relative_depth

    Positive means that history must be rejected.  Geometric tests are scored against visibility, tests of color
    against visibility or changed light; both are printed.  Pixels of the frustum and the sky stand apart.
    exr:DIR: also the rejection that the frames have, in a pass rejected or history_weight of their mapping.
    """
    from taubench_gl.reject.output import write_rejection
    from taubench_gl.report.reject import reject_tables

    rejection = _evaluated(path, tests, settings, files)
    show_tables(reject_tables(rejection.summary))
    for note in rejection.summary["notes"]:
        click.echo(f"note: {note}")
    if out is not None:
        write_rejection(out, rejection.summary)
        click.echo(f"written to {out}{os.sep}")


@command(settings=SETTINGS)
@click.argument("path", metavar="SCENE")
def fit(
    path: str,
    settings: Settings,
    *,
    tests: tuple[str, ...] | None = TESTS,
    recall: float = setting(
        0.95, "Share of the pixels to be rejected that a threshold must reject: above 0, at most 1"
    ),
    as_json: bool = AS_JSON,
) -> None:
    """Find the largest threshold of each test that reaches a recall, and print what it costs.

    Thresholds are on a logarithmic grid of eight per octave.  A test that cannot reach the recall has none.

    Examples:
      taubench-gl reject fit scene.glb --tests position,footprint_plane --recall 0.98
    """
    from taubench_gl.reject.output import check_recall, fit_table, fitted

    check_recall(recall)
    thresholds = fitted(_evaluated(path, tests, settings), recall)
    if as_json:
        show_json(thresholds)
    else:
        show_tables([fit_table(thresholds)])


@command()
def method(
    *,
    tests: tuple[str, ...] | None = TESTS,
    out: Path = setting(REQUIRED, "Folder that gets a folder for each test", group=OUTPUT, metavar="DIR"),
    history: str = setting(
        "mean",
        "What a test rejects: the running mean of shaded frames, or the reservoirs of restir-di (tests of geometry)",
        one_of(("mean", "reservoirs")),
    ),
) -> None:
    """Write rejection tests as reuse methods that differ only in the history they reject.

    'reuse evaluate' compares their images: what false positives cost in noise, and false negatives in ghosts or bias.

    Examples:
      taubench-gl reject method --tests position,footprint_plane+object_id --out methods
      taubench-gl reuse evaluate scene.glb --input noisy --methods methods/reject_position
      taubench-gl reject method --tests position,svgf --history reservoirs --out gates
      taubench-gl reuse evaluate scene.glb --input path-traced@1 --reference path-traced --methods gates/gate_position
    """
    from taubench_gl.reject.as_method import write_methods
    from taubench_gl.reject.contract import builtin_tests, load_tests

    for folder in write_methods(load_tests(tests or builtin_tests()), out, history):
        click.echo(f"written to {folder}{os.sep}")


def _evaluated(
    path: str, tests: tuple[str, ...] | None, settings: Settings, files: PathTracedOptions | None = None
) -> Rejection:
    from taubench_gl.apps.named_scenes import resolve, row_settings
    from taubench_gl.apps.progress import ProgressBar
    from taubench_gl.reject.contract import builtin_tests
    from taubench_gl.reject.evaluate import evaluate_tests

    path, row = resolve(path, settings.sequence.animation)
    settings = settings.replace(reprojection="motion", **row_settings(row))
    with ProgressBar(path) as progress:
        return evaluate_tests(path, tests or builtin_tests(), settings, files=files, progress=progress)


for member in (list_tests, evaluate, fit, method):
    reject.add_command(member)
