"""Scenes of the cases, made in code.  Space: world, +Y up, meters."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from taubench_gl.scene.builder import SceneBuilder, box, quad, skinned, turn_y
from taubench_gl.scene.model import Scene

Array = np.ndarray


@contextlib.contextmanager
def sky_file(radiance: Array) -> Iterator[str]:
    """Path of an environment image, equirectangular, while the block runs.  ``radiance``: (h, w, 3)."""
    import OpenImageIO as oiio

    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "sky.exr")
        image = oiio.ImageOutput.create(path)
        image.open(path, oiio.ImageSpec(radiance.shape[1], radiance.shape[0], 3, "float"))
        image.write_image(radiance.astype(np.float32))
        image.close()
        yield path


class _StillBuilder(SceneBuilder):
    """Keeps the duration and the first value of every channel."""

    def animate(
        self, node: int, path: str, times: Sequence[float], values: object, interpolation: str = "LINEAR"
    ) -> None:
        super().animate(node, path, times, [values[0]] * len(times), interpolation)


def busy_room(
    offset: Sequence[float] = (0.0, 0.0, 0.0), scale: float = 1.0, *, still: bool = False, lamps: int = 0
) -> Scene:
    """A closed room with a moving box, a skinned strip and a camera that walks and turns; one second long.

    All nodes are children of a node at ``offset`` (meters) with uniform ``scale``.  Every key is a small dyadic number,
    so that float64 world matrices are exact at any offset up to 1e9 m.  ``still``: nothing moves, for one second.
    ``lamps``: number of point lights below the ceiling.
    """
    b = _StillBuilder() if still else SceneBuilder()
    root = b.node(translation=offset, scale=(scale, scale, scale))
    b.node(root, mesh=b.mesh(box((4.0, 2.0, 4.0), inside=True, cells=3)))
    cube = b.node(root, mesh=b.mesh(box((0.5, 0.5, 0.5))))
    b.animate(cube, "translation", [0.0, 1.0], [(-1.5, -0.5, -1.0), (1.5, 0.25, -1.5)])
    joints = [b.node(root, translation=(1.5, -1.0, -2.0))]
    joints.append(b.node(joints[0], translation=(0.0, 1.0, 0.0)))
    b.animate(joints[1], "translation", [0.0, 1.0], [(0.0, 1.0, 0.0), (-1.0, 1.25, 0.5)])
    strip = quad(0.25, 1.0, cells=(1, 8), material=b.material(double_sided=True))
    height = 0.5 + 0.5 * strip.positions[:, 1:2]
    bind = np.tile(np.eye(4), (2, 1, 1))
    bind[:, 1, 3] = 1.0, -1.0 + 1.0
    strip = skinned(strip, np.tile([0, 1], (len(strip.positions), 1)), np.concatenate([1 - height, height], axis=1))
    b.node(root, mesh=b.mesh(strip), skin=b.skin(joints, bind))
    camera = b.camera(root, yfov=np.radians(70.0), znear=0.0625 * scale, zfar=64.0 * scale)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 2.0), (0.5, 0.125, 1.5)])
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(-8.0), turn_y(12.0)])
    for i in range(lamps):
        b.light(root, translation=(-2.0 + 4.0 * (i % 2), 1.5, -2.0 + 2.0 * (i // 2)), intensity=30.0)
    return b.build()
