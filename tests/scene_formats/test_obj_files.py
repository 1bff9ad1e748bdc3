"""Single OBJ files and their MTL."""

from __future__ import annotations

import numpy as np
import pytest
from bad_files import refused
from obj_files import QUAD, write
from PIL import Image as Picture

from taubench_gl.scene import load_scene


def only(scene):
    (mesh,) = scene.meshes
    (primitive,) = mesh.primitives
    return primitive


def placed(primitive) -> np.ndarray:
    """Corner positions (T, 3, 3)."""
    return primitive.positions[primitive.triangles]


def test_polygons_are_fans_and_indices_may_count_back(tmp_path):
    scene = load_scene(write(tmp_path, QUAD + "f 1 2 3 4\nv 5 5 5\nf -5 -4 -1\n"))
    expected = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [5, 5, 5]]]
    np.testing.assert_array_equal(placed(only(scene)), expected)
    assert only(scene).normals is None and scene.duration == 0.0 and not scene.channels


@pytest.mark.parametrize("corner", ["{}", "{}/{}", "{}//{}", "{}/{}/{}"])
def test_every_kind_of_corner(tmp_path, corner):
    text = QUAD + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n" + "vn 0 0 2\nvn 0 0 1\nvn 0 3 0\nvn 0 0 1\n"
    text += "f " + " ".join(corner.format(k, k, k) for k in (1, 2, 3, 4))
    primitive = only(load_scene(write(tmp_path, text)))
    assert (primitive.texcoords[0] is not None) == ("{}/{}" in corner)
    assert (primitive.normals is not None) == (corner.count("{}") == 3 or "//" in corner)
    if primitive.normals is not None:
        np.testing.assert_array_equal(primitive.normals[2], [0, 1, 0])
    if primitive.texcoords[0] is not None:
        np.testing.assert_array_equal(primitive.texcoords[0], [[0, 1], [1, 1], [1, 0], [0, 0]])


def test_mixed_corners_runs_of_lines_and_odd_spacing(tmp_path):
    text = (
        b"# made by hand\r\n\r\nmtllib\tnone.mtl\r\n  v 0 0 0 # first\r\nv\t1e0 0.0 -0\r\nvt .5 .5\r\nv 1 1 0 1\r\n"
        b"v 0 1 0 .1 .2 .3\r\ns off\r\nf 1/1 2/1 \\\r\n 3/1\r\nvn 0 0 1\r\nf 1//1 3//1 4//1\r\nl 1 2\r\np 1"
    )
    scene = load_scene(write(tmp_path, text))
    assert len(only(scene).triangles) == 2 and only(scene).normals is None
    notes = " ".join(str(n) for n in scene.notes)
    assert "material library 'none.mtl' does not exist" in notes and "lines are not drawn" in notes


def test_equal_corners_are_one_vertex_and_others_are_not(tmp_path):
    text = QUAD + "vn 0 0 1\nvn 0 1 0\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\nf 1//2 3//1 4//1\n"
    assert len(only(load_scene(write(tmp_path, text))).positions) == 5


def test_objects_else_groups(tmp_path):
    faces = "o one\ng a\nf 1 2 3\ng b\nf 1 3 4\no two\nf 1 2 4\no one\nf 2 3 4\n"
    scene = load_scene(write(tmp_path, QUAD + faces))
    assert scene.nodes.names == ("scene", "one", "two")
    assert [len(m.primitives[0].triangles) for m in scene.meshes] == [3, 1]
    scene = load_scene(write(tmp_path, QUAD + faces.replace("o ", "s ")))
    assert scene.nodes.names == ("scene", "a", "b")


def test_materials(tmp_path):
    (tmp_path / "maps").mkdir()
    Picture.new("RGB", (3, 2), (0, 128, 255)).save(tmp_path / "maps" / "blue sky.png")
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
    assert any("material no is in no library" in str(n) for n in scene.notes)


@pytest.mark.parametrize("name", ["../up.png", "/etc/up.png", "C:\\up.png", "none.png", "\\\\host\\up.png"])
def test_pictures_outside_the_folder_are_never_opened(tmp_path, name):
    folder = tmp_path / "in"
    folder.mkdir()
    write(tmp_path, b"not a picture", "up.png")
    write(folder, f"newmtl a\nmap_Kd {name}", "a.mtl")
    scene = load_scene(write(folder, "mtllib a.mtl\nusemtl a\n" + QUAD + "f 1 2 3"))
    assert any("drawn without it [a.mtl:2]" in str(n) for n in scene.notes) and not scene.images


BAD = {
    QUAD + "f 1 2 5": (5, "index 5, the file has 4 v"),
    QUAD + "f 1 2 -5": (5, "index -5"),
    QUAD + "f 1 2 0": (5, "index 0"),
    QUAD + "f 1 2": (5, "a face with 2 corners"),
    QUAD + "f 1 2 x": (5, "'x' where a number"),
    QUAD + "f 1 2 1.5": (5, "'1.5' where a number"),
    QUAD + "f 1 2 3/": (5, "'3/' is not a corner"),
    QUAD + "f 1 2 3/1/1/1": (5, "is not a corner"),
    QUAD + "f 1/1 2/1 3/1": (5, "index 1, the file has 0 vt"),
    QUAD + "f 1 2 99999999999999999999": (5, ""),
    "v 0 0\n": (1, "v with 2 numbers"),
    "v 0 0 0\n\n\\\nv 1 2 three": (4, "'three' where a number"),
    "v 0 0 nan": (1, "not usable"),
    "v 0 0 1e200": (1, "not usable"),
    "vn 0 1": (1, "vn with 2 numbers"),
    "#\n<html>": (2, "'<html>' is not a statement of OBJ"),
    "\r\n\r\ncurv 0 1 1 2": (3, "curves and surfaces are not supported"),
    "mtllib": (1, "without a file name"),
}


@pytest.mark.parametrize("text", BAD)
def test_bad_files_give_one_line_with_file_and_line(tmp_path, text):
    refused(write(tmp_path, text), *BAD[text])


BAD_MTL = {
    "Kd 1 1 1": (1, "comes before the first newmtl"),
    "newmtl a\nKd 1 1": (2, "2 numbers, expected 1 or 3"),
    "newmtl a\nd nan": (2, "not usable"),
    "newmtl a\nNs x": (2, "'x' where numbers should be"),
    "newmtl": (1, "without a name"),
}


@pytest.mark.parametrize("text", BAD_MTL)
def test_bad_materials(tmp_path, text):
    write(tmp_path, text, "a.mtl")
    refused(write(tmp_path, "mtllib a.mtl\n" + QUAD + "f 1 2 3"), *BAD_MTL[text], named="a.mtl")


def test_a_real_level(data):
    scene = load_scene(data / "arena_maps" / "fdm6" / "fdm6.obj")
    assert sum(len(p.triangles) for m in scene.meshes for p in m.primitives) == 9779
    for mesh in scene.meshes:
        for p in mesh.primitives:
            assert np.all(np.isfinite(p.positions)) and p.triangles.max() < len(p.positions)
