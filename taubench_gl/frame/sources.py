"""Sources of channels: the frames of a sequence, one after another, as textures of known meaning.

The rasterizer is one source, path-traced files are another; one mask implementation compares the frames of both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol, Unpack

import numpy as np

from taubench_gl.animation import CameraTrack, View
from taubench_gl.animation.eyes import other_eye
from taubench_gl.animation.jitter import grid_offsets
from taubench_gl.animation.surface import previous_point
from taubench_gl.conventions import COUNTED, EQUAL
from taubench_gl.effects.decide import as_summary, unmeasured
from taubench_gl.effects.path_tracing import notes as light_notes
from taubench_gl.features import LIGHT_FEATURES, OTHERS
from taubench_gl.frame.light_stage import LightStage
from taubench_gl.frame.memory import require_frame_memory
from taubench_gl.frame.passes.visibility import CHANNEL as VISIBILITY
from taubench_gl.frame.passes.visibility import VisibilityPass
from taubench_gl.frame.plan import LIGHT, FrameOptions, frame_channels, frame_spec
from taubench_gl.frame.renderer import Renderer
from taubench_gl.frame.spec import AnimatedScene, FrameSpec
from taubench_gl.frame.targets import read_channel
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.settings import PREVIEWED, Settings

if TYPE_CHECKING:
    import moderngl


class Source(Protocol):
    """What an evaluation needs of a sequence.  ``advance`` is called for every frame in order."""

    size: tuple[int, int]
    reprojection: str  # the mode of this source: camera | motion
    radiance: tuple[str, ...]  # LIGHT_FEATURES that the source has
    others: tuple[str, ...]  # OTHERS that the source has
    unmeasured: Mapping[str, str]  # column -> why it is null
    cuts: bool  # ``current`` has ``ids`` that mark surfaces without history
    other: str  # the other reprojection: COUNTED, EQUAL, or why it is null

    def advance(self, frame: int) -> View:
        """Make ``frame`` the current frame and the current one the previous; the frame's view."""

    @property
    def current(self) -> Mapping[str, moderngl.Texture]: ...

    @property
    def previous(self) -> Mapping[str, moderngl.Texture]: ...

    def read(self, name: str, *, previous: bool = False) -> np.ndarray:
        """A channel as (h, w, components), row 0 at the top."""

    def hidden_backs(self) -> int:
        """Pixels of the current frame that are seen through a culled back of a face that casts shadows."""

    def describe(self) -> dict[str, Any]:
        """Summary blocks that depend on the kind of source: ``effects``, ``memory``."""

    def release(self) -> None: ...


FEW_TRIANGLES = 1_000_000
"""Triangles whose trees for rays take less memory while they are built, compiler included, than large images do."""

OTHER_EYE = 1 << 20
"""Added to the number of a frame for the random numbers of the other eye."""


class RasterSource(Owner):
    """Frames of a Scene, rasterized.  With ``history`` ``eye`` the previous image is that of the other eye.

    For ``both`` this is the source of the last frame (``evaluation.scene`` has the other one).
    """

    def __init__(
        self,
        gpu: Gpu,
        animated: AnimatedScene,
        settings: Settings,
        *,
        jitter: Callable[[int], np.ndarray] | None = None,
        timer: PassTimer | None = None,
        shaders: ShaderCache | None = None,
        **options: Unpack[FrameOptions],
    ):
        """``jitter``: frame -> sub-pixel offset (2,) of its samples, pixels; ``shaders``: compiled programs to share.

        ``options``: of ``frame_spec``, such as ``extra``, the channels besides those that the columns need.  Raises
        GraphicsError where a frame takes more memory than the limit.
        """
        super().__init__()
        tuning = Tuning(gpu.software, gpu.ctx.info["GL_MAX_TEXTURE_SIZE"])
        spec = frame_spec(animated.at_rate(settings.sequence.fps), settings, tuning=tuning, **options)
        require_frame_memory(spec)
        self._settings, self._fps, self._jitter = settings, settings.sequence.fps, jitter
        self.samples = settings.metrics.samples_per_pixel
        self._offsets = grid_offsets(self.samples)
        self.effects, self.size = spec.effects, spec.size
        # Where no surface moves by itself, motion reprojection is camera reprojection: nothing is stored for it.
        self.reprojection = settings.metrics.reprojection if self.effects["previous_pose"].enabled else "camera"
        self.unmeasured = unmeasured(self.effects, settings)
        self.other = COUNTED if self.effects["previous_pose"].enabled else EQUAL
        if settings.metrics.history == "both":
            self.other = "each pixel has one of two histories"
        self.cuts = self.effects["cuts"].enabled
        self.radiance = tuple(c for c in LIGHT_FEATURES if c not in self.unmeasured)
        self.others = tuple(c for c in OTHERS if c not in self.unmeasured)
        self.context = self.own(GpuContext(gpu, shaders, timer))
        stereo = settings.metrics.stereo
        self.eye = other_eye(animated.scene, animated.camera, settings) if stereo else None
        self.step = 1  # frames from the previous image to the next one that ``advance`` draws
        self._previous_time = 0.0  # seconds
        self.current_view: View | None = None
        self.previous_view: View | None = None
        with self.opening():
            self._open(spec)

    def _open(self, spec: FrameSpec) -> None:
        settings, animated = self._settings, spec.animated
        renderer = Renderer(
            self.context,
            spec.scene,
            animated.camera,
            self.size,
            frame_channels(spec),
            culling=settings.sequence.culling,
            textures=settings.sequence.textures,
            storage=settings.device.storage,
            normal_maps="normal_maps" in spec.enabled,
            poser=animated.poser,
        )
        self.renderer = self.own(renderer)
        # Every sample position has a history; scene, shadows and probes are shared.
        self._more = [self.own(renderer.new_history()) for _ in range(self.samples - 1)]
        self._history = renderer.history
        self.visibility = self.own(VisibilityPass(renderer, spec) if VISIBILITY in spec.extra else None)
        # Decoding images and building trees both take much memory for a while: what takes more of it comes first.
        if spec.animated.triangles < FEW_TRIANGLES:
            _ = renderer.materials.textures
        self.light = self.own(LightStage(renderer, spec) if any(declare(spec) for declare in LIGHT) else None)
        _ = renderer.materials.textures

    def advance(self, frame: int) -> View:
        return self._draw(frame, self._offset(frame))

    def advance_eye(self, frame: int) -> View:
        """Make the other eye the current image, before ``advance_camera``, with history ``eye``; its view."""
        return self._draw_eye(frame, self._offset(frame))

    def advance_camera(self, frame: int) -> View:
        """``advance`` without drawing its history: after ``advance_eye``."""
        return self._draw_camera(frame, self._offset(frame))

    def _offset(self, frame: int) -> np.ndarray | None:
        return None if self._jitter is None else self._jitter(frame)

    def advance_sample(self, frame: int, sample: int) -> View:
        """``advance`` for one of the ``samples`` positions within a pixel (``grid_offsets``), which has a history.

        ``current`` and ``previous`` are that sample's until the next call.
        """
        self._history = (self.renderer.history, *self._more)[sample]
        return self._draw(frame, self._offsets[sample] if self.samples > 1 else None)

    def draw_pair(
        self, frame: int, previous_frame: int, view: View, previous_view: View, *, light: bool = True
    ) -> View:
        """``advance`` with views and a previous frame that the caller chooses, for interactive cameras.

        ``light``: False leaves the light channels as they are; ``trace`` can light the frame.
        """
        self._history = self.renderer.history
        self._previous_time = previous_frame / self._fps
        self.renderer.draw(frame / self._fps, self._previous_time, views=(view, previous_view))
        if self.visibility is not None:
            self.visibility.run(self.renderer.frame)
        if light and self.light is not None:
            self.light.run(frame)
        return view

    def draw(self, frame: int) -> View:
        """``advance`` without light and without the other eye; ``trace`` lights it."""
        return self._rasterize(frame, self._offset(frame))

    def draw_history(self, frame: int) -> None:
        """Draw what is the history of ``frame``, without light: the frame before, or the other eye."""
        if self.eye is None:
            self.draw(frame - 1)
        else:
            self.draw_at(frame / self._fps, self._seen_by(self.eye, frame, None))

    def draw_at(self, time: float, view: View) -> None:
        """Draw the scene at ``time`` seconds from ``view``, without light."""
        self._previous_time = time
        self.renderer.draw(time, time, views=(view, view))

    def trace(self, number: int, first: int, count: int) -> None:
        """Light the current frame by samples ``first`` .. ``first + count - 1`` of path-traced light.

        ``number``: frame number of the sample pattern.
        """
        self.light.paths.first_sample, self.light.paths.sample_count = first, count
        self.light.run(number)

    def light_again(self, number: int, seed: int) -> None:
        """Light the current frame by other random numbers: those of ``seed`` and frame ``number``."""
        before, self.light.seed = self.light.seed, seed
        self.light.run(number)
        self.light.seed = before

    def listed_light(
        self,
        number: int,
        pixels: np.ndarray,
        keys: np.ndarray,
        samples: range,
        *,
        drawn: bool,
        seed: int | None = None,
        parts: bool = False,
    ) -> np.ndarray:
        """Path-traced light of pixels of the current frame, with option ``pixel_list``: (n, samples, k, 3) radiance.

        ``pixels``, ``keys`` (n, 2): column and row from the top; the sample numbers are those of pixel ``keys`` in
        frame ``number``, of the sequence ``seed`` (None: that of the settings) or, with ``parts``, of ``part_table``.
        Lobes: as of ``PathTracing.listed_light``.  ``drawn``: the frame is drawn again since the call before.
        """
        if drawn:
            self.light.run(number)
        paths, frame = self.light.paths, self.renderer.frame
        # Callers count rows from the top, GL memory from the bottom.
        rows = [np.stack([p[:, 0], self.size[1] - 1 - p[:, 1]], axis=-1) for p in (pixels, keys)]
        frame.number, paths.scramble = number, paths.scramble if seed is None else seed
        return paths.listed_light(frame, *rows, samples, parts=parts)

    @property
    def listed_lobes(self) -> tuple[str, ...]:
        """Names of the lobes of ``listed_light``, in order."""
        return self.light.paths.lobes

    @property
    def previous_time(self) -> float:
        """Time of the frame before the current one, seconds."""
        return self._previous_time

    def recolor(self) -> None:
        """Compute ``color`` of the current frame again, from light that the caller has changed."""
        self.light.run_color()

    def _draw(self, frame: int, offset: np.ndarray | None) -> View:
        if self.eye is not None:
            self._draw_eye(frame, offset)
        return self._draw_camera(frame, offset)

    def _draw_eye(self, frame: int, offset: np.ndarray | None) -> View:
        time, view = frame / self._fps, self._seen_by(self.eye, frame, offset)
        self.renderer.draw(time, time, views=(view, view), history=self._history)
        self.current_view = view
        if self.light is not None:
            self.light.run(frame + OTHER_EYE)
        return view

    def _draw_camera(self, frame: int, offset: np.ndarray | None) -> View:
        view = self._rasterize(frame, offset)
        self.previous_view, self.current_view = self.current_view or view, view
        if self.light is not None:
            self.light.run(frame)
        return view

    def _rasterize(self, frame: int, offset: np.ndarray | None) -> View:
        time = frame / self._fps
        if self.eye is None:
            self._previous_time = (frame - self.step) / self._fps
            self.renderer.draw(time, self._previous_time, offset, history=self._history)
        else:
            self._previous_time = time
            views = (self._seen_by(self.renderer.camera, frame, offset), self._seen_by(self.eye, frame, offset))
            self.renderer.draw(time, time, views=views, history=self._history)
        if self.visibility is not None:
            self.visibility.run(self.renderer.frame)
        return self.renderer.frame.view

    def _seen_by(self, camera: CameraTrack, frame: int, offset: np.ndarray | None) -> View:
        """The view of ``camera``, with the sub-pixel ``offset`` of the samples."""
        view = camera.view_at(self.renderer.view(frame / self._fps)[0])
        return view if offset is None else replace(view, jitter_px=np.asarray(offset, dtype=np.float64))

    @property
    def current(self) -> Mapping[str, moderngl.Texture]:
        return self._history.current.textures

    @property
    def previous(self) -> Mapping[str, moderngl.Texture]:
        return self._history.previous.textures

    @property
    def channels(self) -> tuple[str, ...]:
        return self.renderer.channels

    def read(self, name: str, *, previous: bool = False) -> np.ndarray:
        return read_channel((self.previous if previous else self.current)[name], name)

    def hidden_backs(self) -> int:
        occluded = any(self.effects[name].enabled for name in ("shadows", "path_traced"))
        return self.renderer.hidden_backs() if occluded else 0

    def previous_position(self, position: np.ndarray) -> np.ndarray | None:
        """Where the surface point at ``position`` was in the previous frame, both relative to the current camera.

        (3,) -> (3,) float64, scene units; for any ``reprojection``.  None where nothing is drawn.
        """
        frame, scene = self.renderer.frame, self.renderer.scene
        assert frame is not None
        before = self.renderer.poser.sample(self._previous_time)
        found = previous_point(scene, frame.state, before, frame.view.position + position)
        return None if found is None else found - frame.view.position

    def describe(self) -> dict[str, Any]:
        size = self.renderer.bytes + (0 if self.light is None else self.light.bytes)
        size += sum(history.bytes for history in self._more)
        size += 0 if self.visibility is None else sum(self.visibility.memory.values())
        enabled = frozenset(name for name, effect in self.effects.items() if effect.enabled)
        notes = light_notes(self.renderer.scene, self._settings, enabled)
        notes += [] if self.light is None else self.light.notes()
        if self._settings.lighting.light in PREVIEWED:  # whose columns may be of sampled light, without these limits
            notes = [f"preview: {note}" for note in notes]
        notes += [] if self.visibility is None else self.visibility.notes()
        return {"effects": as_summary(self.effects), "memory": {"gpu_bytes": size}, "notes": notes}
