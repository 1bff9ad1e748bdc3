"""Frames of a scene as reuse methods see them: one FrameInputs after another, with no more drawn than is read.

Two sources at most.  The *input* source draws what methods get: jittered, noisy, or only in part.  The *truth* source
draws the same frames exactly, at pixel centres, for ``truth_mask`` and for judging; where the input is exact, they are
one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import CameraTrack, Poser
from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import COLUMNS, Reason
from taubench_gl.errors import SettingsError
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.shading_rate import cycle
from taubench_gl.reuse.frame import FrameInputs
from taubench_gl.reuse.inputs_kind import InputKind
from taubench_gl.reuse.inputs_passes import LIGHT_CHANNELS, ComposePass, MaskInputs
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray

CHANNEL_INPUTS = ("position", "normal", "prev_position", "base_color", "emission", "ids")
HISTORY_INPUTS = {"history_position": "position", "history_normal": "normal", "history_ids": "ids"}

SHADING_PASSES = ("shadows", "direct", "indirect", "stochastic", "compose")
"""Passes whose time a coarser or noisier input saves."""


class RasterInputs:
    """Inputs rasterized from a scene.  ``advance`` is called for every frame in order."""

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        camera: CameraTrack,
        settings: Settings,
        kind: InputKind,
        reads: Collection[str],
        *,
        cuts: Collection[int] = (),
        truth: bool = False,
        poser: Poser | None = None,
        jitter: Callable[[int], Array] = halton_jitter,
    ):
        """``reads``: names of INPUTS that frames must hold; ``cuts``: frames declared to begin anew; ``truth``: keep
        ``truth_mask`` and ``truth_motion`` even if no method reads them."""
        if kind.rate != "full" and min(settings.sequence.width, settings.sequence.height) < 2:
            raise SettingsError(f"shading rate {kind.rate!r} needs 2x2 pixels at least", hint="raise --size")
        self.gpu, self.kind, self.settings = gpu, kind, light_settings(settings, kind)
        self.reads, self._cuts = frozenset(reads), frozenset(cuts)
        self.size = (settings.sequence.width, settings.sequence.height)
        self.timer = PassTimer(gpu)
        # One offset until every pixel was shaded once: the rate's period divides Halton's, so that with an offset per
        # frame a pixel would be sampled in the same half or quarter of its area for ever.
        self._jitter = (lambda frame: jitter(frame // cycle(kind.rate))) if kind.jitter else None
        poser = poser or Poser(scene)
        extra = tuple(c for c in CHANNEL_INPUTS if c in self.reads and c not in ("position", "normal"))
        extra += ("ids",) if "history_ids" in self.reads else ()
        shading = None if kind.exact else kind.shading()
        make = {"settings": self.settings, "poser": poser}
        self.source = RasterSource(
            gpu, scene, camera, timer=self.timer, jitter=self._jitter, shading=shading, extra=extra, **make
        )
        wants_truth = truth or "truth_mask" in self.reads
        self.truth: RasterSource | None = None
        if wants_truth:
            exact = Shading(gather_each=kind.noisy)
            self.truth = self.source if kind.exact else RasterSource(gpu, scene, camera, shading=exact, **make)
        self._context = GpuContext(gpu)
        self._compose = ComposePass(
            gpu, self._context.shaders, self.size, self.settings, lit_channels(self.source), rate=kind.rate
        )
        self._masks = self._truth_masks = None
        if {"mask", "motion"} & self.reads:
            self._masks = MaskInputs(self._context, self.source, self.settings, ())
        if wants_truth:
            self._truth_masks = MaskInputs(self._context, self.truth, self.settings, self.truth.radiance)
        self._index, self._before = 0, None

    def advance(self, frame: int) -> FrameInputs:
        """The inputs of ``frame``; textures are valid until the next call."""
        view = self.source.advance(frame)
        if self.truth not in (None, self.source):
            self.truth.advance(frame)
        with self.timer.measure("compose"):
            self._compose.run(self.source.current, frame)
        before = self._before or view
        cut = frame in self._cuts
        declared = Reason.FIRST if self._before is None else Reason.CUT if cut else 0
        size = self.size
        pair = reprojection(view, before, *size, jitter=False)
        if self._masks is not None:
            self._masks.run(pair, declared)
        if self._truth_masks is not None:
            self._truth_masks.run(reprojection(view.centered(), before.centered(), *size), declared)
        out = FrameInputs(
            index=self._index, time=frame / self.settings.sequence.fps, textures=self._textures(), pair=pair, view=view,
            prev_view=before, jitter_px=view.jitter_px, prev_jitter_px=before.jitter_px,
            exposure=self.settings.lighting.exposure, cut=cut,
        )  # fmt: skip
        self._index, self._before = self._index + 1, view
        return out

    def _textures(self) -> Mapping[str, moderngl.Texture]:
        current, history = self.source.current, self.source.previous
        if self._before is None:
            history = current  # a first frame has no history, but what it is given must be a picture
        out = {"radiance": self._compose.radiance}
        out |= {name: current[name] for name in CHANNEL_INPUTS if name in self.reads}
        out |= {name: history[channel] for name, channel in HISTORY_INPUTS.items() if name in self.reads}
        if self._masks is not None:
            out |= {"mask": self._masks.mask, "motion": self._masks.motion}
        if self._truth_masks is not None:
            out["truth_mask"] = self._truth_masks.mask
        return out

    @property
    def truth_mask(self) -> moderngl.Texture:
        return self._truth_masks.mask

    @property
    def truth_motion(self) -> moderngl.Texture:
        return self._truth_masks.motion

    def shading_ms(self) -> float:
        """Milliseconds that shading the frame in hand took, as the timer's clock tells."""
        samples = self.timer.samples_ms()
        return float(sum(samples[name][-1] for name in SHADING_PASSES if len(samples.get(name, ()))))

    @property
    def bytes(self) -> int:
        """GPU memory of what methods read: scene, targets, shadow maps and masks; that of the truth is not theirs."""
        own = self.source.describe()["memory"]["gpu_bytes"] + self._compose.bytes
        return own + (0 if self._masks is None else self._masks.bytes)

    def describe(self) -> dict[str, Any]:
        """What the result says of its input."""
        told = self.source.describe()
        return {
            "kind": self.kind.text,
            "light_samples": self.kind.light_samples or None,
            "indirect_samples": self.kind.indirect_samples or None,
            "seed": self.kind.seed if self.kind.noisy else None,
            "gpu_bytes": self.bytes,
            "effects": told["effects"],
            "notes": told["notes"],
        }

    def release(self) -> None:
        for part in (self._compose, self._masks, self._truth_masks, self.source):
            if part is not None:
                part.release()
        if self.truth not in (None, self.source):
            self.truth.release()
        self._context.release()


def light_settings(settings: Settings, kind: InputKind) -> Settings:
    """``settings`` as the sources need them: every column on, and for noisy light the rung whose estimate it is."""
    rung = {"indirect": "rsm"} if kind.noisy and settings.lighting.indirect != "none" else {}
    return settings.replace(columns=COLUMNS, samples_per_pixel=1, **rung)


def lit_channels(source: RasterSource) -> tuple[str, ...]:
    """Of LIGHT_CHANNELS, those that this source's frames have."""
    return tuple(c for c in LIGHT_CHANNELS if source.effects[c].enabled)
