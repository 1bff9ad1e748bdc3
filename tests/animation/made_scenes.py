"""Small scenes without files, for tests that do not depend on a reader."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from taubench_gl.scene.build import NodeList
from taubench_gl.scene.model import Channel, Mesh, Nodes, Primitive, Scene


def make_nodes(parents, **fields) -> Nodes:
    """Nodes with glTF's defaults; ``fields`` are whole columns, e.g. ``translation=[[1, 0, 0]]``.

    A ``matrix`` is used where ``has_matrix`` is set, as in the model, and ignored elsewhere.
    """
    count, nodes = len(parents), NodeList()
    names = fields.pop("names", [f"n{i}" for i in range(count)])
    by_node = {name: fields.pop(name, {}) for name in ("weights", "instances")}
    matrix, has_matrix = fields.pop("matrix", None), fields.pop("has_matrix", [False] * count)
    assert all(len(column) == count for column in (names, has_matrix, *fields.values()))
    for i, parent in enumerate(parents):
        own = {name: column[i] for name, column in fields.items()}
        own |= {name: given.get(i) for name, given in by_node.items()}
        nodes.add(names[i], parent, matrix=matrix[i] if has_matrix[i] else None, **own)
    made = nodes.nodes()
    return made if matrix is None else replace(made, matrix=np.array(matrix, dtype=np.float64))


def make_channel(index, path, times, values, interpolation="LINEAR", target="node") -> Channel:
    return Channel(target, index, path, interpolation, np.array(times, float), np.array(values, float))


def triangle(**fields) -> Primitive:
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float32)
    return Primitive(positions, np.array([[0, 1, 2]], dtype=np.uint32), **fields)


def triangle_mesh(**fields) -> Mesh:
    return Mesh("triangle", (triangle(**fields),))


def make_scene(parents, channels=(), **fields) -> Scene:
    """Scene fields by name (meshes, skins, cameras, lights); everything else goes to ``make_nodes``."""
    own = {k: tuple(fields.pop(k)) for k in ("meshes", "skins", "cameras", "lights") if k in fields}
    return Scene("test", make_nodes(parents, **fields), channels=tuple(channels), **own)
