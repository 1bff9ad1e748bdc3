"""``taubench-gl agree``: two runs of the same frames, column by column and pixel by pixel."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click

from taubench_gl.apps.option_types import OutPath


@click.command(
    epilog="""\b
Examples:
  taubench-gl evaluate scene.glb --size 320x180 --out raster --save masks,channels
  taubench-gl evaluate exr:renders --out truth --save masks,channels
  taubench-gl agree raster truth
  taubench-gl agree raster truth --out agreement"""
)
@click.argument("first", metavar="RUN_A")
@click.argument("second", metavar="RUN_B")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--out", type=OutPath(), metavar="DIR", help="Also write text, JSON, HTML, a picture.")
def agree(first: str, second: str, as_json: bool, out: Path | None) -> None:
    """How far RUN_A agrees with RUN_B (folders that 'taubench-gl evaluate --out' wrote).

    Differences of every column in points, with the noise floor where known, and seconds per frame of both; with saved
    masks also their overlap and the worst pair, with saved channels the error distribution of every feature.
    """
    from taubench_gl.agreement import agree as compare
    from taubench_gl.agreement import save_agreement
    from taubench_gl.report.agreement import agreement_text

    result = compare(first, second)
    if as_json:
        click.echo(json.dumps(result, indent=2, allow_nan=False))
    else:
        click.echo("\n".join(agreement_text(result)))
    if out is not None:
        save_agreement(result, out)
        click.echo(f"written to {out}{os.sep}", err=as_json)
