"""Cases: invalid or unusual glTF files."""

from __future__ import annotations

import base64
import dataclasses
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import Poser, pose_vertices, sample
from taubench_gl.errors import SceneError
from taubench_gl.outputs import write_atomically
from taubench_gl.scene import load_scene
from taubench_gl.scene.gltf.container import container_bytes, read_container
from taubench_gl.scene.model import Image, Sampler, Scene, Texture
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Naive, Outcome, case, count, field, worst
from taubench_gl.selftest.scenes import SceneBuilder, box, quad, turn, turn_y
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
    description="two keys at the same time (a teleport, as many exporters write it): positions before, at and after it",
    elsewhere="(t - t0) / (t1 - t0) is 0/0 at the key, and the object disappears for a frame",
    here="the earlier key ends what is before, the later one begins what follows; a note reports it",
    source="exact: the values of the keys, in meters",
)
def duplicate_key_times(bench: Bench) -> Outcome:
    file = _File()
    file.translate([0.0, 1.0, 1.0, 2.0], [[0, 0, 0], [0, 0, 0], [8, 0, 0], [8, 0, 0]])
    try:
        scene = file.load()
    except SceneError as refused:
        return Outcome("finite", f"refused: {refused.what}", 0.0)
    places = [sample(scene, t).world[0, 0, 3] for t in (0.5, 1.0 - 1e-3, 1.0, 1.0 + 1e-7, 2.0)]
    with np.errstate(invalid="ignore"):
        naive = float(np.float64(0.0) / np.float64(0.0))
    noted = bool(scene.notes)
    off = worst(np.subtract(places, [0.0, 0.0, 8.0, 8.0, 8.0])) if noted else np.inf
    return Outcome("0, 0, 8, 8, 8 and a note", ", ".join(f"{p:g}" for p in places), off, Naive("0 / 0", naive, naive))


@case(
    "decreasing-key-times",
    description="decreasing key times 0, 2, 1: the file is refused",
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


@case(
    "numbers-out-of-range",
    description="an index, an accessor, a buffer view and a child outside of what the file has: files that are read, "
    "and files without such a number that are refused",
    elsewhere="bytes beside the buffer are drawn, or the program ends",
    here="each is refused with the JSON pointer of the number",
    source="exact: refused or not",
)
def numbers_out_of_range(bench: Bench) -> Outcome:
    def indices(file: _File, last: int) -> None:
        file.json["meshes"][0]["primitives"][0]["indices"] = file.accessor(np.uint16([0, 1, last]))

    def change(collection: str, key: str) -> Callable[[_File, Any], None]:
        return lambda file, value: file.json[collection][0].update({key: value})

    wrong = 0
    for set_number, right, beyond in (
        (indices, 2, 3), (change("accessors", "count"), 3, 4), (change("bufferViews", "byteLength"), 36, 37),
        (change("nodes", "children"), [], [0]),
    ):  # fmt: skip
        for number in (right, beyond):
            file = _File()
            set_number(file, number)
            try:
                file.load()
                wrong += number is beyond
            except SceneError as refused:
                wrong += number is right or "#/" not in str(refused)
    return count(0, wrong)


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
    description="skin weights that sum to 1.5, joints 10 m away: positions of the vertices",
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
    description="a vertex whose skin weights are all 0: its position",
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
    description="last keys at float32(n / fps) s, n = 50, 100, 2000 at 24 fps and 7, 23 at 10 fps: number of frames",
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


def _furnished(texels: Array) -> Scene:
    """A scene with every kind of light, a textured and a glowing material, and moving nodes."""
    b = SceneBuilder()
    sampler = Sampler(mag_filter=9728, min_filter=9984, wrap_s=33071, wrap_t=33648)
    textured = b.material(
        name="textured", base_color=(0.25, 0.5, 0.75, 0.5), base_color_texture=Texture(0, sampler), metallic=0.25,
        roughness=0.75, normal_texture=Texture(0), normal_scale=0.5, alpha_mode="MASK", alpha_cutoff=0.25,
        double_sided=True, specular=0.5,
    )  # fmt: skip
    glowing = b.material(name="glowing", emissive=(4.0, 2.0, 0.5), emissive_strength=4.0, alpha_mode="BLEND")
    plate = quad(2.0, 1.0, cells=(3, 2), material=textured)
    corner = 0.5 + 0.5 * plate.positions[:, :2]
    plate = dataclasses.replace(plate, texcoords=(corner.astype(np.float32), None))
    root = b.node(name="root", translation=(1.0, 2.0, 3.0), rotation=turn((1.0, 2.0, 3.0), 40.0), scale=(2.0, 1.0, 0.5))
    arm = b.node(root, name="arm", mesh=b.mesh(plate, box(material=glowing)))
    b.animate(root, "rotation", [0.0, 0.5, 1.0], [turn_y(0.0), turn_y(170.0), turn((1.0, 0.0, 1.0), 90.0)])
    b.animate(arm, "translation", [0.0, 0.25, 1.0], [(0.0, 0.0, 0.0), (1.0, -2.0, 0.5), (3.0, 0.0, 1.0)], "STEP")
    b.animate(arm, "scale", [0.25, 0.75], [[(0, 0, 0), (1, 1, 1), (2, 0, 1)], [(0, 1, 0), (2, 3, 1), (0, 0, 0)]],
              "CUBICSPLINE")  # fmt: skip
    b.light(arm, kind="point", intensity=7.0, color=(1.0, 0.5, 0.25), range=9.0)
    b.light(root, kind="spot", intensity=5.0, inner_cone=0.25, outer_cone=0.5, translation=(0.0, 1.0, 0.0))
    b.light(kind="directional", intensity=3.0, rotation=turn((1.0, 0.0, 0.0), -50.0))
    b.camera(root, yfov=0.75, znear=0.125, zfar=64.0)
    image = Image("texels", (texels.shape[1], texels.shape[0]), lambda: texels)
    return dataclasses.replace(b.build(), images=(image,))


@case(
    "round-trip",
    description="a scene written as .glb and read again: matrices at nine times, vertices, triangles, texels, "
    "materials, lights and lens, largest difference",
    elsewhere="strides, component types, samplers, key layouts of splines or unit conversions differ",
    here="every value is read as it was written",
    tolerance=2e-7,
    source="relative to the largest value; keys, rotations and vertices are float32 in the file",
)
def round_trip(bench: Bench) -> Outcome:
    from taubench_gl.datasets.gltf_from_scene import write_scene  # imported late: pygltflib

    texels = np.arange(6 * 5 * 4, dtype=np.uint8).reshape(6, 5, 4) + np.uint8(100)
    made = _furnished(texels)
    with tempfile.TemporaryDirectory() as folder:
        write_scene(made, Path(folder) / "scene.glb")
        read = load_scene(Path(folder) / "scene.glb")
        errors = [float(not np.array_equal(read.images[0].decode(), texels))]
    for text, binary in ((b"{}", None), (b'{"asset": 1}', bytes(range(5)))):
        chunk, rest, after = read_container(container_bytes(text, binary), "case.glb")
        errors.append(float((bytes(chunk).rstrip(), rest and bytes(rest[:5]), after) != (text, binary, 0)))
    poses, order = [Poser(made), Poser(read)], [list(read.nodes.names).index(name) for name in made.nodes.names]
    for time in np.linspace(0.0, 1.0, 9):
        a, b = (poser.sample(float(time)).world for poser in poses)
        errors.append(worst(a - b[order]) / worst(a))
    for a, b in zip(made.meshes[0].primitives, read.meshes[0].primitives, strict=True):
        errors += [worst(getattr(a, name) - getattr(b, name)) for name in ("positions", "normals")]
        errors.append(float(not np.array_equal(a.triangles, b.triangles)))
    uv = [scene.meshes[0].primitives[0].texcoords[0] for scene in (made, read)]
    errors += [worst(uv[0] - uv[1]), read.duration - 1.0, len(read.meshes) - 1, len(read.notes)]
    pairs = [*zip(made.materials, read.materials, strict=True), *zip(made.cameras, read.cameras, strict=True),
             *zip(made.lights, read.lights, strict=True)]  # fmt: skip
    return field("no difference", errors + [_unlike(a, b) for a, b in pairs])


def _unlike(a: object, b: object) -> float:
    """Largest difference of the fields of two records, names aside; 1 for other than numbers."""
    largest = 0.0
    for part in dataclasses.fields(a):
        x, y = getattr(a, part.name), getattr(b, part.name)
        if isinstance(x, Texture) and isinstance(y, Texture):
            largest = max(largest, float((x.image, x.sampler, x.texcoord) != (y.image, y.sampler, y.texcoord)))
        elif part.name != "name" and x != y:
            numbers = isinstance(x, int | float | tuple) and isinstance(y, int | float | tuple)
            largest = max(largest, worst(np.subtract(x, y)) if numbers else 1.0)
    return largest
