"""Images of the frame pairs of a run for its page (``frame_store``).

Per recorded pair the folder holds the frame and the reprojected previous frame (WebP) and the reason words (PNG: low
byte in red, high byte in green).  With distances, also their planes (WebP, ``distance_planes``) and ``levels.bin``: the
pixels per code of every pair.
"""

from __future__ import annotations

import io
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from taubench_gl.conventions import NOT_COMPARABLE
from taubench_gl.data_files import read_bytes, read_csv, read_json
from taubench_gl.errors import OutputError
from taubench_gl.metrics.masks import PixelDistances
from taubench_gl.outputs import image_bytes, write_atomically
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
from taubench_gl.report.frame_store import (
    FOLDER,
    UNREADABLE,
    Count,
    ImageIndex,
    ImageRecorder,
    image_size,
    lost_text,
    read_index,
)
from taubench_gl.report.page import data_uri

Array = np.ndarray

LEVELS = "levels.bin"
SCHEMA = "taubench-gl/images/1"
MAX_WIDTH_FULL = 1920
"""Largest width of images with distances: these are to be looked at pixel by pixel."""
_CHECK = 8  # side of a checkerboard cell, pixels
_PLANES = "planes"
_SUFFIX = {"frame": "webp", "previous": "webp", "mask": "png", _PLANES: "webp"}
SHARED_STEPS, SHARED_QUALITY = (0, 1, 2, 3, 4, 6, 8), 60
NO_REPORT = "the run was made without --report"
NO_PLANES = "the run was made without --report-full"


class _Levels(msgspec.Struct):
    """Levels of the distances of one feature, as ``distance_planes.levels_data`` writes them."""

    values: list[float]
    home: Count
    kept: list[list[Count]]
    near: list[Count]


class _Planes(msgspec.Struct):
    """Distances of a run.

    ``names``: planes in packed order; ``steps``: of distance_planes.DETAIL, per frame of the index; ``pairs``: rows of
    LEVELS, in the order of frames.csv; ``levels``: as ``levels_data``.
    """

    names: list[str]
    features: list[str]
    steps: list[Count]
    pairs: Count
    levels: dict[str, _Levels]


class _Index(ImageIndex):
    planes: _Planes | None = None


@dataclass(frozen=True, slots=True)
class StoredPlanes:
    """Distances of a run, as ``_Planes``, with ``steps``: frame -> index of DETAIL.

    ``counts`` (pairs, features, CODES) uint32: comparable pixels per code, of every pair and ``features``.
    """

    names: list[str]
    features: list[str]
    levels: Mapping[str, Any]
    steps: Mapping[int, int]
    counts: Array


@dataclass(frozen=True, slots=True)
class StoredFrames:
    """Images of one run: ``planes`` are the distances, None for the reason ``no_planes``.

    ``lost``: which images are missing or damaged, in words, or empty; the index is without their frames.
    """

    folder: Path
    index: ImageIndex
    planes: StoredPlanes | None = None
    no_planes: str = NO_PLANES
    lost: str = ""

    def small(self, budget: int) -> tuple[list[dict[str, Any]], ImageIndex]:
        """Every frame and its mask as data URIs of at most ``budget`` bytes, and the index for their size.

        The images as they are, else smaller ones of less quality: ``step`` is of the smallest cut that fits, at most
        SHARED_STEPS[-1].  Raises OutputError.
        """
        items: list[dict[str, Any]] = []
        index = self.index
        for step in SHARED_STEPS:
            items = [
                {"n": f, "frame": self._reduced("frame", f, step), "mask": self._reduced("mask", f, step)}
                for f in index.frames
            ]
            if sum(len(item["frame"]) + len(item["mask"]) for item in items) <= budget:
                break
        width, height = (max(side // max(step, 1), 1) for side in (index.width, index.height))
        return items, msgspec.structs.replace(index, width=width, height=height, step=index.step * max(step, 1))

    def _reduced(self, part: str, frame: int, step: int) -> str:
        """An image as a data URI with one of ``step`` rows and columns; 0: as it is stored."""
        from PIL import Image

        if step == 0:
            return self.uri(part, frame)
        with Image.open(io.BytesIO(read_bytes(self.folder / file_name(part, frame)))) as image:
            image.load()
        width, height = (max(side // step * step, 1) for side in image.size)
        whole = image.crop((0, 0, width, height))
        if part == "mask":
            data = image_bytes(np.asarray(whole)[step // 2 :: step, step // 2 :: step], optimize=True)
        else:
            data = image_bytes(np.asarray(whole.reduce(step)), "webp", quality=SHARED_QUALITY, method=4)
        return data_uri(data, _SUFFIX[part])

    def uri(self, part: str, frame: int) -> str:
        """An image as a data URI; ``part`` is frame, previous, mask or planes.  Raises OutputError."""
        return data_uri(read_bytes(self.folder / file_name(part, frame)), _SUFFIX[part])


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


class FrameRecorder(ImageRecorder):
    """Takes every pair in order and keeps the images of some (``KeptFrames``)."""

    schema = SCHEMA

    def __init__(self, out: Path, planes: PlaneRecorder | None = None):
        """``planes``: records the distances too; None for images alone."""
        super().__init__(out, [LEVELS, *(f"{part}_*.{suffix}" for part, suffix in _SUFFIX.items())])
        self._planes = planes

    @property
    def distances(self) -> bool:
        """Whether ``add`` needs distances."""
        return self._planes is not None

    def add(
        self,
        frame: int,
        badness: float,
        image: Array,
        previous: Array,
        mask: Array,
        motion: Array,
        distances: PixelDistances | None = None,
    ) -> None:
        """Record one pair, if it is one to keep.

        ``image``, ``previous`` (h, w, 3) display-referred in [0, 1]; ``mask`` (h, w) reason words; ``motion``
        (h, w, 2) pixels, previous - current, +y down; the kept pairs have that of the largest ``badness``;
        ``distances``: for the plane recorder.  Raises OutputError.
        """
        encoded = None
        if self._planes is not None and distances is not None:
            encoded = self._planes.add(distances, mask)

        def write(number: int) -> None:
            words = self.shrunk(mask, None if self._planes is None else MAX_WIDTH_FULL).astype(np.uint32)
            self.save(file_name("frame", number), image)
            self.save(file_name("previous", number), reproject_image(previous, mask, motion))
            packed = np.stack([words & 255, words >> 8 & 255, words >> 16], axis=-1).astype(np.uint8)
            self.save(file_name("mask", number), packed)
            if self._planes is not None and encoded is not None:
                every = slice(self.step // 2, None, self.step)
                features = {name: codes[every, every] for name, codes in encoded.features.items()}
                stored = EncodedDistances(features, encoded.depth[every, every], encoded.signs[every, every])
                self._planes.write(self.folder / file_name(_PLANES, number), number, stored)

        self.kept_frames.offer(frame, badness, write)

    def finish(self, frames_file: Path) -> list[Path]:
        """Write the index.  ``frames_file``: frames.csv of the run.  -> all files.  Raises OutputError."""
        frames = self.kept_frames.frames
        if not frames:
            return []
        planes = {} if self._planes is None else {"planes": self._planes.finish(self.folder, frames)}
        self.write_index(frames_file, planes)
        parts = [part for part in _SUFFIX if part != _PLANES or planes]
        return [self.folder / "index.json", *(self.folder / file_name(p, f) for p in parts for f in frames)]


def file_name(part: str, frame: int) -> str:
    """Name of a file of the images of a frame: ``frame_00012.webp``."""
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
    index, why = read_index(out, SCHEMA, _Index, NO_REPORT)
    if out is not None and why == UNREADABLE:
        found = _index_of_files(out)
        if not found.frames:
            return None, why
        text = f"{why}: its images are found by their names, and which pair is the worst is not known"
        return StoredFrames(out / FOLDER, found, no_planes=why, lost=text), ""
    if index is None or out is None:
        return None, why
    folder = out / FOLDER
    parts = [part for part in _SUFFIX if part != _PLANES or index.planes is not None]
    lost = index.lost(folder, [file_name(part, frame) for part in parts for frame in index.frames])
    images = [name for name in lost if not name.startswith((_PLANES, LEVELS))]
    whole = index.without(images)
    text = lost_text(images, len(index.frames) - len(whole.frames), "pair")
    if not whole.frames:
        return None, text
    return StoredFrames(folder, whole, *_stored_planes(folder, index, [n for n in lost if n not in images]), text), ""


def _index_of_files(out: Path) -> ImageIndex:
    """An index of the pairs of the run in folder ``out`` all of whose images can be decoded and have one size.

    No frame is the worst one.  Raises OutputError where frames.csv or summary.json cannot be read.
    """
    sizes: dict[int, tuple[int, int]] = {}
    for frame in (int(cells[0]) for line, cells in read_csv(out / "frames.csv") if line > 1):
        found = {image_size(out / FOLDER / file_name(part, frame)) for part in _SUFFIX if part != _PLANES}
        if len(found) == 1 and (size := found.pop()):
            sizes[frame] = size
    (((width, height), _),) = Counter(sizes.values()).most_common(1) or [((1, 1), 0)]
    frames = tuple(frame for frame, size in sizes.items() if size == (width, height))
    settings = read_json(out / "summary.json").get("settings") or {}
    step = max(1, round((settings.get("width") or width) / width))
    return ImageIndex(schema=SCHEMA, rows_sha256="", width=width, height=height, step=step, frames=frames, worst=None)


def _stored_planes(folder: Path, index: _Index, lost: Sequence[str]) -> tuple[StoredPlanes | None, str]:
    """The distances of a run, or None and the reason; ``lost``: their files that are missing or damaged."""
    planes, frames = index.planes, index.frames
    if planes is None:
        return None, NO_PLANES
    if lost:
        return None, lost_text(lost, 0, "")
    shape = planes.pairs, len(planes.features), CODES
    try:
        data = zlib.decompressobj().decompress(read_bytes(folder / LEVELS), 4 * int(np.prod(shape)) + 1)
        counts = np.frombuffer(data, dtype="<u4").reshape(shape)
    except OutputError as error:
        return None, f"{folder.name}/{LEVELS}: {error.what}"
    except (zlib.error, ValueError):
        return None, f"{folder.name}/{LEVELS} is damaged"
    steps = dict(zip(frames, planes.steps, strict=False))
    fits = set(planes.features) == set(planes.levels) and len(steps) == len(frames)
    if not fits or any(step >= len(levels.kept) for levels in planes.levels.values() for step in steps.values()):
        return None, f"{folder.name}/index.json does not fit the distances"
    levels = msgspec.to_builtins(planes.levels)
    return StoredPlanes(planes.names, planes.features, levels, steps, counts), ""
