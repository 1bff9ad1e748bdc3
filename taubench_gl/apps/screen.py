"""Tables and progress on the terminal, for all commands."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.errors import printable

if TYPE_CHECKING:
    from taubench_gl.report import Table
    from taubench_gl.run import Progress, Run

PLAIN_STEPS = 10
"""Progress lines per scene if standard error is not a terminal."""


def load_runs(folders: Iterable[str | Path]) -> list[Run]:
    """Stored runs, with a note for each of which files are missing.  Raises OutputError."""
    from taubench_gl.run import load_run

    found = [load_run(folder) for folder in folders]
    for run in found:
        if run.missing:
            more = f" and {len(run.missing) - 1} more files" if len(run.missing) > 1 else ""
            click.echo(f"note: {run.out}: {printable(run.missing[0])}{more} of the run missing", err=True)
    return found


def show_tables(tables: list[Table]) -> None:
    """Print tables: styled on a terminal, plain text in a pipe."""
    if not sys.stdout.isatty():
        from taubench_gl.report import FORMATS

        click.echo(FORMATS["text"](tables))
        return
    from rich.console import Console

    from taubench_gl.report import MIN_WIDTH, TablesView

    console = Console()
    console.width = max(console.width, MIN_WIDTH)
    console.print(TablesView(tables))


def show_pairs(title: str, pairs: dict[str, Any]) -> None:
    """Print a heading and two columns; long values wrap."""
    from rich.console import Console
    from rich.table import Table as Grid
    from rich.text import Text

    grid = Grid(show_header=False, box=None, padding=(0, 2, 0, 0), pad_edge=False)
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    for name, value in pairs.items():
        grid.add_row(Text(printable(f"  {name}")), Text("–" if value is None else printable(str(value))))
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 160
    console.print(Text(printable(title), style="bold"), grid)


class ProgressBar:
    """Progress callback of ``evaluate``: a bar on a terminal, PLAIN_STEPS lines in a file or pipe."""

    def __init__(self, name: str, unit: str = "pairs"):
        self.name, self.unit = printable(name), unit
        self.done = 0
        self.total = 0
        self._bar: Any = None
        self._task: Any = None
        self._seconds = 0.0

    def __enter__(self) -> ProgressBar:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            rate = TextColumn("{task.fields[rate]}")
            columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
            self._bar = Progress(*columns, rate, TimeRemainingColumn(), console=Console(stderr=True), transient=True)
            self._task = self._bar.add_task(self.name, total=None, rate="starting")
            self._bar.start()
        return self

    def __exit__(self, *exc: Any) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, progress: Progress) -> None:
        before, self.done, self.total = self.done, progress.done, progress.total
        self._seconds += progress.frame_seconds
        rate = f"{self.done / self._seconds:.2f} {self.unit}/s" if self._seconds > 0 else ""
        if self._bar is not None:
            self._bar.update(self._task, completed=self.done, total=self.total, rate=rate)
        elif self.done * PLAIN_STEPS // max(self.total, 1) > before * PLAIN_STEPS // max(self.total, 1):
            left = self._seconds / self.done * (self.total - self.done)
            click.echo(f"{self.name}: {self.done}/{self.total} {self.unit}, {rate}, {left:.0f} s left", err=True)
