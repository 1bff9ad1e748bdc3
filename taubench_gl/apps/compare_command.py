"""``taubench-gl compare``: the tables of stored runs and of the paper."""

from __future__ import annotations

import click


@click.command(
    epilog="""\b
Examples:
  taubench-gl compare out/sponza out/bistro
  taubench-gl compare out/* --no-paper --format csv > runs.csv
  taubench-gl compare out/sponza --format latex > tables.tex"""
)
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "markdown", "csv", "latex", "html"]),
    default="text",
    show_default=True,
    help="Format of the tables.",
)
@click.option("--paper/--no-paper", default=True, show_default=True, help="Include the rows of the paper.")
def compare(runs: tuple[str, ...], form: str, paper: bool) -> None:
    """Print the reusable pixels and Tables 1 to 4 of one or more runs.

    RUN is an output folder of 'taubench-gl evaluate'.  Runs of one scene are labeled with the settings that differ.
    """
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.report import FORMATS, run_tables
    from taubench_gl.run import load_run

    tables = run_tables([load_run(run).summary for run in runs], paper=paper)
    if form == "text":
        show_tables(tables)
    else:
        click.echo(FORMATS[form](tables), nl=False)
