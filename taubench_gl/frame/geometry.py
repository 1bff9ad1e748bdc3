"""From a Scene's meshes to flat vertex pools and draw records.  NumPy only; ``frame.scene_buffers`` uploads them.

Two pools: *fixed* primitives are stored once and placed by a matrix per draw; *posed* ones (skinned or morphed) get a
vertex range per draw, which the deform pass fills with camera-relative positions every frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from taubench_gl.scene.model import Mesh, Primitive, Scene

Array = np.ndarray


DEFAULTS = {"tangents": np.float32([1, 0, 0, 1]), "colors": np.float32([1, 1, 1, 1])}
"""Values of the attributes that most scenes have nothing else of."""


@dataclass(frozen=True, slots=True)
class VertexData:
    """One primitive made ready for drawing: every attribute present, flat-shaded triangles unwelded."""

    positions: Array  # (V, 3) float32
    normals: Array  # (V, 3) float32
    tangents: Array  # (V, 4) float32
    texcoords: tuple[Array, Array]  # (V, 2) float32 each
    colors: Array  # (V, 4) float32
    triangles: Array  # (T, 3) uint32
    flat: bool
    source: Array  # (V,) vertex of the primitive that each vertex was made from
    constant: frozenset[str] = frozenset()  # of tangents and colors: what every vertex has the default of

    def of(self, values: Array) -> Array:
        """``values`` (V, ...) of the primitive's vertices for these; the same array where they are the same."""
        return values[self.source] if self.flat else values


def make_vertex_data(primitive: Primitive, *, tangents: int | None) -> VertexData:
    """Fill in what the file leaves out: flat normals, texture coordinates, white colors, and tangents.

    ``tangents``: texture-coordinate set of the normal map that needs them; None: no tangents are needed.
    """
    flat = primitive.normals is None
    triangles = primitive.triangles
    source = triangles.reshape(-1) if flat else np.arange(len(primitive.positions))
    if flat:
        triangles = np.arange(len(source), dtype=np.uint32).reshape(-1, 3)
    count = len(source)

    def of_vertices(values: Array) -> Array:
        return values[source] if flat else values

    positions = of_vertices(primitive.positions)
    normals = np.repeat(face_normals(positions), 3, axis=0) if flat else primitive.normals
    texcoords = tuple(
        np.broadcast_to(np.float32(0), (count, 2)) if uv is None else uv[source].astype(np.float32)
        for uv in primitive.texcoords
    )
    if primitive.tangents is not None:
        tangent = of_vertices(primitive.tangents)
    elif tangents is not None:
        tangent = make_tangents(positions, normals, texcoords[tangents], triangles)
    else:
        tangent = np.broadcast_to(DEFAULTS["tangents"], (count, 4))
    white = np.broadcast_to(DEFAULTS["colors"], (count, 4))
    colors = white if primitive.colors is None else of_vertices(primitive.colors)
    constant = {"colors"} if primitive.colors is None else set()
    if primitive.tangents is None and tangents is None:
        constant.add("tangents")
    normals = normals.astype(np.float32, copy=False)
    return VertexData(positions, normals, tangent, texcoords, colors, triangles, flat, source, frozenset(constant))


def face_normals(positions: Array) -> Array:
    """Unit normals of unwelded triangles, float64 inside; degenerate triangles give 0.  (3 T, 3) -> (T, 3)."""
    corners = positions.astype(np.float64).reshape(-1, 3, 3)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.where(length > 0, normal / np.where(length > 0, length, 1.0), 0.0)


def make_tangents(positions: Array, normals: Array, uv: Array, triangles: Array) -> Array:
    """Per-vertex tangents where the file has none: area-weighted sums of the triangles' u directions (Lengyel).

    (V, 3), (V, 3), (V, 2), (T, 3) -> (V, 4) float32, w = handedness as glTF: bitangent = w cross(n, t).
    """
    p, t = positions.astype(np.float64)[triangles], uv.astype(np.float64)[triangles]
    e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    d1, d2 = t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]
    # Not divided by the determinant's size: that leaves a sum weighted by area in both spaces, finite everywhere.
    side = np.sign(d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1])[:, None]
    u = (e1 * d2[:, 1:] - e2 * d1[:, 1:]) * side
    v = (e2 * d1[:, :1] - e1 * d2[:, :1]) * side
    tangent, bitangent = np.zeros(positions.shape), np.zeros(positions.shape)
    for corner in range(3):
        np.add.at(tangent, triangles[:, corner], u)
        np.add.at(bitangent, triangles[:, corner], v)
    n = normals.astype(np.float64)
    tangent -= n * np.sum(n * tangent, axis=-1, keepdims=True)
    length = np.linalg.norm(tangent, axis=-1, keepdims=True)
    # No usable texture coordinates: any direction across the normal.
    spare = np.cross(n, np.where(np.abs(n[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    spare /= np.maximum(np.linalg.norm(spare, axis=-1, keepdims=True), 1e-30)
    tangent = np.where(length > 1e-30, tangent / np.maximum(length, 1e-30), spare)
    # Green is up in a normal map (glTF 3.9.3) while v runs down: the bitangent is against the v direction.
    hand = np.where(np.sum(np.cross(n, tangent) * bitangent, axis=-1) > 0, -1.0, 1.0)
    return np.concatenate([tangent, hand[:, None]], axis=-1).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Draw:
    """One primitive of one node (and instance): a row of the record table, ``ids`` channel = row + 1."""

    node: int
    mesh: int
    primitive: int
    material: int  # -1: the default material
    local: Array | None  # (4, 4) node_from_instance, EXT_mesh_gpu_instancing
    posed: bool
    base_vertex: int  # in its pool
    first_index: int
    index_count: int
    vertex_count: int
    flat: bool
    repeats: bool  # lies exactly on an earlier instance of its node at every time: nothing sees it


@dataclass(slots=True)
class Pool:
    """Attribute arrays of one pool, concatenated; tangents and colors are empty where all are the default."""

    positions: Array
    normals: Array
    tangents: Array
    texcoords0: Array
    texcoords1: Array
    colors: Array
    indices: Array  # (I,) uint32, relative to a draw's base vertex


@dataclass(slots=True)
class _Builder:
    parts: list[VertexData] = field(default_factory=list)
    vertices: int = 0
    indices: dict[int, int] = field(default_factory=dict)  # identity of a list of triangles -> its first index
    triangles: list[Array] = field(default_factory=list)  # those lists: tiles of a terrain often share one
    index_count: int = 0

    def add(self, vertices: VertexData) -> tuple[int, int]:
        base = self.vertices, self.indices.setdefault(id(vertices.triangles), self.index_count)
        self.parts.append(vertices)
        self.vertices += len(vertices.positions)
        if base[1] == self.index_count:
            self.triangles.append(vertices.triangles)
            self.index_count += vertices.triangles.size
        return base

    def pool(self, constants: bool = False) -> Pool:
        """The pool of the vertices added so far.  ``constants``: tangents and colors that are all the default are
        stored too.
        """

        def join(parts: list[Array], width: int, dtype=np.float32) -> Array:
            return np.concatenate([np.zeros((0, width), dtype), *parts]).astype(dtype, copy=False)

        def variable(name: str) -> list[VertexData]:
            return [] if not constants and all(name in s.constant for s in self.parts) else self.parts

        return Pool(
            join([s.positions for s in self.parts], 3),
            join([s.normals for s in self.parts], 3),
            join([s.tangents for s in variable("tangents")], 4),
            join([s.texcoords[0] for s in self.parts], 2),
            join([s.texcoords[1] for s in self.parts], 2),
            join([s.colors for s in variable("colors")], 4),
            join(self.triangles, 3, np.uint32).reshape(-1),
        )


@dataclass(frozen=True, slots=True)
class Geometry:
    draws: tuple[Draw, ...]
    fixed: Pool
    posed: Pool
    posed_vertices: dict[tuple[int, int], VertexData]  # (mesh, primitive) -> vertex data of a deformed primitive


def is_posed(scene: Scene, node: int, mesh: Mesh, primitive: Primitive) -> bool:
    """Whether the vertices themselves move: skinned, or morph targets present."""
    return bool(primitive.targets) or (scene.nodes.skin[node] >= 0 and primitive.joints is not None)


def build_geometry(scene: Scene) -> Geometry:
    """Pools and draws of everything the scene can draw, in node order."""
    fixed, posed = _Builder(), _Builder()
    made: dict[tuple[int, int], VertexData] = {}
    placed: dict[tuple[int, int], tuple[int, int]] = {}
    draws = []
    for node in scene.mesh_nodes:
        mesh_index = int(scene.nodes.mesh[node])
        mesh = scene.meshes[mesh_index]
        instances = scene.nodes.instances.get(int(node))
        for index, primitive in enumerate(mesh.primitives):
            if not len(primitive.triangles):
                continue
            key = (mesh_index, index)
            if key not in made:
                made[key] = make_vertex_data(primitive, tangents=_normal_map_set(scene, primitive))
            vertices = made[key]
            moves = is_posed(scene, node, mesh, primitive)
            places: set[bytes] = set()
            for local in [None] if instances is None else instances:
                if moves:
                    base = posed.add(vertices)
                else:
                    base = placed[key] = placed.get(key) or fixed.add(vertices)
                place = b"" if local is None else local.tobytes()
                draws.append(
                    Draw(
                        int(node), mesh_index, index, primitive.material, local, moves, base[0], base[1],
                        vertices.triangles.size, len(vertices.positions), vertices.flat, not moves and place in places,
                    )
                )  # fmt: skip
                places.add(place)
    posed_keys = {(d.mesh, d.primitive) for d in draws if d.posed}
    return Geometry(tuple(draws), fixed.pool(), posed.pool(constants=True), {k: made[k] for k in posed_keys})


def _normal_map_set(scene: Scene, primitive: Primitive) -> int | None:
    texture = scene.materials[primitive.material].normal_texture if primitive.material >= 0 else None
    return None if texture is None else texture.texcoord


def instanced_draws(draws: tuple[Draw, ...]) -> tuple[Array, Array]:
    """Rows of the draws of instanced nodes, (K,) int64, and their node_from_instance, (K, 4, 4) float64."""
    rows = [i for i, d in enumerate(draws) if d.local is not None]
    return np.array(rows, np.int64), np.array([draws[i].local for i in rows], np.float64).reshape(-1, 4, 4)


def instance_numbers(draws: tuple[Draw, ...]) -> list[int | None]:
    """Instance number of every draw of an instanced node, None of others."""
    seen: dict[tuple[int, int], int] = {}
    out: list[int | None] = []
    for d in draws:
        key = d.node, d.primitive
        number = seen[key] = seen.get(key, -1) + 1
        out.append(None if d.local is None else number)
    return out
