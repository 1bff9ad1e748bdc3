"""Small scenes built in code for cases with known answers.  Space: world, +Y up, meters."""

from __future__ import annotations

import contextlib
import dataclasses
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

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


class SceneBuilder:
    """Collects nodes, meshes and channels; every method returns the index of the added element."""

    def __init__(self) -> None:
        self._nodes = NodeList()
        self._meshes: list[Mesh] = []
        self._materials: list[Material] = []
        self._skins: list[Skin] = []
        self._cameras: list[Camera] = []
        self._lights: list[Light] = []
        self._channels: list[Channel] = []

    def node(self, parent: int = -1, *, name: str | None = None, **fields: object) -> int:
        """A node with the defaults of glTF; ``fields`` as in ``NodeList.add``."""
        return self._nodes.add(name or f"node {len(self._nodes)}", parent, **fields)

    def mesh(self, *primitives: Primitive, weights: Sequence[float] = ()) -> int:
        self._meshes.append(Mesh(f"mesh {len(self._meshes)}", primitives, np.array(weights, dtype=np.float64)))
        return len(self._meshes) - 1

    def material(self, **fields: object) -> int:
        self._materials.append(Material(**fields))
        return len(self._materials) - 1

    def camera(
        self, parent: int = -1, *, translation=(0.0, 0.0, 0.0), rotation=IDENTITY, scale=(1.0, 1.0, 1.0), **lens
    ) -> int:
        """A camera on a new node; ``lens`` are fields of ``Camera``.  Returns the node."""
        self._cameras.append(Camera(**lens))
        index = len(self._cameras) - 1
        return self.node(parent, translation=translation, rotation=rotation, scale=scale, camera=index)

    def light(self, parent: int = -1, *, translation=(0.0, 0.0, 0.0), rotation=IDENTITY, **fields) -> int:
        """A light on a new node, shining along -Z; ``fields`` are those of ``Light``.  Returns the node."""
        self._lights.append(Light(**fields))
        return self.node(parent, translation=translation, rotation=rotation, light=len(self._lights) - 1)

    def skin(self, joints: Sequence[int], inverse_bind: Array | None = None) -> int:
        inverse_bind = np.tile(np.eye(4), (len(joints), 1, 1)) if inverse_bind is None else inverse_bind
        self._skins.append(Skin("skin", np.array(joints, dtype=np.int32), inverse_bind))
        return len(self._skins) - 1

    def animate(
        self, node: int, path: str, times: Sequence[float], values: object, interpolation: str = "LINEAR"
    ) -> None:
        """A channel of ``node``; ``values`` as ``Channel.values``."""
        keys, rows = np.array(times, dtype=np.float64), np.array(values, dtype=np.float64)
        self._channels.append(Channel("node", node, path, interpolation, keys, rows))

    def build(self) -> Scene:
        return Scene(
            "made in code", self._nodes.nodes(), tuple(self._meshes), tuple(self._materials), skins=tuple(self._skins),
            cameras=tuple(self._cameras), lights=tuple(self._lights), channels=tuple(self._channels),
        )  # fmt: skip


class _StillBuilder(SceneBuilder):
    """Keeps the duration and the first value of every channel."""

    def animate(
        self, node: int, path: str, times: Sequence[float], values: object, interpolation: str = "LINEAR"
    ) -> None:
        super().animate(node, path, times, [values[0]] * len(times), interpolation)


def quad(
    half_width: float = 1.0,
    half_height: float = 1.0,
    *,
    cells: tuple[int, int] = (1, 1),
    material: int = -1,
    normals: bool = True,
) -> Primitive:
    """A rectangle in the plane z = 0, facing +Z, divided into ``cells`` of two triangles."""
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
    """A sphere around the origin with exact vertex normals."""
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
    return Primitive(
        primitive.positions, primitive.triangles, primitive.material, normals=primitive.normals,
        joints=np.asarray(joints, dtype=np.uint32), weights=np.asarray(weights, dtype=np.float32),
    )  # fmt: skip


def morphed(primitive: Primitive, *displacements: Array) -> Primitive:
    """``primitive`` with one morph target per (V, 3) displacement."""
    targets = tuple(MorphTarget(np.asarray(d, dtype=np.float32)) for d in displacements)
    return Primitive(
        primitive.positions, primitive.triangles, primitive.material, normals=primitive.normals, targets=targets
    )


def turn(axis: Sequence[float], degrees: float) -> Array:
    """Quaternion xyzw of a rotation about ``axis``.  (4,) float64."""
    return math3d.quat_from_axis_angle(np.asarray(axis, dtype=np.float64), np.radians(degrees))


def turn_y(degrees: float) -> Array:
    return turn((0.0, 1.0, 0.0), degrees)


def turn_x(degrees: float) -> Array:
    return turn((1.0, 0.0, 0.0), degrees)


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


def lamp_field(
    static: int = 73, moving: int = 617, *, reach: float = np.inf, intensity: float = 0.5, cells: int = 48
) -> Scene:
    """A hilly ground of 40 x 40 m below point lights, and a moving camera; one second long, deterministic.

    The defaults are the numbers of point lights of the paper's scene with most lights.  ``reach``: range of
    every light, meters; ``intensity``: candela.  Lights are 0.3 to 1.5 m above the ground; the moving ones move by up
    to half a meter per axis.
    """
    b = SceneBuilder()
    ground = quad(20.0, 20.0, cells=(cells, cells), material=b.material(metallic=0.0, roughness=0.8))

    def height(x: Array, z: Array) -> Array:
        return 0.8 * np.sin(0.45 * x) * np.cos(0.35 * z)

    x, z = ground.positions[:, 0].astype(np.float64), -ground.positions[:, 1].astype(np.float64)
    slope_x, slope_z = 0.36 * np.cos(0.45 * x) * np.cos(0.35 * z), -0.28 * np.sin(0.45 * x) * np.sin(0.35 * z)
    normals = math3d.normalize(np.stack([-slope_x, np.ones_like(x), -slope_z], axis=-1))
    positions = np.stack([x, height(x, z), z], axis=-1)
    b.node(mesh=b.mesh(dataclasses.replace(
        ground, positions=positions.astype(np.float32), normals=normals.astype(np.float32)
    )))  # fmt: skip
    rng = np.random.default_rng(690)
    for i in range(static + moving):
        at = rng.uniform(-19.0, 19.0, 2)
        position = np.array([at[0], height(*at) + rng.uniform(0.3, 1.5), at[1]])
        color = 0.3 + 0.7 * rng.random(3)
        node = b.light(translation=position, color=tuple(color), intensity=intensity, range=reach)
        drift = rng.uniform(-0.5, 0.5, 3)
        if i >= static:
            b.animate(node, "translation", [0.0, 1.0], [position, position + drift])
    camera = b.camera(rotation=turn_x(-12.0), yfov=np.radians(60.0), znear=0.05)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 2.5, 16.0), (0.5, 2.5, 14.5)])
    return b.build()
