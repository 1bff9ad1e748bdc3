"""Small glTF files and a stand-in for Blender's Python, for the tests of the Blender driver."""

from __future__ import annotations

import base64
import json
import math
import os
import stat
import sys
from pathlib import Path

import numpy as np

DOWN = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
BASE_COLOR = (0.5, 0.25, 0.125)


def encode(data: bytes) -> str:
    return base64.b64encode(data).decode()


def plane(path: Path, lights: list[dict] = (), keys: dict[str, list] | None = None) -> Path:
    """A 2 m square at y = 0 with a rough dielectric, a camera 3 m above looking down, lights as nodes.

    ``keys``: animated path of the plane's node -> one value per half second, LINEAR.
    """
    chunks = [
        np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], "<f4"),
        np.tile(np.array([0, 1, 0], "<f4"), (4, 1)),
        np.array([0, 1, 2, 0, 2, 3], "<u2"),
    ]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, 0, -1], "max": [1, 0, 1]},
        {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
    ]
    nodes = [{"mesh": 0, "name": "plane"}, {"camera": 0, "translation": [0, 3, 0], "rotation": DOWN}]
    animations = []
    for name, values in (keys or {}).items():
        values = np.array(values, "<f4")
        times = (0.5 * np.arange(len(values))).astype("<f4")
        last = float(times[-1])
        accessors.append({"bufferView": len(chunks), "componentType": 5126, "count": len(times), "type": "SCALAR",
                          "min": [0.0], "max": [last]})  # fmt: skip
        accessors.append({"bufferView": len(chunks) + 1, "componentType": 5126, "count": len(values),
                          "type": f"VEC{values.shape[1]}"})  # fmt: skip
        chunks += [times, values]
        sampler = {"input": len(accessors) - 2, "output": len(accessors) - 1}
        # One animation per channel: Blender's importer mutes all but one.
        channel = {"sampler": 0, "target": {"node": 0, "path": name}}
        animations.append({"name": name, "samplers": [sampler], "channels": [channel]})
    for i, light in enumerate(lights):
        nodes.append(light["node"] | {"extensions": {"KHR_lights_punctual": {"light": i}}})
    blob, views = b"", []
    for chunk in chunks:
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": chunk.nbytes})
        blob += chunk.tobytes() + b"\0" * (-chunk.nbytes % 4)
    material = {"baseColorFactor": [*BASE_COLOR, 1], "metallicFactor": 0, "roughnessFactor": 1}
    root = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
        "materials": [{"pbrMetallicRoughness": material}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}]}],
        "buffers": [
            {"byteLength": len(blob), "uri": "data:application/octet-stream;base64," + base64.b64encode(blob).decode()}
        ],
        "bufferViews": views,
        "accessors": accessors,
    }
    if animations:
        root["animations"] = animations
    if lights:
        root["extensionsUsed"] = ["KHR_lights_punctual"]
        root["extensions"] = {"KHR_lights_punctual": {"lights": [light["light"] for light in lights]}}
    path.write_text(json.dumps(root))
    return path


LAMP = {"light": {"type": "point", "intensity": 10.0}, "node": {"translation": [0, 2, 0]}}


def blinking(path: Path, *, ground: bool = True) -> Path:
    """On, off, on, every half second: a light by scale; another one and, if ``ground``, the plane by visibility."""
    gltf = json.loads(plane(path, [LAMP, LAMP], {"translation": [[0, 0, 0]] * 3, "scale": [[1, 1, 1]] * 3}).read_text())
    blob = [np.array([[1, 1, 1], [0, 0, 0], [1, 1, 1]], "<f4").tobytes(), np.array([1, 0, 1], "<u1").tobytes()]
    start = len(gltf["bufferViews"])
    data = b"".join(blob)
    gltf["buffers"].append({"byteLength": len(data), "uri": "data:application/octet-stream;base64," + encode(data)})
    gltf["bufferViews"] += [{"buffer": 1, "byteLength": 36}, {"buffer": 1, "byteOffset": 36, "byteLength": 3}]
    gltf["accessors"] += [
        {"bufferView": start, "componentType": 5126, "count": 3, "type": "VEC3"},
        {"bufferView": start + 1, "componentType": 5121, "count": 3, "type": "SCALAR"},
    ]
    times = gltf["animations"][0]["samplers"][0]["input"]
    count = len(gltf["accessors"])

    def hides(node):
        pointer = f"/nodes/{node}/extensions/KHR_node_visibility/visible"
        return {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}}

    step = {"input": times, "interpolation": "STEP"}
    gltf["animations"].append({
        "samplers": [step | {"output": count - 2}, step | {"output": count - 1}],
        "channels": [{"sampler": 0, "target": {"node": 2, "path": "scale"}},
                     {"sampler": 1, "target": hides(3)}, *[{"sampler": 1, "target": hides(0)}][: int(ground)]],
    })  # fmt: skip
    for node in (0, 3):
        gltf["nodes"][node].setdefault("extensions", {})["KHR_node_visibility"] = {"visible": True}
    gltf["extensionsUsed"] += ["KHR_node_visibility", "KHR_animation_pointer"]
    path.write_text(json.dumps(gltf))
    return path


FAKE = """
import json, os, sys
if sys.argv[1] == "-c":
    print("@tb 4.5.0 stand-in"); sys.exit()
import numpy as np, OpenEXR
job = json.load(open(sys.argv[2]))
assert os.path.isfile(job["scene"])
print("Blender says hello", flush=True)
renders = [(folder, frame) for folder in job["folders"] for frame in job["frames"]]
for n, (folder, frame) in enumerate(renders):
    if n == int(os.environ.get("FAKE_STOPS_AFTER", "999")):
        print("Error: out of pixels"); sys.exit(3)
    w, h = job["size"]
    z = np.full((h, w), 1e10, np.float32)
    path = os.path.join(folder, job["name"] % frame)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"ViewLayer.Depth.Z": z}).write(path)
    print("@tb " + json.dumps({"event": "samples", "done": 1, "total": 2}))
    print("@tb " + json.dumps({"event": "frame", "frame": frame, "seconds": 0.5, "cpu_seconds": 1.0 + n}), flush=True)
"""


def fake_blender(folder: Path) -> str:
    """An executable that runs a job as Blender's Python does, and writes empty frames."""
    return executable(folder, FAKE)


def executable(folder: Path, source: str) -> str:
    """A program that runs ``source`` with this interpreter, instead of one that has bpy."""
    script, program = folder / "fake.py", folder / "fake_python"
    script.write_text(source)
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{script}" "$@"\n')
    os.chmod(program, program.stat().st_mode | stat.S_IXUSR)
    return str(program)
