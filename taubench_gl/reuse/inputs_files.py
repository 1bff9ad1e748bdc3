"""Path-traced frames at few samples as inputs of reuse methods: noise that no model of ours made up."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Reason
from taubench_gl.errors import PathTracedError
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.pathtraced.cameras import FittedCamera, SceneCamera
from taubench_gl.pathtraced.passes import PathTracedFrame
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.pathtraced.source import PathTracedSource
from taubench_gl.reuse.arrays import write_input
from taubench_gl.reuse.frame import FrameInputs
from taubench_gl.reuse.inputs import CHANNEL_INPUTS, HISTORY_INPUTS
from taubench_gl.reuse.inputs_kind import InputKind
from taubench_gl.reuse.inputs_passes import MaskInputs, picture_texture
from taubench_gl.reuse.inputs_reference import combined_radiance
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings


class _Remembering:
    """A PathTracedSequence that keeps its last frame: channels and combined pass share one decoding."""

    def __init__(self, sequence: PathTracedSequence):
        self._sequence, self._last = sequence, (None, None)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sequence, name)

    def read(self, frame: int, lobes: Collection[str] = ()) -> PathTracedFrame:
        if self._last[0] != frame:
            self._last = frame, self._sequence.read(frame, lobes)
        return self._last[1]


class FileInputs:
    """Inputs from ``exr:DIR``.  Geometry comes from the files' own passes, exact light from ``truth`` files if given.

    What methods read of the geometry and the files do not hold (path tracers rarely write previous positions or our
    ids) is rasterized from ``scene``, seen from the same camera.
    Without ``truth`` (many samples of the same frames) there is no ``truth_mask``: noise would count as change.
    """

    truth_mask = truth_motion = None

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene | None,
        camera: CameraTrack | None,
        settings: Settings,
        kind: InputKind,
        reads: Collection[str],
        *,
        cuts: Collection[int] = (),
        truth: str | None = None,
        mapping: str | None = None,
    ):
        """``truth``: ``exr:DIR`` of noise-free frames; ``mapping``: names of passes, as ``load_mapping`` takes it."""
        sequence = PathTracedSequence.open(kind.files, mapping=mapping)
        width, height = self.size = sequence.size
        self.kind, self._cuts = kind, frozenset(cuts)
        settings = settings.replace(width=width, height=height)
        if "prev_position" not in sequence.index:
            settings = settings.replace(reprojection="camera")
        self.settings, self.reads = settings, frozenset(reads)
        track = FittedCamera() if scene is None else SceneCamera(scene, camera, settings.sequence.fps)
        self._sequence = _Remembering(sequence)
        self.source = PathTracedSource(gpu, self._sequence, track, settings)
        self._drawn = None if scene is None else self._draw_missing(gpu, scene, camera, settings)
        self._context = GpuContext(gpu)
        self._masks = MaskInputs(self._context, self.source, settings, ())
        self._radiance = picture_texture(gpu, self.size)
        self.truth = self._truth_masks = None
        if truth is not None:
            exact = PathTracedSequence.open(truth, mapping=mapping)
            if exact.size != self.size:
                raise PathTracedError(
                    f"is {exact.size[0]}x{exact.size[1]} pixels, the input {width}x{height}", where=truth
                )
            self.truth = PathTracedSource(gpu, exact, track, settings)
            self._truth_masks = MaskInputs(self._context, self.truth, settings, self.truth.radiance)
            self.truth_mask, self.truth_motion = self._truth_masks.mask, self._truth_masks.motion
        self._index, self._before = 0, None

    def _draw_missing(self, gpu: Gpu, scene: Scene, camera: CameraTrack, settings: Settings) -> RasterSource | None:
        """A source of the channels that are read and not in the files; None if there are none."""
        read = {HISTORY_INPUTS.get(name, name) for name in self.reads} & set(CHANNEL_INPUTS)
        missing = tuple(sorted(read - set(self.source.channels)))
        if not missing:
            return None
        geometry = settings.replace(columns=("frustum",), textures="finest")
        return RasterSource(gpu, scene, camera, geometry, extra=missing)

    def frames(self, wanted: tuple[int | None, int | None]) -> range:
        """Frame numbers of the files within ``wanted``.  Raises PathTracedError on gaps."""
        return self._sequence.select(wanted)

    def advance(self, frame: int) -> FrameInputs:
        """The inputs of ``frame``; textures are valid until the next call."""
        view = self.source.advance(frame)
        for other in (self.truth, self._drawn):
            if other is not None:
                other.advance(frame)
        where = f"{self._sequence.path}, frame {frame}"
        radiance = combined_radiance(self._sequence.read(frame), self.settings.lighting.exposure, where)
        shaded = np.ones((*radiance.shape[:2], 1), dtype=np.float32)
        write_input(self._radiance, "radiance", np.concatenate([radiance, shaded], axis=-1))
        before, cut = self._before or view, frame in self._cuts
        pair = reprojection(view, before, *self.size)
        declared = Reason.FIRST if self._before is None else Reason.CUT if cut else 0
        for masks in (self._masks, self._truth_masks):
            if masks is not None:
                masks.run(pair, declared)
        out = FrameInputs(
            index=self._index, time=frame / self.settings.sequence.fps, textures=self._textures(), pair=pair, view=view,
            prev_view=before, jitter_px=np.zeros(2), prev_jitter_px=np.zeros(2),
            exposure=self.settings.lighting.exposure, cut=cut,
        )  # fmt: skip
        self._index, self._before = self._index + 1, view
        return out

    def _textures(self) -> dict[str, Any]:
        current, history = dict(self.source.current), dict(self.source.previous)
        if self._drawn is not None:
            current, history = {**self._drawn.current, **current}, {**self._drawn.previous, **history}
        history = current if self._before is None else history
        out = {"radiance": self._radiance, "mask": self._masks.mask, "motion": self._masks.motion}
        out |= {name: current[name] for name in CHANNEL_INPUTS if name in current}
        out |= {name: history[c] for name, c in HISTORY_INPUTS.items() if c in history}
        if self.truth_mask is not None:
            out["truth_mask"] = self.truth_mask
        return out

    def shading_ms(self) -> None:
        """Unknown: these pixels were shaded elsewhere."""
        return None

    @property
    def bytes(self) -> int:
        drawn = 0 if self._drawn is None else self._drawn.describe()["memory"]["gpu_bytes"]
        return 16 * self.size[0] * self.size[1] + self._masks.bytes + drawn

    def describe(self) -> dict[str, Any]:
        notes = [] if self._truth_masks else ["no truth mask: give noise-free files of the same frames as --reference"]
        if self._drawn is not None:
            missing = sorted(set(self._drawn.channels) & self.reads - set(self.source.channels))
            notes.append(f"rasterized, for the files do not hold it: {', '.join(missing)}")
        return {
            "kind": self.kind.text, "light_samples": None, "indirect_samples": None, "seed": None,
            "gpu_bytes": self.bytes, "effects": {}, "notes": notes,
        }  # fmt: skip

    def release(self) -> None:
        for part in (self._masks, self._truth_masks, self.source, self.truth, self._drawn):
            if part is not None:
                part.release()
        self._radiance.release()
        self._context.release()
