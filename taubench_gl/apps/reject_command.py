"""``taubench-gl reject``: rejection tests of history, scored against exact visibility."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.options import (
    List,
    OutPath,
    culling_option,
    frame_options,
    gpu_options,
    lighting_options,
    settings_from,
    threshold_option,
    unit_scale_option,
    with_options,
)

if TYPE_CHECKING:
    from taubench_gl.reject.evaluate import Rejection

TESTS_HELP = (
    "Comma-separated: a built-in name or a folder, also NAME=THRESHOLD; several joined by + reject what any rejects.  "
    "[default: all built-in ones]"
)


def shared_options(command: Any) -> Any:
    """Frames, thresholds of light, light."""
    return with_options(
        command,
        frame_options(size="1280x720"),
        threshold_option,
        unit_scale_option,
        culling_option,
        lighting_options,
        gpu_options,
    )


@click.group()
def reject() -> None:
    """Rejection tests of history, scored against exact visibility (docs/reject.md)."""


@reject.command(
    "list",
    epilog="""\b
Examples:
  taubench-gl reject list
  taubench-gl reject list --json""",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def list_tests(as_json: bool) -> None:
    """List the built-in tests."""
    from taubench_gl.reject.contract import builtin_tests, load_test

    tests = [load_test(name) for name in builtin_tests()]
    if as_json:
        rows = {t.name: {"title": t.title, "kind": t.kind, "unit": t.unit, "threshold": t.threshold} for t in tests}
        click.echo(json.dumps(rows, indent=2))
        return
    width = max(len(t.name) for t in tests)
    for test in tests:
        click.echo(f"{test.name:{width}}  {test.kind:8}  above {test.threshold:g} {test.unit}: {test.title}")


@reject.command(
    epilog="""\b
Examples:
  taubench-gl reject evaluate scene.glb --size 640x360 --frames 20:30
  taubench-gl reject evaluate scene.glb --tests position,plane_distance,footprint_plane+object_id --out results
  taubench-gl reject evaluate scene.glb --tests position=0.05,position=0.5 --tests ./my_test
\b
Positive means that history must be rejected.  Geometric tests are scored against visibility, tests of color
against visibility or changed light; both are printed.  Pixels of the frustum and the sky stand apart."""
)
@click.argument("path", metavar="SCENE")
@click.option("--tests", type=List(), help=TESTS_HELP)
@click.option("--out", type=OutPath(), metavar="DIR", help="Also write reject.json, tables, plots and report.html.")
@shared_options
def evaluate(path: str, tests: tuple[str, ...] | None, out: Path | None, **options: Any) -> None:
    """Score rejection tests on SCENE: precision, recall, curves over thresholds; by distance, angle, object, motion."""
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.reject.contract import builtin_tests
    from taubench_gl.reject.output import write_rejection
    from taubench_gl.report.reject import reject_tables

    found = _evaluated(path, tests or builtin_tests(), options)
    show_tables(reject_tables(found.summary))
    for note in found.summary["notes"]:
        click.echo(f"note: {note}")
    if out is not None:
        write_rejection(out, found.summary)
        click.echo(f"written to {out}{os.sep}")


@reject.command(
    epilog="""\b
Examples:
  taubench-gl reject fit scene.glb --tests position,footprint_plane --recall 0.98"""
)
@click.argument("path", metavar="SCENE")
@click.option("--tests", type=List(), help=TESTS_HELP)
@click.option(
    "--recall", type=float, default=0.95, show_default=True,
    help="Share of the pixels to be rejected that a threshold must reject: above 0, at most 1.",
)  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@shared_options
def fit(path: str, tests: tuple[str, ...] | None, recall: float, as_json: bool, **options: Any) -> None:
    """Find the largest threshold of each test that reaches a recall, and print what it costs.

    Thresholds are on a logarithmic grid of eight per octave.  A test that cannot reach the recall has none.
    """
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.reject.contract import builtin_tests
    from taubench_gl.reject.fit import check_recall, fit_table, fitted

    check_recall(recall)
    found = fitted(_evaluated(path, tests or builtin_tests(), options), recall)
    if as_json:
        click.echo(json.dumps(found, indent=2, allow_nan=False))
    else:
        show_tables([fit_table(found)])


@reject.command(
    epilog="""\b
Examples:
  taubench-gl reject method --tests position,footprint_plane+object_id --out methods
  taubench-gl reuse evaluate scene.glb --input noisy --methods methods/reject_position"""
)
@click.option("--tests", type=List(), help=TESTS_HELP)
@click.option("--out", type=OutPath(), metavar="DIR", required=True, help="Folder that gets a folder for each test.")
def method(tests: tuple[str, ...] | None, out: Path) -> None:
    """Write rejection tests as reuse methods: running means that differ only in the history they reject.

    'reuse evaluate' compares their images: what false positives cost in noise, and false negatives in ghosts.
    """
    from taubench_gl.reject.as_method import write_methods
    from taubench_gl.reject.contract import builtin_tests, load_tests

    for folder in write_methods(load_tests(tests or builtin_tests()), out):
        click.echo(f"written to {folder}{os.sep}")


def _evaluated(path: str, tests: tuple[str, ...], options: dict[str, Any]) -> Rejection:
    from taubench_gl.apps.named_scenes import resolve, row_settings
    from taubench_gl.apps.screen import ProgressBar
    from taubench_gl.reject.evaluate import evaluate_tests

    path, row = resolve(path)
    settings = settings_from(options, reprojection="motion").replace(**row_settings(row))
    with ProgressBar(Path(path).name) as progress:
        return evaluate_tests(path, tests, settings, progress=progress)
