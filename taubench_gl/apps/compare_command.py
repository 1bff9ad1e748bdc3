"""``taubench-gl compare``: the tables of stored runs and of the paper."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from taubench_gl.apps.options import command
from taubench_gl.apps.screen import TABLE_FORMATS, load_runs, show_tables
from taubench_gl.conventions import MIXED, mixed_definitions
from taubench_gl.errors import OutputError
from taubench_gl.fields import one_of, setting

if TYPE_CHECKING:
    from taubench_gl.report.table import Table


@command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
def compare(
    runs: tuple[str, ...],
    *,
    form: str = setting("text", "Format of the tables", one_of(TABLE_FORMATS), flag="--format"),
    paper: bool = setting(True, "Include the rows of the paper", flag="--paper/--no-paper"),
) -> None:
    """Print the reusable pixels and Tables 1 to 4 of one or more runs.

    RUN is an output folder of 'taubench-gl evaluate'.  Runs of one scene are labeled with the settings that differ.
    Folders of 'taubench-gl reuse evaluate' print the tables of their methods: in common tables where scene, frames,
    input and reference are the same, else one after another.

    Examples:
      taubench-gl compare out/sponza out/bistro
      taubench-gl compare out/* --no-paper --format csv > runs.csv
      taubench-gl compare out/sponza --format latex > tables.tex
      taubench-gl compare reuse-a reuse-b

    A page that shows runs side by side: 'taubench-gl report RUN RUN --out both.html'.
    """
    from taubench_gl.report import run_tables
    from taubench_gl.reuse.stored import is_evaluation

    reuse = [is_evaluation(run) for run in runs]
    if any(reuse) and not all(reuse):
        raise OutputError("runs and reuse evaluations have different tables", hint="compare them separately")
    tables = _reuse_tables(runs) if any(reuse) else run_tables([run.summary for run in load_runs(runs)], paper=paper)
    show_tables(tables, form)


def _reuse_tables(folders: tuple[str, ...]) -> list[Table]:
    """Tables of reuse evaluations.  Raises OutputError."""
    from taubench_gl.report.reuse import merged_summaries, reuse_tables
    from taubench_gl.reuse.stored import load_evaluation

    evaluations = map(load_evaluation, folders)
    named = [(evaluation.out.resolve().name, evaluation.summary) for evaluation in evaluations]
    tables = [table for summary in merged_summaries(named) for table in reuse_tables(summary)]
    if mixed := mixed_definitions(summary for _, summary in named):
        tables[0] = replace(tables[0], lead=(f"{mixed}: {MIXED}", *tables[0].lead))
    return tables
