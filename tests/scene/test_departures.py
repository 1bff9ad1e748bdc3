"""Small departures from glTF that other programs write and viewers allow: read with one counted note, or refused."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_builders import lights, morphing, png, pointer, refuse, skinned, textured
from gltf_files import TRIANGLE, Gltf, glb, triangle_scene
from test_gltf_refusals import animated, camera, light, primitive, scene_with, sparse_indices, with_attribute

from taubench_gl.scene import Scene, load_scene
from taubench_gl.scene.notes import REPAIRS

Build = Callable[[], Gltf]
UNIT3 = [[0, 0, 1]] * 3
TANGENT = [[1, 0, 0, 1]] * 3
IDENTITY = np.eye(4).ravel().tolist()
MATERIAL = {"pbrMetallicRoughness": {"baseColorFactor": [1.02, 0.5, 0.5, 1]}}


def with_frames(normals: Any, tangents: Any) -> Build:
    def build() -> Gltf:
        gltf = Gltf()
        gltf.node(mesh=gltf.mesh(NORMAL=gltf.accessor(normals), TANGENT=gltf.accessor(tangents)))
        return gltf

    return build


def image(**changes: Any) -> Build:
    def build() -> Gltf:
        gltf = textured({})
        gltf.json["images"][0].update(changes)
        gltf.node(mesh=gltf.mesh(TEXCOORD_0=gltf.accessor([[0, 0], [1, 0], [0, 1]])))
        gltf.json["meshes"][0]["primitives"][0]["material"] = 0
        return gltf

    return build


def data_uri(head: str, encode: Callable[[bytes], str]) -> Build:
    def build() -> Gltf:
        gltf = triangle_scene()
        gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": head + encode(bytes(gltf.blob))}]
        return gltf

    return build


def wrapped(data: bytes) -> str:
    text = base64.b64encode(data).decode()
    return text[:20] + "\n" + text[20:]


def strided() -> Gltf:
    gltf = animated()
    view = gltf.json["accessors"][gltf.json["animations"][0]["samplers"][0]["input"]]["bufferView"]
    gltf.json["bufferViews"][view]["byteStride"] = 4
    return gltf


def unaligned() -> Gltf:
    gltf = Gltf()
    view = gltf.view(b"\0\0" + TRIANGLE.tobytes() + b"\0\0")
    position = gltf.add("accessors", {"bufferView": view, "byteOffset": 2, "componentType": 5126, "count": 3,
                                      "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]})  # fmt: skip
    gltf.node(mesh=gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": position}}]}))
    return gltf


def two_targets() -> Gltf:
    gltf = morphing(1)
    bare = {"attributes": dict(gltf.json["meshes"][0]["primitives"][0]["attributes"])}
    gltf.json["meshes"][0]["primitives"].append(bare)
    return gltf


def perspective(**changes: float) -> Build:
    return camera(**changes)


def rounded_bounds() -> Gltf:
    gltf = Gltf()
    points = np.float32(TRIANGLE) / 3
    gltf.node(mesh=gltf.add("meshes", {"primitives": [{"attributes": {
        "POSITION": gltf.accessor(points, max=[0.333, 0.333, 0.0])}}]}))  # fmt: skip
    return gltf


CASES: dict[str, tuple[Build, str, int]] = {
    # name: (file, kind of the note, its count)
    "zero-normals": (with_attribute("NORMAL", [*UNIT3[:2], [0, 0, 0]]), "normal-length", 1),
    "long-normals": (with_attribute("NORMAL", [[0, 0, 2]] * 3), "normal-length", 3),
    "nan-normals": (with_attribute("NORMAL", [*UNIT3[:1], [np.nan] * 3, [np.inf, 0, 0]], min=[0, 0, 1], max=[0, 0, 1]),
                    "normal-length", 2),
    "short-tangents": (with_frames(UNIT3, [*TANGENT[:2], [0.5, 0, 0, 1]]), "tangent", 1),
    "zero-tangents": (with_frames(UNIT3, [[0, 0, 0, 1]] * 3), "tangent", 3),
    "tangent-sign": (with_frames(UNIT3, [[1, 0, 0, 0]] * 3), "tangent", 3),
    "rounded-bounds": (rounded_bounds, "bounds", 1),
    "stale-bounds": (scene_with(lambda j: j["accessors"][0].update(min=[-9, 0, 0])), "bounds", 1),
    "bounds-size": (scene_with(lambda j: j["accessors"][0].update(max=[1])), "bounds", 1),
    "no-time-bounds": (scene_with(lambda j: [j["accessors"][1].pop(k) for k in ("min", "max")], animated),
                       "key-time-bounds", 1),
    "empty-arrays": (scene_with(lambda j: j.update(materials=[], textures=[], animations=[])), "empty-array", 3),
    "empty-channels": (scene_with(lambda j: j.update(animations=[{"channels": [], "samplers": []}])),
                       "empty-array", 2),
    "null-name": (scene_with(lambda j: j["nodes"][0].update(name=None)), "null-member", 1),
    "number-name": (scene_with(lambda j: j["nodes"][0].update(name=7)), "wrong-type", 1),
    "color-factor": (scene_with(lambda j: j.update(materials=[MATERIAL])), "factor-range", 1),
    "vertex-colors": (with_attribute("COLOR_0", [[1.001, 0, 0], [0, 0, 0], [0, -0.1, 0]]), "color-range", 2),
    "nan-texcoords": (with_attribute("TEXCOORD_0", [[0, 0], [np.nan, 0], [1, 1]], min=[0, 0], max=[1, 1]),
                      "nonfinite-attribute", 1),
    "rotation": (scene_with(lambda j: j["nodes"][0].update(rotation=[0, 0, 0, 2])), "quaternion-length", 1),
    "animated-rotation": (lambda: animated("rotation", values=[[0, 0, 0, 1], [0, 0, 0, 0.5]]), "quaternion-length", 1),
    "shear": (scene_with(lambda j: j["nodes"][0].update(matrix=[1, 0.5, *IDENTITY[2:]])), "matrix-shear", 1),
    "nearly-affine": (scene_with(lambda j: j["nodes"][0].update(matrix=[*IDENTITY[:15], 1.0001])), "matrix-shear", 1),
    "matrix-and-scale": (scene_with(lambda j: j["nodes"][0].update(matrix=IDENTITY, scale=[1, 1, 1])),
                         "matrix-and-parts", 1),
    "animated-matrix": (scene_with(lambda j: j["nodes"][0].update(matrix=IDENTITY), animated), "animated-matrix", 1),
    "unknown-attribute": (scene_with(lambda j: j["meshes"][0]["primitives"][0]["attributes"].update(HUE=0)),
                          "unknown-attribute", 1),
    "attribute-gap": (with_attribute("TEXCOORD_1", [[0, 0]] * 3), "attribute-numbers", 1),
    "attribute-count": (with_attribute("NORMAL", UNIT3[:2]), "attribute-ignored", 1),
    "attribute-type": (with_attribute("COLOR_0", [1, 0, 1]), "attribute-ignored", 1),
    "custom-integers": (with_attribute("_ID", [1, 2, 3], "u4"), "attribute-format", 1),
    "undeclared-quantization": (with_attribute("TEXCOORD_0", [[0, 0]] * 3, "u2"), "quantization", 1),
    "joints-alone": (with_attribute("JOINTS_0", [[0, 0, 0, 0]] * 3, "u1"), "joints-without-weights", 1),
    "negative-weights": (lambda: skinned([[1.5, -0.5, 0, 0]] * 3), "negative-weight", 3),
    "missing-image": (image(uri="gone.png"), "texture-unreadable", 1),
    "image-outside": (image(uri="../secret.png"), "texture-unreadable", 1),
    "damaged-image": (image(uri="data:image/png;base64," + base64.b64encode(png()[:40]).decode()),
                      "texture-unreadable", 1),
    "image-type": (image(mimeType="image/jpg"), "image-source", 1),
    "missing-texture": (scene_with(lambda j: j["textures"][0].update(source=5), image()), "texture-reference", 1),
    "missing-material": (primitive(material=3), "material-reference", 1),
    "plain-data-uri": (data_uri("data:application/octet-stream,", lambda b: "".join(f"%{c:02x}" for c in b)),
                       "data-uri", 1),
    "untyped-data-uri": (data_uri("data:;base64,", lambda b: base64.b64encode(b).decode()), "data-uri", 1),
    "wrapped-data-uri": (data_uri("data:application/octet-stream;base64,", wrapped), "data-uri", 1),
    "short-buffer": (scene_with(lambda j: j.update(buffers=[{"byteLength": 40, "uri": "data:application/octet-stream;"
        "base64," + base64.b64encode(TRIANGLE.tobytes()).decode()}])), "short-buffer", 1),
    "stride": (strided, "stride", 1),
    "unaligned": (unaligned, "alignment", 1),
    "sparse-order": (scene_with(lambda j: j["accessors"][0].update(max=[0, 0, 0]), sparse_indices([2, 1])),
                     "sparse-order", 1),
    "morph-counts": (two_targets, "morph-count", 1),
    "morph-weights": (scene_with(lambda j: j["meshes"][0].update(weights=[1]), morphing), "morph-weights", 1),
    "skin-without-mesh": (scene_with(lambda j: j["nodes"][1].update(skin=0), lambda: skinned([[1, 0, 0, 0]] * 3)),
                          "skin-ignored", 1),
    "wide-camera": (perspective(yfov=4), "camera", 1),
    "flat-camera": (perspective(znear=0), "value-range", 1),
    "short-camera": (perspective(znear=2, zfar=1), "camera", 1),
    "area-light": (light(type="area"), "light-type", 1),
    "cones": (light(spot={"innerConeAngle": 1, "outerConeAngle": 0.5}), "light-cone", 1),
    "light-range": (light(range=0), "value-range", 1),
    "missing-light": (scene_with(lambda j: j["nodes"][0]["extensions"]["KHR_lights_punctual"].update(light=9), lights),
                      "light-reference", 1),
    "misplaced": (scene_with(lambda j: j["meshes"][0].update(extensions={"KHR_materials_unlit": {}})),
                  "extension-misplaced", 1),
    "interpolation": (lambda: animated(interpolation="SLERP"), "interpolation", 1),
    "negative-times": (lambda: animated(times=(-1, 1)), "negative-time", 1),
    "no-morphs": (lambda: animated("weights", values=[0, 1]), "channel-ignored", 1),
    "pointer-to-nothing": (scene_with(lambda j: j["animations"][0]["channels"][0].update(
        target=pointer("/nodes/9/scale")), animated), "channel-ignored", 1),
    "scene-root": (scene_with(lambda j: j.update(nodes=[{"children": [1]}, {}], meshes=j["meshes"],
                                                 scenes=[{"nodes": [0, 1]}])), "scene-roots", 1),
    "default-scene": (scene_with(lambda j: j.update(scenes=[{"nodes": [0]}], scene=4)), "default-scene", 1),
}  # fmt: skip


def kinds(scene: Scene) -> list[tuple[str, int]]:
    """Kind and count of every repair."""
    return [(note.kind, note.count) for note in scene.notes if note.kind in REPAIRS]


@pytest.mark.parametrize("name", CASES)
def test_departure(tmp_path: Path, name: str) -> None:
    """Read with exactly one note, which has a count and a place; refused strictly."""
    build, kind, count = CASES[name]
    path = build().save(tmp_path)
    scene = load_scene(path)
    assert kinds(scene) == [(kind, count)]
    refuse(path)


def test_byte_order_mark_and_encoding(tmp_path: Path) -> None:
    path = triangle_scene().save(tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert kinds(load_scene(path)) == [("byte-order-mark", 1)]
    refuse(path, "")
    document = json.dumps({"asset": {"version": "2.0"}, "nodes": [{"name": "K"}]}).encode()
    path.write_bytes(document.replace(b"K", "Käse".encode("latin-1")))
    assert kinds(load_scene(path)) == [("text-encoding", 1)]
    refuse(path, "")


def test_uri_with_a_percent_sign(tmp_path: Path) -> None:
    gltf = triangle_scene()
    (tmp_path / "100%.bin").write_bytes(gltf.blob)
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": "100%.bin"}]
    assert not kinds(load_scene(gltf.save(tmp_path)))  # an incomplete escape stands for itself
    (tmp_path / "a%20b.bin").write_bytes(gltf.blob)
    gltf.json["buffers"][0]["uri"] = "a%20b.bin"
    assert kinds(load_scene(gltf.save(tmp_path))) == [("uri-spelling", 1)]
    refuse(gltf.save(tmp_path), "/buffers/0/uri")


def test_short_binary_chunk(tmp_path: Path) -> None:
    gltf = triangle_scene()
    document = {**gltf.json, "buffers": [{"byteLength": len(gltf.blob) + 4}]}
    path = tmp_path / "short.glb"
    path.write_bytes(glb(json.dumps(document).encode(), bytes(gltf.blob)))
    assert kinds(load_scene(path)) == [("short-buffer", 1)]
    gltf.json["bufferViews"][0]["byteLength"] += 4
    path.write_bytes(glb(json.dumps(document).encode(), bytes(gltf.blob)))
    refuse(path, "/bufferViews/0", strict=False)  # data is missing


# What the repairs give


def test_repaired_normals(tmp_path: Path) -> None:
    """Normalized where there is a direction; else the mean of the faces, weighted by area."""
    points = np.float32([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 1]])
    normals = np.float32([[0, 0, 0], [0, 0, 3], [np.nan, 0, 0], [0, 1, 0]])
    gltf = Gltf()
    normal = gltf.accessor(normals, min=[0, 0, 0], max=[0, 1, 3])
    gltf.node(mesh=gltf.mesh(points, [0, 1, 2, 0, 3, 1], NORMAL=normal))
    scene = load_scene(gltf.save(tmp_path))
    expected = np.array([[0, 1, 2], [0, 0, 1], [0, 0, 1], [0, 1, 0]]) / [[5**0.5], [1], [1], [1]]
    np.testing.assert_allclose(scene.meshes[0].primitives[0].normals, expected, atol=1e-7)


def test_normals_of_degenerate_faces(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(np.zeros((3, 3)), NORMAL=gltf.accessor(np.zeros((3, 3)))))
    normals = load_scene(gltf.save(tmp_path)).meshes[0].primitives[0].normals
    np.testing.assert_array_equal(normals, [[0, 0, 1]] * 3)


def test_repaired_tangents(tmp_path: Path) -> None:
    scene = load_scene(with_frames(UNIT3, [[3, 0, 0, 1], [0, 2, 0, -0.7], [1, 0, 0, 1]])().save(tmp_path))
    assert kinds(scene) == [("tangent", 2)]
    expected = [[1, 0, 0, 1], [0, 1, 0, -1], [1, 0, 0, 1]]
    np.testing.assert_array_equal(scene.meshes[0].primitives[0].tangents, expected)
    scene = load_scene(with_frames(UNIT3, [[0, 0, 0, 1]] * 3)().save(tmp_path))
    assert scene.meshes[0].primitives[0].tangents is None  # rebuilt where a normal map needs them


def test_sheared_matrix_is_kept(tmp_path: Path) -> None:
    gltf = CASES["shear"][0]()
    matrix = load_scene(gltf.save(tmp_path)).nodes.matrix[0]
    np.testing.assert_array_equal(matrix[:3, 0], [1, 0.5, 0])


def test_animated_matrix_becomes_parts(tmp_path: Path) -> None:
    """Translation, rotation by 90 degrees about z, and a mirrored scale, composed and split again."""
    gltf = animated()
    matrix = np.array([[0, -3, 0, 5], [-2, 0, 0, 6], [0, 0, 4, 7], [0, 0, 0, 1]], float)
    gltf.json["nodes"][0]["matrix"] = matrix.T.ravel().tolist()
    nodes = load_scene(gltf.save(tmp_path)).nodes
    from taubench_gl.math3d import trs

    assert not nodes.has_matrix[0]
    np.testing.assert_allclose(trs(nodes.translation[0], nodes.rotation[0], nodes.scale[0]), matrix, atol=1e-12)


def test_limited_values(tmp_path: Path) -> None:
    scene = load_scene(CASES["color-factor"][0]().save(tmp_path))
    assert scene.materials[0].base_color == (1.0, 0.5, 0.5, 1.0)
    scene = load_scene(CASES["vertex-colors"][0]().save(tmp_path))
    np.testing.assert_array_equal(scene.meshes[0].primitives[0].colors, [[1, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 1]])
    scene = load_scene(CASES["rotation"][0]().save(tmp_path))
    assert scene.nodes.rotation[0].tolist() == [0, 0, 0, 1]
    scene = load_scene(CASES["short-camera"][0]().save(tmp_path))
    assert scene.cameras[0].zfar == np.inf


def test_cut_image_is_a_flat_color(tmp_path: Path) -> None:
    """Strictly it is read, and fails only when it is decoded."""
    gltf = image(uri="data:image/png;base64," + base64.b64encode(png((64, 64))[:-30]).decode())()
    assert kinds(load_scene(gltf.save(tmp_path))) == [("texture-unreadable", 1)]
    assert load_scene(gltf.save(tmp_path), strict=True).materials[0].base_color_texture is not None


def test_light_of_unknown_type_is_not_placed(tmp_path: Path) -> None:
    scene = load_scene(CASES["area-light"][0]().save(tmp_path))
    assert len(scene.lights) == 3 and scene.nodes.light.tolist() == [0, -1, 2]


def test_undeclared_extension_is_noted_in_every_mode(tmp_path: Path) -> None:
    gltf = triangle_scene()
    gltf.json["nodes"][0]["extensions"] = {"KHR_node_visibility": {"visible": False}}
    for strict in (False, True):
        scene = load_scene(gltf.save(tmp_path), strict=strict)
        assert [(n.kind, n.count) for n in scene.notes] == [("extension-undeclared", 1)]
        assert not scene.nodes.visible[0]
