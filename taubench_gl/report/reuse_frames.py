"""Images of a reuse evaluation for its page: recorded while it runs, read back afterwards.

The folder ``images`` next to reuse.json holds, per recorded frame, the input, the image of every method, the reference
and the error maps (WebP), and the pixel classes (PNG, the index of the class); and ``index.json`` once the evaluation
is complete.  The mean error of each class is recorded for every frame, from the maps themselves.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from taubench_gl.data_files import read_bytes, read_json
from taubench_gl.errors import OutputError
from taubench_gl.outputs import write_atomically
from taubench_gl.report.frame_store import (
    FOLDER,
    INDEX,
    MAX_IMAGE_BYTES,
    KeptFrames,
    file_sha256,
    image_bytes,
    save_image,
    step_of,
    within_budget,
)
from taubench_gl.report.page import data_uri

Array = np.ndarray

SCHEMA = "taubench-gl/reuse-images/1"
MAX_IMAGES = 48
"""Default number of frames with images on the page."""
NO_IMAGES = "the evaluation was made without --report"

_Count = Annotated[int, msgspec.Meta(ge=0)]


class _Index(msgspec.Struct):
    schema: str
    rows_sha256: str
    width: Annotated[int, msgspec.Meta(ge=1)]
    height: Annotated[int, msgspec.Meta(ge=1)]
    step: Annotated[int, msgspec.Meta(ge=1)]
    names: list[str]
    frames: list[_Count]
    worst: int | None
    every_frame: list[_Count]
    class_pixels: list[list[_Count]]
    class_errors: dict[str, list[list[float | None] | None]]


class ReuseRecorder:
    """Takes every frame of an evaluation in order and keeps the images of some (``KeptFrames``).

    Of several seeds, the first one is recorded.
    """

    def __init__(self, out: Path, classes: int):
        """``classes``: number of pixel classes."""
        self._folder, self._classes = out / FOLDER, classes
        self._kept = KeptFrames(self._folder, ("image*_*.webp", "error*_*.webp", "classes_*.png"))
        self._names: list[str] = []
        self._seed: int | None = None
        self._size, self._step = (0, 0), 1
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
        self._kept.offer(
            frame, mean if len(self._every) > 1 else -1.0, lambda n: self._write(n, images, errors, classes)
        )

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
        self._step = step = step_of(classes.shape[1])
        small = classes[step // 2 :: step, step // 2 :: step].astype(np.uint8)
        self._size = (small.shape[1], small.shape[0])
        for index, name in enumerate(self._names):
            if name in images:
                save_image(self._folder / file_name("image", index, frame), image_bytes(images[name], step))
            if name in errors:
                gray = image_bytes(np.repeat(errors[name][..., None], 3, axis=2), step)
                save_image(self._folder / file_name("error", index, frame), gray)
        save_image(self._folder / file_name("classes", None, frame), np.repeat(small[..., None], 3, axis=2))

    def finish(self, frames_file: Path) -> None:
        """Write the index.  ``frames_file``: frames.csv of the evaluation; its hash ties the images to these rows."""
        if not self._kept.frames:
            return
        index = {
            "schema": SCHEMA,
            "rows_sha256": file_sha256(frames_file),
            "width": self._size[0],
            "height": self._size[1],
            "step": self._step,
            "names": self._names,
            "frames": self._kept.frames,
            "worst": self._kept.worst,
            "every_frame": self._every,
            "class_pixels": self._pixels,
            "class_errors": self._errors,
        }
        write_atomically(self._folder / INDEX, json.dumps(index) + "\n")


def file_name(part: str, index: int | None, frame: int) -> str:
    """``image2_00012.webp``, ``classes_00012.png``."""
    return f"{part}{'' if index is None else index}_{frame:05d}.{'png' if part == 'classes' else 'webp'}"


@dataclass(frozen=True, slots=True)
class ReuseImages:
    """What the page shows: ``data`` for the scripts, None without images; ``text``: what is shown, or why not."""

    data: dict[str, Any] | None
    text: str


def reuse_images(out: Path | None, most: int = MAX_IMAGES, budget: int = MAX_IMAGE_BYTES) -> ReuseImages:
    """Images of at most ``most`` frames and ``budget`` bytes of the evaluation in folder ``out``."""
    if out is None or not (out / FOLDER / INDEX).is_file():
        return ReuseImages(None, NO_IMAGES)
    folder = out / FOLDER
    try:
        index = read_json(folder / INDEX, _Index)
        if index["schema"] != SCHEMA:
            return ReuseImages(None, f"the schema of the images is {index['schema']!r}, expected {SCHEMA!r}")
        if index["rows_sha256"] != file_sha256(out / "frames.csv"):
            return ReuseImages(None, "the images in its folder belong to another evaluation")
    except (OutputError, OSError):
        return ReuseImages(None, f"{FOLDER}/{INDEX} cannot be read")
    names = index["names"]

    def uri(part: str, at: int | None, frame: int) -> str | None:
        path = folder / file_name(part, at, frame)
        return data_uri(read_bytes(path), path.suffix.removeprefix(".")) if path.is_file() else None

    def load(frame: int) -> dict[str, Any]:
        images, errors = ([uri(part, i, frame) for i in range(len(names))] for part in ("image", "error"))
        return {"n": frame, "images": images, "errors": errors, "classes": uri("classes", None, frame)}

    try:
        items = within_budget(tuple(index["frames"]), index["worst"], most, budget, load)
    except OSError as error:
        return ReuseImages(None, f"an image cannot be read: {error.strerror}")
    shared = ("width", "height", "names", "worst", "every_frame", "class_pixels", "class_errors")
    return ReuseImages({name: index[name] for name in shared} | {"items": items}, _text(index, len(items)))


def _text(index: Mapping[str, Any], shown: int) -> str:
    """Which frames have images, and at what size."""
    count = len(index["every_frame"])
    text = (
        f"{shown} of {count} frames have images, evenly spaced" if shown < count else f"All {count} frames have images"
    )
    if shown < count and index["worst"] is not None:
        text += ", with the worst one"
    text += f", at {index['width']}×{index['height']} pixels"
    if index["step"] > 1:
        text += f" (one of {index['step']} rows and columns)"
    return f"{text}; lossy, for the eye. Numbers are from the full frames."
