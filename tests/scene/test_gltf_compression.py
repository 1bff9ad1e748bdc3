"""Draco and meshopt against the same data uncompressed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gltf_builders import (
    QUAD,
    compressed,
    finish,
    primitive_of,
)
from gltf_files import Gltf

# Compression


def test_draco_against_the_same_mesh_uncompressed(tmp_path: Path) -> None:
    draco = pytest.importorskip("DracoPy")
    rng = np.random.default_rng(4)
    points = rng.normal(size=(60, 3)).astype(np.float32)
    faces = np.arange(60, dtype=np.uint32).reshape(-1, 3)
    uv = rng.random((60, 2)).astype(np.float32)
    packed = draco.encode(points, faces, preserve_order=True, quantization_bits=20, tex_coord=uv.astype(np.float64))
    ids = {a["attribute_type"]: a["unique_id"] for a in draco.decode(packed).attributes}
    gltf = Gltf()
    gltf.extension("KHR_draco_mesh_compression")
    for kind, count in (("VEC3", 60), ("VEC2", 60)):
        gltf.add("accessors", {"componentType": 5126, "count": count, "type": kind})
    gltf.add("accessors", {"componentType": 5125, "count": 60, "type": "SCALAR"})
    types = draco.AttributeType
    compression = {"bufferView": gltf.view(packed),
                   "attributes": {"POSITION": ids[types.POSITION], "TEXCOORD_0": ids[types.TEX_COORD]}}  # fmt: skip
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2,
                                        "extensions": {"KHR_draco_mesh_compression": compression}}]})  # fmt: skip
    primitive = primitive_of(gltf, tmp_path)
    np.testing.assert_array_equal(primitive.triangles, faces)
    np.testing.assert_allclose(primitive.positions, points, atol=1e-5)
    np.testing.assert_allclose(primitive.texcoords[0], uv, atol=1e-5)


@pytest.mark.parametrize("index_type", [5123, 5125])
def test_meshopt_round_trip(tmp_path: Path, index_type: int) -> None:
    meshopt = pytest.importorskip("meshoptimizer")
    points = np.random.default_rng(5).normal(size=(100, 3)).astype(np.float32)
    faces = np.random.default_rng(6).permutation(99).astype(np.uint32)
    gltf = Gltf()
    vertices = compressed(gltf, meshopt.encode_vertex_buffer(points), 12, 100, "ATTRIBUTES", byteStride=12)
    size = 2 if index_type == 5123 else 4
    indices = compressed(gltf, meshopt.encode_index_sequence(faces, vertex_count=100), size, 99, "INDICES")
    gltf.add("accessors", {"bufferView": vertices, "componentType": 5126, "count": 100, "type": "VEC3"})
    gltf.add("accessors", {"bufferView": indices, "componentType": index_type, "count": 99, "type": "SCALAR"})
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]})
    primitive = primitive_of(finish(gltf), tmp_path)
    np.testing.assert_array_equal(primitive.positions, points)
    np.testing.assert_array_equal(primitive.triangles.ravel(), faces)


def test_meshopt_octahedral_filter(tmp_path: Path) -> None:
    """Axis directions in octahedral form: x, y and the value of 1."""
    meshopt = pytest.importorskip("meshoptimizer")
    encoded = np.array([[127, 0, 127, 0], [0, 127, 127, 0], [0, 0, 127, 0], [0, -127, 127, 0]], np.int8)
    gltf = Gltf()
    gltf.extension("KHR_mesh_quantization")
    view = compressed(gltf, meshopt.encode_vertex_buffer(encoded), 4, 4, "ATTRIBUTES", "OCTAHEDRAL", byteStride=4)
    gltf.mesh(QUAD, [0, 1, 2, 0, 2, 3])
    normal = gltf.add("accessors", {"bufferView": view, "componentType": 5120, "normalized": True, "count": 4,
                                    "type": "VEC3"})  # fmt: skip
    gltf.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = normal
    normals = primitive_of(finish(gltf), tmp_path).normals
    np.testing.assert_allclose(normals, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]], atol=1e-6)
