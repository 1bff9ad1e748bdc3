"""``taubench-gl selftest``: runs the hard cases with known answers on this machine's GPU or CPU driver."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.options import Size, gpu_options

if TYPE_CHECKING:
    from taubench_gl.selftest import CaseResult

MAX_SIDE = 4096
"""Largest width or height, pixels: larger images could fail for lack of memory."""


@click.command(
    epilog="""\b
Examples:
  taubench-gl selftest
  taubench-gl selftest --only offsets --only screen-edge
  taubench-gl selftest --backend osmesa --json > selftest.json"""
)
@gpu_options
@click.option("--size", type=Size(), default="96x64", show_default=True, help="Pixels of most cases; at least 48x32.")
@click.option("--only", multiple=True, metavar="NAME", help="A case, part of its name, or a group; may be repeated.")
@click.option("--list", "listing", is_flag=True, help="Print the names and descriptions, and run nothing.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
def selftest(
    backend: str, device: int | None, size: tuple[int, int], only: tuple[str, ...], listing: bool, as_json: bool
) -> int:
    """Run the hard cases on this machine and print the known answer, the measured value and the error.

    The exit code is 1 if a case fails.
    """
    from taubench_gl.errors import SettingsError
    from taubench_gl.selftest import cases, run_selftest

    chosen = cases(only)
    if not chosen:
        raise SettingsError(f"no case is named {', '.join(only)}", hint="see 'taubench-gl selftest --list'")
    if listing:
        for one in chosen:
            click.echo(f"{one.group:<11} {one.name:<25} {one.what}")
        return 0
    if size[0] < 48 or size[1] < 32:
        raise SettingsError(f"size is {size[0]}x{size[1]}", hint="the cases need at least 48x32 pixels")
    if max(size) > MAX_SIDE:
        raise SettingsError(f"size is {size[0]}x{size[1]}", hint=f"the cases take up to {MAX_SIDE}x{MAX_SIDE} pixels")
    from taubench_gl.gpu.context import open_gpu
    from taubench_gl.gpu.timing import WALL_CLOCK
    from taubench_gl.provenance import provenance

    gpu = open_gpu(backend, device)
    results = run_selftest(gpu, size, only, device=device, on_result=None if as_json else _show_row)
    failed = sum(not r.passed for r in results)
    if as_json:
        document: dict[str, Any] = {
            "cases": [r.as_json() for r in results],
            "passed": len(results) - failed,
            "failed": failed,
            "size": list(size),
            "provenance": provenance(gpu, WALL_CLOCK),
        }
        click.echo(json.dumps(document, indent=2, allow_nan=False))
    else:
        click.echo(f"\n{gpu.renderer}, {gpu.version} ({gpu.backend}), {size[0]}x{size[1]}")
        verdict = f"{failed} of {len(results)} cases FAILED" if failed else f"all {len(results)} cases passed"
        click.secho(verdict, fg="red" if failed else "green", bold=True)
    return 1 if failed else 0


def _show_row(result: CaseResult) -> None:
    """Print the result of a case, then its description, indented."""
    word = "pass" if result.passed else "FAIL"
    head = f"{word}  {result.name:<25} error {result.error:<9.3g} of {result.case.tolerance:g}"
    click.secho(head, fg=None if result.passed else "red", nl=False)
    if result.failure is not None:
        click.echo(f"  {result.failure}")
    else:
        click.echo(f"  expected {_number(result.expected)}, measured {_number(result.measured)}")
    click.echo(f"      {result.case.what}")
    if result.naive is not None:
        verdict = "fails" if not result.naive.error <= result.case.tolerance else "passes here"
        click.echo(f"      {result.naive.formula}: {_number(result.naive.measured)}, {verdict}")


def _number(value: object) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
