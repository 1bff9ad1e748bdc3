"""Stored references: sums over path-traced samples of each frame, which more samples extend.

``<cache>/references/<key>/frame_00012_<view>.npz`` holds the sums of one frame, ``reference.json`` beside it what the
key stands for.  The key is a hash of all that the radiance depends on: the scene's files, the settings of image and
light, and the code that traces paths.  ``view`` is a hash of the frame's camera.  No OpenGL.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import View
from taubench_gl.data_files import code_hash, read_json, stored_arrays
from taubench_gl.errors import OutputError
from taubench_gl.folder_lock import FolderLock
from taubench_gl.outputs import replacing, write_atomically
from taubench_gl.paths import cache_folder
from taubench_gl.settings import Settings
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

SCHEMA = "taubench-gl/path-traced-reference/1"
LOBES = ("direct_diffuse", "direct_glossy", "indirect_diffuse", "indirect_glossy")
HALVES = 2
"""Sample sequences of a reference.  Each has half of the samples; their difference measures the noise."""

IDENTITY = (
    "width", "height", "fps", "culling", "blend", "textures", "animation", "scene", "light_unit", "environment",
    "bounces", "bidirectional", "seed",
)  # fmt: skip
"""Settings that radiance depends on.  The camera is part of every frame's name, exposure multiplies afterwards."""

_CODE = ("frame/passes/pathtracing.py", "frame/passes/gbuffer.py", "frame/passes/deform.py", "frame/raytracing",
         "frame/materials.py", "frame/environment.py", "frame/lights.py", "effects/lighting.py",
         "metrics/path_samples.py", "metrics/environment.py", "metrics/stochastic.py", "srgb.py")  # fmt: skip
_SHADER_FOLDERS = ("common", "gbuffer", "deform", "raytracing", "pathtracing")


@dataclass(slots=True)
class Accumulated:
    """Sums over the samples of one frame, without exposure.

    ``counts`` (2,): samples of each half; ``sums`` (2, 4, h, w, 3) float32: radiance by half and lobe of ``LOBES``.
    """

    counts: Array
    sums: Array

    @classmethod
    def empty(cls, size: tuple[int, int]) -> Accumulated:
        """``size``: width, height."""
        width, height = size
        sums = np.zeros((HALVES, len(LOBES), height, width, 3), dtype=np.float32)
        return cls(np.zeros(HALVES, dtype=np.int64), sums)

    @property
    def samples(self) -> int:
        """Per pixel, both halves together."""
        return int(self.counts.sum())

    def add(self, half: int, count: int, means: Mapping[str, Array]) -> None:
        """Add ``count`` samples, whose ``means`` are (h, w, >= 3) by lobe."""
        for k, lobe in enumerate(LOBES):
            self.sums[half, k] += np.float32(count) * means[lobe][..., :3]
        self.counts[half] += count

    def keep(self, other: Accumulated) -> None:
        """Take each half from ``other`` that has more samples there: the fewer ones are the first of the more."""
        more = other.counts > self.counts
        self.counts[more], self.sums[more] = other.counts[more], other.sums[more]

    def missing(self, samples: int) -> list[tuple[int, int, int]]:
        """(half, first sample, count) to trace until there are ``samples`` in all; the first half has the odd one."""
        wanted = (samples - samples // HALVES, samples // HALVES)
        return [(h, int(n), w - int(n)) for h, (n, w) in enumerate(zip(self.counts, wanted, strict=True)) if n < w]

    def lobes(self) -> dict[str, Array]:
        """Mean radiance by lobe, (h, w, 3) float32."""
        total = self.sums.sum(axis=0, dtype=np.float64) / max(self.samples, 1)
        return dict(zip(LOBES, total.astype(np.float32), strict=True))

    def noise(self) -> Noise | None:
        """Of the mean, from the difference of the two halves; None with fewer than two samples."""
        if self.counts.min() == 0:
            return None
        means = self.sums.sum(axis=1, dtype=np.float64) / self.counts[:, None, None, None]
        luminance = means @ LUMINANCE
        # Pixels without light, such as the background, have no noise and would hide that of the others.
        lit = (luminance > 0).any(axis=0)
        if not lit.any():
            return Noise(0.0, 0.0, 0.0)
        luminance = luminance[:, lit]
        # The mean weights the halves by their counts; its variance is that of the difference times n m / (n + m)^2.
        share = self.counts.prod() / self.samples**2
        difference = np.sqrt(share) * np.abs(luminance[0] - luminance[1])
        mean = float((self.counts / self.samples) @ luminance.mean(axis=1))
        return Noise(float(np.sqrt(np.mean(difference**2))), float(np.median(difference)) / NORMAL_MEDIAN, mean)


NORMAL_MEDIAN = 0.6744897501960817
"""Median of the absolute value of a standard normal number."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard error of luminance over the pixels that have light, without exposure.

    ``rms``: over these pixels, which a few bright samples can dominate; ``typical``: from the median over pixels, for
    normal errors equal to ``rms``; ``mean``: luminance.
    """

    rms: float
    typical: float
    mean: float

    @property
    def percent(self) -> float | None:
        """``rms`` as a share of ``mean``; None for a black image."""
        return 100.0 * self.rms / self.mean if self.mean > 0 else None

    @property
    def typical_percent(self) -> float | None:
        """``typical`` as a share of ``mean``; None for a black image."""
        return 100.0 * self.typical / self.mean if self.mean > 0 else None

    @property
    def text(self) -> str:
        """``3.1 % of the mean luminance (RMS), 0.8 % typically``."""
        if self.percent is None or self.typical_percent is None:
            return "none: the image is black"
        rms, typical = (f"{x:.0f}" if x >= 100.0 else f"{x:.2g}" for x in (self.percent, self.typical_percent))
        return f"{rms} % of the mean luminance (RMS), {typical} % typically"


@cache
def code_version() -> str:
    """Hash of the modules and shaders that trace paths, 16 hexadecimal digits."""
    return code_hash(_CODE, _SHADER_FOLDERS)


def identity(settings: Settings, hashes: Mapping[str, Any]) -> dict[str, Any]:
    """What a reference's radiance depends on besides the camera.  ``hashes``: of ``evaluation.file_hashes``."""
    values = settings.to_dict()
    return {"schema": SCHEMA, "code": code_version(), **hashes, **{name: values[name] for name in IDENTITY}}


def view_hash(view: View, size: tuple[int, int]) -> str:
    """8 hexadecimal digits for pose, projection and sub-pixel offset."""
    parts = (view.position, view.world_from_view, view.clip_from_view(*size))
    return hashlib.sha256(b"".join(np.asarray(p, dtype=np.float64).tobytes() for p in parts)).hexdigest()[:8]


@dataclass(frozen=True, slots=True)
class StoredReference:
    """The folder of one key.  ``root``: of all references; None: nothing is stored."""

    about: Mapping[str, Any]  # of ``identity``
    name: str  # of the scene
    root: Path | None = field(default_factory=lambda: references_folder())

    @property
    def folder(self) -> Path | None:
        """None where nothing is stored: the scene is no file, so nothing identifies its content."""
        if self.root is None or self.about.get("sha256") is None:
            return None
        text = json.dumps(self.about, sort_keys=True)
        return self.root / hashlib.sha256(text.encode()).hexdigest()[:16]

    def load(self, frame: int, view: View, size: tuple[int, int]) -> Accumulated:
        """The sums of ``frame``, empty where none are stored.  Raises OutputError for a damaged file."""
        path = self._path(frame, view, size)
        if path is None or not path.is_file():
            return Accumulated.empty(size)
        with stored_arrays(path, hint="delete it: it is rendered again") as stored:
            loaded = Accumulated(*(stored[name] for name in ("counts", "sums")))
        if loaded.sums.shape != Accumulated.empty(size).sums.shape:
            raise OutputError("is of another size", where=str(path), hint="delete it: it is rendered again")
        return loaded

    def save(self, frame: int, view: View, size: tuple[int, int], sums: Accumulated) -> None:
        """Replace the file of ``frame``, completely or not at all.  Raises OutputError.

        Samples that another process has stored since are kept, in ``sums`` too.
        """
        path = self._path(frame, view, size)
        if path is None or self.folder is None:
            return
        with FolderLock(self.folder, wait=True):
            about = self.folder / "reference.json"
            if not about.is_file():
                text = json.dumps({"name": self.name, **self.about}, indent=2, ensure_ascii=False) + "\n"
                write_atomically(about, text, parents=True)
            sums.keep(self.load(frame, view, size))
            with replacing(path, parents=True, suffix=".npz") as partial:
                np.savez(partial, counts=sums.counts, sums=sums.sums)

    def _path(self, frame: int, view: View, size: tuple[int, int]) -> Path | None:
        return None if self.folder is None else self.folder / f"frame_{frame:05d}_{view_hash(view, size)}.npz"


# ---------------------------------------------------------------------------------------------------- the whole store


def references_folder() -> Path:
    """Folder of all stored references."""
    return cache_folder() / "references"


@dataclass(frozen=True, slots=True)
class Listed:
    """One stored reference: its key, what it is of, frames, samples of the frame with the fewest, bytes on disk."""

    key: str
    about: Mapping[str, Any]
    frames: int
    samples: int
    bytes: int

    @property
    def current(self) -> bool:
        """Whether this version of the code made it."""
        return self.about.get("code") == code_version()


def listed(root: Path | None = None) -> list[Listed]:
    """All stored references, by key."""
    root = references_folder() if root is None else root
    return [_listed(folder) for folder in sorted(root.glob("*")) if (folder / "reference.json").is_file()]


def _listed(folder: Path) -> Listed:
    try:
        about = read_json(folder / "reference.json", dict[str, Any])
    except OutputError:
        about = {}
    files = sorted(folder.glob("frame_*.npz"))
    counts = [n for n in map(_samples_in, files) if n is not None]
    size = sum(path.stat().st_size for path in files)
    return Listed(folder.name, about, len(files), min(counts, default=0), size)


def _samples_in(path: Path) -> int | None:
    try:
        with stored_arrays(path) as stored:
            return int(stored["counts"].sum())
    except OutputError:
        return None


def clear(keys: Iterable[str], root: Path | None = None) -> None:
    """Delete stored references.  Raises OutputError."""
    root = references_folder() if root is None else root
    for key in keys:
        try:
            shutil.rmtree(root / key)
        except OSError as error:
            raise OutputError(f"cannot be deleted: {error.strerror}", where=str(root / key)) from None
