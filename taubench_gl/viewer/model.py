"""The viewer without window, input and panels: runs actions, keeps state and engine consistent, records clips."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from taubench_gl.errors import TaubenchError
from taubench_gl.evaluation.explain import Explanation
from taubench_gl.features import FEATURES
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.timing import WALL_CLOCK, wall_time
from taubench_gl.outputs import write_png
from taubench_gl.report.video import Video
from taubench_gl.viewer import prefs, session_file
from taubench_gl.viewer.actions import run_action
from taubench_gl.viewer.comparisons import open_comparisons
from taubench_gl.viewer.controls import MASKS, SOURCE
from taubench_gl.viewer.engine import ViewerEngine
from taubench_gl.viewer.feeds import OpenRequest, open_feed
from taubench_gl.viewer.layout import Layout, arrange
from taubench_gl.viewer.names import PixelNames
from taubench_gl.viewer.state import HISTORY, ViewerState
from taubench_gl.viewer.timeline import Rates, Timeline

Array = np.ndarray
LIGHT = ("direct", "color", "emission")
"""Effects that start disabled on software OpenGL."""
FIRST_LOOKS = ("color", "base_color", "headlight")
"""Channels that the viewer opens with, the first that there is; without light the second."""


SMOOTHING = 0.2
"""Weight of the latest time in the moving average."""


def _first_look(channels: tuple[str, ...], wanted: tuple[str, ...]) -> str:
    """The first of ``wanted`` among ``channels``, else the last of it."""
    return next((name for name in wanted if name in channels), wanted[-1])


class LiveTimer:
    """Moving average of each pass's time, ``ms``; has the interface of ``gpu.timing.PassTimer``.

    It measures only while ``enabled``, because it waits for the GPU before and after each pass.
    """

    clock = WALL_CLOCK

    def __init__(self, gpu: Gpu):
        self._gpu, self.enabled = gpu, False
        self.ms: dict[str, float] = {}
        self.latest: frozenset[str] = frozenset()  # passes of the last update that had any
        self._measured: set[str] = set()  # since the last update began

    def update(self) -> None:
        """Tell the timer that the next update of the image begins."""
        if self._measured:
            self.latest = frozenset(self._measured)
            self._measured.clear()

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        """Measure the pass ``name``, if the timer is enabled."""
        if not self.enabled:
            yield
            return
        with wall_time(self._gpu, partial(self._record, name)):
            yield

    def _record(self, name: str, elapsed: float) -> None:
        self.ms[name] = elapsed + (1.0 - SMOOTHING) * (self.ms.get(name, elapsed) - elapsed)
        self._measured.add(name)


class ViewerModel(Owner):
    """State, engine and everything that actions change.

    ``light``: start with the LIGHT effects enabled; None: only where OpenGL is hardware.  ``folder``: where
    preferences are stored, None for nowhere.  Raises TaubenchError if ``request`` cannot be opened.
    """

    hint = "?: keys"
    camera_moves = False
    """Whether the user moves the camera now."""

    def __init__(self, gpu: Gpu, request: OpenRequest, *, light: bool | None = None, folder: Path | None = None):
        super().__init__()
        self.gpu, self._request, self._light, self._folder = gpu, request, light, folder
        self.timer = LiveTimer(gpu)
        stored, note = prefs.load(folder) if folder is not None else (prefs.Prefs(), "")
        self.window_size = stored.window or (0, 0)  # screen points; (0, 0) while minimized
        self.state, engine = self._open(request)
        self.engine = self.own(engine)
        self.timeline = self.own(Timeline(gpu, self.state.first, self.state.last))
        stored.apply(self.state)
        self.state.message = note or self.state.message
        self.screenshots = Path(".")  # folder of screenshots and clips
        self.clip: Video | None = None
        self.done = False
        self.fps = 0.0
        self._last_image: tuple[int, object] = (0, None)  # the image that was drawn last, for clips
        self._recorded: tuple[int, object] = (0, None)  # the masks whose rates the timeline got last
        self._probed: tuple[object, Explanation] | None = None
        self._named: tuple[object, PixelNames | None] | None = None

    def _open(self, request: OpenRequest) -> tuple[ViewerState, ViewerEngine]:
        with Owner().opening() as owner:
            return self._open_owned(owner, request)

    def _open_owned(self, owner: Owner, request: OpenRequest) -> tuple[ViewerState, ViewerEngine]:
        """State and engine for ``request``.  ``owner`` frees what was opened if a later step fails."""
        opened = open_feed(self.gpu, request, self.timer)
        feed = owner.own(opened.feed)
        comparisons = open_comparisons(self.gpu, request, feed)
        limits = {f: feed.settings.metrics.threshold(f) for f in FEATURES}
        channel = _first_look(feed.visualizations(), FIRST_LOOKS)
        state = ViewerState(
            first=feed.frames[0], last=feed.frames[-1], fps=feed.settings.sequence.fps, size=feed.size,
            effects=feed.switchable,
            thresholds=dict(limits), default_thresholds=limits, channel=channel,
            unit_scale=feed.settings.metrics.unit_scale, live=feed.live,
            nodes=() if feed.tree is None else feed.tree.labels,
        )  # fmt: skip
        if request.method is not None:  # beside the image from the start
            state.methods = (request.method, *(name for name in state.methods if name != request.method))
            state.method, state.beside = request.method, "method" in comparisons
        state.others = (*HISTORY, *comparisons)
        preferred = ("method", "reference", "run") if request.method is not None else ("reference", "run")
        state.against = next((name for name in preferred if name in comparisons), "reprojected")
        state.effect = state.effects[0] if state.effects else ""
        state.go_to(state.first + 1 if opened.frame is None else opened.frame)
        state.message = "; ".join(opened.notes)
        # A lesson is about what its light shows, a method about the image that it makes.
        lesson = request.restored is not None and request.restored.lesson
        dim = self.gpu.software and request.method is None and not lesson
        dark = self._light is False or (self._light is None and dim)
        if dark and set(LIGHT) & set(state.effects) and opened.frame is None:
            state.switched_off = frozenset(LIGHT) & set(state.effects)
            state.channel = _first_look(feed.visualizations(), FIRST_LOOKS[1:])
            state.message = "software OpenGL: light is disabled; enable it under effects, or start with --lighting"
        engine = owner.own(ViewerEngine(self.gpu, feed, self.timer, comparisons))
        engine.update(state)  # a scene that cannot be drawn is an error here, not later
        if request.restored is not None:
            request.restored.apply(state, engine.user)
            engine.update(state)  # now the image has the stored size, and channels depend on the effects
            misfits = request.restored.apply(state, engine.user)
            engine.update(state)
            state.message = f"restored without {', '.join(misfits)}" if misfits else "restored"
        return state, engine

    def reopen(self, request: OpenRequest) -> bool:
        """Open ``request``, or read the same source from disk again.  False, with nothing changed, if that fails."""
        try:
            state, engine = self._open(request)
        except TaubenchError as error:
            self.state.message = str(error)
            return False
        if self.clip is not None:
            self._toggle_clip()
        if request.restored is None:
            prefs.Prefs(values=prefs.kept(self.state)).apply(state)
        self._request, self.state, self.engine = request, state, self.own(engine, instead_of=self.engine)
        self.timeline = self.own(Timeline(self.gpu, state.first, state.last), instead_of=self.timeline)
        self._probed = self._named = None
        return True

    def drop(self, paths: list[str]) -> None:
        """Open the first of the files that were dropped on the window."""
        if paths:
            path = Path(paths[0])
            if session_file.is_session(path.name):
                self._restore(path)
                return
            exr = path.is_dir() and any(path.glob("[!.]*.exr"))
            source = f"exr:{path}" if exr else str(path)
            self.reopen(dataclasses.replace(self._request, source=source, reference=None, run=None, restored=None))

    def _restore(self, path: Path) -> None:
        """Open a session file; a message says why if that fails."""
        try:
            request = session_file.load(path, self._request.resolve)
        except TaubenchError as error:
            self.state.message = str(error)
            return
        self.reopen(request)

    def save_session(self, path: Path) -> bool:
        """Save what is open and how it is shown; False, with a message, if that fails."""
        return self._saved(path, lambda: session_file.save(path, self._request, self.state, self.engine.user))

    def act(self, name: str) -> None:
        """Run an action and serve its requests.  Raises KeyError for an unknown action."""
        run_action(name, self.state)
        for request in self.state.requests:
            self._serve(request)
        self.state.requests.clear()

    def _serve(self, request: str) -> None:
        if request == "quit":
            self.done = True
        elif request == "reset camera":
            self.engine.reset_camera(self.state)
        elif request == "reload":
            if self.reopen(dataclasses.replace(self._request, restored=None)):
                self.state.message = "reloaded from disk"
        elif request == "clip":
            self._toggle_clip()
        elif request == "save session":
            self.save_session(free_name(self.screenshots, self.stem, session_file.SUFFIX))
        elif request == "screenshot":
            self.screenshot(free_name(self.screenshots, self.stem, ".png"))

    @property
    def stem(self) -> str:
        """Start of the names of screenshots and clips: ``demo-00007``."""
        name = "".join(c if c.isalnum() or c in "-_" else "-" for c in self.engine.feed.name) or "view"
        return f"{name}-{self.state.frame:05d}"

    def screenshot(self, path: Path) -> bool:
        """Save the image as PNG; False, with a message, if that fails."""
        return self._saved(path, lambda: write_png(path, self.engine.picture()))

    def _saved(self, path: Path, save: Callable[[], None]) -> bool:
        """Run ``save``, which writes ``path``; False, with a message, if that fails."""
        try:
            save()
        except TaubenchError as error:
            self.state.message = str(error)
            return False
        self.state.message = f"saved {path.name}"
        return True

    def _toggle_clip(self) -> None:
        try:
            if self.clip is None:
                path = free_name(self.screenshots, self.stem, ".mp4")
                self.clip = Video(path, self.state.fps)
                self.state.message = f"recording {path.name}: F9 stops"
            else:
                self.clip.close()
                self.state.message, self.clip = f"saved {self.clip.path.name}, {self.clip.frames} frames", None
        except TaubenchError as error:
            if self.clip is not None:
                self.clip.discard()
            self.state.message, self.clip = str(error), None

    def tick(self, seconds: float) -> None:
        """Advance time by ``seconds`` and update the image."""
        self.state.moving = self.state.playing or self.camera_moves
        self.state.advance(seconds)
        self.timer.enabled = self.state.sections["time"] and self.state.panels
        self.timer.update()
        try:
            self.engine.update(self.state)
        except TaubenchError as error:  # such as an EXR file that was deleted: report it, keep the last image
            self.state.message, self.state.playing = str(error), False
        self._update_timeline()
        image = (self.engine.drawn.images, self.engine)
        if self.clip is not None and (self.clip.frames == 0 or image != self._last_image):
            try:
                self.clip.add(self.engine.picture())
            except TaubenchError as error:
                self.clip.discard()
                self.state.message, self.clip = str(error), None
        self._last_image = image

    def _update_timeline(self) -> None:
        """Keep the rates of the pair shown, and its image where the timeline has none."""
        s, engine = self.state, self.engine
        drawn = (engine.drawn.masks, engine)
        if drawn == self._recorded or s.camera != "file" or s.freeze_current or s.freeze_previous:
            return
        self._recorded = drawn
        key = s.restarted_by(MASKS, SOURCE)
        self.timeline.record(
            key, s.frame, Rates(engine.percentages(), engine.reusable()[1], engine.lights.active is not None)
        )
        if self.timeline.lacks_image(s.frame):
            self.timeline.show(s.frame, engine.image())

    @property
    def busy(self) -> bool:
        """Whether the image changes without input."""
        return self.state.busy or self.camera_moves or self.engine.lights.pending(self.state)

    @property
    def layout(self) -> Layout:
        """Layout of the window for the panels and images that are shown."""
        s = self.state
        tiles = len(self.engine.textures)
        return arrange(self.window_size, self.engine.feed.size, s.panels, bar=s.sections["playback"], tiles=tiles)

    def probe(self) -> Explanation | None:
        """The probed pixel, read from the GPU only if the pair or the pixel changed; None without a pixel."""
        s = self.state
        if s.probe is None or self.engine.pair is None or s.freeze_current:
            return None
        key = (s.probe, self.engine.drawn.masks, self.engine.drawn.plans)
        if self._probed is None or self._probed[0] != key:
            self._probed = (key, self.engine.explain(s))
        return self._probed[1]

    def probe_names(self) -> PixelNames | None:
        """Names of what the probed pixel shows; None without a pixel, and where names are not known."""
        explained = self.probe()
        if explained is None:
            return None
        key = (explained.pixel, self.engine.drawn.pairs, self.engine.drawn.plans)
        if self._named is None or self._named[0] != key:
            self._named = (key, self.engine.names_at(*explained.pixel))
        return self._named[1]

    def close(self) -> None:
        """Store the preferences, finish the clip, free the GPU resources."""
        if self.clip is not None:
            self._toggle_clip()
        if self._folder is not None:
            prefs.save(self._folder, self.state, self.window_size if min(self.window_size) > 0 else None)
        self.release()


def free_name(folder: Path, stem: str, suffix: str) -> Path:
    """``stem-1.png``, ``stem-2.png``, ...: the first name that is free."""
    number = 1
    while (folder / f"{stem}-{number}{suffix}").exists():
        number += 1
    return folder / f"{stem}-{number}{suffix}"
