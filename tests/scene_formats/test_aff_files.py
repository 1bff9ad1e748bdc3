"""Complete AFF files with poses known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from aff_files import TRIANGLE, VIEW, keys, write
from bad_files import notes_about, refused
from PIL import Image

from taubench_gl.animation import choose_camera, pose_normals, pose_vertices, sample
from taubench_gl.effects.census import census
from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene
from taubench_gl.scene.aff import parser

REST = "0 0 0"


def node(scene, name: str) -> int:
    return scene.nodes.names.index(name)


def world(scene, name: str, t: float) -> np.ndarray:
    return sample(scene, t).world[node(scene, name)]


def corners(scene, at: int = 0, t: float = 0.0) -> np.ndarray:
    """World positions of the first primitive of mesh node number ``at``."""
    n = int(scene.mesh_nodes[at])
    return pose_vertices(scene, sample(scene, t), n, scene.meshes[scene.nodes.mesh[n]].primitives[0])


def test_static_transforms_scale_rotate_and_translate(tmp_path):
    scene = load_scene(write(tmp_path, "xs 2 3 4  0 0 5 90  10 20 30 { xs 1 1 1 1 0 0 0 1 0 0 {" + TRIANGLE + "} }"))
    # (1, 0, 0) + (1, 0, 0) scaled to (4, 0, 0), turned to (0, 4, 0), moved
    np.testing.assert_allclose(corners(scene), [[10, 22, 30], [10, 24, 30], [7, 22, 30]], atol=1e-12)


def test_animated_transform_and_visibility_of_one_node(tmp_path):
    move = keys(np.array([[t, t, 0, 0, 0, 0, 0] for t in (-1, 0, 2, 3)]))
    turn = keys(np.array([[t, 0, 0, 7, 90 * t, 0, 0, 0] for t in (-1, 0, 1, 2, 3)]))
    grow = keys(np.array([[t, 1 + t, 1, 1, 0, 0, 0] for t in (-1, 0, 2, 3)]))
    text = f"a 0 2 48\nx car {{ {TRIANGLE} }}\nk car {{ transl {move} rot {turn} scale {grow} visibility 1 1.5 0 }}"
    scene = load_scene(write(tmp_path, text))
    assert scene.duration == 2.0 and notes_about(scene, "--fps 24")
    for t in (0.0, 0.4, 1.0, 1.9):
        c, s = np.cos(np.pi / 2 * t), np.sin(np.pi / 2 * t)
        expected = [[t, 0, 0], [t + (1 + t) * c, (1 + t) * s, 0], [t - s, c, 0]]
        np.testing.assert_allclose(corners(scene, t=t), expected, atol=1e-6)
        assert sample(scene, t).visible[node(scene, "car")] == (t < 1.5)
    assert census(scene, np.arange(0, 2, 0.25))["dynamic_rigid_objects"] == 1


def test_negative_start_time_and_keys_before_their_target(tmp_path):
    move = keys(np.array([[t, t, 0, 0, 0, 0, 0] for t in (-3, -2, 2, 3)]))
    scene = load_scene(write(tmp_path, f"k car {{ transl {move} }} a -1 2 90 x car {{ {TRIANGLE} }} x car {{ }}"))
    assert scene.duration == 3.0
    np.testing.assert_allclose(world(scene, "car", 0.5)[:3, 3], [-0.5, 0, 0], atol=1e-12)
    assert len(scene.channels) == 3, "both blocks named car, and the duration"


def test_camera(tmp_path):
    move = keys(np.array([[t, 0, 0, 5 - t, 0, 0, 0] for t in (-1, 0, 2, 3)]))
    turn = keys(np.array([[t, 0, 1, 0, 10 * t, 0, 0, 0] for t in (-1, 0, 2, 3)]))
    scene = load_scene(write(tmp_path, VIEW + TRIANGLE + f"k camera {{ transl {move} rot {turn} }}"))
    track = choose_camera(scene)
    for t in (0.0, 1.0, 2.0):
        view = track.view_at(sample(scene, t))
        np.testing.assert_allclose(view.position, [0, 0, 5 - t], atol=1e-12)
        a = np.radians(10 * t)
        np.testing.assert_allclose(view.world_from_view[:, 2], [np.sin(a), 0, np.cos(a)], atol=1e-7)
    lens = scene.cameras[0]
    assert lens.yfov == pytest.approx(np.radians(40)) and lens.aspect == 80 / 60 and lens.znear == 0.01


def test_still_camera(tmp_path):
    text = VIEW.replace("from 0 0 10", "from 3 4 0").replace("at 0 0 0", "at 3 0 0").replace("up 0 1 0", "up 0 0 9")
    view = choose_camera(scene := load_scene(write(tmp_path, text + TRIANGLE))).view_at(sample(scene, 0.0))
    np.testing.assert_allclose(view.world_from_view, np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0]]), atol=1e-12)


def test_lights(tmp_path):
    move = keys(np.array([[t, t, 0, 0, 0, 0, 0] for t in (-1, 0, 2, 3)]))
    text = f"l 0 2 0\nl 1 2 3 .5 .25 0\nla lamp 0 1 0 1 0 0\np 3 -3 0 0 3 0 0 3 8 0\nk lamp {{ transl {move} }}"
    scene = load_scene(write(tmp_path, text))
    assert [light.color for light in scene.lights] == [(1, 1, 1), (0.5, 0.25, 0), (1, 0, 0)]
    for light in scene.lights:
        assert light.constant and light.intensity == pytest.approx(np.pi), "radiance of a facing surface = its color"
    np.testing.assert_allclose(world(scene, "light 2", 1.5)[:3, 3], [1.5, 1, 0], atol=1e-12)
    found = census(scene, [0.0, 1.0])
    assert (found["static_point_lights"], found["dynamic_point_lights"]) == (2, 1)


@pytest.mark.parametrize("word", ["m", "mesh"])
def test_order_of_index_triples_in_meshes(tmp_path, word):
    Image.new("RGB", (4, 2), (255, 0, 0)).save(tmp_path / "red.ppm")
    text = (
        f"{word} vertices 3 0 0 0 1 0 0 0 1 0 normals 2 0 0 -4 0 9 0 texturecoords 3 red.ppm 0 0 1 0 0.25 0.75 "
        "triangles 2  0 1 2  0 0 1  2 1 0   0 1 2  0 0 1  2 1 0"
    )
    scene = load_scene(write(tmp_path, text))
    (primitive,) = scene.meshes[0].primitives
    assert len(primitive.positions) == 3 and len(primitive.triangles) == 2, "equal corners share a vertex"
    order = primitive.triangles[0]
    np.testing.assert_array_equal(primitive.positions[order], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(primitive.normals[order], [[0, 0, -1], [0, 0, -1], [0, 1, 0]])
    np.testing.assert_array_equal(primitive.texcoords[0][order], [[0.25, 0.75], [1, 0], [0, 0]])
    texture = scene.materials[primitive.material].base_color_texture
    assert scene.images[texture.image].size == (4, 2)
    assert scene.images[texture.image].decode()[0, 0].tolist() == [255, 0, 0, 255]


def test_polygons_patches_and_textured_triangles(tmp_path):
    Image.new("RGB", (1, 1)).save(tmp_path / "t.png")
    text = (
        "p 4 0 0 0 1 0 0 1 1 0 0 1 0\npp 3 0 0 0 0 0 9 1 0 0 0 0 1 0 1 0 0 0 1\n"
        "tt t.png 0 0 0 0 1  1 0 0 1 1  0 1 0 0 0\nttp t.png 0 0 0 0 0 2 0 1  1 0 0 0 0 1 1 1  0 1 0 0 0 1 0 0\n"
        "pp 3 0 0 0 0 0 0 1 0 0 0 0 1 0 1 0 0 0 1"
    )
    primitives = load_scene(write(tmp_path, text)).meshes[0].primitives
    assert sum(len(p.triangles) for p in primitives) == 2 + 1 + 1 + 1 + 1
    flat, patch, textured, both = primitives
    assert flat.normals is None and len(flat.triangles) == 3, "a normal of length 0 makes its patch flat"
    np.testing.assert_array_equal(patch.normals, np.tile([0, 0, 1], (3, 1)))
    np.testing.assert_array_equal(textured.texcoords[0], [[0, 1], [1, 1], [0, 0]])
    np.testing.assert_array_equal(both.texcoords[0], [[0, 1], [1, 1], [0, 0]])


def test_round_surfaces(tmp_path):
    (primitive,) = load_scene(write(tmp_path, "s 1 2 3 -2")).meshes[0].primitives
    out = primitive.positions - np.array([1, 2, 3], np.float32)
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 2, rtol=1e-6)
    np.testing.assert_allclose(primitive.normals, out / 2, atol=1e-6)
    faces_outwards(primitive, [1, 2, 3])
    assert len(primitive.triangles) == 2 * 32 * 15

    (primitive,) = load_scene(write(tmp_path, "c 0 0 0 2  0 0 4 1")).meshes[0].primitives
    radius = np.linalg.norm(primitive.positions[:, :2], axis=1)
    np.testing.assert_allclose(radius, 2 - primitive.positions[:, 2] / 4, rtol=1e-6)
    slope = primitive.normals[:, 2] / np.linalg.norm(primitive.normals[:, :2], axis=1)
    np.testing.assert_allclose(slope, 0.25, rtol=1e-5)
    faces_outwards(primitive, [0, 0, 2])
    assert len(primitive.triangles) == 64, "no caps"
    (primitive,) = load_scene(write(tmp_path, "c 0 0 0 2  0 0 4 0")).meshes[0].primitives
    assert len(primitive.triangles) == 32, "a pointed cone has no triangle of area 0"
    faces_outwards(primitive, [0, 0, 1])


def faces_outwards(primitive, center) -> None:
    a, b, c = primitive.positions[primitive.triangles].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    assert np.all(np.sum(normal * (a + b + c - 3 * np.array(center, np.float32)), axis=1) > 0)


def test_animated_triangles_are_interpolated_linearly(tmp_path):
    frame = "{t} {x} 0 0 0 0 2  {y} 0 0 0 0 1  {x} 1 0 0 1 0 "
    text = "tpa 3 " + "".join(frame.format(t=t, x=t * t, y=t * t + 1) for t in (0, 1, 2))
    scene = load_scene(write(tmp_path, f"a 0 1.5 30 {text} {text} tpa 1 0 0 0 0 0 0 1 1 0 0 0 0 1 0 1 0 0 0 1"))
    moving, still = (scene.meshes[scene.nodes.mesh[n]] for n in scene.mesh_nodes)
    assert len(moving.primitives[0].triangles) == 2 and len(still.primitives[0].triangles) == 1
    for t in (0.0, 0.25, 1.0, 1.5):
        x = t if t <= 1 else 1 + 3 * (t - 1)
        np.testing.assert_allclose(corners(scene, 0, t)[:3], [[x, 0, 0], [x + 1, 0, 0], [x, 1, 0]], atol=1e-6)
    normals = pose_normals(scene, sample(scene, 0.5), int(scene.mesh_nodes[0]), moving.primitives[0])
    np.testing.assert_allclose(normals[:3], [[0, 0, 1], [0, 0, 1], [0, 1, 0]], atol=1e-6)
    assert scene.duration == 1.5


def test_materials(tmp_path):
    text = f"f 1 .5 0 .8 .2 30 0 1 {TRIANGLE} fm 1 1 1 .1 .2 .3 0 0 0 5 .25 1 {TRIANGLE} am .5 .5 2 "
    text += f"fm .2 .4 1 0 0 0 0 0 0 0 0 0 {TRIANGLE}"
    shiny, dull, lit = load_scene(write(tmp_path, text)).materials
    assert shiny.base_color == pytest.approx((0.8, 0.4, 0, 1)) and shiny.specular == 1.0
    assert shiny.roughness == pytest.approx((2 / 32) ** 0.25) and shiny.alpha_mode == "OPAQUE"
    assert dull.base_color == pytest.approx((0.1, 0.2, 0.3, 0.75)) and dull.specular == 0.0
    assert dull.alpha_mode == "BLEND" and not any(dull.emissive)
    assert lit.emissive == pytest.approx((0.1, 0.2, 2.0)), "a surface with only ambient color emits it"


def test_includes_share_material_and_block(tmp_path):
    write(tmp_path, "fm 0 0 0 .1 .2 .3 0 0 0 0 0 0\ni 0 deeper.aff", "part.aff")
    write(tmp_path, TRIANGLE, "deeper.aff")
    scene = load_scene(
        write(tmp_path, "xs 1 1 1 0 1 0 0 5 0 0 { i 0 part.aff }\ni 1 left_out.aff\np 3 0 0 0 1 0 0 0 1 0")
    )
    assert len(scene.mesh_nodes) == 2 and corners(scene, 1)[0, 0] == 5
    assert {m.primitives[0].material for m in scene.meshes} == {0}, "an include changes the current material"
    assert notes_about(scene, "left_out.aff")
    scene = load_scene(write(tmp_path, "d 3 i 3 part.aff"))
    assert len(scene.mesh_nodes) == 1


def test_textures_of_bart_are_found_in_the_folder_beside_the_scene(tmp_path):
    """A texture of the scene's own folder comes first; nothing but that one other folder is searched."""
    scene_folder, shared = tmp_path / "kitchen", tmp_path / "TextureFiles"
    scene_folder.mkdir()
    shared.mkdir()
    Image.new("RGB", (4, 2), (255, 0, 0)).save(shared / "red.ppm")
    Image.new("RGB", (2, 2), (0, 255, 0)).save(shared / "both.ppm")
    Image.new("RGB", (8, 8), (0, 0, 255)).save(scene_folder / "both.ppm")
    Image.new("RGB", (1, 1)).save(tmp_path / "secret.ppm")
    names = ("red.ppm", "both.ppm", "../secret.ppm", "../TextureFiles/red.ppm")
    text = "".join(f"tt {name} 0 0 0 0 1  1 0 0 1 1  0 1 0 0 0\n" for name in names)
    scene = load_scene(write(scene_folder, text))
    assert sorted(image.size for image in scene.images) == [(4, 2), (8, 8)]
    assert [bool(notes_about(scene, repr(name))) for name in names] == [False, False, True, False]


def test_unusable_textures_are_noted(tmp_path):
    (tmp_path.parent / "secret.png").write_bytes(b"")
    text = "".join(f"tt {name} 0 0 0 0 1  1 0 0 1 1  0 1 0 0 0\n" for name in ("none.ppm", "../secret.png", "/etc/x"))
    scene = load_scene(write(tmp_path, text))
    for name in ("none.ppm", "../secret.png", "/etc/x"):
        assert notes_about(scene, repr(name)) == ["scene.aff:1"], "one note, at the first of the three"
    assert len(scene.notes) == 1
    assert not scene.images


BAD = {
    "q 1 2 3": (1, "'q'"),
    "\n\ns 0 0 0": (3, 4),
    "s 0 0\n0 one": (2, "'one'"),
    "s 0 0 0 0": (1, 0),
    "s nan 0 0 1": (1, "'nan'"),
    "s 1e39 0 0 1": (1, "'1e39'"),
    "p 2 0 0 0 1 1 1": (1, 3),
    "p 999999999 0 0 0": (1, 2999999997),
    "c 0 0 0 1 0 0 0 1": (1, ""),
    "v from 0 0 0 to 1 1 1": (1, "'to'"),
    VIEW.replace("at 0 0 0", "at 0 0 10"): (1, ""),
    VIEW.replace("angle 40", "angle 180"): (1, 180),
    "xs 1 1 1 0 1 0 0 0 0 0 {\ns 0 0 0 1": (1, ""),
    "s 0 0 0 1\n}": (2, "}"),
    "x car\ns 0 0 0 1": (2, "'s'"),
    "k a { transl 3": (1, 3),
    "k a { wobble 4": (1, "'wobble'"),
    "k a { visibility 1 0 1": (1, ""),
    "a 2 1 5": (1, 1),
    "m vertices 1 0 0 0 corners 1": (1, "'corners'"),
    "m vertices 3 0 0 0 1 0 0 0 1 0 triangles 1\n0 1 3": (2, 3),
    "m vertices 3 0 0 0 1 0 0 0 1 0 triangles 1\n0 1 -1": (2, -1),
    "m vertices 3 0 0 0 1 0 0 0 1 0 triangles 1\n0 1 .5": (2, ".5"),
    "\ni 0 ../x.aff": (2, "'../x.aff'"),
    "i 0 none.aff": (1, "'none.aff'"),
    "i zero x.aff": (1, "'zero'"),
}


@pytest.mark.parametrize("text", BAD)
def test_errors_carry_file_and_line(tmp_path, text):
    refused(write(tmp_path, text), *BAD[text])


def test_include_cycles(tmp_path):
    write(tmp_path, "s 0 0 0 1\ni 0 b.aff", "a.aff")
    write(tmp_path, "i 0 a.aff", "b.aff")
    with pytest.raises(SceneError, match=r"a\.aff > b\.aff > a\.aff") as caught:
        load_scene(write(tmp_path, "i 0 a.aff"))
    assert caught.value.where == "b.aff:1"


def test_limit_on_includes(tmp_path, monkeypatch):
    monkeypatch.setattr(parser, "MAX_INCLUDES", 500)
    for k in range(30):
        write(tmp_path, f"i 0 f{k + 1}.aff\n" * 4, f"f{k}.aff")
    write(tmp_path, TRIANGLE, "f30.aff")
    with pytest.raises(SceneError, match=str(parser.MAX_INCLUDES)):
        load_scene(tmp_path / "f0.aff")


def test_limit_on_vertices(tmp_path, monkeypatch):
    monkeypatch.setattr(parser, "MAX_VERTICES", 1000)
    write(tmp_path, "s 0 0 0 1", "ball.aff")
    with pytest.raises(SceneError, match="1000"):
        load_scene(write(tmp_path, "i 0 ball.aff\n" * 3))


@pytest.mark.parametrize("data", [b"", b"\0\1\2"])
def test_empty_and_binary_files(tmp_path, data):
    (tmp_path / "x.aff").write_bytes(data)
    with pytest.raises(SceneError) as caught:
        load_scene(tmp_path / "x.aff")
    assert caught.value.where == str(tmp_path / "x.aff")


def test_scene_and_animation_arguments(tmp_path):
    path = write(tmp_path, f"x car {{ {TRIANGLE} }} k car {{ visibility 1 1 0 }} a 0 2 4")
    assert load_scene(path, animation=[]).channels == ()
    with pytest.raises(SceneError):
        load_scene(path, scene=0)
