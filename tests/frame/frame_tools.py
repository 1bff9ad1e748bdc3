"""Small scenes made in code, cameras that follow a formula, and one frame pair drawn, masked and read back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection as pair_matrices
from taubench_gl.conventions import DEFAULT_THRESHOLD
from taubench_gl.features import FEATURES
from taubench_gl.frame.passes.masks import MaskOptions, MaskPass
from taubench_gl.frame.renderer import Renderer
from taubench_gl.frame.targets import read_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.metrics.counts import Counts
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.scene.model import Camera, Channel, Image, Material, Primitive, Scene

Array = np.ndarray
THRESHOLDS = dict.fromkeys(FEATURES, DEFAULT_THRESHOLD)


# ------------------------------------------------------------------------------------------------------------- scenes
def primitive(positions, triangles, **fields) -> Primitive:
    triangles = np.array(triangles, dtype=np.uint32).reshape(-1, 3)
    return Primitive(np.array(positions, dtype=np.float32), triangles, **fields)


def quad(origin, u, v, **fields) -> Primitive:
    """A parallelogram facing u x v with texture coordinates from (0, 0) at the origin to (1, 1)."""
    origin, u, v = (np.array(x, dtype=float) for x in (origin, u, v))
    corners = np.array([origin, origin + u, origin + u + v, origin + v])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    return primitive(corners, [[0, 1, 2], [0, 2, 3]], texcoords=(uv, None), **fields)


def room(half: float = 5.0) -> Primitive:
    """The inside of a cube, facing inwards."""
    return replace(box((half, half, half), inside=True), normals=None)


def make_scene(
    *primitives: Primitive,
    matrices=None,
    materials: tuple[Material, ...] = (),
    images: tuple[Image, ...] = (),
    channels: tuple[Channel, ...] = (),
    origin=(0.0, 0.0, 0.0),
) -> Scene:
    """A root node at ``origin`` and one child per primitive, placed by ``matrices`` or by animated T, R, S."""
    b = SceneBuilder()
    root = b.node(translation=origin)
    for i, p in enumerate(primitives):
        b.node(root, mesh=b.mesh(p), matrix=None if matrices is None else matrices[i])
    return replace(b.build(), materials=materials, images=images, channels=channels)


def picture(pixels) -> Image:
    """An image from (h, w, 4) values 0..255, row 0 at the top."""
    pixels = np.array(pixels, dtype=np.uint8)
    return Image("made", (pixels.shape[1], pixels.shape[0]), lambda: pixels)


# ------------------------------------------------------------------------------------------------------------ cameras
class FormulaCamera:
    """A CameraTrack whose place and rotation are functions of time."""

    name = "formula"

    def __init__(self, camera: Camera, place: Callable[[float], tuple[Array, Array]]):
        self.camera, self.place = camera, place

    def describe(self) -> str:
        return self.name

    def view_at(self, state) -> View:
        position, rotation = self.place(state.time)
        return View(np.array(position, dtype=np.float64), np.array(rotation, dtype=np.float64), self.camera)


def still_camera(camera: Camera, position=(0.0, 0.0, 0.0), rotation=None) -> FormulaCamera:
    rotation = np.eye(3) if rotation is None else rotation
    return FormulaCamera(camera, lambda t: (position, rotation))


def rotation_about(axis: str, degrees: float) -> Array:
    a = np.radians(degrees)
    c, s = np.cos(a), np.sin(a)
    return np.array(
        {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
         "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}[axis]
    )  # fmt: skip


def looking_at(eye, target) -> Array:
    z = np.subtract(eye, target) / np.linalg.norm(np.subtract(eye, target))
    x = np.cross([0.0, 1.0, 0.0], z) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], z))
    return np.stack([x, np.cross(z, x), z], axis=1)


# -------------------------------------------------------------------------------------------------------------- pairs
@dataclass(frozen=True)
class PairResult:
    counts: Counts
    mask: Array  # (h, w) uint32
    motion: Array  # (h, w, 2) +y down
    current: dict[str, Array]
    history: dict[str, Array]
    pair: Reprojection
    view: View
    prev_view: View


def draw_pair(
    gpu: Gpu,
    scene: Scene,
    camera,
    size: tuple[int, int],
    times: tuple[float, float],
    *,
    reprojection: str = "camera",
    sampling: str = "nearest",
    thresholds=THRESHOLDS,
    extra: tuple[str, ...] = (),
    culling: str = "gltf",
    read: bool = True,
) -> PairResult:
    """Draw the frames at ``times`` (previous, current), compare them, and read everything back."""
    channels = {"position", "normal", *extra} | ({"prev_position"} if reprojection == "motion" else set())
    with Owner() as owner:
        context = owner.own(GpuContext(gpu))
        renderer = owner.own(Renderer(context, scene, camera, size, channels, culling=culling))
        options = MaskOptions(reprojection, sampling, write_mask=True, write_motion=True)
        masks = owner.own(MaskPass(context, size, options))
        step = times[1] - times[0]
        renderer.draw(times[0], times[0] - step)
        before = renderer.view(times[0])[1]
        renderer.draw(times[1], times[0])
        now = renderer.view(times[1])[1]
        pair = pair_matrices(now, before, *size)
        masks.run(pair, thresholds, renderer.history.current.textures, renderer.history.previous.textures)
        counts = masks.read()
        counts = replace(counts, mask_histogram=counts.mask_histogram.copy(), histograms=counts.histograms.copy())
        images = read_channel(masks.mask, "mask")[..., 0], read_channel(masks.motion, "motion")
        names = renderer.channels if read else ()
        current, history = ({n: renderer.read(n, previous=previous) for n in names} for previous in (False, True))
    gpu.collect()
    return PairResult(counts, *images, current, history, pair, now, before)


def draw_frame(gpu: Gpu, scene: Scene, camera, size, channels, *, time: float = 0.0, culling: str = "gltf"):
    """Channels of one frame, {name: (h, w, n)}, and its view."""
    with Owner() as owner:
        context = owner.own(GpuContext(gpu))
        renderer = owner.own(Renderer(context, scene, camera, size, set(channels), culling=culling))
        renderer.draw(time, time - 1 / 24)
        found = {n: renderer.read(n) for n in renderer.channels}, renderer.view(time)[1]
    gpu.collect()
    return found


def find_scene(data: Path, name: str) -> Path:
    """The one file called ``name`` among the real scenes."""
    found = sorted(p for p in data.rglob(name) if not p.relative_to(data).parts[0].startswith("bad_"))
    assert len(found) == 1, f"{name}: {found}"
    return found[0]
