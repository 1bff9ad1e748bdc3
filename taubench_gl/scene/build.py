"""Scenes without a glTF file: nodes as records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from taubench_gl.scene.model import Nodes

Array = np.ndarray


@dataclass
class Node:
    """One node, with glTF's defaults; fields as in ``Nodes``, -1 for no reference."""

    name: str
    parent: int = -1
    translation: ArrayLike = (0.0, 0.0, 0.0)
    rotation: ArrayLike = (0.0, 0.0, 0.0, 1.0)  # unit quaternion xyzw
    scale: ArrayLike = (1.0, 1.0, 1.0)
    matrix: Array | None = None  # (4, 4), instead of translation, rotation and scale
    mesh: int = -1
    skin: int = -1
    camera: int = -1
    light: int = -1
    visible: bool = True
    in_scene: bool = True
    weights: Array | None = None  # (M,) morph weights of the node
    instances: Array | None = None  # (K, 4, 4) node_from_instance


class NodeList(list[Node]):
    """Nodes in file order; ``nodes`` converts them to the arrays of the model."""

    def add(self, name: str, parent: int = -1, **fields: Any) -> int:
        """Append ``Node(name, parent, **fields)``.  -> its index."""
        self.append(Node(name, parent, **fields))
        return len(self) - 1

    def nodes(self) -> Nodes:
        def array(field: str, width: int = 0) -> Array:
            values = [getattr(node, field) for node in self]
            return np.array(values, dtype=np.float64).reshape(len(self), width) if width else np.array(values, np.int32)

        return Nodes(
            names=tuple(node.name for node in self),
            parent=array("parent"),
            translation=array("translation", 3),
            rotation=array("rotation", 4),
            scale=array("scale", 3),
            matrix=np.array([np.eye(4) if n.matrix is None else n.matrix for n in self], np.float64).reshape(-1, 4, 4),
            has_matrix=np.array([n.matrix is not None for n in self], dtype=bool),
            mesh=array("mesh"),
            skin=array("skin"),
            camera=array("camera"),
            light=array("light"),
            visible=array("visible").astype(bool),
            in_scene=array("in_scene").astype(bool),
            weights={i: node.weights for i, node in enumerate(self) if node.weights is not None},
            instances={i: node.instances for i, node in enumerate(self) if node.instances is not None},
        )
