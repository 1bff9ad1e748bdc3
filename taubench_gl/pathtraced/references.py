"""References by the path tracer: frames of a scene at many samples, stored, resumed and extended."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from taubench_gl.animation import View
from taubench_gl.effects.path_tracing import traced_sources
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import file_hashes
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.pathtraced.reference_store import LOBES, Accumulated, Noise, StoredReference, identity
from taubench_gl.settings import Settings

Array = np.ndarray

PART = 16
"""Most samples per pixel that are traced before they are added to the sums."""

SAVE_SECONDS = 60.0
"""Between two saves of a frame that is being traced."""

PATTERN_FRAMES = (1 << 31, (1 << 31) + 1)
"""Frame numbers that the sample patterns of the halves use, in every frame: what stands still is exactly equal from
frame to frame, and no frame of a noisy input has the same numbers."""

MAX_SAMPLES = 1 << 20

FEWEST, MOST = 4, 4096
"""Samples per pixel of references that are fitted to a time."""


class Tracer(Protocol):
    """Traces samples of frames.  ``size``: width, height."""

    size: tuple[int, int]

    def view(self, frame: int) -> View:
        """Of any frame, without drawing it."""

    def trace(self, frame: int, half: int, first: int, count: int) -> dict[str, Array]:
        """Means of samples ``first`` .. ``first + count - 1``: radiance (h, w, 3) by lobe."""


class SceneTracer:
    """Traces samples of a scene's frames, at pixel centers."""

    def __init__(self, owner: GpuOwner, animated: AnimatedScene, settings: Settings):
        """``owner``: frees it; ``settings``: resolved.  Raises SettingsError where nothing lights the scene."""
        settings = reference_settings(settings)
        if not traced_sources(animated.scene, settings):
            raise SettingsError("no light to trace paths to", hint="give an --environment, or a scene with lights")
        self._source = owner.open_source(animated, settings, extra=LOBES)
        self.size, self._fps = self._source.size, settings.sequence.fps
        self._drawn: int | None = None

    def view(self, frame: int) -> View:
        return self._source.renderer.view(frame / self._fps)[1]

    def trace(self, frame: int, half: int, first: int, count: int) -> dict[str, Array]:
        source = self._source
        if frame != self._drawn:
            source.draw(frame)
            self._drawn = frame
        source.trace(PATTERN_FRAMES[half], first, count)
        black = np.zeros((self.size[1], self.size[0], 3), dtype=np.float32)
        return {name: source.read(name)[..., :3] if name in source.channels else black for name in LOBES}


def reference_settings(settings: Settings) -> Settings:
    """``settings`` with which references are traced."""
    return settings.replace(
        light="path-traced", indirect="auto", pattern="independent", spp=PART, columns=("direct", "indirect"),
        samples_per_pixel=1, storage="float", pairs="all", effects="auto", reprojection="camera",
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Reference:
    """One frame of a reference.  ``lobes``: mean radiance without exposure, (h, w, 3) float32, row 0 at the top."""

    frame: int
    lobes: dict[str, Array]
    samples: int
    noise: Noise | None

    @property
    def direct(self) -> Array:
        return self.lobes["direct_diffuse"] + self.lobes["direct_glossy"]

    @property
    def indirect(self) -> Array:
        return self.lobes["indirect_diffuse"] + self.lobes["indirect_glossy"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """What is left to trace before references are complete.  ``seconds``: by one measured part; None: nothing left."""

    frames: int
    complete: int
    samples: int
    seconds: float | None
    limit: float | None = None  # seconds that ``samples`` were fitted to

    @property
    def text(self) -> str:
        """One line."""
        stored = f", {self.complete} stored" if self.complete else ""
        what = f"path-traced references: {self.frames} frames, {self.samples} samples per pixel{stored}"
        if self.seconds is None:
            return what
        what += f", about {duration_text(self.seconds)} to trace"
        if self.limit is None:
            return what
        if self.seconds <= self.limit:
            return f"{what}; as many samples as fit {duration_text(self.limit)} (--reference-time)"
        fewer = "fewer --frames or a smaller --size take less"
        return f"{what}, longer than --reference-time {self.limit:g} for the fewest samples: {fewer}"


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
        """Of a scene with resolved ``settings``; ``owner`` frees what they draw with.  Raises SettingsError.

        ``exact``: frames have ``samples`` and are stored apart, so that no other evaluation adds samples to them.
        """
        about = identity(reference_settings(settings), file_hashes(animated.scene, settings))
        store = StoredReference(about | ({"samples": samples} if exact else {}), animated.scene.name)
        return cls(SceneTracer(owner, animated, settings), store, samples)

    def estimate(self, frames: Iterable[int]) -> Estimate:
        """Time to complete ``frames``, by tracing parts of the first one that needs it, which count."""
        left = {frame: sum(n for *_, n in self._load(frame).missing(self.samples)) for frame in frames}
        complete = sum(n == 0 for n in left.values())
        if complete == len(left):
            return Estimate(len(left), complete, self.samples, None)
        first = next(frame for frame, n in left.items() if n)
        sums, seconds, count = self._load(first), 0.0, 0
        # The first part also compiles shaders and builds the scene's structure, so a second one is timed.
        for half, start, n in [*sums.missing(self.samples)][:2]:
            count = min(n, PART)
            seconds = self._part(sums, first, half, start, count)
            left[first] -= count
        self._save(first, sums)
        return Estimate(len(left), complete, self.samples, seconds / count * sum(left.values()))

    def fit(self, frames: Iterable[int], seconds: float) -> Estimate:
        """Set ``samples`` to the largest power of two for which ``frames`` take at most ``seconds``; FEWEST to MOST.

        The time is that of a part of the first frame, which counts.  If all frames are stored with FEWEST samples or
        more, the fewest of them are used, whatever the time: repeated evaluations have the same reference.
        """
        frames = tuple(frames)
        stored = {frame: self._load(frame).samples for frame in frames}
        if min(stored.values()) >= FEWEST:
            self.samples = min(stored.values())
            return Estimate(len(frames), len(frames), self.samples, None)
        first = min(stored, key=stored.get)
        sums, one = self._load(first), 0.0
        for half, start, n in [*sums.missing(stored[first] + 2 * FEWEST)][:2]:  # the first part also compiles shaders
            one = self._part(sums, first, half, start, n) / n
        self._save(first, sums)
        stored[first] = sums.samples

        def needed(samples: int) -> float:
            return one * sum(max(0, samples - have) for have in stored.values())

        fitting = [
            n for n in (1 << k for k in range(MOST.bit_length())) if FEWEST <= n <= MOST and needed(n) <= seconds
        ]
        self.samples = max(fitting, default=FEWEST)
        complete = sum(have >= self.samples for have in stored.values())
        return Estimate(len(frames), complete, self.samples, needed(self.samples), seconds)

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
        return Reference(frame, sums.lobes(), sums.samples, noise)

    @property
    def worst_noise(self) -> Noise | None:
        """Of the noisiest frame so far."""
        return self._worst

    def _part(self, sums: Accumulated, frame: int, half: int, first: int, count: int) -> float:
        """Trace a part and add it; the seconds it took."""
        started = time.perf_counter()
        sums.add(half, count, self._tracer.trace(frame, half, first, count))
        return time.perf_counter() - started

    def _load(self, frame: int) -> Accumulated:
        held, sums = self._held
        return sums if held == frame else self._store.load(frame, self._tracer.view(frame), self.size)

    def _save(self, frame: int, sums: Accumulated) -> None:
        self._held = frame, sums
        self._store.save(frame, self._tracer.view(frame), self.size, sums)


def duration_text(seconds: float) -> str:
    """``40 s``, ``12 min``, ``3.4 h``."""
    if seconds < 90:
        return f"{max(seconds, 1):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
