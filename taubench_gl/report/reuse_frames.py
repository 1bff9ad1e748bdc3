"""Images of a reuse evaluation for its page (``frame_store``).

Per recorded frame the folder holds the input, the image of every method, the reference and the error maps (WebP), and
the pixel classes (PNG, the index of the class).  The index has the mean error of each class for every frame, from the
maps themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.data_files import read_bytes
from taubench_gl.report.frame_store import (
    FOLDER,
    MAX_IMAGE_BYTES,
    Count,
    ImageIndex,
    ImageRecorder,
    read_index,
    shown_text,
    within_budget,
)
from taubench_gl.report.page import data_uri

Array = np.ndarray

SCHEMA = "taubench-gl/reuse-images/1"
MAX_IMAGES = 48
"""Default number of frames with images on the page."""
NO_IMAGES = "the evaluation was made without --report"


class _Index(ImageIndex):
    names: list[str]
    every_frame: list[Count]
    class_pixels: list[list[Count]]
    class_errors: dict[str, list[list[float | None] | None]]


class ReuseRecorder(ImageRecorder):
    """Takes every frame of an evaluation in order and keeps the images of some (``KeptFrames``).

    Of several seeds, the first one is recorded.
    """

    schema = SCHEMA

    def __init__(self, out: Path, classes: int):
        """``classes``: number of pixel classes."""
        super().__init__(out, ("image*_*.webp", "error*_*.webp", "classes_*.png"))
        self._classes = classes
        self._names: list[str] = []
        self._seed: int | None = None
        self._every: list[int] = []
        self._pixels: list[list[int]] = []
        self._errors: dict[str, list[list[float | None] | None]] = {}

    def add(
        self, frame: int, seed: int, images: Mapping[str, Array], errors: Mapping[str, Array], classes: Array
    ) -> None:
        """``images``: name -> (h, w, 3) in [0, 1], the first and last are input and reference; ``errors``: name of a
        method -> (h, w) in [0, 1]; ``classes`` (h, w): index of the class.  Raises OutputError.
        """
        self._seed = seed if self._seed is None else self._seed
        if seed != self._seed:
            return
        self._names = self._names or list(images)
        self._add_classes(frame, errors, classes)
        mean = float(np.mean([e.mean() for e in errors.values()])) if errors else 0.0
        # Without history all methods are equal: the first frame is never the worst one.
        badness = mean if len(self._every) > 1 else -1.0
        self.kept_frames.offer(frame, badness, lambda n: self._write(n, images, errors, classes))

    def _add_classes(self, frame: int, errors: Mapping[str, Array], classes: Array) -> None:
        flat = classes.ravel().astype(np.int64)
        count = np.bincount(flat, minlength=self._classes)
        self._every.append(frame)
        self._pixels.append(count.tolist())
        for name in self._names[1:-1]:
            of_method = self._errors.setdefault(name, [])
            if name not in errors:
                of_method.append(None)
                continue
            total = np.bincount(flat, weights=errors[name].ravel().astype(np.float64), minlength=self._classes)
            of_method.append([float(f"{t / n:.6g}") if n else None for t, n in zip(total, count, strict=True)])

    def _write(self, frame: int, images: Mapping[str, Array], errors: Mapping[str, Array], classes: Array) -> None:
        small = self.shrunk(classes).astype(np.uint8)
        for index, name in enumerate(self._names):
            if name in images:
                self.save(file_name("image", index, frame), images[name])
            if name in errors:
                self.save(file_name("error", index, frame), np.repeat(errors[name][..., None], 3, axis=2))
        self.save(file_name("classes", None, frame), np.repeat(small[..., None], 3, axis=2))

    def finish(self, frames_file: Path) -> None:
        """Write the index.  ``frames_file``: frames.csv of the evaluation."""
        if self.kept_frames.frames:
            classes = {"class_pixels": self._pixels, "class_errors": self._errors}
            self.write_index(frames_file, {"names": self._names, "every_frame": self._every, **classes})


def file_name(part: str, index: int | None, frame: int) -> str:
    """Name of a file of the images of a frame: ``image2_00012.webp``, ``classes_00012.png``."""
    return f"{part}{'' if index is None else index}_{frame:05d}.{'png' if part == 'classes' else 'webp'}"


@dataclass(frozen=True, slots=True)
class ReuseImages:
    """What the page shows: ``data`` for the scripts, None without images; ``text``: what is shown, or why not."""

    data: dict[str, Any] | None
    text: str


def reuse_images(out: Path | None, most: int = MAX_IMAGES, budget: int = MAX_IMAGE_BYTES) -> ReuseImages:
    """Images of at most ``most`` frames and ``budget`` bytes of the evaluation in folder ``out``."""
    index, why = read_index(out, SCHEMA, _Index, NO_IMAGES)
    if index is None or out is None:
        return ReuseImages(None, NO_IMAGES if out is None else why)
    folder, names = out / FOLDER, index.names

    def uri(part: str, at: int | None, frame: int) -> str | None:
        path = folder / file_name(part, at, frame)
        return data_uri(read_bytes(path), path.suffix.removeprefix(".")) if path.is_file() else None

    def load(frame: int) -> dict[str, Any]:
        images, errors = ([uri(part, i, frame) for i in range(len(names))] for part in ("image", "error"))
        return {"n": frame, "images": images, "errors": errors, "classes": uri("classes", None, frame)}

    try:
        items = within_budget(index, most, budget, load)
    except OSError as error:
        return ReuseImages(None, f"an image cannot be read: {error.strerror}")
    shared = ("width", "height", "names", "worst", "every_frame", "class_pixels", "class_errors")
    text = shown_text(index, len(items), len(index.every_frame), "frames")
    data = {name: getattr(index, name) for name in shared} | {"items": items}
    return ReuseImages(data, f"{text}; lossy, for the eye. Numbers are from the full frames.")
