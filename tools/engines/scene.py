"""Writes one small scene for every engine: scene.glb, camera.json, and poses.json with all of it in closed form.

    python tools/engines/scene.py OUT [--morph]

A floor, a box that stands, a box that moves and turns, with --morph a roof that rises too, before a sky; a camera that
moves and turns faster in every frame.  glTF axes (+Y up, the camera looks along -Z), meters, 24 frames a second.  Frame
i of the files, i from 1 to 6, is at (i - 1) / 24 seconds.
"""

import base64
import json
import math
import sys
from pathlib import Path

import numpy as np

FRAMES, SIZE, YFOV, NEAR, FPS = range(1, 7), (96, 54), 0.8, 0.1, 24.0
SIDES = [((0, 1, 3, 2), (-1, 0, 0)), ((4, 6, 7, 5), (1, 0, 0)), ((0, 4, 5, 1), (0, -1, 0)),
         ((2, 3, 7, 6), (0, 1, 0)), ((0, 2, 6, 4), (0, 0, -1)), ((1, 5, 7, 3), (0, 0, 1))]  # fmt: skip


def box(width, height, depth):
    """Positions (24, 3), normals (24, 3) and triangles (12, 3) of a box around the origin."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.5 * (width, height, depth)
    positions = np.concatenate([corners[list(side)] for side, _ in SIDES])
    normals = np.repeat([normal for _, normal in SIDES], 4, axis=0).astype(float)
    triangles = np.concatenate([np.array([(0, 1, 2), (0, 2, 3)]) + 4 * i for i in range(6)])
    return positions, normals, triangles


def turned(axis, degrees):
    """Rotation (3, 3) about axis 0, 1 or 2."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    out = np.eye(3)
    a, b = [i for i in range(3) if i != axis]
    out[[a, b], [a, b]] = c
    out[a, b], out[b, a] = (-s, s) if axis != 1 else (s, -s)
    return out


def pose(rotation, position):
    """Matrix (4, 4) world from local."""
    return np.block([[rotation, np.reshape(position, (3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])


def poses(n):
    """world_from_local of each object, and of the camera, in frame number ``n``; the weight of the morph."""
    t = float(n - 1)
    turn = turned(1, 4 - 0.25 * t**2) @ turned(0, -9 - 0.1 * t**1.5)
    camera = pose(turn, (0.4 + 0.03 * t**1.5, 1.5, 5.0 - 0.04 * t**1.5))
    mover = pose(turned(1, 20 + 5 * t), (-1.2 + 0.11 * t, 0.55 + 0.02 * t, -0.2))
    return {"floor": pose(np.eye(3), (0, -0.05, -1)), "stands": pose(turned(1, 30), (1.1, 0.5, -0.6)), "mover": mover,
            "roof": pose(turned(1, -25), (0.2, 0.35, 1.0)), "camera": camera, "weight": 0.08 * t}  # fmt: skip


def quaternion(m):
    """x, y, z, w of a rotation whose w is not near 0."""
    w = 0.5 * math.sqrt(max(1e-9, 1 + np.trace(m)))
    return [(m[2, 1] - m[1, 2]) / (4 * w), (m[0, 2] - m[2, 0]) / (4 * w), (m[1, 0] - m[0, 1]) / (4 * w), w]


def gltf(meshes, morphs):
    """The scene as glTF with its buffer inside: keys in every frame."""
    data, views, accessors = bytearray(), [], []

    def add(values, kind, dtype="f4"):
        values = np.ascontiguousarray(values, dtype=dtype)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        data.extend(values.tobytes() + b"\0" * (-values.nbytes % 4))
        flat = values.reshape(len(values), -1)
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126 if dtype == "f4" else 5125, "type": kind,
                          "count": len(values), "min": flat.min(0).tolist(), "max": flat.max(0).tolist()})  # fmt: skip
        return len(accessors) - 1

    out = {"asset": {"version": "2.0"}, "scene": 0, "nodes": [], "meshes": [], "materials": [{"doubleSided": True}],
           "animations": [{"samplers": [], "channels": []}], "cameras": []}  # fmt: skip
    out["cameras"].append({"type": "perspective", "perspective": {"yfov": YFOV, "znear": NEAR, "zfar": 100.0}})
    times = add([(n - 1) / FPS for n in FRAMES], "SCALAR")
    for name in (*meshes, "camera"):
        node = len(out["nodes"])
        first = poses(1)[name]
        out["nodes"].append({"name": name, "translation": first[:3, 3].tolist(), "rotation": quaternion(first[:3, :3])})
        tracks = {"translation": ([poses(n)[name][:3, 3] for n in FRAMES], "VEC3"),
                  "rotation": ([quaternion(poses(n)[name][:3, :3]) for n in FRAMES], "VEC4")}  # fmt: skip
        if name == "camera":
            out["nodes"][-1]["camera"] = 0
        else:
            positions, normals, triangles = meshes[name]
            primitive = {"attributes": {"POSITION": add(positions, "VEC3"), "NORMAL": add(normals, "VEC3")},
                         "indices": add(triangles.reshape(-1), "SCALAR", "u4"), "material": 0}  # fmt: skip
            out["nodes"][-1]["mesh"] = len(out["meshes"])
            out["meshes"].append({"primitives": [primitive]})
            if name in morphs:
                primitive["targets"] = [{"POSITION": add(morphs[name], "VEC3")}]
                out["meshes"][-1]["weights"] = [0.0]
                tracks["weights"] = ([poses(n)["weight"] for n in FRAMES], "SCALAR")
        animation = out["animations"][0]
        for path, (values, kind) in tracks.items() if name in ("camera", "mover", *morphs) else ():
            animation["samplers"].append({"input": times, "output": add(values, kind)})
            target = {"node": node, "path": path}
            animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": target})
    out |= {"scenes": [{"nodes": list(range(len(out["nodes"])))}], "bufferViews": views, "accessors": accessors}
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    return out | {"buffers": [{"byteLength": len(data), "uri": uri}]}


def main(out, morph):
    """Write the files of the scene to the folder ``out``."""
    meshes = {"floor": box(9, 0.1, 8), "stands": box(0.8, 1.0, 0.8), "mover": box(0.9, 0.9, 0.9)}
    morphs = {}
    if morph:
        meshes["roof"] = box(0.7, 0.7, 0.7)
        morphs["roof"] = np.where(meshes["roof"][0][:, 1:2] > 0, (0.0, 1.0, 0.0), 0.0)
    out.mkdir(parents=True, exist_ok=True)
    (out / "scene.gltf").write_text(json.dumps(gltf(meshes, morphs)))
    lens = {"kind": "perspective", "yfov": YFOV, "znear": NEAR, "zfar": None}
    entries = {str(n): lens | {"world_from_view": poses(n)["camera"].tolist()} for n in FRAMES}
    head = {"schema": "taubench-gl/camera/1", "fps": FPS, "width": SIZE[0], "height": SIZE[1]}
    (out / "camera.json").write_text(json.dumps(head | {"frames": entries}))
    plain = {name: [part.tolist() for part in mesh] for name, mesh in meshes.items()}
    frames = {n: {k: v.tolist() if k != "weight" else v for k, v in poses(n).items()} for n in FRAMES}
    whole = {"size": SIZE, "yfov": YFOV, "near": NEAR, "meshes": plain, "frames": frames,
             "morphs": {name: values.tolist() for name, values in morphs.items()}}  # fmt: skip
    (out / "poses.json").write_text(json.dumps(whole))


if __name__ == "__main__":
    main(Path(sys.argv[1]), "--morph" in sys.argv)
