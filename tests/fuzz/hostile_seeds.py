"""Valid documents of which the hostile cases are made, and changes of a text."""

from __future__ import annotations

import base64
import json
import random
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "scene"))
from gltf_files import Gltf, glb

AFF = """v from 0 1 6 at 0 0 0 up 0 1 0 angle 45 hither 0.1 resolution 24 16
am .2 .2 .2
l 2 4 3 .5 .5 .5
fm 0 0 0 .6 .5 .4 .1 .1 .1 20 .1 1
p 4 -3 -1 3 3 -1 3 3 -1 -3 -3 -1 -3
f 1 .5 .2 .8 .2 30 0 1
xs 1 2 1 0 1 0 30 -1 0 0 { m vertices 3 0 0 0 1 0 0 0 1 0 normals 1 0 0 1 triangles 1 0 1 2 0 0 0 }
x ball { s 0 0 0 .7 c 0 0 0 .3 1.5 0 0 .1 }
pp 3 0 0 0 0 0 1 1 0 0 0 0 1 0 1 0 0 0 1
tt none.ppm 0 0 0 0 0 1 0 0 1 0 0 1 0 0 1
tpa 2 0 1 -1 0 0 0 1 2 -1 0 0 0 1 1 1 0 0 0 1 1 1 -1 0 0 0 1 2 0 0 0 0 1 1 1 0 0 0 1
a 0 2 8
k ball { transl 4 -1 0 0 0 0 0 0 0 0 0 0 .1 .2 .3 1 1 0 0 0 0 0 2 1 1 0 0 0 0
rot 5 -1 0 1 0 0 0 0 0 0 0 1 0 0 0 0 0 1 0 1 0 90 0 0 0 2 0 1 0 400 0 0 0 3 0 1 0 400 0 0 0
visibility 2 0 1 1.6 0 }
la lamp 0 3 0 .4 .4 .4
i 0 part.aff
i 9 other.aff
"""
PART = "s 1 1 1 .3\nxs 1 1 1 0 1 0 0 1 0 0 { p 3 0 0 0 1 0 0 0 1 0 }\n"
OBJ = """mtllib a.mtl
o sheet
v -1 -1 0
v 1 -1 0
v 1 1 .5 1
v -1 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
vn 0 .1 1
usemtl red
f 1/1/1 2/2/1 3/3/2 4/4/2
o other
v 2 0 0
v 3 0 0 .5 .5 .5
v 2 1 0
g part
usemtl blue
f -3 -2 -1
f 5//1 6//2 7//1
l 1 2
s off
"""
MTL = "newmtl red\nKd 1 0 0\nKs .5 .5 .5\nNs 30\nd .9\nmap_Kd -o 0 0 none.png\nnewmtl blue\nKd 0 0 1\nKe 1 1 2\nTr .1\n"
WORDS = ["nan", "inf", "-1", "0", "1e30", "1e39", "-1e308", "1e-45", "99999999999", "2147483648", "{", "}", "#", "x",
         "f", "v", "../..", "%", "1/1", "//", "-0", "\\", "1_0", "0x10", "½", "٣", ""]  # fmt: skip
NUMBERS = ["0", "-0", "1", "-1", "2", "3", "7", "0.5", "-1.5", "1e-45", "1e-20", "1e15", "1e29", "-1e29", "360"]


def gltf_seed() -> tuple[dict, bytes]:
    """A skinned, morphed, lit and animated scene: JSON without its buffer, and a buffer of a few hundred bytes."""
    s = Gltf()
    square = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    attributes = {
        "POSITION": s.accessor(square),
        "NORMAL": s.accessor([[0, 0, 1]] * 4),
        "JOINTS_0": s.accessor([[0, 1, 0, 0]] * 4, "u2"),
        "WEIGHTS_0": s.accessor([[0.5, 0.5, 0, 0]] * 4),
        "TEXCOORD_0": s.accessor([[0, 0], [1, 0], [1, 1], [0, 1]]),
    }
    plain = {name: attributes[name] for name in ("POSITION", "NORMAL", "TEXCOORD_0")}
    indices = s.accessor([0, 1, 2, 0, 2, 3], "u2")
    target = {"POSITION": s.accessor([[0, 0, 1], [0, 0, 0], [0, 1, 0], [0, 0, 0]])}
    times = s.accessor([0.0, 0.25, 0.5])
    move = s.accessor([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    spin = s.accessor([[0, 0, 0, 1], [0, 1, 0, 0], [0, 0, 0, -1]])
    swell = s.accessor([0.0, 1.0, 0.5])
    bind = s.accessor(np.tile(np.eye(4), (2, 1, 1)))
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
    return s.json, bytes(s.blob)


def write_gltf(
    path: Path, document: dict, blob: bytes, buffer: dict | None = None, text_of: Callable[[Any], str] = json.dumps
) -> None:
    """A .gltf or .glb file.  ``buffer``: more keys of the buffer, such as the URI of a file."""
    entry = {"byteLength": len(blob)}
    if path.suffix == ".gltf":
        entry["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    text = text_of(document | {"buffers": [entry | (buffer or {})]}).encode("utf-8", "surrogatepass")
    path.write_bytes(text if path.suffix == ".gltf" else glb(text, blob))


def damaged_text(text: str, rng: random.Random) -> bytes:
    """A few words, numbers, lines and bytes of a text changed."""
    lines = [line.split(" ") for line in text.split("\n")]
    for _ in range(rng.choice((1, 1, 2, 4))):
        line = rng.choice(lines)
        at, action = rng.randrange(len(line)), rng.random()
        numbers = [i for i, word in enumerate(line) if word.lstrip("-").replace(".", "").isdigit()]
        if numbers and rng.random() < 0.6:  # still a number: a file that is rejected at once tests little
            line[rng.choice(numbers)] = rng.choice(NUMBERS)
        elif action < 0.45:
            line[at] = rng.choice(WORDS)
        elif action < 0.6:
            line.insert(at, rng.choice(WORDS))
        elif action < 0.75 and len(line) > 1:
            del line[at]
        elif action < 0.85:
            other = rng.choice(lines)
            line[at] = rng.choice(other)
        elif action < 0.93:
            lines.remove(line)
        else:
            lines.insert(rng.randrange(len(lines)), list(line))
        lines = lines or [[""]]
    data = bytearray("\n".join(" ".join(line) for line in lines).encode())
    if rng.random() < 0.15 and data:
        data[rng.randrange(len(data))] = rng.randrange(256)
    if rng.random() < 0.1:
        del data[rng.randrange(len(data) + 1) :]
    return bytes(data)
