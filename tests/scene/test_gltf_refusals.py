"""What must not get in: each refusal is one SceneError that says what and where, and costs next to nothing."""

from __future__ import annotations

import base64
import json
import os
import sys
import tracemalloc
import types
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_files import TRIANGLE, Gltf, glb, triangle_scene
from test_gltf_features import compressed, finish, lights, morphing, png, pointer, skinned, textured

from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene


def refuse(path: Path, *parts: str, **options: Any) -> str:
    """The message of the SceneError, which must hold every part and fit one line."""
    with pytest.raises(SceneError) as caught:
        load_scene(path, **options)
    text = str(caught.value)
    assert "\n" not in text and text.isprintable()
    for part in parts:
        assert part in text, text
    return text


# Files


def test_unknown_suffix_lists_known_ones() -> None:
    refuse(Path("model.fbx"), ".fbx", ".glb, .gltf")


def test_missing_folder_empty(tmp_path: Path) -> None:
    refuse(tmp_path / "no.gltf", "no such file")
    (tmp_path / "folder.gltf").mkdir()
    refuse(tmp_path / "folder.gltf", "is a folder")
    (tmp_path / "empty.glb").touch()
    refuse(tmp_path / "empty.glb", "is empty")
    refuse(tmp_path / ("x" * 300 + ".gltf"), "cannot be read")
    refuse(Path("nul\0.gltf"))


def test_no_pipe_is_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.gltf")
    refuse(tmp_path / "pipe.gltf", "not a regular file")
    os.mkfifo(tmp_path / "pipe.bin")
    gltf = triangle_scene()
    gltf.json["buffers"] = [{"byteLength": 36, "uri": "pipe.bin"}]
    refuse(gltf.save(tmp_path), "/buffers/0/uri", "not a regular file")


def test_json_errors_say_line_and_column(tmp_path: Path) -> None:
    path = tmp_path / "a.gltf"
    path.write_text('{\n  "asset": {"version": "2.0"},\n  "nodes": [,]\n}')
    refuse(path, "line 3 column 13")
    path.write_bytes(b"\xef\xbb\xbf{}")
    refuse(path, "byte order mark")
    path.write_text('{"asset": {"version": "2.0"}')
    refuse(path, "not valid JSON")
    path.write_text("[1]")
    refuse(path, "Expected object")
    path.write_text('{"asset": {"version": "2.0"}, "nodes": [{"translation": [NaN, 0, 0]}]}')
    refuse(path, "not valid JSON")


@pytest.mark.parametrize("place", ["extras", "extensions", "nodes"])
def test_deep_json(tmp_path: Path, place: str) -> None:
    path = tmp_path / "deep.gltf"
    opening, closing = '{"a":[' * 200_000, "]}" * 200_000
    path.write_text('{"asset": {"version": "2.0"}, "' + place + '": ' + opening + closing + "}")
    refuse(path, "nested too deeply" if place == "extras" else "")


def test_glb_cut_at_every_length(tmp_path: Path) -> None:
    whole = triangle_scene().save(tmp_path, "whole.glb").read_bytes()
    path = tmp_path / "cut.glb"
    for length in range(1, len(whole), 7):
        path.write_bytes(whole[:length])
        refuse(path, "cut.glb")


def test_glb_header(tmp_path: Path) -> None:
    whole = triangle_scene().save(tmp_path, "whole.glb").read_bytes()
    path = tmp_path / "a.glb"
    path.write_bytes(b"glTX" + whole[4:])
    refuse(path, "not a binary glTF")
    path.write_bytes(whole[:4] + b"\1\0\0\0" + whole[8:])
    refuse(path, "version 1")
    path.write_bytes(glb(b""))
    refuse(path, "JSON")


# URIs


@pytest.mark.parametrize(
    "uri",
    ["../secret.bin", "sub/../../secret.bin", "%2e%2e/secret.bin", "%2E%2E%2Fsecret.bin", "..%2fsecret.bin", "link.bin",
     "linked/secret.bin", "/etc/hostname", "%2Fetc%2Fhostname", "//host/a.bin", "\\\\host\\a.bin", "C:\\a.bin",
     "http://example.com/a.bin", "https://example.com/a.bin", "file:///etc/hostname", "FILE:/etc/hostname", "%66ile:/x",
     "", ".", "sub", "a%00.bin", "%FF.bin", "x" * 5000, "loop"],
    ids=lambda uri: uri[:24],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["buffer", "image"])
def test_uris_stay_in_the_folder(tmp_path: Path, uri: str, kind: str) -> None:
    folder = tmp_path / "scene"
    (folder / "sub").mkdir(parents=True)
    secret = png() if kind == "image" else bytes(100)
    (tmp_path / "secret.bin").write_bytes(secret)
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "linked").symlink_to(tmp_path)
    (folder / "loop").symlink_to(folder / "loop")
    if kind == "buffer":
        gltf = triangle_scene()
        gltf.json["buffers"] = [{"byteLength": 36, "uri": uri}]
    else:
        gltf = textured({})
        gltf.json["images"][0]["uri"] = uri
    refuse(gltf.save(folder), f"/{kind}s/0/uri")


@pytest.mark.parametrize("encode", [str, lambda s: s.replace("/", "%2F")], ids=["plain", "encoded"])
def test_absolute_paths_are_refused_even_inside(tmp_path: Path, encode: Callable[[str], str]) -> None:
    gltf = triangle_scene()
    (tmp_path / "a.bin").write_bytes(gltf.blob)
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": encode(str(tmp_path / "a.bin"))}]
    refuse(gltf.save(tmp_path), "/buffers/0/uri", "is absolute")


def test_links_within_the_folder_are_followed(tmp_path: Path) -> None:
    gltf = triangle_scene()
    (tmp_path / "real.bin").write_bytes(gltf.blob)
    (tmp_path / "link.bin").symlink_to(tmp_path / "real.bin")
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": "link.bin"}]
    assert load_scene(gltf.save(tmp_path)).meshes


@pytest.mark.parametrize(
    "uri",
    ["data:", "data:application/octet-stream,abc", "data:application/octet-stream;base64,@@@@",
     "data:text/html;base64,AAAA", "data:;base64,AAAA"],
    ids=["bare", "plain", "alphabet", "html", "untyped"],
)  # fmt: skip
def test_bad_data_uris(tmp_path: Path, uri: str) -> None:
    gltf = triangle_scene()
    gltf.json["buffers"] = [{"byteLength": 3, "uri": uri}]
    refuse(gltf.save(tmp_path), "/buffers/0/uri")


# Bombs: the peak of what is allocated, which tracemalloc sees for NumPy too, stays small


def change(**changes: Any) -> Callable[[Gltf], None]:
    def apply(gltf: Gltf) -> None:
        gltf.json["accessors"][0].update(changes)

    return apply


def no_view(gltf: Gltf) -> None:
    del gltf.json["accessors"][0]["bufferView"]
    gltf.json["accessors"][0]["count"] = 10**9


def no_view_many(gltf: Gltf) -> None:
    """Each within reason, all together not."""
    accessor = {"componentType": 5126, "type": "MAT4", "count": 2**21}
    first = len(gltf.json["accessors"])
    gltf.json["accessors"] += [dict(accessor) for _ in range(100)]
    position = {"componentType": 5126, "type": "VEC3", "count": 10**7}
    gltf.json["accessors"] += [position] * 3
    for i in range(3):
        gltf.json["meshes"].append({"primitives": [{"attributes": {"POSITION": first + 100 + i}}]})


def huge_sparse(gltf: Gltf) -> None:
    gltf.json["accessors"][0]["sparse"] = {"count": 10**12, "indices": {"bufferView": 0, "componentType": 5125},
                                           "values": {"bufferView": 0}}  # fmt: skip


def zeros_under_sparse(gltf: Gltf) -> None:
    del gltf.json["accessors"][0]["bufferView"]
    gltf.json["accessors"][0].update(count=10**12, sparse={
        "count": 1, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}})  # fmt: skip


@pytest.mark.parametrize(
    "bomb",
    [change(count=10**12), change(count=2**63), change(count=10**30), change(count=1e300), change(byteOffset=2**62),
     no_view, no_view_many, huge_sparse, zeros_under_sparse],
    ids=["count-1e12", "count-2^63", "count-1e30", "count-float", "offset", "no-view", "no-view-many", "sparse",
         "zeros-under-sparse"],
)  # fmt: skip
def test_bombs_allocate_little(tmp_path: Path, bomb: Callable[[Gltf], None]) -> None:
    gltf = triangle_scene()
    bomb(gltf)
    path = gltf.save(tmp_path)
    tracemalloc.start()
    try:
        refuse(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < (400 << 20 if bomb is no_view_many else 8 << 20)


def test_image_bombs(tmp_path: Path) -> None:
    for width, height in ((16385, 1), (16384, 16384), (2**31 - 1, 2**31 - 1)):
        data = bytearray(png((1, 1)))
        data[16:24] = width.to_bytes(4, "big") + height.to_bytes(4, "big")
        data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
        gltf = textured({})
        gltf.json["images"][0]["uri"] = "data:image/png;base64," + base64.b64encode(data).decode()
        refuse(gltf.save(tmp_path), "/images/0")


def test_truncated_image_fails_in_decode_only(tmp_path: Path) -> None:
    gltf = textured({})
    data = png((64, 64))[:-30]
    gltf.json["images"][0]["uri"] = "data:image/png;base64," + base64.b64encode(data).decode()
    scene = load_scene(gltf.save(tmp_path))
    with pytest.raises(SceneError, match=r"/images/0.*cannot be decoded"):
        scene.images[0].decode()


def test_long_chain_of_nodes(tmp_path: Path) -> None:
    gltf = Gltf()
    for i in range(1500):
        gltf.node(children=[i + 1])
    gltf.node()
    assert len(load_scene(gltf.save(tmp_path)).nodes.levels()) == 1501
    for i in range(1500, 5000):
        gltf.json["nodes"][i]["children"] = [i + 1]
        gltf.node()
    refuse(gltf.save(tmp_path), "levels below its root")


def test_shared_accessors_share_memory(tmp_path: Path) -> None:
    """A thousand primitives over one accessor of ten thousand vertices: without sharing, hundreds of megabytes."""
    gltf = Gltf()
    points = np.random.default_rng(0).random((10_000, 3), np.float32)
    weights = np.tile([0.5, 0.5, 0, 0], (10_000, 1))
    gltf.mesh(points, COLOR_0=gltf.accessor(points), WEIGHTS_0=gltf.accessor(weights),
              JOINTS_0=gltf.accessor(np.zeros((10_000, 4)), "u1"))  # fmt: skip
    gltf.json["meshes"] *= 1000
    gltf.node()
    gltf.animation({"node": 0, "path": "translation"}, np.arange(10_000), points)
    gltf.json["nodes"] *= 1000
    channel = gltf.json["animations"][0]["channels"][0]
    gltf.json["animations"][0]["channels"] = [
        {**channel, "target": {"node": i, "path": "translation"}} for i in range(1000)
    ]
    path = gltf.save(tmp_path)
    tracemalloc.start()
    try:
        scene = load_scene(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(scene.meshes) == len(scene.channels) == 1000 and peak < 32 << 20


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
