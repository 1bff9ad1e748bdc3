"""Maps and physical statements of MTL, colors of vertices, names with ``#``, and numbers of files below zero."""

from __future__ import annotations

import numpy as np
import pytest
from obj_files import QUAD, write
from PIL import Image
from test_obj_files import only_primitive

from taubench_gl.errors import PathTracedError, SceneError
from taubench_gl.pathtraced.sequence import find_frames as find_exr_frames
from taubench_gl.scene import load_scene
from taubench_gl.scene.obj.reader import find_frames

PLATE = QUAD + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3 4/4\n"


def load(folder, library: str, text: str = PLATE, **options):
    write(folder, library, "a.mtl")
    return load_scene(write(folder, "mtllib a.mtl\n" + text), **options)


def image(folder, name: str, pixels) -> None:
    Image.fromarray(np.asarray(pixels)).save(folder / name)


def texels(scene, texture, uv: np.ndarray) -> np.ndarray:
    """Nearest RGBA texels at coordinates (n, 2) of the primitive, as glTF counts them."""
    pixels = scene.images[texture.image].decode()
    moved = np.column_stack([uv, np.ones(len(uv))]) @ texture.uv_transform.T
    size = np.array(pixels.shape[1::-1])
    x, y = np.floor(moved * size).astype(int).T % size[:, None]
    return pixels[y, x]


def noted(scene, kind: str) -> str:
    return " ".join(note.message for note in scene.notes if note.kind == kind)


def test_scale_of_a_map_of_a_file(data):
    scene = load_scene(data / "reports4" / "objects" / "mtl_scale.obj")
    uv = only_primitive(scene).texcoords[0]
    low, high = uv.min(axis=0), uv.max(axis=0)
    line = np.column_stack([np.linspace(low[0], high[0], 3201)[:-1] + 1e-4, np.full(3200, 0.5 * (low + high)[1])])
    red = texels(scene, scene.materials[0].base_color_texture, line)[:, 0]
    assert np.count_nonzero(np.diff(red.astype(int))) == 31


def test_scale_and_offset_of_maps(tmp_path):
    """At (u, v) of the file, v upwards, the texel at (2 u + 0.25, 3 v + 0.5)."""
    image(tmp_path, "t.png", np.arange(64, dtype=np.uint8).reshape(8, 8))
    scene = load(tmp_path, "newmtl m\nmap_Kd -s 2 3 1 -o .25 .5 -mm 0 .5 t.png\nmap_Ke -clamp on t.png\nKe 1 1 1\n")
    (material,) = scene.materials
    rng = np.random.default_rng(3)
    uv = rng.random((50, 2))
    x, y = np.floor((uv * [2, 3] + [0.25, 0.5]) * 8).astype(int).T % 8
    flipped = np.column_stack([uv[:, 0], 1.0 - uv[:, 1]])
    assert texels(scene, material.base_color_texture, flipped)[:, 0].tolist() == (8 * (7 - y) + x).tolist()
    assert material.emissive_texture.sampler.wrap_s == 33071 and "-mm of map_Kd" in noted(scene, "mtl-unsupported")


def test_physical_statements(tmp_path):
    """Roughness in green and metalness in blue, as glTF has them; the normal map with its strength."""
    image(tmp_path, "rough.png", np.full((2, 4), 64, np.uint8))
    image(tmp_path, "metal.png", np.full((4, 2), 200, np.uint8))
    image(tmp_path, "n.png", np.full((2, 2, 3), (128, 128, 255), np.uint8))
    library = "newmtl m\nPr .25\nPm .75\nnewmtl both\nmap_Pr -s 2 2 rough.png\nmap_Pm metal.png\nnorm -bm .5 n.png\n"
    library += "newmtl black\nPr .5\nKs 0 0 0\nnewmtl one\nPm .5\nmap_Pr rough.png\n"
    numbers, both, black, one = load(tmp_path, library).materials
    assert (numbers.roughness, numbers.metallic, numbers.specular) == (0.25, 0.75, 1.0)
    assert (both.roughness, both.metallic, both.normal_scale) == (1.0, 1.0, 0.5) and both.normal_texture is not None
    scene = load(tmp_path, library)
    packed = scene.images[both.metallic_roughness_texture.image].decode()
    assert packed.shape == (2, 4, 4) and np.all(packed == (255, 64, 200, 255))
    assert both.metallic_roughness_texture.uv_transform[0, 0] == 2.0
    assert (black.specular, black.roughness) == (0.0, 0.5)
    packed = scene.images[one.metallic_roughness_texture.image].decode()
    assert one.metallic == 0.5 and np.all(packed[..., 1:3] == (64, 255))


def test_physical_statements_of_a_file(data):
    scene = load_scene(data / "reports4" / "objects" / "mtl_pbr.obj")
    (material,) = scene.materials
    assert material.metallic == 1.0 and material.roughness == 1.0 and material.normal_texture is not None
    checker = scene.images[material.metallic_roughness_texture.image].decode()
    assert set(np.unique(checker[..., 1])) == {0, 255} and np.all(checker[..., 2] == 255)
    for name in ("map_Bump", "map_Ks", "Tf"):
        assert name in noted(scene, "mtl-unsupported")
    assert all(name not in noted(scene, "mtl-unsupported") for name in ("norm", "illum", "Ni"))


def test_colors_of_vertices(data, tmp_path):
    primitive = only_primitive(load_scene(data / "reports4" / "sweep" / "vertex_colors.obj"))
    at = {tuple(p): tuple(c) for p, c in zip(primitive.positions.tolist(), primitive.colors.tolist(), strict=True)}
    assert at == {(0, 0, 0): (1, 0, 0, 1), (1, 0, 0): (0, 1, 0, 1), (0, 1, 0): (0, 0, 1, 1)}
    assert only_primitive(load_scene(data / "reports4" / "objects" / "vcolor.obj")).colors is not None
    text = "v 0 0 0 .5 .5 .5\nv 1 0 0\nv 0 1 0 2 0 0\nf 1 2 3\n"  # sRGB 0.5 is 0.2140 of linear light
    scene = load_scene(write(tmp_path, text))
    np.testing.assert_allclose(only_primitive(scene).colors[:, 0], [0.21404114, 1.0, 1.0], rtol=1e-6)
    assert noted(scene, "color-range")


def test_letters_of_statements(tmp_path):
    library = "NEWMTL m\nkd .1 .2 .3\nPR .5\nbump b.png\n"
    scene = load(tmp_path, library)
    assert scene.materials[0].base_color[:3] == (0.1, 0.2, 0.3) and scene.materials[0].roughness == 0.5
    (note,) = (note for note in scene.notes if note.kind == "mtl-case")
    assert note.count == 3
    with pytest.raises(SceneError) as caught:
        load(tmp_path, library, strict=True)
    assert caught.value.where == "a.mtl:1"


def test_names_with_a_number_sign(tmp_path):
    """A ``#`` begins a comment at the start of a word, and anywhere behind numbers."""
    image(tmp_path, "a#1.png", np.zeros((2, 2, 3), np.uint8))
    library = "newmtl a#1 # comment\nKd .5 .5 .5# comment\nmap_Kd a#1.png\n# all\nnewmtl a#2\nKd 1 0 0\n"
    text = "o p#1\n" + QUAD + "#\nusemtl a#1 # first\nf 1 2 3# comment\no p#2\nusemtl a#2\nf 1 3 4 #\n"
    scene = load(tmp_path, library, text)
    assert [m.name for m in scene.materials] == ["a#1", "a#2"] and not scene.notes
    assert scene.nodes.names[1:] == ("p#1", "p#2") and scene.materials[0].base_color_texture is not None
    assert [mesh.primitives[0].material for mesh in scene.meshes] == [0, 1]


def test_floating_point_images(tmp_path):
    """Linear gray: colors are encoded as sRGB, data is not."""
    for name in ("c.tiff", "d.tiff"):
        Image.fromarray(np.array([[0.25, 1.5], [0.0, np.nan]], np.float32)).save(tmp_path / name)
    scene = load(tmp_path, "newmtl m\nmap_Kd c.tiff\nmap_Pr d.tiff\n")
    (material,) = scene.materials
    color = scene.images[material.base_color_texture.image].decode()
    assert color[..., 0].tolist() == [[137, 255], [0, 0]]  # 255 (1.055 0.25^(1/2.4) - 0.055)
    assert scene.images[material.metallic_roughness_texture.image].decode()[..., 1].tolist() == [[64, 255], [0, 0]]


def test_corners_that_end_in_a_slash(data, tmp_path):
    scene = load_scene(data / "reports4" / "sweep" / "empty_normal.obj")
    primitive = only_primitive(scene)
    assert len(primitive.triangles) == 1 and primitive.texcoords[0] is not None and primitive.normals is None
    scene = load_scene(write(tmp_path, QUAD + "f 1// 2// 3//\nf 1 3// 4\n"))
    assert len(only_primitive(scene).triangles) == 2 and only_primitive(scene).texcoords[0] is None
    assert [n.count for n in scene.notes if n.kind == "corner-slash"] == [4]


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["f_-0002", "f_-0001", "f_0000", "f_0001"], [-2, -1, 0, 1]),
        (["-10", "-2", "3"], [-10, -2, 3]),
        (["shot-0001", "shot-0002"], [1, 2]),  # here it separates
        (["f_9", "f_10"], [9, 10]),
    ],
)
def test_numbers_of_files(tmp_path, names, numbers):
    for name in reversed(names):
        write(tmp_path, QUAD + "f 1 2 3\n", name + ".obj")
        (tmp_path / f"{name}.exr").touch()
    assert list(find_exr_frames(tmp_path)) == numbers
    assert [path.stem for path in find_frames(str(tmp_path))[0]] == names


def test_two_files_of_one_number_are_one_line(tmp_path):
    for name in ("f_1", "f_0001"):
        write(tmp_path, QUAD + "f 1 2 3\n", name + ".obj")
        (tmp_path / f"{name}.exr").touch()
    for find, error in ((find_exr_frames, PathTracedError), (find_frames, SceneError)):
        with pytest.raises(error) as caught:
            find(str(tmp_path))
        assert "f_0001" in caught.value.what and "f_1" in caught.value.what and caught.value.hint
