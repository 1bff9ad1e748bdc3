"""``taubench-gl doctor``: OpenGL and libraries of this machine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import AS_JSON, GPU, command, option_group
from taubench_gl.apps.screen import show_json
from taubench_gl.fields import setting
from taubench_gl.settings import Settings


@command(settings=option_group(only=GPU))
def doctor(
    settings: Settings,
    *,
    as_json: bool = AS_JSON,
    file: Path | None = setting(
        None,
        "Also run the hard cases and ten frames, and write all of it to FILE: for an issue about a driver",
        flag="--report",
        metavar="FILE",
    ),
) -> int:
    """Print the OpenGL of this machine, its limits, and the versions of installed libraries.

    If OpenGL 4.5 cannot be opened, exits with code 2 and prints a command that may help.

    Examples:
      taubench-gl doctor
      taubench-gl doctor --backend osmesa --json
      taubench-gl doctor --report driver.json
    """
    from taubench_gl.gpu.capabilities import capability_report

    backend, device = settings.device.backend, settings.device.device
    if file is not None:
        return _write_report(file, backend, device)
    report = capability_report(backend, device)
    if as_json:
        show_json(report)
    else:
        show_report(report)
    return 0


def _write_report(file: Path, backend: str, device: int | None) -> int:
    """The exit code is 1 if a hard case fails: the file is written all the same."""
    from taubench_gl.outputs import write_atomically
    from taubench_gl.selftest.driver_report import driver_report

    report = driver_report(backend, device)
    write_atomically(file, json.dumps(report, indent=1, allow_nan=False) + "\n")
    show_report(report)
    failed = len(report["selftest"]["failed"])
    cases = f"{report['selftest']['passed']} of {report['selftest']['passed'] + failed} hard cases passed"
    click.echo(f"\n{cases}; written to {file}")
    return 1 if failed else 0


def show_report(report: dict[str, Any]) -> None:
    """Print a capability report as tables; ``--json`` prints all of its keys."""
    from taubench_gl.apps.screen import show_pairs

    timer = report["timer"]
    usable = "usable" if timer["usable"] else "not usable"
    gl = {name: report.get(name) for name in ("backend", "renderer", "vendor", "version", "glsl")}
    show_pairs("OpenGL", {**gl, "GPU timer": f"{usable}: {timer['why']}"})
    ways = report.get("backends", {})
    show_pairs("Backends", {name: f"{'yes' if b['usable'] else 'no'}: {b['why']}" for name, b in ways.items()})
    show_pairs("Limits", report.get("limits", {}))
    libraries = report.get("libraries", {})
    show_pairs("Libraries", {name: version or "not installed" for name, version in libraries.items()})
