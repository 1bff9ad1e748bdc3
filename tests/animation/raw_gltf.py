"""A second implementation of poses from glTF files: struct, json, SciPy, one loop per node and per vertex.

Shares no code with the package, so that a misread convention cannot agree with itself.  Knows only what the sample
files use: no sparse accessors, no extensions.
"""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

FORMATS = {5120: ("b", 127), 5121: ("B", 255), 5122: ("h", 32767), 5123: ("H", 65535), 5125: ("I", 1), 5126: ("f", 1)}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class RawGltf:
    def __init__(self, path: Path):
        data = path.read_bytes()
        chunk = b""
        if data[:4] == b"glTF":
            length = struct.unpack_from("<I", data, 12)[0]
            self.json = json.loads(data[20 : 20 + length])
            chunk = data[20 + length + 8 :]
        else:
            self.json = json.loads(data)
        self.buffers = []
        for buffer in self.json["buffers"]:
            uri = buffer.get("uri")
            if uri is None:
                self.buffers.append(chunk)
            elif uri.startswith("data:"):
                self.buffers.append(base64.b64decode(uri.split(",", 1)[1]))
            else:
                self.buffers.append((path.parent / uri).read_bytes())

    def accessor(self, index: int) -> np.ndarray:
        accessor = self.json["accessors"][index]
        view = self.json["bufferViews"][accessor["bufferView"]]
        letter, scale = FORMATS[accessor["componentType"]]
        layout = "<" + letter * WIDTHS[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride = view.get("byteStride", struct.calcsize(layout))
        data = self.buffers[view["buffer"]]
        rows = [struct.unpack_from(layout, data, start + i * stride) for i in range(accessor["count"])]
        return np.array(rows, dtype=np.float64) / (scale if accessor.get("normalized") else 1)

    def animated(self, animation: dict, t: float) -> dict[tuple[int, str], np.ndarray]:
        """(node, path) -> value at t."""
        out = {}
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            times = self.accessor(sampler["input"])[:, 0]
            path = channel["target"]["path"]
            values = self.accessor(sampler["output"])
            kind = sampler.get("interpolation", "LINEAR")
            per_key = 3 if kind == "CUBICSPLINE" else 1
            values = values.reshape(len(times), per_key, -1)
            out[channel["target"]["node"], path] = blend(kind, path, times, values, t)
        return out

    def world(self, animation: dict, t: float) -> list[np.ndarray]:
        values = self.animated(animation, t)
        nodes = self.json["nodes"]
        parents = {child: i for i, node in enumerate(nodes) for child in node.get("children", ())}

        def local(i: int) -> np.ndarray:
            node = nodes[i]
            if "matrix" in node:
                return np.array(node["matrix"], float).reshape(4, 4).T
            move, turn, grow = np.eye(4), np.eye(4), np.eye(4)
            move[:3, 3] = values.get((i, "translation"), node.get("translation", [0, 0, 0]))
            quat = values.get((i, "rotation"), node.get("rotation", [0, 0, 0, 1]))
            turn[:3, :3] = Rotation.from_quat(quat).as_matrix()
            grow[:3, :3] = np.diag(values.get((i, "scale"), node.get("scale", [1, 1, 1])))
            return move @ turn @ grow

        def of(i: int) -> np.ndarray:
            return of(parents[i]) @ local(i) if i in parents else local(i)

        return [of(i) for i in range(len(nodes))]

    def vertices(self, animation: dict, t: float, node: int, primitive: int) -> np.ndarray:
        """World positions of one primitive, vertex by vertex."""
        spec = self.json["nodes"][node]
        mesh = self.json["meshes"][spec["mesh"]]
        prim = mesh["primitives"][primitive]
        world = self.world(animation, t)
        positions = self.accessor(prim["attributes"]["POSITION"])
        targets = prim.get("targets", [])
        rest = spec.get("weights", mesh.get("weights", [0.0] * len(targets)))
        for weight, target in zip(self.animated(animation, t).get((node, "weights"), rest), targets):
            positions = positions + weight * self.accessor(target["POSITION"])
        if "skin" not in spec:
            return np.array([(world[node] @ [*p, 1])[:3] for p in positions])
        skin = self.json["skins"][spec["skin"]]
        bind = [m.reshape(4, 4).T for m in self.accessor(skin["inverseBindMatrices"])]
        palette = [world[joint] @ b for joint, b in zip(skin["joints"], bind)]
        joints = self.accessor(prim["attributes"]["JOINTS_0"]).astype(int)
        weights = self.accessor(prim["attributes"]["WEIGHTS_0"])
        out = []
        for p, js, ws in zip(positions, joints, weights):
            out.append(sum(w * (palette[j] @ [*p, 1])[:3] for j, w in zip(js, ws / ws.sum())))
        return np.array(out)


def blend(kind: str, path: str, times: np.ndarray, values: np.ndarray, t: float) -> np.ndarray:
    """Appendix C of glTF 2.0, key by key.  ``values`` (K, 1 or 3, n)."""
    middle = values[:, values.shape[1] // 2]
    if t <= times[0]:
        return middle[0]
    if t >= times[-1]:
        return middle[-1]
    k = max(i for i in range(len(times)) if times[i] <= t)
    d = times[k + 1] - times[k]
    u = (t - times[k]) / d
    if kind == "STEP":
        return middle[k]
    if kind == "LINEAR":
        if path == "rotation":
            return Slerp([0, 1], Rotation.from_quat([middle[k], middle[k + 1]]))(u).as_quat()
        return middle[k] * (1 - u) + middle[k + 1] * u
    return (
        (2 * u**3 - 3 * u**2 + 1) * middle[k]
        + d * (u**3 - 2 * u**2 + u) * values[k, 2]
        + (-2 * u**3 + 3 * u**2) * middle[k + 1]
        + d * (u**3 - u**2) * values[k + 1, 0]
    )
