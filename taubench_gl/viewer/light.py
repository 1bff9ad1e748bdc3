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
from taubench_gl.viewer.feeds import Feed, SceneFeed, Shot
from taubench_gl.viewer.state import MAX_THRESHOLD, ViewerState

Array = np.ndarray

REFINED = ("color", "direct", "indirect")
"""Channels that path tracing refines."""
STILL_SECONDS = 0.3
"""Seconds that the image stands still before path tracing starts."""


@dataclass(frozen=True, slots=True)
class Coarse:
    """A quality of light that is computed for fewer pixels than the image has."""

    step: int  # pixels of the image along a side of each
    shadows: bool = True
    hold: int = 12  # frames for which indirect light is kept; 0: there is none

    @property
    def text(self) -> str:
        """The differences from light at every pixel, in words."""
        kept = f"indirect light of every {self.hold}th frame" if self.hold else "no indirect light"
        return f"light at 1/{self.step} resolution, {'' if self.shadows else 'no shadows, '}{kept}"

    def settings(self, full: Settings) -> Settings:
        """Settings of a smaller image with this light.  ``full``: those of the image."""
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
"""Setting *while moving* -> light while the image moves; None: light at every pixel."""
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
        """The source that draws the light."""
        return self._feed.source

    @property
    def mask(self) -> moderngl.Texture:
        """Reason masks of the light of the pair compared last, a texture."""
        return self._evaluator.mask_texture

    def draw(self, shots: tuple[Shot, Shot], off: frozenset[str]) -> None:
        """Draw the previous and the current shot.  ``off``: effects that are switched off."""
        if self._feed.plan(frozenset(), off, self._feed.live) or self._evaluator is None:
            self._evaluator = self.open_evaluator(
                self.source, self._feed.settings, images=True, instead_of=self._evaluator
            )
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
        """Why the coarse pixel over pixel (x, row from the top) of the image is kept or discarded."""
        return self._evaluator.explain(x // self.coarse.step, row // self.coarse.step, thresholds=thresholds)

    def read(self) -> Counts:
        """Counts of the pair compared last, of fewer pixels."""
        return self._evaluator.read()


class Refiner(GpuOwner):
    """Path-traced light of one frame, the mean of as many samples as were traced so far.

    ``converged``: its noise is smaller than the error of the light method, both root mean squares of displayed values:
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
        self.samples, self.converged = 0, False

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
            self._shot, self.samples, self.converged = shot, 0, False
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
        if self.samples.bit_count() == 1 and not self.converged:
            self._compare(preview)

    def _compare(self, preview: RasterSource) -> None:
        names = [name for name in ("direct", "indirect") if name in preview.current]
        exposure = self._feed.settings.lighting.exposure_factor

        def image(source: RasterSource) -> Array:
            return srgb_encode(np.clip(exposure * sum(source.read(name)[..., :3] for name in names), 0.0, 1.0))

        mean = image(self.source)
        if self.samples > 1:
            noise, distance = (float(np.square(mean - other).mean()) for other in (self._half, image(preview)))
            self.converged = noise < distance - noise
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
        self._feed: Feed | None = None  # what is shown: feed, current shot and channel
        self._shot: Shot | None = None
        self._channel = ""
        self._refined: Any = None  # key of the shot that is refined
        self._hidden = False  # while compared with an image whose light is not path-traced

    @property
    def lit(self) -> bool:
        """Whether the feed draws light, which can also be drawn coarsely and path-traced."""
        feed = self._feed
        return isinstance(feed, SceneFeed) and any(feed.effects[name].enabled for name in ("direct", "indirect"))

    def choose(self, state: ViewerState, feed: Feed, shot: Shot, channel: str) -> Coarse | None:
        """Take what is shown; set and return ``active``: coarse light while the image moves, if it has ``channel``."""
        self._feed, self._shot, self._channel = feed, shot, channel
        coarse = COARSE[state.moving_light] if state.moving and self.lit else None
        if channel in ("indirect", *DIRECT_LOBES):
            coarse = None
        self.active = coarse
        compared = state.comparison != "off" or state.beside
        self._hidden = compared and state.against != "reference"
        return coarse

    def geometry(self, state: ViewerState, extra: frozenset[str]) -> SceneFeed:
        """A feed of the same scene without light, with channels ``extra``."""
        if self._geometry is None:
            self._geometry = self.own(self._feed.beside(self._feed.settings))
        if self._geometry.plan(extra - UNLIT, state.switched_off | UNLIT, self._geometry.live):
            source, settings = self._geometry.source, self._geometry.settings
            self._evaluator = self.open_evaluator(source, settings, images=True, instead_of=self._evaluator)
        return self._geometry

    @property
    def evaluator(self) -> PairEvaluator:
        """The evaluator that compares pairs of ``geometry``."""
        return self._evaluator

    def draw(self, state: ViewerState, shots: tuple[Shot, Shot]) -> None:
        """Draw a pair with ``active`` light, if that is coarse."""
        if self.active is None:
            return
        if self._coarse is None or self._coarse.coarse != self.active:
            coarse = CoarseLight(self.gpu, self._feed, self.active, self._timer)
            self._coarse = self.own(coarse, instead_of=self._coarse)
        self._coarse.draw(shots, state.switched_off)

    @property
    def coarse(self) -> CoarseLight | None:
        """The coarse light of the pair shown; None if its light is exact."""
        return self._coarse if self.active is not None else None

    def refine(self, state: ViewerState) -> None:
        """Trace one more sample if the image is still and time passes."""
        still = not state.moving and state.elapsed > 0.0 and state.still_seconds >= STILL_SECONDS
        if not still or not self.pending(state):
            return
        if self._refiner is None:
            self._refiner = self.own(Refiner(self.gpu, self._feed, state.switched_off, self._timer))
        self._refiner.add(self._shot, self._feed.source)
        self._refined = self._shot.key

    def pending(self, state: ViewerState) -> bool:
        """Whether more samples are to be traced."""
        refinable = self._channel in REFINED and self.lit and not state.freeze_current and not self._hidden
        return refinable and self.traced < state.samples

    @property
    def traced(self) -> int:
        """Path-traced samples per pixel that there are, shown or not yet."""
        there = self._refiner is not None and self._channel in REFINED and self._refined == self._shot.key
        return self._refiner.samples if there and self.active is None and not self._hidden else 0

    @property
    def samples(self) -> int:
        """Path-traced samples per pixel of the image; 0 while its light is that of the light method."""
        return self.traced if self.traced and self._refiner.converged else 0

    @property
    def source(self) -> RasterSource | None:
        """The source of the channel if it is not that of the feed, else None."""
        if self.active is not None and self._channel in REFINED:
            return self._coarse.source
        return self._refiner.source if self.samples else None

    def text(self, state: ViewerState) -> str:
        """The quality of light in words; empty without light."""
        if not self.lit:
            return ""
        if self.active is not None:
            return self.active.text
        lighting = self._feed.settings.lighting
        if self.samples:
            return f"path-traced light, {self.samples} of {state.samples} samples per pixel"
        if lighting.light == "path-traced":
            return f"path-traced light, {lighting.spp} sample{'' if lighting.spp == 1 else 's'} per pixel"
        kind = "light of the preview, approximate," if lighting.light in PREVIEWED else "light"
        noisy = f"; {self.traced} of {state.samples} path-traced samples have more noise" if self.traced else ""
        return f"{kind} at full resolution{noisy}"

    def reset(self) -> None:
        """Free everything: the feed has another source."""
        self.release()
        self._evaluator = self._geometry = self._coarse = self._refiner = self.active = self._refined = None
