"""Scenes made in code: a builder, simple primitives and rotations.  +Y is up, lengths are meters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from taubench_gl import math3d
from taubench_gl.scene.build import NodeList
from taubench_gl.scene.model import (
    Camera,
    Channel,
    Light,
    Material,
    Mesh,
    MorphTarget,
    Primitive,
    Scene,
    Skin,
)

Array = np.ndarray
IDENTITY = (0.0, 0.0, 0.0, 1.0)
"""Quaternion xyzw of no rotation."""


class SceneBuilder:
    """Collects the parts of a scene.  Every method that adds a part returns its index; ``build`` makes the scene."""

    def __init__(self) -> None:
        self._nodes = NodeList()
        self._meshes: list[Mesh] = []
        self._materials: list[Material] = []
        self._skins: list[Skin] = []
        self._cameras: list[Camera] = []
        self._lights: list[Light] = []
        self._channels: list[Channel] = []

    def node(self, parent: int = -1, *, name: str | None = None, **fields: object) -> int:
        """Add a node below ``parent``, or a root.  ``fields``: those of ``build.Node``, else the defaults of glTF."""
        return self._nodes.add(name or f"node {len(self._nodes)}", parent, **fields)

    def mesh(self, *primitives: Primitive, weights: Sequence[float] = ()) -> int:
        """Add a mesh of ``primitives``.  ``weights``: one per morph target."""
        self._meshes.append(Mesh(f"mesh {len(self._meshes)}", primitives, np.array(weights, dtype=np.float64)))
        return len(self._meshes) - 1

    def material(self, **fields: object) -> int:
        """Add a material.  ``fields``: those of ``Material``."""
        self._materials.append(Material(**fields))
        return len(self._materials) - 1

    def camera(
        self, parent: int = -1, *, translation=(0.0, 0.0, 0.0), rotation=IDENTITY, scale=(1.0, 1.0, 1.0), **lens
    ) -> int:
        """Add a camera that looks along -Z of a new node; returns the node.  ``lens``: fields of ``Camera``."""
        self._cameras.append(Camera(**lens))
        index = len(self._cameras) - 1
        return self.node(parent, translation=translation, rotation=rotation, scale=scale, camera=index)

    def light(self, parent: int = -1, *, translation=(0.0, 0.0, 0.0), rotation=IDENTITY, **fields) -> int:
        """Add a light that shines along -Z of a new node; returns the node.  ``fields``: those of ``Light``."""
        self._lights.append(Light(**fields))
        return self.node(parent, translation=translation, rotation=rotation, light=len(self._lights) - 1)

    def skin(self, joints: Sequence[int], inverse_bind: Array | None = None) -> int:
        """Add a skin with nodes as ``joints``.  ``inverse_bind``: (J, 4, 4), by default identities."""
        inverse_bind = np.tile(np.eye(4), (len(joints), 1, 1)) if inverse_bind is None else inverse_bind
        self._skins.append(Skin("skin", np.array(joints, dtype=np.int32), inverse_bind))
        return len(self._skins) - 1

    def animate(
        self, node: int, path: str, times: Sequence[float], values: object, interpolation: str = "LINEAR"
    ) -> None:
        """Add a channel that animates ``path`` of ``node``.  ``times``: seconds; ``values``: (K, ...)."""
        keys, rows = np.array(times, dtype=np.float64), np.array(values, dtype=np.float64)
        self._channels.append(Channel("node", node, path, interpolation, keys, rows))

    def build(self) -> Scene:
        """The scene of all parts that were added."""
        return Scene(
            "made in code", self._nodes.nodes(), tuple(self._meshes), tuple(self._materials), skins=tuple(self._skins),
            cameras=tuple(self._cameras), lights=tuple(self._lights), channels=tuple(self._channels),
        )  # fmt: skip


def quad(
    half_width: float = 1.0,
    half_height: float = 1.0,
    *,
    cells: tuple[int, int] = (1, 1),
    material: int = -1,
    normals: bool = True,
) -> Primitive:
    """A rectangle around the origin in the plane z = 0, facing +Z, of ``cells`` (columns, rows) of two triangles."""
    columns, rows = cells
    x = np.linspace(-half_width, half_width, columns + 1)
    y = np.linspace(-half_height, half_height, rows + 1)
    grid = np.stack([*np.meshgrid(x, y), np.zeros((rows + 1, columns + 1))], axis=-1).reshape(-1, 3)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1)
    a, b, c, d = corner, corner + 1, corner + columns + 2, corner + columns + 1
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    facing = np.tile(np.float32([0, 0, 1]), (len(grid), 1)) if normals else None
    return Primitive(grid.astype(np.float32), triangles.astype(np.uint32), material, normals=facing)


def box(
    half: Sequence[float] = (1.0, 1.0, 1.0), *, inside: bool = False, cells: int = 1, material: int = -1
) -> Primitive:
    """A box around the origin with flat normals; ``inside``: faces point inwards, as in a closed room."""
    positions, normals, triangles = [], [], []
    face = quad(cells=(cells, cells))
    for axis in range(3):
        for side in (-1.0, 1.0):
            u, v = np.roll(np.eye(3), 1, axis=0)[axis], np.roll(np.eye(3), 2, axis=0)[axis]
            outward = side * np.eye(3)[axis]
            if np.dot(np.cross(u, v), outward) < 0:
                u, v = v, u
            local = face.positions[:, :1] * u + face.positions[:, 1:2] * v + outward
            order = face.triangles[:, ::-1] if inside else face.triangles
            triangles.append(order + sum(map(len, positions)))
            positions.append(local * np.asarray(half))
            normals.append(np.tile(-outward if inside else outward, (len(local), 1)))
    return Primitive(
        np.concatenate(positions).astype(np.float32),
        np.concatenate(triangles).astype(np.uint32),
        material,
        normals=np.concatenate(normals).astype(np.float32),
    )


def sphere(radius: float = 1.0, rings: int = 24) -> Primitive:
    """A sphere around the origin with exact vertex normals, ``rings`` from pole to pole and twice as many around."""
    theta = np.linspace(0.0, np.pi, rings + 1)
    phi = np.linspace(0.0, 2.0 * np.pi, 2 * rings + 1)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    unit = np.stack([np.sin(t) * np.sin(p), np.cos(t), np.sin(t) * np.cos(p)], axis=-1).reshape(-1, 3)
    columns = 2 * rings
    corner = (np.arange(rings)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1)
    a, b, c, d = corner, corner + 1, corner + columns + 2, corner + columns + 1
    triangles = np.stack([a, d, c, a, c, b], axis=-1).reshape(-1, 3)
    return Primitive((radius * unit).astype(np.float32), triangles.astype(np.uint32), normals=unit.astype(np.float32))


def skinned(primitive: Primitive, joints: Array, weights: Array) -> Primitive:
    """``primitive`` with joints (V, k) and weights (V, k)."""
    joints, weights = np.asarray(joints, dtype=np.uint32), np.asarray(weights, dtype=np.float32)
    return replace(primitive, joints=joints, weights=weights)


def morphed(primitive: Primitive, *displacements: Array) -> Primitive:
    """``primitive`` with one morph target per (V, 3) displacement."""
    return replace(primitive, targets=tuple(MorphTarget(np.asarray(d, dtype=np.float32)) for d in displacements))


def turn(axis: Sequence[float], degrees: float) -> Array:
    """Quaternion xyzw of a rotation about ``axis``.  (4,) float64."""
    return math3d.quat_from_axis_angle(np.asarray(axis, dtype=np.float64), np.radians(degrees))


def turn_y(degrees: float) -> Array:
    """Quaternion xyzw of a rotation about +Y.  (4,) float64."""
    return turn((0.0, 1.0, 0.0), degrees)


def turn_x(degrees: float) -> Array:
    """Quaternion xyzw of a rotation about +X.  (4,) float64."""
    return turn((1.0, 0.0, 0.0), degrees)
