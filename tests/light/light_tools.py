"""Scenes under light, drawn by the very source an evaluation uses, and read back in float64."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from fixed import fixed_settings

from taubench_gl import math3d
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu
from taubench_gl.scene.builder import SceneBuilder, quad, turn_x
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import Shot

Array = np.ndarray
FLAT = turn_x(-90.0)
"""Turns the plane z = 0 facing +Z into the plane y = 0 facing +Y."""

DIRECT_ONLY = ("frustum", "position", "normal", "direct")


@contextmanager
def opened(
    gpu: Gpu,
    scene: Scene,
    *,
    extra: tuple[str, ...] = (),
    shading: Shading | None = None,
    without: tuple[str, ...] = (),
    **settings,
) -> Iterator[RasterSource]:
    """The source of an evaluation over ``scene``; 64x48 and direct light alone unless ``settings`` say otherwise."""
    chosen = fixed_settings(**({"width": 64, "height": 48, "columns": DIRECT_ONLY} | settings))
    options = {"extra": extra, "shading": shading or Shading(), "without": without}
    with RasterSource(gpu, AnimatedScene(scene), chosen, **options) as source:
        yield source
    gpu.collect()


def shoot(source: RasterSource, frame: int = 0) -> Shot:
    view = source.advance(frame)
    return Shot({name: source.read(name).astype(np.float64) for name in source.channels}, view)


def picture(gpu: Gpu, scene: Scene, **options) -> Shot:
    """The first frame of ``scene``; ``options`` of ``opened``."""
    with opened(gpu, scene, **options) as source:
        return shoot(source)


# ------------------------------------------------------------------------------------------------------------- scenes
def lambert(b: SceneBuilder, albedo: float = 0.6, **fields) -> int:
    fields = {"metallic": 0.0, "roughness": 1.0, "specular": 0.0} | fields
    return b.material(base_color=(albedo, albedo, albedo, 1.0), **fields)


def look(b: SceneBuilder, eye, target, **lens) -> int:
    """A camera at ``eye`` that looks at ``target``."""
    return b.camera(translation=eye, rotation=facing(np.subtract(target, eye)), **({"znear": 0.01} | lens))


def look_down(b: SceneBuilder, half: float, height: float = 8.0, center=(0.0, 0.0)) -> int:
    """A parallel camera above the plane y = 0: pixels are equal areas of it, -Z is up in the image."""
    return b.camera(
        translation=(center[0], height, center[1]), rotation=turn_x(-90.0), kind="orthographic",
        xmag=half, ymag=half, znear=0.01, zfar=1.5 * height,
    )  # fmt: skip


def facing(direction) -> Array:
    """Quaternion that turns -Z to ``direction``."""
    z = -math3d.normalize(np.asarray(direction, dtype=np.float64))
    helper = np.array([0.0, 1.0, 0.0]) if abs(z[1]) < 0.99 else np.array([1.0, 0.0, 0.0])
    x = math3d.normalize(np.cross(helper, z))
    m = np.stack([x, np.cross(z, x), z], axis=1)
    w = np.sqrt(np.maximum(0.0, 1.0 + m[0, 0] + m[1, 1] + m[2, 2])) / 2.0
    if w > 1e-3:
        return np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 4 * w * w]) / (4 * w)
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(m).as_quat()


def floor(b: SceneBuilder, half: float = 4.0, *, material: int = -1, **node) -> int:
    """The plane y = 0."""
    return b.node(mesh=b.mesh(quad(half, half, material=material)), rotation=FLAT, **node)


def worst(got: Array, expected: Array, where: Array) -> float:
    """Largest relative error over ``where``; relative to the larger of the value and 1e-4 of the peak."""
    scale = np.maximum(np.abs(expected), 1e-4 * np.abs(expected[where]).max())
    return float((np.abs(got - expected) / scale)[where].max())


def integrate_hemisphere(function: Callable[[Array], Array], n: int = 400) -> Array:
    """Integral over the unit hemisphere about +Z of ``function`` of directions (K, 3), midpoint rule in float64."""
    u = (np.arange(n) + 0.5) / n
    theta = 0.5 * np.pi * u
    phi = 2.0 * np.pi * (np.arange(2 * n) + 0.5) / (2 * n)
    t, p = (x.ravel() for x in np.meshgrid(theta, phi, indexing="ij"))
    directions = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    weight = np.sin(t) * (0.5 * np.pi / n) * (np.pi / n)
    values = function(directions)
    return np.sum(values * weight.reshape(-1, *([1] * (values.ndim - 1))), axis=0)
