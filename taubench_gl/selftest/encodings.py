"""Cases: the same values in the many forms that glTF allows, against the formulas of its specification."""

from __future__ import annotations

import base64
import io
import json
import math
import tempfile
from pathlib import Path

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import Poser
from taubench_gl.outputs import write_atomically
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, field, worst
from taubench_gl.selftest.scenes import turn

Array = np.ndarray
COMPONENTS = {"b": 5120, "B": 5121, "h": 5122, "H": 5123, "I": 5125, "f": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class _Gltf:
    """A glTF file in memory; every accessor has a buffer view of its own unless ``interleaved``."""

    def __init__(self, generator: str = "") -> None:
        self._blob = bytearray()
        self.json: dict = {"asset": {"version": "2.0", "generator": generator}, "bufferViews": [], "accessors": []}

    def view(self, data: bytes, **fields: int) -> int:
        self._blob += bytes(-len(self._blob) % 4)
        self.add("bufferViews", {"buffer": 0, "byteOffset": len(self._blob), "byteLength": len(data)} | fields)
        self._blob += data
        return len(self.json["bufferViews"]) - 1

    def add(self, collection: str, value: dict) -> int:
        self.json.setdefault(collection, []).append(value)
        return len(self.json[collection]) - 1

    def accessor(self, values: Array, *, view: int | None = None, offset: int = 0, normalized: bool = False) -> int:
        """An accessor of ``values`` (n, k); ``view``: where they already are."""
        rows = np.ascontiguousarray(values).reshape(len(values), -1)
        view = self.view(rows.tobytes()) if view is None else view
        about = {"bufferView": view, "componentType": COMPONENTS[rows.dtype.char], "count": len(rows),
                 "type": KINDS[rows.shape[1]]}  # fmt: skip
        about |= {"byteOffset": offset} if offset else {}
        about |= {"normalized": True} if normalized else {}
        if rows.dtype.char == "f" or not normalized:
            about |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self.add("accessors", about)

    def interleaved(self, columns: dict[str, tuple[Array, bool]]) -> dict[str, int]:
        """Vertex attributes that alternate in one buffer view.  name -> (values, normalized)."""
        count, parts, offsets = len(next(iter(columns.values()))[0]), [], {}
        for name, (values, _) in columns.items():
            offsets[name] = sum(part.shape[1] for part in parts)
            data = np.ascontiguousarray(values).view(np.uint8).reshape(count, -1)
            parts.append(np.pad(data, ((0, 0), (0, -data.shape[1] % 4)), constant_values=171))
        rows = np.concatenate(parts, axis=1)
        view = self.view(rows.tobytes(), byteStride=rows.shape[1])
        return {
            name: self.accessor(values, view=view, offset=offsets[name], normalized=normalized)
            for name, (values, normalized) in columns.items()
        }

    def load(self) -> Scene:
        uri = f"data:application/octet-stream;base64,{base64.b64encode(self._blob).decode()}"
        self.json["buffers"] = [{"byteLength": len(self._blob), "uri": uri}]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "case.gltf"
            write_atomically(path, json.dumps(self.json))
            return load_scene(path)


def _normalized(values: Array) -> Array:
    """Real numbers of normalized integers: the signed ones have two codes for -1."""
    return np.maximum(values / float(np.iinfo(values.dtype).max), -1.0)


@case(
    "vertices-in-many-forms",
    description="interleaved, normalized, sparse and indexed vertices of strips, fans and lists, in integers of 8, 16 "
    "and 32 bits: largest difference from the numbers that were written",
    elsewhere="a stride, an offset or the range of a type is taken for another one's, strips are wound alternately",
    here="glTF 2.0, sections 3.6 and 3.7; KHR_mesh_quantization",
    tolerance=1e-6,
    source="float32: 8 ulps",
)
def vertices_in_many_forms(bench: Bench) -> Outcome:
    rng, f = np.random.default_rng(7), _Gltf()
    count = 7
    positions = rng.integers(-32768, 32768, (count, 3), dtype=np.int16)
    positions[0, 0], positions[1, 1] = -32768, 32767
    normals = np.rint(127 * math3d.normalize(rng.normal(size=(count, 3)))).astype(np.int8)
    uv = rng.integers(0, 65536, (count, 2), dtype=np.uint16)
    colors = rng.integers(0, 256, (count, 3), dtype=np.uint8)
    joints = np.tile(np.uint8([1, 0, 0, 0]), (count, 1))
    weights = rng.integers(0, 200, (count, 1), dtype=np.uint8)
    weights = np.concatenate([weights, 255 - weights, np.zeros((count, 2), np.uint8)], axis=1)
    attributes = f.interleaved({
        "POSITION": (positions, True), "NORMAL": (normals, True), "TEXCOORD_0": (uv, True), "COLOR_0": (colors, True),
        "JOINTS_0": (joints, False), "WEIGHTS_0": (weights, True),
    })  # fmt: skip
    plain = rng.normal(size=(count, 3)).astype(np.float32)
    sparse_at, sparse_values = np.uint16([2, 5]), rng.normal(size=(2, 3)).astype(np.float32)
    sparse = f.accessor(plain)
    changed = plain.copy()
    changed[sparse_at] = sparse_values
    f.json["accessors"][sparse] |= {
        "min": changed.min(axis=0).tolist(), "max": changed.max(axis=0).tolist(),
        "sparse": {"count": 2, "indices": {"bufferView": f.view(sparse_at.tobytes()), "componentType": 5123},
                   "values": {"bufferView": f.view(sparse_values.tobytes())}},
    }  # fmt: skip
    zeros = f.add("accessors", {
        "componentType": 5126, "count": count, "type": "VEC3", "min": [0.0] * 3, "max": [1.0] * 3,
        "sparse": {"count": 1, "indices": {"bufferView": f.view(np.uint8([3]).tobytes()), "componentType": 5121},
                   "values": {"bufferView": f.view(np.ones(3, np.float32).tobytes())}},
    })  # fmt: skip
    strip, fan = np.uint8([0, 1, 2, 3, 3, 4, 5, 6]), np.uint32([6, 0, 1, 2, 3])
    triangles = np.uint16([0, 1, 2, 2, 1, 3, 4, 5])
    modes = ((strip, 5), (fan, 6), (triangles, 4), (None, 5), (None, 4), (np.uint8([0, 1, 2]), 3))
    primitives = []
    for indices, mode in modes:
        own = {"attributes": {"POSITION": sparse}, "mode": mode}
        own |= {} if indices is None else {"indices": f.accessor(indices)}
        primitives.append(own)
    primitives[0]["attributes"] = attributes
    primitives[1]["targets"] = [{"POSITION": zeros}, {"POSITION": sparse}]
    rgba = rng.integers(0, 65536, (count, 4), dtype=np.uint16)
    primitives[1]["attributes"]["COLOR_0"] = f.accessor(rgba, normalized=True)
    f.json |= {"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]}
    bind = rng.normal(size=(2, 4, 4)).astype(np.float32)
    bind[:, :, 3] = 0, 0, 0, 1  # columns come first in the file
    f.json |= {
        "meshes": [{"primitives": primitives[:1]}, {"primitives": [primitives[1]], "weights": [0.5, 0.25]},
                   {"primitives": primitives[2:]}],
        "nodes": [{"mesh": 0, "skin": 0}, {"mesh": 1}, {"mesh": 2}, {"children": [4]}, {}],
        "skins": [{"joints": [3, 4], "inverseBindMatrices": f.accessor(bind.reshape(2, 16))}],
        "scenes": [{"nodes": [0, 1, 2, 3]}],
    }  # fmt: skip
    scene = f.load()
    (first,), (second,), rest = (mesh.primitives for mesh in scene.meshes)
    unit = math3d.normalize(_normalized(normals))
    shares = weights / 255.0
    errors = [
        worst(first.positions - _normalized(positions)), worst(math3d.normalize(first.normals) - unit),
        worst(first.texcoords[0] - uv / 65535.0), worst(first.colors[:, :3] - colors / 255.0),
        worst(first.colors[:, 3] - 1), worst(second.colors - rgba / 65535.0),
        worst(first.joints - joints), worst(first.weights - shares), worst(second.positions - changed),
        worst(second.targets[0].positions - np.eye(7)[3][:, None]), worst(second.targets[1].positions - changed),
        worst(scene.meshes[1].weights - [0.5, 0.25]),
        worst(scene.skins[0].inverse_bind - bind.reshape(2, 4, 4).swapaxes(1, 2)), len(rest) - 3,
    ]  # fmt: skip
    shown = [first.triangles, second.triangles, *(p.triangles for p in rest)]
    triangles = [
        [[0, 1, 2], [1, 3, 2], [3, 4, 5], [4, 6, 5]], [[0, 1, 6], [1, 2, 6], [2, 3, 6]], [[0, 1, 2], [2, 1, 3]],
        [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4], [4, 5, 6]], [[0, 1, 2], [3, 4, 5]],
    ]  # fmt: skip
    for triangles_read, expected in zip(shown, triangles, strict=True):
        errors.append(float(_cyclic(triangles_read) != _cyclic(np.array(expected))))
    return field("as written", errors)


def _cyclic(triangles: Array) -> list[tuple[int, ...]]:
    """Triangles with the smallest corner first, sorted; the winding is kept."""
    return sorted(tuple(np.roll(t, -int(np.argmin(t))).tolist()) for t in triangles)


@case(
    "nodes-in-many-forms",
    description="matrices, parts, instances in floats and shorts, lenses, lights, rotations of shorts and pointers to "
    "properties: world matrices and values against the formulas",
    elsewhere="rows for columns, quaternions of integers that are not unit, angles of a full cone",
    here="glTF 2.0; EXT_mesh_gpu_instancing, KHR_lights_punctual, KHR_animation_pointer",
    tolerance=2e-5,
    source="float32 in the file, and 16 bits of a rotation: 1 / 65534",
)
def nodes_in_many_forms(bench: Bench) -> Outcome:
    f = _Gltf()
    triangle = {"attributes": {"POSITION": f.accessor(np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]))}}
    places = np.float32([[1, 2, 3], [-4, 5, 0.5]])
    turns = np.array([turn((1.0, 2.0, 0.0), 50.0), turn((0.0, 1.0, 1.0), 130.0)])
    scales = np.float32([[1, 1, 1], [2, 0.5, 3]])
    shorts = np.rint(turns * 32767).astype(np.int16)
    whole = math3d.trs(np.array([3.0, -1.0, 2.0]), turn((1.0, 1.0, 1.0), 40.0), np.array([-1.0, 2.0, 0.5]))
    times = f.accessor(np.float32([0.0, 1.0, 3.0]))
    lit = ["KHR_lights_punctual", "EXT_mesh_gpu_instancing", "KHR_animation_pointer", "KHR_node_visibility"]
    spot = {"innerConeAngle": 0.2, "outerConeAngle": 0.7}
    lights = [{"type": "spot", "spot": spot, "intensity": 5.0, "color": [1.0, 0.5, 0.25], "range": 9.0},
              {"type": "point"}, {"type": "directional", "intensity": 2.5}]  # fmt: skip
    instancing = {"TRANSLATION": f.accessor(places), "ROTATION": f.accessor(shorts, normalized=True),
                  "SCALE": f.accessor(scales)}  # fmt: skip
    f.json |= {
        "extensionsUsed": lit,
        "meshes": [{"primitives": [triangle]}],
        "extensions": {"KHR_lights_punctual": {"lights": lights}},
        "cameras": [
            {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.25, "zfar": 80.0, "aspectRatio": 1.5}},
            {"type": "orthographic", "orthographic": {"xmag": 3.0, "ymag": 2.0, "znear": 0.0, "zfar": 40.0}},
        ],
        "nodes": [
            {"matrix": whole.T.reshape(-1).tolist(), "children": [1, 2]},
            {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": instancing}}},
            {"translation": [0, 1, 0], "rotation": turn((0, 1, 0), 30.0).tolist(), "scale": [1, 2, 3], "camera": 0},
            {"camera": 1, "mesh": 0, "extensions": {
                "KHR_node_visibility": {"visible": False},
                "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": instancing["TRANSLATION"]}}}},
            *({"extensions": {"KHR_lights_punctual": {"light": i}}} for i in range(3)),
        ],
        "scenes": [{"nodes": [6]}, {"nodes": [0, 3, 4, 5], "name": "second"}],
        "scene": 1,
    }  # fmt: skip
    keys = np.array([turn((0, 0, 1), a) for a in (0.0, 80.0, 20.0)])
    moves = np.float32(np.random.default_rng(8).normal(size=(9, 3)))
    strengths = np.float32([[1.0], [4.0], [2.0]])
    angles = np.float32([[0.3], [0.6], [0.5]])

    def pointer(path: str) -> dict:
        return {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": path}}}

    tracks = [
        (
            {"node": 2, "path": "rotation"},
            f.accessor(np.rint(keys * 32767).astype(np.int16), normalized=True),
            "LINEAR",
        ),
        ({"node": 2, "path": "translation"}, f.accessor(moves), "CUBICSPLINE"),
        (pointer("/extensions/KHR_lights_punctual/lights/1/intensity"), f.accessor(strengths), "LINEAR"),
        (pointer("/extensions/KHR_lights_punctual/lights/0/spot/outerConeAngle"), f.accessor(angles), "STEP"),
        (pointer("/cameras/0/perspective/yfov"), f.accessor(angles), "LINEAR"),
    ]
    f.json["animations"] = [{
        "samplers": [{"input": times, "output": output, "interpolation": kind} for _, output, kind in tracks],
        "channels": [{"sampler": i, "target": target} for i, (target, *_) in enumerate(tracks)],
    }]  # fmt: skip
    scene = f.load()
    poser = Poser(scene)
    parts = [math3d.trs(p.astype(float), q, s.astype(float)) for p, q, s in zip(places, turns, scales, strict=True)]
    moved = np.tile(np.eye(4), (2, 1, 1))
    moved[:, :3, 3] = places
    errors = [
        worst(scene.nodes.instances[1] - parts) / 5.0,
        worst(scene.nodes.instances[3] - moved),
        float(scene.nodes.in_scene.tolist() != [True] * 6 + [False]),
    ]
    h = (2 * 0.5**3 - 3 * 0.5**2 + 1, 0.5**3 - 2 * 0.5**2 + 0.5, -2 * 0.5**3 + 3 * 0.5**2, 0.5**3 - 0.5**2)
    m = moves.astype(np.float64).reshape(3, 3, 3)
    for time, angle, place, strength, cone in (
        (0.0, 0.0, m[0, 1], 1.0, 0.3), (3.5, 20.0, m[2, 1], 2.0, 0.5),
        (2.0, 50.0, h[0] * m[1, 1] + h[1] * 2.0 * m[1, 2] + h[2] * m[2, 1] + h[3] * 2.0 * m[2, 0], 3.0, 0.6),
    ):  # fmt: skip
        state = poser.sample(time)
        world = whole @ math3d.trs(place, turn((0, 0, 1), angle), np.array([1.0, 2.0, 3.0]))
        yfov = {0.0: 0.3, 3.5: 0.5, 2.0: 0.55}[time]
        errors += [
            worst(state.world[2] - world) / 10.0, state.lights[1].intensity - strength,
            state.lights[0].outer_cone - cone, state.cameras[0].yfov - yfov,
        ]  # fmt: skip
    (near, flat), (bright, point, sun) = scene.cameras, scene.lights
    errors += [
        near.znear - 0.25, near.zfar - 80.0, near.yfov - 0.8, flat.xmag - 3.0, flat.ymag - 2.0, flat.zfar - 40.0,
        float(flat.kind != "orthographic"), float(scene.nodes.visible.tolist() != [True] * 3 + [False] + [True] * 3),
        bright.inner_cone - 0.2, bright.outer_cone - 0.7, bright.intensity - 5.0,
        worst(np.subtract(bright.color, (1, 0.5, 0.25))), bright.range - 9.0, point.intensity - 1.0,
        float(point.range != math.inf), sun.intensity - 2.5,
        float([light.kind for light in scene.lights] != ["spot", "point", "directional"]),
        float(scene.nodes.light.tolist() != [-1, -1, -1, -1, 0, 1, 2]), scene.duration - 3.0,
    ]  # fmt: skip
    return field("as written", errors)


@case(
    "lights-of-blender",
    description="intensity and cone keys as Blender's exporter 4.5 writes them: in watts or lumens and as blends, at "
    "each key",
    elsewhere="keys 12.6 or 683 times too large beside lights that are right",
    here="keys are converted to the unit of the light: by version, or by the light's own value",
    tolerance=1e-6,
    source="relative; float32 in the file",
)
def lights_of_blender(bench: Bench) -> Outcome:
    rise, errors = np.float32([[1.0], [2.0], [0.5]]), []
    for generator, factors in (
        ("Khronos glTF Blender I/O v4.5.51", (4.0 * math.pi, 4.0 * math.pi, 1.0 / 683.0)), ("another", (1.0, 1.0, 1.0)),
    ):  # fmt: skip
        f = _Gltf(generator)
        times = f.accessor(np.float32([0.0, 1.0, 2.0]))
        own, kinds = (10.0, 20.0, 3.0), ("point", "spot", "directional")
        lights = [{"type": kind, "intensity": value} for kind, value in zip(kinds, own, strict=True)]
        lights[1]["spot"] = {"innerConeAngle": 0.3, "outerConeAngle": 0.6}
        outputs = [f.accessor(np.float32(value * factor * rise)) for value, factor in zip(own, factors, strict=True)]
        paths = [f"{i}/intensity" for i in range(3)]
        blends, outers = np.float32([[0.5], [0.25], [0.0]]), np.float32([[0.6], [0.4], [0.5]])
        if generator != "another":
            outputs += [f.accessor(blends), f.accessor(outers)]
            paths += ["1/spot.innerConeAngle", "1/spot.outerConeAngle"]
        f.json |= {
            "extensionsUsed": ["KHR_lights_punctual", "KHR_animation_pointer"],
            "extensions": {"KHR_lights_punctual": {"lights": lights}},
            "nodes": [{"extensions": {"KHR_lights_punctual": {"light": i}}} for i in range(3)],
            "scenes": [{"nodes": [0, 1, 2]}],
            "animations": [{
                "samplers": [{"input": times, "output": output} for output in outputs],
                "channels": [
                    {"sampler": i, "target": {"path": "pointer", "extensions": {"KHR_animation_pointer": {
                        "pointer": f"/extensions/KHR_lights_punctual/lights/{path}"}}}} for i, path in enumerate(paths)
                ],
            }],
        }  # fmt: skip
        poser = Poser(f.load())
        for k, time in enumerate((0.0, 1.0, 2.0)):
            state = poser.sample(time)
            errors += [
                light.intensity / (value * rise[k, 0]) - 1.0 for light, value in zip(state.lights, own, strict=True)
            ]
            if generator != "another":
                spot = state.lights[1]
                errors += [spot.outer_cone - outers[k, 0], spot.inner_cone - (1.0 - blends[k, 0]) * outers[k, 0]]
    return field("in the unit of the light", errors)


def _png(texels: Array) -> bytes:
    import imageio.v3 as iio

    data = io.BytesIO()
    iio.imwrite(data, texels, extension=".png")
    return data.getvalue()


@case(
    "materials-in-many-forms",
    description="factors, texture transforms, samplers, emissive strength, specular and unlit; specular-glossiness of "
    "metals and dielectrics in factors and texels: differences from the definitions",
    elsewhere="a rotation of coordinates with the other sign, glossiness taken for roughness, sRGB data not decoded",
    here="the definitions of the extensions; specular-glossiness is converted and back again within one code",
    tolerance=0.006,
    source="one of 255 codes, encoded as sRGB and decoded",
)
def materials_in_many_forms(bench: Bench) -> Outcome:
    f = _Gltf()
    metal = np.array([1.0, 0.0, 1.0, 0.0])
    base = np.array([[0.9, 0.6, 0.3], [0.2, 0.5, 0.8], [0.5, 0.5, 0.5], [0.1, 0.7, 0.4]])
    diffuse = base * (1.0 - metal[:, None])  # with the specular color of a dielectric, 0.04
    specular = np.where(metal[:, None] > 0, base, 0.04)

    def encoded(linear: Array) -> Array:
        return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)

    def texels(color: Array, alpha: list[int]) -> Array:
        codes = np.rint(255 * encoded(color)).astype(np.uint8)
        return np.concatenate([codes, np.array(alpha, np.uint8)[:, None]], axis=1).reshape(2, 2, 4)

    images = [_png(texels(diffuse, [255, 128, 64, 0])), _png(texels(specular, [255, 204, 102, 0]))]
    cos, sin = math.cos(0.4), math.sin(0.4)
    move = {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.4, "scale": [2.0, 3.0], "texCoord": 1}}
    glossy = "KHR_materials_pbrSpecularGlossiness"
    f.json |= {
        "extensionsUsed": ["KHR_texture_transform", "KHR_materials_emissive_strength", "KHR_materials_specular",
                           "KHR_materials_unlit", glossy],
        "images": [{"bufferView": f.view(image), "mimeType": "image/png"} for image in images],
        "samplers": [{"magFilter": 9728, "minFilter": 9985, "wrapS": 33071, "wrapT": 33648}],
        "textures": [{"source": 0, "sampler": 0}, {"source": 1}],
        "materials": [
            {"pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.6,
                                      "roughnessFactor": 0.7, "baseColorTexture": {"index": 0, "extensions": move}},
             "normalTexture": {"index": 1, "scale": 0.5, "texCoord": 1},
             "occlusionTexture": {"index": 1, "strength": 0.25}, "alphaMode": "MASK", "alphaCutoff": 0.75,
             "doubleSided": True, "emissiveFactor": [0.5, 0.25, 1.0],
             "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3.0},
                            "KHR_materials_specular": {"specularFactor": 0.35}}},
            {"extensions": {"KHR_materials_unlit": {}}, "emissiveTexture": {"index": 1, "texCoord": 2}},
            {"extensions": {glossy: {"diffuseFactor": [0.1, 0.7, 0.4, 0.5], "specularFactor": [0.04] * 3,
                                     "glossinessFactor": 0.3}}},
            {"extensions": {glossy: {"diffuseFactor": [0, 0, 0, 1], "specularFactor": [0.9, 0.6, 0.3],
                                     "glossinessFactor": 1.0}}},
            {"extensions": {glossy: {"diffuseTexture": {"index": 1}, "specularGlossinessTexture": {"index": 1}}}},
        ],
    }  # fmt: skip
    f.json["textures"].append({"source": 0})
    f.json["materials"][4]["extensions"][glossy]["diffuseTexture"]["index"] = 2
    corners = {"POSITION": f.accessor(np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])),
               **{f"TEXCOORD_{i}": f.accessor(np.float32([[0, 0], [1, 0], [0, 1]])) for i in range(2)}}  # fmt: skip
    f.json |= {"meshes": [{"primitives": [{"attributes": corners, "material": i} for i in range(5)]}],
               "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}  # fmt: skip
    scene = f.load()
    plain, unlit, dielectric, mirror, textured = scene.materials
    turned = [[2.0 * cos, 3.0 * sin, 0.1], [-2.0 * sin, 3.0 * cos, 0.2]]
    sampler = plain.base_color_texture.sampler
    errors = [
        worst(np.subtract(plain.base_color, (0.1, 0.2, 0.3, 0.4))), plain.metallic - 0.6, plain.roughness - 0.7,
        worst(plain.base_color_texture.uv_transform - turned), plain.base_color_texture.texcoord - 1,
        worst(np.subtract((sampler.mag_filter, sampler.min_filter, sampler.wrap_s, sampler.wrap_t),
                          (9728, 9985, 33071, 33648))),
        plain.normal_scale - 0.5, plain.normal_texture.texcoord - 1, plain.occlusion_strength - 0.25,
        float((plain.alpha_mode, plain.double_sided, unlit.unlit, plain.unlit) != ("MASK", True, True, False)),
        float(unlit.emissive_texture is not None),  # third coordinates are noted, not read as others
        plain.alpha_cutoff - 0.75, unlit.alpha_cutoff - 0.5, worst(np.subtract(plain.emissive, (1.5, 0.75, 3.0))),
        plain.specular - 0.35,
        worst(np.subtract(dielectric.base_color, (0.1, 0.7, 0.4, 0.5))), dielectric.metallic,
        dielectric.roughness - 0.7, worst(np.subtract(mirror.base_color, (0.9, 0.6, 0.3, 1.0))),
        mirror.metallic - 1.0, mirror.roughness,
    ]  # fmt: skip
    colors = scene.images[textured.base_color_texture.image].decode() / 255.0
    data = scene.images[textured.metallic_roughness_texture.image].decode() / 255.0
    errors += [
        worst(colors[..., :3].reshape(4, 3) - encoded(base)),
        worst(colors[..., 3].ravel() - np.array([255, 128, 64, 0]) / 255),
        worst(data[..., 2].ravel() - metal), worst(data[..., 1].ravel() - (1 - np.array([255, 204, 102, 0]) / 255)),
        worst(np.subtract(textured.base_color, 1.0)),
    ]  # fmt: skip
    return field("the definitions", errors)
