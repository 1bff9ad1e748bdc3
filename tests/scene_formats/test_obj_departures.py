"""Small departures from OBJ and MTL that viewers allow: read with one counted note, or refused strictly."""

from __future__ import annotations

import codecs

import numpy as np
import pytest
from obj_files import QUAD, write
from test_obj_files import only_primitive

from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene
from taubench_gl.scene.notes import REPAIRS

FACE = "f 1 2 3\n"
LIBRARY = "mtllib a.mtl\n" + QUAD + "usemtl a\n" + FACE

CASES: dict[str, tuple[str | bytes, str, str, int]] = {
    # name: (OBJ, MTL, kind of the note, its count)
    "unknown-statement": (QUAD + "mesh 1\nmesh 2\n" + FACE, "", "unknown-statement", 2),
    "curves": (QUAD + "cstype bezier\ndeg 3\ncurv 0 1 1 2 3 4\nend\n" + FACE, "", "curve", 4),
    "five-numbers": (QUAD.replace("v 0 0 0\n", "v 0 0 0 1 1\n", 1) + FACE, "", "statement-numbers", 1),
    "nan-normals": (QUAD + "vn 0 0 1\nvn nan 0 0\nf 1//1 2//2 3//1\n", "", "statement-nonfinite", 1),
    "c-nan": (QUAD + "vt -nan(ind) 0\nf 1/1 2/1 3/1\n", "", "statement-nonfinite", 1),
    "two-corners": (QUAD + "f 1 2\n" + FACE, "", "face-corners", 1),
    "missing-vertex": (QUAD + "f 1 2 9\nf 1 3 8\n" + FACE, "", "face-index", 2),
    "missing-normal": (QUAD + "f 1//7 2//7 3//7\n", "", "face-index", 1),
    "unnamed-library": ("mtllib\n" + QUAD + FACE, "", "library-name", 1),
    "bad-color": (LIBRARY, "newmtl a\nKd 1 x 1\nKs 1 2\n", "mtl-statement", 2),
    "early-statement": (LIBRARY, "Kd 1 1 1\nnewmtl a\n", "mtl-statement", 1),
    "unnamed-material": (LIBRARY, "newmtl\nKd 1 0 0\nnewmtl a\n", "mtl-statement", 1),
    "damaged-texture": (LIBRARY, "newmtl a\nmap_Kd bad.png\n", "texture-unreadable", 1),
    "utf-16": ((QUAD + FACE).encode("utf-16"), "", "text-encoding", 1),
    "utf-16-library": (LIBRARY, codecs.BOM_UTF16_BE + "newmtl a\nKd 1 0 0\n".encode("utf-16-be"), "text-encoding", 1),
    "byte-order-mark": (b"\xef\xbb\xbf" + (QUAD + FACE).encode(), "", "byte-order-mark", 1),
}


@pytest.mark.parametrize("name", CASES)
def test_departure(tmp_path, name):
    text, library, kind, count = CASES[name]
    write(tmp_path, library, "a.mtl")
    write(tmp_path, b"\x89PNG but not quite", "bad.png")
    path = write(tmp_path, text)
    scene = load_scene(path)
    assert [(n.kind, n.count) for n in scene.notes if n.kind in REPAIRS] == [(kind, count)]
    assert scene.notes[0].where
    assert len(only_primitive(scene).triangles) == 1
    with pytest.raises(SceneError):
        load_scene(path, strict=True)


def test_repaired_values(tmp_path):
    """A face without its vertex is not drawn; without its normal it is flat."""
    scene = load_scene(write(tmp_path, QUAD + "vn 0 1 0\nf 1//1 2//1 3//9\nf 1//1 2//1 99//1\n"))
    primitive = only_primitive(scene)
    assert len(primitive.triangles) == 1 and primitive.normals is None
    write(tmp_path, "newmtl a\nKd 1 x 1\nd 0.5\n", "a.mtl")
    (material,) = load_scene(write(tmp_path, LIBRARY)).materials
    np.testing.assert_allclose(material.base_color, (0.8, 0.8, 0.8, 0.5))


def test_a_file_that_is_no_obj_is_refused(tmp_path):
    for text in ("hello world\n", b"v 0 0 nan\n", b"v 0 0 \0 0\n"):
        with pytest.raises(SceneError):
            load_scene(write(tmp_path, text))


def test_damaged_texture_of_aff(tmp_path):
    write(tmp_path, b"\x89PNG but not quite", "bad.png")
    text = "f 1 1 1 1 0 0 0 1\ntt bad.png\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n"
    path = write(tmp_path, text, "scene.nff")
    scene = load_scene(path)
    assert [(n.kind, n.count) for n in scene.notes if n.kind] == [("texture-unreadable", 1)]
    assert scene.materials[-1].base_color_texture is None
    with pytest.raises(SceneError):
        load_scene(path, strict=True)
