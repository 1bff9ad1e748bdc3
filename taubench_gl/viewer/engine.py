"""From state to image: chooses the pair, renders what changed, evaluates the masks, counts.  No window."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import COUNTED, OTHER_REPROJECTION, Reason
from taubench_gl.errors import SettingsError, TaubenchError
from taubench_gl.evaluation import PairEvaluator
from taubench_gl.evaluation.exact import exact_channels
from taubench_gl.evaluation.explain import Explanation, with_light
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.features import FEATURES, LIGHT_FEATURES, TABLE
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics.counts import Counts, counts_of
from taubench_gl.metrics.display import object_motion
from taubench_gl.metrics.reprojection import Reprojection, reproject
from taubench_gl.metrics.reuse_rate import (
    NO_SURFACE,
    RATE_COLUMNS,
    RATES,
    disjoint_reasons,
    reusable_pixels,
    unmeasured_rates,
)
from taubench_gl.report.reusable import pair_sentence
from taubench_gl.viewer.cameras import UserCamera, frustum_lines
from taubench_gl.viewer.comparisons import Comparison, MethodComparison, other_title, version
from taubench_gl.viewer.controls import IMAGE, MASKS
from taubench_gl.viewer.display import (
    ARROW_STEP_PX,
    LIGHT_BITS,
    VISUALIZATIONS,
    Content,
    Display,
    FrozenCamera,
    Magnifier,
    Other,
)
from taubench_gl.viewer.exact import ExactMasks, exact_words
from taubench_gl.viewer.feeds import Feed, SceneFeed, Shot
from taubench_gl.viewer.light import REFINED, Lights
from taubench_gl.viewer.names import PixelNames, node_at
from taubench_gl.viewer.state import HISTORY, ViewerState

Array = np.ndarray
NAMES = frozenset({"ids"})
"""Channels that tell which object and material a pixel shows."""
CURRENT_COLOR, PREVIOUS_COLOR = (0.35, 0.85, 1.0), (1.0, 0.6, 0.2)


@dataclass(slots=True)
class Drawn:
    """Numbers of renders so far; a frame in which nothing changed renders nothing."""

    pairs: int = 0
    masks: int = 0
    images: int = 0
    plans: int = 0


@dataclass(slots=True)
class ViewerEngine:
    """Draws what a state asks for: pair, masks, counts and image.

    Every part has a key of everything it was made from, and is made again only when that changes.  ``timer`` measures
    the passes.
    """

    gpu: Gpu
    feed: Feed
    timer: Any
    comparisons: dict[str, Comparison] = field(default_factory=dict)  # value of the control ``against`` -> its images
    counts: dict[str, int] = field(default_factory=dict)
    reasons: dict[str, dict[str, int]] = field(default_factory=dict)  # rate -> disjoint reason -> pixels
    other_counts: dict[str, int] | None = (
        None  # rate -> reusable pixels under the other reprojection; None: not counted
    )
    histograms: dict[str, Array] = field(default_factory=dict)  # feature -> (bins,) pixels per bin of its distance
    drawn: Drawn = field(default_factory=Drawn)
    pair: Reprojection | None = None
    shots: tuple[Shot, Shot] | None = None  # previous, current
    user: UserCamera | None = None
    unmeasured: Mapping[str, str] = field(default_factory=dict)  # column of the pair -> why it is not measured
    arrow_scale: float = 1.0  # length of the arrows drawn last, per pixel of motion
    lights: Lights | None = None

    _owner: GpuOwner | None = None  # frees everything here, with the feed and the comparisons
    _evaluator: PairEvaluator | None = None  # compares pairs of the feed
    _reversed: PairEvaluator | None = None  # compares the other eye with the image as its history, once it is shown
    _active: PairEvaluator | None = None  # compared the pair shown; with coarse light its geometry alone
    _drawn_feed: Feed | None = None  # drew the pair shown; with coarse light a feed without light
    _observer: SceneFeed | None = None  # draws the view from outside
    _display: Display | None = None
    _mask_key: Any = None  # everything that the pair and its masks were made from
    _image_key: Any = None  # everything that the image was made from
    _content: Content | None = None  # what the image shows, without comparison
    _beside: list[Display] = field(default_factory=list)
    _magnifier: Magnifier | None = None
    _magnified: Any = None  # everything that the magnified images were made from
    _exact: ExactMasks | None = None
    _exact_key: Any = None  # ``_mask_key`` for which exact reasons were found
    _range_key: Any = None  # everything that the automatic range was made from
    _probe_place: tuple[tuple[int, int], tuple[float, float]] | None = None  # probed pixel and its place from 0 to 1
    _last: Shot | None = None  # what the camera saw at the last update
    _before: Shot | None = None  # the previous shot of the pair of the last update, with an interactive camera
    _frozen: dict[str, Shot | None] = field(default_factory=lambda: {"current": None, "previous": None})

    def __post_init__(self) -> None:
        self._owner = GpuOwner(self.gpu, self.timer)
        for part in (self.feed, *self.comparisons.values()):
            self._owner.own(part)
        self.lights = self._owner.own(Lights(self._owner.context, self.timer))
        self._exact = self._owner.own(ExactMasks(self.gpu))
        self._display = self._owner.own(Display(self.gpu, self.feed.size))
        self._magnifier = self._owner.own(Magnifier(self.gpu))
        self.user = UserCamera(self.feed.file_shot(self.feed.frames[0]).view, self.feed.center, self.feed.radius)

    @property
    def texture(self) -> moderngl.Texture:
        """The texture of the image that is shown, RGBA8, of the size of the feed."""
        return self._display.texture

    @property
    def source(self) -> Any:
        """The source of the pair shown, without its light where that is coarse."""
        return self._drawn_feed.source

    def names_at(self, x: int, row: int) -> PixelNames | None:
        """Names of what pixel (x, row from the top) of the image shows; None where they are not known."""
        return self._drawn_feed.names_at(x, row)

    @property
    def evaluator(self) -> PairEvaluator:
        """The evaluator that compared the pair shown: it holds mask and motion."""
        return self._active

    def reset_camera(self, state: ViewerState) -> None:
        """Move the camera of the user to that of the file at the current frame."""
        self.user.reset(self.feed.file_shot(state.frame).view)

    def update(self, state: ViewerState) -> None:
        """Update pair, masks and image to ``state``; unchanged parts are not rendered."""
        self._plan(state)
        previous, current = self._choose_pair(state)
        channel = VISUALIZATIONS[state.channel].channel
        coarse = self.lights.choose(state, self.feed, current, channel)
        shown = frozenset(VISUALIZATIONS[state.channel].channels) | self._exact_channels(state)
        shown |= self._names(state)
        self._drawn_feed = self.feed if coarse is None else self.lights.geometry(state, shown)
        changed = self._drawn_feed.show(previous, current)
        if changed:
            self.gpu.flush()  # it is drawn while light is prepared
        self.shots = previous, current
        first = self._first(state, previous, current)
        mask_key = (previous.key, current.key, first, coarse, state.restarted_by(MASKS))
        evaluate = changed or mask_key != self._mask_key
        if evaluate:
            self.drawn.pairs += changed
            self._submit(state, Reason.FIRST if first else 0)
            self._mask_key, self._exact_key = mask_key, None
        self._find_exact(state)
        self._pick(state)
        self._refine(state)
        try:
            self._update_image(state)
        finally:
            if evaluate:
                self._count()  # last: it waits for the GPU, which draws the image meanwhile

    def prepare(self, state: ViewerState) -> None:
        """While the GPU draws: pose the frame that playback shows next."""
        if state.playing and state.camera == "file" and self.feed.free:
            self.feed.file_shot(state.next_frame)

    def _refine(self, state: ViewerState) -> None:
        try:
            self.lights.refine(state)
        except TaubenchError as error:  # such as too little memory: rasterized light stays
            state.samples, state.message = 0, str(error)

    @staticmethod
    def _exact_channels(state: ViewerState) -> frozenset[str]:
        """Channels that exact reasons need, if the state shows them."""
        return frozenset(exact_channels()) if state.exact else frozenset()

    @staticmethod
    def _names(state: ViewerState) -> frozenset[str]:
        """Channels that name objects, where they are asked for: playback is faster without."""
        return NAMES if (state.probe, state.selection, state.pick) != (None, None, None) else frozenset()

    def _pick(self, state: ViewerState) -> None:
        """Select the node at the pixel that the user picked."""
        if state.pick is not None and self.feed.tree is not None and not state.freeze_current:
            state.selection = node_at(self.gpu, self.source, *state.pick)
        state.pick = None

    def visible(self, node: int) -> bool:
        """Whether a node of the scene is visible in the frame shown."""
        return bool(self.source.renderer.frame.state.visible[node])

    def _find_exact(self, state: ViewerState) -> None:
        """Find the exact reasons of the pair shown, if the state asks for them and they are not there yet."""
        if not state.exact or self._exact_key == self._mask_key:
            return
        try:
            self._exact.update(self._drawn_feed, self.shots[1].frame, self.mask(), state.switched_off)
            self._exact_key = self._mask_key
        except TaubenchError as error:  # such as too little memory
            state.exact, state.message = False, str(error)

    def _plan(self, state: ViewerState) -> None:
        """Let the feed provide what the state needs; a new source means new evaluators, keys and lists of choices."""
        fault = self._without_exact() if state.exact else None
        if fault is not None:
            state.exact, state.message = False, str(fault)
        shown = VISUALIZATIONS.get(state.channel)
        requested = state.live
        extra = frozenset(shown.channels if shown else ()) | self._exact_channels(state) | NAMES
        try:
            planned = self.feed.plan(extra, state.switched_off, requested)
        finally:
            state.live = self.feed.live  # also where the source cannot change
        if state.live != requested:
            state.message = "path-traced files have their light and their size"
        if planned or self._evaluator is None:
            for part in (self.lights, self._exact):
                part.reset()
            self._drawn_feed = self.feed
            if self._reversed is not None:
                self._owner.free_parts(self._reversed)
            self._reversed = None
            self._active = self._evaluator = self._owner.open_evaluator(
                self.feed.source, self.feed.settings, images=True, both=self.feed.source.other == COUNTED,
                instead_of=self._evaluator,
            )  # fmt: skip
            self._mask_key = self._image_key = self._magnified = None
            self.drawn.plans += 1
            self._resize(state)
            state.effects = self.feed.switchable
            state.channels = self.feed.visualizations()
            if state.channel not in state.channels:
                state.message = f"the source has no {state.channel.replace('_', ' ')} channel"
                state.channel = state.channels[0]

    def _without_exact(self) -> SettingsError | None:
        """Why the source has no exact reasons; None if it has them."""
        if not self.feed.free:
            return SettingsError("path-traced files have no surfaces to trace rays against")
        try:
            self.feed.settings.require_exact()
        except SettingsError as error:
            return error
        return None

    def _resize(self, state: ViewerState) -> None:
        """Draw images of the size of the feed; the probe stays at its place in the image."""
        size = self.feed.size
        if self._display.size == size:
            return
        self._display = self._owner.own(Display(self.gpu, size), instead_of=self._display)
        if state.probe is not None:
            if self._probe_place is None or self._probe_place[0] != state.probe:  # the user chose another pixel
                self._probe_place = state.probe, tuple((p + 0.5) / n for p, n in zip(state.probe, state.size))
            place = self._probe_place[1]
            state.probe = tuple(min(int(at * n), n - 1) for at, n in zip(place, size))
            self._probe_place = state.probe, place
        state.size = size
        self._owner.free_parts(self._observer)
        self._observer = None

    def _choose_pair(self, state: ViewerState) -> tuple[Shot, Shot]:
        """The pair to evaluate.  File camera: frames i-1 and i.  Interactive camera: the last and the current view.

        With history ``eye`` both eyes, of any camera.
        """
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
                last = Shot(before, last.view)  # history is the frame before, from the last view
            elif seen.key == last.key and self._before is not None:
                last = self._before  # nothing moved: the pair is unchanged
        current = self._freeze("current", state.freeze_current, seen)
        if state.freeze_current and state.camera != "file":
            last = Shot(before, seen.view)  # history of the frozen camera is the user's view
        self._before = last if state.camera != "file" else None
        self._last = seen
        if state.live.history == "eye" and not (state.freeze_current and state.camera != "file"):
            last = self.feed.other_eye(current)
        return self._freeze("previous", state.freeze_previous, last), current

    def _freeze(self, camera: str, frozen: bool, shot: Shot) -> Shot:
        """``shot``, or the one that ``camera`` (current or previous) had when it was frozen."""
        if not frozen:
            self._frozen[camera] = None
            return shot
        if self._frozen[camera] is None:
            self._frozen[camera] = shot
        return self._frozen[camera]

    def _first(self, state: ViewerState, previous: Shot, current: Shot) -> bool:
        """Whether there is no history: the first frame with the file camera."""
        if state.live.history == "eye":
            return False
        return state.camera == "file" and not state.freeze_previous and current.frame == state.first

    def _submit(self, state: ViewerState, declared: int) -> None:
        """Start the comparison of the pair, which gives mask and motion; ``_count`` reads its counts later.

        ``declared``: bits of ``Reason`` that every pixel has, such as FIRST.
        """
        previous, current = self.shots
        self.pair = reprojection(current.view, previous.view, *self.feed.size)
        coarse = self.lights.active is not None
        self.lights.draw(state, self.shots)  # before the masks, which wait for the geometry
        self._active = self.lights.evaluator if coarse else self._evaluator
        self._active.submit(self.pair, declared=declared, thresholds=state.thresholds)
        if coarse:
            self.lights.coarse.submit(self.shots, declared, state.thresholds)

    def _count(self) -> None:
        """Read the counts of the pair compared last."""
        counts = self._active.read()
        self.counts = counts_of(counts.mask_histogram)
        self.reasons = {rate: disjoint_reasons(counts.mask_histogram, rate) for rate in RATE_COLUMNS}
        self.other_counts = None if counts.other is None else reusable_pixels(counts.other)
        self.histograms = dict(zip(FEATURES, counts.histograms, strict=True))
        self.unmeasured = self.source.unmeasured
        if self.lights.active is not None:
            self._add_light(self.lights.coarse.read())
        self.drawn.masks += 1

    def _add_light(self, counts: Counts) -> None:
        """Add counts of coarse light, which come from fewer pixels, scaled to the number of pixels of the image."""
        coarse, self.other_counts = counts_of(counts.mask_histogram), None
        share = self.counts["pixels"] / coarse["pixels"]
        names = (*(bit.name.lower() for bit in LIGHT_BITS), "reusable_shading")
        self.counts |= {name: round(share * coarse[name]) for name in names}
        reasons = disjoint_reasons(counts.mask_histogram, "shading")
        self.reasons["shading"] = {name: round(share * pixels) for name, pixels in reasons.items()}
        light = {n: h for n, h in zip(FEATURES, counts.histograms, strict=True) if n in LIGHT_FEATURES}
        self.histograms |= {name: share * bins for name, bins in light.items()}
        missing = self.lights.coarse.unmeasured
        self.unmeasured = {**self.feed.source.unmeasured, **{n: missing[n] for n in light if n in missing}}

    def _update_image(self, state: ViewerState) -> None:
        """Draw the image and those beside it, if anything changed that they depend on."""
        observed = state.freeze_current
        shown = self._last if observed else self.shots[1]
        if self._image_key_of(state, shown) == self._image_key:
            return
        source, frozen = self.source, None
        if observed:
            source, frozen = self._observe(state, shown)
        self._set_range(state, source, shown)
        self._content = self._content_of(state, source, frozen)
        content = self._compared(state, self._content, observed)
        with self.timer.measure("image"):
            self._display.draw(content)
            self._lines(state, shown.view, source)
            if state.arrows and not observed:
                self.arrow_scale = state.arrow_scale or self._fitting_arrows()
                self._display.arrows(self._active.motion_texture, self.arrow_scale)
            self._draw_beside(state, content.other)
            self._outline(state, source)
        self.gpu.flush()  # it is drawn while the panels are built
        self.drawn.images += 1
        self._image_key = self._image_key_of(state, shown)  # with the automatic range

    def _image_key_of(self, state: ViewerState, shown: Shot) -> tuple[Any, ...]:
        """Everything that the image depends on."""
        files = version(state.method) if state.against == "method" else None
        drawn = (self._mask_key, shown.key, self.lights.samples, state.flicker_other, files)
        return (*drawn, *state.restarted_by(IMAGE))

    def _outline(self, state: ViewerState, source: Any) -> None:
        """Outline the selected node in every image."""
        if state.selection is not None:
            selected = self.feed.tree.draws_of(state.selection, source.renderer.draws)
            for display in (self._display, *self._beside):
                display.outline(source.current["ids"], selected)

    def _fitting_arrows(self) -> float:
        """Length of an arrow per pixel of motion, so that of the longest 5 % of arrows the shortest reaches a neighbor.

        At most 1000; 1 without motion.
        """
        grid = self.motion()[ARROW_STEP_PX // 2 :: ARROW_STEP_PX, ARROW_STEP_PX // 2 :: ARROW_STEP_PX]
        far = float(np.quantile(np.linalg.norm(grid, axis=-1), 0.95)) if grid.size else 0.0
        return min(ARROW_STEP_PX / far, 1000.0) if far > 0.0 else 1.0

    def _observe(self, state: ViewerState, shown: Shot) -> tuple[Any, FrozenCamera]:
        """The source that draws the view from outside, and the frozen camera as the image needs it."""
        current = self.shots[1].view
        clip = current.clip_from_relative(*self.feed.size)
        frozen = self.source.current["position"]
        return self._render_observer(state, shown), FrozenCamera(frozen, clip, shown.view.position - current.position)

    def _content_of(self, state: ViewerState, source: Any, frozen: FrozenCamera | None) -> Content:
        """What the image shows of one channel, without comparison.  ``frozen``: for a view from outside."""
        visual = VISUALIZATIONS[state.channel]
        lit = self.lights.source if frozen is None else None
        channels = (lit or source).current
        coarse = self.lights.coarse
        return Content(
            visual.kind,
            self._active.motion_texture if visual.channel == "motion" else channels[visual.channel],
            source.current["position"],
            self._exact.texture if state.exact else self._active.mask_texture,
            light_mask=None if coarse is None or frozen is not None else coarse.mask,
            low=state.low,
            high=state.high,
            shown=state.active_overlays(),
            opacity=state.opacity,
            split=state.split,
            gain=state.gain,
            frozen=frozen,
            prev_clip_from_prev=self.pair.prev_clip_from_prev,
            camera_delta=self.pair.camera_delta,
        )

    def _compared(self, state: ViewerState, content: Content, observed: bool) -> Content:
        """``content`` with the comparison of the state; a message says where there is nothing to compare with."""
        if state.comparison == "off" and not state.beside:
            return content
        if state.comparison == "ghost" and state.against != "method":
            state.message = "only a reuse method has ghosts: compare with method"
            return content
        try:
            other = None if observed else self.other(state)
        except TaubenchError as error:  # of a reuse method, for example: the image alone is shown
            state.message = str(error)
            return content
        if other is None:
            state.message = self._no_comparison(state)
            return content
        if state.beside:
            return replace(content, other=other)
        mode = state.comparison if state.comparison != "flicker" else "other" if state.flicker_other else "off"
        return replace(content, comparison=mode, other=other)

    def _draw_beside(self, state: ViewerState, other: Other | None) -> None:
        """Draw the other image and a map of errors or ghosts, if they are to be beside the image and there are any."""
        wanted = ("other", _map_beside(state)) if state.beside and other is not None else ()
        if len(self._beside) != len(wanted) or any(d.size != self._display.size for d in self._beside):
            self._owner.free_parts(*self._beside)
            self._beside = [self._owner.own(Display(self.gpu, self._display.size)) for _ in wanted]
        for mode, display in zip(wanted, self._beside, strict=True):
            content = replace(self._content, comparison=mode, other=other, shown=())
            if mode == "other" and self._shows_eyes(state):
                channels = {"channel": other.channel, "position": other.position, "mask": self._mask_of_eye(state)}
                content = replace(self._content, **channels)
            display.draw(content)

    def _shows_eyes(self, state: ViewerState) -> bool:
        """Whether the image beside is the other eye, with the masks of its own history, which is this image."""
        whole = not state.exact and self.lights.coarse is None
        return state.live.history == "eye" and state.against == HISTORY[0] and whole

    def _mask_of_eye(self, state: ViewerState) -> moderngl.Texture:
        """The mask of the other eye, whose history is this image: the pair with its shots exchanged."""
        if self._reversed is None:
            self._reversed = self._owner.open_evaluator(self.source, self.feed.settings, images=True)
        this, other = self.shots[1].view, self.shots[0].view
        images = {"current": self.source.previous, "previous": self.source.current}
        self._reversed.submit(reprojection(other, this, *self.feed.size), thresholds=state.thresholds, **images)
        return self._reversed.mask_texture

    @property
    def textures(self) -> tuple[moderngl.Texture, ...]:
        """The image and the images beside it, RGBA8."""
        return tuple(display.texture for display in (self._display, *self._beside))

    def titles(self, state: ViewerState) -> tuple[str, ...]:
        """A title for each of ``textures``, for the halves of a split image one each; empty for the image itself."""
        other = other_title(state, eyes=self._shows_eyes(state))
        halves = ("this image", other) if state.comparison == "split" and not state.freeze_current else ("",)
        return (*halves, other, f"{_map_beside(state)} x {state.gain:g}") if self._beside else halves

    def method_scores(self, state: ViewerState) -> Mapping[str, float | None]:
        """Columns of ``reuse evaluate`` for the method and frame compared with; empty where nothing needs them."""
        method = self._method(state)
        return {} if method is None else method.scores

    def reservoir_words(self, state: ViewerState, x: int, row: int) -> str | None:
        """What the reservoir of the method compared with holds at a pixel; None where it has none."""
        method = self._method(state)
        return None if method is None else method.reservoir(x, row)

    def _method(self, state: ViewerState) -> MethodComparison | None:
        """The reuse method that the frame shown is compared with; None if it is compared with something else."""
        method = self.comparisons.get(state.against)
        compared = isinstance(method, MethodComparison) and state.camera == "file" and method.frame == state.frame
        return method if compared else None

    def picture(self) -> Array:
        """The images of ``textures`` side by side, (h, w, 3) uint8, row 0 at the top."""
        return np.concatenate([display.read() for display in (self._display, *self._beside)], axis=1)

    def other(self, state: ViewerState) -> Other | None:
        """What the image is compared with: history, or a comparison; None where that has no such image."""
        channel = VISUALIZATIONS[state.channel].channel
        if state.against in HISTORY:
            return self._history_of(channel, state.against == "reprojected")
        comparison = self.comparisons.get(state.against)
        if comparison is None or state.camera != "file":
            return None
        texture = comparison.texture(channel, state.frame, self.feed, state)
        return (
            None
            if texture is None or texture.size != self.feed.size
            else Other(texture, self.source.current["position"])
        )

    def _history_of(self, channel: str, reprojected: bool) -> Other | None:
        """A channel of the previous frame; None for a channel that only pairs have."""
        coarse = self.lights.coarse if channel in REFINED else None
        previous = (coarse or self).source.previous
        if channel not in previous:
            return None
        motion = self._active.motion_texture if reprojected else None
        return Other(previous[channel], self.source.previous["position"], motion)

    def _no_comparison(self, state: ViewerState) -> str:
        """Why the image cannot be compared, and what to do about it."""
        channel = state.channel.replace("_", " ")
        if state.freeze_current:
            return "a view from outside is not compared: press C"
        if state.against in HISTORY:
            return f"history has no {channel}"
        if state.against not in self.comparisons:
            return f"there is no {state.against} to compare with"
        if state.camera != "file":
            return f"the {state.against} has the file's camera: press V"
        return f"{self.comparisons[state.against].name} has no {channel} of this frame"

    @property
    def magnified(self) -> moderngl.Texture | None:
        """The magnified images that ``magnify`` drew last; None before."""
        return self._magnifier.texture

    def magnify(self, state: ViewerState, explained: Explanation) -> moderngl.Texture:
        """The images of ``display.TILES`` around an explained pixel of the pair."""
        key = (self._image_key, explained.pixel, state.magnified)
        if key != self._magnified:
            height = self.feed.size[1]
            channel = VISUALIZATIONS[state.channel].channel
            at = None  # the history pixel, rounded as the masks do; OpenGL counts rows from the bottom
            if explained.at is not None:
                at = math.floor(explained.at[0] + 0.5), math.floor(height - 1 - explained.at[1] + 0.5)
            pixel = (explained.pixel[0], height - 1 - explained.pixel[1])
            content = self._content
            if self.lights.samples:  # history has the light of the light method
                content = replace(content, channel=self.source.current[channel])
            self._magnifier.draw(state.magnified, content, self._history_of(channel, True), pixel, at)
            self._magnified = key
        return self._magnifier.texture

    def _render_observer(self, state: ViewerState, shot: Shot) -> Any:
        """Render the scene from the user's camera while the current camera is frozen; its source."""
        if self._observer is None:
            feed = self.feed
            self._observer = self._owner.own(feed.beside(feed.settings))
        live = replace(self.feed.live, scale=1.0, stops=0.0)  # the settings of the feed have them
        extra = frozenset(VISUALIZATIONS[state.channel].channels) | self._names(state)
        self._observer.plan(extra, state.switched_off, live)
        self._observer.show_one(shot)
        return self._observer.source

    def _lines(self, state: ViewerState, view: View, source: Any) -> None:
        """Outline the frusta of frozen cameras in the image of ``view``."""
        if not state.frusta:
            return
        frozen = [(self.shots[0].view, PREVIOUS_COLOR)] if state.freeze_previous else []
        frozen += [(self.shots[1].view, CURRENT_COLOR)] if state.freeze_current else []
        width, height = self.feed.size
        for other, color in frozen:
            points = frustum_lines(other, width / height, 1.5 * self.feed.radius)
            self._display.lines(points, np.tile(color, (len(points), 1)), view, source.current["position"])

    def _set_range(self, state: ViewerState, source: Any, shown: Shot) -> None:
        """Set the automatic display range: the fixed one of the visualization, or smallest to largest value."""
        visual = VISUALIZATIONS[state.channel]
        if not state.auto_range:
            return
        key = (state.channel, shown.key, self._mask_key)
        if key == self._range_key:
            return
        self._range_key = key
        lit = self.lights.source if not state.freeze_current else None
        state.display_range = visual.fixed or self.value_range(visual.kind, visual.channel, lit or source)

    def explain(self, state: ViewerState) -> Explanation:
        """Why the probed pixel is kept or discarded; its light is that of the coarse pixel over it, if there is one."""
        explained = self._active.explain(*state.probe, thresholds=state.thresholds)
        if self.lights.active is None:
            return explained
        return with_light(explained, self.lights.coarse.explain(*state.probe, state.thresholds))

    def exact_words(self, x: int, row: int) -> str | None:
        """The exact reason of a pixel; None unless the masks are exact ones."""
        if self._exact_key is None or self._exact.bits is None:
            return None
        return exact_words(int(self._exact.bits[row, x]), self._exact.lit)

    def value_range(self, kind: str, channel: str, source: Any) -> tuple[float, float]:
        """Smallest and largest finite value of a channel on surfaces; (0, 1) without any."""
        if kind == "motion":
            values = np.linalg.norm(self.motion() if channel == "motion" else source.read(channel), axis=-1)
        elif kind == "object_motion":
            values = self.object_motion()
        else:
            surface = source.read("position")[..., 3] > 0
            values = source.read(channel)
            values = values[..., 3] if kind == "depth" else values[..., :3]
            values = values[surface]
        values = values[np.isfinite(values)]
        if not values.size:
            return 0.0, 1.0
        low, high = float(values.min()), float(values.max())
        low = 0.0 if kind in ("radiance", "motion", "object_motion") else low
        return low, high if high > low else low + 1.0

    def motion(self) -> Array:
        """Motion vectors, previous - current position in pixels, (h, w, 2), +y down, row 0 at the top."""
        return self._active.motion()

    def mask(self) -> Array:
        """Reason masks, (h, w) uint32, row 0 at the top."""
        return self._active.mask()

    def object_motion(self) -> Array:
        """Length of the motion vector without camera motion, pixels, (h, w)."""
        position = self.source.read("position").astype(np.float64)
        previous = self.source.read("prev_position").astype(np.float64)
        return object_motion(
            reproject(self.pair, position, previous).motion_px, reproject(self.pair, position).motion_px
        )

    def image(self) -> Array:
        """The image, (h, w, 3) uint8, row 0 at the top."""
        return self._display.read()

    def percentages(self) -> Mapping[str, float | None]:
        """Percent per count: of surface pixels for reuse rates, else of all pixels; None where it is not known."""
        pixels, missing = max(self.counts.get("pixels", 0), 1), self.unmeasured
        surface = pixels - self.counts.get("sky", 0)
        needs = {bit.name.lower(): (f.name,) for f in TABLE if f.light for bit in f.details}
        needs |= {f"reusable_{rate}": columns for rate, columns in RATE_COLUMNS.items()}
        out: dict[str, float | None] = {}
        out |= self._exact.percent
        for name in self.counts:
            absent = any(column in missing for column in needs.get(name, (name,)))
            base = surface if name.startswith("reusable") else pixels
            out[name] = None if absent or not base else 100.0 * self.counts[name] / base
        return out

    def reusable(self) -> tuple[str, float | None, str]:
        """The reuse rate of the pair: which one, in % of surface pixels, and a sentence with its largest reasons.

        ``shading``, or ``surface`` where light is not measured; None and why where neither is.
        """
        pixels, missing = self.counts.get("pixels", 0), unmeasured_rates(self.unmeasured)
        rate = next((r for r in reversed(RATES) if r not in missing), None)
        surface = pixels - self.counts.get("sky", 0)
        if rate is None or not surface:
            why = missing.get("surface", NO_SURFACE if pixels else "no pair")
            return "surface", None, f"reusable pixels are unknown: {why}"
        percent = 100.0 * self.counts[f"reusable_{rate}"] / surface
        shares = {name: 100.0 * count / surface for name, count in self.reasons[rate].items()}
        sky, rates = 100.0 * (pixels - surface) / pixels, {self.source.reprojection: percent}
        if self.other_counts is not None:
            rates[OTHER_REPROJECTION[self.source.reprojection]] = 100.0 * self.other_counts[rate] / surface
        return rate, percent, pair_sentence(rates, shares, rate, sky)

    def release(self) -> None:
        self._owner.release()


def _map_beside(state: ViewerState) -> str:
    """How the last of three images side by side combines the other two: ``ghost`` or ``error``."""
    return "ghost" if state.comparison == "ghost" else "error"
