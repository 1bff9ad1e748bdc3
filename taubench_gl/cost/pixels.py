"""Masks at a random set of pixels: those of a configuration, and in float64 those of any light.

Errors of columns cancel: a pixel that is discarded wrongly makes up for one that is kept wrongly.  Here each pixel is
compared.  The pixels are drawn at random from whole frames, so a share of them is an unbiased share of the frames.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import CameraTrack
from taubench_gl.animation.pairs import reprojection
from taubench_gl.effects.decide import decide
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.features import COLUMN_BITS, FEATURES, LIGHT_FEATURES, WORD_DTYPE
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics.color import display_color
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.metrics.reprojection import Reprojection, reproject
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray
Light = Callable[[int], tuple[Array, Array]]
"""Frame -> direct and indirect radiance, (h, w, 3) each; only the pixels that are looked up need to be right."""

PAIRS, PIXELS, SEED = 4, 4096, 20
"""Pairs of frames, pixels of all pairs together, and the seed that draws them."""


@dataclass(frozen=True, slots=True)
class PixelSample:
    """``frames``: the later frame of each pair; ``at``: its pixels, (n, 2) column and row from the top."""

    frames: tuple[int, ...]
    at: tuple[Array, ...]

    def __len__(self) -> int:
        return sum(map(len, self.at))


def draw_pixels(frames: range, size: tuple[int, int]) -> PixelSample:
    """The pixels of a study: the same for the same frames and size."""
    rng = np.random.default_rng(SEED)
    later = np.arange(frames.start + 1, frames.stop)
    frames_drawn = np.sort(rng.choice(later, min(PAIRS, len(later)), replace=False))
    count = min(PIXELS // len(frames_drawn), size[0] * size[1])
    flat = [np.sort(rng.choice(size[0] * size[1], count, replace=False)) for _ in frames_drawn]
    return PixelSample(
        tuple(frames_drawn.tolist()), tuple(np.stack([f % size[0], f // size[0]], axis=-1) for f in flat)
    )


def discarded(words: Array, column: str) -> Array:
    """Whether each mask word discards its pixel.  (n,) -> (n,) bool."""
    return (words & np.uint32(COLUMN_BITS[column])) != 0


def pack(words: Array) -> str:
    """Mask words as text."""
    return base64.b64encode(words.astype(WORD_DTYPE).tobytes()).decode()


def pack_bits(flags: Array) -> str:
    """(n,) bool as text, eight to a byte."""
    return base64.b64encode(np.packbits(flags).tobytes()).decode()


def unpack(text: str) -> Array:
    """(n,) uint32."""
    return np.frombuffer(base64.b64decode(text), WORD_DTYPE).astype(np.uint32)


@dataclass(frozen=True, slots=True)
class Subject:
    """What is rendered, and which of its pixels are compared."""

    gpu: Gpu
    scene: Scene
    camera: CameraTrack
    sample: PixelSample

    @property
    def animated(self) -> AnimatedScene:
        return AnimatedScene(self.scene, self.camera)


def at_pixel_centers(settings: Settings) -> Settings:
    """``settings`` of frames that are looked at pixel by pixel."""
    return settings.replace(pairs="all", samples_per_pixel=1)


def rendered_masks(
    subject: Subject, settings: Settings, without: Sequence[str] = (), check: Callable[[], None] = lambda: None
) -> Array:
    """Mask words that the renderer itself writes with ``settings`` (n,) uint32.

    ``without``: effects left out.  ``check`` is called before each frame and may raise.
    """
    settings, words = at_pixel_centers(settings), []
    with subject.gpu, GpuOwner(subject.gpu) as owner:
        source = owner.open_source(subject.animated, settings, without=without)
        evaluator = owner.open_evaluator(source, settings, images=True)
        for frame, at in zip(subject.sample.frames, subject.sample.at, strict=True):
            evaluator.restart()
            check()
            evaluator.step(frame - 1, False)
            check()
            evaluator.step(frame)
            words.append(evaluator.mask()[at[:, 1], at[:, 0]])
    return np.concatenate(words)


@dataclass(frozen=True, slots=True)
class _Pair:
    frame: int
    at: Array
    reprojection: Reprojection
    channels: tuple[Mapping[str, Array], Mapping[str, Array]]  # previous, current


class PairChannels:
    """Channels of the sampled pairs, from the rasterizer at 32-bit floats, for masks in float64 on the CPU."""

    def __init__(
        self, subject: Subject, settings: Settings, light: bool = False, check: Callable[[], None] = lambda: None
    ):
        """``light``: keep the radiance of ``settings`` too, for ``masks`` without another light.  ``check``: as of
        ``rendered_masks``."""
        settings = at_pixel_centers(settings)
        self._settings, self._pairs = settings, []
        every = decide(subject.scene, settings)
        settings = settings if light else settings.replace(light="raster", indirect="none")
        with subject.gpu, GpuOwner(subject.gpu) as owner:
            extra = ("emission",) if every["emission"].enabled else ()
            source = owner.open_source(subject.animated, settings, extra=extra)
            self._mode = source.reprojection
            self._columns = tuple(c for c in LIGHT_FEATURES if c in settings.metrics.columns)
            names = ["position", "normal", *extra]
            names += source.radiance if light else [c for c in ("color",) if c in source.radiance]
            for frame, at in zip(subject.sample.frames, subject.sample.at, strict=True):
                views, channels = [], []
                for k in (frame - 1, frame):
                    check()
                    views.append(source.advance(k))
                    here = [*names, *(["prev_position"] if self._mode == "motion" else [])]
                    here += ["ids"] if source.cuts else []
                    channels.append({n: source.read(n) for n in here})
                moved = reprojection(views[1], views[0], *source.size)
                self._pairs.append(_Pair(frame, at, moved, tuple(channels)))

    def looked_up(self) -> dict[int, Array]:
        """Frame -> its pixels whose light the masks depend on, (n, 2): the sample, and its history."""
        out: dict[int, list[Array]] = {}
        for pair in self._pairs:
            out.setdefault(pair.frame, []).append(pair.at)
            out.setdefault(pair.frame - 1, []).append(self._history(pair))
        return {frame: np.unique(np.concatenate(lists), axis=0) for frame, lists in out.items()}

    def _history(self, pair: _Pair) -> Array:
        now = pair.channels[1]
        before = now["prev_position"] if self._mode == "motion" else None
        moved = reproject(pair.reprojection, np.asarray(now["position"], np.float64), before)
        at = moved.at_px[pair.at[:, 1], pair.at[:, 0]]
        at = at[np.isfinite(at).all(axis=-1)]
        h, w = now["position"].shape[:2]
        corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
        if self._settings.metrics.sampling == "nearest":  # both neighbors of a tie
            taps = [np.rint(at + 2e-6 * (corner - 0.5)) for corner in corners]
        else:
            taps = [np.floor(at) + corner for corner in corners]
        return np.clip(np.concatenate(taps), 0, [w - 1, h - 1]).astype(np.int64)  # the guard band of Eq. (3)

    def masks(self, light: Light | None = None) -> Array:
        """Mask words (n,) uint32, lit by ``light``, or as the settings say."""
        return np.concatenate([words for words, _ in self.comparisons(light)])

    def comparisons(self, light: Light | None = None) -> Iterator[tuple[Array, dict[str, Array]]]:
        """Of each pair the mask words (m,) of its pixels and their distances by feature (m,), as of ``PairMasks``."""
        metrics = self._settings.metrics
        for pair in self._pairs:
            before, now = (
                dict(c) if light is None else self._lit(c, light(pair.frame - 1 + k))
                for k, c in enumerate(pair.channels)
            )
            compared = pair_masks(
                now,
                before,
                pair.reprojection,
                {f: metrics.threshold(f) for f in FEATURES},
                sampling=metrics.sampling,
                reprojection=self._mode,
                exposure=self._settings.lighting.exposure_factor,
            )
            columns, rows = pair.at.T
            yield (
                compared.mask[rows, columns],
                {name: image[rows, columns] for name, image in compared.distances.items()},
            )

    def _lit(self, channels: Mapping[str, Array], light: tuple[Array, Array]) -> dict[str, Array]:
        """``channels`` with the radiance of ``light``; where there is no surface, the color of the background."""
        out = {n: a for n, a in channels.items() if n not in LIGHT_FEATURES}
        lit = dict(zip(("direct", "indirect"), light, strict=True))
        if "color" in self._columns:
            lighting = self._settings.lighting
            radiance = light[0] + light[1] + channels.get("emission", np.zeros(1))[..., :3]
            shown = display_color(radiance, lighting.exposure_factor, lighting.tone_map)
            lit["color"] = np.where(channels["position"][..., 3:] > 0, shown, channels["color"][..., :3])
        return out | {name: lit[name] for name in self._columns}
