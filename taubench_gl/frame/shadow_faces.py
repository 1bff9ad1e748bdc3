"""Shadow faces: the view of each shadow map, and its place in the atlas.  NumPy only.

Faces are placed relative to their light and aligned with the world, never with the camera: a face whose light and
casters stand still keeps its texels, so shadow edges do not shimmer under a moving camera (shimmer counts as change).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import FrameState
from taubench_gl.effects.lighting import Sun
from taubench_gl.frame.occlusion import Shown, corners_of
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.math3d import cross, normalize
from taubench_gl.scene.model import Light, Scene

Array = np.ndarray

FACE = Struct(
    "ShadowFace",
    Field("origin", "vec4", "xyz: light, relative to the current camera, meters; w: 1 parallel, 0 perspective"),
    Field("right", "vec4", "xyz: world axis over half extent (or tan of half the angle); w: atlas x, texels"),
    Field("up", "vec4", "likewise; w: atlas y, texels"),
    Field("forward", "vec4", "xyz: unit world axis; w: near (perspective) or depth range (parallel), meters"),
    Field(
        "extent",
        "vec4",
        "x: resolution, texels; y: world size of a texel at distance 1 (or anywhere, parallel); of reflective shadow "
        "maps z: 1 if the light is on, w: row of the light",
    ),
)
FACE_ROW = 64
"""Faces in a row of the texture that holds the table, a texel for each of their fields."""

_FORWARD = [sign * np.eye(3)[axis] for axis in range(3) for sign in (1.0, -1.0)]
_UP = [np.eye(3)[axis] for axis in (1, 1, 2, 2, 1, 1)]
_CUBE = tuple((cross(f, u), u, f) for f, u in zip(_FORWARD, _UP, strict=True))
"""Right, up and forward of the faces +x -x +y -y +z -z."""

NEAR_FRACTION = 1e-4
"""Near plane of a point or spot light's map, as a fraction of the scene's radius; nothing nearer casts a shadow."""

CONE_MARGIN = 1.02
"""A spot's map is this much wider than its cone, so that filter taps at its edge still see casters."""

DIRECTIONAL_TEXELS = 4
"""Texels along a side of a directional map, as a factor on those of other maps."""

FULL_SIZE_SHADOWS = 8
"""Lights, the most significant first, whose maps have ``shadow_size`` texels along a side; those after have half."""

SMALLEST_MAP = 16
"""Texels along a side below which no map is shrunk to fit the atlas."""

WIDEST_MAP = np.radians(80.0)
"""Half angle of the widest cone that has one map; at 90 degrees the map would be infinite."""


@dataclass(frozen=True, slots=True)
class Face:
    """One map of one light, in world space."""

    light: int  # row of the light table
    parallel: bool
    origin: Array  # (3,) world
    right: Array  # (3,) unit
    up: Array  # (3,) unit
    forward: Array  # (3,) unit
    half: float  # tan of half the angle, or half extent in meters
    near: float  # near plane, or depth range of a parallel map
    resolution: int

    def clip_from_relative(self, camera: Array) -> Array:
        """(4, 4) float64, reversed Z in [0, 1] <- world axes relative to ``camera`` (3,)."""
        rows = np.stack([self.right / self.half, self.up / self.half, self.forward])
        offset = rows @ (np.asarray(camera) - self.origin)
        out = np.zeros((4, 4))
        out[0, :3], out[0, 3] = rows[0], offset[0]
        out[1, :3], out[1, 3] = rows[1], offset[1]
        if self.parallel:
            out[2, :3], out[2, 3] = -rows[2] / self.near, 1.0 - offset[2] / self.near
            out[3, 3] = 1.0
        else:
            out[2, 3] = self.near
            out[3, :3], out[3, 3] = rows[2], offset[2]
        return out


class FaceTable:
    """Faces side by side: arithmetic over all of them at once."""

    def __init__(self, faces: Sequence[Face]):
        self.origin = np.array([f.origin for f in faces]).reshape(-1, 3)  # (F, 3) world
        self.axes = np.array([(f.right, f.up, f.forward) for f in faces]).reshape(-1, 3, 3)
        self.half, self.near = (np.array([getattr(f, name) for f in faces]) for name in ("half", "near"))  # (F,)
        self.parallel = np.array([f.parallel for f in faces], dtype=bool)
        self.resolution = np.array([f.resolution for f in faces], dtype=np.int64)

    def keys(self) -> list[bytes]:
        """Bytes of each face that are equal for faces with the same view volume."""
        volumes = np.concatenate(
            [self.origin, self.axes.reshape(-1, 9), self.half[:, None], self.near[:, None]], axis=1
        )
        return [volume.tobytes() for volume in volumes]

    def fill(self, rows: Array, corners: Sequence[tuple[int, int]], eye: Array) -> None:
        """Fill (F,) FACE records: ``corners``: atlas x, y of each face, texels; ``eye`` (3,): the camera, world."""
        half, corners = self.half[:, None], np.array(corners).reshape(-1, 2)
        rows["origin"][:, :3], rows["origin"][:, 3] = self.origin - eye, self.parallel
        for axis, name in enumerate(("right", "up")):
            rows[name][:, :3], rows[name][:, 3] = self.axes[:, axis] / half, corners[:, axis]
        rows["forward"][:, :3], rows["forward"][:, 3] = self.axes[:, 2], self.near
        rows["extent"][:, 0], rows["extent"][:, 1] = self.resolution, 2.0 * self.half / self.resolution

    def sees(self, centers: Array, halves: Array) -> Array:
        """Which boxes can cast into each map.  (F, K) bool, conservative.

        ``centers``, ``halves`` (K, 3): middles and half extents along the world's axes.
        """
        at = np.einsum("fkj,fij->ifk", centers - self.origin[:, None], self.axes)
        size = np.einsum("kj,fij->ifk", halves, np.abs(self.axes))
        half, parallel = self.half[:, None], self.parallel[:, None]
        reach = np.where(parallel, half, (at[2] + size[2]) * half)
        ahead = parallel | (at[2] + size[2] > 0)
        return ahead & (np.abs(at[0]) <= reach + size[0]) & (np.abs(at[1]) <= reach + size[1])

    def shown(self, rows: Array, draws: Array, centers: Array, halves: Array) -> Shown:
        """Where ``draws`` (P,) may be seen in the maps of faces ``rows`` (P,).

        ``centers``, ``halves`` (P, 3) as of ``sees``.
        """
        at = np.einsum("pcj,pij->pci", corners_of(centers - self.origin[rows], halves), self.axes[rows])
        at[..., :2] /= self.half[rows, None, None]
        z, near, parallel = at[..., 2:], self.near[rows, None, None], self.parallel[rows, None, None]
        depth = np.where(parallel, 1.0 - z / near, near)
        clip = np.concatenate([at[..., :2], depth, np.where(parallel, 1.0, z)], axis=-1)
        return Shown.projected(draws, clip, self.resolution[rows, None])


def map_sizes(scene: Scene, ranked: list[int], texels: int, limit: int, sun: Sun | None = None) -> dict[int, int]:
    """Row of the light table -> texels along its maps, before DIRECTIONAL_TEXELS: all maps fit one atlas.

    ``ranked``: rows of the lights with shadows, the most significant first.  The first FULL_SIZE_SHADOWS have
    ``texels``, the others half.  While the atlas would be larger than ``limit`` texels along a side, as few as possible
    of the lights with the largest maps, the least significant ones, get half of that, down to SMALLEST_MAP.
    """
    sizes = wanted_sizes(ranked, texels)
    faces = [(f.light, f.resolution) for f in faces_of(scene, None, sorted(ranked), (np.zeros(3), 1.0), 1, sun)]

    def fits(tried: dict[int, int]) -> bool:
        return max(_pack([factor * tried[row] for row, factor in faces], limit)[1]) <= limit

    while not fits(sizes) and max(sizes.values()) > SMALLEST_MAP:  # else the atlas is refused where it is allocated
        largest = [row for row in ranked if sizes[row] == max(sizes.values())]
        low, high = 0, len(largest)  # lights that keep their size: ``high`` are too many
        while high - low > 1:
            middle = (low + high) // 2
            tried = sizes | {row: sizes[row] // 2 for row in largest[middle:]}
            low, high = (middle, high) if fits(tried) else (low, middle)
        sizes = sizes | {row: sizes[row] // 2 for row in largest[low:]}
    return sizes


def wanted_sizes(ranked: list[int], texels: int) -> dict[int, int]:
    """``map_sizes`` of an atlas without limit."""
    return {row: texels if i < FULL_SIZE_SHADOWS else texels // 2 for i, row in enumerate(ranked)}


def is_wide(light: Light) -> bool:
    """Whether a spot has the cube of maps of a point light.

    Taken from the rest state: a light keeps its maps over the animation.
    """
    return light.kind == "spot" and light.outer_cone > WIDEST_MAP


def light_faces(
    row: int,
    light: Light,
    position: Array,
    direction: Array,
    bounds: tuple[Array, float],
    resolution: int,
    *,
    cube: bool = False,
) -> list[Face]:
    """The faces a light needs: six for a point and for a spot that ``is_wide`` (``cube``), one for others.

    ``bounds``: center (3,) and radius of everything that casts or receives, world.
    """
    center, radius = bounds
    near = max(NEAR_FRACTION * radius, 1e-6)
    if cube or light.kind == "point":
        return [Face(row, False, position, *axes, 1.0, near, resolution) for axes in _CUBE]
    right, up = _frame(direction)
    if light.kind == "spot":
        half = np.tan(min(light.outer_cone, WIDEST_MAP)) * CONE_MARGIN
        return [Face(row, False, position, right, up, direction, half, near, resolution)]
    # Directional: the whole scene in one map, snapped to nothing, because neither the scene nor the light moves with
    # the camera.  The map's depth runs from the sphere's near side to its far side.
    origin = center - direction * radius
    return [Face(row, True, origin, right, up, direction, radius, 2.0 * radius, resolution)]


def faces_of(
    scene: Scene,
    state: FrameState | None,
    rows: list[int],
    bounds: tuple[Array, float],
    resolution: int | Mapping[int, int],
    sun: Sun | None = None,
) -> list[Face]:
    """Faces of the lights in ``rows`` of the light table; ``state`` None: their number and sizes only.

    ``resolution``: texels along a face, of all lights or by row.  ``sun``: the light of the row after those of the
    scene's lights.

    A directional map covers the whole scene, so it gets DIRECTIONAL_TEXELS times the texels along each side.
    """
    nodes = scene.light_nodes
    out = []
    for row in rows:
        texels = resolution if isinstance(resolution, int) else resolution[row]
        if sun is not None and row == len(nodes):
            light, direction = Light(kind="directional"), np.array(sun.direction)
            out += light_faces(row, light, np.zeros(3), direction, bounds, DIRECTIONAL_TEXELS * texels)
            continue
        node = int(nodes[row])
        index = int(scene.nodes.light[node])
        light = (scene.lights if state is None else state.lights)[index]
        position, direction = np.zeros(3), -np.eye(3)[2]
        if state is not None:
            world = state.world[node]
            position, direction = world[:3, 3].copy(), -normalize(world[:3, 2])
        size = texels * (DIRECTIONAL_TEXELS if light.kind == "directional" else 1)
        out += light_faces(row, light, position, direction, bounds, size, cube=is_wide(scene.lights[index]))
    return out


def first_faces(faces: list[Face]) -> dict[int, int]:
    """Row of the light table -> index of the first of its faces."""
    return {face.light: i for i, face in reversed(list(enumerate(faces)))}


def _frame(forward: Array) -> tuple[Array, Array]:
    """Two unit axes across ``forward``, a function of it alone."""
    helper = np.array([0.0, 1.0, 0.0]) if abs(forward[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    right = normalize(cross(forward, helper))
    return right, cross(right, forward)


def pack(faces: list[Face], limit: int = 16384) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Shelf packing, largest first: atlas offsets of each face, and the atlas's size in texels.

    The atlas is as narrow as keeps its height within ``limit``; where no width does, higher.
    """
    return _pack([face.resolution for face in faces], limit)


def _pack(sides: list[int], limit: int) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """``pack`` of squares with these sides."""
    if not sides:
        return [], (1, 1)
    width = max(max(sides), min(8192 if len(sides) > 16 else 4096, limit))
    while (packed := _shelves(sides, width))[1][1] > limit and width < limit:
        width = min(2 * width, limit)
    return packed


def _shelves(sides: list[int], width: int) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """``pack`` into shelves of ``width`` texels."""
    offsets: list[tuple[int, int]] = [(0, 0)] * len(sides)
    x = y = shelf = 0
    for i in sorted(range(len(sides)), key=lambda i: -sides[i]):
        size = sides[i]
        if x + size > width:
            x, y, shelf = 0, y + shelf, 0
        offsets[i] = (x, y)
        x, shelf = x + size, max(shelf, size)
    return offsets, (width, y + shelf)
