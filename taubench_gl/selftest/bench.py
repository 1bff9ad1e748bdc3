"""Runs the pipeline on the scenes of the cases and returns every array that a case may test."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, View, choose_camera
from taubench_gl.animation import pairs as pairing
from taubench_gl.evaluation import ChannelPair, evaluate_scene
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.features import LIGHT_FEATURES
from taubench_gl.frame.renderer import Renderer
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import EXACT, AnimatedScene
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.metrics.counts import Counts, counts_of
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.run import Run
from taubench_gl.scene.model import Camera, Scene
from taubench_gl.settings import FIXED_LIGHTING, Settings

Array = np.ndarray
Size = tuple[int, int]


@dataclass(frozen=True, slots=True)
class PairImages:
    """One pair of frames as arrays, row 0 at the top.

    ``current`` and ``history``: channels (h, w, n) by name.  ``counts``: pixels by name; ``counted``: with histograms.
    """

    mask: Array  # (h, w) uint32 reason words
    motion: Array  # (h, w, 2) float32 previous - current, pixels, +x right, +y down; 0 where behind
    counts: Mapping[str, int]
    counted: Counts
    pair: Reprojection
    current: Mapping[str, Array]
    history: Mapping[str, Array]
    view: View | None = None
    previous_view: View | None = None

    @property
    def surface(self) -> Array:
        """Whether pixels show a surface in the current frame.  (h, w) bool."""
        return self.current["position"][..., 3] > 0

    def has(self, bits: int) -> Array:
        """Whether reason words have any of ``bits``.  (h, w) bool."""
        return (self.mask & np.uint32(bits)) != 0


@dataclass(frozen=True, slots=True)
class Shot:
    """One shaded frame: channels (h, w, n) float64 by name, row 0 at the top."""

    channels: Mapping[str, Array]
    view: View

    def __getitem__(self, name: str) -> Array:
        return self.channels[name]

    @property
    def points(self) -> Array:
        """Surface points, world space; the camera's position where there is no surface.  (h, w, 3) meters."""
        return self["position"][..., :3] + self.view.position

    @property
    def surface(self) -> Array:
        """Whether pixels show a surface.  (h, w) bool."""
        return self["position"][..., 3] > 0.0

    @property
    def direct(self) -> Array:
        """Direct radiance.  (h, w, 3)."""
        return self["direct"][..., :3]


class Bench(GpuOwner):
    """A GL context, an image size and shaders, shared by all cases."""

    def __init__(self, gpu: Gpu, size: Size = (96, 64), device: int | None = None):
        super().__init__(gpu)
        self.size, self.device = size, device

    @contextlib.contextmanager
    def even(self) -> Iterator[Bench]:
        """A bench of even width and height: with 1 m per pixel, pixel borders lie at integer meters."""
        with Bench(self.gpu, (self.size[0] - self.size[0] % 2, self.size[1] - self.size[1] % 2)) as bench:
            yield bench

    def pair(
        self,
        scene: Scene,
        times: tuple[float, float] = (0.0, 1.0),
        *,
        camera: CameraTrack | None = None,
        extra: Sequence[str] = (),
        size: Size | None = None,
        **metrics: Any,
    ) -> PairImages:
        """Render the frames at ``times`` (previous, current; seconds), compare them, and read all images back.

        ``extra``: further channels to render; ``size``: (width, height) in pixels, by default that of the bench;
        ``metrics``: fields of MetricsSettings.
        """
        size, settings = size or self.size, Settings(**metrics, **FIXED_LIGHTING)
        reprojection = settings.metrics.reprojection
        names = {"position", "normal", *extra} | ({"prev_position"} if reprojection == "motion" else set())
        cuts = bool(scene.replacements)
        names |= {"ids"} if cuts else set()
        camera = camera or choose_camera(scene)
        before, now = times
        with Owner() as owner:
            renderer = owner.own(Renderer(self.context, scene, camera, size, names))
            renderer.draw(before, before)
            previous_view = renderer.frame.view
            renderer.draw(now, before)
            view = renderer.frame.view
            pair = pairing.reprojection(view, previous_view, *size)
            textures = renderer.history.current.textures, renderer.history.previous.textures
            drawn = ChannelPair(size, *textures, reprojection=reprojection, cuts=cuts)
            compared = self._compare(drawn, settings, pair)
            current = {n: renderer.read(n) for n in renderer.channels}
            history = {n: renderer.read(n, previous=True) for n in renderer.channels}
            return PairImages(*compared, pair, current, history, view, previous_view)

    def frame(
        self,
        scene: Scene,
        time: float = 0.0,
        *,
        camera: CameraTrack | None = None,
        extra: Sequence[str] = (),
        culling: str = "gltf",
        size: Size | None = None,
    ) -> tuple[dict[str, Array], View]:
        """Channels (h, w, n) of one frame by name, and its view."""
        size, camera = size or self.size, camera or choose_camera(scene)
        names = {"position", "normal", *extra}
        with Owner() as owner:
            renderer = owner.own(Renderer(self.context, scene, camera, size, names, culling=culling))
            renderer.draw(time, time)
            return {n: renderer.read(n) for n in renderer.channels}, renderer.frame.view

    def shots(
        self,
        scene: Scene,
        frames: Sequence[int] = (0,),
        *,
        extra: Sequence[str] = (),
        shading: Shading = EXACT,
        **settings: Any,
    ) -> list[Shot]:
        """``frames`` of one source, shaded by the light stage, one frame per second.

        ``extra``: further channels to render; ``shading``: how light is sampled; ``settings``: fields of Settings.
        """
        values = self.settings_of({"columns": ("direct",), "fps": 1.0} | settings)
        with self._opened(scene, values, extra, shading) as source:
            out = []
            for frame in frames:
                view = source.advance(frame)
                out.append(Shot({n: source.read(n).astype(np.float64) for n in source.channels}, view))
            return out

    def traced(self, scene: Scene, *, extra: Sequence[str] = (), **settings: Any) -> dict[str, Array]:
        """Path-traced ``direct``, ``indirect`` and ``extra`` of the first frame.  ``settings``: fields of Settings."""
        options = {"columns": ("direct", "indirect"), "fps": 1.0, "light": "path-traced", "indirect": "auto"}
        values = self.settings_of(options | settings)
        with self._opened(scene, values, extra) as source:
            source.advance(0)
            return {n: source.read(n) for n in ("direct", "indirect", *extra)}

    @contextlib.contextmanager
    def _opened(
        self, scene: Scene, settings: Settings, extra: Sequence[str] = (), shading: Shading = EXACT
    ) -> Iterator[RasterSource]:
        with GpuOwner(self.gpu) as owner:
            yield owner.open_source(AnimatedScene(scene), settings, shading=shading, extra=extra)

    def evaluate(self, scene: Scene, **settings: Any) -> Run:
        """The whole evaluation of a scene.  ``settings``: fields of Settings."""
        return evaluate_scene(scene, self.settings_of(settings), camera=choose_camera(scene))

    def settings_of(self, fields: Mapping[str, Any]) -> Settings:
        """Settings with ``fields``, and else the device and size of the bench, raster light and fixed lighting."""
        # Indirect light takes long on a CPU driver: the cases that test it ask for it.
        options = {"backend": self.gpu.backend, "device": self.device, "indirect": "none", "light": "raster"}
        options |= {"width": self.size[0], "height": self.size[1]} | FIXED_LIGHTING
        return Settings(**(options | dict(fields)))

    def compare(
        self,
        current: Mapping[str, Array],
        history: Mapping[str, Array],
        pair: Reprojection | None = None,
        *,
        declared: int = 0,
        **metrics: Any,
    ) -> PairImages:
        """Compare arrays (h, w, n) with the mask pass, stored as float32.

        ``position`` and ``normal`` default to a still wall 1 m away.  Radiance is compared where ``current`` has it.
        ``declared``: reason bits of every pixel; ``metrics``: fields of Settings.
        """
        radiance = tuple(n for n in LIGHT_FEATURES if n in current)
        first = next(iter(current.values()), None)
        width, height = self.size if first is None else first.shape[1::-1]
        pair = pair or still_pair((width, height))
        wall = self.wall((width, height))
        current, history = {**wall, **current}, {**wall, **history}
        settings = Settings(**(FIXED_LIGHTING | metrics))
        with Owner() as owner:
            now = {n: owner.own(self._texture(v)) for n, v in current.items()}
            then = {n: owner.own(self._texture(v)) for n, v in history.items()}
            uploaded = ChannelPair((width, height), now, then, settings.metrics.reprojection, radiance)
            return PairImages(*self._compare(uploaded, settings, pair, declared), pair, current, history)

    def sky_counts(self, size: Size) -> dict[str, int]:
        """Counts of a still pair that shows only sky.  One 8-bit texture is used as every channel."""
        texture = self.gpu.ctx.texture(size, 4, dtype="f1")
        framebuffer = self.gpu.ctx.framebuffer([texture])
        channels = {"position": texture, "normal": texture}
        with GpuOwner(self.gpu, shaders=self.context.shaders) as owner:
            owner.own(texture)
            owner.own(framebuffer)
            sky = ChannelPair(size, channels, channels)
            evaluator = owner.open_evaluator(sky, Settings(**FIXED_LIGHTING))
            framebuffer.clear()
            return counts_of(evaluator.read(evaluator.submit(still_pair(size))).mask_histogram)

    def wall(self, size: Size) -> dict[str, Array]:
        """Position (h, w, 4) and normal (h, w, 3) of a wall 1 m in front of the camera of ``still_pair``."""
        position = np.ones((size[1], size[0], 4))
        position[..., :3] = rays(size, Camera())
        normal = np.zeros((size[1], size[0], 3))
        normal[..., 2] = 1.0
        return {"position": position, "normal": normal}

    def _compare(
        self, channels: ChannelPair, settings: Settings, pair: Reprojection, declared: int = 0
    ) -> tuple[Array, Array, Mapping[str, int], Counts]:
        """Mask, motion, counts by name, and counts with histograms, as in ``PairImages``."""
        with GpuOwner(self.gpu, shaders=self.context.shaders) as owner:
            evaluator = owner.open_evaluator(channels, settings, images=True)
            counts = evaluator.read(evaluator.submit(pair, declared=declared))
            return evaluator.mask(), evaluator.motion(), counts_of(counts.mask_histogram), counts

    def _texture(self, values: Array):
        height, width = values.shape[:2]
        full = np.zeros((height, width, 4), dtype=np.float32)
        full[..., : values.shape[-1]] = values[::-1]
        texture = self.gpu.ctx.texture((width, height), 4, full.tobytes(), dtype="f4")
        texture.filter = (0x2600, 0x2600)  # NEAREST
        return texture


def limits(thresholds: Mapping[str, float] | None) -> dict[str, float]:
    """Threshold of every feature by name: the defaults, overridden by ``thresholds``."""
    return dict(Settings(thresholds=thresholds or {}).metrics.thresholds)


def rays(size: Size, camera: Camera) -> Array:
    """Points on the plane z = -1 seen by the pixel centers of a perspective camera.  (h, w, 3) float64, view space.

    Computed from the definition of ``yfov``, independently of the projection matrix.
    """
    width, height = size
    tangent = np.tan(0.5 * camera.yfov)
    x = (2.0 * (np.arange(width) + 0.5) / width - 1.0) * tangent * width / height
    y = (1.0 - 2.0 * (np.arange(height) + 0.5) / height) * tangent
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    return np.concatenate([grid, np.full((height, width, 1), -1.0)], axis=-1)


def to_pixels(points: Array, size: Size, camera: Camera) -> Array:
    """Pixel-index coordinates (x, row) of view-space points of a perspective camera.  (..., 3) -> (..., 2)."""
    width, height = size
    tangent = np.tan(0.5 * camera.yfov)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = points[..., 0] / -points[..., 2] / (tangent * width / height)
        y = points[..., 1] / -points[..., 2] / tangent
    return np.stack([0.5 * (x + 1.0) * width - 0.5, 0.5 * (1.0 - y) * height - 0.5], axis=-1)


def pixel_grid(size: Size) -> Array:
    """Pixel-index coordinates (x, row) of every pixel.  (h, w, 2) float64."""
    return np.stack(np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float)), axis=-1)


def still_pair(size: Size, camera: Camera | None = None) -> Reprojection:
    """The reprojection of a still camera at the origin that looks along -Z."""
    view = View(np.zeros(3), np.eye(3), camera or Camera())
    return pairing.reprojection(view, view, *size)


def shifted_pair(size: Size, pixels: float) -> Reprojection:
    """The reprojection of a still camera whose previous image is shifted: history is at x + ``pixels``."""
    pair = still_pair(size)
    moved = pair.prev_clip_from_prev.copy()
    moved[0] += 2.0 * pixels / size[0] * moved[3]
    return dataclasses.replace(pair, prev_clip_from_prev=moved)


class MovingCamera:
    """A camera whose view is a function of time, independent of nodes."""

    name = "moving camera"

    def __init__(self, view_of: Callable[[float], View]):
        self._view_of = view_of

    def describe(self) -> str:
        return self.name

    def view_at(self, state) -> View:
        return self._view_of(state.time)
