"""The stage of the demos (GL context, image size, passes of the engine) and the objects of their scenes.

Scenes are in world space, +Y up, meters.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Concatenate, ParamSpec

import numpy as np

from taubench_gl.animation import CameraTrack, choose_camera
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import Observers, Pair, evaluate_scene
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.inputs import FrameRequest, RasterInputs
from taubench_gl.reuse.loading import MethodSpec, load_method, method_settings
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.run import Run
from taubench_gl.scene.builder import SceneBuilder, box, quad, sphere, turn_x, turn_y
from taubench_gl.scene.model import Primitive, Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.settings import Settings

Array = np.ndarray
P = ParamSpec("P")
SIZE = (480, 270)
SMALLEST, LARGEST = (160, 90), (1920, 1080)
"""Smaller images have too few edge pixels for the theoretical values."""


@dataclass(frozen=True, slots=True)
class LitPair:
    """One evaluated pair as arrays, row 0 at the top.  ``now`` and ``before``: channels (h, w, n) of both frames."""

    mask: Array  # (h, w) uint32 reason masks
    motion: Array  # (h, w, 2) previous - current, pixels, +x right, +y down; 0 behind the camera
    now: Mapping[str, Array]
    before: Mapping[str, Array]

    def has(self, bits: int) -> Array:
        """Which pixels have any of ``bits``.  (h, w) bool."""
        return (self.mask & np.uint32(bits)) != 0

    def percent(self, bits: int) -> float:
        """The share of the pixels with any of ``bits``, percent."""
        return 100.0 * float(self.has(bits).mean())

    def change(self, channel: str) -> Array:
        """The length of the change of a channel's first three components between the frames.  (h, w)."""
        return np.linalg.norm(self.now[channel][..., :3] - self.before[channel][..., :3], axis=-1)

    def row_width(self, bits: int) -> float:
        """The number of pixels with any of ``bits`` in the middle row."""
        return float(self.has(bits)[self.mask.shape[0] // 2].sum())


def focal_px(yfov: float, height: int) -> float:
    """Focal length in pixels of images ``height`` pixels high.  ``yfov``: radians."""
    return float(0.5 * height / np.tan(0.5 * yfov))


class Stage:
    """A GL context and an image size for the demos of one run.  The caller enters ``gpu``."""

    def __init__(self, gpu: Gpu, size: tuple[int, int] = SIZE, device: int | None = None):
        for side, least, most in zip(size, SMALLEST, LARGEST):
            if not least <= side <= most:
                allowed = f"{SMALLEST[0]}x{SMALLEST[1]} to {LARGEST[0]}x{LARGEST[1]}"
                raise SettingsError(f"size is {size[0]}x{size[1]}", hint=f"give a size from {allowed} pixels")
        self.gpu, self.size, self.device = gpu, size, device
        self.bench = Bench(gpu, size, device)

    @property
    def pixels(self) -> int:
        """The number of pixels of an image."""
        return self.size[0] * self.size[1]

    @property
    def cell(self) -> int:
        """Side of a square of a ``checkerboard`` over an image, pixels."""
        return max(self.size[0] // 60, 1)

    def settings(self, **settings: Any) -> Settings:
        """Settings of an evaluation with the size and backend of the stage.

        ``settings``: fields of Settings; the defaults are one frame per second and no indirect light.
        """
        return self.bench.settings_of({"fps": 1.0, "light": "auto"} | settings)

    def evaluate(
        self, scene: Scene, *, camera: CameraTrack | None = None, extra: Sequence[str] = (), **settings: Any
    ) -> tuple[Run, list[LitPair]]:
        """Evaluate ``scene``: the run, and each pair with its channels.  ``settings``: fields of Settings.

        ``extra``: further channels beyond those that the columns need.
        """
        pairs: list[LitPair] = []
        stage_settings = self.settings(**settings)

        def keep(pair: Pair) -> None:
            names = [n for n in pair.source.channels if n in pair.source.current]
            now, before = ({n: pair.source.read(n, previous=old) for n in names} for old in (False, True))
            pairs.append(LitPair(pair.mask, pair.motion, now, before))

        camera = camera or choose_camera(scene, stage_settings.sequence.camera)
        run = evaluate_scene(scene, stage_settings, Observers(on_pair=keep, channels=tuple(extra)), camera=camera)
        return run, pairs

    def pair(self, scene: Scene, **settings: Any) -> LitPair:
        """The first pair of ``scene``: its frames at 0 and 1 second."""
        return self.evaluate(scene, frames=(0, 2), **settings)[1][0]

    @contextlib.contextmanager
    def reuse(
        self,
        scene: Scene,
        texts: Mapping[str, str],
        kind: str = "full",
        reads: Sequence[str] = (),
        **settings: Any,
    ) -> Iterator[tuple[RasterInputs, dict[str, MethodRunner]]]:
        """Inputs of reuse methods, and a runner for each of ``texts``: name -> specification, as on the command line.

        ``kind``: of the input; ``reads``: inputs beyond those of the methods and radiance.
        """
        stage_settings = self.settings(reprojection="motion", environment="none", **settings)
        specs = {name: MethodSpec.parse(text) for name, text in texts.items()}
        methods = {name: load_method(spec.method) for name, spec in specs.items()}
        every = {read for method in methods.values() for read in method.reads} | {"radiance", *reads}
        request = FrameRequest(self.gpu, scene, choose_camera(scene), stage_settings, parse_input(kind))
        with Owner() as owner:
            inputs, runners = owner.own(RasterInputs(request, every)), {}
            for name, method in methods.items():
                values = method_settings(method, specs[name].settings)
                runner = MethodRunner(self.gpu, method, inputs.output_size, values, input_size=inputs.size)
                runners[name] = owner.own(runner)
            yield inputs, runners

    def release(self) -> None:
        """Release what the stage holds on the GPU."""
        self.bench.release()


SAND, BRICK, SEA, LEAF, CHALK, GOLD = (
    (0.70, 0.58, 0.40), (0.62, 0.20, 0.12), (0.10, 0.30, 0.55), (0.16, 0.42, 0.20), (0.80, 0.79, 0.75),
    (0.75, 0.55, 0.12),
)  # fmt: skip
"""Colors of materials.  A lesson uses none that is close to a color of its masks (test_demos.py)."""


class Props(SceneBuilder):
    """A SceneBuilder with diffuse materials and a few shapes.  ``root``: the node that nodes without a parent get."""

    root = -1

    def node(self, parent: int = -1, **fields: Any) -> int:
        """Add a node below ``parent``, or below ``root``."""
        return super().node(self.root if parent < 0 else parent, **fields)

    def paint(self, color: tuple[float, float, float], **more: object) -> int:
        """Add a Lambertian material without specular lobe.  ``more``: fields of Material."""
        return self.material(base_color=(*color, 1.0), metallic=0.0, roughness=1.0, specular=0.0, **more)

    def glow(self, *radiance: float) -> int:
        """Add a black material that emits ``radiance``, one number for gray or R, G and B."""
        color = radiance if len(radiance) == 3 else radiance * 3
        return self.material(base_color=(0, 0, 0, 1), emissive=color, specular=0.0)

    def still_camera(self, yfov: float, seconds: float) -> int:
        """Add a camera at the origin that stands still for ``seconds``, so that the scene has that duration."""
        camera = self.camera(yfov=yfov, znear=0.05)
        self.animate(camera, "translation", [0.0, seconds], [(0, 0, 0), (0, 0, 0)])
        return camera

    def thing(self, *primitives: Primitive, **node: object) -> int:
        """Add a node with a mesh of ``primitives``.  ``node``: fields of ``build.Node``."""
        return self.node(mesh=self.mesh(*primitives), **node)

    def ball(self, radius: float, color: tuple[float, float, float], rings: int = 48, **node: object) -> int:
        """Add a sphere around its node."""
        return self.thing(dataclasses.replace(sphere(radius, rings), material=self.paint(color)), **node)

    def block(self, half: tuple[float, float, float], color: tuple[float, float, float], **node: object) -> int:
        """Add a box around its node.  ``half``: half of its sides, meters."""
        return self.thing(box(half, material=self.paint(color)), **node)

    def wall(self, half_width: float, half_height: float, color: tuple[float, float, float], **node: object) -> int:
        """Add a rectangle that faces +Z of its node."""
        return self.thing(quad(half_width, half_height, material=self.paint(color)), **node)

    def checkered(
        self, half_width: float, half_height: float, cells: tuple[int, int], colors: tuple, **node: object
    ) -> int:
        """Add a rectangle of ``cells`` squares in two ``colors``, facing +Z of its node."""
        return self.thing(*checkered(half_width, half_height, cells, [self.paint(c) for c in colors]), **node)


def built(parts: Callable[Concatenate[Props, P], None]) -> Callable[P, Scene]:
    """A function that returns the scene of what ``parts`` adds to the Props that are its first argument."""

    @functools.wraps(parts)
    def scene(*args: P.args, **options: P.kwargs) -> Scene:
        props = Props()
        parts(props, *args, **options)
        return props.build()

    return scene


def checkered(half_width: float, half_height: float, cells: tuple[int, int], materials: list[int]) -> list[Primitive]:
    """Two primitives: the even and the odd squares of a checkerboard."""
    whole = quad(half_width, half_height, cells=cells)
    column, row = np.arange(cells[0] * cells[1]) % cells[0], np.arange(cells[0] * cells[1]) // cells[0]
    odd = np.repeat((column + row) % 2 == 1, 2)
    return [
        dataclasses.replace(whole, triangles=whole.triangles[odd == bool(i)], material=material)
        for i, material in enumerate(materials)
    ]


def corner(b: Props) -> None:
    """Add a corner of a room with a ball and a block; a camera at the origin looks along -Z."""
    b.checkered(5.0, 4.0, (10, 8), (SAND, CHALK), translation=(0, -1.3, -4), rotation=turn_x(-90))
    b.wall(5.0, 2.5, SEA, translation=(0, 1.2, -6.5))
    b.wall(4.0, 2.5, CHALK, translation=(-3.2, 1.2, -4), rotation=turn_y(90))
    b.ball(0.5, BRICK, translation=(-0.6, -0.8, -4.4))
    b.block((0.35, 0.6, 0.35), CHALK, translation=(1.2, -0.7, -4.6), rotation=turn_y(35))


def hall(b: Props) -> None:
    """Add a hall with columns, 8 m wide, 4 m high, 16 m long; a camera at its origin looks along -Z."""
    b.checkered(4.0, 8.0, (8, 16), (SAND, CHALK), translation=(0, -1.5, 0), rotation=turn_x(-90))
    b.wall(4.0, 8.0, CHALK, translation=(0, 2.5, 0), rotation=turn_x(90))
    b.checkered(8.0, 2.0, (16, 4), (CHALK, SAND), translation=(-4, 0.5, 0), rotation=turn_y(90))
    b.checkered(8.0, 2.0, (16, 4), (CHALK, SAND), translation=(4, 0.5, 0), rotation=turn_y(-90))
    b.wall(4.0, 2.0, SEA, translation=(0, 0.5, -8))
    b.wall(4.0, 2.0, LEAF, translation=(0, 0.5, 8), rotation=turn_y(180))
    column = b.mesh(box((0.25, 2.0, 0.25), material=b.paint(BRICK)))
    for i in range(6):
        for side in (-1, 1):
            b.node(translation=(2.25 * side, 0.5, -6.5 + 2.5 * i), mesh=column)
    b.ball(0.45, GOLD, translation=(0.0, -1.05, -5.0))
    b.block((0.4, 0.4, 0.4), LEAF, translation=(-1.2, -1.1, -6.4), rotation=turn_y(30))
    b.ball(0.5, BRICK, translation=(0.6, -1.0, 5.0))
    for z in (-6.0, -2.5, 2.5, 6.0):
        b.light(translation=(0.0, 1.9, z), intensity=7.0, color=(1.0, 0.93, 0.82))
