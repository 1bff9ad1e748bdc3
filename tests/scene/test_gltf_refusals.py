"""Invalid files: each is refused with one SceneError that carries the JSON pointer of the fault."""

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


CASES: dict[str, tuple[Callable[[], Gltf], str, object]] = {
    # name: (file, JSON pointer, a number or name the message contains)
    "no-version": (scene_with(lambda j: j.update(asset={})), "/asset", "version"),
    "version-1": (scene_with(lambda j: j["asset"].update(version="1.0")), "/asset/version", "1.0"),
    "min-version": (scene_with(lambda j: j["asset"].update(minVersion="2.1")), "/asset/minVersion", "2.1"),
    "required": (scene_with(lambda j: j.update(extensionsRequired=["ACME_x"])), "/extensionsRequired/0", "ACME_x"),
    "basis": (scene_with(lambda j: j.update(extensionsRequired=["GOOGLE_texture_basis"])), "/extensionsRequired/0",
              "GOOGLE_texture_basis"),
    "nan": (with_nan("nan"), "/accessors/0", 1),
    "infinite": (with_nan("inf"), "/accessors/0", 1),
    "view-range": (scene_with(lambda j: j["bufferViews"][0].update(byteOffset=1000)), "/bufferViews/0", 1000),
    "count": (scene_with(lambda j: j["accessors"][0].update(count=4)), "/accessors/0", 4),
    "unaligned": (scene_with(lambda j: j["accessors"][0].update(byteOffset=2, count=2)), "/accessors/0", 2),
    "normalized-float": (scene_with(lambda j: j["accessors"][0].update(normalized=True)), "/accessors/0/normalized",
                         ""),
    "sparse-twice": (sparse_indices([1, 1]), "/accessors/0/sparse/indices", ""),
    "sparse-range": (sparse_indices([1, 3]), "/accessors/0/sparse/indices", 3),
    "sparse-many": (sparse_indices([0, 1, 2, 3]), "/accessors/0/sparse/count", 4),
    "bad-buffer": (scene_with(lambda j: j["bufferViews"][0].update(buffer=7)), "/bufferViews/0/buffer", "buffers[7]"),
    "bad-accessor": (primitive(attributes={"POSITION": 9}), f"{AT}/POSITION", "accessors[9]"),
    "same-view": (primitive(indices=0), "/meshes/0/primitives/0/indices", "SCALAR"),
    "mode": (primitive(mode=7), "/meshes/0/primitives/0/mode", 7),
    "target-base": (primitive(targets=[{"NORMAL": 0}]), "/meshes/0/primitives/0/targets/0/NORMAL", ""),
    "node-weights": (scene_with(lambda j: j["nodes"][0].update(weights=[1]), morphing), "/nodes/0/weights",
                     1),
    "cycle": (scene_with(lambda j: j.update(nodes=[{}, {"children": [2]}, {"children": [1]}])), "/nodes/1", ""),
    "self": (scene_with(lambda j: j.update(nodes=[{"children": [0]}])), "/nodes/0", ""),
    "two-parents": (scene_with(lambda j: j.update(nodes=[{}, {"children": [0]}, {"children": [0]}])),
                    "/nodes/2/children/0", "nodes[0]"),
    "root-twice": (scene_with(lambda j: j.update(scenes=[{"nodes": [0, 0]}])), "/scenes/0/nodes/1", ""),
    "overflow": (scene_with(lambda j: j["nodes"][0].update(scale=[1, 1, 10**400])), "/nodes/0/scale/2", ""),
    "skin-plain-mesh": (scene_with(lambda j: (j["nodes"][0].update(skin=0), j.update(skins=[{"joints": [0]}]))),
                        "/nodes/0", ""),
    "joint-range": (lambda: skinned([[1, 0, 0, 0]] * 3, [[2, 0, 0, 0]] * 3), "/nodes/0", 2),
    "no-common-root": (scene_with(lambda j: j["nodes"][1].pop("children"), lambda: skinned([[1, 0, 0, 0]] * 3)),
                       "/skins/0/joints", ""),
    "skeleton": (lambda: skinned([[1, 0, 0, 0]] * 3, skeleton=2), "/skins/0/skeleton", ""),
    "joint-twice": (scene_with(lambda j: j["skins"][0].update(joints=[1, 1]), lambda: skinned([[1, 0, 0, 0]] * 3)),
                    "/skins/0/joints", ""),
    "yfov": (camera(yfov=0), "/cameras/0/perspective/yfov", ""),
    "light-intensity": (light(intensity=-1), "/extensions/KHR_lights_punctual/lights/1/intensity", ""),
    "times-back": (lambda: animated(times=(0, 2, 1), values=[[0, 0, 0]] * 3), "/animations/0/samplers/0/input",
                   1),
    "output-count": (lambda: animated(values=[[0, 0, 0]] * 3), "/animations/0/samplers/0/output", 2),
    "output-cubic": (lambda: animated(interpolation="CUBICSPLINE"), "/animations/0/samplers/0/output", 6),
    "output-type": (lambda: animated("rotation"), "/animations/0/samplers/0/output", "VEC4"),
    "output-integers": (lambda: animated(values=[[0, 0, 0, 0]] * 2, path="rotation", dtype="u1"),
                        "/animations/0/samplers/0/output", "UNSIGNED_BYTE"),
    "same-target": (scene_with(lambda j: j["animations"][0]["channels"].append(j["animations"][0]["channels"][0]),
                               animated), "/animations/0/channels/1/target", 0),
    "pointer-light": (scene_with(lambda j: j["animations"][0]["channels"][0].update(
        target=pointer("/extensions/KHR_lights_punctual/lights/0/intensity")), animated),
        "/animations/0/channels/0/target/extensions/KHR_animation_pointer/pointer", ""),
    "instancing": (scene_with(lambda j: j["nodes"][0].update(extensions={"EXT_mesh_gpu_instancing": {"attributes": {
        "TRANSLATION": 0, "ROTATION": 0}}})),
        "/nodes/0/extensions/EXT_mesh_gpu_instancing/attributes/ROTATION", "VEC3"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_refusal(tmp_path: Path, name: str) -> None:
    build, where, value = CASES[name]
    refuse(build().save(tmp_path), where, value)


def test_bases_of_the_cases_are_valid(tmp_path: Path) -> None:
    """No case is refused for a fault of its base."""
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
    refuse(gltf.save(tmp_path), "/meshes/0/primitives/0/indices", 3, 2)


def test_accessor_one_component_too_long(tmp_path: Path) -> None:
    gltf = triangle_scene()
    view = gltf.view(bytes(8))
    gltf.add("accessors", {"bufferView": view, "componentType": 5126, "count": 3, "type": "SCALAR"})
    refuse(gltf.save(tmp_path), "/accessors/1", 8)


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
    assert refuse(gltf.save(tmp_path), None, "byteStride").where.endswith(f"/{where}")


def test_indices_among_attributes(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.mesh(TRIANGLE, [0, 1, 2])
    gltf.json["bufferViews"][1]["target"] = 34962
    refuse(gltf.save(tmp_path), "/meshes/0/primitives/0/indices")


def test_scene_selection_errors(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.json["scenes"] = [{"name": "a"}, {"name": "a"}, {"name": "b"}]
    path = gltf.save(tmp_path)
    refuse(path, "/scenes", "'c'", "'a'", scene="c")
    refuse(path, "/scenes", 7, scene=7)
    refuse(path, "/scenes", -1, scene=-1)
    refuse(path, "/scenes", 2, "'a'", scene="a")
    assert load_scene(path, scene="b").scene_names == ("a", "a", "b")


def test_control_characters_in_names(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.json["scenes"] = [{"name": "a\n\x1b[31mb"}]
    refuse(gltf.save(tmp_path), "/scenes", "'c'", scene="c")
    gltf.json["extensionsRequired"] = ["EVIL\n\x1b[2J"]
    refuse(gltf.save(tmp_path), "/extensionsRequired/0", "EVIL")


# Compression


@pytest.mark.parametrize("extra, module, folder", [("draco", "DracoPy", "BoxDraco.gltf"),
                                                   ("meshopt", "meshoptimizer", "BoxMeshopt.glb")])  # fmt: skip
def test_missing_library_names_the_extra(
    data: Path, monkeypatch: pytest.MonkeyPatch, extra: str, module: str, folder: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    assert f"taubench-gl[{extra}]" in refuse(data / "gltf_transform" / folder).hint


def test_draco_library_failures_are_scene_errors(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def decode(_: bytes) -> None:
        raise Exception("not a draco\nfile")

    monkeypatch.setitem(sys.modules, "DracoPy", types.SimpleNamespace(decode=decode))
    error = refuse(data / "gltf_transform" / "BoxDraco.gltf")
    assert "KHR_draco_mesh_compression" in error.where and "not a draco file" in str(error)


@pytest.mark.parametrize(
    "changes, value",
    [({"filter": "COLOR"}, "COLOR"), ({"filter": "OCTAHEDRAL"}, 12), ({"count": 99}, 1200), ({"byteOffset": 10**9}, ""),
     ({"byteLength": 10}, ""), ({"mode": "INDICES", "filter": "EXPONENTIAL"}, "EXPONENTIAL"),
     ({"mode": "TRIANGLES"}, ""), ({"buffer": 1}, ""), ({"buffer": 9}, "buffers[9]"), ({"byteStride": 0}, "")],
    ids=lambda v: ",".join(v) if isinstance(v, dict) else None,
)  # fmt: skip
def test_invalid_meshopt_view(tmp_path: Path, changes: dict, value: object) -> None:
    meshopt = pytest.importorskip("meshoptimizer")
    gltf = Gltf()
    points = np.zeros((100, 3), np.float32)
    view = compressed(gltf, meshopt.encode_vertex_buffer(points), 12, 100, "ATTRIBUTES", byteStride=12)
    gltf.add("accessors", {"bufferView": view, "componentType": 5126, "count": 100, "type": "VEC3"})
    load_scene(finish(gltf).save(tmp_path))
    gltf.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"].update(changes)
    error = refuse(gltf.save(tmp_path), None, value)
    assert error.where.startswith("scene.gltf#/bufferViews/0")


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
    assert refuse(path).where.startswith("bomb.gltf#/bufferViews/0")
