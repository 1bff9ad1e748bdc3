"""Small Scenes made in code, for tests that must not depend on a file reader."""

from __future__ import annotations

import numpy as np

from taubench_gl.scene.model import Channel, Mesh, Nodes, Primitive, Scene

NODE_FIELDS = {"mesh": -1, "skin": -1, "camera": -1, "light": -1}


def make_nodes(parents, **fields) -> Nodes:
    """Nodes with glTF's defaults; ``fields`` replace whole arrays, e.g. ``translation=[[1, 0, 0]]``."""
    n = len(parents)
    given = dict(fields)
    rotation = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))

    def floats(name, default):
        return np.array(given.pop(name, default), dtype=np.float64).reshape(np.shape(default))

    arrays = {
        "names": tuple(given.pop("names", [f"n{i}" for i in range(n)])),
        "parent": np.array(parents, dtype=np.int32),
        "translation": floats("translation", np.zeros((n, 3))),
        "rotation": floats("rotation", rotation),
        "scale": floats("scale", np.ones((n, 3))),
        "matrix": floats("matrix", np.tile(np.eye(4), (n, 1, 1))),
        "has_matrix": np.array(given.pop("has_matrix", np.zeros(n)), dtype=bool),
        "visible": np.array(given.pop("visible", np.ones(n)), dtype=bool),
        "in_scene": np.array(given.pop("in_scene", np.ones(n)), dtype=bool),
        "weights": given.pop("weights", {}),
        "instances": given.pop("instances", {}),
    }
    for name, default in NODE_FIELDS.items():
        arrays[name] = np.array(given.pop(name, np.full(n, default)), dtype=np.int32)
    assert not given, f"unknown node fields {sorted(given)}"
    return Nodes(**arrays)


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
