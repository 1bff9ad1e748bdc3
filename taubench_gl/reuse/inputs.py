"""The frames of a scene as inputs of reuse methods: one ``FrameInputs`` after another.

``Inputs`` is what frames of the rasterizer and of path-traced files (``file_inputs``) have in common.  ``RasterInputs``
renders them.  Its *input* source renders what methods get: jittered, noisy, or partly shaded.  Its *exact* source
renders the same frames without noise, at pixel centers, for ``exact_mask`` and for the evaluation; both are one source
where the input is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import CameraTrack, Poser, View
from taubench_gl.animation.eyes import other_eye
from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Reason
from taubench_gl.effects.decide import decide
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import frame_range
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.pairs import ChannelPair
from taubench_gl.features import COLUMNS
from taubench_gl.frame.passes.masks import ComparedSource
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import OTHER_EYE, RasterSource, Source
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import WRITE, ComputePass
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.metrics.shading_rate import cycle
from taubench_gl.reuse.contract import LIGHTS
from taubench_gl.reuse.derived import NEEDS, ComposePass, SurfacePass, channels_for, with_needs
from taubench_gl.reuse.frame import EYE_INPUTS, FAR_AWAY_PX, FrameInputs, read_result, texture_bytes
from taubench_gl.reuse.input_kind import InputKind
from taubench_gl.reuse.reshade import CHANNELS_READ, RESHADED, Reshade
from taubench_gl.reuse.scene_light import CHANNELS as LIGHT_CHANNELS
from taubench_gl.reuse.scene_light import SceneLight, refusal
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray
Textures = dict[str, moderngl.Texture]

CHANNEL_INPUTS = ("position", "normal", "prev_position", "base_color", "emission", "ids", "material")
HISTORY_INPUTS = {"history_position": "position", "history_normal": "normal", "history_ids": "ids"}

SHADING_PASSES = ("shadows", "direct", "indirect", "stochastic", "path tracing", "compose")
"""Passes that become cheaper with a coarser or noisier input."""


@dataclass(frozen=True, slots=True)
class FrameRequest:
    """What to render or read: shared by the inputs and the reference of an evaluation.

    ``scene`` and ``camera`` can be None for path-traced files.  ``poser``: of ``scene``, None: a new one; ``mapping``:
    names of the passes of files, as for ``load_mapping``.
    """

    gpu: Gpu
    scene: Scene | None
    camera: CameraTrack | None
    settings: Settings
    kind: InputKind
    poser: Poser | None = None
    mapping: str | None = None

    @property
    def animated(self) -> AnimatedScene:
        """The scene with its camera and poses, at the frame rate of the settings; files without a scene have none."""
        return AnimatedScene(self.scene, self.camera, self.poser).at_rate(self.settings.sequence.fps)


def missing_inputs(kind: InputKind, *, traced: bool) -> dict[str, str]:
    """Input that frames of ``kind`` do not have -> why.  ``traced``: their light is path-traced."""
    out = dict.fromkeys(EYE_INPUTS, "only rendered frames with both histories have the other eye (--history both)")
    if not (kind.noisy or kind.path_samples) or kind.rate != "full":
        why = "only noisy and path-traced light is shaded again, where every pixel is shaded"
        out |= dict.fromkeys(RESHADED, why)
    if not traced:
        out |= dict.fromkeys(("hit_distance", "variance"), "only path-traced light has it (--input path-traced@N)")
        out[LIGHTS] = "only path-traced input has light to sample (--input path-traced@N)"
    if kind.upscale != 1:
        out["exact_mask"] = "exact frames have the size of the output"
    for name, needs in NEEDS.items():
        if missing := next((out[need] for need in needs if need in out), None):
            out[name] = missing
    return out


class Inputs(GpuOwner):
    """Frames as inputs of methods.  Call ``advance`` for every frame in order.

    ``source``: of the input; ``exact``: of the same frames without noise, at pixel centers, None where there are none;
    ``size``: of the inputs, ``output_size``: of results, pixels; ``missing``: input -> why these frames lack it.
    """

    source: Source
    exact: Source | None
    size: tuple[int, int]
    output_size: tuple[int, int]
    settings: Settings
    missing: dict[str, str]
    in_turn = True
    """Whether the frames follow one another, so that measures of change from frame to frame have a meaning."""
    keeps_exact = False
    """Keep the exact masks for the sequences of other seeds, with the same frames."""

    def __init__(self, request: FrameRequest, reads: Collection[str], cuts: Collection[int]):
        """``reads``: names of INPUTS that every frame contains, unless ``missing``; ``cuts``: frames declared to
        have no history."""
        super().__init__(request.gpu)
        self.request, self.kind, self.reads = request, request.kind, frozenset(reads)
        self._cuts, self._index = frozenset(cuts), 0
        self._previous: View | None = None  # of the history
        self._last: View | None = None  # of the frame before, with which exact masks compare
        self._masks: MaskPass | None = None
        self._exact_masks: MaskPass | None = None
        self._kept: dict[int, tuple[bytes, bytes]] = {}  # exact masks and motion by frame

    def begin(self, seed: int) -> None:
        """The next frame is the first of a sequence with the random numbers of ``seed``."""
        self.kind = replace(self.kind, seed=seed)
        self._index, self._previous, self._last = 0, None, None

    def advance(self, frame: int) -> FrameInputs:
        """The inputs of ``frame``; textures are valid until the next call."""
        view, cut = self._draw(frame), frame in self._cuts
        if self._exact_masks is not None:
            last = self._last or view
            declared = Reason.FIRST if self._last is None else Reason.CUT if cut else 0
            self._run_exact(frame, reprojection(view.centered(), last.centered(), *self.output_size), declared)
        self._last = view
        return self._inputs_of(frame, frame, view, cut and not self.stereo)

    def before(self, frame: int) -> FrameInputs | None:
        """Inputs of a frame that methods run before ``frame``, without a score; None: of none.  It is called before
        ``advance``.

        Where the history is the other eye (``stereo``), that eye in ``frame``, which itself has no history.
        """
        if not self.stereo:
            return None
        return self._inputs_of(frame, frame + OTHER_EYE, self.source.advance_eye(frame), cut=True)

    @property
    def stereo(self) -> bool:
        """Whether the history of a frame is the other eye."""
        return self.settings.metrics.stereo

    def _inputs_of(self, frame: int, number: int, view: View, cut: bool) -> FrameInputs:
        """The inputs of the image drawn last.  ``number``: of its random numbers."""
        previous = self._previous or view
        declared = Reason.FIRST if self._previous is None else Reason.CUT if cut else 0
        pair = reprojection(view, previous, *self.size, jitter=False)
        if self._masks is not None:
            self._masks.run(pair, declared)
        textures = self._channels() | self._compute(number, view, pair, declared)
        light = self._light(number, view, previous, textures)
        out = FrameInputs(
            index=self._index,
            time=frame / self.settings.sequence.fps,
            textures=textures,
            pair=pair,
            view=view,
            prev_view=previous,
            jitter_px=view.jitter_px,
            prev_jitter_px=previous.jitter_px,
            exposure=self.settings.lighting.exposure_factor,
            cut=cut,
            missing=self.missing,
            light=light,
        )
        self._index, self._previous = self._index + 1, view
        return out

    def _run_exact(self, frame: int, pair: Reprojection, declared: int) -> None:
        """The exact masks of ``frame``: the same for every seed, so kept where the exact frames are drawn for them."""
        if frame in self._kept:
            self._exact_masks.write(*self._kept[frame])
            return
        if self.exact not in (None, self.source):
            self.exact.advance(frame)
        self._exact_masks.run(pair, declared)
        if self.keeps_exact and self.exact is not self.source:
            self._kept[frame] = self._exact_masks.mask.read(), self._exact_masks.motion.read()

    def _light(self, frame: int, view: View, previous: View, textures: Textures) -> SceneLight | None:
        """Lights and surfaces for methods that compute direct light themselves; None: no method does, or these frames
        lack it."""
        return None

    def _draw(self, frame: int) -> View:
        """Advance the source of the input to ``frame``; its view."""
        return self.source.advance(frame)

    def _compute(self, frame: int, view: View, pair: Reprojection, declared: int) -> Textures:
        """The inputs that are computed from channels, ``radiance`` among them; ``declared``: bits of the frame."""
        raise NotImplementedError

    def _channels(self) -> Textures:
        """The inputs that are channels, of this frame and of the previous one, and the masks."""
        current, history = self._sources()
        if self._previous is None:
            history = current  # the first frame has no history, but its inputs must be valid textures
        out = {name: current[name] for name in CHANNEL_INPUTS if name in self.reads and name in current}
        out |= {n: history[c] for n, c in HISTORY_INPUTS.items() if n in self.reads and c in history}
        if self._masks is not None:
            out |= {"mask": self._masks.mask, "motion": self._masks.motion}
        if self._exact_masks is not None and "exact_mask" not in self.missing:
            out["exact_mask"] = self._exact_masks.mask
        return out

    def _sources(self) -> tuple[Textures, Textures]:
        """Channels of this frame and of the previous one."""
        return dict(self.source.current), dict(self.source.previous)

    @property
    def frames(self) -> range:
        """Frame numbers to evaluate.  Raises SettingsError, and PathTracedError for gaps in files."""
        return frame_range(self.request.scene, self.request.camera, self.request.settings)

    @property
    def exact_mask(self) -> moderngl.Texture | None:
        """The mask of the exact frames; None: there are none."""
        return None if self._exact_masks is None else self._exact_masks.mask

    @property
    def exact_motion(self) -> moderngl.Texture | None:
        """The motion of the exact frames, pixels of the output; None: there are none."""
        return None if self._exact_masks is None else self._exact_masks.motion

    def shading_ms(self) -> float | None:
        """Milliseconds spent on shading the current frame, by the clock of the timer; None: unknown."""
        return None

    @property
    def bytes(self) -> int:
        """Bytes of GPU memory of the inputs, without the exact source."""
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        """The block ``input`` of reuse.json."""
        kind = self.kind
        return {
            "kind": kind.text,
            "light_samples": kind.light_samples or None,
            "indirect_samples": kind.indirect_samples or None,
            "path_samples": kind.path_samples or None,
            "seed": kind.seed if kind.noisy or kind.path_samples else None,
            "size": list(self.size),
            "gpu_bytes": self.bytes,
            "effects": {},
            "notes": [],
        }


class RasterInputs(Inputs):
    """Inputs rasterized from a scene."""

    def __init__(
        self,
        request: FrameRequest,
        reads: Collection[str],
        *,
        cuts: Collection[int] = (),
        exact: bool | Source = False,
        jitter: Callable[[int], Array] = halton_jitter,
        extra: Collection[str] = (),
    ):
        """Open the sources and compile the passes.  Raises SettingsError.

        ``extra``: channels of the source besides those of ``reads``; ``exact``: provide ``exact_mask`` and
        ``exact_motion`` even if no method reads them; or the source that they are of, which stays the caller's:
        path-traced inputs need one.
        """
        kind, settings = request.kind, request.settings
        self.output_size = (settings.sequence.width, settings.sequence.height)
        if kind.rate != "full" and min(self.output_size) < 2:
            raise SettingsError(f"shading rate {kind.rate!r} needs at least 2x2 pixels", hint="increase --size")
        super().__init__(request, reads, cuts)
        self.size = kind.input_size(self.output_size)
        every_column = light_settings(settings, kind)
        self.settings = every_column.replace(width=self.size[0], height=self.size[1])
        # Exact masks class pixels and measure change over time: they compare with the last frame, also in stereo.
        exact_settings = every_column.replace(history="frame")
        self.timer = PassTimer(request.gpu)
        self._reshades = bool(set(RESHADED) & self.reads) and (kind.noisy or kind.path_samples) and kind.rate == "full"
        self._samples_lights = LIGHTS in self.reads and kind.path_samples > 0
        self.source = self._open_source(sample_offset(kind, jitter), extra)
        # The caller's source if it passed one; else _open_exact's, which may be the input's: that has to be open.
        needs_exact = bool(exact) or "exact_mask" in self.reads
        self.exact = None if isinstance(exact, bool) else exact
        if needs_exact and self.exact is None:
            self.exact = self._open_exact(exact_settings)
        self.missing = missing_inputs(kind, traced="path_info" in self.source.channels)
        if self.stereo:
            self.missing["exact_mask"] = "exact masks compare with the last frame, the history is the other eye"
        self._open_passes()
        if needs_exact:
            self._exact_masks = MaskPass(self, self.exact, exact_settings, self.exact.radiance)

    def _open_source(self, offset: Callable[[int], Array] | None, extra: Collection[str]) -> RasterSource:
        """The source of the input.  ``offset``: frame -> sub-pixel offset (2,), None: pixel centers."""
        kind, emits = self.kind, decide(self.request.scene, self.settings)["emission"].enabled
        channels = (*extra, *(c for c in CHANNEL_INPUTS if c in self.reads and c not in ("position", "normal")))
        channels += ("ids",) * ("history_ids" in self.reads)
        channels += ("emission",) * emits  # part of radiance, also where there is no color pass
        channels += channels_for(self.reads)
        channels += CHANNELS_READ * self._reshades + LIGHT_CHANNELS * self._samples_lights
        shading = replace(Shading() if kind.exact else kind.shading(), both_frames=self._samples_lights)
        animated = self.request.animated
        return self.open_source(
            animated, self.settings, extra=channels, shading=shading, jitter=offset, timer=self.timer
        )

    def _open_exact(self, settings: Settings) -> RasterSource:
        """The source of the same frames without noise, at pixel centers: that of the input where it is exact."""
        if self.kind.path_samples:
            raise SettingsError("path-traced input has no exact mask", hint="give --reference path-traced@M")
        if self.kind.exact and not self.stereo:
            return self.source
        return self.open_source(self.request.animated, settings, shading=Shading(gather_each=self.kind.noisy))

    def _open_passes(self) -> None:
        """The passes that compute inputs from the channels of the source."""
        kind = self.kind
        derived = tuple(name for name in with_needs(self.reads) if name not in self.missing)
        self._compose = ComposePass(
            self, self.source, self.settings, rate=kind.rate, derived=derived, samples=kind.samples
        )
        self._derived = SurfacePass(self, self.size, derived, self.source.renderer.scene)
        self._lit_by = kind.seed
        self.reshade: Reshade | None = None
        if self._reshades and self.source.light is not None and self.source.light.written:
            self.reshade = Reshade(self, self.source, self.settings)
        self.scene_light: SceneLight | None = None
        if LIGHTS in self.reads and LIGHTS not in self.missing:
            if why := refusal(self.source):
                self.missing[LIGHTS] = why
            else:
                self.scene_light = SceneLight(self, self.source, self.settings, kind.seed)
        if {"mask", "motion"} & self.reads or self.reshade is not None:
            self._masks = MaskPass(self, self.source, self.settings, ())

    def _compute(self, frame: int, view: View, pair: Reprojection, declared: int) -> Textures:
        with self.timer.measure("compose"):
            self._compose.run(frame)
        self._lit_by = self.kind.seed
        self._derived.run({**self.source.current, **self._compose.textures}, view)
        out = {**self._compose.textures, **self._derived.textures}
        if self.reshade is not None:
            masks = {"mask": self._masks.mask, "motion": self._masks.motion}
            before = frame + OTHER_EYE if self.stereo else frame - 1
            self.reshade.run((frame, before), pair, masks, self.kind.seed, not declared)
            out |= self.reshade.textures
        return out

    def _draw(self, frame: int) -> View:
        return self.source.advance_camera(frame) if self.stereo else super()._draw(frame)

    def begin(self, seed: int) -> None:
        super().begin(seed)
        if self.source.light is not None:
            self.source.light.seed = seed
        if self.scene_light is not None:
            self.scene_light.begin(seed)

    def radiance(self, frame: int, seed: int) -> Array:
        """``radiance`` of ``frame``, which ``advance`` drew last, with the random numbers of ``seed``.

        (h, w, 4) float32, row 0 at the top, as methods get it.  Other inputs stay those of ``advance``.
        """
        if seed != self._lit_by:
            self.source.light_again(frame, seed)
            self._compose.run(frame)
        self._lit_by = seed
        return read_result(self._compose.textures["radiance"])

    def _light(self, frame: int, view: View, previous: View, textures: Textures) -> SceneLight | None:
        if self.scene_light is not None:
            self.scene_light.run(frame, view, previous, textures["emitted"])
        return self.scene_light

    def shading_ms(self) -> float:
        samples = self.timer.samples_ms()
        return float(sum(samples[name][-1] for name in SHADING_PASSES if len(samples.get(name, ()))))

    @property
    def bytes(self) -> int:
        """GPU memory of the inputs: scene, targets, shadow maps and masks, without the exact source."""
        total = texture_bytes(*self._compose.textures.values(), *self._derived.textures.values())
        total += sum(part.bytes for part in (self._masks, self.reshade, self.scene_light) if part is not None)
        return total + self.source.describe()["memory"]["gpu_bytes"]

    def describe(self) -> dict[str, Any]:
        source = self.source.describe()
        return super().describe() | {"effects": source["effects"], "notes": source["notes"]}


class OtherEye(GpuOwner):
    """The other eye beside the frames of ``inputs``: its frames, whose history is its own last one, and where it shows
    the surfaces of the camera.  Its random numbers are those of the seed SEED_OF_EYE further on."""

    def __init__(self, inputs: RasterInputs, cuts: Collection[int]):
        """Open the frames of the other eye.  Raises SettingsError."""
        super().__init__(inputs.gpu)
        request = inputs.request
        with self.opening():
            there = replace(
                request, camera=other_eye(request.scene, request.camera, request.settings), kind=self._kind(inputs)
            )
            self._inputs, reads = inputs, inputs.reads - {*EYE_INPUTS, "exact_mask"}
            self._there = self.own(RasterInputs(there, reads, cuts=cuts))
            self._pair = ChannelPair(inputs.size)
            self._masks = MaskPass(self, self._pair, inputs.settings, ())

    def _kind(self, inputs: Inputs) -> InputKind:
        return replace(inputs.kind, seed=(inputs.kind.seed + SEED_OF_EYE) % (2 * SEED_OF_EYE))

    def begin(self) -> None:
        """The next frame is the first of a sequence with the random numbers of ``inputs``."""
        self._there.begin(self._kind(self._inputs).seed)

    def advance(self, frame: int) -> FrameInputs:
        """The inputs of the other eye in ``frame``, which has no eye before it; call it before ``beside``."""
        eye = self._there.advance(frame)
        return self._with_eye(eye, eye, self._there, int(Reason.FIRST))

    def beside(self, frame: FrameInputs, eye: FrameInputs) -> FrameInputs:
        """The inputs of the camera, ``frame`` of ``inputs``, with ``eye`` as a second history."""
        return self._with_eye(frame, eye, self._inputs, 0)

    def _with_eye(self, frame: FrameInputs, eye: FrameInputs, inputs: RasterInputs, declared: int) -> FrameInputs:
        self._pair.current, self._pair.previous = dict(inputs.source.current), dict(self._there.source.current)
        self._masks.run(reprojection(frame.view, eye.view, *inputs.size, jitter=False), declared)
        result = eye.textures["radiance"]  # until the method has one
        eyes = {"eye_motion": self._masks.motion, "eye_mask": self._masks.mask, "eye_result": result}
        return replace(frame, textures={**frame.textures, **eyes})


SEED_OF_EYE = 32768
"""Half of all seeds."""


class MaskPass:
    """Computes ``mask`` and ``motion`` of the current frame of a source, without jitter."""

    def __init__(self, owner: GpuOwner, source: Source | ComparedSource, settings: Settings, radiance: tuple[str, ...]):
        """Compile the passes for frames of ``source``; ``owner`` frees them.

        ``radiance``: which of direct, indirect and color to compare; empty: geometry only.
        """
        self._hazards = owner.gpu.hazards
        self._evaluator = owner.open_evaluator(source, settings, images=True, radiance=radiance)
        self.mask, self.motion = self._evaluator.mask_texture, self._evaluator.motion_texture
        declaration = ComputePass("reuse invalid motion", ("reuse/invalid_motion.comp.glsl",))
        declaration.glsl(*(f"const uint {bit.name} = {bit.value}u;" for bit in (Reason.BEHIND, Reason.INVALID)))
        declaration.glsl(f"const float FAR_AWAY_PX = {FAR_AWAY_PX};")
        declaration.texture("mask", "usampler2D").image("motion", "rg32f", access=WRITE)
        declaration.dispatch(self.mask.size, Tuning(owner.gpu.software).shading_group)
        self._fill = owner.own(owner.context.compute(declaration))
        for texture in (self.mask, self.motion):
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)

    @property
    def bytes(self) -> int:
        """Bytes of GPU memory of both textures."""
        return texture_bytes(self.mask, self.motion)

    def write(self, mask: bytes, motion: bytes) -> None:
        """The contents of the textures of an earlier ``run``."""
        self.mask.write(mask)
        self.motion.write(motion)

    def run(self, pair: Reprojection, declared: int) -> None:
        """Write both textures.  ``pair``: reprojection without jitter; ``declared``: Reason.FIRST or CUT of the whole
        frame, else 0."""
        self._evaluator.submit(pair, declared=declared)
        self._fill.run(None, {"mask": self.mask, "motion": self.motion}, size=self.mask.size)
        self._hazards.publish()


def sample_offset(kind: InputKind, jitter: Callable[..., Array] = halton_jitter) -> Callable[[int], Array] | None:
    """Frame -> sub-pixel offset (2,) of its samples; None: all frames are sampled at pixel centers.

    The offset changes when every pixel was shaded once.  The cycle of the rate divides Halton's period: with an offset
    per frame, a pixel would always be sampled in the same half or quarter of its area.
    """
    if not kind.jitter:
        return None
    period = {} if kind.upscale == 1 else {"period": kind.jitter_period}
    return lambda frame: jitter(frame // cycle(kind.rate), **period)


def light_settings(settings: Settings, kind: InputKind) -> Settings:
    """``settings`` with every column, and with the method of light that an input of ``kind`` estimates.

    Path-traced light has its samples, other ones in every pixel and frame.

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
