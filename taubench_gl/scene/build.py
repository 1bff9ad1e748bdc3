"""What several readers make: nodes as records, Phong materials, and the one animation of a file without names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from taubench_gl.scene.model import Animation, Channel, Material, Nodes, Texture

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
        def column(name: str, width: int = 0) -> Array:
            values = [getattr(node, name) for node in self]
            return np.array(values, dtype=np.float64).reshape(len(self), width) if width else np.array(values, np.int32)

        out = Nodes(
            names=tuple(node.name for node in self),
            translation=column("translation", 3),
            rotation=column("rotation", 4),
            scale=column("scale", 3),
            matrix=np.array([np.eye(4) if n.matrix is None else n.matrix for n in self], np.float64).reshape(-1, 4, 4),
            has_matrix=np.array([n.matrix is not None for n in self], dtype=bool),
            **{name: column(name) for name in ("parent", "mesh", "skin", "camera", "light")},
            **{name: column(name).astype(bool) for name in ("visible", "in_scene")},
            weights={i: node.weights for i, node in enumerate(self) if node.weights is not None},
            instances={i: node.instances for i, node in enumerate(self) if node.instances is not None},
        )
        for part in fields(out):
            if isinstance(array := getattr(out, part.name), np.ndarray):
                array.flags.writeable = False
        return out


@dataclass(frozen=True, slots=True)
class Phong:
    """A surface of OBJ or AFF: linear coefficients of at least 0, and an exponent ``shine``."""

    diffuse: Sequence[float]
    specular: Sequence[float]
    shine: float
    alpha: float
    texture: Texture | None
    emission: tuple[float, float, float]
    emission_texture: Texture | None

    def material(self, name: str) -> Material:
        """Metallic-roughness: Lambertian without specular reflection, else a roughness of (2 / (shine + 2)) ^ 1/4."""
        return Material(
            name=name,
            base_color=(*(min(float(c), 1.0) for c in self.diffuse), self.alpha),
            base_color_texture=self.texture,
            metallic=0.0,
            roughness=float((2.0 / (max(self.shine, 0.0) + 2.0)) ** 0.25),
            emissive=self.emission,
            emissive_texture=self.emission_texture,
            alpha_mode="BLEND" if self.alpha < 1.0 else "OPAQUE",
            double_sided=True,
            specular=1.0 if any(self.specular) else 0.0,
        )


def only_animation(name: str, channels: list[Channel], plays: bool) -> dict[str, Any]:
    """Fields of a Scene whose file has at most one animation."""
    if not channels:
        return {}
    animation = Animation(name, tuple(channels))
    playing = {"channels": animation.channels, "playing": (name,)} if plays else {}
    return {"animations": (animation,), **playing}
