"""Scene + seconds -> FrameState, and the float64 reference for GPU skinning and morphing.

Sources: glTF 2.0 sections 3.5 (node transforms), 3.7.2.2 (morph targets), 3.7.3 (skins), KHR_node_visibility.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation.curves import Timeline
from taubench_gl.animation.state import FrameState
from taubench_gl.conventions import DEFAULT_FPS
from taubench_gl.errors import SceneError
from taubench_gl.scene.model import Camera, Channel, Light, Primitive, Scene

Array = np.ndarray

LARGEST = 1e18
"""Limit on the entries of world transforms, scene units: their squares, used in lighting, fit a float32."""


KEPT_BYTES, NODE_BYTES, LIGHT_BYTES = 16 << 20, 160, 400
"""Memory of the states that a Poser keeps, and about what a state has of each node and of each light."""


class Poser:
    """Samples one scene at many times.  Contains only data derived from the scene.

    ``fps``: rate of the run; a time within the tolerance of a key is the key's time (``curves.time_on_key``).
    """

    def __init__(self, scene: Scene, fps: float = DEFAULT_FPS):
        self.scene, self.fps = scene, fps
        self.timeline = Timeline(scene.channels, fps)
        nodes = scene.nodes
        self._levels = nodes.levels()
        self._fixed = np.flatnonzero(nodes.has_matrix)
        self._weights = _default_weights(scene)
        for weights in self._weights.values():
            weights.flags.writeable = False  # shared by all states
        used = scene.mesh_nodes, scene.camera_nodes, scene.light_nodes, scene.joint_nodes
        self._used = np.unique(np.concatenate(used))  # nodes whose transforms something reads
        self._kept: dict[float, FrameState] = {}
        state_bytes = NODE_BYTES * len(nodes) + LIGHT_BYTES * len(scene.lights)
        self._most_kept = max(KEPT_BYTES // max(state_bytes, 1), 4)  # four: of two sources that each draw a pair

    @property
    def duration(self) -> float:
        """Duration of the scene in seconds."""
        return self.scene.duration

    def sample(self, t: float) -> FrameState:
        """The scene at ``t`` seconds, a pure function of (scene, fps, t).  Raises SceneError for huge transforms.

        The latest states are kept, as sources of one scene ask for the same times: transforms are read-only.
        """
        if t not in self._kept:
            state = self._sampled(t)
            state.world.flags.writeable = state.visible.flags.writeable = False
            while len(self._kept) >= self._most_kept:
                del self._kept[next(iter(self._kept))]
            self._kept[t] = state
        return self._kept[t]

    def _sampled(self, t: float) -> FrameState:
        nodes = self.scene.nodes
        values = {
            "translation": np.array(nodes.translation, dtype=np.float64),
            "rotation": np.array(nodes.rotation, dtype=np.float64),
            "scale": np.array(nodes.scale, dtype=np.float64),
        }
        node_visible = np.array(nodes.visible, dtype=bool)
        weights = dict(self._weights)
        cameras, lights = list(self.scene.cameras), list(self.scene.lights)
        for track, sampled in self.timeline.sample(t):
            if track.target == "camera":
                _set_parameters(cameras, track.index, track.path, sampled)
            elif track.target == "light":
                _set_parameters(lights, track.index, track.path, sampled)
            elif track.path == "visible":
                node_visible[track.index] = sampled[:, 0] > 0.5
            elif track.path == "weights":
                for node, row in zip(track.index.tolist(), sampled):
                    if node in weights:
                        weights[node] = _fit(row, len(weights[node]))
            else:
                values[track.path][track.index] = sampled
        local = math3d.trs(values["translation"], values["rotation"], values["scale"])
        # glTF forbids animating a node that has a matrix; the matrix has precedence.
        local[self._fixed] = nodes.matrix[self._fixed]
        world, visible = local, node_visible
        with np.errstate(over="ignore", invalid="ignore"):  # checked below, for nodes in use
            for level in self._levels[1:]:
                parent = nodes.parent[level]
                world[level] = world[parent] @ local[level]
                visible[level] &= visible[parent]
        if not (np.abs(world[self._used]) <= LARGEST).all():
            self._refuse(t, world)
        return FrameState(float(t), world, visible & nodes.in_scene, weights, tuple(cameras), tuple(lights))

    def overflowing(self, world: Array, nodes: Array | None = None) -> Array:
        """Nodes whose transforms exceed LARGEST or are not finite, among ``nodes`` (None: all of the scene).

        (n,) int64.
        """
        nodes = np.flatnonzero(self.scene.nodes.in_scene) if nodes is None else nodes
        return nodes[~(np.abs(world[nodes]) <= LARGEST).all(axis=(1, 2))]

    def _refuse(self, t: float, world: Array) -> None:
        scene, node = self.scene, int(self.overflowing(world, self._used)[0])
        name = scene.nodes.names[node] or f"number {node}"
        raise SceneError(
            f"transform of node {name!r} exceeds {LARGEST:g} at {t:g} s",
            where=str(scene.path or scene.name),
            hint="scales multiply from parent to child: correct the scale or translation of the node or of an ancestor",
        )


def sample(scene: Scene, t: float, fps: float = DEFAULT_FPS) -> FrameState:
    """``Poser(scene, fps).sample(t)``.  For several times, create one ``Poser``."""
    return Poser(scene, fps).sample(t)


def present_nodes(scene: Scene, state: FrameState) -> Array:
    """Nodes that are there: visible and not scaled to zero, nor all joints of their skin.  -> (N,) bool."""
    sized = np.any(state.world[:, :3, :3] != 0.0, axis=(1, 2))
    out = state.visible & sized
    skinned = scene.mesh_nodes[scene.nodes.skin[scene.mesh_nodes] >= 0]
    of_skin = np.array([bool(sized[skin.joints].any()) for skin in scene.skins], dtype=bool)
    out[skinned] = state.visible[skinned] & of_skin[scene.nodes.skin[skinned]]
    return out


def moved_nodes(scene: Scene, channels: Iterable[Channel]) -> Array:
    """Nodes that one of ``channels`` moves or hides, themselves or by an ancestor.  (N,) bool."""
    nodes = scene.nodes
    moved = np.zeros(len(nodes), dtype=bool)
    moved[[c.index for c in channels if c.target == "node" and c.path != "weights"]] = True
    for level in nodes.levels()[1:]:
        moved[level] |= moved[nodes.parent[level]]
    return moved


def skin_matrices(scene: Scene, state: FrameState, skin: int) -> Array:
    """Palette world_from_mesh of skin number ``skin``: world[joint] @ inverse_bind.  -> (J, 4, 4) float64.

    The transform of the node with the skinned mesh is not used (glTF 3.7.3.3).
    """
    s = scene.skins[skin]
    return state.world[s.joints] @ s.inverse_bind


def is_skinned(scene: Scene, node: int, primitive: Primitive) -> bool:
    """Whether the skin of ``node`` deforms this primitive.  A primitive without joints moves with its node."""
    return scene.nodes.skin[node] >= 0 and primitive.joints is not None and primitive.weights is not None


def pose_vertices(
    scene: Scene, state: FrameState, node: int, primitive: Primitive, instance: int | None = None
) -> Array:
    """World positions of a primitive of ``node``'s mesh: morphed, then skinned or moved with its node.

    -> (V, 3) float64, scene units.  ``instance``: index into ``nodes.instances[node]``; None: the transform of the node
    alone.
    """
    pos = _morphed(primitive.positions, [t.positions for t in primitive.targets], state.weights.get(node))
    if is_skinned(scene, node, primitive):
        world_from_mesh = _blended(scene, state, node, primitive)
        return np.einsum("vij,vj->vi", world_from_mesh[:, :3, :3], pos) + world_from_mesh[:, :3, 3]
    return math3d.transform_points(_world_from_mesh(scene, state, node, instance), pos)


def pose_once(
    posed: dict[tuple, Array],
    scene: Scene,
    state: FrameState,
    node: int,
    primitive: Primitive,
    instance: int | None = None,
) -> Array:
    """``pose_vertices``, kept in ``posed`` of this state: a file can give thousands of primitives the same vertices."""
    arrays = (primitive.positions, primitive.joints, primitive.weights, *(t.positions for t in primitive.targets))
    key = (node, instance, *map(id, arrays))
    if key not in posed:
        posed[key] = pose_vertices(scene, state, node, primitive, instance)
    return posed[key]


def pose_normals(
    scene: Scene, state: FrameState, node: int, primitive: Primitive, instance: int | None = None
) -> Array | None:
    """Unit normals of a primitive, posed as ``pose_vertices`` poses it.  -> (V, 3) float64, world; None where it has
    none (flat).
    """
    if primitive.normals is None:
        return None
    normals = _morphed(primitive.normals, [t.normals for t in primitive.targets], state.weights.get(node))
    if is_skinned(scene, node, primitive):
        normal_matrix = math3d.normal_matrix(_blended(scene, state, node, primitive)[:, :3, :3])
        return math3d.normalize(np.einsum("vij,vj->vi", normal_matrix, normals))
    normal_matrix = math3d.normal_matrix(_world_from_mesh(scene, state, node, instance)[:3, :3])
    return math3d.normalize(normals @ normal_matrix.T)


def target_count(scene: Scene, mesh: int) -> int:
    """Number of morph targets of a mesh: the maximum over its primitives."""
    return max((len(p.targets) for p in scene.meshes[mesh].primitives), default=0)


def _world_from_mesh(scene: Scene, state: FrameState, node: int, instance: int | None) -> Array:
    world = state.world[node]
    return world if instance is None else world @ scene.nodes.instances[node][instance]


def _blended(scene: Scene, state: FrameState, node: int, primitive: Primitive) -> Array:
    """Linear blend skinning: one world_from_mesh per vertex.  -> (V, 4, 4) float64."""
    palette = skin_matrices(scene, state, int(scene.nodes.skin[node]))
    out = np.zeros((len(primitive.positions), 4, 4))
    for influence in range(primitive.joints.shape[1]):  # one at a time: (V, k, 4, 4) needs much memory
        weight = primitive.weights[:, influence].astype(np.float64)
        out += weight[:, None, None] * palette[primitive.joints[:, influence]]
    return out


def _morphed(base: Array, targets: list[Array | None], weights: Array | None) -> Array:
    """Morphed vertices: ``base`` + sum of weight * displacement.  -> (V, 3) float64."""
    out = base.astype(np.float64)
    if weights is not None:
        for target, weight in zip(targets, weights):
            if target is not None and weight != 0.0:
                out += weight * target
    return out


def _default_weights(scene: Scene) -> dict[int, Array]:
    """Default morph weights of every node whose mesh has targets: those of the node, else of its mesh, else 0."""
    out = {}
    for node in np.flatnonzero(scene.nodes.mesh >= 0).tolist():
        mesh = int(scene.nodes.mesh[node])
        count = target_count(scene, mesh)
        if count:
            node_weights = scene.nodes.weights.get(node)
            out[node] = _fit(scene.meshes[mesh].weights if node_weights is None else node_weights, count)
    return out


def _fit(weights: Array, count: int) -> Array:
    """Exactly ``count`` weights, missing ones 0.  Always a new array."""
    out = np.zeros(count)
    file_weights = np.asarray(weights, dtype=np.float64).ravel()[:count]
    out[: len(file_weights)] = file_weights
    return out


def _set_parameters(items: list[Camera] | list[Light], index: Array, path: str, values: Array) -> None:
    for i, row in zip(index.tolist(), values.tolist()):
        items[i] = dataclasses.replace(items[i], **{path: tuple(row) if path == "color" else row[0]})
