"""The binary container of glTF and additions to a document, against the byte layout of glTF 2.0, section 4."""

from __future__ import annotations

import struct

import pytest

from taubench_gl.errors import SceneError
from taubench_gl.scene.gltf.container import add_facts, container_bytes, read_container


def test_the_layout_of_a_container():
    data = container_bytes(b'{"a":1}', b"12345")
    assert data[:4] == b"glTF" and struct.unpack_from("<II", data, 4) == (2, len(data))
    assert struct.unpack_from("<II", data, 12) == (8, 0x4E4F534A) and data[20:28] == b'{"a":1} '
    assert struct.unpack_from("<II", data, 28) == (8, 0x004E4942) and data[36:] == b"12345\0\0\0"


@pytest.mark.parametrize("length", range(0, 40, 3))
def test_truncated_containers_are_refused(length):
    with pytest.raises(SceneError):
        read_container(container_bytes(b'{"a":1}', b"12345")[:length], "a.glb")


def test_facts_are_added_to_those_of_the_file():
    root = {"asset": {"extras": {"other": 1, "taubench_gl": {"name": "a", "note": "b"}}}}
    add_facts(root, {"note": "c"})
    assert root["asset"]["extras"] == {"other": 1, "taubench_gl": {"name": "a", "note": "c"}}
    bare = {"asset": {"extras": "text"}}
    add_facts(bare, {"note": "c"})
    assert bare["asset"]["extras"] == {"taubench_gl": {"note": "c"}}
