"""The binary container of glTF and additions to a document, against the byte layout of glTF 2.0, section 4."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from taubench_gl.errors import SceneError
from taubench_gl.scene.gltf.container import add_accessor, add_facts, container_bytes, read_container


def test_the_layout_of_a_container():
    data = container_bytes(b'{"a":1}', b"12345")
    assert data[:4] == b"glTF" and struct.unpack_from("<II", data, 4) == (2, len(data))
    assert struct.unpack_from("<II", data, 12) == (8, 0x4E4F534A) and data[20:28] == b'{"a":1} '
    assert struct.unpack_from("<II", data, 28) == (8, 0x004E4942) and data[36:] == b"12345\0\0\0"


@pytest.mark.parametrize("length", range(0, 40, 3))
def test_truncated_containers_are_refused(length):
    with pytest.raises(SceneError):
        read_container(container_bytes(b'{"a":1}', b"12345")[:length], "a.glb")


def test_accessors_are_aligned_and_have_the_bounds_of_their_values():
    root, data = {}, bytearray(b"x")
    flags = add_accessor(root, data, np.array([1, 0, 1], np.uint8))
    vectors = np.array([[1, 2, 3], [-1, 5, 0]], np.float32)
    points = add_accessor(root, data, vectors, buffer=2, bounds=True)
    assert (flags, points) == (0, 1)
    assert root["accessors"][0] == {"bufferView": 0, "componentType": 5121, "count": 3, "type": "SCALAR"}
    assert root["accessors"][1] == {"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC3",
                                    "min": [-1, 2, 0], "max": [1, 5, 3]}  # fmt: skip
    assert [v["byteOffset"] for v in root["bufferViews"]] == [4, 8] and root["bufferViews"][1]["buffer"] == 2
    assert np.frombuffer(data, np.float32, 6, offset=8).tolist() == vectors.ravel().tolist()


def test_facts_are_added_to_those_of_the_file():
    root = {"asset": {"extras": {"other": 1, "taubench_gl": {"name": "a", "note": "b"}}}}
    add_facts(root, {"note": "c"})
    assert root["asset"]["extras"] == {"other": 1, "taubench_gl": {"name": "a", "note": "c"}}
    bare = {"asset": {"extras": "text"}}
    add_facts(bare, {"note": "c"})
    assert bare["asset"]["extras"] == {"taubench_gl": {"note": "c"}}
