"""References by the path tracer: frames of a scene at many samples, stored, resumed and extended.

``<cache>/references/<key>/frame_00012_<view>.npz`` holds the sums over the samples of one frame, ``reference.json``
beside it what the key stands for.  The key is a hash of all that the radiance depends on: the scene's files, the
settings of image and light, and the code that traces paths.  ``view`` is a hash of the frame's camera.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from taubench_gl.animation import View
from taubench_gl.data_files import code_hash, read_json, stored_arrays
from taubench_gl.effects.decide import drawn_materials
from taubench_gl.effects.path_tracing import glass_counts, traced_sources
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.evaluation import file_hashes
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.folder_lock import FolderLock
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.lobes import COMMON_LOBES, lobe_channels, lobes_with
from taubench_gl.outputs import duration_text, replacing, write_atomically
from taubench_gl.paths import cache_folder
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

SCHEMA = "taubench-gl/path-traced-reference/1"
LOBES = lobe_channels(COMMON_LOBES)
"""Channels of the lobes that every reference has; those of the scene's other lobes follow."""

HALVES = 2
"""Sample sequences of a reference.  Each has half of the samples; their difference measures the noise."""

IDENTITY = (
    "width", "height", "fps", "culling", "blend", "textures", "animation", "scene", "light_unit", "environment",
    "bounces", "bidirectional",
)  # fmt: skip
"""Settings that radiance depends on, but for ``seed``: references are the same for every one.  The camera is part of
every frame's name, exposure multiplies afterwards."""

_CODE = ("frame/passes/pathtracing.py", "frame/passes/gbuffer.py", "frame/passes/deform.py", "frame/raytracing",
         "frame/materials.py", "frame/environment.py", "frame/lights.py", "effects/lighting.py",
         "effects/path_tracing.py", "metrics/path_samples.py", "metrics/environment.py", "metrics/stochastic.py",
         "srgb.py")  # fmt: skip
_SHADER_FOLDERS = ("common", "gbuffer", "deform", "raytracing", "pathtracing")

NORMAL_MEDIAN = 0.6744897501960817
"""Median of the absolute value of a standard normal number."""

PART = 16
"""Most samples per pixel that are traced before they are added to the sums."""

SAVE_SECONDS = 60.0
"""Seconds between two saves of a frame that is being traced."""

PATTERN_FRAMES = (1 << 31, (1 << 31) + 1)
"""Frame numbers that the sample patterns of the halves use, in every frame: what stands still is exactly equal from
frame to frame, and no frame of a noisy input has the same numbers."""

MAX_SAMPLES = 1 << 20

FEWEST, MOST = 4, 4096
"""Samples per pixel of references that are fitted to a time."""


@dataclass(slots=True)
class Accumulated:
    """Sums over the samples of one frame, without exposure.

    ``counts`` (2,): samples of each half; ``sums`` (2, k, h, w, 3) float32: radiance by half and lobe; ``names`` (k,):
    of ``LOBES`` or ``reference_lobes``.
    """

    counts: Array
    sums: Array
    names: tuple[str, ...] = LOBES

    @classmethod
    def empty(cls, size: tuple[int, int], names: tuple[str, ...] = LOBES) -> Accumulated:
        """Sums of no samples.  ``size``: width, height; ``names``: of the lobes."""
        width, height = size
        sums = np.zeros((HALVES, len(names), height, width, 3), dtype=np.float32)
        return cls(np.zeros(HALVES, dtype=np.int64), sums, names)

    @property
    def samples(self) -> int:
        """Samples per pixel of both halves together."""
        return int(self.counts.sum())

    def add(self, half: int, count: int, means: Mapping[str, Array]) -> None:
        """Add ``count`` samples, whose ``means`` are (h, w, >= 3) by lobe."""
        for k, lobe in enumerate(self.names):
            self.sums[half, k] += np.float32(count) * means[lobe][..., :3]
        self.counts[half] += count

    def keep(self, other: Accumulated) -> None:
        """Take each half from ``other`` that has more samples there: the fewer ones are the first of the more."""
        further = other.counts > self.counts  # (HALVES,)
        self.counts[further], self.sums[further] = other.counts[further], other.sums[further]

    def missing(self, samples: int) -> list[tuple[int, int, int]]:
        """(half, first sample, count) to trace until there are ``samples`` in all; the first half has the odd one."""
        targets = (samples - samples // HALVES, samples // HALVES)
        halves = enumerate(zip(self.counts.tolist(), targets, strict=True))
        return [(half, count, target - count) for half, (count, target) in halves if count < target]

    def lobes(self) -> dict[str, Array]:
        """Mean radiance by lobe, (h, w, 3) float32."""
        total = self.sums.sum(axis=0, dtype=np.float64) / max(self.samples, 1)
        return dict(zip(self.names, total.astype(np.float32), strict=True))

    def halves(self) -> Array | None:
        """Mean radiance of all lobes by half, (2, h, w, 3) float64, independent of each other; None with fewer than two
        samples."""
        if self.counts.min() == 0:
            return None
        return self.sums.sum(axis=1, dtype=np.float64) / self.counts[:, None, None, None]

    def noise(self) -> Noise | None:
        """Noise of the mean, from the difference of the two halves; None with fewer than two samples."""
        halves = self.halves()
        if halves is None:
            return None
        luminance = halves @ LUMINANCE
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


def reference_lobes(scene: Scene) -> tuple[str, ...]:
    """Channels of the lobes in references of ``scene``."""
    further = lobes_with([name for name, count in glass_counts(drawn_materials(scene)).items() if count])
    return LOBES + lobe_channels([lobe for lobe in further if lobe not in COMMON_LOBES])


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
        """Folder of this reference; None for a scene that is no file, which nothing identifies: nothing is stored."""
        if self.root is None or self.about.get("sha256") is None:
            return None
        text = json.dumps(self.about, sort_keys=True)
        return self.root / hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def lobes(self) -> tuple[str, ...]:
        """Names of the lobes that are stored."""
        return tuple(self.about.get("lobes", LOBES))

    def load(self, frame: int, view: View, size: tuple[int, int]) -> Accumulated:
        """The sums of ``frame``, empty where none are stored.  Raises OutputError for a damaged file."""
        path = self._path(frame, view, size)
        if path is None or not path.is_file():
            return Accumulated.empty(size, self.lobes)
        with stored_arrays(path, hint="delete it: it is rendered again") as stored:
            loaded = Accumulated(stored["counts"], stored["sums"], self.lobes)
        if loaded.sums.shape != Accumulated.empty(size, self.lobes).sums.shape:
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


# ---------------------------------------------------------------------------------------------------------- tracing


class Tracer(Protocol):
    """Traces samples of frames.  ``size``: width, height."""

    size: tuple[int, int]

    def view(self, frame: int) -> View:
        """The camera's view of ``frame``, which is not drawn for it."""

    def trace(self, frame: int, half: int, first: int, count: int) -> dict[str, Array]:
        """Means of samples ``first`` .. ``first + count - 1``: radiance (h, w, 3) by lobe."""


class SceneTracer:
    """Traces samples of a scene's frames, at pixel centers."""

    def __init__(self, owner: GpuOwner, animated: AnimatedScene, settings: Settings):
        """Prepare to trace ``animated`` at resolved ``settings``.  Raises SettingsError for a scene without light."""
        self._owner, self._animated, self._settings = owner, animated, reference_settings(settings)
        if not traced_sources(animated.scene, self._settings):
            raise SettingsError("no light to trace paths to", hint="give an --environment, or a scene with lights")
        self.size = settings.sequence.width, settings.sequence.height
        self._lobes = reference_lobes(animated.scene)
        self._drawn: int | None = None

    @cached_property
    def _source(self) -> RasterSource:
        """Opened for the first sample: the structures of its scene take seconds, and stored frames need none."""
        shading = Shading(every_light=True)
        return self._owner.open_source(self._animated, self._settings, extra=self._lobes, shading=shading)

    def view(self, frame: int) -> View:
        return self._animated.view_at(frame / self._settings.sequence.fps)

    def trace(self, frame: int, half: int, first: int, count: int) -> dict[str, Array]:
        source = self._source
        if frame != self._drawn:
            source.draw(frame)
            self._drawn = frame
        source.trace(PATTERN_FRAMES[half], first, count)
        black = np.zeros((self.size[1], self.size[0], 3), dtype=np.float32)
        return {name: source.read(name)[..., :3] if name in source.channels else black for name in self._lobes}


def path_settings(settings: Settings) -> Settings:
    """``settings`` with which path-traced light of every pixel is stored."""
    return settings.replace(
        light="path-traced", indirect="auto", pattern="independent", spp=PART, columns=("direct", "indirect"),
        samples_per_pixel=1, storage="float", pairs="all", effects="auto", reprojection="camera",
    )  # fmt: skip


def reference_settings(settings: Settings) -> Settings:
    """``settings`` with which references are traced: one seed, the same for inputs of every seed."""
    return path_settings(settings).replace(seed=0)


@dataclass(frozen=True, slots=True)
class Reference:
    """One frame of a reference.  ``lobes``: mean radiance without exposure, (h, w, 3) float32, row 0 at the top;
    ``halves``: of ``Accumulated.halves``."""

    frame: int
    lobes: dict[str, Array]
    samples: int
    noise: Noise | None
    halves: Array | None

    @property
    def direct(self) -> Array:
        return self._sum("direct")

    @property
    def indirect(self) -> Array:
        return self._sum("indirect")

    def _sum(self, bounce: str) -> Array:
        """Radiance of all its lobes, in their order."""
        first, *others = (light for name, light in self.lobes.items() if name.startswith(f"{bounce}_"))
        return sum(others, first)


@dataclass(frozen=True, slots=True)
class Estimate:
    """What is left to trace before references are complete.  ``seconds``: by one measured part; None: nothing left."""

    frames: int
    complete: int
    samples: int
    seconds: float | None
    limit: float | None = None  # seconds that ``samples`` were fitted to
    quiet: bool = False  # more samples would fit, and are not needed

    @property
    def text(self) -> str:
        """What is left to trace, and how long it takes, as one line."""
        stored = f", {self.complete} stored" if self.complete else ""
        line = f"path-traced references: {self.frames} frames, {self.samples} samples per pixel{stored}"
        if self.seconds is None:
            return line
        line += f", about {duration_text(self.seconds)} to trace"
        if self.limit is None:
            return line
        if self.quiet:
            return f"{line}; as many samples as leave no noise to see"
        if self.seconds <= self.limit:
            return f"{line}; as many samples as fit {duration_text(self.limit)} (--reference-time)"
        fewer = "fewer --frames or a smaller --size take less"
        return f"{line}, longer than --reference-time {self.limit:g} for the fewest samples: {fewer}"


class References:
    """References of the frames of one scene at ``samples`` per pixel."""

    def __init__(self, tracer: Tracer, store: StoredReference, samples: int):
        """Raises SettingsError for a number of samples outside 1..MAX_SAMPLES."""
        if not 1 <= samples <= MAX_SAMPLES:
            raise SettingsError(f"reference samples is {samples}", hint=f"give 1 to {MAX_SAMPLES}")
        self._tracer, self._store, self.samples = tracer, store, samples
        self._worst: Noise | None = None
        self._held: tuple[int, Accumulated] = (-1, Accumulated.empty((1, 1)))  # the last frame, also if not stored
        self.size = tracer.size

    @classmethod
    def open(
        cls, owner: GpuOwner, animated: AnimatedScene, settings: Settings, samples: int, *, exact: bool = False
    ) -> References:
        """References of ``animated`` at resolved ``settings``, drawn with what ``owner`` frees.  Raises SettingsError.

        ``exact``: frames have ``samples`` and are stored apart, so that no other evaluation adds samples to them.
        """
        about = identity(reference_settings(settings), file_hashes(animated.scene, settings))
        lobes = reference_lobes(animated.scene)
        about |= {"lobes": list(lobes)} if lobes != LOBES else {}
        store = StoredReference(about | ({"samples": samples} if exact else {}), animated.scene.name)
        return cls(SceneTracer(owner, animated, settings), store, samples)

    def estimate(self, frames: Iterable[int]) -> Estimate:
        """Time to complete ``frames``, by tracing parts of the first one that needs it, which count."""
        left = {frame: self._left(frame) for frame in frames}
        complete = sum(n == 0 for n in left.values())
        if complete == len(left):
            return Estimate(len(left), complete, self.samples, None)
        first = next(frame for frame, n in left.items() if n)
        seconds = self._time_parts(first, self.samples)
        left[first] = self._left(first)
        return Estimate(len(left), complete, self.samples, seconds * sum(left.values()))

    def fit(
        self, frames: Iterable[int], seconds: float, enough: Callable[[Accumulated], float] = lambda sums: math.inf
    ) -> Estimate:
        """Set ``samples`` to the largest power of two for which ``frames`` take at most ``seconds``; FEWEST to MOST.

        The time is that of a part of the first frame, which counts.  ``enough``: samples that suffice, by the sums of
        this part.  If all frames are stored with FEWEST samples or
        more, the fewest of them are used, whatever the time: repeated evaluations have the same reference.
        """
        frames = tuple(frames)
        stored = {frame: self._load(frame).samples for frame in frames}
        if min(stored.values()) >= FEWEST:
            self.samples = min(stored.values())
            return Estimate(len(frames), len(frames), self.samples, None)
        first = min(stored, key=stored.get)
        each = self._time_parts(first, stored[first] + 2 * FEWEST)
        sums = self._load(first)
        stored[first] = sums.samples

        def needed(samples: int) -> float:
            return each * sum(max(0, samples - have) for have in stored.values())

        powers = [1 << k for k in range(MOST.bit_length()) if FEWEST <= 1 << k <= MOST]
        fitting = max((n for n in powers if needed(n) <= seconds), default=FEWEST)
        suffice = enough(sums)
        self.samples = next((n for n in powers if suffice <= n < fitting), fitting)
        complete = sum(have >= self.samples for have in stored.values())
        quiet = self.samples < fitting
        return Estimate(len(frames), complete, self.samples, needed(self.samples), seconds, quiet)

    def frame(self, frame: int) -> Reference:
        """The reference of ``frame``, traced as far as it is not stored.  An interrupt loses at most SAVE_SECONDS."""
        sums = self._load(frame)
        saved, started = sums.samples, time.monotonic()
        try:
            while missing := sums.missing(self.samples):  # fewer after a save, where another process has added some
                half, first, count = missing[0]
                self._part(sums, frame, half, first, min(PART, count))
                if time.monotonic() - started > SAVE_SECONDS:
                    self._save(frame, sums)
                    saved, started = sums.samples, time.monotonic()
        finally:
            if sums.samples != saved:
                self._save(frame, sums)
        noise = sums.noise()
        if noise is not None and (self._worst is None or noise.rms > self._worst.rms):
            self._worst = noise
        return Reference(frame, sums.lobes(), sums.samples, noise, sums.halves())

    @property
    def worst_noise(self) -> Noise | None:
        """Noise of the noisiest frame that was returned so far; None before the first."""
        return self._worst

    def _left(self, frame: int) -> int:
        """Samples to trace until ``frame`` is complete."""
        return sum(count for *_, count in self._load(frame).missing(self.samples))

    def _time_parts(self, frame: int, samples: int) -> float:
        """Trace and store a part of each half of ``frame`` towards ``samples``; the seconds of a sample of the last."""
        sums, seconds = self._load(frame), 0.0
        # The first part also compiles shaders and builds the scene's structure.
        for half, first, count in sums.missing(samples)[:2]:
            count = min(count, PART)
            seconds = self._part(sums, frame, half, first, count) / count
        self._save(frame, sums)
        return seconds

    def _part(self, sums: Accumulated, frame: int, half: int, first: int, count: int) -> float:
        """Trace a part and add it; the seconds it took."""
        started = time.perf_counter()
        sums.add(half, count, self._tracer.trace(frame, half, first, count))
        return time.perf_counter() - started

    def _load(self, frame: int) -> Accumulated:
        held_frame, sums = self._held
        return sums if held_frame == frame else self._store.load(frame, self._tracer.view(frame), self.size)

    def _save(self, frame: int, sums: Accumulated) -> None:
        self._held = frame, sums
        self._store.save(frame, self._tracer.view(frame), self.size, sums)
