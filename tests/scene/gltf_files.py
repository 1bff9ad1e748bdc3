"""Writes small valid and invalid glTF files for tests of the reader."""

from __future__ import annotations

import base64
import copy
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
COMPONENT = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Gltf:
    """A document under construction; methods return the index of the new object."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}}
        self.blob = bytearray()

    def add(self, collection: str, item: dict[str, Any]) -> int:
        items = self.json.setdefault(collection, [])
        items.append(item)
        return len(items) - 1

    def view(self, data: bytes, **properties: Any) -> int:
        self.blob += bytes(-len(self.blob) % 4)
        offset = len(self.blob)
        self.blob += data
        return self.add("bufferViews", {"buffer": 0, "byteOffset": offset, "byteLength": len(data), **properties})

    def accessor(self, values: Any, dtype: str = "f4", normalized: bool = False, **properties: Any) -> int:
        """A (count,) or (count, n) array as a tightly packed accessor with correct bounds."""
        array = np.ascontiguousarray(values, dtype=f"<{dtype}")
        array = array.reshape(len(array), -1)
        item = {
            "bufferView": self.view(array.tobytes()),
            "componentType": COMPONENT[dtype],
            "count": len(array),
            "type": TYPES[array.shape[1]],
            "min": array.min(axis=0).tolist(),
            "max": array.max(axis=0).tolist(),
        }
        if normalized:
            item["normalized"] = True
        item.update(properties)
        return self.add("accessors", item)

    def mesh(self, positions: Any = TRIANGLE, indices: Any = None, mode: int | None = None, **attributes: int) -> int:
        """A mesh of one primitive; ``attributes`` are accessor indices by semantic."""
        primitive: dict[str, Any] = {"attributes": {"POSITION": self.accessor(positions), **attributes}}
        if indices is not None:
            primitive["indices"] = self.accessor(indices, "u2")
        if mode is not None:
            primitive["mode"] = mode
        return self.add("meshes", {"primitives": [primitive]})

    def node(self, **properties: Any) -> int:
        return self.add("nodes", properties)

    def animation(self, target: dict[str, Any], times: Any, values: Any, interpolation: Any = None, **kw: Any) -> int:
        sampler = {"input": self.accessor(times), "output": self.accessor(values, **kw)}
        if interpolation is not None:
            sampler["interpolation"] = interpolation
        return self.add("animations", {"samplers": [sampler], "channels": [{"sampler": 0, "target": target}]})

    def extension(self, name: str, value: dict[str, Any] | None = None) -> None:
        self.json.setdefault("extensionsUsed", []).append(name)
        if value is not None:
            self.json.setdefault("extensions", {})[name] = value

    def document(self) -> dict[str, Any]:
        out = copy.deepcopy(self.json)
        if self.blob and "buffers" not in out:
            payload = base64.b64encode(self.blob).decode()
            uri = f"data:application/octet-stream;base64,{payload}"
            out["buffers"] = [{"byteLength": len(self.blob), "uri": uri}]
        return out

    def save(self, folder: Path, name: str = "scene.gltf") -> Path:
        path = folder / name
        if path.suffix == ".glb":
            out = copy.deepcopy(self.json)
            if self.blob:
                out["buffers"] = [{"byteLength": len(self.blob)}]
            path.write_bytes(glb(json.dumps(out).encode(), bytes(self.blob) or None))
        else:
            path.write_text(json.dumps(self.document()), encoding="utf-8")
        return path


def glb(text: bytes, chunk: bytes | None = None) -> bytes:
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    if chunk is not None:
        chunk += bytes(-len(chunk) % 4)
        body += struct.pack("<II", len(chunk), 0x004E4942) + chunk
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def read_json(path: Path) -> dict[str, Any]:
    """JSON of a .gltf or .glb, by a second implementation."""
    data = path.read_bytes()
    if data[:4] == b"glTF":
        (size,) = struct.unpack_from("<I", data, 12)
        data = data[20 : 20 + size]
    return json.loads(data)


def read_parts(path: Path) -> tuple[dict[str, Any], bytes]:
    """JSON and binary chunk of a .glb."""
    data = path.read_bytes()
    (size,) = struct.unpack_from("<I", data, 12)
    return read_json(path), data[28 + size :]


def triangle_scene() -> Gltf:
    """One node, one mesh, one triangle."""
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh())
    return gltf
