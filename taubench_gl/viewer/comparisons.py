"""Images that the viewer compares with its own: a reference, another run, the result of a reuse method."""

from __future__ import annotations

from pathlib import Path

import moderngl
import numpy as np

from taubench_gl.channels import CHANNELS
from taubench_gl.errors import SettingsError, TaubenchError
from taubench_gl.frame.targets import read_channel, write_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.reuse.bound import NO_HISTORY, Blended, bound_of_frame
from taubench_gl.reuse.derived import ComposePass
from taubench_gl.reuse.frame import FrameInputs, read_result
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.inputs import FrameRequest, RasterInputs
from taubench_gl.reuse.loading import builtin_methods, load_method
from taubench_gl.reuse.quality import display, reusable
from taubench_gl.reuse.references import emitting
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.sample_rays import SampleFrame, SampleRays
from taubench_gl.reuse.scores import NO_WEIGHT, weights, wrongly_reused
from taubench_gl.run import load_run
from taubench_gl.viewer.display import LIGHT, VISUALIZATIONS
from taubench_gl.viewer.feeds import Feed, OpenRequest, PathTracedFeed, SceneFeed, scene_feed, scene_of
from taubench_gl.viewer.state import METHOD_IMAGES, ViewerState

Array = np.ndarray
WARM_UP = 8
"""Number of frames that a reuse method runs first, where the frame asked for does not follow the last one."""


def open_comparisons(gpu: Gpu, request: OpenRequest, feed: Feed) -> dict[str, Comparison]:
    """What the frames of ``feed`` can be compared with, by name.  Raises TaubenchError."""
    comparisons: dict[str, Comparison] = {}
    with Owner().opening() as opened:
        if request.reference is not None:
            settings = feed.settings.replace(frames=(None, None))
            reference = opened.own(PathTracedFeed(gpu, request.reference, settings, request.options))
            comparisons["reference"] = PathTracedComparison(reference, feed)
        if request.run is not None:
            comparisons["run"] = run_comparison(gpu, request, feed)
        if isinstance(feed, SceneFeed):
            comparisons["method"] = MethodComparison(gpu)
    return comparisons


def run_comparison(gpu: Gpu, request: OpenRequest, feed: Feed) -> Comparison:
    """The scene of another run with that run's settings, at the size of ``feed``.  Raises TaubenchError."""
    run = load_run(request.run)
    width, height = feed.size
    settings = feed.settings.replace(width=width, height=height, frames=(None, None))
    text, settings = scene_of(run, OpenRequest(request.run, settings, given=frozenset({"size", "frames"})))
    if is_sequence(text):
        return PathTracedComparison(PathTracedFeed(gpu, text, settings, request.options), feed)
    return RunComparison(scene_feed(gpu, text, settings, PassTimer(gpu, enabled=False)))


class RunComparison(Owner):
    """A rasterized scene with the settings of another run."""

    name = "run"

    def __init__(self, feed: SceneFeed):
        super().__init__()
        self._feed = self.own(feed)

    def texture(self, channel: str, frame: int, feed: Feed, state: ViewerState) -> moderngl.Texture | None:
        """``channel`` of ``frame`` of the compared source, with its own camera; None if it has none.

        Raises TaubenchError.
        """
        if frame not in self._feed.frames or channel not in CHANNELS or channel == "motion":
            return None
        of_light = any(VISUALIZATIONS[name].channel == channel for name in LIGHT)
        off = frozenset() if of_light else frozenset(LIGHT.values())
        self._feed.plan(frozenset({channel}) - {"position", "normal"} - set(LIGHT), off, self._feed.live)
        if channel not in self._feed.source.channels:
            return None
        self._feed.show_one(self._feed.file_shot(frame))
        return self._feed.source.current[channel]


def version(method: str) -> tuple[tuple[str, int], ...]:
    """The files of a reuse method and when they were written last; empty for a built-in method or a module."""
    if method in builtin_methods():
        return ()
    path = Path(method if Path(method).exists() else method.rpartition(":")[0] or method)
    files = sorted(path.rglob("*")) if path.is_dir() else [path] if path.is_file() else []
    return tuple((str(file), file.stat().st_mtime_ns) for file in files if file.suffix in (".toml", ".glsl", ".py"))


class MethodComparison(Owner):
    """The result of a reuse method for the frames of a feed, as color; and the best blend of what it blended.

    A frame that does not follow the last starts again WARM_UP frames before it, and so does every frame once a file of
    the method has changed.  ``scores``: of ``frame``, by column of ``reuse evaluate``, where ghosts or the bound are
    asked for: these need the exact frames, so each frame takes longer.
    """

    name = "method"

    def __init__(self, gpu: Gpu):
        super().__init__()
        self._gpu = gpu
        self.frame: int | None = None  # of the images
        self.scores: dict[str, float | None] = {}
        self._key: tuple[object, ...] | None = None  # feed's settings, method, input, files, whether it is scored
        self._error: TaubenchError | None = None  # of that key
        self._inputs: RasterInputs | None = None
        self._runner: MethodRunner | None = None
        self._frame: FrameInputs | None = None  # inputs of ``frame``
        self._samples: SampleFrame | None = None  # of ``frame``, once a pixel is asked for
        self._reference: ComposePass | None = None  # light of the exact frames
        self._images: dict[str, moderngl.Texture] = {}  # of METHOD_IMAGES; alpha: 1 where history is wrongly reused
        self._missing: dict[str, str] = {}  # of what is not in them, or of "ghost" -> why

    def texture(self, channel: str, frame: int, feed: Feed, state: ViewerState) -> moderngl.Texture | None:
        if channel != "color":
            return None
        key = (feed.settings, state.method, state.method_input, version(state.method))
        stays = self._error is None and self._key == (*key, True)  # going on costs less than starting again
        scored = stays or state.comparison == "ghost" or state.method_image == "bound"
        if (*key, scored) != self._key:
            self._reset()
            self._key = (*key, scored)
            try:
                self._start(feed, state, scored)
            except TaubenchError as error:
                self._error = error
        if self._error is not None:
            raise self._error
        if frame != self.frame:
            try:
                self._run(frame, feed.frames[0])
            except TaubenchError as error:
                self._error = error
                raise
        for name in (state.method_image, state.comparison):
            if name in self._missing:
                raise SettingsError(f"{state.method} has no {name}: {self._missing[name]}")
        return self._images[state.method_image]

    def _start(self, feed: SceneFeed, state: ViewerState, scored: bool) -> None:
        method, kind = load_method(state.method), parse_input(state.method_input)
        if scored and not state.has_exact_frames:
            message = "ghosts and the bound are compared with exact frames, which path-traced input does not have"
            raise SettingsError(message, hint="choose another input, or the result with another comparison")
        settings = feed.settings.replace(reprojection="motion", history="frame")
        request = FrameRequest(self._gpu, feed.scene, feed.camera, settings, kind)
        reads = (*method.reads, "motion") if method.own_light else method.reads
        inputs = self._inputs = self.own(RasterInputs(request, reads, exact=scored))
        self._reference = ComposePass(inputs, inputs.exact, inputs.settings) if scored else None
        self._runner = self.own(MethodRunner(self._gpu, method, feed.size, input_size=inputs.size))
        self._images = {n: self.own(self._gpu.ctx.texture(feed.size, 4, dtype="f4")) for n in METHOD_IMAGES}

    def _run(self, frame: int, first: int) -> None:
        follows = self.frame is not None and frame == self.frame + 1
        if not follows:
            self._runner.reset()
        for number in range(frame if follows else max(frame - WARM_UP, first), frame + 1):
            inputs = self._inputs.advance(number)
            result = self._runner.step(inputs)
        result = read_result(result)
        self._write("result", result[..., :3], np.zeros(result.shape[:2], dtype=bool))
        self.frame, self._frame, self._samples = frame, inputs, None
        if self._reference is not None:
            self._score(inputs, result)

    def reservoir(self, x: int, row: int) -> str | None:
        """What the reservoir of a pixel of ``frame`` holds, in words; None for a method that reports none."""
        if self.frame is None or "kept_sample" not in self._runner.method.reports:
            return None
        if self._samples is None:
            moved = self._inputs.settings.metrics.threshold("position")
            with SampleRays(self._gpu, self._frame.light, self._inputs.size, moved) as rays:
                reported = self._runner.reported(self._frame)
                self._samples = rays.of(reported, self._frame.textures["motion"], np.zeros(0))
        return self._samples.words(x, row)

    def _score(self, inputs: FrameInputs, result: Array) -> None:
        """What ``reuse evaluate`` computes of one frame, against the light of the exact frame at pixel centers."""
        self._missing.clear()
        self._reference.run(self.frame)
        reference = read_result(self._reference.textures["radiance"])[..., :3]
        allowed = reusable(read_channel(self._inputs.exact_mask, "mask")[..., 0])
        valid = np.isfinite(reference).all(axis=-1) & np.isfinite(result).all(axis=-1)
        reference = np.where(valid[..., None], reference, 0.0)
        self.scores = dict(weights(result[..., 3], allowed))
        self._write("result", result[..., :3], wrongly_reused(result[..., 3], allowed))
        if self.scores["wrongly_reused_percent"] is None:
            self._missing["ghost"] = NO_WEIGHT
        radiance = read_result(inputs.textures["radiance"])
        blended = Blended.of(radiance, self._runner.reported(inputs))
        if blended is None:
            self._missing["bound"] = NO_HISTORY
            return
        exact = self._inputs.exact
        emitters = emitting(exact) if exact.effects["emission"].enabled else None
        self.scores |= bound_of_frame(blended, result, reference, valid, emitters).row
        best, weight = blended.masked(valid)[0].best(reference)
        self._write("bound", best, wrongly_reused(weight, allowed))

    def _write(self, name: str, radiance: Array, ghosts: Array) -> None:
        color = display(radiance, self._inputs.settings.lighting.tone_map)
        write_channel(self._images[name], "color", np.dstack([color, ghosts]))

    def _reset(self) -> None:
        self.release()
        self._runner = self._inputs = self._reference = self.frame = self._error = self._key = None
        self._images, self._missing, self.scores = {}, {}, {}
        self._frame = self._samples = None


def frame_offset(reference: Feed, shown: Feed) -> int:
    """Number of a reference's frame minus that of the frame it shows: 1 if it counts from 1 and only that explains its
    camera, else 0."""
    if reference.frames[0] != 1 or shown.frames[0] != 0:
        return 0
    number = min(reference.frames[-1], shown.frames[-1])
    try:
        camera = reference.file_shot(number).view
    except TaubenchError:  # a frame without a camera; asked for, it says so
        return 0

    def distance(frame: int) -> float:
        view = shown.file_shot(frame).view
        moved = np.linalg.norm(view.position - camera.position) / max(shown.radius, 1e-300)
        return float(moved + np.linalg.norm(view.world_from_view - camera.world_from_view))

    return 1 if distance(number - 1) < 0.5 * distance(number) else 0


class PathTracedComparison(Owner):
    """Path-traced frames to compare with those of ``shown``.  Raises SettingsError."""

    def __init__(self, feed: PathTracedFeed, shown: Feed):
        if feed.size != shown.size:
            got = "x".join(map(str, feed.size))
            raise SettingsError(f"the reference is {got} pixels", hint=f"give --size {got}")
        super().__init__()
        self._feed, self.name = self.own(feed), "reference"
        self._offset = frame_offset(feed, shown)
        self._read: int | None = None
        self._error: TaubenchError | None = None  # of that frame

    def texture(self, channel: str, frame: int, feed: Feed, state: ViewerState) -> moderngl.Texture | None:
        number = frame + self._offset
        if channel not in self._feed.source.channels or number not in self._feed.frames:
            return None
        if number != self._read:
            self._read, self._error = number, None
            try:
                self._feed.source.advance(number)
            except TaubenchError as error:
                self._error = error
        if self._error is not None:
            raise self._error
        return self._feed.source.current[channel]


Comparison = RunComparison | MethodComparison | PathTracedComparison
"""Anything with images of the frames of a feed; ``texture`` takes the same arguments in each class."""


def other_title(state: ViewerState, eyes: bool) -> str:
    """What the image is compared with, in words; ``eyes``: whether that is the other eye."""
    if eyes:
        return "the other eye"
    bound = "bound of " if state.method_image == "bound" else ""
    return f"{bound}{state.method}, input {state.method_input}" if state.against == "method" else state.against
