"""The nodes of a scene as a tree: unique names, kinds, what is animated, and which draws belong to a node."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taubench_gl.frame.geometry import Draw
from taubench_gl.frame.raytracing.instances import changing_nodes
from taubench_gl.scene.model import Scene
from taubench_gl.viewer.state import NO_NODE

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class SceneTree:
    """Nodes by index, those of the chosen scene in ``roots`` and below.  ``children``: by index, in file order."""

    labels: tuple[str, ...]  # unique: the name, or the number where there is no name or another node has it
    kinds: tuple[str, ...]  # mesh, camera, light, joint, joined by commas; empty for a node that only groups others
    parent: Array  # (N,) int32, -1 for roots
    animated: Array  # (N,) bool: an animation changes the place, the visibility or the shape
    children: tuple[tuple[int, ...], ...]
    roots: tuple[int, ...]

    @classmethod
    def of(cls, scene: Scene) -> SceneTree:
        nodes = scene.nodes
        joints = {int(n) for skin in scene.skins for n in skin.joints}
        below: list[list[int]] = [[] for _ in nodes.names]
        roots = []
        for node in np.flatnonzero(nodes.in_scene).tolist():
            parent = int(nodes.parent[node])
            (roots if parent < 0 or not nodes.in_scene[parent] else below[parent]).append(node)
        members = {"mesh": nodes.mesh >= 0, "camera": nodes.camera >= 0, "light": nodes.light >= 0}
        kinds = [[n for n, has in members.items() if has[i]] + ["joint"] * (i in joints) for i in range(len(nodes))]
        labels, used = [], {NO_NODE}
        for node, name in enumerate(nodes.names):
            label = name if name and name not in used else f"{name or 'node'} {node}"
            while label in used:  # another node has the name with the number
                label += "'"
            labels.append(label)
            used.add(label)
        words = tuple(", ".join(kind) for kind in kinds)
        return cls(tuple(labels), words, nodes.parent, _animated(scene), tuple(map(tuple, below)), tuple(roots))

    def ancestors(self, node: int) -> set[int]:
        """Indices of the nodes above ``node``, up to its root."""
        out: set[int] = set()
        while (node := int(self.parent[node])) >= 0:
            out.add(node)
        return out

    def draws_of(self, node: int, draws: Sequence[Draw]) -> Array:
        """Which values of the channel ``ids`` are draws of ``node`` or of a node below it.  (D + 1,) bool; 0: sky."""
        under, stack = np.zeros(len(self.labels), dtype=bool), [node]
        while stack:
            under[stack[-1]] = True
            stack += self.children[stack.pop()]
        return np.append(False, under[np.array([d.node for d in draws], dtype=np.int64)])


def _animated(scene: Scene) -> Array:
    """Whether an animation changes the place, the visibility or the shape of each node, (N,) bool."""
    nodes, changing = scene.nodes, changing_nodes(scene)
    animated = changing.copy()
    animated[[c.index for c in scene.channels if c.target == "node" and c.path == "weights"]] = True
    for node in np.flatnonzero(nodes.skin >= 0).tolist():
        animated[node] |= changing[scene.skins[int(nodes.skin[node])].joints].any()
    return animated
