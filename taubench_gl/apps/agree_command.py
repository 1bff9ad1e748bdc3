"""``taubench-gl agree``: two runs of the same frames, column by column and pixel by pixel."""

from __future__ import annotations

import json

import click


@click.command(
    epilog="""\b
Examples:
  taubench-gl evaluate scene.glb --size 320x180 --out raster --save masks,channels
  taubench-gl evaluate exr:renders --out truth --save masks,channels
  taubench-gl agree raster truth"""
)
@click.argument("first", metavar="RUN_A")
@click.argument("second", metavar="RUN_B")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def agree(first: str, second: str, as_json: bool) -> None:
    """How far RUN_A agrees with RUN_B (folders that 'taubench-gl evaluate --out' wrote).

    Differences of every column in points; with saved masks also their overlap, with saved channels the errors of
    positions and normals.
    """
    from taubench_gl.agreement import agree as compare
    from taubench_gl.agreement import agreement_lines

    result = compare(first, second)
    if as_json:
        click.echo(json.dumps(result, indent=2, allow_nan=False))
    else:
        agreement_lines(result, click.echo)
