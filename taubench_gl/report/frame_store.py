"""Images of frame pairs for a report: few, small and evenly spaced; recorded during a run, read back afterwards.

The folder ``images`` next to summary.json holds, per recorded pair, the frame and the reprojected previous frame (WebP)
and the reason words (PNG: low byte in red, high byte in green), and ``index.json`` once the run is complete.  With
distances, also their planes (WebP, ``distance_planes``) and ``levels.bin``: the pixels per code of every pair.
"""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from taubench_gl.conventions import NOT_COMPARABLE
from taubench_gl.data_files import hashed, read_bytes, read_json
from taubench_gl.errors import OutputError
from taubench_gl.metrics.masks import PixelDistances
from taubench_gl.outputs import cannot_write, folder_in, write_atomically
from taubench_gl.report.distance_planes import (
    CODES,
    EncodedDistances,
    Levels,
    compressed,
    encode,
    histogram,
    levels_data,
    levels_of,
)
from taubench_gl.report.page import data_uri

Array = np.ndarray

FOLDER = "images"
INDEX = "index.json"
LEVELS = "levels.bin"
SCHEMA = "taubench-gl/images/1"
MAX_WIDTH = 640
"""Largest width stored.  Wider frames keep every k-th pixel of the mask and the mean of k x k pixels of the frame."""
MAX_WIDTH_FULL = 1920
"""MAX_WIDTH of images with distances: these are to be looked at pixel by pixel."""
MAX_KEPT = 120
"""Most pairs on disk; beyond it every second one is removed."""
MAX_IMAGE_BYTES = 18_000_000
"""Bytes of base64 text of the images of a page: a phone still opens it."""
QUALITY = 82
_CHECK = 8  # side of a checkerboard cell, pixels
_PARTS = {"frame": "webp", "previous": "webp", "mask": "png"}
_PLANES = "planes"
_SUFFIX = {**_PARTS, _PLANES: "webp"}
NO_PLANES = "the run was made without --report-full"


_Count = Annotated[int, msgspec.Meta(ge=0)]


class _Levels(msgspec.Struct):
    """``levels_data`` of one feature."""

    values: list[float]
    home: _Count
    kept: list[list[_Count]]
    near: list[_Count]


class _Planes(msgspec.Struct):
    """``names``: planes in packed order; ``steps``: of distance_planes.DETAIL, per frame of the index; ``pairs``: rows
    of LEVELS, in the order of frames.csv; ``levels``: as ``levels_data``."""

    names: list[str]
    features: list[str]
    steps: list[_Count]
    pairs: _Count
    levels: dict[str, _Levels]


class _Index(msgspec.Struct):
    schema: str
    rows_sha256: str
    width: Annotated[int, msgspec.Meta(ge=1)]
    height: Annotated[int, msgspec.Meta(ge=1)]
    step: Annotated[int, msgspec.Meta(ge=1)]
    frames: list[_Count]
    worst: int | None
    planes: _Planes | None = None


@dataclass(frozen=True, slots=True)
class StoredPlanes:
    """Distances of a run (``distance_planes``).

    ``names``: planes in packed order; ``levels``: feature -> ``levels_data``; ``steps``: frame -> index of DETAIL;
    ``counts`` (pairs, features, CODES) uint32: comparable pixels per code, of every pair and ``features``.
    """

    names: tuple[str, ...]
    features: tuple[str, ...]
    levels: Mapping[str, Any]
    steps: Mapping[int, int]
    counts: Array


@dataclass(frozen=True, slots=True)
class StoredFrames:
    """Images of one run.

    ``frames``: numbers of the later frames, ascending; ``worst``: the one with the most discarded pixels; ``step``:
    pixels of the frame per stored pixel, along each axis; ``planes``: the distances, None for the reason ``no_planes``.
    """

    folder: Path
    width: int
    height: int
    step: int
    frames: tuple[int, ...]
    worst: int | None
    planes: StoredPlanes | None = None
    no_planes: str = NO_PLANES

    def uri(self, part: str, frame: int) -> str:
        """An image as a data URI; ``part`` is frame, previous, mask or planes.  Raises OutputError."""
        return data_uri(read_bytes(self.folder / file_name(part, frame)), _SUFFIX[part])


class KeptFrames:
    """Which of a series of frames keep their images: every n-th, n doubling as MAX_KEPT demands, and the worst one."""

    def __init__(self, folder: Path, patterns: Sequence[str]):
        """``patterns``: files of one frame, with ``*`` for its number, as ``frame_*.webp``; older ones are removed."""
        self.folder, self._patterns = folder, tuple(patterns)
        self._seen, self._every = 0, 1
        self._kept: dict[int, int] = {}  # frame -> index
        self._worst: tuple[float, int] | None = None  # badness, frame

    def offer(self, frame: int, badness: float, write: Callable[[int], None]) -> None:
        """Call ``write(frame)`` if it is a frame to keep, and remove those that no longer are.  Raises OutputError."""
        index, self._seen = self._seen, self._seen + 1
        worst = self._worst is None or badness > self._worst[0]
        if index % self._every and not worst:
            return
        former = self._worst[1] if self._worst else None
        if worst:
            self._worst = (badness, frame)
        try:
            if not self._kept:
                self._clear()
            write(frame)
            self._kept[frame] = index
            if worst and former is not None and self._kept[former] % self._every:
                self._drop(former)
            while sum(i % self._every == 0 for i in self._kept.values()) > MAX_KEPT:
                self._every *= 2
                for old in [f for f, i in self._kept.items() if i % self._every and f != self._worst[1]]:
                    self._drop(old)
        except OSError as error:
            raise cannot_write(self.folder, error) from None

    @property
    def frames(self) -> list[int]:
        """Frame numbers, ascending."""
        return sorted(self._kept)

    @property
    def worst(self) -> int | None:
        return self._worst[1] if self._worst else None

    def _clear(self) -> None:
        """Remove the images of an earlier run; called when the first image is about to be written."""
        folder_in(self.folder.parent, self.folder.name)
        for old in self.folder.iterdir():
            if old.name in (INDEX, LEVELS) or any(old.match(pattern) for pattern in self._patterns):
                old.unlink()

    def _drop(self, frame: int) -> None:
        del self._kept[frame]
        for pattern in self._patterns:
            for path in self.folder.glob(pattern.replace("_*", f"_{frame:05d}")):
                path.unlink(missing_ok=True)


class PlaneRecorder:
    """Encodes the distances of every pair, writes the planes of some and counts the codes of all."""

    def __init__(self, thresholds: Mapping[str, float], units: Mapping[str, float]):
        """``thresholds``: feature -> a_B in the unit of its distances; ``units``: as for ``levels_data``."""
        self._levels: dict[str, Levels] = {name: levels_of(value) for name, value in thresholds.items()}
        self._units = units
        self._counts: list[Array] = []
        self._features: tuple[str, ...] = ()
        self._steps: dict[int, int] = {}
        self._step = 0

    def add(self, distances: PixelDistances, mask: Array) -> EncodedDistances:
        """Count one pair.  ``mask`` (h, w) reason words."""
        encoded = encode(distances, self._levels)
        self._features = tuple(encoded.features)
        self._counts.append(histogram(encoded, (mask & np.uint32(int(NOT_COMPARABLE))) == 0))
        return encoded

    def write(self, path: Path, frame: int, encoded: EncodedDistances) -> None:
        """Write the planes of ``frame``.  Raises OutputError."""
        data, self._step = compressed(encoded, self._levels, self._step)
        self._steps[frame] = self._step
        write_atomically(path, data)

    def finish(self, folder: Path, frames: Sequence[int]) -> dict[str, Any]:
        """Write LEVELS; the block ``planes`` of the index, whose ``frames`` these are.  Raises OutputError."""
        write_atomically(folder / LEVELS, zlib.compress(np.array(self._counts, "<u4").tobytes(), 9))
        return {
            "names": [*self._features, "depth", "signs"],
            "features": list(self._features),
            "steps": [self._steps[frame] for frame in frames],
            "pairs": len(self._counts),
            "levels": levels_data({name: self._levels[name] for name in self._features}, self._units),
        }


class FrameRecorder:
    """Takes every pair in order and keeps the images of some (``KeptFrames``)."""

    def __init__(self, out: Path, planes: PlaneRecorder | None = None):
        """``planes``: to record the distances too."""
        self._out, self._folder, self._planes = out, out / FOLDER, planes
        self._kept = KeptFrames(self._folder, [f"{part}_*.{suffix}" for part, suffix in _SUFFIX.items()])
        self._size, self._step = (0, 0), 1

    @property
    def distances(self) -> bool:
        """Whether ``add`` needs distances."""
        return self._planes is not None

    def add(
        self,
        frame: int,
        discarded: int,
        image: Array,
        previous: Array,
        mask: Array,
        motion: Array,
        distances: PixelDistances | None = None,
    ) -> None:
        """Record one pair, if it is one to keep.

        ``image``, ``previous`` (h, w, 3) display-referred in [0, 1]; ``mask`` (h, w) reason words; ``motion``
        (h, w, 2) pixels, previous - current, +y down; ``discarded``: number of discarded pixels; ``distances``: for
        the plane recorder.  Raises OutputError.
        """
        encoded = None
        if self._planes is not None and distances is not None:
            encoded = self._planes.add(distances, mask)

        def write(number: int) -> None:
            self._write(number, image, reproject_image(previous, mask, motion), mask)
            if self._planes is not None and encoded is not None:
                every = slice(self._step // 2, None, self._step)
                stored = EncodedDistances(
                    {name: codes[every, every] for name, codes in encoded.features.items()},
                    encoded.depth[every, every],
                    encoded.signs[every, every],
                )
                self._planes.write(self._folder / file_name(_PLANES, number), number, stored)

        self._kept.offer(frame, discarded, write)

    def finish(self, frames_file: Path) -> list[Path]:
        """Write the index.  ``frames_file``: frames.csv of the run; its hash ties the images to these rows.

        -> index and images.
        """
        if not self._kept.frames:
            return []
        index = {
            "schema": SCHEMA,
            "width": self._size[0],
            "height": self._size[1],
            "step": self._step,
            "frames": self._kept.frames,
            "worst": self._kept.worst,
            "rows_sha256": file_sha256(frames_file),
        }
        if self._planes is not None:
            index["planes"] = self._planes.finish(self._folder, self._kept.frames)
        write_atomically(self._folder / INDEX, json.dumps(index, indent=1) + "\n")
        parts = _PARTS if self._planes is None else (*_PARTS, _PLANES)
        return [self._folder / INDEX, *(self._folder / file_name(p, f) for p in parts for f in self._kept.frames)]

    def _write(self, frame: int, image: Array, previous: Array, mask: Array) -> None:
        self._step = step = step_of(mask.shape[1], MAX_WIDTH if self._planes is None else MAX_WIDTH_FULL)
        words = mask[step // 2 :: step, step // 2 :: step].astype(np.uint32)
        self._size = (words.shape[1], words.shape[0])
        for part, pixels in (("frame", image), ("previous", previous)):
            save_image(self._folder / file_name(part, frame), image_bytes(pixels, step))
        packed = np.stack([words & 255, words >> 8 & 255, words >> 16], axis=-1).astype(np.uint8)
        save_image(self._folder / file_name("mask", frame), packed)


def save_image(path: Path, pixels: Array) -> None:
    """(h, w) or (h, w, 3) uint8 as WebP of QUALITY or as PNG, by the suffix of ``path``.  Raises OutputError."""
    from PIL import Image

    data = io.BytesIO()
    options: dict[str, Any] = {"quality": QUALITY, "method": 4} if path.suffix == ".webp" else {"optimize": True}
    Image.fromarray(pixels).save(data, format=path.suffix.removeprefix(".").upper(), **options)
    write_atomically(path, data.getvalue())


def step_of(width: int, most: int | None = None) -> int:
    """Pixels of a frame per stored pixel, along each axis, for at most ``most`` (MAX_WIDTH) stored columns."""
    return -(-width // (MAX_WIDTH if most is None else most))


def image_bytes(pixels: Array, step: int) -> Array:
    """(h, w, 3) in [0, 1] -> uint8 means of ``step`` x ``step`` pixels, as large as ``[step // 2 :: step]`` of it."""
    shape = tuple(len(range(step // 2, n, step)) for n in pixels.shape[:2])
    return np.round(255.0 * _downscaled(pixels, step, shape)).astype(np.uint8)


def file_name(part: str, frame: int) -> str:
    """``frame_00012.webp``."""
    return f"{part}_{frame:05d}.{_SUFFIX[part]}"


def reproject_image(previous: Array, mask: Array, motion: Array) -> Array:
    """The previous frame reprojected into the current one; a checkerboard where there is no history.

    ``previous`` (h, w, 3), ``mask`` (h, w) reason words, ``motion`` (h, w, 2) px, previous - current, +y down.  Samples
    the pixel at floor(x + 0.5) (docs/conventions.md).  -> (h, w, 3), the dtype of ``previous``.
    """
    height, width = mask.shape
    rows, columns = np.indices(mask.shape)
    with np.errstate(invalid="ignore"):
        x = np.floor(columns + np.nan_to_num(motion[..., 0]) + 0.5).clip(0, width - 1).astype(np.intp)
        y = np.floor(rows + np.nan_to_num(motion[..., 1]) + 0.5).clip(0, height - 1).astype(np.intp)
    history = previous[y, x].copy()
    cells = max(1, round(_CHECK * max(width, 64) / 640))
    board = np.where((rows // cells + columns // cells) % 2, 0.82, 0.58)[..., None]
    nothing = (mask & np.uint32(int(NOT_COMPARABLE))) != 0
    history[nothing] = np.broadcast_to(board, history.shape)[nothing]
    return history


def stored_frames(out: Path | None) -> tuple[StoredFrames | None, str]:
    """Images of the run in folder ``out``, or None and the reason why there are none."""
    if out is None:
        return None, "the run was not written to a folder"
    path = out / FOLDER / INDEX
    if not path.exists():
        return None, "the run was made without --report"
    try:
        index: Mapping[str, Any] = read_json(path, _Index)
        if index["schema"] != SCHEMA:
            return None, f"the schema of the images is {index['schema']!r}, expected {SCHEMA!r}"
        if index["rows_sha256"] != file_sha256(out / "frames.csv"):
            return None, "the images in its folder belong to another run"
        frames = tuple(int(f) for f in index["frames"])
        size = int(index["width"]), int(index["height"])
        for frame in frames:
            for part in _PARTS:
                if not (path.parent / file_name(part, frame)).is_file():
                    return None, f"{FOLDER}/{file_name(part, frame)} is missing"
        planes, no_planes = _stored_planes(path.parent, frames, index.get("planes"))
        return StoredFrames(path.parent, *size, int(index["step"]), frames, index["worst"], planes, no_planes), ""
    except (OutputError, OSError, KeyError):
        return None, f"{FOLDER}/{INDEX} cannot be read"


def _stored_planes(
    folder: Path, frames: tuple[int, ...], block: Mapping[str, Any] | None
) -> tuple[StoredPlanes | None, str]:
    """The distances of a run from the block ``planes`` of its index, or None and the reason."""
    if block is None:
        return None, NO_PLANES
    for frame in frames:
        if not (folder / file_name(_PLANES, frame)).is_file():
            return None, f"{folder.name}/{file_name(_PLANES, frame)} is missing"
    shape = block["pairs"], len(block["features"]), CODES
    try:
        data = zlib.decompressobj().decompress(read_bytes(folder / LEVELS), 4 * int(np.prod(shape)) + 1)
        counts = np.frombuffer(data, dtype="<u4").reshape(shape)
    except OutputError as error:
        return None, f"{folder.name}/{LEVELS}: {error.what}"
    except (zlib.error, ValueError):
        return None, f"{folder.name}/{LEVELS} is damaged"
    steps = dict(zip(frames, block["steps"], strict=False))
    if set(block["features"]) != set(block["levels"]):
        return None, f"{folder.name}/{INDEX} does not fit the distances"
    known = all(0 <= step < len(block["levels"][name]["kept"]) for name in block["features"] for step in steps.values())
    if len(steps) != len(frames) or not known:
        return None, f"{folder.name}/{INDEX} does not fit the distances"
    return StoredPlanes(tuple(block["names"]), tuple(block["features"]), block["levels"], steps, counts), ""


def spread(frames: tuple[int, ...], most: int, always: int | None) -> list[int]:
    """At most ``most`` of ``frames``, evenly spaced, with the first, the last and ``always`` among them."""
    if len(frames) > most:
        places = np.unique(np.round(np.linspace(0, len(frames) - 1, max(most - (always is not None), 1))).astype(int))
        chosen = {frames[p] for p in places} | ({always} if always is not None else set())
        return sorted(chosen)
    return list(frames)


def within_budget(
    frames: tuple[int, ...], worst: int | None, most: int, budget: int, load: Callable[[int], dict[str, Any]]
) -> list[dict[str, Any]]:
    """What ``load`` returns for at most ``most`` of ``frames`` (``spread``), fewer where the texts exceed ``budget``.

    Raises OSError.
    """
    while True:
        chosen = spread(frames, most, worst)
        items = [load(frame) for frame in chosen]
        size = sum(_text_size(item) for item in items)
        if size <= budget or most <= 2:
            return items
        most = max(2, min(most - 1, int(len(chosen) * budget / size)))


def _text_size(value: Any) -> int:
    if isinstance(value, (dict, list)):
        return sum(map(_text_size, value.values() if isinstance(value, dict) else value))
    return len(value) if isinstance(value, str) else 0


def _downscaled(image: Array, step: int, shape: tuple[int, int]) -> Array:
    """Means of ``step`` x ``step`` pixels in [0, 1], NaN as black; edge pixels fill the last block.  -> (*shape, 3)."""
    image = np.clip(np.nan_to_num(np.asarray(image, np.float64)[..., :3], nan=0.0), 0.0, 1.0)
    if step == 1:
        return image
    rows, columns = shape
    more = ((0, max(0, rows * step - image.shape[0])), (0, max(0, columns * step - image.shape[1])), (0, 0))
    image = np.pad(image, more, mode="edge")[: rows * step, : columns * step]
    return image.reshape(rows, step, columns, step, 3).mean(axis=(1, 3))


def file_sha256(path: Path) -> str:
    """Of the bytes of a file."""
    return hashed(path).hexdigest()
