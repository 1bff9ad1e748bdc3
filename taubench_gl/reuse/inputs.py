"""The frames of a scene as inputs of reuse methods: one ``FrameInputs`` after another.

``RasterInputs`` renders them.  Its *input* source renders what methods get: jittered, noisy, or partly shaded.  Its
*exact* source renders the same frames without noise, at pixel centers, for ``exact_mask`` and for the evaluation; both
are one source where the input is exact.  ``file_inputs`` reads path-traced frames.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import CameraTrack, Poser, View
from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.animation.pairs import reprojection, sky_directions
from taubench_gl.conventions import Reason
from taubench_gl.effects.decide import decide
from taubench_gl.effects.lighting import environment_of
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.features import COLUMNS
from taubench_gl.frame.environment import declare_environment
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource, Source, SourceOptions
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import UPDATE, WRITE, ComputePass
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.metrics.shading_rate import RATES, cycle, phase
from taubench_gl.reuse.derived import (
    COMPOSED,
    NEEDS,
    DerivedInputs,
    channels_for,
    declare_composed,
    input_texture,
    with_needs,
    written,
)
from taubench_gl.reuse.frame import FAR_AWAY_PX, FrameInputs
from taubench_gl.reuse.input_kind import InputKind
from taubench_gl.reuse.reshade import CHANNELS_READ, RESHADED, Reshade
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray

CHANNEL_INPUTS = ("position", "normal", "prev_position", "base_color", "emission", "ids", "material")
HISTORY_INPUTS = {"history_position": "position", "history_normal": "normal", "history_ids": "ids"}
LIGHT_CHANNELS = ("direct", "indirect", "emission")

SHADING_PASSES = ("shadows", "direct", "indirect", "stochastic", "path tracing", "compose")
"""Passes that become cheaper with a coarser or noisier input."""


@dataclass(frozen=True, slots=True)
class InputRequest:
    """What to render: shared by the inputs and the reference of an evaluation.

    ``scene`` and ``camera`` can be None for path-traced files.  ``poser``: of ``scene``, None: a new one.
    """

    gpu: Gpu
    scene: Scene | None
    camera: CameraTrack | None
    settings: Settings
    kind: InputKind
    poser: Poser | None = None


def missing_inputs(kind: InputKind, *, traced: bool) -> dict[str, str]:
    """Input that frames of ``kind`` do not have -> why.  ``traced``: their light is path-traced."""
    out = {}
    if not (kind.noisy or kind.path_samples) or kind.rate != "full":
        why = "only noisy and path-traced light is shaded again, where every pixel is shaded"
        out |= dict.fromkeys(RESHADED, why)
    if not traced:
        out |= dict.fromkeys(("hit_distance", "variance"), "only path-traced light has it (--input path-traced@N)")
    if kind.upscale != 1:
        out["exact_mask"] = "exact frames have the size of the output"
    for name, needs in NEEDS.items():
        if missing := next((out[need] for need in needs if need in out), None):
            out[name] = missing
    return out


class RasterInputs(GpuOwner):
    """Inputs rasterized from a scene.  Call ``advance`` for every frame in order."""

    def __init__(
        self,
        request: InputRequest,
        reads: Collection[str],
        *,
        cuts: Collection[int] = (),
        exact: bool | Source = False,
        jitter: Callable[[int], Array] = halton_jitter,
    ):
        """Raises SettingsError.

        ``reads``: names of INPUTS that frames must contain; ``cuts``: frames declared to have no history; ``exact``:
        provide ``exact_mask`` and ``exact_motion`` even if no method reads them; or the source that they are of, which
        stays the caller's: path-traced inputs need one.
        """
        gpu, kind, settings = request.gpu, request.kind, request.settings
        if kind.rate != "full" and min(settings.sequence.width, settings.sequence.height) < 2:
            raise SettingsError(f"shading rate {kind.rate!r} needs at least 2x2 pixels", hint="increase --size")
        super().__init__(gpu)
        self.kind, self.settings = kind, light_settings(settings, kind)
        self.reads, self._cuts = frozenset(reads), frozenset(cuts)
        self.output_size = (settings.sequence.width, settings.sequence.height)
        self.size = kind.input_size(self.output_size)
        exact_settings = self.settings
        self.settings = self.settings.replace(width=self.size[0], height=self.size[1])
        self.timer = PassTimer(gpu)
        # The offset changes when every pixel was shaded once.  The cycle of the rate divides Halton's period: with an
        # offset per frame, a pixel would always be sampled in the same half or quarter of its area.
        period = {} if kind.upscale == 1 else {"period": kind.jitter_period}
        self._jitter = (lambda frame: jitter(frame // cycle(kind.rate), **period)) if kind.jitter else None
        extra = tuple(c for c in CHANNEL_INPUTS if c in self.reads and c not in ("position", "normal"))
        extra += ("ids",) if "history_ids" in self.reads else ()
        emits = decide(request.scene, self.settings)["emission"].enabled
        extra += ("emission",) if emits else ()  # part of radiance, also where there is no color pass
        extra += channels_for(self.reads)
        reshades = bool(set(RESHADED) & self.reads) and (kind.noisy or kind.path_samples) and kind.rate == "full"
        extra += CHANNELS_READ if reshades else ()
        shading = None if kind.exact else kind.shading()
        poser = request.poser or Poser(request.scene)
        scene, camera = request.scene, request.camera
        options = SourceOptions(extra, jitter=self._jitter, shading=shading)
        self.source = self.open_source(scene, camera, self.settings, options, timer=self.timer, poser=poser)
        needs_exact = bool(exact) or "exact_mask" in self.reads
        self.exact: Source | None = None if isinstance(exact, bool) else exact
        if needs_exact and self.exact is None:
            if kind.path_samples:
                raise SettingsError("path-traced input has no exact mask", hint="give --reference path-traced@M")
            self.exact = self.source
            if not kind.exact:
                unshared = SourceOptions(shading=Shading(gather_each=kind.noisy))
                self.exact = self.open_source(scene, camera, exact_settings, unshared, poser=poser)
        self.missing = missing_inputs(kind, traced="path_info" in self.source.channels)
        derived = tuple(name for name in with_needs(self.reads) if name not in self.missing)
        self._compose = self.own(ComposePass(
            self.context, self.size, self.settings, light_channels(self.source), rate=kind.rate,
            derived=derived, available=self.source.channels, samples=kind.samples,
        ))  # fmt: skip
        self._derived = self.own(DerivedInputs(self.context, self.size, derived, self.source.renderer.scene))
        self._masks = self._exact_masks = self.reshade = None
        if reshades and self.source.light is not None and self.source.light.written:
            self.reshade = self.own(Reshade(self.context, self.source, self.settings))
        if {"mask", "motion"} & self.reads or self.reshade is not None:
            self._masks = MaskInputs(self, self.source, self.settings, ())
        if needs_exact:
            self._exact_masks = MaskInputs(self, self.exact, exact_settings, self.exact.radiance)
        self._index, self._previous = 0, None

    def advance(self, frame: int) -> FrameInputs:
        """The inputs of ``frame``; textures are valid until the next call."""
        view = self.source.advance(frame)
        if self.exact not in (None, self.source):
            self.exact.advance(frame)
        with self.timer.measure("compose"):
            self._compose.run(self.source, frame)
        self._derived.run({**self.source.current, **self._compose.textures}, view)
        previous = self._previous or view
        declared = declared_reason(self._previous, frame, self._cuts)
        pair = reprojection(view, previous, *self.size, jitter=False)
        if self._masks is not None:
            self._masks.run(pair, declared)
        if self._exact_masks is not None:
            self._exact_masks.run(reprojection(view.centered(), previous.centered(), *self.output_size), declared)
        if self.reshade is not None:
            textures = {"mask": self._masks.mask, "motion": self._masks.motion}
            self.reshade.run(frame, pair, textures, self.kind.seed, not declared)
        out = FrameInputs(
            index=self._index,
            time=frame / self.settings.sequence.fps,
            textures=self._textures(),
            pair=pair,
            view=view,
            prev_view=previous,
            jitter_px=view.jitter_px,
            prev_jitter_px=previous.jitter_px,
            exposure=self.settings.lighting.exposure_factor,
            cut=frame in self._cuts,
            missing=self.missing,
        )
        self._index, self._previous = self._index + 1, view
        return out

    def _textures(self) -> Mapping[str, moderngl.Texture]:
        current, history = self.source.current, self.source.previous
        if self._previous is None:
            history = current  # the first frame has no history, but its inputs must be valid textures
        out = {"radiance": self._compose.radiance, **self._compose.textures, **self._derived.textures}
        out |= {name: current[name] for name in CHANNEL_INPUTS if name in self.reads}
        out |= {name: history[channel] for name, channel in HISTORY_INPUTS.items() if name in self.reads}
        if self._masks is not None:
            out |= {"mask": self._masks.mask, "motion": self._masks.motion}
        if self.reshade is not None:
            out |= self.reshade.textures
        if self._exact_masks is not None and "exact_mask" not in self.missing:
            out["exact_mask"] = self._exact_masks.mask
        return out

    @property
    def exact_mask(self) -> moderngl.Texture:
        return self._exact_masks.mask

    @property
    def exact_motion(self) -> moderngl.Texture:
        return self._exact_masks.motion

    def shading_ms(self) -> float:
        """Milliseconds spent on shading the current frame, by the clock of the timer."""
        samples = self.timer.samples_ms()
        return float(sum(samples[name][-1] for name in SHADING_PASSES if len(samples.get(name, ()))))

    @property
    def bytes(self) -> int:
        """GPU memory of the inputs: scene, targets, shadow maps and masks, without the exact source."""
        own = self.source.describe()["memory"]["gpu_bytes"] + self._compose.bytes + self._derived.bytes
        return own + sum(part.bytes for part in (self._masks, self.reshade) if part is not None)

    def describe(self) -> dict[str, Any]:
        """The block ``input`` of reuse.json."""
        source = self.source.describe()
        return {
            "kind": self.kind.text,
            "light_samples": self.kind.light_samples or None,
            "indirect_samples": self.kind.indirect_samples or None,
            "path_samples": self.kind.path_samples or None,
            "seed": self.kind.seed if self.kind.noisy or self.kind.path_samples else None,
            "size": list(self.size),
            "gpu_bytes": self.bytes,
            "effects": source["effects"],
            "notes": source["notes"],
        }


class ComposePass:
    """``radiance`` = (direct + indirect + emission, or the sky) times exposure; unshaded pixels are filled."""

    def __init__(
        self,
        context: GpuContext,
        size: tuple[int, int],
        settings: Settings,
        channels: tuple[str, ...],
        *,
        rate: str = "full",
        accumulate: bool = False,
        derived: Collection[str] = (),
        available: Collection[str] = (),
        samples: int = 1,
    ):
        """``channels``: the LIGHT_CHANNELS of the frames; ``accumulate``: sum weighted samples of one frame.

        ``derived``: those of ``derived.COMPOSED`` to write, from the ``available`` channels; ``samples``: of light in a
        shaded pixel.
        """
        self._samples = samples
        self._hazards, self._size, self._settings, self._rate = context.gpu.hazards, size, settings, rate
        declaration = ComputePass("reuse compose", ("reuse/compose.comp.glsl",))
        declaration.define(**{f"HAS_{c.upper()}": c in channels for c in LIGHT_CHANNELS})
        declaration.define(SHADING_RATE=RATES.index(rate), ACCUMULATE=accumulate)
        for name in ("position", *(c for c in LIGHT_CHANNELS if c in channels)):
            declaration.texture(name)
        self._environment = environment_of(settings)
        declare_environment(declaration, self._environment, lobes=False, owned=False)
        declaration.image("radiance_out", resource="radiance", access=UPDATE if accumulate else WRITE)
        declare_composed(declaration, derived, available)
        self.textures = {name: input_texture(context.gpu, name, size) for name in COMPOSED if name in derived}
        declaration.dispatch(size, Tuning(context.gpu.software).shading_group)
        self._pass = context.compute(declaration)
        self._accumulate = accumulate
        self.radiance = radiance_texture(context.gpu, size)

    @property
    def bytes(self) -> int:
        values = 4 + sum(texture.components for texture in self.textures.values())
        return 4 * values * self._size[0] * self._size[1]

    def run(self, source: RasterSource, frame: int = 0, share: float = 1.0) -> None:
        """Write ``radiance`` of the current frame of ``source``.

        ``share``: weight of this sample if samples add up, negative for the first sample.
        """
        values: dict[str, Any] = {"size": self._size, "exposure": self._settings.lighting.exposure_factor}
        if self._environment.kind == "image":
            rays = sky_directions(source.renderer.frame.view, *self._size)
            values |= zip(("sky_origin", "sky_dx", "sky_dy"), map(tuple, rays), strict=True)
        else:
            values["sky"] = self._environment.radiance
        if self._rate != "full":
            values["phase"] = phase(self._rate, frame)
        if self._accumulate:
            values["share"] = share
        if "sample_count" in self.textures:
            values["samples"] = float(self._samples)
        textures = {**source.renderer.frame.tables, **source.current, "radiance": self.radiance}
        self._pass.run(None, textures | written(self.textures), **values)
        self._hazards.publish()

    def release(self) -> None:
        for item in (self._pass, self.radiance, *self.textures.values()):
            item.release()


class MaskInputs:
    """``mask`` and ``motion`` of the current frame of a source, without jitter."""

    def __init__(self, owner: GpuOwner, source: Source, settings: Settings, radiance: tuple[str, ...]):
        """``owner``: frees them; ``radiance``: which of direct, indirect and color to compare; empty: geometry only."""
        self._hazards = owner.gpu.hazards
        self._evaluator = owner.open_evaluator(source, settings, images=True, radiance=radiance)
        declaration = ComputePass("reuse invalid motion", ("reuse/invalid_motion.comp.glsl",))
        declaration.glsl(*(f"const uint {bit.name} = {bit.value}u;" for bit in (Reason.BEHIND, Reason.INVALID)))
        declaration.glsl(f"const float FAR_AWAY_PX = {FAR_AWAY_PX};")
        declaration.texture("mask", "usampler2D").image("motion", "rg32f", access=WRITE)
        declaration.dispatch(self.mask.size, Tuning(owner.gpu.software).shading_group)
        self._fill = owner.own(owner.context.compute(declaration))
        for texture in (self.mask, self.motion):
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)

    @property
    def mask(self) -> moderngl.Texture:
        return self._evaluator.mask_texture

    @property
    def motion(self) -> moderngl.Texture:
        return self._evaluator.motion_texture

    @property
    def bytes(self) -> int:
        return 12 * self.mask.width * self.mask.height

    def run(self, pair: Reprojection, declared: int) -> None:
        """``pair``: without jitter; ``declared``: Reason.FIRST or CUT for the whole frame, else 0."""
        self._evaluator.submit(pair, declared=declared)
        self._fill.run(None, {"mask": self.mask, "motion": self.motion}, size=self.mask.size)
        self._hazards.publish()


def declared_reason(previous: View | None, frame: int, cuts: Collection[int]) -> int:
    """Reason.FIRST, Reason.CUT or 0 for the whole frame."""
    return Reason.FIRST if previous is None else Reason.CUT if frame in cuts else 0


def radiance_texture(gpu: Gpu, size: tuple[int, int]) -> moderngl.Texture:
    """An rgba32f texture without filtering."""
    texture = gpu.ctx.texture(size, 4, dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


def light_settings(settings: Settings, kind: InputKind) -> Settings:
    """``settings`` with every column; for noisy light with the light and indirect-light method that it estimates, for
    path-traced light with its samples, other ones in every pixel and frame.

    Raises SettingsError.
    """
    method: dict[str, Any] = {}
    if kind.path_samples:
        method = {"light": "path-traced", "spp": kind.path_samples, "pattern": "independent", "seed": kind.seed}
        method["indirect"] = "auto"
    if kind.noisy:
        if settings.lighting.light == "path-traced":
            raise SettingsError("noisy input is of the raster method", hint="give --input path-traced@N")
        method["light"] = "raster"
        if settings.lighting.indirect != "none":
            method["indirect"] = "rsm"
    return settings.replace(columns=COLUMNS, samples_per_pixel=1, **method)


def light_channels(source: RasterSource) -> tuple[str, ...]:
    """The LIGHT_CHANNELS of the source's frames."""
    return tuple(c for c in LIGHT_CHANNELS if source.effects[c].enabled)
