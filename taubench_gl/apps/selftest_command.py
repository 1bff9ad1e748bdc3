"""``taubench-gl selftest``: runs the hard cases with known answers on this machine's GPU or CPU driver."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.options import AS_JSON, GPU, command, option_group
from taubench_gl.apps.screen import show_json
from taubench_gl.apps.stages import STAGES
from taubench_gl.errors import SettingsError
from taubench_gl.fields import setting
from taubench_gl.settings import Settings

if TYPE_CHECKING:
    from taubench_gl.selftest import CaseResult

MAX_SIDE = 4096
"""Largest width or height, pixels: larger images could fail for lack of memory."""


@command(settings=option_group(only=("size", *GPU), size="96x64"))
def selftest(
    settings: Settings,
    *,
    only: tuple[str, ...] = setting(
        (), "A case, part of its name, or a group; may be repeated", metavar="NAME", repeats=True
    ),
    listing: bool = setting(False, "Print the names and descriptions, and run nothing", flag="--list"),
    as_json: bool = AS_JSON,
) -> int:
    """Run the hard cases on this machine and print the known answer, the measured value and the error.

    The exit code is 1 if a case fails.

    Examples:
      taubench-gl selftest
      taubench-gl selftest --only offsets --only screen-edge
      taubench-gl selftest --backend osmesa --json > selftest.json
    """
    from taubench_gl.gpu.context import open_gpu
    from taubench_gl.gpu.timing import WALL_CLOCK
    from taubench_gl.provenance import provenance
    from taubench_gl.selftest import cases, run_selftest

    selected = cases(only)
    if not selected:
        raise SettingsError(f"no case is named {', '.join(only)}", hint="see 'taubench-gl selftest --list'")
    if listing:
        for case in selected:
            click.echo(f"{case.group:<11} {case.name:<25} {case.description}")
        return 0
    size, device = (settings.sequence.width, settings.sequence.height), settings.device.device
    if size[0] < 48 or size[1] < 32:
        raise SettingsError(f"size is {size[0]}x{size[1]}", hint="the cases need at least 48x32 pixels")
    if max(size) > MAX_SIDE:
        raise SettingsError(f"size is {size[0]}x{size[1]}", hint=f"the cases take up to {MAX_SIDE}x{MAX_SIDE} pixels")
    STAGES.silence()
    gpu = open_gpu(settings.device.backend, device)
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
        show_json(document)
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
    click.echo(f"      {result.case.description}")
    if not result.passed:
        click.echo(f"      common failure: {result.case.common_failure}")


def _number(value: object) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
