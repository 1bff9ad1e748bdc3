"""Cases: unusual glTF files."""

from __future__ import annotations

import base64
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import Poser, pose_vertices, sample
from taubench_gl.outputs import write_atomically
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, field, worst
from taubench_gl.settings import Settings

Array = np.ndarray
TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float32)


def _read(arrays: dict[str, Array], attributes: tuple[str, ...] = (), **document: Any) -> Scene:
    """The scene of a file with TRIANGLE as its mesh 0, whose accessors are POSITION and ``arrays``, in this order.

    ``attributes``: those of ``arrays`` that belong to vertices; ``document``: more of the file's objects.
    """
    blob, views, accessors, names = b"", [], [], ["POSITION", *arrays]
    for values in (TRIANGLE, *arrays.values()):
        rows = values.reshape(len(values), -1)
        about = {"componentType": {"f": 5126, "H": 5123}[values.dtype.char], "type": TYPES[rows.shape[1]]}
        bounds = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        accessors.append(about | bounds | {"bufferView": len(views), "count": len(rows)})
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": values.nbytes})
        blob += values.tobytes() + bytes(-values.nbytes % 4)
    uri = f"data:application/octet-stream;base64,{base64.b64encode(blob).decode()}"
    mesh = {"primitives": [{"attributes": {name: names.index(name) for name in ("POSITION", *attributes)}}]}
    made = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": len(blob), "uri": uri}], "bufferViews": views,
            "accessors": accessors, "meshes": [mesh], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.gltf"
        write_atomically(path, json.dumps(made | document))
        return load_scene(path)


@case("duplicate-key-times", tolerance=1e-6, source="meters; float64 of float32 keys, sampled 1e-7 s before the key")
def duplicate_key_times(bench: Bench) -> Outcome:
    """Two keys at the same time (a teleport, as many exporters write it): positions before, at and after, and a note.

    (t - t0) / (t1 - t0) is 0/0 at the key, and the object disappears for a frame.
    """
    keys = {"times": np.float32([0, 1, 1, 2]), "places": np.float32([[0] * 3, [0] * 3, [8, 0, 0], [8, 0, 0]])}
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    scene = _read(keys, animations=[{"samplers": [{"input": 1, "output": 2}], "channels": [channel]}])
    places = [sample(scene, t).world[0, 0, 3] for t in (0.5, 1.0 - 1e-3, 1.0, 1.0 + 1e-7, 2.0)]
    off = worst(np.subtract(places, [0.0, 0.0, 8.0, 8.0, 8.0])) if scene.notes else np.inf
    return Outcome("0, 0, 8, 8, 8 and a note", ", ".join(f"{p:g}" for p in places), off)


@case("weights-not-one", tolerance=1e-5, source="meters; float32 weights: 2 ulps of 10 m")
def weights_not_one(bench: Bench) -> Outcome:
    """Skin weights that sum to 1.5, joints 10 m away: positions of the vertices, and a note.

    The blend is scaled by 1.5: the mesh grows and moves by 5 m.
    """
    weights = {"JOINTS_0": np.tile(np.uint16([0, 1, 0, 0]), (3, 1)), "WEIGHTS_0": np.float32([[1, 0.5, 0, 0]] * 3)}
    nodes = [{"mesh": 0, "skin": 0}, {"children": [2], "translation": [10, 0, 0]}, {"translation": [0, 0, 0]}]
    scene = _read(weights, tuple(weights), nodes=nodes, skins=[{"joints": [1, 2]}], scenes=[{"nodes": [0, 1]}])
    posed = pose_vertices(scene, Poser(scene).sample(0.0), 0, scene.meshes[0].primitives[0])
    expected = TRIANGLE + [10.0, 0.0, 0.0]
    off = posed - expected if scene.notes else np.inf
    return field("10 m along x", off)


@case("duration-from-float-keys", source="exact: integers")
def duration_from_float_keys(bench: Bench) -> Outcome:
    """Last keys at float32(n / fps) s, n = 50, 100, 2000 at 24 fps and 7, 23 at 10 fps: number of frames.

    The product float32(50 / 24) * 24 is 49.999998, and float32(0.7) * 10 is 6.9999999: the last frame is lost.
    """
    lasts = [(50, 24.0), (100, 24.0), (2000, 24.0), (7, 10.0), (23, 10.0)]
    durations = [float(np.float32(n / fps)) for n, fps in lasts]
    measured = [Settings(fps=fps).sequence.frame_count(t) for t, (_, fps) in zip(durations, lasts, strict=True)]
    expected = [n + 1 for n, _ in lasts]
    off = worst(np.subtract(measured, expected))
    return Outcome(str(expected), str(measured), off)
