"""From state to picture: which pair is shown, what must be drawn for it, and what was counted.  No window."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Reason
from taubench_gl.evaluation import PairEvaluator
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.metrics.counts import counts_of
from taubench_gl.metrics.display import motion_error
from taubench_gl.metrics.reprojection import Reprojection, reproject
from taubench_gl.viewer.cameras import UserCamera, frustum_lines
from taubench_gl.viewer.display import PICTURES, Content, Display, Held
from taubench_gl.viewer.feeds import Feed, SceneFeed, Shot
from taubench_gl.viewer.state import ViewerState

Array = np.ndarray
CURRENT_COLOR, PREVIOUS_COLOR = (0.35, 0.85, 1.0), (1.0, 0.6, 0.2)


class Comparison(Protocol):
    """What the image is compared with: a path-traced reference, or the result of a reuse method for the same frames."""

    name: str

    def texture(self, channel: str, frame: int) -> moderngl.Texture | None:
        """The same channel of the same frame, of the picture's size; None where there is none."""

    def release(self) -> None: ...


@dataclass(slots=True)
class Drawn:
    """How often what was done: a frame in which nothing changed does nothing."""

    pairs: int = 0
    masks: int = 0
    pictures: int = 0
    plans: int = 0


@dataclass(slots=True)
class ViewerEngine:
    """Keeps a picture up to date with a state.  ``timer``: given to the passes."""

    gpu: Gpu
    feed: Feed
    timer: Any
    comparison: Comparison | None = None
    counts: dict[str, int] = field(default_factory=dict)
    drawn: Drawn = field(default_factory=Drawn)
    pair: Reprojection | None = None
    shots: tuple[Shot, Shot] | None = None  # previous, current
    user: UserCamera | None = None

    _context: GpuContext | None = None
    _evaluator: PairEvaluator | None = None
    _observer: SceneFeed | None = None
    _display: Display | None = None
    _mask_key: Any = None
    _picture_key: Any = None
    _range_key: Any = None
    _last: Shot | None = None  # what the user's camera saw in the last update
    _before: Shot | None = None  # and what that was compared with
    _frozen: dict[str, Shot | None] = field(default_factory=lambda: {"current": None, "previous": None})

    def __post_init__(self) -> None:
        self._context = GpuContext(self.gpu, timer=self.timer)
        self._display = Display(self.gpu, self.feed.size)
        self.user = UserCamera(self.feed.file_shot(self.feed.frames[0]).view, self.feed.center, self.feed.radius)

    @property
    def picture(self) -> moderngl.Texture:
        return self._display.texture

    @property
    def evaluator(self) -> PairEvaluator:
        """Holds mask and motion of the pair shown."""
        return self._evaluator

    def reset_camera(self, state: ViewerState) -> None:
        self.user.reset(self.feed.file_shot(state.frame).view)

    def update(self, state: ViewerState) -> None:
        """Bring everything up to date; does nothing where nothing changed."""
        self._plan(state)
        previous, current = self._choose(state)
        changed = self.feed.show(previous, current)
        self.shots = previous, current
        first = self._first(state, previous, current)
        mask_key = (previous.key, current.key, first, tuple(sorted(state.thresholds.items())))
        if changed or mask_key != self._mask_key:
            self.drawn.pairs += changed
            self._evaluate(state, previous, current, first)
            self._mask_key = mask_key
        self._show(state)

    def _plan(self, state: ViewerState) -> None:
        picture = PICTURES.get(state.channel)
        if (
            self.feed.plan(frozenset(picture.channels if picture else ()), state.switched_off)
            or self._evaluator is None
        ):
            if self._evaluator is not None:
                self._evaluator.release()
            self._evaluator = PairEvaluator(self._context, self.feed.source, self.feed.settings, images=True)
            self._mask_key = self._picture_key = None
            self.drawn.plans += 1
            state.channels = self.feed.pictures()
            if state.channel not in state.channels:
                state.message = f"there is no {state.channel.replace('_', ' ')} to show now"
                state.channel = state.channels[0]

    def _choose(self, state: ViewerState) -> tuple[Shot, Shot]:
        """The pair to judge.  With the file's camera: frames i-1 and i.  Flying: what was seen just before, and now."""
        if not self.feed.free:
            state.camera, state.freeze_current, state.freeze_previous = "file", False, False
        before = max(state.frame - 1, state.first)
        if state.camera == "file":
            seen = self.feed.file_shot(state.frame)
            last = self.feed.file_shot(before)
        else:
            seen = Shot(state.frame, self.user.view())
            last = self._last or seen
            if seen.frame != last.frame:
                last = Shot(before, last.view)  # time moved on: its last frame is the one before
            elif seen.key == last.key and self._before is not None:
                last = self._before  # nothing moved: the pair stays
        current = self._freeze("current", state.freeze_current, seen)
        if state.freeze_current and state.camera != "file":
            last = Shot(before, seen.view)  # a held current camera is compared with where one stands
        self._before = last if state.camera != "file" else None
        self._last = seen
        return self._freeze("previous", state.freeze_previous, last), current

    def _freeze(self, which: str, on: bool, shot: Shot) -> Shot:
        if not on:
            self._frozen[which] = None
            return shot
        if self._frozen[which] is None:
            self._frozen[which] = shot
        return self._frozen[which]

    def _first(self, state: ViewerState, previous: Shot, current: Shot) -> bool:
        """Whether there is no history: the first frame, seen by the file's camera."""
        return state.camera == "file" and not state.freeze_previous and current.frame == state.first

    def _evaluate(self, state: ViewerState, previous: Shot, current: Shot, first: bool) -> None:
        self.pair = reprojection(current.view, previous.view, *self.feed.size)
        declared = Reason.FIRST if first else 0
        counts = self._evaluator.compare(self.pair, declared=declared, thresholds=state.thresholds)
        self.counts = counts_of(counts.mask_histogram)
        self.drawn.masks += 1

    def _show(self, state: ViewerState) -> None:
        observed = state.freeze_current
        shown = self._last if observed else self.shots[1]
        key = (
            self._mask_key, shown.key, state.channel, state.low, state.high, state.auto_range, state.active_overlays(),
            state.opacity, state.comparison, state.split, state.gain, state.arrows, state.frusta, observed,
            state.switched_off, state.freeze_previous,
        )  # fmt: skip
        if key == self._picture_key:
            return
        source = self.feed.source
        held = None
        if observed:
            source = self._look_on(state, shown)
            current = self.shots[1].view
            held = Held(
                self.feed.source.current["position"],
                current.clip_from_relative(*self.feed.size),
                shown.view.position - current.position,
            )
        picture = PICTURES[state.channel]
        texture = self._evaluator.motion_texture if picture.channel == "motion" else source.current[picture.channel]
        self._set_range(state, source, shown)
        other = None
        if self.comparison is not None and state.comparison != "off" and not observed and state.camera == "file":
            other = self.comparison.texture(picture.channel, state.frame)
        if state.comparison != "off" and other is None:
            state.message = self._no_comparison(state)
        with self.timer.measure("picture"):
            self._display.draw(
                Content(
                    picture.kind,
                    texture,
                    source.current["position"],
                    self._evaluator.mask_texture,
                    state.low,
                    state.high,
                    state.active_overlays(),
                    state.opacity,
                    state.comparison,
                    other,
                    state.split,
                    state.gain,
                    held,
                    self.pair.prev_clip_from_prev,
                    self.pair.camera_delta,
                )
            )
            self._lines(state, shown.view, source)
            if state.arrows and not observed:
                self._display.arrows(self._evaluator.motion_texture)
        self.drawn.pictures += 1
        self._picture_key = key[:3] + (state.low, state.high) + key[5:]

    def _no_comparison(self, state: ViewerState) -> str:
        if self.comparison is None:
            return "nothing to compare with: start with --reference exr:DIR"
        if state.camera != "file":
            return "the reference was rendered with the file's camera: press V"
        return f"{self.comparison.name} has no {state.channel.replace('_', ' ')} of this frame"

    def _look_on(self, state: ViewerState, shot: Shot) -> Any:
        """The scene as somebody sees it who walks around the held camera."""
        if self._observer is None:
            feed = self.feed
            self._observer = SceneFeed(self.gpu, feed.scene, feed.settings, self.timer, feed.camera)
        self._observer.plan(frozenset(PICTURES[state.channel].channels), state.switched_off)
        self._observer.look(shot)
        return self._observer.source

    def _lines(self, state: ViewerState, view: View, source: Any) -> None:
        if not state.frusta:
            return
        held = [(self.shots[0].view, PREVIOUS_COLOR)] if state.freeze_previous else []
        held += [(self.shots[1].view, CURRENT_COLOR)] if state.freeze_current else []
        width, height = self.feed.size
        for other, color in held:
            points = frustum_lines(other, width / height, 1.5 * self.feed.radius)
            self._display.lines(points, np.tile(color, (len(points), 1)), view, source.current["position"])

    def _set_range(self, state: ViewerState, source: Any, shown: Shot) -> None:
        """The automatic range: fixed where the picture has one, else least and largest value there are."""
        picture = PICTURES[state.channel]
        if not state.auto_range:
            return
        key = (state.channel, shown.key, self._mask_key)
        if key == self._range_key:
            return
        self._range_key = key
        state.low, state.high = picture.fixed or self.value_range(picture.kind, picture.channel, source)

    def value_range(self, kind: str, channel: str, source: Any) -> tuple[float, float]:
        """Least and largest finite value of a channel, over surfaces; (0, 1) where there is none."""
        if channel == "motion":
            values = np.linalg.norm(self.motion(), axis=-1)
        elif kind == "motion_error":
            values = self.motion_error()
        else:
            surface = source.read("position")[..., 3] > 0
            values = source.read(channel)
            values = values[..., 3] if kind == "depth" else values[..., :3]
            values = values[surface]
        values = values[np.isfinite(values)]
        if not values.size:
            return 0.0, 1.0
        low, high = float(values.min()), float(values.max())
        low = 0.0 if kind in ("radiance", "motion", "motion_error") else low
        return low, high if high > low else low + 1.0

    def motion(self) -> Array:
        """Previous - current, pixels, (h, w, 2), +y down, row 0 at the top."""
        return self._evaluator.motion()

    def mask(self) -> Array:
        """Reason words, (h, w) uint32, row 0 at the top."""
        return self._evaluator.mask()

    def motion_error(self) -> Array:
        """Pixels between where a surface point was and where a still world would have put it, (h, w)."""
        position = self.feed.source.read("position").astype(np.float64)
        previous = self.feed.source.read("prev_position").astype(np.float64)
        return motion_error(
            reproject(self.pair, position, previous).motion_px, reproject(self.pair, position).motion_px
        )

    def image(self) -> Array:
        """The picture, (h, w, 3) uint8, row 0 at the top."""
        return self._display.read()

    def percentages(self) -> Mapping[str, float | None]:
        """Percent of all pixels per overlay; None where its column is not measured."""
        pixels, missing = max(self.counts.get("pixels", 0), 1), self.feed.source.unmeasured
        needs = {"lit": "direct", "shadowed": "direct"}
        out: dict[str, float | None] = {}
        for name in self.counts:
            absent = needs.get(name, name) in missing
            out[name] = None if absent else 100.0 * self.counts[name] / pixels
        return out

    def release(self) -> None:
        for part in (self._evaluator, self._context, self._display, self._observer, self.comparison, self.feed):
            if part is not None:
                part.release()
        self.gpu.collect()


SMOOTH = 0.2


class LiveTimer:
    """Stands in for ``gpu.timing.PassTimer``: the latest times, smoothed, and only while ``enabled``."""

    clock = "finish + monotonic clock"

    def __init__(self, gpu: Gpu):
        self._gpu, self.enabled = gpu, False
        self.ms: dict[str, float] = {}

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        if not self.enabled:
            yield
            return
        self._gpu.finish()
        start = time.perf_counter()
        yield
        self._gpu.finish()
        taken = (time.perf_counter() - start) * 1e3
        self.ms[name] = taken + (1.0 - SMOOTH) * (self.ms.get(name, taken) - taken)
