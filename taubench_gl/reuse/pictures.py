"""Methods side by side: labelled pictures over their error maps, a crop where they differ most, and a video."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from taubench_gl.errors import OutputError
from taubench_gl.outputs import cannot_write, new_partial
from taubench_gl.reuse.evaluate import JudgedFrame

Array = np.ndarray

GAP = 4
MIN_CELL = 200
"""Cells narrower than this are enlarged by whole pixels."""

_BACK = (24, 24, 24)
_CROP_SHARE = 4
CODECS = {"mp4": ("libx264", ["-crf", "18"]), "webm": ("libvpx-vp9", ["-crf", "24", "-b:v", "0"])}


def error_colors(error: Array) -> Array:
    """An error in [0, 1] in matplotlib's magma, as FLIP is shown.  (h, w) -> (h, w, 3) uint8."""
    from matplotlib import colormaps

    return (255.0 * colormaps["magma"](np.clip(error, 0.0, 1.0))[..., :3] + 0.5).astype(np.uint8)


def side_by_side(judged: JudgedFrame, *, crop: bool = False) -> Array:
    """Columns: input, each method, reference.  Rows: pictures, error maps and, with ``crop``, an enlarged detail.

    The detail is the window, a quarter of the picture wide, in which the methods' errors differ most.
    -> (H, W, 3) uint8.
    """
    from PIL import Image, ImageDraw, ImageFont

    labels = list(judged.pictures)
    pictures = [judged.input, *(judged.pictures[n] for n in labels), judged.reference]
    height, width = judged.reference.shape[:2]
    scale = max(1, -(-MIN_CELL // width))
    window = detail_window(judged) if crop else None
    rows = [[_bytes(p) for p in pictures]]
    rows.append([None, *(error_colors(judged.errors[n]) for n in labels), None])
    if window is not None:
        rows.append([_cut(_bytes(p), window) for p in pictures])
    cell_w, cell_h = width * scale, height * scale
    font = ImageFont.load_default(size=int(np.clip(cell_w / 20, 11, 22)))
    line = int(1.5 * font.size)
    canvas = Image.new(
        "RGB", (len(pictures) * (cell_w + GAP) - GAP, 2 * line + len(rows) * (cell_h + GAP) - GAP), _BACK
    )
    draw = ImageDraw.Draw(canvas)
    draw.text((GAP, line // 5), f"frame {judged.frame}", font=font, fill=(180, 180, 180))
    for column, name in enumerate(["input", *labels, "reference"]):
        x = column * (cell_w + GAP)
        draw.text((x + GAP, line + line // 5), fit(name, cell_w - 2 * GAP, font), font=font, fill=(255, 255, 255))
        for row, cells in enumerate(rows):
            if cells[column] is not None:
                image = Image.fromarray(cells[column]).resize((cell_w, cell_h), Image.Resampling.NEAREST)
                canvas.paste(image, (x, 2 * line + row * (cell_h + GAP)))
        if window is not None:
            top, left, h, w = (scale * v for v in window)
            y = 2 * line
            draw.rectangle((x + left, y + top, x + left + w - 1, y + top + h - 1), outline=(255, 255, 0))
    for name in labels:  # beside the map, what it amounts to
        x = (1 + labels.index(name)) * (cell_w + GAP)
        at, text = (x + GAP, 2 * line + cell_h + 2 * GAP), _amount(judged, name)
        draw.rectangle(draw.textbbox(at, text, font=font), fill=_BACK, outline=_BACK, width=GAP)
        draw.text(at, text, font=font, fill=(255, 255, 255))
    return np.asarray(canvas)


def detail_window(judged: JudgedFrame) -> tuple[int, int, int, int]:
    """top, left, height, width of the window where the methods' errors differ most, summed over it."""
    maps = np.stack(list(judged.errors.values()))
    spread = maps.max(axis=0) - (maps.min(axis=0) if len(maps) > 1 else 0.0)
    height, width = spread.shape
    h, w = max(1, height // _CROP_SHARE), max(1, width // _CROP_SHARE)
    table = np.pad(spread, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    sums = table[h:, w:] - table[:-h, w:] - table[h:, :-w] + table[:-h, :-w]
    top, left = np.unravel_index(int(np.argmax(sums)), sums.shape)
    return int(top), int(left), h, w


def fit(text: str, width: float, font: Any) -> str:
    """``text``, its end left out where it is wider than ``width`` pixels."""
    if font.getlength(text) <= width:
        return text
    while text and font.getlength(text + "…") > width:
        text = text[:-1]
    return text + "…"


class Video:
    """Writes frames of one size as they come; the file appears when it is whole.  ``kind``: mp4 or webm."""

    def __init__(self, path: Path, fps: float, kind: str = "mp4"):
        self.path, self._fps, self._kind = path, fps, kind
        self._partial = new_partial(path, f".{kind}")
        self._writer: Any = None

    def add(self, picture: Array) -> None:
        """(h, w, 3) uint8; an odd side gets a black row or column, as 4:2:0 colour needs.  Raises OutputError."""
        import imageio_ffmpeg

        height, width = picture.shape[:2]
        picture = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)))
        try:
            if self._writer is None:
                codec, more = CODECS[self._kind]
                self._writer = imageio_ffmpeg.write_frames(
                    str(self._partial), picture.shape[1::-1], fps=self._fps, codec=codec, macro_block_size=1,
                    output_params=more, ffmpeg_log_level="error",
                )  # fmt: skip
                self._writer.send(None)
            self._writer.send(np.ascontiguousarray(picture))
        except OSError as error:
            raise OutputError(f"the video cannot be written: {_first_line(error)}", where=str(self.path)) from None

    def close(self) -> Path | None:
        """The file, None if no frame was added.  Raises OutputError."""
        if self._writer is None:
            return None
        self._writer.close()
        self._writer = None
        try:
            os.replace(self._partial, self.path)
        except OSError as error:
            raise cannot_write(self.path, error) from None
        return self.path

    def __enter__(self) -> Video:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._writer is not None:  # not closed: something went wrong before the end
            self._writer.close()
            self._writer = None
        self._partial.unlink(missing_ok=True)


def _amount(judged: JudgedFrame, label: str) -> str:
    row = judged.rows[label]
    if row["flip"] is not None:
        return f"FLIP {row['flip']:.3f}"
    return "equal" if row["psnr_db"] is None else f"{row['psnr_db']:.1f} dB"


def _cut(picture: Array, window: Sequence[int]) -> Array:
    top, left, h, w = window
    return picture[top : top + h, left : left + w]


def _bytes(shown: Array) -> Array:
    return (255.0 * np.clip(np.nan_to_num(shown), 0.0, 1.0) + 0.5).astype(np.uint8)


def _first_line(error: OSError) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
