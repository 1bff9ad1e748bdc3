"""Single OBJ files and their MTL."""

from __future__ import annotations

import numpy as np
import pytest
from bad_files import notes_about, refused
from obj_files import QUAD, write
from PIL import Image

from taubench_gl.scene import load_scene


def only_primitive(scene):
    (mesh,) = scene.meshes
    (primitive,) = mesh.primitives
    return primitive


def placed(primitive) -> np.ndarray:
    """Corner positions (T, 3, 3)."""
    return primitive.positions[primitive.triangles]


def test_polygon_fans_and_negative_indices(tmp_path):
    scene = load_scene(write(tmp_path, QUAD + "f 1 2 3 4\nv 5 5 5\nf -5 -4 -1\n"))
    expected = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [5, 5, 5]]]
    np.testing.assert_array_equal(placed(only_primitive(scene)), expected)
    assert only_primitive(scene).normals is None and scene.duration == 0.0 and not scene.channels


@pytest.mark.parametrize("corner", ["{}", "{}/{}", "{}//{}", "{}/{}/{}"])
def test_corner_forms(tmp_path, corner):
    text = QUAD + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n" + "vn 0 0 2\nvn 0 0 1\nvn 0 3 0\nvn 0 0 1\n"
    text += "f " + " ".join(corner.format(k, k, k) for k in (1, 2, 3, 4))
    primitive = only_primitive(load_scene(write(tmp_path, text)))
    assert (primitive.texcoords[0] is not None) == ("{}/{}" in corner)
    assert (primitive.normals is not None) == (corner.count("{}") == 3 or "//" in corner)
    if primitive.normals is not None:
        np.testing.assert_array_equal(primitive.normals[2], [0, 1, 0])
    if primitive.texcoords[0] is not None:
        np.testing.assert_array_equal(primitive.texcoords[0], [[0, 1], [1, 1], [1, 0], [0, 0]])


def test_mixed_corners_continued_lines_and_spacing(tmp_path):
    text = (
        b"# written by hand\r\n\r\nmtllib\tnone.mtl\r\n  v 0 0 0 # first\r\nv\t1e0 0.0 -0\r\nvt .5 .5\r\nv 1 1 0 1\r\n"
        b"v 0 1 0 .1 .2 .3\r\ns off\r\nf 1/1 2/1 \\\r\n 3/1\r\nvn 0 0 1\r\nf 1//1 3//1 4//1\r\nl 1 2\r\np 1"
    )
    scene = load_scene(write(tmp_path, text))
    assert len(only_primitive(scene).triangles) == 2 and only_primitive(scene).normals is None
    assert notes_about(scene, "'none.mtl'") == ["scene.obj:3"]
    assert [(n.kind, n.count, n.where) for n in scene.notes][1:] == [("undrawn", 2, "scene.obj")]


def test_equal_corners_share_a_vertex(tmp_path):
    text = QUAD + "vn 0 0 1\nvn 0 1 0\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\nf 1//2 3//1 4//1\n"
    assert len(only_primitive(load_scene(write(tmp_path, text))).positions) == 5


def test_groups_are_objects_where_there_are_none(tmp_path):
    faces = "o one\ng a\nf 1 2 3\ng b\nf 1 3 4\no two\nf 1 2 4\no one\nf 2 3 4\n"
    scene = load_scene(write(tmp_path, QUAD + faces))
    assert scene.nodes.names == ("scene", "one", "two")
    assert [len(m.primitives[0].triangles) for m in scene.meshes] == [3, 1]
    scene = load_scene(write(tmp_path, QUAD + faces.replace("o ", "s ")))
    assert scene.nodes.names == ("scene", "a", "b")


def test_materials(tmp_path):
    (tmp_path / "maps").mkdir()
    Image.new("RGB", (3, 2), (0, 128, 255)).save(tmp_path / "maps" / "blue sky.png")
    write(
        tmp_path,
        "newmtl plain\nKd .1 .2 .3\nKa 1 1 1\nillum 2\nKs 0 0 0\n"
        "newmtl shiny one\nKd 0 0 0\nKs .5 .5 .5\nNs 98\nd .25\nKe 1 2 3\nmap_Kd -s 1 1 1 -clamp on maps\\blue sky.png"
        "\nnewmtl clear\nTr .4\n",
        "a.mtl",
    )
    text = (
        QUAD + "f 1 2 3\nusemtl plain\nf 1 2 3\nusemtl shiny one\nf 1 2 3\nusemtl clear\nf 1 2 3\nusemtl no\nf 1 2 3\n"
    )
    scene = load_scene(write(tmp_path, "mtllib a.mtl\n" + text))
    assert [p.material for p in scene.meshes[0].primitives] == [-1, 0, 1, 2, -1]
    plain, shiny, clear = scene.materials
    assert plain.base_color == (0.1, 0.2, 0.3, 1.0) and plain.specular == 0.0 and plain.alpha_mode == "OPAQUE"
    assert plain.metallic == 0.0 and plain.double_sided
    assert shiny.name == "shiny one" and shiny.roughness == pytest.approx((2 / 100) ** 0.25)
    assert shiny.base_color == (1, 1, 1, 0.25) and shiny.alpha_mode == "BLEND" and shiny.emissive == (1, 2, 3)
    assert scene.images[shiny.base_color_texture.image].size == (3, 2)
    assert clear.base_color[3] == pytest.approx(0.6)
    assert [(n.kind, n.count) for n in scene.notes] == [("material-unknown", 1)]


@pytest.mark.parametrize("name", ["../up.png", "/etc/up.png", "C:\\up.png", "none.png", "\\\\host\\up.png"])
def test_images_outside_the_folder_are_never_opened(tmp_path, name):
    folder = tmp_path / "in"
    folder.mkdir()
    write(tmp_path, b"not an image", "up.png")
    write(folder, f"newmtl a\nmap_Kd {name}", "a.mtl")
    scene = load_scene(write(folder, "mtllib a.mtl\nusemtl a\n" + QUAD + "f 1 2 3"))
    assert notes_about(scene, repr(name)[:8]) == ["a.mtl:2"] and not scene.images


BAD = {
    QUAD + "f 1 2 5": (5, 5),
    QUAD + "f 1 2 -5": (5, -5),
    QUAD + "f 1 2 0": (5, 0),
    QUAD + "f 1 2": (5, 2),
    QUAD + "f 1 2 x": (5, "'x'"),
    QUAD + "f 1 2 1.5": (5, "'1.5'"),
    QUAD + "f 1 2 3/": (5, "'3/'"),
    QUAD + "f 1 2 3/1/1/1": (5, "3/1/1/1"),
    QUAD + "f 1/1 2/1 3/1": (5, "vt"),
    QUAD + "f 1 2 99999999999999999999": (5, ""),
    "v 0 0\n": (1, 2),
    "v 0 0 0\n\n\\\nv 1 2 three": (4, "'three'"),
    "v 0 0 nan": (1, ""),
    "v 0 0 1e200": (1, ""),
    "vn 0 1": (1, "vn"),
    "#\n<html>": (2, "'<html>'"),
    "\r\n\r\ncurv 0 1 1 2": (3, ""),
    "mtllib": (1, "mtllib"),
}


@pytest.mark.parametrize("text", BAD)
def test_errors_carry_file_and_line(tmp_path, text):
    refused(write(tmp_path, text), *BAD[text])


BAD_MTL = {
    "Kd 1 1 1": (1, "'Kd'"),
    "newmtl a\nKd 1 1": (2, 2),
    "newmtl a\nd nan": (2, ""),
    "newmtl a\nNs x": (2, "'x'"),
    "newmtl": (1, "newmtl"),
}


@pytest.mark.parametrize("text", BAD_MTL)
def test_errors_of_material_libraries(tmp_path, text):
    write(tmp_path, text, "a.mtl")
    refused(write(tmp_path, "mtllib a.mtl\n" + QUAD + "f 1 2 3"), *BAD_MTL[text], file="a.mtl")


def test_arena_map(data):
    scene = load_scene(data / "arena_maps" / "fdm6" / "fdm6.obj")
    assert sum(len(p.triangles) for m in scene.meshes for p in m.primitives) == 9779
    for mesh in scene.meshes:
        for p in mesh.primitives:
            assert np.all(np.isfinite(p.positions)) and p.triangles.max() < len(p.positions)
