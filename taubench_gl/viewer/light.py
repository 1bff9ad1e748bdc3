"""Light beside the exact one: coarse while the image moves, path-traced sample by sample while it is still."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation.pairs import reprojection
from taubench_gl.evaluation import PairEvaluator
from taubench_gl.evaluation.explain import Explanation
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.features import LIGHT_FEATURES
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.metrics.counts import Counts
from taubench_gl.settings import AUTO, PREVIEWED, Settings
from taubench_gl.srgb import srgb_encode
from taubench_gl.viewer.display import DIRECT_LOBES
from taubench_gl.viewer.feeds import SceneFeed, Shot
from taubench_gl.viewer.state import MAX_THRESHOLD, ViewerState

Array = np.ndarray

REFINED = ("color", "direct", "indirect")
"""Channels that path tracing refines."""
STILL_SECONDS = 0.3
"""Without motion, before path tracing starts."""


@dataclass(frozen=True, slots=True)
class Coarse:
    """Light of fewer pixels."""

    step: int  # pixels of the image along a side of each
    shadows: bool = True
    hold: int = 12  # frames for which indirect light is kept; 0: there is none

    @property
    def text(self) -> str:
        """What differs from light at every pixel."""
        kept = f"indirect light of every {self.hold}th frame" if self.hold else "no indirect light"
        return f"light at 1/{self.step} resolution, {'' if self.shadows else 'no shadows, '}{kept}"

    def settings(self, full: Settings) -> Settings:
        """``full`` with this light."""
        width, height = (-(-n // self.step) for n in (full.sequence.width, full.sequence.height))
        changed: dict[str, Any] = {"shadow_size": max(full.lighting.shadow_size // (2 * self.step), 16)}
        changed |= {} if self.shadows else {"shadow_lights": 0}
        changed |= {} if self.hold else {"indirect": "none"}
        return full.replace(width=width, height=height, light="raster", **changed)


COARSE: Mapping[str, Coarse | None] = {
    "full": None,
    "half": Coarse(2),
    "quarter": Coarse(4),
    "unshadowed": Coarse(4, shadows=False, hold=0),
}
"""Light while the image moves, by name."""
UNLIT = frozenset(LIGHT_FEATURES)
"""Effects without which only geometry is drawn."""


class CoarseLight(GpuOwner):
    """Light and light masks of pairs at a fraction of the size of a feed."""

    def __init__(self, gpu: Gpu, feed: SceneFeed, coarse: Coarse, timer: Any):
        super().__init__(gpu, timer)
        self.coarse = coarse
        self._feed = self.own(feed.beside(coarse.settings(feed.settings)))
        self._evaluator: PairEvaluator | None = None

    @property
    def source(self) -> RasterSource:
        return self._feed.source

    @property
    def mask(self) -> moderngl.Texture:
        return self._evaluator.mask_texture

    def draw(self, shots: tuple[Shot, Shot], off: frozenset[str]) -> None:
        """Draw a pair."""
        if self._feed.plan(frozenset(), off, self._feed.live) or self._evaluator is None:
            how = {"images": True, "instead_of": self._evaluator}
            self._evaluator = self.open_evaluator(self.source, self._feed.settings, **how)
        light = self.source.light
        if light is not None and light.indirect is not None:
            light.indirect.hold = self.coarse.hold
        self._feed.show(*shots)

    def submit(self, shots: tuple[Shot, Shot], declared: int, thresholds: Mapping[str, float]) -> None:
        """Compare the pair drawn; indirect light, which is kept for some frames, discards nothing."""
        pair = reprojection(shots[1].view, shots[0].view, *self._feed.size)
        self._evaluator.submit(pair, declared=declared, thresholds={**thresholds, "indirect": MAX_THRESHOLD})

    @property
    def unmeasured(self) -> Mapping[str, str]:
        """Columns of light that are not measured, with reasons."""
        kept = "indirect light is kept for some frames while the image moves"
        return {"indirect": kept, **self.source.unmeasured}

    def explain(self, x: int, row: int, thresholds: Mapping[str, float]) -> Explanation:
        """The coarse pixel over pixel (x, row) of the image."""
        return self._evaluator.explain(x // self.coarse.step, row // self.coarse.step, thresholds=thresholds)

    def read(self) -> Counts:
        """Counts of the pair compared last, of fewer pixels."""
        return self._evaluator.read()


class Refiner(GpuOwner):
    """Path-traced light of one frame, the mean of as many samples as were traced so far.

    ``better``: its noise is smaller than the error of the light method, both root mean squares of displayed values:
    sRGB of radiance times exposure, clipped.  Twice as many samples move the mean by as much as its noise, because the
    second half is as noisy as the first and independent; the squared distance to the light method is the sum of both
    squared errors.  Compared at 2, 4, 8, ... samples until it is.
    """

    def __init__(self, gpu: Gpu, feed: SceneFeed, off: frozenset[str], timer: Any):
        super().__init__(gpu)
        settings = feed.settings.replace(light="path-traced", indirect=AUTO, spp=1, pattern="independent")
        self._feed = self.own(feed.beside(settings))
        self._feed.plan(frozenset(), off, self._feed.live)
        size = self._feed.size
        self._program = self.context.shaders.render("viewer/fullscreen.vert.glsl", "viewer/average.frag.glsl")
        self._triangle = self.own(gpu.ctx.vertex_array(self._program, []))
        self._means = [[self.own(gpu.ctx.texture(size, 4, dtype="f4")) for _ in range(2)] for _ in range(2)]
        self._targets = [self.own(gpu.ctx.framebuffer(textures)) for textures in self._means]
        self._shot: Shot | None = None
        self._half: Array | None = None  # the image at the last comparison, of half as many samples
        self.samples, self.better = 0, False

    @property
    def source(self) -> RasterSource:
        return self._feed.source

    def add(self, shot: Shot, preview: RasterSource) -> None:
        """Trace one more sample of ``shot``; the first if it is another one than before.

        ``preview``: the same shot in the light of the light method.
        """
        source, key = self.source, shot.key
        if self._shot is None or self._shot.key != key:
            source.draw_pair(shot.frame, shot.frame, shot.view, shot.view, light=False)
            self._shot, self.samples, self.better = shot, 0, False
        source.trace(shot.frame, self.samples, 1)
        self.samples += 1
        light = [source.current[name] for name in ("direct", "indirect")]
        self.gpu.finish()  # Mesa 22's llvmpipe may read a texture before its last draw has finished
        self._average(light, self._means[0], self._targets[1], 1.0 / self.samples)
        self._means.reverse()
        self._targets.reverse()
        with Owner() as drawn:
            target = drawn.own(self.gpu.ctx.framebuffer(light))
            self._average(self._means[0], self._means[0], target, 0.0)
            self.gpu.unbind_framebuffer()
        source.recolor()
        if self.samples.bit_count() == 1 and not self.better:
            self._compare(preview)

    def _compare(self, preview: RasterSource) -> None:
        names = [name for name in ("direct", "indirect") if name in preview.current]
        exposure = self._feed.settings.lighting.exposure_factor

        def image(source: RasterSource) -> Array:
            return srgb_encode(np.clip(exposure * sum(source.read(name)[..., :3] for name in names), 0.0, 1.0))

        mean = image(self.source)
        if self.samples > 1:
            noise, distance = (float(np.square(mean - other).mean()) for other in (self._half, image(preview)))
            self.better = noise < distance - noise
        self._half = mean

    def _average(self, samples: list, means: list, target: moderngl.Framebuffer, weight: float) -> None:
        """``target`` = mean + weight (sample - mean), for direct and indirect light."""
        target.use()
        ctx, program = self.gpu.ctx, self._program
        ctx.viewport = (0, 0, *self._feed.size)
        ctx.disable(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.BLEND)
        names = ("sample_direct", "sample_indirect", "mean_direct", "mean_indirect")
        for unit, (name, texture) in enumerate(zip(names, (*samples, *means), strict=True)):
            texture.use(unit)
            program[name] = unit
        program["weight"] = weight
        self._triangle.render(moderngl.TRIANGLES, vertices=3)
        self.gpu.finish()

    def release(self) -> None:
        self.gpu.unbind_framebuffer()
        super().release()


class Lights(GpuOwner):
    """Chooses the quality of light for what a feed shows, and holds what the others need."""

    def __init__(self, context: GpuContext, timer: Any):
        super().__init__(context.gpu, timer, context.shaders)
        self._timer = timer
        self._geometry: SceneFeed | None = None  # the feed without light
        self._evaluator: PairEvaluator | None = None  # of its pairs
        self._coarse: CoarseLight | None = None
        self._refiner: Refiner | None = None
        self.active: Coarse | None = None  # of the pair shown
        self._key: Any = None  # of the shot that is refined
        self._hidden = False  # while compared with an image whose light is not path-traced

    @staticmethod
    def lit(feed: Any) -> bool:
        """Whether a feed draws light, which can also be drawn coarsely and path-traced."""
        return isinstance(feed, SceneFeed) and any(feed.effects[name].enabled for name in ("direct", "indirect"))

    def choose(self, state: ViewerState, feed: Any, channel: str) -> Coarse | None:
        """Set and return ``active``: coarse light while the image moves, if it has ``channel``."""
        coarse = COARSE[state.moving_light] if state.moving and self.lit(feed) else None
        if channel in ("indirect", *DIRECT_LOBES):
            coarse = None
        self.active = coarse
        compared = state.comparison != "off" or state.beside
        self._hidden = compared and state.against != "reference"
        return coarse

    def geometry(self, state: ViewerState, feed: SceneFeed, extra: frozenset[str]) -> SceneFeed:
        """The feed without light, with channels ``extra``."""
        if self._geometry is None:
            self._geometry = self.own(feed.beside(feed.settings))
        if self._geometry.plan(extra - UNLIT, state.switched_off | UNLIT, self._geometry.live):
            source, settings = self._geometry.source, self._geometry.settings
            self._evaluator = self.open_evaluator(source, settings, images=True, instead_of=self._evaluator)
        return self._geometry

    @property
    def evaluator(self) -> PairEvaluator:
        """Compares pairs of ``geometry``."""
        return self._evaluator

    def draw(self, state: ViewerState, feed: SceneFeed, shots: tuple[Shot, Shot]) -> None:
        """Draw a pair with ``active`` light, if that is coarse."""
        if self.active is None:
            return
        if self._coarse is None or self._coarse.coarse != self.active:
            coarse = CoarseLight(self.gpu, feed, self.active, self._timer)
            self._coarse = self.own(coarse, instead_of=self._coarse)
        self._coarse.draw(shots, state.switched_off)

    def submit(self, state: ViewerState, shots: tuple[Shot, Shot], declared: int) -> None:
        """Compare the pair drawn with ``active`` light."""
        self._coarse.submit(shots, declared, state.thresholds)

    def read(self) -> Counts:
        """Counts of the pair compared last with ``active`` light."""
        return self._coarse.read()

    @property
    def coarse(self) -> CoarseLight | None:
        """The coarse light of the pair shown; None if its light is exact."""
        return self._coarse if self.active is not None else None

    def refine(self, state: ViewerState, feed: Any, shot: Shot, channel: str) -> None:
        """Trace one more sample if the image is still and time passes."""
        still = not state.moving and state.elapsed > 0.0 and state.still_seconds >= STILL_SECONDS
        if not still or not self.pending(state, feed, shot, channel):
            return
        if self._refiner is None:
            self._refiner = self.own(Refiner(self.gpu, feed, state.switched_off, self._timer))
        self._refiner.add(shot, feed.source)
        self._key = shot.key

    def refinable(self, state: ViewerState, feed: Any, channel: str) -> bool:
        return channel in REFINED and self.lit(feed) and not state.freeze_current and not self._hidden

    def pending(self, state: ViewerState, feed: Any, shot: Shot, channel: str) -> bool:
        """Whether more samples are to be traced."""
        return self.refinable(state, feed, channel) and self.traced(shot, channel) < state.samples

    def traced(self, shot: Shot, channel: str) -> int:
        """Path-traced samples that there are of a shot."""
        refined = self._refiner is not None and channel in REFINED and self._key == shot.key and self.active is None
        return self._refiner.samples if refined and not self._hidden else 0

    def samples(self, shot: Shot, channel: str) -> int:
        """Path-traced samples that the image of a shot has; 0 while its light is that of the light method."""
        traced = self.traced(shot, channel)
        return traced if traced and self._refiner.better else 0

    def source(self, shot: Shot, channel: str) -> RasterSource | None:
        """The source of a channel other than the feed's; None for the feed's."""
        if self.active is not None and channel in REFINED:
            return self._coarse.source
        return self._refiner.source if self.samples(shot, channel) else None

    def text(self, state: ViewerState, feed: Any, shot: Shot, channel: str) -> str:
        """The quality of light in words; empty without light."""
        if not self.lit(feed):
            return ""
        if self.active is not None:
            return self.active.text
        samples, lighting = self.samples(shot, channel), feed.settings.lighting
        if samples:
            return f"path-traced light, {samples} of {state.samples} samples per pixel"
        if lighting.light == "path-traced":
            return f"path-traced light, {lighting.spp} sample{'' if lighting.spp == 1 else 's'} per pixel"
        of = "light of the preview, approximate," if lighting.light in PREVIEWED else "light"
        traced = self.traced(shot, channel)
        still = f"; {traced} of {state.samples} path-traced samples have more noise" if traced else ""
        return f"{of} at full resolution{still}"

    def reset(self) -> None:
        """Free everything: the feed has another source."""
        self.release()
        self._evaluator = self._geometry = self._coarse = self._refiner = self.active = self._key = None
