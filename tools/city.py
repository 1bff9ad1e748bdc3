"""Makes a city-like scene as a .glb, of any size: towers, textures of 1024x1024, a moving camera, moving lights."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image

SPAN = 3.0
"""Meters from tower to tower."""

FLOAT, UINT, ARRAYS, INDICES = 5126, 5125, 34962, 34963


class _Glb:
    """A document whose buffer grows array by array."""

    def __init__(self) -> None:
        self.document: dict[str, Any] = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}
        self._data = bytearray()

    def view(self, data: bytes, **more: int) -> int:
        self._data += bytes(-len(self._data) % 4)
        views = self.document["bufferViews"]
        views.append({"buffer": 0, "byteOffset": len(self._data), "byteLength": len(data), **more})
        self._data += data
        return len(views) - 1

    def accessor(self, values: np.ndarray, kind: str, **more: int) -> int:
        component = UINT if values.dtype == np.uint32 else FLOAT
        entry = {"bufferView": self.view(values.tobytes(), **more), "componentType": component, "count": len(values)}
        bounds = {"min": np.atleast_1d(values.min(axis=0)).tolist(), "max": np.atleast_1d(values.max(axis=0)).tolist()}
        self.document["accessors"].append(entry | {"type": kind} | bounds)
        return len(self.document["accessors"]) - 1

    def write(self, path: Path) -> None:
        self._data += bytes(-len(self._data) % 4)
        text = json.dumps(self.document | {"buffers": [{"byteLength": len(self._data)}]}).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(self._data))
        chunks = [struct.pack("<I4s", len(text), b"JSON"), text, struct.pack("<I4s", len(self._data), b"BIN\0")]
        path.write_bytes(b"".join([head, *chunks, self._data]))


def write_city(path: Path, triangles: int, lights: int = 8, textures: int = 8, sides: int = 50) -> Path:
    """``path``, written with about so many ``triangles``, in towers of 2 ``sides``^2, and moving point ``lights``."""
    g, rng = _Glb(), np.random.default_rng(1)
    towers = max(triangles // (2 * sides * sides), 1)
    u, v = np.meshgrid(*2 * [np.arange(sides + 1) / sides])
    corner = (np.arange(sides)[:, None] * (sides + 1) + np.arange(sides)).ravel()
    quads = np.stack([corner, corner + 1, corner + sides + 2, corner, corner + sides + 2, corner + sides + 1], axis=1)
    indices = g.accessor(quads.astype(np.uint32).ravel(), "SCALAR", target=INDICES)
    texcoords = g.accessor(np.stack([3 * u, 3 * v], -1).reshape(-1, 2).astype(np.float32), "VEC2", target=ARRAYS)
    meshes, nodes, width = [], [], int(np.ceil(np.sqrt(towers)))
    for tower in range(towers):
        angle, waves = 2 * np.pi * u, rng.integers(2, 9)
        r = 0.6 + 0.2 * rng.random() + 0.1 * np.sin(waves * angle + 20 * v)
        positions = np.stack([r * np.cos(angle), v * (2 + 8 * rng.random()), -r * np.sin(angle)], -1).reshape(-1, 3)
        normals = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], -1).reshape(-1, 3)
        attributes = {"POSITION": positions, "NORMAL": normals}
        arrays = {n: g.accessor(a.astype(np.float32), "VEC3", target=ARRAYS) for n, a in attributes.items()}
        primitive = {"attributes": arrays | {"TEXCOORD_0": texcoords}, "indices": indices, "material": tower % textures}
        meshes.append({"primitives": [primitive]})
        place = [SPAN * (tower % width - width / 2), 0.0, SPAN * (tower // width - width / 2)]
        nodes.append({"mesh": tower, "translation": place})
    times = np.linspace(0.0, 2.0, 49, dtype=np.float32)
    clock, samplers, channels = g.accessor(times, "SCALAR"), [], []

    def moving(node: dict[str, Any], points: np.ndarray) -> None:
        output = g.accessor(points.astype(np.float32), "VEC3")
        channels.append({"sampler": len(samplers), "target": {"node": len(nodes), "path": "translation"}})
        samplers.append({"input": clock, "output": output, "interpolation": "LINEAR"})
        nodes.append(node)

    moving({"camera": 0}, np.stack([20 * np.sin(times), 2 + 0.2 * times, 20 - 15 * times], axis=1))
    nodes.append({"rotation": [-0.5, 0.2, 0, 0.8426], "extensions": {"KHR_lights_punctual": {"light": 0}}})
    sources: list[dict[str, Any]] = [{"type": "directional", "intensity": 3.0}]
    for light in range(lights):
        sources.append({"type": "point", "intensity": 30.0, "color": rng.random(3).round(2).tolist()})
        center = rng.uniform((-40, 2, -40), (40, 2, 40))
        points = center + np.stack([np.sin(3 * times + light), 0 * times, np.cos(3 * times + light)], axis=1)
        moving({"extensions": {"KHR_lights_punctual": {"light": light + 1}}}, points)
    images = []
    for _ in range(textures):
        noise = PIL.Image.fromarray(rng.integers(0, 255, (64, 64, 3), np.uint8)).resize((1024, 1024))
        noise.save(file := io.BytesIO(), "JPEG")
        images.append({"bufferView": g.view(file.getvalue()), "mimeType": "image/jpeg"})
    shading = [
        {"baseColorTexture": {"index": t}, "metallicFactor": 0.0, "roughnessFactor": 0.7} for t in range(textures)
    ]
    g.document |= {
        "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes, "meshes": meshes, "images": images,
        "textures": [{"source": t} for t in range(textures)],
        "animations": [{"channels": channels, "samplers": samplers}],
        "materials": [{"pbrMetallicRoughness": s} for s in shading], "extensionsUsed": ["KHR_lights_punctual"],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.9, "znear": 0.05}}],
        "extensions": {"KHR_lights_punctual": {"lights": sources}},
    }  # fmt: skip
    g.write(path)
    return path
