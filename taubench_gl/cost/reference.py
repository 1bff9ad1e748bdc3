"""Light that masks are compared with: path-traced at the sampled pixels, as long as time allows, or from renders."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from taubench_gl.cost.pixels import Light, PairChannels, Subject, at_pixel_centers
from taubench_gl.data_files import stored_arrays
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.outputs import write_atomically
from taubench_gl.pathtraced.references import PART
from taubench_gl.pathtraced.series import Render
from taubench_gl.settings import MAX_BOUNCES, Settings

Array = np.ndarray
SUMS_FILE = "reference.npz"
MOST = 64
"""Samples of the largest part that is traced at once; the first has one, and each doubles the one before."""

HALVES = (1 << 31, (1 << 31) + 1)
"""Seeds of the two halves, larger than those of settings: the halves and every path-traced configuration have
independent numbers.  (Parts of one sequence have not: a later part of a Sobol sequence is the first one shifted.)"""


def reference_light(settings: Settings) -> Settings:
    """``settings`` with all light path-traced, up to 12 bounces.

    All pixels and frames have the same numbers: noise that a surface point has in both frames of a pair is no change,
    so masks converge much sooner than with other numbers in each.
    """
    light = {
        "light": "path-traced",
        "indirect": "auto",
        "pattern": "fixed",
        "bounces": MAX_BOUNCES,
        "bidirectional": True,
    }
    return at_pixel_centers(settings).replace(**light, spp=PART, storage="float")


class TracedPixels(GpuOwner):
    """Path-traced light of the pixels that masks depend on, in parts with seeds of their own."""

    def __init__(self, subject: Subject, pairs: PairChannels, settings: Settings, seeds: Sequence[int | None] = HALVES):
        """``settings``: path-traced, at pixel centers.  ``seeds``: of the parts; None: that of the settings."""
        super().__init__(subject.gpu)
        self._lists = pairs.looked_up()
        self._size = settings.sequence.width, settings.sequence.height
        with subject.gpu:
            self._source = self.open_source(subject.animated, settings, pixel_list=True)
        self._sums = {seed: {f: np.zeros((len(at), 6)) for f, at in self._lists.items()} for seed in seeds}
        self._counts = dict.fromkeys(seeds, 0)

    @property
    def samples(self) -> int:
        """Per pixel, all parts."""
        return sum(self._counts.values())

    def trace(self, count: int, check: Callable[[], None] = lambda: None) -> None:
        """Add ``count`` samples to every part.  ``check`` is called before each frame and may raise: then parts that
        are not finished gain nothing."""
        for seed in self._sums:
            self._trace(seed, count, check)

    def _trace(self, seed: int | None, count: int, check: Callable[[], None]) -> None:
        added = {}
        with self.gpu:
            for frame, at in self._lists.items():
                check()
                self._source.draw(frame)
                samples = range(self._counts[seed], self._counts[seed] + count)
                light = self._source.listed_light(frame, at, at, samples, drawn=True, seed=seed).astype(np.float64)
                lobes = light.reshape(len(at), count, 2, 2, 3)  # direct and indirect, diffuse and glossy
                added[frame] = lobes.sum(axis=(1, 3)).reshape(-1, 6)
        for frame, sums in added.items():
            self._sums[seed][frame] += sums
        self._counts[seed] += count

    def light(self, *seeds: int) -> Light:
        """Means over the samples of the parts ``seeds``, all unless given; 0 at all other pixels."""
        parts = seeds or tuple(self._sums)
        count = max(sum(self._counts[s] for s in parts), 1)

        def at(frame: int) -> tuple[Array, Array]:
            columns, rows = self._lists[frame].T
            image = np.zeros((self._size[1], self._size[0], 6))
            image[rows, columns] = sum(self._sums[s][frame] for s in parts) / count
            return image[..., :3], image[..., 3:]

        return at

    def save(self, folder: Path) -> None:
        data = io.BytesIO()
        sums = {f"{seed}_{frame}": a for seed, of in self._sums.items() for frame, a in of.items()}
        np.savez_compressed(data, counts=np.array(list(self._counts.values())), **sums)
        write_atomically(folder / SUMS_FILE, data.getvalue())

    def load(self, folder: Path) -> None:
        """Continue from ``save`` of the same study, if there is any."""
        path = folder / SUMS_FILE
        if not path.is_file():
            return
        with stored_arrays(path, hint="give --fresh to measure from scratch") as stored:
            self._sums = {s: {f: stored[f"{s}_{f}"] for f in of} for s, of in self._sums.items()}
            self._counts = dict(zip(self._sums, stored["counts"].tolist(), strict=True))


def traced_masks(
    subject: Subject, pairs: PairChannels, settings: Settings, check: Callable[[], None] = lambda: None
) -> Array:
    """Mask words of path-traced ``settings`` with their own samples per pixel and pattern: (n,) uint32."""
    with TracedPixels(subject, pairs, at_pixel_centers(settings), seeds=(None,)) as traced:
        traced.trace(settings.lighting.path_samples, check)
        return pairs.masks(traced.light())


def render_light(render: Render, settings: Settings, frames: Sequence[int]) -> Light:
    """Light of path-traced files, for the pairs that end at ``frames``."""
    light: dict[int, tuple[Array, Array]] = {}
    for frame in frames:
        light |= render.light(settings, frame)
    return light.__getitem__
