"""Renders the frames of an export: the requested channels of one frame after another, as arrays.

Backward motion and masks compare a frame with the previous one, which is rendered even if it is not exported, or with
history ``eye`` with the other eye.  Forward motion is rendered: the frame is drawn with the next pose as its previous
pose.  The first frame has no previous frame and the last no next frame; there, motion is NaN and the mask is FIRST.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import View
from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import ABSENT, NO_HISTORY, Reason
from taubench_gl.evaluation import PairEvaluator
from taubench_gl.evaluation.exact import ExactReasons, exact_channels
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.schedule import frame_total
from taubench_gl.export.channels import DISPARITY, EXACT_REASONS, RADIANCE
from taubench_gl.features import LIGHT_FEATURES
from taubench_gl.frame.read_back import ChannelReader, Image
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.frame.targets import History
from taubench_gl.gpu.context import Gpu
from taubench_gl.lobes import CHANNEL_EFFECT, SCENE_LOBES, lobe_channels
from taubench_gl.option_groups import NO_TRAINING, TrainingOptions
from taubench_gl.settings import Settings

if TYPE_CHECKING:
    from taubench_gl.export.training import TrainingLight

Array = np.ndarray
MARKS = np.uint32(NO_HISTORY | ABSENT)
NO_MOTION = int(Reason.FIRST | Reason.CUT | Reason.INVALID | Reason.BEHIND)
"""Pixels without motion: they have no position in the other frame."""

CV_FROM_VIEW = np.diag([1.0, -1.0, -1.0])
"""glTF view axes (+Y up, camera looks along -Z) -> computer vision axes (+Y down, camera looks along +Z)."""

FORWARD = ("motion_forward", "mask_forward")
_ALL_COMPONENTS = ("base_color", "material", "ids", "path_info", "mask", "mask_forward", "prev_visibility")


@dataclass(frozen=True, slots=True)
class ExportFrame:
    """One frame.  ``channels``: name -> (h, w, components); ``camera``: see ``camera_matrices``."""

    number: int
    time_s: float
    channels: dict[str, Array]
    camera: dict[str, Array]
    view: View


@dataclass(slots=True)
class _Submitted:
    """A rendered frame whose images are in flight: ``images`` of GPU channels, ``moved`` of motion and its mask."""

    number: int
    view: View
    images: dict[str, Image]
    moved: dict[str, tuple[Image, Image]]
    reasons: Array | None = None  # (h, w) exact reasons


def _columns(settings: Settings, names: tuple[str, ...]) -> tuple[str, ...]:
    """Columns whose light a source has to draw so that it has the channels ``names``."""
    columns = settings.metrics.columns if "mask" in names else ("frustum",)
    wanted = {*names, *(("direct", "indirect") if EXACT_REASONS in names else ())}
    columns += tuple(c for c in LIGHT_FEATURES if c in wanted and c not in columns)
    for column in ("direct", "indirect"):
        lobes = {*lobe_channels(SCENE_LOBES, (column,)), *(("path_info",) * (column == "direct"))}
        if lobes & set(names) and column not in columns:
            columns += (column,)
    return columns


def _extra_channels(names: tuple[str, ...]) -> tuple[str, ...]:
    """Channels besides those of columns that a source draws for the exported channels ``names``."""
    table = {"depth": "position", "motion": "prev_position", "motion_forward": "prev_position"}
    table |= {"mask_forward": "prev_position", "mask": "position", DISPARITY: "prev_position"}
    extra = [table.get(n, n) for n in names if n not in LIGHT_FEATURES and n != EXACT_REASONS]
    moved = ["ids"] * ("prev_position" in extra)  # they mark surfaces that are not there in the other frame
    return tuple(dict.fromkeys([*extra, *moved, *(exact_channels() if EXACT_REASONS in names else ())]))


class FrameSource(GpuOwner):
    """Renders any frame of a scene for export.

    ``names``: the requested channels that the scene has; ``unmeasured``: the other requested channels and the reason.
    """

    def __init__(
        self,
        gpu: Gpu,
        animated: AnimatedScene,
        settings: Settings,
        names: tuple[str, ...],
        *,
        jitter: str | Callable[[int], Array] = "none",
        buffered: bool | None = None,
        training: TrainingOptions = NO_TRAINING,
        two_sizes: bool = False,
    ):
        """Open what draws ``names``.

        ``jitter``: none, halton, or the offset of a frame, (2,) pixels, +x right, +y up; ``buffered``: as of
        ``ChannelReader``; ``two_sizes``: the input of ``training`` has a size and offsets of its own, the channels
        ``names`` have none, and frames also have ``input_depth``, ``input_motion`` and, beside the camera,
        ``input_jitter_px``.
        """
        super().__init__(gpu)
        self._animated = animated = animated.at_rate(settings.sequence.fps)
        self._count = frame_total(animated.scene, animated.camera, settings)
        self._reader = self.own(ChannelReader(gpu, buffered=buffered))
        self._jitter = jitter if callable(jitter) else halton_jitter if jitter == "halton" and not two_sizes else None
        exact = EXACT_REASONS in names
        if exact:
            settings.require_exact()
        self._settings = settings = settings.replace(columns=_columns(settings, names))
        self.source = self.open_source(animated, settings, extra=_extra_channels(names), jitter=self._jitter)
        self.unmeasured = {n: self._why_not(n) for n in names if n in RADIANCE and n not in self.source.channels}
        self.names = tuple(n for n in names if n not in self.unmeasured)
        self.training: TrainingLight | None = None
        self._input: FrameSource | None = None
        if training.wanted:
            from taubench_gl.export.training import TrainingLight, input_pixels, require_same_pixels  # late: 0.5 s

            if two_sizes:
                smaller, offset = input_pixels(training, settings)
                self._input = self.own(FrameSource(gpu, animated, smaller, ("depth", "motion"), jitter=offset))
            else:
                require_same_pixels(training, jitter)
            self.training = self.own(TrainingLight(gpu, animated, settings.replace(history="frame"), training))
        self._masks = self.open_evaluator(self.source, settings, images=True)
        self._motion: PairEvaluator | None = None
        if "prev_position" in self.source.channels:
            nearest = settings.replace(sampling="nearest")
            self.source.renderer.marks_absent = True
            self._motion = self.open_evaluator(
                self.source, nearest, images=True, reprojection="motion", radiance=(), absent=True
            )
        self._exact: ExactReasons | None = None
        if exact:
            radiance = {"direct", "indirect"} & set(self.source.radiance)
            self._exact = ExactReasons(partial(self.open_source, animated), settings, radiance)
        self._ahead: History | None = None
        if set(FORWARD) & set(self.names):
            self._ahead = self.own(History(gpu, self.source.size, self.source.channels, settings.device.storage))
        self._drawn: int | None = None
        self._views: list[View] = []

    def _why_not(self, name: str) -> str:
        column = "direct" if name == "path_info" else name.partition("_")[0]
        if column in self.source.unmeasured or name == column:
            return self.source.unmeasured.get(column, "the scene does not have it")
        if name in CHANNEL_EFFECT and not self.source.effects[CHANNEL_EFFECT[name]].enabled:
            return self.source.effects[CHANNEL_EFFECT[name]].reason
        return "no light is path-traced"

    def view(self, frame: int) -> View:
        """The view of any frame, without rendering."""
        view = self._animated.view_at(frame / self._settings.sequence.fps)
        return view if self._jitter is None else replace(view, jitter_px=self._jitter(frame))

    def frames(self, numbers: Iterable[int]) -> Iterator[ExportFrame]:
        """Render these frames, ascending.  With pixel buffers, a frame is read back while the next one is rendered."""
        waiting: _Submitted | None = None
        for frame in numbers:
            submitted = self._submit(frame)
            if waiting is not None:
                yield self._collect(waiting)
            waiting = submitted
            if not self._reader.buffered:
                yield self._collect(waiting)
                waiting = None
        if waiting is not None:
            yield self._collect(waiting)

    def _submit(self, frame: int) -> _Submitted:
        if self.source.eye is None and frame > 0 and self._drawn != frame - 1:
            self._advance(frame - 1)
        self._advance(frame)
        submitted = _Submitted(frame, self._views[-1], self._start(), {})
        self._backward(submitted)
        if self._exact is not None and self._has_history(frame):
            submitted.reasons = self._exact.of(self.source, frame).bits
        self._forward(submitted)
        return submitted

    def _has_history(self, frame: int) -> bool:
        return frame > 0 or self.source.eye is not None

    def _collect(self, submitted: _Submitted) -> ExportFrame:
        arrays = {name: image.get() for name, image in submitted.images.items()}
        arrays = _arrays(arrays) | {name: _motion(*images) for name, images in submitted.moved.items()}
        if DISPARITY in self.names:
            across = arrays["motion"][..., :1]
            arrays[DISPARITY] = -across if self._settings.metrics.eye == "left" else across
        if EXACT_REASONS in self.names:  # without a frame before: no bit
            none = np.zeros(self.source.size[::-1], dtype=np.uint32)
            arrays[EXACT_REASONS] = (none if submitted.reasons is None else submitted.reasons)[..., None]
        out = {name: np.ascontiguousarray(arrays[name]) for name in self.names}
        if not self._has_history(submitted.number) and "prev_visibility" in out:
            out["prev_visibility"] = np.zeros_like(out["prev_visibility"])  # no frame before: no bit
        if self.training is not None:
            out |= self.training.files(submitted.number)
        number, view = submitted.number, submitted.view
        camera = camera_matrices(view, *self.source.size)
        if self._input is not None:
            (seen,) = self._input.frames([number])
            out |= {f"input_{name}": values for name, values in seen.channels.items()}
            camera["input_jitter_px"] = seen.camera["jitter_px"]
        return ExportFrame(number, number / self._settings.sequence.fps, out, camera, view)

    def _advance(self, frame: int) -> None:
        self._views = [*self._views[-1:], self.source.advance(frame)]
        self._drawn = frame

    def _start(self) -> dict[str, Image]:
        read = {"position" if name == "depth" else name for name in self.names}
        current = self.source.current
        return {name: self._reader.start(current[name], name) for name in self.source.channels if name in read}

    def _start_motion(self) -> tuple[Image, Image]:
        motion, mask = self._motion.motion_texture, self._motion.mask_texture
        return self._reader.start(motion, "motion"), self._reader.start(mask, "mask")

    def _backward(self, submitted: _Submitted) -> None:
        declared = 0 if self._has_history(submitted.number) else int(Reason.FIRST)
        now = self._views[-1]
        before = now if declared else self._views[-2] if self.source.eye is None else self.source.previous_view
        previous = self.source.current if declared else self.source.previous
        if "mask" in self.names:
            pair = reprojection(now, before, *self.source.size)
            self._masks.submit(pair, declared=declared, previous=previous)
            submitted.images["mask"] = self._reader.start(self._masks.mask_texture, "mask")
        if {"motion", DISPARITY} & set(self.names):
            # The jitter of the two frames is not motion.
            pair = reprojection(now, before, *self.source.size, jitter=False)
            self._motion.submit(pair, declared=declared, previous=previous)
            submitted.moved["motion"] = self._start_motion()

    def _forward(self, submitted: _Submitted) -> None:
        if self._ahead is None:
            return
        frame, fps, renderer = submitted.number, self._settings.sequence.fps, self.source.renderer
        last = frame + 1 >= self._count
        here, there = self.view(frame), self.view(frame if last else frame + 1)
        renderer.draw((frame + 1) / fps, frame / fps, there.jitter_px, history=self._ahead)
        renderer.draw(frame / fps, (frame + 1) / fps, here.jitter_px, history=self._ahead, collapsed=True)
        pair = reprojection(here, there, *self.source.size, jitter=False)
        self._motion.submit(
            pair,
            declared=int(Reason.FIRST) if last else 0,
            current=self._ahead.current.textures,
            previous=self._ahead.previous.textures,
        )
        submitted.moved["motion_forward"] = self._start_motion()
        submitted.images["mask_forward"] = self._reader.start(self._motion.mask_texture, "mask")


def intrinsics(view: View, width: int, height: int) -> Array:
    """Intrinsic matrix K, (3, 3) float64, from computer vision axes to pixel-index coordinates: the center of the top
    left pixel is (0, 0), +y down.

    Perspective: pixel = K @ (X / Z, Y / Z, 1).  Orthographic: pixel = K @ (X, Y, 1).  Without jitter.
    """
    clip = view.centered().clip_from_view(width, height)
    focal_x, focal_y = 0.5 * width * clip[0, 0], 0.5 * height * clip[1, 1]
    return np.array(
        [[focal_x, 0.0, 0.5 * (width - 1) - focal_x * view.shift], [0.0, focal_y, 0.5 * (height - 1)], [0.0, 0.0, 1.0]]
    )


def extrinsics(view: View) -> Array:
    """Extrinsic matrix, (3, 4) float64, from the world to computer vision axes of the camera."""
    rotation = CV_FROM_VIEW @ view.world_from_view.T
    return np.column_stack([rotation, -rotation @ view.position])


def camera_matrices(view: View, width: int, height: int) -> dict[str, Array]:
    """Camera matrices of one frame, float64, by their names in files.  Matrices act on column vectors.

    ``world_from_view`` (4, 4); ``clip_from_view`` (4, 4), reversed Z in [0, 1], without jitter; ``intrinsics`` (3, 3);
    ``jitter_px`` (2,), +x right, +y DOWN: pixel i shows the point at i + jitter.
    """
    return {
        "world_from_view": math3d.affine(view.world_from_view, view.position),
        "clip_from_view": view.centered().clip_from_view(width, height),
        "intrinsics": intrinsics(view, width, height),
        "jitter_px": np.asarray(view.jitter_px, dtype=np.float64) * [1.0, -1.0] + 0.0,
    }


def _arrays(images: dict[str, Array]) -> dict[str, Array]:
    """Channels as they are exported: position and depth separate, without padding."""
    out = {n: a if n in _ALL_COMPONENTS else a[..., :3] for n, a in images.items()}
    if "ids" in out:
        out["ids"] = out["ids"] & ~MARKS
    return out | ({"depth": images["position"][..., 3:]} if "position" in images else {})


def _motion(motion: Image, mask: Image) -> Array:
    """Motion of every pixel, (h, w, 2) pixels; NaN where it has no position in the other frame."""
    values = motion.get()
    values[(mask.get()[..., 0] & NO_MOTION) != 0] = np.nan
    return values
