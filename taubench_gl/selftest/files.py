"""Cases: invalid or unusual glTF files."""

from __future__ import annotations

import base64
import json
import tempfile
from pathlib import Path

import numpy as np

from taubench_gl.animation import Poser, pose_vertices, sample
from taubench_gl.errors import SceneError
from taubench_gl.outputs import write_atomically
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Naive, Outcome, case, field, worst
from taubench_gl.settings import Settings

Array = np.ndarray
_COMPONENT = {"f": 5126, "H": 5123}
_KIND = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float32)


class _File:
    """A minimal glTF writer: a triangle on node 0, and accessors."""

    def __init__(self, **attributes: Array):
        self._blob = b""
        self.json: dict = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}
        attributes = {"POSITION": TRIANGLE, **attributes}
        names = {name: self.accessor(values) for name, values in attributes.items()}
        self.json |= {
            "meshes": [{"primitives": [{"attributes": names}]}],
            "nodes": [{"mesh": 0}],
            "scenes": [{"nodes": [0]}],
            "scene": 0,
        }

    def accessor(self, values: Array) -> int:
        values = np.ascontiguousarray(values)
        rows = values.reshape(len(values), -1)
        view = {"buffer": 0, "byteOffset": len(self._blob), "byteLength": values.nbytes}
        self.json["bufferViews"].append(view)
        self.json["accessors"].append(
            {
                "bufferView": len(self.json["bufferViews"]) - 1,
                "componentType": _COMPONENT[values.dtype.char],
                "count": len(rows),
                "type": _KIND[rows.shape[1]],
                "min": rows.min(axis=0).tolist(),
                "max": rows.max(axis=0).tolist(),
            }
        )
        self._blob += values.tobytes() + bytes(-values.nbytes % 4)
        return len(self.json["accessors"]) - 1

    def translate(self, times: list[float], values: list[list[float]]) -> None:
        sampler = {
            "input": self.accessor(np.array(times, np.float32)),
            "output": self.accessor(np.array(values, np.float32)),
        }
        channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
        self.json["animations"] = [{"samplers": [sampler], "channels": [channel]}]

    def load(self) -> Scene:
        payload = base64.b64encode(self._blob).decode()
        uri = f"data:application/octet-stream;base64,{payload}"
        self.json["buffers"] = [{"byteLength": len(self._blob), "uri": uri}]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "case.gltf"
            write_atomically(path, json.dumps(self.json))
            return load_scene(path)


@case(
    "duplicate-key-times",
    what="two keys at the same time (a teleport, as many exporters write it): positions at and after it",
    elsewhere="(t - t0) / (t1 - t0) is 0/0 at the key, and the object disappears for a frame",
    here="of keys with equal times the last one holds; a note reports it",
    tolerance=1e-6,
    source="meters; float64 of float32 keys, sampled 1e-7 s before the key",
)
def duplicate_key_times(bench: Bench) -> Outcome:
    file = _File()
    file.translate([0.0, 1.0, 1.0, 2.0], [[0, 0, 0], [0, 0, 0], [8, 0, 0], [8, 0, 0]])
    try:
        scene = file.load()
    except SceneError as refused:
        return Outcome("finite", f"refused: {refused.what}", 0.0)
    places = [sample(scene, t).world[0, 0, 3] for t in (1.0, 1.0 + 1e-7, 2.0)]
    with np.errstate(invalid="ignore"):
        naive = float(np.float64(0.0) / np.float64(0.0))
    noted = bool(scene.notes)
    off = worst(np.subtract(places, 8.0)) if noted else np.inf
    return Outcome("8, 8, 8 and a note", ", ".join(f"{p:g}" for p in places), off, Naive("0 / 0", naive, naive))


@case(
    "decreasing-key-times",
    what="decreasing key times 0, 2, 1: the file is refused",
    elsewhere="binary search in unsorted times returns an arbitrary key",
    here="an error names the file, the JSON pointer and the wrong time",
    source="exact: refused or not",
)
def decreasing_key_times(bench: Bench) -> Outcome:
    file = _File()
    file.translate([0.0, 2.0, 1.0], [[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    try:
        file.load()
    except SceneError as refused:
        pointed = "#/" in str(refused)
        return Outcome("refused", "refused" if pointed else "refused without a JSON pointer", 0.0 if pointed else 1.0)
    return Outcome("refused", "read", 1.0)


def _weighted(weights: list[list[float]]) -> tuple[Scene, Array]:
    file = _File(JOINTS_0=np.tile(np.uint16([0, 1, 0, 0]), (3, 1)), WEIGHTS_0=np.float32(weights))
    file.json["nodes"] = [{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [0, 0, 0]}]
    file.json["nodes"][1]["translation"] = [10, 0, 0]
    file.json["skins"] = [{"joints": [1, 2]}]
    file.json["scenes"] = [{"nodes": [0, 1]}]
    scene = file.load()
    return scene, pose_vertices(scene, Poser(scene).sample(0.0), 0, scene.meshes[0].primitives[0])


@case(
    "weights-not-one",
    what="skin weights that sum to 1.5, joints 10 m away: positions of the vertices",
    elsewhere="the blend is scaled by 1.5: the mesh grows and moves by 5 m",
    here="weights are normalized on load; a note reports it",
    tolerance=1e-5,
    source="meters; float32 weights: 2 ulps of 10 m",
)
def weights_not_one(bench: Bench) -> Outcome:
    scene, posed = _weighted([[1.0, 0.5, 0.0, 0.0]] * 3)
    expected = TRIANGLE + [10.0, 0.0, 0.0]
    naive = worst(1.5 * expected - expected)
    off = posed - expected if scene.notes else np.inf
    return field("10 m along x", off, Naive("as stored", f"off by {naive:.3g} m", naive))


@case(
    "weights-all-zero",
    what="a vertex whose skin weights are all 0: its position",
    elsewhere="the normalization is 0 / 0, or the vertex collapses to the origin",
    here="the vertex follows its first joint; a note reports it",
    tolerance=1e-5,
    source="meters; float32 weights: 2 ulps of 10 m",
)
def weights_all_zero(bench: Bench) -> Outcome:
    scene, posed = _weighted([[0.0] * 4, [1.0, 0.0, 0.0, 0.0], [0.25, 0.75, 0.0, 0.0]])
    expected = TRIANGLE + [10.0, 0.0, 0.0]
    off = posed - expected if scene.notes else np.inf
    return field("10 m along x", off, Naive("as stored", "at the origin", 10.0))


@case(
    "duration-from-float-keys",
    what="last keys at float32(n / fps) s, n = 50, 100, 2000 at 24 fps and 7, 23 at 10 fps: number of frames",
    elsewhere="float32(50 / 24) * 24 is 49.999998, float32(0.7) * 10 is 6.9999999: the last frame is lost",
    here="floor(duration * fps * (1 + 2^-23) + 1e-6)",
    source="exact: integers",
)
def duration_from_float_keys(bench: Bench) -> Outcome:
    lasts = [(50, 24.0), (100, 24.0), (2000, 24.0), (7, 10.0), (23, 10.0)]
    durations = [float(np.float32(n / fps)) for n, fps in lasts]
    measured = [Settings(fps=fps).sequence.frame_count(t) for t, (_, fps) in zip(durations, lasts, strict=True)]
    naive = [int(np.floor(t * fps)) + 1 for t, (_, fps) in zip(durations, lasts, strict=True)]
    expected = [n + 1 for n, _ in lasts]
    off = worst(np.subtract(measured, expected))
    plain = Naive("floor(duration * fps)", str(naive), worst(np.subtract(naive, expected)))
    return Outcome(str(expected), str(measured), off, plain)
