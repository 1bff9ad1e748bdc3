"""What puts a Scene together without a glTF file: nodes one at a time, and bounds at rest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from taubench_gl import math3d
from taubench_gl.scene.model import Mesh, Nodes

Array = np.ndarray


@dataclass
class NodeList:
    """Grows node by node; ``nodes`` turns it into the arrays of the model."""

    names: list[str] = field(default_factory=list)
    parent: list[int] = field(default_factory=list)
    translation: list[Array] = field(default_factory=list)
    rotation: list[Array] = field(default_factory=list)
    scale: list[Array] = field(default_factory=list)
    matrix: list[Array | None] = field(default_factory=list)
    mesh: list[int] = field(default_factory=list)
    skin: list[int] = field(default_factory=list)
    camera: list[int] = field(default_factory=list)
    light: list[int] = field(default_factory=list)
    visible: list[bool] = field(default_factory=list)
    in_scene: list[bool] = field(default_factory=list)
    weights: dict[int, Array] = field(default_factory=dict)
    instances: dict[int, Array] = field(default_factory=dict)

    def add(
        self,
        name: str,
        parent: int = -1,
        *,
        translation: ArrayLike = (0.0, 0.0, 0.0),
        rotation: ArrayLike = (0.0, 0.0, 0.0, 1.0),
        scale: ArrayLike = (1.0, 1.0, 1.0),
        matrix: Array | None = None,
        mesh: int = -1,
        skin: int = -1,
        camera: int = -1,
        light: int = -1,
        visible: bool = True,
        in_scene: bool = True,
        weights: Array | None = None,
        instances: Array | None = None,
    ) -> int:
        """Index of the new node.

        ``rotation`` is a unit quaternion xyzw; ``matrix`` (4, 4) takes the place of translation, rotation and scale;
        ``weights`` (M,) are the node's own morph weights, ``instances`` (K, 4, 4) as in ``Nodes``.
        """
        index = len(self.names)
        self.names.append(name)
        self.parent.append(parent)
        self.translation.append(np.array(translation, dtype=np.float64))
        self.rotation.append(np.array(rotation, dtype=np.float64))
        self.scale.append(np.array(scale, dtype=np.float64))
        self.matrix.append(matrix)
        self.mesh.append(mesh)
        self.skin.append(skin)
        self.camera.append(camera)
        self.light.append(light)
        self.visible.append(visible)
        self.in_scene.append(in_scene)
        if weights is not None:
            self.weights[index] = weights
        if instances is not None:
            self.instances[index] = instances
        return index

    def __len__(self) -> int:
        return len(self.names)

    def nodes(self) -> Nodes:
        count = len(self.names)
        matrices = [np.eye(4) if m is None else m for m in self.matrix]
        return Nodes(
            names=tuple(self.names),
            parent=np.array(self.parent, dtype=np.int32),
            translation=np.array(self.translation).reshape(count, 3),
            rotation=np.array(self.rotation).reshape(count, 4),
            scale=np.array(self.scale).reshape(count, 3),
            matrix=np.array(matrices, dtype=np.float64).reshape(count, 4, 4),
            has_matrix=np.array([m is not None for m in self.matrix], dtype=bool),
            mesh=np.array(self.mesh, dtype=np.int32),
            skin=np.array(self.skin, dtype=np.int32),
            camera=np.array(self.camera, dtype=np.int32),
            light=np.array(self.light, dtype=np.int32),
            visible=np.array(self.visible, dtype=bool),
            in_scene=np.array(self.in_scene, dtype=bool),
            weights=dict(self.weights),
            instances=dict(self.instances),
        )


def half_diagonal(nodes: Nodes, meshes: tuple[Mesh, ...]) -> float:
    """Half the diagonal of the box around everything at rest, metres; 1 where there is nothing."""
    world = math3d.trs(nodes.translation, nodes.rotation, nodes.scale)
    for level in nodes.levels()[1:]:
        world[level] = world[nodes.parent[level]] @ world[level]
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for node in np.flatnonzero(nodes.mesh >= 0).tolist():
        for primitive in meshes[nodes.mesh[node]].primitives:
            points = math3d.transform_points(world[node], primitive.positions.astype(np.float64))
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    size = 0.5 * float(np.linalg.norm(high - low))
    return size if np.isfinite(size) and size > 0 else 1.0
