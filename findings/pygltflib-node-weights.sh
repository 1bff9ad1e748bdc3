#!/usr/bin/env bash
# Morph weights of a node, which override those of its mesh: pygltflib has no field for them.  Three nodes share a mesh
# with one target; read and written again without a change, all three have the weight of the mesh.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install pygltflib==1.16.5 || exit 2
cd "$folder" && "$folder/venv/bin/python" - <<'PYTHON'
import base64
import json
import struct

import pygltflib

triangle, offsets = (0, 0, 0, 1, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 0, 0, 2, 0)
data = struct.pack("<18f", *triangle, *offsets)
accessor = {"componentType": 5126, "type": "VEC3", "count": 3}
given = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0, 1, 2]}],
    "nodes": [{"mesh": 0, "weights": [0.25]}, {"mesh": 0, "weights": [1.0]}, {"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "targets": [{"POSITION": 1}]}], "weights": [0.5]}],
    "accessors": [
        accessor | {"bufferView": 0, "min": [0, 0, 0], "max": [1, 1, 0]},
        accessor | {"bufferView": 1, "min": [0, 0, 0], "max": [0, 2, 0]},
    ],
    "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 36}],
    "buffers": [{"byteLength": 72, "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
}
with open("given.gltf", "w") as file:
    json.dump(given, file)
pygltflib.GLTF2().load("given.gltf").save("saved.gltf")
with open("saved.gltf") as file:
    saved = json.load(file)


def weights(gltf):
    return [node.get("weights", gltf["meshes"][node["mesh"]]["weights"]) for node in gltf["nodes"]]


print(f"pygltflib {pygltflib.__version__}: weights of three nodes {weights(given)}, read and written again {weights(saved)}")
raise SystemExit(weights(saved) != [[0.5]] * 3)
PYTHON
