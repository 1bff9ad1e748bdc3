"""The folder of a reuse evaluation: reuse.json, frames.csv, tables, plots, pictures and a video."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.errors import SettingsError
from taubench_gl.outputs import output_folder, write_atomically, write_png
from taubench_gl.report.render import write_tables
from taubench_gl.report.reuse import fit_table, plot_fit, plot_reuse, reuse_tables
from taubench_gl.reuse.evaluate import Evaluation, JudgedFrame
from taubench_gl.reuse.evaluate_records import ROW_COLUMNS
from taubench_gl.reuse.pictures import CODECS, Video, side_by_side

VIDEOS = (*CODECS, "none")


class ReuseFolder:
    """Collects an evaluation while it runs (``on_frame``) and writes the rest at the end (``finish``).

    A video grows as frames come; ``side_by_side.png`` shows the frame with the largest mean error, of those with
    history: in the first all methods show the same.  Used in a ``with`` block: what is left half-written by an error or
    an interrupt is taken away.  An interrupt (Ctrl-C) keeps the rows of the frames that were judged, in frames.csv
    without a reuse.json beside it.
    """

    def __init__(self, out: str | Path, fps: float, video: str = "mp4"):
        if video not in VIDEOS:
            raise SettingsError(f"video is {video!r}", hint=f"choose from {', '.join(VIDEOS)}")
        if video != "none" and find_spec("imageio_ffmpeg") is None:
            hint = "pip install 'taubench-gl[reuse]', or give --video none"
            raise SettingsError("a video needs imageio-ffmpeg", hint=hint)
        self.out = Path(out)
        self._made = not self.out.exists()
        output_folder(self.out)
        self._video = None if video == "none" else Video(self.out / f"side_by_side.{video}", fps, video)
        self._worst, self._worst_picture = -1.0, None
        self._rows: list[dict[str, Any]] = []
        self.kept = 0  # frames whose rows are in frames.csv, once that is written
        self._shape: tuple[int, ...] | None = None

    def on_frame(self, judged: JudgedFrame) -> None:
        """Look at one frame; give this to ``evaluate_methods``."""
        self._rows += (dict(row) for row in judged.rows.values())
        if not judged.pictures:
            return
        if self._video is not None:
            picture = side_by_side(judged)
            self._shape = self._shape or picture.shape
            if picture.shape == self._shape:  # a method that failed on the way leaves a narrower picture
                self._video.add(picture)
            else:
                fitted = np.zeros(self._shape, dtype=np.uint8)
                fitted[:, : picture.shape[1]] = picture
                self._video.add(fitted)
        error = float(np.mean([e.mean() for e in judged.errors.values()]))
        first = self._worst_picture is None  # no method has history in it: it is kept only until another comes
        if first or error > self._worst:
            self._worst, self._worst_picture = -1.0 if first else error, side_by_side(judged, crop=True)

    def finish(self, evaluation: Evaluation) -> list[Path]:
        """Write everything, numbers first: a full disk costs pictures.  Returns the files.  Raises OutputError."""
        out = self.out
        written = [out / "frames.csv", out / "reuse.json"]
        write_atomically(written[0], rows_csv(evaluation.rows, ROW_COLUMNS))
        write_atomically(written[1], as_json(evaluation.summary))
        self.kept = len({row["frame"] for row in evaluation.rows})
        self._rows.clear()  # they are all on disk: an interrupt from here on takes nothing away
        written += write_tables(out, reuse_tables(evaluation.summary))
        if self._video is not None:
            written += [path for path in (self._video.close(),) if path is not None]
        if self._worst_picture is not None:
            written.append(out / "side_by_side.png")
            write_png(written[-1], self._worst_picture)
        return written + plot_reuse(evaluation.summary, evaluation.rows, out)

    def __enter__(self) -> ReuseFolder:
        return self

    def __exit__(self, *error: Any) -> None:
        if self._video is not None:
            self._video.__exit__(*error)
        if isinstance(error[1], KeyboardInterrupt) and self._rows:
            (self.out / "reuse.json").unlink(missing_ok=True)  # an earlier evaluation's
            write_atomically(self.out / "frames.csv", rows_csv(self._rows, ROW_COLUMNS))
            self.kept = len({row["frame"] for row in self._rows})
        if error[0] is not None and self._made and not any(self.out.iterdir()):
            self.out.rmdir()


def write_fit(out: str | Path, fit: dict[str, Any]) -> list[Path]:
    """fit.json, curve.csv, tables and the curve's plot into ``out``.  Returns the files.  Raises OutputError."""
    out = Path(out)
    output_folder(out)
    written = [out / "curve.csv", out / "fit.json"]
    names = list(fit["settings"])
    rows = [p["settings"] | {fit["metric"]: p["value"], "failed": p["failed"]} for p in fit["points"]]
    write_atomically(written[0], rows_csv(rows, (*names, fit["metric"], "failed")))
    write_atomically(written[1], as_json(fit))
    return [*written, *write_tables(out, [fit_table(fit)]), *plot_fit(fit, out / "curve.png")]


@contextmanager
def new_folder(out: Path | None) -> Iterator[None]:
    """``out`` is there before anything long begins, and gone again if that fails with nothing in it; None: nothing.

    Raises OutputError.
    """
    made = out is not None and not out.exists()
    if out is not None:
        output_folder(out)
    try:
        yield
    except BaseException:
        if made and not any(out.iterdir()):
            out.rmdir()
        raise


def rows_csv(rows: list[dict[str, Any]], columns: tuple[str, ...]) -> str:
    """CSV with all digits; None is an empty cell."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: "" if row[name] is None else row[name] for name in columns} for row in rows)
    return text.getvalue()


def as_json(value: dict[str, Any]) -> str:
    return json.dumps(value, indent=2, allow_nan=False) + "\n"
