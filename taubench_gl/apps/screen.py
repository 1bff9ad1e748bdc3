"""Tables and messages on the terminal, for all commands."""

from __future__ import annotations

import contextlib
import json
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from taubench_gl.errors import SettingsError, TaubenchError, printable

if TYPE_CHECKING:
    from taubench_gl.report import Table
    from taubench_gl.run import Run

TABLE_FORMATS = ("text", "markdown", "csv", "latex", "html")
EXIT_INTERRUPTED = 130
"""Exit code of a command that the user interrupts, as shells have it: 128 and the number of SIGINT."""


# Messages


def note(line: str) -> None:
    """Print a line to standard error."""
    click.echo(line, err=True)


def warn(line: str) -> None:
    """Print a line to standard error that names the program."""
    click.echo(f"taubench-gl: {line}", err=True)


def show_notes(notes: Sequence[object], scene: str = "") -> None:
    """Print at most 10 notes: a broken exporter can produce one per node.  Files of results have all of them."""
    about = f"{scene}: " if scene else ""
    for line in notes[:10]:
        click.echo(f"note: {about}{line}")
    if len(notes) > 10:
        click.echo(f"note: {about}and {len(notes) - 10} more")


@contextlib.contextmanager
def interruptible(line: Callable[[], str]) -> Iterator[None]:
    """Ends the command with ``line``, which says what is kept, where the user interrupts the block."""
    try:
        yield
    except KeyboardInterrupt:
        stop_interrupted(line())


def stop_interrupted(line: str) -> NoReturn:
    """End the command after an interrupt."""
    warn(f"interrupted; {line}")
    raise click.exceptions.Exit(EXIT_INTERRUPTED) from None


# Several scenes


def out_folders(scenes: Sequence[str], out: Path | None) -> list[Path | None]:
    """Folder of each scene's results: ``out`` itself for one scene, else a folder in it named after the file.

    Equal names get -2, -3, ..., never the name of another scene.  Case is ignored, as some file systems do.
    """
    if out is None:
        return [None] * len(scenes)
    if len(scenes) == 1:
        return [out]
    taken: set[str] = set()
    stems = [Path(scene).stem or "scene" for scene in scenes]
    folders: list[Path | None] = []
    for i, stem in enumerate(stems):
        others = {other.lower() for j, other in enumerate(stems) if j != i}
        name, number = stem, 1
        while name.lower() in taken or (number > 1 and name.lower() in others):
            number += 1
            name = f"{stem}-{number}"
        taken.add(name.lower())
        folders.append(out / name)
    return folders


def for_each_scene(scenes: Sequence[str], out: Path | None, run: Callable[[str, Path | None], None]) -> int:
    """Call ``run`` with each scene and its folder; returns the number of scenes that failed.

    One of several scenes that fails prints its error, or the traceback of an internal error, and the others still run.
    """
    failed = 0
    for scene, folder in zip(scenes, out_folders(scenes, out), strict=True):
        try:
            run(scene, folder)
        except Exception as error:
            if len(scenes) == 1 or isinstance(error, click.exceptions.Exit):
                raise
            failed += 1
            if isinstance(error, TaubenchError):
                warn(f"error: {error}")
                continue
            traceback.print_exc()
            warn(f"error: {scene}: internal error, see above")
    return failed


def load_runs(folders: Iterable[str | Path]) -> list[Run]:
    """Stored runs, with a note for each of which files are missing.  Raises OutputError."""
    from taubench_gl.run import load_run

    runs = [load_run(folder) for folder in folders]
    for run in runs:
        if run.missing:
            others = f" and {len(run.missing) - 1} more files" if len(run.missing) > 1 else ""
            note(f"note: {run.out}: {printable(run.missing[0])}{others} of the run missing")
    return runs


# Tables


def show_tables(tables: list[Table], form: str = "text") -> None:
    """Print tables in a form of TABLE_FORMATS; text is styled on a terminal."""
    from taubench_gl.report import FORMATS, MIN_WIDTH, TablesView

    if form != "text":
        click.echo(FORMATS[form](tables), nl=False)
    elif not sys.stdout.isatty():
        click.echo(FORMATS["text"](tables))
    else:
        from rich.console import Console

        console = Console()
        console.width = max(console.width, MIN_WIDTH)
        console.print(TablesView(tables))


def show_json(data: object, *, finite: bool = True) -> None:
    """Print JSON values.  ``finite``: refuse NaN and infinity, which JSON has not."""
    click.echo(json.dumps(data, indent=2, ensure_ascii=False, allow_nan=not finite))


def show_list(rows: Mapping[str, str]) -> None:
    """Print a line for each row, the names in one column."""
    width = max(map(len, rows))
    for name, text in rows.items():
        click.echo(f"{name:{width}}  {text}")


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


def only_one(message: str, hint: str, *choices: object) -> None:
    """Raises SettingsError if more than one of ``choices`` is given."""
    if sum(map(bool, choices)) > 1:
        raise SettingsError(message, hint=hint)
