"""A finished evaluation and its files: ``summary.json`` and ``frames.csv``."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taubench_gl.checksums import stored_files, with_checksums, without_checksums
from taubench_gl.conventions import SUMMARY_SCHEMA
from taubench_gl.data_files import checked, integer, one_line, read_csv, read_json, real
from taubench_gl.errors import OutputError
from taubench_gl.features import COLUMNS
from taubench_gl.folder_lock import FolderLock
from taubench_gl.outputs import cannot_write, csv_text, new_file, remove_files, text_bytes, write_atomically
from taubench_gl.run_schema import (
    COUNT_COLUMNS,
    DECIDED_COLUMNS,
    EXACT_COLUMNS,
    FRAME_COLUMNS,
    OTHER_COLUMNS,
    SAMPLED_COLUMNS,
    Summary,
)

SUMMARY_FILE = "summary.json"
FRAMES_FILE = "frames.csv"

INTEGER_COLUMNS = frozenset(
    {
        "frame",
        *COUNT_COLUMNS,
        *OTHER_COLUMNS,
        *EXACT_COLUMNS,
        *DECIDED_COLUMNS,
        SAMPLED_COLUMNS[0],
        "camera_cut",
        "gimbal",
    }
)
"""Columns of frames.csv that hold integers."""


def not_reusable(row: Mapping[str, Any]) -> float:
    """Share of the surface pixels of a row of frames.csv that are not reusable, 0 to 1; the worst frame has the most.

    By ``shading``, else ``surface``.  Where neither was measured, discards of all columns over all pixels; 0 where no
    pixel shows a surface.
    """
    for reusable in (row.get("reusable_shading"), row.get("reusable_surface")):
        if reusable is not None:
            surface = row["pixels"] - (row.get("sky") or 0)
            return 1.0 - reusable / surface if surface else 0.0
    return sum(row.get(name) or 0 for name in COLUMNS) / max(row.get("pixels") or 0, 1)


@dataclass(frozen=True, slots=True)
class Progress:
    """How far an evaluation is: reported once per evaluated pair, and then after each round of sampled light.

    ``frame_seconds``: wall-clock time of this pair, 0 of a round; ``text``: about the round, else empty.
    """

    scene: str
    done: int
    total: int
    frame_seconds: float
    text: str = ""


@dataclass(slots=True)
class Run:
    """A finished evaluation: what ``evaluate`` returns and ``load_run`` reads back.

    ``summary`` is summary.json as plain Python values; ``frames`` has one dict per pair with FRAME_COLUMNS as keys, and
    ``None`` for a value that was not measured; ``out`` is the folder of the files, if any; ``missing``: files that the
    run wrote there and that ``load_run`` did not find.
    """

    summary: dict[str, Any]
    frames: list[dict[str, Any]]
    out: Path | None = None
    missing: list[str] = field(default_factory=list)

    def tables(self, paper: bool = True) -> list[Any]:
        """Reusable pixels, then Tables 1 to 4, as plain data (``report.table.Table``); ``paper``: with its rows."""
        from taubench_gl.report import run_tables

        return run_tables([self.summary], paper=paper)

    def table(self, paper: bool = True) -> Any:
        """Reusable pixels, then Tables 1 to 4: printable, a rich renderable, and HTML in a notebook."""
        from taubench_gl.report import TablesView

        return TablesView(self.tables(paper))

    def plot(self) -> Any:
        """Discard rate of every pair over time, and the camera motion below it: a Matplotlib figure.

        Shown in a notebook; ``figure.savefig("frames.png")`` writes it.  Raises OutputError for a run without pairs.
        """
        from taubench_gl.report.run_plots import frames_plot

        if not self.frames:
            raise OutputError("the run has no pair to plot", where=None if self.out is None else str(self.out))
        return frames_plot(self.summary, self.frames).figure

    def to_pandas(self) -> Any:
        """The pairs as a pandas DataFrame: one row per pair, FRAME_COLUMNS as columns, NaN where not measured.

        Raises OutputError without pandas, which is optional.
        """
        try:
            import pandas
        except ImportError:
            raise OutputError("to_pandas needs pandas", hint="run: pip install pandas") from None
        known = {name: place for place, name in enumerate(FRAME_COLUMNS)}  # other columns come last
        columns = sorted(self.frames[0] if self.frames else FRAME_COLUMNS, key=lambda c: known.get(c, len(known)))
        table = pandas.DataFrame(self.frames, columns=columns)
        unmeasured = [name for name in columns if table[name].isna().all()]
        return table.astype(dict.fromkeys(unmeasured, float))

    def save(self, folder: str | Path) -> Path:
        """Write summary.json and frames.csv into ``folder``.  Raises OutputError."""
        columns = list(self.frames[0]) if self.frames else list(FRAME_COLUMNS)
        with RunWriter(folder, columns) as writer:
            for row in self.frames:
                writer.write_row(row)
            writer.write_summary(self.summary)
        return writer.out

    def _repr_html_(self) -> str:
        """The run in a notebook: what was evaluated, the headline and tables, and the notes."""
        from html import escape

        notes = "".join(f"<li>{escape(str(note))}</li>" for note in self.summary.get("notes") or ())
        listed = f"<details><summary>Notes</summary><ul>{notes}</ul></details>" if notes else ""
        return f"<p>{escape(self._title())}</p>{self.table(paper=False)._repr_html_()}{listed}"

    def _title(self) -> str:
        """What was evaluated, such as ``demo: 60 pairs at 24 fps, 1920x1080``."""
        settings = self.summary.get("settings", {})
        size = f"{settings.get('width', '?')}x{settings.get('height', '?')}"
        name = self.summary.get("scene", {}).get("name", "?")
        fps = settings.get("fps")
        rate = "?" if fps is None else f"{fps:g}"
        return f"{name}: {self.summary.get('pairs', 0)} pairs at {rate} fps, {size}"

    def __repr__(self) -> str:
        discard = {name: (self.summary.get("discard") or {}).get(name) for name in COLUMNS}
        reusable = {
            f"reusable {rate}": (self.summary.get("reusable") or {}).get(rate) for rate in ("surface", "shading")
        }
        entries = (reusable | discard).items()
        shares = {name: entry.get("mean_percent") for name, entry in entries if entry is not None}
        shares["sky"] = (self.summary.get("reusable") or {}).get("sky_percent")
        rates = ", ".join(f"{name} {share:.2f} %" for name, share in shares.items() if share is not None)
        return f"<Run {self._title()}: {rates or 'nothing measured'}>"


_WRITTEN_WITHOUT_RECORD = (
    "report.html", "share.html", "masks/mask_*.npz", "masks/mask_*.png", "channels/channels_*.npz"
)  # fmt: skip
"""Files of an earlier run that no summary.json names: of ``report``, ``share`` and interrupted runs."""


class RunWriter:
    """Writes a run pair by pair.  It is a context manager; ``with`` creates and locks the folder or raises OutputError.

    ``frames.csv`` grows by one whole line per evaluated pair, each written in one unbuffered call: an interrupted run
    keeps its pairs, and a run that fails before the first pair leaves no file.  ``summary.json`` is written last, to
    a temporary file that is renamed; the files of an earlier run are removed first, so that they never show other rows.
    """

    def __init__(self, out: str | Path, frame_columns: Sequence[str] = FRAME_COLUMNS):
        self.out = Path(out)
        self.columns = tuple(frame_columns)
        self.rows = 0
        self._file: io.FileIO | None = None
        self._begun = False
        self._lock = FolderLock(out)

    def __enter__(self) -> RunWriter:
        self._lock.__enter__()
        try:
            self._remove_earlier()
            # Unbuffered: one write call per row, so no row can be cut in two by an interrupt between flushes.
            self._file = new_file(self.path(FRAMES_FILE))
            self._begun = True
            self._write_line(self.columns)
        except OSError as error:
            self._forget()
            raise cannot_write(self.out, error) from None
        return self

    def _remove_earlier(self) -> None:
        """Remove summary.json of an earlier run and what it, ``report`` and ``share`` wrote beside.  Raises OSError.

        This run may not write these files, and they would show other pairs.  Files of others are kept.
        """
        summary = self.path(SUMMARY_FILE)
        with contextlib.suppress(OutputError):
            names = stored_files(read_json(summary, dict[str, Any]))
            remove_files(self.out, names)
        summary.unlink(missing_ok=True)
        remove_files(self.out, _WRITTEN_WITHOUT_RECORD)

    def __exit__(self, *exc: Any) -> None:
        begun = self._file is not None
        self._close()
        if begun and exc[0] is not None and not self.rows:
            self._forget()
        self._lock.__exit__(*exc)

    def _close(self) -> None:
        """Close frames.csv, if it is open."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _forget(self) -> None:
        """Remove a frames.csv without rows, and the folders made for it if they are empty."""
        begun, self._begun = self._begun, False
        self._close()
        with contextlib.suppress(OSError):
            if begun:
                (self.out / FRAMES_FILE).unlink(missing_ok=True)
        self._lock.__exit__()

    def path(self, name: str) -> Path:
        """Path of another output called ``name``, whose folder is created.  Raises OutputError."""
        path = self.out / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(path.parent, error) from None
        return path

    def write_row(self, row: Mapping[str, Any]) -> None:
        """Append one pair.  Raises KeyError for a column that was not declared, OutputError if it cannot be written."""
        cells = self._cells(row)
        try:
            self._write_line(cells)
        except OSError as error:
            raise cannot_write(self.path(FRAMES_FILE), error) from None
        self.rows += 1

    def rewrite_rows(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Replace frames.csv atomically by rows with the columns that need the whole sequence (camera cuts).

        Appending afterwards raises ValueError.
        """
        text = csv_text([self.columns, *map(self._cells, rows)])
        self._close()
        write_atomically(self.path(FRAMES_FILE), text)
        self.rows = len(rows)

    def write_summary(self, summary: Mapping[str, Any], files: Iterable[Path] = ()) -> None:
        """Write summary.json atomically, with checksums.  ``files``: others that the run wrote to the folder.

        Raises OutputError for a file that is missing.  NaN and infinity are not JSON: they raise ValueError.
        """
        plain = json.loads(text_bytes(json.dumps(summary, ensure_ascii=False, allow_nan=False, default=_plain)))
        whole = with_checksums(plain, self.path(FRAMES_FILE), files)
        write_atomically(self.path(SUMMARY_FILE), json.dumps(whole, indent=2, ensure_ascii=False) + "\n")

    def _write_line(self, cells: Sequence[Any]) -> None:
        """Append one line to frames.csv in one call.  Raises ValueError if it is not open, OSError."""
        if self._file is None:
            raise ValueError("frames.csv is not open: write rows inside the with block, before rewrite_rows")
        self._file.write(text_bytes(csv_text([cells])))

    def _cells(self, row: Mapping[str, Any]) -> list[Any]:
        """A pair as cells in the order of the columns.  Raises KeyError for a column that was not declared."""
        if unknown := row.keys() - set(self.columns):
            raise KeyError(f"frames.csv has no column {', '.join(sorted(unknown))}")
        return [_cell(row.get(name)) for name in self.columns]


def load_run(folder: str | Path) -> Run:
    """Read a stored run; ``folder`` may also name its summary.json.

    Raises OutputError if the run is missing, unfinished, damaged or of another schema version.  The checksums in
    summary.json notice damage; they are no protection against forgery, and numbers are not computed again.
    """
    out = Path(folder)
    if out.name == SUMMARY_FILE:
        out = out.parent
    path = out / SUMMARY_FILE
    if out.exists() and not out.is_dir():
        raise OutputError("is not a folder with a run", where=str(out), hint="give the folder evaluate wrote")
    if not path.exists():
        raise _no_summary(out)
    summary = read_json(path)
    schema = summary.get("schema") if isinstance(summary, dict) else None
    if schema != SUMMARY_SCHEMA:
        hint = "another version of taubench-gl wrote it, or it is not a run"
        if schema == "taubench-gl/summary/1":
            hint = "its reusable pixels count sky: evaluate the scene again"
        if str(schema).startswith("taubench-gl/batch/"):
            hint = "a batch: give the folders in its jobs/, or use 'taubench-gl batch report'"
        raise OutputError(f"schema is {schema!r}, expected {SUMMARY_SCHEMA!r}", where=str(path), hint=hint)
    with one_line(path, hint="is the file damaged?"):
        checked(summary, Summary)
    rows = read_frames(out / FRAMES_FILE)
    summary, missing = without_checksums(summary, path, out / FRAMES_FILE)
    return Run(summary, rows, out, missing)


def read_frames(
    path: Path, integers: Collection[str] = INTEGER_COLUMNS, texts: Collection[str] = ()
) -> list[dict[str, Any]]:
    """Rows of a frames.csv, also of an interrupted run: numbers as int or float, an empty cell as None.

    ``integers``: columns without fractions; ``texts``: columns of text.  Raises OutputError.
    """
    if not path.exists():
        raise OutputError("is missing", where=str(path), hint="the run's folder is not complete")
    columns: list[str] = []
    rows = []
    for number, cells in read_csv(path, whole_lines=True, links=False):
        if number == 1:
            columns = cells
            continue
        if len(cells) != len(columns):
            raise OutputError(f"{len(cells)} cells, expected {len(columns)}", where=f"{path}:{number}")
        try:
            rows.append({
                # csv_text writes ' before text that a spreadsheet takes for a formula
                name: cell.removeprefix("'") if name in texts else _number(name, cell, integers)
                for name, cell in zip(columns, cells, strict=True)
            })  # fmt: skip
        except ValueError as error:
            raise OutputError(str(error), where=f"{path}:{number}") from None
    return rows


def _cell(value: Any) -> Any:
    """The value of a cell: booleans as 0 or 1, NumPy scalars as Python numbers; floats keep every digit."""
    value = value.item() if hasattr(value, "item") else value
    return int(value) if isinstance(value, bool) else value


def _number(column: str, cell: str, integers: Collection[str]) -> int | float | None:
    """The number in a cell, None for an empty one.

    Raises ValueError for text, for infinity and NaN, and for a fraction where the column holds integers.
    """
    if cell == "":
        return None
    try:
        return integer(cell)
    except ValueError:
        if column in integers:
            raise ValueError(f"{column} is {cell[:40]!r}, expected an integer") from None
    try:
        return real(cell)
    except ValueError:
        raise ValueError(f"{column} is {cell[:40]!r}, expected a number") from None


def _plain(value: Any) -> Any:
    """A NumPy scalar or array, or a path, as a JSON value.  Raises TypeError for another object."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} cannot be written to summary.json")


def _no_summary(out: Path) -> OutputError:
    """The error for a folder without summary.json: how far its run is, if it has begun one."""
    frames = out / FRAMES_FILE
    if frames.is_file():
        pairs = len(read_frames(frames))
        return OutputError(f"the run is not finished; {FRAMES_FILE} holds {pairs} pairs", where=str(out))
    message = "holds no run" if out.is_dir() else "does not exist"
    return OutputError(message, where=str(out), hint=f"give the folder in which evaluate wrote {SUMMARY_FILE}")
