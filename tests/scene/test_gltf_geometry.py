"""Containers, triangles and accessors: one small file per feature, with explicit expected numbers."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from gltf_builders import (
    QUAD,
    area_sign,
    notes_about,
    primitive_of,
)
from gltf_files import Gltf, triangle_scene

from taubench_gl.scene import load_scene
from taubench_gl.scene.gltf.meshes import TRIANGLE_FAN, TRIANGLE_STRIP, TRIANGLES, triangle_list


def test_file_with_only_an_asset(tmp_path: Path) -> None:
    scene = load_scene(Gltf().save(tmp_path))
    assert len(scene.nodes) == 0 and not scene.meshes and scene.nodes.levels() == []


def test_glb_is_the_same_scene(tmp_path: Path) -> None:
    gltf = triangle_scene()
    a, b = load_scene(gltf.save(tmp_path, "a.gltf")), load_scene(gltf.save(tmp_path, "b.glb"))
    np.testing.assert_array_equal(a.meshes[0].primitives[0].positions, b.meshes[0].primitives[0].positions)
    assert a.sha256 != b.sha256


@pytest.mark.parametrize("uri", ["dätä %231.bin", "d%C3%A4t%C3%A4%20%231.bin", "sub/../dätä %231.bin"])
def test_percent_encoded_and_unicode_uris(tmp_path: Path, uri: str) -> None:
    gltf = triangle_scene()
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": uri}]
    (tmp_path / "sub").mkdir()
    (tmp_path / "dätä #1.bin").write_bytes(gltf.blob)
    assert len(load_scene(gltf.save(tmp_path, "szene ❤.gltf")).meshes) == 1


def test_integers_written_as_floats(tmp_path: Path) -> None:
    document = triangle_scene().document()
    document["accessors"][0]["count"] = 3.0
    document["nodes"][0]["mesh"] = 0.0
    path = tmp_path / "floats.gltf"
    path.write_text(json.dumps(document))
    assert load_scene(path).nodes.mesh.tolist() == [0]


def test_bytes_after_a_glb_are_noted(tmp_path: Path) -> None:
    path = triangle_scene().save(tmp_path, "long.glb")
    path.write_bytes(path.read_bytes() + b"xyz")
    assert notes_about(load_scene(path), 3)


def test_strip_winding() -> None:
    """All triangles of a strip have the orientation of the first."""
    points = np.array([[i // 2, -(i % 2)] for i in range(8)], float)
    triangles = triangle_list(TRIANGLE_STRIP, np.arange(8))
    assert triangles.tolist()[:3] == [[0, 1, 2], [1, 3, 2], [2, 3, 4]]
    assert len(triangles) == 6 and np.all(area_sign(triangles, points) == area_sign(triangles, points)[0])


def test_fan_winding() -> None:
    angles = np.linspace(0, 2 * math.pi, 6, endpoint=False)
    points = np.vstack([[0, 0], np.c_[np.cos(angles), np.sin(angles)]])
    triangles = triangle_list(TRIANGLE_FAN, np.arange(7))
    assert triangles.tolist()[:2] == [[1, 2, 0], [2, 3, 0]]
    assert len(triangles) == 5 and np.all(area_sign(triangles, points) == 1)


def test_degenerate_triangles_are_dropped_from_strips_only() -> None:
    stitched = np.array([0, 1, 2, 2, 3, 3, 4, 5])
    assert triangle_list(TRIANGLE_STRIP, stitched).tolist() == [[0, 1, 2], [3, 5, 4]]
    assert triangle_list(TRIANGLES, np.array([0, 0, 1, 2])).tolist() == [[0, 0, 1]]


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4"])
def test_index_types(tmp_path: Path, dtype: str) -> None:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(QUAD))
    gltf.json["meshes"][0]["primitives"][0]["indices"] = gltf.accessor([0, 1, 2, 2, 3, 0], dtype)
    triangles = primitive_of(gltf, tmp_path).triangles
    assert triangles.tolist() == [[0, 1, 2], [2, 3, 0]] and triangles.dtype == np.uint32


def test_points_and_lines_are_counted(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.mesh(QUAD)
    for mode in (0, 1, 2, 3):
        primitive = gltf.json["meshes"][gltf.mesh(QUAD, mode=mode)]["primitives"][0]
        gltf.json["meshes"][0]["primitives"].append(primitive)
    gltf.json["meshes"] = gltf.json["meshes"][:1]
    scene = load_scene(gltf.save(tmp_path))
    assert len(scene.meshes[0].primitives) == 1
    assert notes_about(scene, 4, "4 points", "9 lines")


# Accessors


@pytest.mark.parametrize(
    "dtype, stored, value",
    [("u1", 255, 1.0), ("u1", 51, 0.2), ("u2", 13107, 0.2), ("u2", 65535, 1.0)],
)
def test_normalized_unsigned(tmp_path: Path, dtype: str, stored: int, value: float) -> None:
    gltf = Gltf()
    uv = gltf.accessor([[0, stored], [0, 0], [stored, 0]], dtype, normalized=True)
    gltf.node(mesh=gltf.mesh(TEXCOORD_0=uv))
    got = primitive_of(gltf, tmp_path).texcoords[0]
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, [[0, value], [0, 0], [value, 0]], atol=1e-7)


def test_quantized_positions_and_normals(tmp_path: Path) -> None:
    """-128 and -127 both mean -1; integers that are not normalized are unchanged."""
    gltf = Gltf()
    gltf.extension("KHR_mesh_quantization")
    normals = gltf.view(np.array([[0, 0, 127, 0], [0, 0, -127, 0], [0, 0, -128, 0]], "i1").tobytes(), byteStride=4)
    normal = gltf.add("accessors", {"bufferView": normals, "componentType": 5120, "count": 3, "type": "VEC3",
                                    "normalized": True})  # fmt: skip
    points = gltf.view(np.array([[0, 0, 0, 9], [300, 0, 0, 9], [0, -300, 0, 9]], "<i2").tobytes(), byteStride=8)
    position = gltf.add("accessors", {"bufferView": points, "componentType": 5122, "count": 3, "type": "VEC3"})
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": position, "NORMAL": normal}}]})
    primitive = primitive_of(gltf, tmp_path)
    np.testing.assert_array_equal(primitive.normals, [[0, 0, 1], [0, 0, -1], [0, 0, -1]])
    np.testing.assert_array_equal(primitive.positions, [[0, 0, 0], [300, 0, 0], [0, -300, 0]])


@pytest.mark.parametrize("base", [True, False], ids=["over-data", "over-zeros"])
def test_sparse(tmp_path: Path, base: bool) -> None:
    gltf = Gltf()
    points = np.zeros((5, 3), np.float32) + (7 if base else 0)
    expected = points.copy()
    expected[[1, 4]] = [[1, 2, 3], [4, 5, 6]]
    sparse = {
        "count": 2,
        "indices": {"bufferView": gltf.view(np.array([1, 4], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": gltf.view(expected[[1, 4]].tobytes())},
    }
    bounds = {"min": expected.min(axis=0).tolist(), "max": expected.max(axis=0).tolist()}
    if base:
        position = gltf.accessor(points, sparse=sparse, **bounds)
    else:
        item = {"componentType": 5126, "count": 5, "type": "VEC3", "sparse": sparse, **bounds}
        position = gltf.add("accessors", item)
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": position}}]})
    np.testing.assert_array_equal(primitive_of(gltf, tmp_path).positions, expected)


@pytest.mark.parametrize(
    "values, dtype, expected",
    [
        ([[0, 51, 255]] * 3, "u1", [0, 0.2, 1, 1]),
        ([[0, 51, 255, 51]] * 3, "u1", [0, 0.2, 1, 0.2]),
        ([[0, 0.25, 1]] * 3, "f4", [0, 0.25, 1, 1]),
        ([[0, 0.25, 1, 0.5]] * 3, "f4", [0, 0.25, 1, 0.5]),
    ],
    ids=["rgb8", "rgba8", "rgb32f", "rgba32f"],
)
def test_vertex_colors(tmp_path: Path, values: list, dtype: str, expected: list) -> None:
    gltf = Gltf()
    if dtype == "u1" and len(values[0]) == 3:
        view = gltf.view(np.pad(np.array(values, "u1"), ((0, 0), (0, 1))).tobytes(), byteStride=4)
        color = gltf.add("accessors", {"bufferView": view, "componentType": 5121, "count": 3, "type": "VEC3",
                                       "normalized": True})  # fmt: skip
    else:
        color = gltf.accessor(values, dtype, normalized=dtype == "u1")
    gltf.mesh(COLOR_0=color)
    colors = primitive_of(gltf, tmp_path).colors
    assert colors.dtype == np.float32 and colors.shape == (3, 4)
    np.testing.assert_allclose(colors, [expected] * 3, atol=1e-7)
