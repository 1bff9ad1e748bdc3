"""Masks and counts of frame pairs, from any Source: the rasterizer or path-traced files."""

from __future__ import annotations

import operator
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection as reprojection_of
from taubench_gl.errors import SettingsError, TaubenchError, choice_hint
from taubench_gl.evaluation.explain import Explanation, MaskedPair, explain_pixel
from taubench_gl.features import FEATURES, GEOMETRY
from taubench_gl.frame.passes.masks import PLACES, ComparedSource, Comparison, MaskPass
from taubench_gl.frame.sources import Source
from taubench_gl.frame.targets import read_channel, write_channel
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.metrics.counts import Counts
from taubench_gl.metrics.masks import PixelDistances
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.run import Progress, Run, RunWriter
from taubench_gl.settings import Settings

Textures = Mapping[str, Any]
"""Channel name -> GL texture."""


@dataclass(slots=True)
class ChannelPair:
    """Channels of two frames that no Source holds, such as uploaded arrays, in the form of a source."""

    size: tuple[int, int]  # width, height in pixels
    current: Textures = field(default_factory=dict)
    previous: Textures = field(default_factory=dict)
    reprojection: str = "camera"  # camera | motion; motion needs ``prev_position`` in ``current``
    radiance: tuple[str, ...] = ()  # those of LIGHT_FEATURES that both frames have
    others: tuple[str, ...] = ()  # of OTHERS
    cuts: bool = False  # ``current`` has ``ids`` that mark surfaces without history


@dataclass(slots=True)
class EvaluatedPair:
    """A pair of frames that was submitted to the mask pass; ``counts`` once they are read back."""

    frame: int  # number of the current frame
    view: View  # of the current frame, through pixel centers
    views: tuple[View, View]  # of the history and current, of the first sample
    started: float  # seconds of the monotonic clock
    ended: float = 0.0  # when the CPU had nothing left to do for the pair but read its counts
    run: int = 0  # of the mask pass, for ``MaskPass.read``
    counts: Counts | None = None
    lobes: dict[str, np.ndarray] = field(default_factory=dict)  # lobe -> mask histogram, where they are measured

    @property
    def seconds(self) -> float:
        """Wall-clock seconds from drawing the frame to ``ended``, or until now while that is 0."""
        return (self.ended or time.perf_counter()) - self.started


class PairEvaluator:
    """Source -> mask pass -> counts: the one place where the channels of two frames are compared.

    ``step`` draws the frames of a source one after another and evaluates their pairs.  ``submit`` evaluates a pair of
    frames that the caller drew, and ``read`` gives its counts.  ``release`` frees the mask pass; ``context`` stays the
    caller's.
    """

    def __init__(
        self,
        context: GpuContext,
        source: Source | ComparedSource,
        settings: Settings,
        **options: Unpack[Comparison],
    ):
        """``options``: what the mask pass compares and writes, as ``MaskPass.for_source`` takes it."""
        self.source, self.settings, self.gpu = source, settings, context.gpu
        self._samples = settings.metrics.samples_per_pixel
        # Counts are read one pair late, while the GPU works on the next pair; at once where images go with them.
        self.deferred = self._samples == 1 and not options.get("images")
        self._timer = context.timer
        self._thresholds = {f: settings.metrics.threshold(f) for f in FEATURES}
        self._masks = MaskPass.for_source(context, source, settings, **options)
        self._previous: list[View] = []  # views of the frame drawn last, one per sample within a pixel
        self._pending: deque[EvaluatedPair] = deque()
        self._submitted: tuple[Reprojection, Mapping[str, float]] | None = None  # the pair last, and its thresholds

    def step(self, frame: int, evaluate: bool = True) -> tuple[View, list[EvaluatedPair]]:
        """Draw ``frame`` and, if ``evaluate``, submit its pair with the frame drawn before; read finished counts.

        Returns the view of the frame through pixel centers, and the pairs whose counts are read: with ``deferred`` the
        pair before this one, else this one, whose images stay valid until the next call.
        """
        started = time.perf_counter()
        stereo = self.settings.metrics.stereo  # the source draws the history of every frame with it
        evaluate = evaluate and (stereo or bool(self._previous))
        views: list[View] = []
        counts: Counts | None = None
        run = 0
        before: list[View] = []
        for sample in range(self._samples):
            views.append(self._draw(frame, sample))
            if evaluate:
                before.append(self.source.previous_view if stereo else self._previous[sample])
                run = self.submit(reprojection_of(views[-1], before[-1], *self.source.size))
                if not self.deferred:
                    of_sample = self._masks.read(run)
                    counts = of_sample if counts is None else counts + of_sample
        self._previous = views
        view = views[0].centered()
        if not evaluate:
            return view, []
        pair = EvaluatedPair(frame, view, (before[0], views[0]), started, run=run, counts=counts)
        self._pending.append(pair)
        finished = self.finish(but=int(self.deferred))
        pair.ended = time.perf_counter()
        return view, finished

    def finish(self, but: int = 0) -> list[EvaluatedPair]:
        """Read the counts of submitted pairs, all but the last ``but`` of them, and return these pairs in order."""
        finished = []
        while len(self._pending) > but:
            pair = self._pending[0]
            if pair.counts is None:
                pair.counts = self._masks.read(pair.run)
            finished.append(self._pending.popleft())
        return finished

    def restart(self) -> None:
        """Forget the frame drawn last: the next one has no history.  Pairs not yet read are dropped."""
        self._previous = []
        self._pending.clear()

    def submit(
        self,
        pair: Reprojection,
        *,
        declared: int = 0,
        current: Textures | None = None,
        previous: Textures | None = None,
        thresholds: Mapping[str, float] | None = None,
    ) -> int:
        """Submit one pair to the mask pass; returns the number of the run, for ``read``.

        ``declared``: Reason.FIRST or CUT for the whole frame, else 0.  ``current``, ``previous``: None for what the
        source holds; a first frame, which has no previous textures, is bound twice.  ``thresholds``: a_B of every
        feature, position in scene units; None for those of the settings.
        """
        current = self.source.current if current is None else current
        previous = (self.source.previous if previous is None else previous) or current
        limits = self._thresholds if thresholds is None else thresholds
        self._submitted = pair, limits
        with self._timer.measure("masks"):
            return self._masks.run(
                pair, limits, current, previous, int(declared), exposure=self.settings.lighting.exposure_factor
            )

    @property
    def submitted(self) -> Reprojection:
        """The cameras of the pair submitted last."""
        assert self._submitted is not None
        return self._submitted[0]

    def read(self, run: int | None = None) -> Counts:
        """Wait for a run, the latest or the one before it, and read its counts."""
        return self._masks.read(run)

    @property
    def mask_texture(self) -> Any:
        """The texture of mask words (r32ui); None without ``images``."""
        return self._masks.mask

    @property
    def motion_texture(self) -> Any:
        """The texture of motion (rg32f), rows from the bottom; None without ``images``."""
        return self._masks.motion

    def mask(self) -> np.ndarray:
        """Mask words of the pair submitted last.  (h, w) uint32, row 0 at the top."""
        return read_channel(self._masks.mask, "mask")[..., 0]

    def motion(self) -> np.ndarray:
        """Motion of the pair submitted last: previous - current, pixels, +x right, +y down.

        (h, w, 2) float32, row 0 at the top; 0 where the previous position is behind the camera.
        """
        return read_channel(self._masks.motion, "motion")

    def replace_mask(self, words: np.ndarray) -> None:
        """Overwrite ``mask``; (h, w) uint32, row 0 at the top."""
        write_channel(self._masks.mask, "mask", words)

    def distances(self) -> PixelDistances:
        """Distances of every pixel of the pair submitted last, (h, w) images; needs ``distances``."""
        images = {name: read_channel(getattr(self._masks, name), "distances") for name in ("distances", "changes")}
        measured = {*GEOMETRY, *(feature.name for feature in self._masks.options.values)}
        features = {f: images[PLACES[f][0]][..., PLACES[f][1]] for f in FEATURES if f in measured}
        return PixelDistances(features, images["changes"][..., 1], images["changes"][..., 2])

    def explain(self, x: int, row: int, thresholds: Mapping[str, float] | None = None) -> Explanation:
        """Explain pixel (x, row from the top) of the pair submitted last, whose channels the source still holds.

        Needs ``images``.  ``thresholds``: as for ``submit``; None: those the pair was submitted with.
        """
        assert self._submitted is not None
        pair, limits = self._submitted
        limits = limits if thresholds is None else thresholds
        images = (self.gpu, self.source, self._masks.mask, self._masks.motion)
        return explain_pixel(MaskedPair(*images, pair, self.settings, limits), x, row)

    def _draw(self, frame: int, sample: int) -> View:
        if self._samples == 1:
            return self.source.advance(frame)
        return self.source.advance_sample(frame, sample)

    def release(self) -> None:
        self._masks.release()


class Pair:
    """One evaluated pair of frames.  Pixels: row 0 is at the top.

    ``frame``: number of the current frame.  ``row``: its row of frames.csv.  ``view``: of the current frame, through
    pixel centers.  ``settings``: with light unit, exposure and environment as numbers and names, never ``auto``.
    ``unmeasured``: column -> why it is null.  Images are read from the GPU on first use; one that was
    not read before the next pair is drawn (``on_pair``: before the callback returns) is gone, and raises
    TaubenchError.  With several samples per pixel images show the last sample.

    Where ``pairs`` was asked for light, all of the current frame, linear radiance x exposure, float32, else None:
    ``radiance`` (h, w, 3): of the images that masks compare; ``noisy`` (h, w, 4): of the input, as reuse methods get
    it (its last component is 0 where a pixel was not shaded); ``reference`` (h, w, 3): what they are compared with.

    ``uses_other_eye`` (h, w) bool: with ``history`` ``both`` the pixels whose mask is that of the other eye, else None;
    images are those of the last frame.
    """

    def __init__(self, evaluated: EvaluatedPair, row: dict[str, Any], evaluator: PairEvaluator):
        self.frame, self.view, self.evaluated = evaluated.frame, evaluated.view, evaluated
        self.row, self.settings = row, evaluator.settings
        self.unmeasured = dict(evaluator.source.unmeasured)
        self._evaluator: PairEvaluator | None = evaluator
        self.radiance: np.ndarray | None = None
        self.noisy: np.ndarray | None = None
        self.reference: np.ndarray | None = None
        self.uses_other_eye: np.ndarray | None = None
        self._eye: Pair | None = None

    def __repr__(self) -> str:
        return f"<Pair: frame {self.frame} and its history, {self.row['pixels']} pixels>"

    @cached_property
    def mask(self) -> np.ndarray:
        """Mask words, bits of ``Reason``.  (h, w) uint32."""
        return self._read(lambda evaluator: evaluator.mask())

    @cached_property
    def motion(self) -> np.ndarray:
        """Previous - current position, pixels, +x right, +y down.  (h, w, 2) float32; 0 where behind the camera."""
        return self._read(lambda evaluator: evaluator.motion())

    @cached_property
    def distances(self) -> PixelDistances:
        """Distances of every pixel, of an evaluation whose observers ask for them."""
        return self._read(lambda evaluator: evaluator.distances())

    @cached_property
    def color(self) -> np.ndarray | None:
        """Tone-mapped sRGB color of the current frame in [0, 1], (h, w, 3) float32.

        None if the run has no color; ``unmeasured["color"]`` says why.
        """
        return None if "color" in self.unmeasured else self.read("color")[..., :3].astype(np.float32)

    def read(self, name: str, *, previous: bool = False) -> np.ndarray:
        """A channel of the current or previous frame, (h, w, components).  Raises TaubenchError."""
        return self._read(lambda evaluator: _channel(evaluator.source, name, previous))

    def explain(self, x: int, y: int) -> Explanation:
        """Why pixel (x, y), y from the top, can or cannot be reused; ``print`` shows the reason.

        Where every pixel is decided, the values of light and color are those of the preview, as its images are.
        Raises TaubenchError for a pixel outside the image, and after the next pair is drawn.
        """
        column, row = _pixel_in(self.source.size, x, y)
        if self.uses_other_eye is not None and self.uses_other_eye[row, column]:
            return self._eye.explain(column, row)
        return self._read(lambda evaluator: evaluator.explain(column, row))

    def add_eye(self, other: Pair, uses_other_eye: np.ndarray) -> None:
        """Explain the pixels ``uses_other_eye`` (h, w) bool by ``other``, the pair with the other eye."""
        self._eye, self.uses_other_eye = other, uses_other_eye

    def replace(self, words: np.ndarray, distances: PixelDistances, counts: Counts) -> None:
        """Replace mask ``words`` (h, w) uint32, distances and counts by those of pixels compared in another way."""
        self.evaluator.replace_mask(words)
        self.evaluated.counts = counts
        self.__dict__ |= {"mask": words, "distances": distances}  # cached properties

    @property
    def source(self) -> Source:
        """The source of both frames.  Raises TaubenchError once it holds other frames."""
        return self.evaluator.source

    def load(self) -> Pair:
        """Read mask, motion and color, so that they stay; returns this pair."""
        _ = self.mask, self.motion, self.color
        return self

    def close(self) -> None:
        """Let go of the images: the source is about to draw other frames."""
        self._evaluator = None
        if self._eye is not None:
            self._eye.close()

    @property
    def evaluator(self) -> PairEvaluator:
        """What compared the pair, and holds its images.  Raises TaubenchError once they are gone."""
        if self._evaluator is None:
            raise TaubenchError(
                f"the images of frame {self.frame} are gone", hint="use a pair inside its loop, before the next one"
            )
        return self._evaluator

    def _read(self, read: Callable[[PairEvaluator], Any]) -> Any:
        evaluator = self.evaluator
        with evaluator.gpu:
            return read(evaluator)


def _channel(source: Any, name: str, previous: bool) -> np.ndarray:
    if name not in source.channels:
        raise SettingsError(f"no channel of these frames is named {name!r}", hint=choice_hint(name, source.channels))
    return source.read(name, previous=previous)


def _pixel_in(size: tuple[int, int], x: Any, y: Any) -> tuple[int, int]:
    try:
        column, row = operator.index(x), operator.index(y)
    except TypeError:
        raise SettingsError(f"pixel ({x!r:.30}, {y!r:.30}) is not two integers") from None
    if not (0 <= column < size[0] and 0 <= row < size[1]):
        message = f"pixel ({column}, {row}) is outside the image"
        raise SettingsError(message, hint=f"x from 0 to {size[0] - 1}, y from 0 to {size[1] - 1}")
    return column, row


@dataclass(frozen=True, slots=True)
class Observers:
    """Functions that receive every evaluated pair, and what they need.

    ``on_pair`` makes the mask pass write images and counts be read at once.
    """

    progress: Callable[[Progress], None] | None = None
    on_pair: Callable[[Pair], None] | None = None
    channels: tuple[str, ...] = ()  # to draw for ``on_pair`` besides those the columns need
    distances: bool = False  # whether ``on_pair`` reads ``Pair.distances``
    on_counts: Callable[[Counts], None] | None = None  # gets the exact counts of every pair
    scene: str = ""  # name of the scene, for ``progress``; set by the evaluation
    writer: RunWriter | None = None  # writes the row of every pair; set by the evaluation
    on_finish: Callable[[Run], Iterable[Path]] | None = None  # writes files once all rows are, before summary.json
