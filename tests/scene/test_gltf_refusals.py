"""What must not get in: each refusal is one SceneError that says what and where."""

from __future__ import annotations

import json
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_builders import compressed, finish, lights, morphing, pointer, refuse, skinned, textured
from gltf_files import TRIANGLE, Gltf, triangle_scene

from taubench_gl.scene import load_scene

# The document


def scene_with(edit: Callable[[dict], Any], base: Callable[[], Gltf] = triangle_scene) -> Callable[[], Gltf]:
    def build() -> Gltf:
        gltf = base()
        edit(gltf.json)
        return gltf

    return build


def animated(path: str = "translation", times: Any = (0, 1), values: Any = ((0, 0, 0), (1, 1, 1)), **kw: Any) -> Gltf:
    gltf = triangle_scene()
    gltf.animation({"node": 0, "path": path}, list(times), values, **kw)
    return gltf


def with_attribute(name: str, *args: Any, **kw: Any) -> Callable[[], Gltf]:
    def build() -> Gltf:
        gltf = Gltf()
        gltf.node(mesh=gltf.mesh(**{name: gltf.accessor(*args, **kw)}))
        return gltf

    return build


def with_nan(where: str) -> Callable[[], Gltf]:
    def build() -> Gltf:
        points = TRIANGLE.copy()
        points[1, 1] = np.nan if where == "nan" else np.inf
        gltf = Gltf()
        position = gltf.accessor(points, min=[0, 0, 0], max=[1, 1, 0])
        gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": position}}]})
        return gltf

    return build


def camera(**perspective: float) -> Callable[[], Gltf]:
    values = {"yfov": 1.0, "znear": 0.1, **perspective}
    return scene_with(lambda j: j.update(cameras=[{"type": "perspective", "perspective": values}]))


def light(**changes: Any) -> Callable[[], Gltf]:
    return scene_with(lambda j: j["extensions"]["KHR_lights_punctual"]["lights"][1].update(changes), lights)


def primitive(**changes: Any) -> Callable[[], Gltf]:
    return scene_with(lambda j: j["meshes"][0]["primitives"][0].update(changes))


def sparse_indices(indices: list[int]) -> Callable[[], Gltf]:
    def build() -> Gltf:
        gltf = triangle_scene()
        gltf.json["accessors"][0]["sparse"] = {
            "count": len(indices),
            "indices": {"bufferView": gltf.view(np.array(indices, "<u2").tobytes()), "componentType": 5123},
            "values": {"bufferView": gltf.view(np.zeros((len(indices), 3), "<f4").tobytes())},
        }
        return gltf

    return build


UNIT3 = [[0, 0, 1]] * 3


AT = "/meshes/0/primitives/0/attributes"


CASES: dict[str, tuple[Callable[[], Gltf], str, str]] = {
    # name: (file, JSON pointer, part of the message)
    "no-version": (scene_with(lambda j: j.update(asset={})), "/asset", "version"),
    "version-1": (scene_with(lambda j: j["asset"].update(version="1.0")), "/asset/version", "1.0"),
    "min-version": (scene_with(lambda j: j["asset"].update(minVersion="2.1")), "/asset/minVersion", "2.1"),
    "required": (scene_with(lambda j: j.update(extensionsRequired=["ACME_x"])), "/extensionsRequired/0", "ACME_x"),
    "basisu": (scene_with(lambda j: j.update(extensionsRequired=["KHR_texture_basisu"])), "/extensionsRequired/0",
               "KHR_texture_basisu"),
    "misplaced": (scene_with(lambda j: j["meshes"][0].update(extensions={"KHR_lights_punctual": {"light": 0}})),
                  "/meshes/0/extensions/KHR_lights_punctual", "does not belong"),
    "nan": (with_nan("nan"), "/accessors/0", "element 1 is NaN"),
    "infinite": (with_nan("inf"), "/accessors/0", "element 1 is NaN or infinite"),
    "bounds": (scene_with(lambda j: j["accessors"][0].update(max=[1, 1, 5])), "/accessors/0/max/2", "declared max 5"),
    "bounds-size": (scene_with(lambda j: j["accessors"][0].update(max=[1])), "/accessors/0/max", "expected 3"),
    "view-range": (scene_with(lambda j: j["bufferViews"][0].update(byteOffset=1000)), "/bufferViews/0", "do not fit"),
    "count": (scene_with(lambda j: j["accessors"][0].update(count=4)), "/accessors/0", "do not fit"),
    "unaligned": (scene_with(lambda j: j["accessors"][0].update(byteOffset=2, count=2)), "/accessors/0", "multiple"),
    "normalized-float": (scene_with(lambda j: j["accessors"][0].update(normalized=True)), "/accessors/0/normalized",
                         "integers"),
    "sparse-order": (sparse_indices([1, 0]), "/accessors/0/sparse/indices", "increase"),
    "sparse-twice": (sparse_indices([1, 1]), "/accessors/0/sparse/indices", "increase"),
    "sparse-range": (sparse_indices([1, 3]), "/accessors/0/sparse/indices", "sparse index 3"),
    "sparse-many": (sparse_indices([0, 1, 2, 3]), "/accessors/0/sparse/count", "4 of 3"),
    "bad-buffer": (scene_with(lambda j: j["bufferViews"][0].update(buffer=7)), "/bufferViews/0/buffer", "buffers[7]"),
    "bad-accessor": (primitive(attributes={"POSITION": 9}), f"{AT}/POSITION", "accessors[9]"),
    "bad-material": (primitive(material=0), "/meshes/0/primitives/0/material", "materials[0]"),
    "bad-attribute": (primitive(attributes={"POSITION": 0, "COLOUR": 0}), f"{AT}/COLOUR",
                      "no attribute"),
    "gap": (primitive(attributes={"POSITION": 0, "TEXCOORD_1": 0}), AT, "without a gap"),
    "joints-alone": (with_attribute("JOINTS_0", [[0, 0, 0, 0]] * 3, "u1"), AT, "pairs"),
    "uint32-attribute": (with_attribute("_ID", [1, 2, 3], "u4"), f"{AT}/_ID", "UNSIGNED_INT"),
    "counts": (with_attribute("NORMAL", UNIT3[:2]), f"{AT}/NORMAL", "POSITION has 3"),
    "quantized": (with_attribute("TEXCOORD_0", [[0, 0]] * 3, "u2"), f"{AT}/TEXCOORD_0",
                  "KHR_mesh_quantization"),
    "normal-length": (with_attribute("NORMAL", [*UNIT3[:2], [0, 0, 1.1]]), f"{AT}/NORMAL",
                      "element 2 has length 1.1"),
    "color-range": (with_attribute("COLOR_0", [[0, 0, 1.5]] * 3), f"{AT}/COLOR_0", "0..1"),
    "same-view": (primitive(indices=0), "/meshes/0/primitives/0/indices", "SCALAR of unsigned"),
    "mode": (primitive(mode=7), "/meshes/0/primitives/0/mode", "7"),
    "target-base": (primitive(targets=[{"NORMAL": 0}]), "/meshes/0/primitives/0/targets/0/NORMAL", "no such attribute"),
    "mesh-weights": (scene_with(lambda j: j["meshes"][0].update(weights=[1]), morphing), "/meshes/0/weights",
                     "1 weights"),
    "node-weights": (scene_with(lambda j: j["nodes"][0].update(weights=[1]), morphing), "/nodes/0/weights",
                     "1 weights"),
    "cycle": (scene_with(lambda j: j.update(nodes=[{}, {"children": [2]}, {"children": [1]}])), "/nodes/1", "ancestor"),
    "self": (scene_with(lambda j: j.update(nodes=[{"children": [0]}])), "/nodes/0", "ancestor"),
    "two-parents": (scene_with(lambda j: j.update(nodes=[{}, {"children": [0]}, {"children": [0]}])),
                    "/nodes/2/children/0", "already is a child"),
    "not-a-root": (scene_with(lambda j: j.update(nodes=[{}, {"children": [0]}], scenes=[{"nodes": [0]}])),
                   "/scenes/0/nodes/0", "not a root"),
    "root-twice": (scene_with(lambda j: j.update(scenes=[{"nodes": [0, 0]}])), "/scenes/0/nodes/1", "twice"),
    "default-scene": (scene_with(lambda j: j.update(scene=3)), "/scene", "scenes[3]"),
    "matrix-and-trs": (scene_with(lambda j: j["nodes"][0].update(matrix=np.eye(4).ravel().tolist(), scale=[1, 1, 1])),
                       "/nodes/0", "both a matrix"),
    "shear": (scene_with(lambda j: j["nodes"][0].update(matrix=[1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])),
              "/nodes/0/matrix", "shears"),
    "quaternion": (scene_with(lambda j: j["nodes"][0].update(rotation=[0, 0, 0, 1.01])), "/nodes/0/rotation", "1.01"),
    "overflow": (scene_with(lambda j: j["nodes"][0].update(scale=[1, 1, 10**400])), "/nodes/0/scale/2", ""),
    "skin-plain-mesh": (scene_with(lambda j: (j["nodes"][0].update(skin=0), j.update(skins=[{"joints": [0]}]))),
                        "/nodes/0", "no joints"),
    "skin-alone": (scene_with(lambda j: j["nodes"][0].pop("mesh"), lambda: skinned([[1, 0, 0, 0]] * 3)), "/nodes/0",
                   "no mesh"),
    "joint-range": (lambda: skinned([[1, 0, 0, 0]] * 3, [[2, 0, 0, 0]] * 3), "/nodes/0", "joint 2"),
    "negative-weight": (lambda: skinned([[1.5, -0.5, 0, 0]] * 3), f"{AT}/WEIGHTS_0",
                        "negative"),
    "no-common-root": (scene_with(lambda j: j["nodes"][1].pop("children"), lambda: skinned([[1, 0, 0, 0]] * 3)),
                       "/skins/0/joints", "common root"),
    "skeleton": (lambda: skinned([[1, 0, 0, 0]] * 3, skeleton=2), "/skins/0/skeleton", "common root"),
    "joint-twice": (scene_with(lambda j: j["skins"][0].update(joints=[1, 1]), lambda: skinned([[1, 0, 0, 0]] * 3)),
                    "/skins/0/joints", "twice"),
    "yfov": (camera(yfov=0), "/cameras/0/perspective/yfov", ""),
    "yfov-pi": (camera(yfov=3.2), "/cameras/0/perspective/yfov", "pi"),
    "zfar": (camera(znear=2, zfar=1), "/cameras/0/perspective/zfar", "beyond"),
    "znear": (camera(znear=0), "/cameras/0/perspective/znear", ""),
    "light-type": (light(type="area"), "/extensions/KHR_lights_punctual/lights/1/type", "area"),
    "light-intensity": (light(intensity=-1), "/extensions/KHR_lights_punctual/lights/1/intensity", ""),
    "cones": (light(spot={"innerConeAngle": 1, "outerConeAngle": 0.5}), "/extensions/KHR_lights_punctual/lights/1/spot",
              "innerConeAngle 1"),
    "light-index": (scene_with(lambda j: j["nodes"][0]["extensions"]["KHR_lights_punctual"].update(light=9), lights),
                    "/nodes/0/extensions/KHR_lights_punctual/light", "lights[9]"),
    "times-back": (lambda: animated(times=(0, 2, 1), values=[[0, 0, 0]] * 3), "/animations/0/samplers/0/input",
                   "key time 2 is 1"),
    "times-negative": (lambda: animated(times=(-1, 1)), "/animations/0/samplers/0/input", "key time 0 is -1"),
    "output-count": (lambda: animated(values=[[0, 0, 0]] * 3), "/animations/0/samplers/0/output", "2 keys need 2"),
    "output-cubic": (lambda: animated(interpolation="CUBICSPLINE"), "/animations/0/samplers/0/output", "need 6"),
    "output-type": (lambda: animated("rotation"), "/animations/0/samplers/0/output", "expected VEC4"),
    "output-integers": (lambda: animated(values=[[0, 0, 0, 0]] * 2, path="rotation", dtype="u1"),
                        "/animations/0/samplers/0/output", "UNSIGNED_BYTE"),
    "output-quaternion": (lambda: animated("rotation", values=[[0, 0, 0, 1], [0, 0, 0, 0.9]]),
                          "/animations/0/samplers/0/output", "quaternion 1 has length 0.9"),
    "interpolation": (lambda: animated(interpolation="SLERP"), "/animations/0/samplers/0/interpolation", "SLERP"),
    "animated-matrix": (scene_with(lambda j: j["nodes"][0].update(matrix=np.eye(4).ravel().tolist()), animated),
                        "/animations/0/channels/0/target/node", "matrix"),
    "no-morphs": (lambda: animated("weights", values=[0, 1]), "/animations/0/channels/0/target", "morph targets"),
    "same-target": (scene_with(lambda j: j["animations"][0]["channels"].append(j["animations"][0]["channels"][0]),
                               animated), "/animations/0/channels/1/target", "same target"),
    "pointer-light": (scene_with(lambda j: j["animations"][0]["channels"][0].update(
        target=pointer("/extensions/KHR_lights_punctual/lights/0/intensity")), animated),
        "/animations/0/channels/0/target/extensions/KHR_animation_pointer/pointer", "not there"),
    "pointer-node": (scene_with(lambda j: j["animations"][0]["channels"][0].update(target=pointer("/nodes/9/scale")),
                                animated), "/animations/0/channels/0/target/extensions/KHR_animation_pointer/pointer",
                     "nodes[9]"),
    "image-source": (scene_with(lambda j: j.pop("images"), lambda: textured({})), "/textures/0/source", "images[0]"),
    "image-type": (scene_with(lambda j: j["images"][0].update(mimeType="image/ktx2"), lambda: textured({})),
                   "/images/0", "ktx2"),
    "roughness": (scene_with(lambda j: j.update(materials=[{"pbrMetallicRoughness": {"roughnessFactor": 2}}])),
                  "/materials/0/pbrMetallicRoughness/roughnessFactor", ""),
    "instancing": (scene_with(lambda j: j["nodes"][0].update(extensions={"EXT_mesh_gpu_instancing": {"attributes": {
        "TRANSLATION": 0, "ROTATION": 0}}})),
        "/nodes/0/extensions/EXT_mesh_gpu_instancing/attributes/ROTATION", "VEC3 of FLOAT"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_refusal(tmp_path: Path, name: str) -> None:
    build, where, part = CASES[name]
    refuse(build().save(tmp_path), f"scene.gltf#{where}: ", part)


def test_the_cases_differ_from_good_files_in_one_thing(tmp_path: Path) -> None:
    """Without this, a case might be refused for a fault of its base."""
    bases = (triangle_scene, animated, lights, morphing, camera(), light(), lambda: skinned([[1, 0, 0, 0]] * 3),
             lambda: textured({}), with_attribute("NORMAL", UNIT3))  # fmt: skip
    for build in bases:
        load_scene(build().save(tmp_path))
    gltf = sparse_indices([2])()
    gltf.json["accessors"][0].update(min=[0, 0, 0], max=[1, 0, 0])
    load_scene(gltf.save(tmp_path))


def test_indices_out_of_range(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.mesh(TRIANGLE, [0, 1, 3])
    refuse(gltf.save(tmp_path), "/meshes/0/primitives/0/indices", "index 3 at position 2")


def test_accessor_one_component_too_long(tmp_path: Path) -> None:
    gltf = triangle_scene()
    view = gltf.view(bytes(8))
    gltf.add("accessors", {"bufferView": view, "componentType": 5126, "count": 3, "type": "SCALAR"})
    refuse(gltf.save(tmp_path), "/accessors/1", "do not fit 8 bytes")


@pytest.mark.parametrize("where", ["indices", "input", "output", "inverseBindMatrices"])
def test_stride_is_for_vertex_attributes_only(tmp_path: Path, where: str) -> None:
    if where == "indices":
        gltf = triangle_scene()
        index, stride = gltf.accessor([0, 1, 2], "u4"), 4
        gltf.json["meshes"][0]["primitives"][0]["indices"] = index
    elif where == "inverseBindMatrices":
        gltf = skinned([[1, 0, 0, 0]] * 3)
        index, stride = gltf.accessor(np.tile(np.eye(4).ravel(), (2, 1))), 64
        gltf.json["skins"][0]["inverseBindMatrices"] = index
    else:
        gltf = animated()
        index, stride = gltf.json["animations"][0]["samplers"][0][where], 4 if where == "input" else 12
    view = gltf.json["bufferViews"][gltf.json["accessors"][index]["bufferView"]]
    load_scene(gltf.save(tmp_path))
    view["byteStride"] = stride
    refuse(gltf.save(tmp_path), f"/{where}: ", "byteStride")


def test_indices_among_attributes(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.mesh(TRIANGLE, [0, 1, 2])
    gltf.json["bufferViews"][1]["target"] = 34962
    refuse(gltf.save(tmp_path), "/meshes/0/primitives/0/indices", "holds vertex attributes and indices")


def test_scene_selection_errors(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.json["scenes"] = [{"name": "a"}, {"name": "a"}, {"name": "b"}]
    path = gltf.save(tmp_path)
    refuse(path, "no scene 'c'", "0: 'a'", scene="c")
    refuse(path, "no scene 7", scene=7)
    refuse(path, "no scene -1", scene=-1)
    refuse(path, "2 scenes are called 'a'", scene="a")
    assert load_scene(path, scene="b").scene_names == ("a", "a", "b")


def test_control_characters_in_names(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.json["scenes"] = [{"name": "a\n\x1b[31mb"}]
    refuse(gltf.save(tmp_path), "no scene 'c'", scene="c")
    gltf.json["extensionsRequired"] = ["EVIL\n\x1b[2J"]
    refuse(gltf.save(tmp_path), "EVIL")


# Compression


@pytest.mark.parametrize("extra, module, folder", [("draco", "DracoPy", "BoxDraco.gltf"),
                                                   ("meshopt", "meshoptimizer", "BoxMeshopt.glb")])  # fmt: skip
def test_missing_library_names_the_extra(
    data: Path, monkeypatch: pytest.MonkeyPatch, extra: str, module: str, folder: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    refuse(data / "gltf_transform" / folder, f"pip install 'taubench-gl[{extra}]'")


def test_draco_library_failures_are_scene_errors(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def decode(_: bytes) -> None:
        raise Exception("not a draco\nfile")

    monkeypatch.setitem(sys.modules, "DracoPy", types.SimpleNamespace(decode=decode))
    refuse(data / "gltf_transform" / "BoxDraco.gltf", "KHR_draco_mesh_compression", "not a draco file")


@pytest.mark.parametrize(
    "changes, part",
    [({"filter": "COLOR"}, "filter COLOR"), ({"filter": "OCTAHEDRAL"}, "byteStride 12"),
     ({"count": 99}, "byteLength 1200"), ({"byteOffset": 10**9}, "do not fit"),
     ({"byteLength": 10}, "cannot be decoded"),
     ({"mode": "INDICES", "filter": "EXPONENTIAL"}, "filter"), ({"mode": "TRIANGLES"}, "cannot be decoded"),
     ({"buffer": 1}, "do not fit"), ({"buffer": 9}, "buffers[9]"), ({"byteStride": 0}, "byteStride")],
    ids=lambda v: ",".join(v) if isinstance(v, dict) else None,
)  # fmt: skip
def test_bad_meshopt(tmp_path: Path, changes: dict, part: str) -> None:
    meshopt = pytest.importorskip("meshoptimizer")
    gltf = Gltf()
    points = np.zeros((100, 3), np.float32)
    view = compressed(gltf, meshopt.encode_vertex_buffer(points), 12, 100, "ATTRIBUTES", byteStride=12)
    gltf.add("accessors", {"bufferView": view, "componentType": 5126, "count": 100, "type": "VEC3"})
    load_scene(finish(gltf).save(tmp_path))
    gltf.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"].update(changes)
    refuse(gltf.save(tmp_path), "/bufferViews/0", part)


def test_meshopt_bomb(tmp_path: Path) -> None:
    pytest.importorskip("meshoptimizer")
    gltf = Gltf()
    gltf.blob += bytes(64)
    for _ in range(6):
        view = compressed(gltf, bytes(64), 256, 2**20, "ATTRIBUTES")
        gltf.add("accessors", {"bufferView": view, "componentType": 5126, "count": 1, "type": "SCALAR"})
    document = finish(gltf).document()
    document["buffers"][1]["byteLength"] = 2**40
    path = tmp_path / "bomb.gltf"
    path.write_text(json.dumps(document))
    refuse(path, "/bufferViews/0")
