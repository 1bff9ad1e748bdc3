"""Damaged glTF and EXR files, generated from a valid one and a seed number."""

from __future__ import annotations

import base64
import copy
import json
import random
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

VALUES = [
    -1, 0, 1, 2, 7, 255, 65535, 65536, 2**31 - 1, 2**31, 2**32, 2**53, 10**30, 0.5, -0.0, 1e308, -1e308, 1e-308, 1e39,
    True, False, None, "", "x", "../../x", "data:,", [], [0], [0, 0, 0], [1e38, 1e38, 1e38], [0, 0, 0, 0], {}, {"a": 1},
    5120, 5121, 5123, 5125, 5126, "SCALAR", "VEC2", "VEC3", "VEC4", "MAT4", "STEP", "LINEAR", "CUBICSPLINE",
]  # fmt: skip
FLOATS = [0.0, -0.0, 1e-45, 1e-38, 1e-20, 1e20, 3.4e38, -3.4e38, float("inf"), float("-inf"), float("nan"), 1.0, -1.0]


class _Seed:
    """A skinned, morphed, lit and animated scene in a few hundred bytes of buffer."""

    def __init__(self) -> None:
        self.blob = b""
        self.json: dict = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}

    def add(self, values: object, kind: str, dtype: str = "f4", bounds: bool = True) -> int:
        array = np.asarray(values, dtype=dtype)
        rows = array.reshape(len(array), -1)
        self.blob += bytes(-len(self.blob) % 4)
        view = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": array.nbytes}
        self.json["bufferViews"].append(view)
        component = {"f4": 5126, "u2": 5123, "u1": 5121}[dtype]
        accessor = {"bufferView": len(self.json["bufferViews"]) - 1, "componentType": component, "count": len(rows)}
        accessor |= {"type": kind}
        if bounds:
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.json["accessors"].append(accessor)
        self.blob += array.tobytes()
        return len(self.json["accessors"]) - 1


def gltf_seed() -> tuple[dict, bytes]:
    """(JSON without its buffer, buffer)."""
    s = _Seed()
    square = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    attributes = {
        "POSITION": s.add(square, "VEC3"),
        "NORMAL": s.add([[0, 0, 1]] * 4, "VEC3"),
        "JOINTS_0": s.add([[0, 1, 0, 0]] * 4, "VEC4", "u2"),
        "WEIGHTS_0": s.add([[0.5, 0.5, 0, 0]] * 4, "VEC4"),
        "TEXCOORD_0": s.add([[0, 0], [1, 0], [1, 1], [0, 1]], "VEC2"),
    }
    plain = {name: attributes[name] for name in ("POSITION", "NORMAL", "TEXCOORD_0")}
    indices = s.add([0, 1, 2, 0, 2, 3], "SCALAR", "u2")
    target = {"POSITION": s.add([[0, 0, 1], [0, 0, 0], [0, 1, 0], [0, 0, 0]], "VEC3")}
    times = s.add([0.0, 0.25, 0.5], "SCALAR")
    move = s.add([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "VEC3")
    spin = s.add([[0, 0, 0, 1], [0, 1, 0, 0], [0, 0, 0, -1]], "VEC4")
    swell = s.add([0.0, 1.0, 0.5], "SCALAR")
    bind = s.add(np.tile(np.eye(4), (2, 1, 1)).reshape(2, 16), "MAT4")
    spot = {"type": "spot", "spot": {}}
    s.json |= {
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 20}, spot]}},
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0.2, 1]}, "alphaMode": "MASK"}],
        "meshes": [
            {"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]},
            {"primitives": [{"attributes": plain, "targets": [target], "mode": 6}], "weights": [0.5]},
            {"primitives": [{"attributes": plain, "indices": indices, "mode": 4}]},
        ],
        "skins": [{"joints": [3, 4], "inverseBindMatrices": bind}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1, "zfar": 100.0}}],
        "nodes": [
            {"mesh": 0, "skin": 0},
            {"mesh": 1, "translation": [1, 0, -1]},
            {"mesh": 2, "scale": [2, 2, 2], "translation": [0, 0, -3], "children": [6]},
            {"children": [4]},
            {"translation": [0, 1, 0]},
            {"camera": 0, "translation": [0, 0, 6]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 2, 3]},
            {"extensions": {"KHR_lights_punctual": {"light": 1}}, "translation": [0, 0, 3]},
        ],
        "scenes": [{"nodes": [0, 1, 2, 3, 5, 7]}],
        "scene": 0,
        "animations": [
            {
                "samplers": [{"input": times, "output": o} for o in (move, spin, swell)],
                "channels": [
                    {"sampler": 0, "target": {"node": 5, "path": "translation"}},
                    {"sampler": 1, "target": {"node": 4, "path": "rotation"}},
                    {"sampler": 2, "target": {"node": 1, "path": "weights"}},
                ],
            }
        ],
    }
    return s.json, s.blob


def write_gltf_mutants(folder: Path, count: int, seed: int) -> None:
    """``count`` mutants of the scene, and the undamaged scene as 000000.gltf."""
    document, blob = gltf_seed()
    write_gltf(folder / "000000.gltf", document, blob)
    rng = random.Random(seed)
    for number in range(1, count + 1):
        mutant, data = copy.deepcopy(document), bytearray(blob)
        for _ in range(rng.choice((1, 1, 2, 3, 5))):
            kind = rng.random()
            if kind < 0.55:
                _damage_json(mutant, rng)
            elif kind < 0.8 and len(data) >= 4:  # replace a float of the buffer by an edge case
                at = 4 * rng.randrange(len(data) // 4)
                data[at : at + 4] = struct.pack("<f", rng.choice(FLOATS))
            elif kind < 0.95:
                data[rng.randrange(len(data))] = rng.randrange(256)
            else:
                del data[rng.randrange(len(data)) :]
                data = data or bytearray(1)
        write_gltf(folder / f"{number:06d}.{rng.choice(('gltf', 'glb'))}", mutant, bytes(data))


def write_gltf(
    path: Path, document: dict, blob: bytes, buffer: dict | None = None, text_of: Callable[[Any], str] = json.dumps
) -> None:
    """A .gltf or .glb file.  ``buffer``: more keys of the buffer, such as the URI of a file."""
    entry = {"byteLength": len(blob)}
    if path.suffix == ".gltf":
        entry["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
        path.write_text(
            text_of(document | {"buffers": [entry | (buffer or {})]}), encoding="utf-8", errors="surrogatepass"
        )
        return
    text = text_of(document | {"buffers": [entry | (buffer or {})]}).encode("utf-8", "surrogatepass")
    text += b" " * (-len(text) % 4)
    blob += bytes(-len(blob) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body)


def _damage_json(document: dict, rng: random.Random) -> None:
    places: list[tuple] = []

    def walk(value: object, owner: object, key: object) -> None:
        if owner is not None:
            places.append((owner, key))
        items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for name, item in items:
            walk(item, value, name)

    walk(document, None, None)
    owner, key = rng.choice(places)
    kind = rng.random()
    if kind < 0.15:
        del owner[key]
    elif kind < 0.45 and isinstance(owner[key], (int, float)) and not isinstance(owner[key], bool):
        owner[key] = owner[key] + rng.choice((-1, 1, 2, 1000)) if rng.random() < 0.6 else rng.choice(FLOATS[:8])
    else:
        owner[key] = copy.deepcopy(rng.choice(VALUES))


def write_exr_mutants(folder: Path, count: int, seed: int) -> None:
    """Small images with changed header bytes, and truncated files; 000000.exr is undamaged."""
    import OpenEXR

    rng, random_pixels = random.Random(seed), np.random.default_rng(seed)
    seeds = []
    for compression in (OpenEXR.NO_COMPRESSION, OpenEXR.ZIP_COMPRESSION, OpenEXR.PIZ_COMPRESSION):
        pixels = {n: random_pixels.random((9, 13)).astype(np.float32) for n in ("Diffuse Direct.R", "Depth.Z", "A")}
        path = folder / "seed.exr"
        OpenEXR.File({"compression": compression, "type": OpenEXR.scanlineimage}, pixels).write(str(path))
        seeds.append(path.read_bytes())
        path.unlink()
    (folder / "000000.exr").write_bytes(seeds[0])
    for number in range(1, count + 1):
        data = bytearray(rng.choice(seeds))
        header = min(len(data), 420)
        for _ in range(rng.choice((1, 1, 2, 4, 16))):
            data[rng.randrange(4, header)] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        if rng.random() < 0.15:
            del data[rng.randrange(len(data)) :]
        (folder / f"{number:06d}.exr").write_bytes(bytes(data))
