"""What the scenes of the suite are made of: a glTF file under construction with ground, boxes, a camera and keys."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gl

from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.datasets import shapes
from taubench_gl.datasets.gltf_writer import Writer
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
    from taubench_gl.math3d import quat_multiply

    turned = np.array([turn(axis, angle) for angle in degrees])
    return turned if base is None else quat_multiply(turned, np.broadcast_to(base, turned.shape))


def along(start: Sequence[float], step: Sequence[float], pace: Array = PACE) -> Array:
    """Positions (K, 3) of a motion by ``step`` meters per unit of ``pace`` from ``start``."""
    return np.asarray(start, dtype=float) + np.asarray(pace)[:, None] * np.asarray(step, dtype=float)


def halton(size: tuple[int, int]) -> Array:
    """Offsets of Halton (2, 3) in pixels, (FRAMES, 2), +x right, +y up."""
    return np.array([halton_jitter(frame) for frame in range(FRAMES)])


def strip(cells: int = 8) -> shapes.Shape:
    """An upright strip, 0.8 m wide and 2.4 m high from the origin, of ``cells`` quads in the plane z = 0."""
    height = np.linspace(0.0, 2.4, cells + 1)
    positions = np.array([(x, y, 0.0) for y in height for x in (-0.4, 0.4)])
    uv = positions[:, :2] * [1.25, -1 / 2.4] + [0.5, 1.0]
    a = 2 * np.arange(cells)
    triangles = np.stack([np.stack([a, a + 1, a + 3], -1), np.stack([a, a + 3, a + 2], -1)], 1).reshape(-1, 3)
    normals = np.tile([0.0, 0.0, 1.0], (len(positions), 1))
    return {"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uv, "indices": triangles}


def _key_times(interpolation: str) -> Array:
    """Times of the keys of frames 0 to 4, seconds: on them, those of jumps a quarter of a frame before them.

    Files hold float32 times; a jump on a frame would come a frame late where they are rounded up.
    """
    return np.maximum(np.arange(FRAMES + 1) - 0.25 * (interpolation == "STEP"), 0.0) / FPS


class Stage:
    """One scene of the suite under construction.  Objects stand on the ground y = 0; methods return node indices."""

    def __init__(self, origin: Sequence[float] = (0.0, 0.0, 0.0)):
        """``origin``: where the whole scene stands, meters."""
        self.writer = Writer("CC0-1.0", "taubench-gl conformance")
        self.root = self.writer.node("root", translation=list(origin)) if any(origin) else None
        self._materials: dict[tuple, int] = {}
        self._tracks: list[tuple] = []
        self._pointers: list[tuple[str, Array, str, str]] = []

    def material(self, color: tuple[float, ...] = (0.6, 0.6, 0.6), **rest: Any) -> int:
        """A rough material of a linear ``color``; equal ones are one."""
        key = (color, tuple(sorted(rest.items())))
        if key not in self._materials:
            self._materials[key] = self.writer.material(f"material {len(self._materials)}", color, **rest)
        return self._materials[key]

    def mesh(
        self, name: str, shape: shapes.Shape, material: int | None = None, targets: list[dict] | None = None,
        weights: list[float] | None = None,
    ) -> int:  # fmt: skip
        """A mesh of one primitive; its index among the meshes."""
        material = self.material() if material is None else material
        if self.writer.gltf.materials[material].pbrMetallicRoughness.baseColorTexture is None:
            shape = {name: values for name, values in shape.items() if name != "TEXCOORD_0"}
        return self.writer.mesh(name, self.writer.primitive(shape, material, targets), weights=weights)

    def node(self, name: str, mesh: int | None = None, parent: int | None = None, **fields: Any) -> int:
        """A node below ``parent``, or below the root of the scene."""
        fields = {key: [float(x) for x in value] if key in ("translation", "rotation", "scale") else value
                  for key, value in fields.items()}  # fmt: skip
        return self.writer.node(name, self.root if parent is None else parent, mesh=mesh, **fields)

    def box(self, name: str, at: Sequence[float], half: Sequence[float] = (0.5, 0.5, 0.5), **fields: Any) -> int:
        """A box around ``at``, ``half`` its size; its color depends on its name."""
        shade = np.random.default_rng(list(name.encode())).uniform(0.2, 0.9, 3).round(3)
        shape = shapes.box(-np.asarray(half), np.asarray(half))
        return self.node(name, self.mesh(name, shape, self.material(tuple(shade.tolist()))), translation=at, **fields)

    def ground(self, cells: int = 1) -> int:
        """The ground, a square of 40 m around the origin of ``cells`` times ``cells`` quads, seen from both sides.

        Rasterizers clip smaller triangles more exactly.
        """
        size, corners = 40.0 / cells, itertools.product(np.linspace(-20.0, 20.0, cells, endpoint=False), repeat=2)
        shape = shapes.join([shapes.quad((x, 0, z + size), (size, 0, 0), (0, 0, -size)) for x, z in corners])
        return self.node("ground", self.mesh("ground", shape, self.material((0.4, 0.5, 0.3), doubleSided=True)))

    def furniture(self, cells: int = 1) -> None:
        """The ground of ``cells`` times ``cells`` quads, and two boxes that stand still on it."""
        self.ground(cells)
        self.box("left box", (-1.6, 0.6, -0.5), (0.5, 0.6, 0.5), rotation=turn((0, 1, 0), 20.0))
        self.box("right box", (1.9, 0.4, -2.0), (0.6, 0.4, 0.4), rotation=turn((0, 1, 0), -35.0))

    def still_camera(self) -> None:
        """The furniture, and a camera that does not move."""
        self.furniture()
        self.eye()

    def eye(
        self, at: Sequence[float] = EYE, pitch: float = -8.0, yfov: float = YFOV, near: float = 0.1, far: float = 200.0
    ) -> int:
        """The camera, ``pitch`` and vertical field of view ``yfov`` in degrees."""
        camera = self.writer.camera(CAMERA, float(np.radians(yfov)), near, far)
        return self._eye(camera, at, pitch)

    def parallel_eye(self, at: Sequence[float], ymag: float) -> int:
        """An orthographic camera, ``ymag`` half the height that it sees, meters."""
        lens = gl.Orthographic(xmag=ymag * 16 / 9, ymag=ymag, znear=0.1, zfar=100.0)
        self.writer.gltf.cameras.append(gl.Camera(name=CAMERA, type="orthographic", orthographic=lens))
        return self._eye(len(self.writer.gltf.cameras) - 1, at, 0.0)

    def _eye(self, camera: int, at: Sequence[float], pitch: float) -> int:
        return self.node(CAMERA, translation=at, rotation=turn((1, 0, 0), pitch), camera=camera)

    def skin(self, parent: int, joints: int = 2) -> list[int]:
        """A chain of joint nodes, 0.8 m apart upward from ``parent``, as skin number 0.  Returns the joints."""
        chain = [parent]
        for k in range(1, joints):
            chain.append(self.node(f"joint {k}", parent=chain[-1], translation=(0.0, 0.8, 0.0)))
        inverse = np.tile(np.eye(4), (joints, 1, 1))
        inverse[:, 1, 3] = -0.8 * np.arange(joints)
        self.writer.skin("skin", chain, inverse)
        return chain

    def animate(self, node: int, path: str, values: Any, interpolation: str = "LINEAR") -> None:
        """Keys of ``path`` of ``node`` for frames 0 to 4: ``values`` (5, ...)."""
        self._tracks.append((node, path, _key_times(interpolation), np.asarray(values, dtype=float), interpolation))

    def point(self, pointer: str, values: Any, interpolation: str = "LINEAR", dtype: str = "f4") -> None:
        """Keys of any property by KHR_animation_pointer: ``values`` (5,) or (5, n)."""
        self._pointers.append((pointer, np.asarray(values), interpolation, dtype))

    def use(self, *names: str) -> None:
        """List extensions as used.  None is listed as required: a loader without one shows the rest of the scene."""
        known = self.writer.gltf.extensionsUsed
        known.extend(name for name in names if name not in known)

    def save(self, path: Path) -> None:
        """Write the scene as .glb.  Raises OutputError."""
        w = self.writer
        if self._tracks or self._pointers:
            w.animation("motion", *self._tracks)
        for pointer, values, interpolation, dtype in self._pointers:
            self.use("KHR_animation_pointer")
            animation, times = w.gltf.animations[0], np.arange(FRAMES + 1) / FPS
            animation.samplers.append(
                gl.AnimationSampler(
                    input=w.accessor(times, bounds=True), output=w.accessor(values, dtype), interpolation=interpolation
                )
            )
            target = gl.AnimationChannelTarget(
                path="pointer", extensions={"KHR_animation_pointer": {"pointer": pointer}})  # fmt: skip
            animation.channels.append(gl.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))
        w.save(path)
