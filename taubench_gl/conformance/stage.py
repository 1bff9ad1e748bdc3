"""What the scenes of the suite are made of: a glTF file under construction with ground, boxes, a camera and keys."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pygltflib as gl

from taubench_gl.datasets import shapes
from taubench_gl.datasets.gltf_writer import Writer
from taubench_gl.math3d import quat_multiply
from taubench_gl.scene.builder import turn

Array = np.ndarray

FRAMES, FPS, CAMERA = 4, 24.0, "eye"
"""Frames that are scored, at frame / FPS seconds, and the name of the camera node."""

PACE = np.array([0.0, 1.0, 3.5, 5.0, 8.7])
"""Progress of every motion at the keys, which lie on frames 0 to 4: no two steps are alike, so that a vector of another
frame, of half the rate or of twice the length differs from the right one."""

EYE = (0.3, 1.4, 5.0)
YFOV = 50.0


def rotations(axis: Sequence[float], degrees: Array, base: Array | None = None) -> Array:
    """Quaternions xyzw (K, 4) of turns by ``degrees`` (K,) about ``axis``, after ``base``."""
    turned = np.array([turn(axis, angle) for angle in degrees])
    return turned if base is None else quat_multiply(turned, np.broadcast_to(base, turned.shape))


def along(start: Sequence[float], step: Sequence[float], pace: Array = PACE) -> Array:
    """Positions (K, 3) of a motion by ``step`` meters per unit of ``pace`` from ``start``."""
    return np.asarray(start, dtype=float) + np.asarray(pace)[:, None] * np.asarray(step, dtype=float)


class Stage:
    """One scene of the suite under construction.  Objects stand on the ground y = 0; methods return node indices."""

    def __init__(self, origin: Sequence[float] = (0.0, 0.0, 0.0)):
        """``origin``: where the whole scene stands, meters."""
        self.writer = Writer("CC0-1.0", "taubench-gl conformance")
        self.root = self.writer.node("root", translation=list(origin)) if any(origin) else None
        self._tracks: list[tuple] = []

    def material(self, color: tuple[float, ...] = (0.6, 0.6, 0.6), **rest: Any) -> int:
        """A rough material of a linear ``color``; its index."""
        return self.writer.material(f"material {len(self.writer.gltf.materials)}", color, **rest)

    def mesh(self, name: str, shape: shapes.Shape, material: int | None = None, **morph: list) -> int:
        """A mesh of one primitive; its index among the meshes.  ``morph``: its targets and their weights."""
        material = self.material() if material is None else material
        if self.writer.gltf.materials[material].pbrMetallicRoughness.baseColorTexture is None:
            shape = {name: values for name, values in shape.items() if name != "TEXCOORD_0"}
        primitive = self.writer.primitive(shape, material, morph.get("targets"))
        return self.writer.mesh(name, primitive, weights=morph.get("weights"))

    def node(self, name: str, mesh: int | None = None, parent: int | None = None, **fields: Any) -> int:
        """A node below ``parent``, or below the root of the scene."""
        fields = {key: [float(x) for x in value] if key in ("translation", "rotation", "scale") else value
                  for key, value in fields.items()}  # fmt: skip
        return self.writer.node(name, self.root if parent is None else parent, mesh=mesh, **fields)

    def add(self, name: str, shape: shapes.Shape, material: int | None = None, **fields: Any) -> int:
        """A node with a mesh of one primitive; ``fields`` as for ``node``."""
        return self.node(name, self.mesh(name, shape, material), **fields)

    def box(self, name: str, at: Sequence[float], half: Sequence[float] = (0.5, 0.5, 0.5), **fields: Any) -> int:
        """A box around ``at``, ``half`` its size; its color depends on its name."""
        shade = np.random.default_rng(list(name.encode())).uniform(0.2, 0.9, 3).round(3)
        shape = shapes.box(-np.asarray(half), np.asarray(half))
        return self.add(name, shape, self.material(tuple(shade.tolist())), translation=at, **fields)

    def ground(self, cells: int = 1) -> int:
        """The ground, a square of 40 m around the origin of ``cells`` times ``cells`` quads, seen from both sides.

        Rasterizers clip smaller triangles more exactly.
        """
        size, corners = 40.0 / cells, itertools.product(np.linspace(-20.0, 20.0, cells, endpoint=False), repeat=2)
        shape = shapes.join([shapes.quad((x, 0, z + size), (size, 0, 0), (0, 0, -size)) for x, z in corners])
        return self.add("ground", shape, self.material((0.4, 0.5, 0.3), doubleSided=True))

    def eye(self, at: Sequence[float] = EYE, pitch: float = -8.0, yfov: float = YFOV, ymag: float | None = None) -> int:
        """The camera.  ``pitch``, ``yfov``: degrees; ``ymag``: half the height that a parallel one sees, meters."""
        camera = self.writer.camera(CAMERA, float(np.radians(yfov)), 0.1, 200.0)
        if ymag is not None:
            lens = gl.Orthographic(xmag=ymag * 16 / 9, ymag=ymag, znear=0.1, zfar=100.0)
            self.writer.gltf.cameras[camera] = gl.Camera(name=CAMERA, type="orthographic", orthographic=lens)
        return self.node(CAMERA, translation=at, rotation=turn((1, 0, 0), pitch), camera=camera)

    def furnished(self, cells: int = 1, **eye: Any) -> int:
        """The ground of ``cells`` times ``cells`` quads, two boxes that stand still on it, and the camera ``eye``."""
        self.ground(cells)
        self.box("left box", (-1.6, 0.6, -0.5), (0.5, 0.6, 0.5), rotation=turn((0, 1, 0), 20.0))
        self.box("right box", (1.9, 0.4, -2.0), (0.6, 0.4, 0.4), rotation=turn((0, 1, 0), -35.0))
        return self.eye(**eye)

    def animate(self, node: int | str, path: str, values: Any, interpolation: str = "LINEAR") -> None:
        """Keys of ``path`` of ``node`` for frames 0 to 4: ``values`` (5, ...); those of STEP a quarter frame earlier.

        With the path "pointer", ``node`` is the JSON pointer of a property.  Files hold float32 times; a jump on a
        frame would come a frame late where they are rounded up.
        """
        times = np.maximum(np.arange(FRAMES + 1) - 0.25 * (interpolation == "STEP"), 0.0) / FPS
        self._tracks.append((node, path, times, values, interpolation))

    def document(self) -> Writer:
        """The glTF document, complete: once.

        Extensions are listed as used and none as required: a loader without one shows the rest of the scene.
        """
        if self._tracks:
            self.writer.animation("motion", *self._tracks)
        return self.writer
