"""Pictures of frame pairs for a report: kept small, evenly spaced and few while a run goes on, read back afterwards.

A folder ``pictures`` beside summary.json holds, per kept pair, the frame and the previous frame reprojected into it
(WebP) and the reason words (PNG: low byte in red, high byte in green), and ``index.json`` once the run is complete.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import NOT_COMPARABLE
from taubench_gl.outputs import cannot_write, write_atomically

Array = np.ndarray

FOLDER = "pictures"
INDEX = "index.json"
SCHEMA = "taubench-gl/pictures/1"
MAX_WIDTH = 640
"""Widest picture kept; wider frames keep every k-th pixel of the mask and the mean of k x k pixels of the picture."""
MAX_KEPT = 120
"""Pairs kept on disk before every second one is dropped again."""
QUALITY = 82
_CHECK = 8  # side of a checkerboard cell, pixels
_PARTS = {"frame": "webp", "previous": "webp", "mask": "png"}


@dataclass(frozen=True, slots=True)
class StoredPictures:
    """Pictures of one run.  ``frames``: numbers of the later frames, ascending; ``step``: pixels per kept pixel."""

    folder: Path
    width: int
    height: int
    step: int
    frames: tuple[int, ...]
    worst: int | None

    def uri(self, part: str, frame: int) -> str:
        """A picture as a data URI; ``part`` is frame, previous or mask.  Raises OSError."""
        name = file_name(part, frame)
        data = base64.b64encode((self.folder / name).read_bytes()).decode()
        return f"data:image/{_PARTS[part]};base64,{data}"


class PictureKeeper:
    """Told of every pair in order; keeps every n-th, n doubling where that is more than MAX_KEPT, and the worst."""

    def __init__(self, out: Path):
        self._out, self._folder = out, out / FOLDER
        self._seen, self._every = 0, 1
        self._kept: dict[int, int] = {}  # frame -> how-manieth pair
        self._worst: tuple[int, int] | None = None  # discarded pixels, frame
        self._size, self._step = (0, 0), 1

    def add(self, frame: int, discarded: int, picture: Array, previous: Array, mask: Array, motion: Array) -> None:
        """``picture``, ``previous`` (h, w, 3) display-referred in [0, 1]; ``mask`` (h, w) reason words; ``motion``
        (h, w, 2) pixels, previous - current, +y down.  Raises OutputError."""
        place, self._seen = self._seen, self._seen + 1
        worst = self._worst is None or discarded > self._worst[0]
        if place % self._every and not worst:
            return
        before = self._worst[1] if self._worst else None
        if worst:
            self._worst = (discarded, frame)
        try:
            if not self._kept:
                self._clear()
            self._write(frame, picture, reproject_picture(previous, mask, motion), mask)
            self._kept[frame] = place
            if worst and before is not None and self._kept[before] % self._every:
                self._drop(before)
            while sum(p % self._every == 0 for p in self._kept.values()) > MAX_KEPT:
                self._every *= 2
                for old in [f for f, p in self._kept.items() if p % self._every and f != self._worst[1]]:
                    self._drop(old)
        except OSError as error:
            raise cannot_write(self._folder, error) from None

    def finish(self, frames_file: Path) -> None:
        """Say what there is.  ``frames_file``: the run's rows, by which a reader knows whose pictures these are."""
        if not self._kept:
            return
        told = {
            "schema": SCHEMA,
            "width": self._size[0],
            "height": self._size[1],
            "step": self._step,
            "frames": sorted(self._kept),
            "worst": self._worst[1] if self._worst else None,
            "rows_sha256": _sha256(frames_file),
        }
        write_atomically(self._folder / INDEX, json.dumps(told, indent=1) + "\n")

    def _write(self, frame: int, picture: Array, previous: Array, mask: Array) -> None:
        from PIL import Image

        self._step = step = -(-mask.shape[1] // MAX_WIDTH)
        words = mask[step // 2 :: step, step // 2 :: step].astype(np.uint16)
        self._size = (words.shape[1], words.shape[0])
        for part, image in (("frame", picture), ("previous", previous)):
            small = np.round(255.0 * _shrunk(image, step, words.shape)).astype(np.uint8)
            Image.fromarray(small).save(self._folder / file_name(part, frame), quality=QUALITY, method=4)
        packed = np.stack([words & 255, words >> 8, np.zeros_like(words)], axis=-1).astype(np.uint8)
        Image.fromarray(packed).save(self._folder / file_name("mask", frame), optimize=True)

    def _clear(self) -> None:
        """Take away what an earlier run left here; only once there is something to put in its place."""
        self._folder.mkdir(parents=True, exist_ok=True)
        for old in self._folder.iterdir():
            if old.name == INDEX or any(old.match(f"{part}_*.{look}") for part, look in _PARTS.items()):
                old.unlink()

    def _drop(self, frame: int) -> None:
        del self._kept[frame]
        for part in _PARTS:
            (self._folder / file_name(part, frame)).unlink(missing_ok=True)


def file_name(part: str, frame: int) -> str:
    """``frame_00012.webp``."""
    return f"{part}_{frame:05d}.{_PARTS[part]}"


def reproject_picture(previous: Array, mask: Array, motion: Array) -> Array:
    """The previous frame as reprojection brings it into this one; checkerboard where there is no history.

    ``previous`` (h, w, 3), ``mask`` (h, w) reason words, ``motion`` (h, w, 2) px, previous - current, +y down.  Samples
    the pixel at floor(x + 0.5) (docs/conventions.md).  -> (h, w, 3), the dtype of ``previous``.
    """
    height, width = mask.shape
    rows, columns = np.indices(mask.shape)
    with np.errstate(invalid="ignore"):
        x = np.floor(columns + np.nan_to_num(motion[..., 0]) + 0.5).clip(0, width - 1).astype(np.intp)
        y = np.floor(rows + np.nan_to_num(motion[..., 1]) + 0.5).clip(0, height - 1).astype(np.intp)
    moved = previous[y, x].copy()
    cells = max(1, round(_CHECK * max(width, 64) / 640))
    board = np.where((rows // cells + columns // cells) % 2, 0.82, 0.58)[..., None]
    nothing = (mask & np.uint32(int(NOT_COMPARABLE))) != 0
    moved[nothing] = np.broadcast_to(board, moved.shape)[nothing]
    return moved


def stored_pictures(out: Path | None) -> tuple[StoredPictures | None, str]:
    """Pictures of the run in folder ``out``, or None and why there are none, in words."""
    if out is None:
        return None, "the run was not written to a folder"
    path = out / FOLDER / INDEX
    try:
        told: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if told["schema"] != SCHEMA:
            return None, f"the pictures are of schema {told['schema']!r}, expected {SCHEMA!r}"
        if told["rows_sha256"] != _sha256(out / "frames.csv"):
            return None, "the pictures in its folder are of another run"
        frames = tuple(int(f) for f in told["frames"])
        size = int(told["width"]), int(told["height"])
        for frame in frames:
            for part in _PARTS:
                if not (path.parent / file_name(part, frame)).is_file():
                    return None, f"{FOLDER}/{file_name(part, frame)} is missing"
        return StoredPictures(path.parent, *size, int(told["step"]), frames, told["worst"]), ""
    except FileNotFoundError:
        return None, "the run was made without --report"
    except (OSError, ValueError, KeyError, TypeError):
        return None, f"{FOLDER}/{INDEX} cannot be read"


def spread(frames: tuple[int, ...], most: int, always: int | None) -> list[int]:
    """At most ``most`` of ``frames``, evenly spaced, the first and the last among them, and ``always``."""
    if len(frames) > most:
        places = np.unique(np.round(np.linspace(0, len(frames) - 1, max(most - (always is not None), 1))).astype(int))
        chosen = {frames[p] for p in places} | ({always} if always is not None else set())
        return sorted(chosen)
    return list(frames)


def _shrunk(image: Array, step: int, shape: tuple[int, int]) -> Array:
    """Means of ``step`` x ``step`` pixels in [0, 1], NaN as black; edge pixels repeated to fill the last block."""
    image = np.clip(np.nan_to_num(np.asarray(image, np.float64)[..., :3], nan=0.0), 0.0, 1.0)
    if step == 1:
        return image
    rows, columns = shape
    more = ((0, max(0, rows * step - image.shape[0])), (0, max(0, columns * step - image.shape[1])), (0, 0))
    image = np.pad(image, more, mode="edge")[: rows * step, : columns * step]
    return image.reshape(rows, step, columns, step, 3).mean(axis=(1, 3))


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
