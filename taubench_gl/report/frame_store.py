"""Images of the frame viewer: few, small and evenly spaced frames of a run, recorded while it goes on, read back later.

A folder ``images`` next to the results holds files of each recorded frame, and ``index.json`` once the run is complete.
``run_frames`` and ``reuse_frames`` say which files.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import msgspec
import numpy as np

from taubench_gl.data_files import hashed, read_bytes, read_json
from taubench_gl.errors import OutputError
from taubench_gl.outputs import cannot_write, folder_in, image_bytes, write_atomically

Array = np.ndarray

FOLDER = "images"
INDEX = "index.json"
UNREADABLE = f"{FOLDER}/{INDEX} cannot be read"
"""Reason of ``read_index`` for an index that is there and damaged."""
MAX_WIDTH = 640
"""Largest width stored.  Wider frames keep every k-th pixel of the mask and the mean of k x k pixels of the frame."""
MAX_KEPT = 120
"""Most frames on disk; beyond it every second one is removed."""
MAX_IMAGE_BYTES = 18_000_000
"""Bytes of base64 text of the images of a page: a phone still opens it."""
QUALITY = 82
_NUMBER = re.compile(r"_(\d{5,})\.")  # of the frame, in the name of its file
_DIGITS = 16  # of a SHA-256

Count = Annotated[int, msgspec.Meta(ge=0)]
Side = Annotated[int, msgspec.Meta(ge=1)]


class ImageIndex(msgspec.Struct, kw_only=True):
    """``frames``: numbers, ascending; ``worst``: the one with the largest error; ``step``: pixels of the frame per
    stored pixel, along each axis; ``rows_sha256``: of the rows that the images belong to; ``files``: name of each image
    file -> first 16 digits of its SHA-256."""

    schema: str
    rows_sha256: str
    width: Side
    height: Side
    step: Side
    frames: tuple[Count, ...]
    worst: int | None
    files: dict[str, str] = {}

    def lost(self, folder: Path, names: Iterable[str] = ()) -> list[str]:
        """Names of ``files`` and ``names`` that ``folder`` does not hold as they were written."""
        every = dict.fromkeys((*self.files, *names))
        return [name for name in every if not _is_whole(folder / name, self.files.get(name))]

    def without(self, lost: Iterable[str]) -> Self:
        """The index of the frames that have none of the files ``lost``."""
        numbers = {int(digits) for name in lost for digits in _NUMBER.findall(name)}
        frames = tuple(frame for frame in self.frames if frame not in numbers)
        return msgspec.structs.replace(self, frames=frames, worst=self.worst if self.worst in frames else None)


class KeptFrames:
    """Which of a series of frames keep their images: every n-th, n doubling as MAX_KEPT demands, and the worst one."""

    def __init__(self, folder: Path, patterns: Sequence[str]):
        """``patterns``: files of one frame, with ``*`` for its number, as ``frame_*.webp``; older ones are removed."""
        self.folder, self._patterns = folder, tuple(patterns)
        self._offered, self._every = 0, 1
        self._index_of: dict[int, int] = {}  # frame -> index
        self._worst: tuple[float, int] | None = None  # badness, frame

    def offer(self, frame: int, badness: float, write: Callable[[int], None]) -> None:
        """Call ``write(frame)`` if it is a frame to keep, and remove those that no longer are.  Raises OutputError."""
        index, self._offered = self._offered, self._offered + 1
        worst = self._worst is None or badness > self._worst[0]
        if index % self._every and not worst:
            return
        former = self.worst
        if worst:
            self._worst = (badness, frame)
        try:
            if not self._index_of:
                self._clear()
            write(frame)
            self._index_of[frame] = index
            if worst and former is not None and self._index_of[former] % self._every:
                self._drop(former)
            while sum(i % self._every == 0 for i in self._index_of.values()) > MAX_KEPT:
                self._every *= 2
                for old in [f for f, i in self._index_of.items() if i % self._every and f != self.worst]:
                    self._drop(old)
        except OSError as error:
            raise cannot_write(self.folder, error) from None

    @property
    def frames(self) -> list[int]:
        """Frame numbers, ascending."""
        return sorted(self._index_of)

    @property
    def worst(self) -> int | None:
        """Number of the worst frame so far; None before the first."""
        return self._worst[1] if self._worst else None

    def sums(self) -> dict[str, str]:
        """``files`` of the index."""
        paths = sorted(path for pattern in self._patterns for path in self.folder.glob(pattern))
        return {path.name: file_sha256(path)[:_DIGITS] for path in paths}

    def _clear(self) -> None:
        """Remove the images of an earlier run; called when the first image is about to be written."""
        folder_in(self.folder.parent, self.folder.name)
        for old in self.folder.iterdir():
            if old.name == INDEX or any(old.match(pattern) for pattern in self._patterns):
                old.unlink()

    def _drop(self, frame: int) -> None:
        del self._index_of[frame]
        for pattern in self._patterns:
            for path in self.folder.glob(pattern.replace("_*", f"_{frame:05d}")):
                path.unlink(missing_ok=True)


class ImageRecorder:
    """Base of what records images: kept frames, their size, and the index."""

    schema = ""

    def __init__(self, out: Path, patterns: Sequence[str]):
        """``patterns``: names of the files of one frame, with ``*`` for its number."""
        self.folder = out / FOLDER
        self.kept_frames = KeptFrames(self.folder, patterns)
        self.size, self.step = (0, 0), 1

    def shrunk(self, values: Array, most: int | None = None) -> Array:
        """Every ``step``-th pixel of (h, w, ...) values, at most ``most`` (MAX_WIDTH) columns; sets size and step."""
        self.step = step = -(-values.shape[1] // (most or MAX_WIDTH))
        small = values[step // 2 :: step, step // 2 :: step]
        self.size = small.shape[1], small.shape[0]
        return small

    def save(self, name: str, pixels: Array) -> None:
        """(h, w) or (h, w, 3): uint8 as it is, floats in [0, 1] as means of ``step`` x ``step`` pixels.

        WebP of QUALITY or PNG, by the suffix of ``name``.  Raises OutputError.
        """
        if pixels.dtype != np.uint8:
            pixels = np.round(255.0 * _downscaled(pixels, self.step, self.size[::-1])).astype(np.uint8)
        form = name.rpartition(".")[2]
        options: dict[str, Any] = {"quality": QUALITY, "method": 4} if form == "webp" else {"optimize": True}
        write_atomically(self.folder / name, image_bytes(pixels, form, **options))

    def write_index(self, frames_file: Path, entries: Mapping[str, Any]) -> None:
        """Write the index.  Raises OutputError.

        ``frames_file``: the rows of the run, to which its hash ties the images; ``entries``: of the index beyond those
        of ``ImageIndex``.
        """
        index = {
            "schema": self.schema, "rows_sha256": file_sha256(frames_file), "width": self.size[0],
            "height": self.size[1], "step": self.step, "frames": self.kept_frames.frames,
            "worst": self.kept_frames.worst, "files": self.kept_frames.sums(), **entries,
        }  # fmt: skip
        write_atomically(self.folder / INDEX, json.dumps(index) + "\n")


def read_index(out: Path | None, schema: str, kind: type, absent: str) -> tuple[Any, str]:
    """The index of the images of results in folder ``out``, of type ``kind``, or None and the reason.

    ``absent``: the reason where no images were recorded.
    """
    if out is None:
        return None, "the results were not written to a folder"
    path = out / FOLDER / INDEX
    if not path.is_file():
        return None, absent
    try:
        index = msgspec.convert(read_json(path, kind), kind)
        if index.schema != schema:
            return None, f"the schema of the images is {index.schema!r}, expected {schema!r}"
        if index.rows_sha256 != file_sha256(out / "frames.csv"):
            return None, "the images in its folder belong to another evaluation"
    except OutputError:
        return None, UNREADABLE
    return index, ""


def image_size(path: Path) -> tuple[int, int] | None:
    """Width and height of an image file; None where it cannot be decoded to its last row."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(read_bytes(path))) as image:
            image.load()
            return image.size
    except (OSError, ValueError, SyntaxError, OutputError):  # Pillow raises SyntaxError for a broken PNG
        return None


def _is_whole(path: Path, digest: str | None) -> bool:
    """Whether a file is there, and is the one with this digest, if one is known."""
    try:
        return path.is_file() and (digest is None or file_sha256(path)[:_DIGITS] == digest)
    except OutputError:
        return False


def lost_text(lost: Sequence[str], frames: int, noun: str) -> str:
    """``2 pairs are left out: images/mask_00002.png is missing or damaged``; without files the text is empty.

    ``frames``: number of frames or pairs, of which ``noun`` is the singular, that have a file of ``lost``.
    """
    if not lost:
        return ""
    names = f"{FOLDER}/{lost[0]}" + (f" and {len(lost) - 1} more are" if len(lost) > 1 else " is")
    left_out = f"{frames} {noun} is left out: " if frames == 1 else f"{frames} {noun}s are left out: "
    return f"{left_out if frames else ''}{names} missing or damaged"


def spread(frames: Sequence[int], most: int, always: int | None) -> list[int]:
    """At most ``most`` of ``frames``, evenly spaced, with the first, the last and ``always`` among them."""
    if len(frames) <= most:
        return list(frames)
    places = np.unique(np.round(np.linspace(0, len(frames) - 1, max(most - (always is not None), 1))).astype(int))
    return sorted({frames[place] for place in places} | ({always} if always is not None else set()))


def within_budget(
    index: ImageIndex, most: int, budget: int, load: Callable[[int], dict[str, Any]]
) -> list[dict[str, Any]]:
    """What ``load`` returns for at most ``most`` of the frames (``spread``), fewer where the texts exceed ``budget``.

    Raises OSError.
    """
    while True:
        frames = spread(index.frames, most, index.worst)
        items = [load(frame) for frame in frames]
        size = sum(map(_text_size, items))
        if size <= budget or most <= 2:
            return items
        most = max(2, min(most - 1, int(len(frames) * budget / size)))


def _text_size(value: Any) -> int:
    if isinstance(value, (dict, list)):
        return sum(map(_text_size, value.values() if isinstance(value, dict) else value))
    return len(value) if isinstance(value, str) else 0


def shown_text(index: ImageIndex, shown: int, count: int, noun: str) -> str:
    """``12 of 60 pairs have images, evenly spaced, at 640×360 pixels``: which frames have images, at what size."""
    text = (
        f"{shown} of {count} {noun} have images, evenly spaced" if shown < count else f"All {count} {noun} have images"
    )
    if shown < count and index.worst is not None:
        text += ", including the worst frame"
    text += f", at {index.width}×{index.height} pixels"
    return text + (f" (one of {index.step} rows and columns)" if index.step > 1 else "")


def _downscaled(image: Array, step: int, shape: tuple[int, int]) -> Array:
    """Means of ``step`` x ``step`` pixels in [0, 1], NaN as black; edge pixels fill the last block.  -> (*shape, 3)."""
    image = np.clip(np.nan_to_num(np.asarray(image, np.float64)[..., :3], nan=0.0), 0.0, 1.0)
    if step == 1:
        return image
    rows, columns = shape
    padding = ((0, max(0, rows * step - image.shape[0])), (0, max(0, columns * step - image.shape[1])), (0, 0))
    image = np.pad(image, padding, mode="edge")[: rows * step, : columns * step]
    return image.reshape(rows, step, columns, step, 3).mean(axis=(1, 3))


def file_sha256(path: Path) -> str:
    """SHA-256 of the bytes of a file, hexadecimal."""
    return hashed(path).hexdigest()
