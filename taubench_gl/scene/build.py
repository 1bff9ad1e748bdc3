"""What readers of text formats share when they put a Scene together: nodes one at a time, and bounds at rest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from taubench_gl import math3d
from taubench_gl.scene.model import Mesh, Nodes

Array = np.ndarray


@dataclass
class NodeList:
    """Grows node by node; ``nodes`` turns it into the arrays of the model.  All nodes belong to the scene."""

    names: list[str] = field(default_factory=list)
    parent: list[int] = field(default_factory=list)
    translation: list[Array] = field(default_factory=list)
    rotation: list[Array] = field(default_factory=list)
    scale: list[Array] = field(default_factory=list)
    mesh: list[int] = field(default_factory=list)
    camera: list[int] = field(default_factory=list)
    light: list[int] = field(default_factory=list)

    def add(
        self,
        name: str,
        parent: int = -1,
        *,
        translation: Array = (0.0, 0.0, 0.0),
        rotation: Array = (0.0, 0.0, 0.0, 1.0),
        scale: Array = (1.0, 1.0, 1.0),
        mesh: int = -1,
        camera: int = -1,
        light: int = -1,
    ) -> int:
        """Index of the new node.  ``rotation`` is a unit quaternion xyzw."""
        self.names.append(name)
        self.parent.append(parent)
        self.translation.append(np.array(translation, dtype=np.float64))
        self.rotation.append(np.array(rotation, dtype=np.float64))
        self.scale.append(np.array(scale, dtype=np.float64))
        self.mesh.append(mesh)
        self.camera.append(camera)
        self.light.append(light)
        return len(self.names) - 1

    def __len__(self) -> int:
        return len(self.names)

    def nodes(self) -> Nodes:
        count = len(self.names)
        return Nodes(
            names=tuple(self.names),
            parent=np.array(self.parent, dtype=np.int32),
            translation=np.array(self.translation).reshape(count, 3),
            rotation=np.array(self.rotation).reshape(count, 4),
            scale=np.array(self.scale).reshape(count, 3),
            matrix=np.tile(np.eye(4), (count, 1, 1)),
            has_matrix=np.zeros(count, dtype=bool),
            mesh=np.array(self.mesh, dtype=np.int32),
            skin=np.full(count, -1, dtype=np.int32),
            camera=np.array(self.camera, dtype=np.int32),
            light=np.array(self.light, dtype=np.int32),
            visible=np.ones(count, dtype=bool),
            in_scene=np.ones(count, dtype=bool),
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
