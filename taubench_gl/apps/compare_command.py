"""``taubench-gl compare``: the tables of stored runs and of the paper."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from taubench_gl.errors import OutputError

if TYPE_CHECKING:
    from taubench_gl.report.table import Table


@click.command(
    epilog="""\b
Examples:
  taubench-gl compare out/sponza out/bistro
  taubench-gl compare out/* --no-paper --format csv > runs.csv
  taubench-gl compare out/sponza --format latex > tables.tex
  taubench-gl compare reuse-a reuse-b
\b
A page that shows runs side by side: 'taubench-gl report RUN RUN --out both.html'."""
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
    Folders of 'taubench-gl reuse evaluate' print the tables of their methods: in common tables where scene, frames,
    input and reference are the same, else one after another.
    """
    from taubench_gl.apps.screen import load_runs, show_tables
    from taubench_gl.report import FORMATS, run_tables
    from taubench_gl.reuse.stored import is_evaluation

    reuse = [is_evaluation(run) for run in runs]
    if any(reuse) and not all(reuse):
        raise OutputError("runs and reuse evaluations have different tables", hint="compare them separately")
    tables = _reuse_tables(runs) if any(reuse) else run_tables([run.summary for run in load_runs(runs)], paper=paper)
    if form == "text":
        show_tables(tables)
    else:
        click.echo(FORMATS[form](tables), nl=False)


def _reuse_tables(folders: tuple[str, ...]) -> list[Table]:
    """Tables of reuse evaluations.  Raises OutputError."""
    from taubench_gl.report.reuse import merged_summaries, reuse_tables
    from taubench_gl.reuse.stored import load_evaluation

    found = [load_evaluation(folder) for folder in folders]
    named = [(one.out.resolve().name, one.summary) for one in found]
    return [table for summary in merged_summaries(named) for table in reuse_tables(summary)]
