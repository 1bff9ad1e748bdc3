"""The output folder of an evaluation: reuse.json, frames.csv, tables, plots, side-by-side images, a video, a page."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.checksums import with_checksums
from taubench_gl.data_files import read_bytes
from taubench_gl.errors import SettingsError
from taubench_gl.folder_lock import FolderLock
from taubench_gl.outputs import (
    csv_text,
    output_folder,
    remove_files,
    write_atomically,
    write_png,
)
from taubench_gl.report.page import REPORT_FILE
from taubench_gl.report.reuse import fit_table, reuse_html, reuse_tables
from taubench_gl.report.reuse_frames import ReuseRecorder, reuse_images
from taubench_gl.report.reuse_plots import PLOTS, plot_fit, plot_reuse
from taubench_gl.report.table import TABLE_FILES, write_tables
from taubench_gl.report.video import CODECS, Video
from taubench_gl.reuse.evaluate import EvaluatedFrame, Evaluation
from taubench_gl.reuse.recorded import ResultWriter
from taubench_gl.reuse.scores import CLASSES, ROW_COLUMNS

Array = np.ndarray

GAP = 4
MIN_CELL = 200
"""Width of a cell in pixels below which all are enlarged by an integer factor."""

_BACK = (24, 24, 24)
_CROP_SHARE = 4


def error_colors(error: Array) -> Array:
    """Errors in [0, 1] as colors of matplotlib's magma, as usual for FLIP.  (h, w) -> (h, w, 3) uint8."""
    from matplotlib import colormaps

    return (255.0 * colormaps["magma"](np.clip(error, 0.0, 1.0))[..., :3] + 0.5).astype(np.uint8)


def side_by_side(evaluated: EvaluatedFrame, *, crop: bool = False) -> Array:
    """Columns: input, each method, reference.  Rows: images, error maps and, with ``crop``, an enlarged detail.

    The detail is the window, a quarter of the image wide, where the errors of the methods differ most.
    -> (H, W, 3) uint8.
    """
    from PIL import Image, ImageDraw, ImageFont

    labels = list(evaluated.images)
    images = [evaluated.input, *(evaluated.images[n] for n in labels), evaluated.reference]
    height, width = evaluated.reference.shape[:2]
    scale = max(1, -(-MIN_CELL // width))
    window = detail_window(evaluated) if crop else None
    rows = [[_bytes(p) for p in images]]
    rows.append([None, *(error_colors(evaluated.errors[n]) for n in labels), None])
    if window is not None:
        rows.append([_crop(_bytes(p), window) for p in images])
    cell_w, cell_h = width * scale, height * scale
    font = ImageFont.load_default(size=int(np.clip(cell_w / 20, 11, 22)))
    line = int(1.5 * font.size)
    canvas = Image.new("RGB", (len(images) * (cell_w + GAP) - GAP, 2 * line + len(rows) * (cell_h + GAP) - GAP), _BACK)
    draw = ImageDraw.Draw(canvas)
    draw.text((GAP, line // 5), f"frame {evaluated.frame}", font=font, fill=(180, 180, 180))
    for column, name in enumerate(["input", *labels, "reference"]):
        x = column * (cell_w + GAP)
        draw.text((x + GAP, line + line // 5), fit_text(name, cell_w - 2 * GAP, font), font=font, fill=(255, 255, 255))
        for row, cells in enumerate(rows):
            if cells[column] is not None:
                image = Image.fromarray(cells[column]).resize((cell_w, cell_h), Image.Resampling.NEAREST)
                canvas.paste(image, (x, 2 * line + row * (cell_h + GAP)))
        if window is not None:
            top, left, h, w = (scale * v for v in window)
            y = 2 * line
            draw.rectangle((x + left, y + top, x + left + w - 1, y + top + h - 1), outline=(255, 255, 0))
    for name in labels:  # mean of the error map
        x = (1 + labels.index(name)) * (cell_w + GAP)
        at, text = (x + GAP, 2 * line + cell_h + 2 * GAP), _amount(evaluated, name)
        draw.rectangle(draw.textbbox(at, text, font=font), fill=_BACK, outline=_BACK, width=GAP)
        draw.text(at, text, font=font, fill=(255, 255, 255))
    return np.asarray(canvas)


def detail_window(evaluated: EvaluatedFrame) -> tuple[int, int, int, int]:
    """top, left, height, width of the window with the largest sum of differences between the methods' errors."""
    maps = np.stack(list(evaluated.errors.values()))
    spread = maps.max(axis=0) - (maps.min(axis=0) if len(maps) > 1 else 0.0)
    height, width = spread.shape
    h, w = max(1, height // _CROP_SHARE), max(1, width // _CROP_SHARE)
    table = np.pad(spread, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    sums = table[h:, w:] - table[:-h, w:] - table[h:, :-w] + table[:-h, :-w]
    top, left = np.unravel_index(int(np.argmax(sums)), sums.shape)
    return int(top), int(left), h, w


def fit_text(text: str, width: float, font: Any) -> str:
    """The longest beginning of ``text`` that is at most ``width`` pixels wide in ``font``, with an ellipsis."""
    if font.getlength(text) <= width:
        return text
    while text and font.getlength(text + "…") > width:
        text = text[:-1]
    return text + "…"


def _amount(evaluated: EvaluatedFrame, label: str) -> str:
    row = evaluated.rows[label]
    if row["flip"] is not None:
        return f"FLIP {row['flip']:.3f}"
    return "equal" if row["psnr_db"] is None else f"{row['psnr_db']:.1f} dB"


def _crop(image: Array, window: Sequence[int]) -> Array:
    top, left, h, w = window
    return image[top : top + h, left : left + w]


def _bytes(shown: Array) -> Array:
    return (255.0 * np.clip(np.nan_to_num(shown), 0.0, 1.0) + 0.5).astype(np.uint8)


VIDEOS = (*CODECS, "none")
SAVED = ("results",)
"""Values of ``--save``.  results: linear EXR of input, methods and reference (``recorded.ResultWriter``)."""


SHOWN_FILES = (
    REPORT_FILE, *TABLE_FILES, *(f"{name}.{suffix}" for name in PLOTS for suffix in ("png", "svg")),
    *(f"side_by_side.{suffix}" for suffix in ("png", *CODECS)),
)  # fmt: skip
"""Page, tables, plots, image and video of an evaluation: those of an earlier one would show other frames."""


class ReuseFolder:
    """Records an evaluation while it runs (``on_frame``) and writes the results at the end (``finish``).

    ``side_by_side.png`` shows the worst frame: the one with the largest mean error, except for the first, which has no
    history.  Use as a context manager: incomplete files are removed after an error.  An interrupt (Ctrl-C) writes the
    rows of the evaluated frames to frames.csv, without reuse.json.
    """

    def __init__(
        self, out: str | Path, fps: float, video: str = "mp4", save: Collection[str] = (), report: bool = False
    ):
        """Lock the folder ``out``.  Raises SettingsError for unknown names and a video without its package.

        ``fps``: frames per second of the video; ``save``: names of SAVED; ``report``: also store images of the page.
        """
        if unknown := sorted(set(save) - set(SAVED)):
            raise SettingsError(f"cannot save {unknown[0]!r}", hint=f"choose from {', '.join(SAVED)}")
        if video not in VIDEOS:
            raise SettingsError(f"video is {video!r}", hint=f"choose from {', '.join(VIDEOS)}")
        if video != "none" and find_spec("imageio_ffmpeg") is None:
            hint = "pip install 'taubench-gl[reuse]', or give --video none"
            raise SettingsError("a video needs imageio-ffmpeg", hint=hint)
        self.out = Path(out)
        self._lock = FolderLock(self.out)
        self._video = None if video == "none" else Video(self.out / f"side_by_side.{video}", fps, video)
        self._recorder = ReuseRecorder(self.out, len(CLASSES)) if report else None
        self._results = ResultWriter(self.out) if "results" in save else None
        self._worst, self._worst_image = -1.0, None
        self._rows: list[dict[str, Any]] = []
        self.written_frames = 0  # frames in frames.csv, once it is written
        self._shape: tuple[int, ...] | None = None

    def on_frame(self, evaluated: EvaluatedFrame) -> None:
        """Add one frame; pass this to ``evaluate_methods``."""
        self._rows += (dict(row) for row in evaluated.rows.values())
        if not evaluated.images:
            return
        if self._results is not None:
            self._results.add(evaluated.frame, evaluated.seed, evaluated.exposure, evaluated.radiance)
        if evaluated.repetition:  # the images of the page are those of the first seed
            return
        if self._recorder is not None:
            images = {"input": evaluated.input, **evaluated.images, **evaluated.maps, "reference": evaluated.reference}
            self._recorder.add(evaluated.frame, evaluated.seed, images, evaluated.errors, evaluated.classes)
        if self._video is not None:
            image = side_by_side(evaluated)
            self._shape = self._shape or image.shape
            if image.shape == self._shape:  # the image is narrower after a method has failed
                self._video.add(image)
            else:
                fitted = np.zeros(self._shape, dtype=np.uint8)
                fitted[:, : image.shape[1]] = image
                self._video.add(fitted)
        error = float(np.mean([e.mean() for e in evaluated.errors.values()]))
        first = self._worst_image is None  # without history: any later frame replaces it
        if first or error > self._worst:
            self._worst, self._worst_image = -1.0 if first else error, side_by_side(evaluated, crop=True)

    def finish(self, evaluation: Evaluation) -> list[Path]:
        """Write all files, numbers before images in case the disk fills up.  -> the files.  Raises OutputError."""
        out, evaluation = self.out, replace(evaluation, summary=finite(evaluation.summary))
        files = [out / "frames.csv", out / "reuse.json"]
        write_atomically(files[0], rows_csv(evaluation.rows, ROW_COLUMNS))
        summary = with_checksums(json.loads(as_json(evaluation.summary)), files[0])
        write_atomically(files[1], as_json(summary))
        self.written_frames = len({row["frame"] for row in evaluation.rows})
        self._rows.clear()  # all on disk: an interrupt from here on loses nothing
        remove_files(out, SHOWN_FILES)
        files += write_tables(out, reuse_tables(evaluation.summary))
        if self._video is not None:
            files += [path for path in (self._video.close(),) if path is not None]
        image = None
        if self._worst_image is not None:
            files.append(out / "side_by_side.png")
            write_png(files[-1], self._worst_image)
            image = read_bytes(files[-1])
        files += plot_reuse(evaluation.summary, evaluation.rows, out)
        if self._recorder is not None:
            self._recorder.finish(files[0])
        page = reuse_html(evaluation.summary, evaluation.rows, image, reuse_images(out) if self._recorder else None)
        write_atomically(out / REPORT_FILE, page)
        return [*files, out / REPORT_FILE]

    def __enter__(self) -> ReuseFolder:
        self._lock.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        if self._video is not None:
            self._video.discard()
        if isinstance(error[1], KeyboardInterrupt) and self._rows:
            remove_files(self.out, ("reuse.json", *SHOWN_FILES))  # of an earlier evaluation
            write_atomically(self.out / "frames.csv", rows_csv(self._rows, ROW_COLUMNS))
            self.written_frames = len({row["frame"] for row in self._rows})
        self._lock.__exit__(*error)


def write_fit(out: str | Path, fit: dict[str, Any]) -> list[Path]:
    """Write fit.json, curve.csv, tables and a plot to ``out``.  -> the files.  Raises OutputError."""
    out = Path(out)
    output_folder(out)
    remove_files(out, ("curve.png", "curve.svg"))  # of an earlier search; this one may have too many settings for one
    files = [out / "curve.csv", out / "fit.json"]
    names = list(fit["settings"])
    rows = [p["settings"] | {fit["metric"]: p["value"], "failed": p["failed"]} for p in fit["points"]]
    write_atomically(files[0], rows_csv(rows, (*names, fit["metric"], "failed")))
    write_atomically(files[1], as_json(fit))
    return [*files, *write_tables(out, [fit_table(fit)]), *plot_fit(fit, out / "curve.png")]


def rows_csv(rows: list[dict[str, Any]], columns: tuple[str, ...]) -> str:
    """CSV with full precision; None is an empty cell."""
    return csv_text([columns, *([row[name] for name in columns] for row in rows)])


def finite(summary: dict[str, Any]) -> dict[str, Any]:
    """A copy of ``summary`` with None for every number that is not finite, and their places in ``not_finite``."""
    places = []

    def copied(value: Any, place: str) -> Any:
        if isinstance(value, Mapping):
            return {key: copied(each, f"{place}.{key}" if place else str(key)) for key, each in value.items()}
        if isinstance(value, list | tuple):
            return [copied(each, f"{place}.{index}") for index, each in enumerate(value)]
        if isinstance(value, float) and not math.isfinite(value):
            places.append(place)
            return None
        return value

    out = copied(summary, "")
    return out | {"not_finite": places} if places else out


def as_json(value: dict[str, Any]) -> str:
    return json.dumps(value, indent=2, allow_nan=False) + "\n"
