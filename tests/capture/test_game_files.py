"""Archives, scripts, maps and models: closed forms on files that the tests write, laws on the game's own."""

from __future__ import annotations

import numpy as np
import pytest
from game_files import box_model, image_bytes, map_bytes, model_bytes, quad, room, vertices, write_pak

from taubench_gl.capture import light
from taubench_gl.capture.parts import SceneFile
from taubench_gl.capture.quake3.bsp import PATCH, STEPS, Bsp
from taubench_gl.capture.quake3.md3 import Md3, read_clips, read_skin
from taubench_gl.capture.quake3.paks import Paks
from taubench_gl.capture.quake3.shaders import describe, number, parse_script, read_scripts
from taubench_gl.capture.quake3.surfaces import Surfaces
from taubench_gl.errors import SceneError


# ---------------------------------------------------------------------------------------------------------- archives
def test_the_last_archive_wins_and_names_ignore_case(tmp_path):
    write_pak(tmp_path / "PAK0.pk3", {"Textures/A.TGA": b"old", "only.txt": b"first"})
    write_pak(tmp_path / "pak1.pk3", {"textures/a.tga": b"new"})
    paks = Paks(tmp_path)
    assert (paks.read("textures\\A.tga"), paks.read("ONLY.txt"), paks.read("none")) == (b"new", b"first", None)


def test_a_map_is_that_of_the_last_archive(tmp_path):
    for name in ("a", "b"):
        write_pak(tmp_path / f"{name}.pk3", {"maps/tiny.bsp": b""})
    assert Paks(tmp_path).map_file("tiny") == (tmp_path / "b.pk3", "maps/tiny.bsp")
    with pytest.raises(SceneError) as caught:
        Paks(tmp_path).map_file("other")
    assert caught.value.where == str(tmp_path) and caught.value.hint


def test_scripts_are_read_from_the_first_archive_and_each_from_its_end(tmp_path):
    def script(value):
        return f"look\n{{\nq3map_surfacelight {value}\n}}\n".encode()

    write_pak(tmp_path / "a.pk3", {"scripts/one.shader": script(1), "scripts/two.shader": script(2)})
    write_pak(tmp_path / "b.pk3", {"scripts/three.shader": script(3)})
    assert describe("look", read_scripts(Paks(tmp_path))["look"]).surface_light == 2.0


def test_of_two_images_the_named_one_is_meant(tmp_path):
    write_pak(tmp_path / "a.pk3", {"x/wall.jpg": b"", "x/wall.tga": b""})
    names = ("x/wall.jpg", "x/wall.tga", "x/wall.png", "x/wall")
    found = [Paks(tmp_path).image_name(name) for name in names]
    assert found == ["x/wall.jpg", "x/wall.tga", "x/wall.tga", "x/wall.tga"]


def test_the_ending_of_an_image_is_a_hint(tmp_path):
    write_pak(tmp_path / "a.pk3", {"x/wall.jpg": image_bytes((255, 0, 0), (64, 32), "JPEG")})
    paks = Paks(tmp_path)
    assert paks.image_name("X/Wall.tga") == "x/wall.jpg" and paks.image_name("x/floor.tga") is None
    pixels = paks.image("x/wall.jpg", 16)
    assert pixels.shape == (8, 16, 4) and abs(pixels[0, 0].astype(int) - [255, 0, 0, 255]).max() < 6


@pytest.mark.parametrize("write", ["none", "damaged", "bomb"])
def test_archives_that_cannot_be_used(tmp_path, write, monkeypatch):
    if write == "damaged":
        (tmp_path / "a.pk3").write_bytes(b"PK\x03\x04 no archive")
    if write == "bomb":
        monkeypatch.setattr("taubench_gl.capture.quake3.paks.MAX_MEMBER", 1000)
        write_pak(tmp_path / "a.pk3", {"big": bytes(5000)})
    with pytest.raises(SceneError):
        Paks(tmp_path).read("big")


# ----------------------------------------------------------------------------------------------------------- scripts
def look(text, name="a"):
    return describe(name, dict(parse_script(text))[name])


def test_scripts():
    text = """// comment
    a { cull none /* { */ deformVertexes wave 1 sin 0 1 0 1
      { map $lightmap } { map textures/x.tga
        alphaFunc GE128 } }
    B\\c
    {
      surfaceparm nodraw
    }
    """
    found = dict(parse_script(text))
    assert set(found) == {"a", "b/c"}
    a = describe("a", found["a"])
    assert (a.images, a.alpha, a.cutoff, a.double_sided, a.drawn) == (("textures/x.tga", "a"), "MASK", 0.5, True, True)
    assert not describe("b/c", found["b/c"]).drawn
    assert look("a\n{\nsurfaceparm fog\n}").left_out == "fog volumes"
    assert describe("without", None).images == ("without",)


@pytest.mark.parametrize(
    "stage, alpha, left_out",
    [
        ("map x\nblendFunc add", "OPAQUE", "additive surfaces"),
        ("map x\nblendFunc GL_ONE GL_ONE", "OPAQUE", "additive surfaces"),
        ("map x\nblendFunc GL_SRC_ALPHA GL_ONE_MINUS_SRC_ALPHA", "BLEND", ""),
        ("map x\nblendFunc GL_DST_COLOR GL_ZERO", "OPAQUE", ""),
        ("animMap 4 x y z", "OPAQUE", ""),
    ],
)
def test_blending(stage, alpha, left_out):
    found = look(f"a\n{{\n{{\n{stage}\n}}\n}}")
    assert (found.images[0], found.alpha, found.left_out) == ("x", alpha, left_out)


def test_a_reflection_is_the_last_choice_of_an_image():
    text = "a\n{\n{\nmap shine\ntcGen environment\n}\n{\nmap x\n}\n}"
    assert look(text).images == ("x", "shine", "a")


@pytest.mark.parametrize("text, value", [("12.5x", 12.5), ("-3", -3), (".5", 0.5), ("1e3", 1000), ("env/sky", 0)])
def test_numbers_are_read_as_atof_does(text, value):
    assert number(text) == value


def test_a_mask_that_shines_keeps_its_cutoff(tmp_path):
    script = b"grate\n{\nq3map_surfacelight 100\n{\nmap x.tga\nalphaFunc GT0\n}\n}"
    write_pak(tmp_path / "a.pk3", {"scripts/a.shader": script, "x.tga": image_bytes((255, 255, 255))})
    file = SceneFile(np.zeros(1), 1.0, "")
    material = file.writer.gltf.materials[Surfaces(file, Paks(tmp_path)).material("grate", "", 1)]
    assert (material.alphaMode, material.alphaCutoff) == ("MASK", 0.01) and max(material.emissiveFactor) == 1


# -------------------------------------------------------------------------------------------------------------- maps
def facing(mesh):
    """Cosines between vertex normals and the normals of the triangles as the file turns them."""
    a, b, c = (mesh.places[mesh.triangles[:, k]] for k in (0, 2, 1))
    n = np.cross(b - a, c - a)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return np.einsum("ij,ij->i", n, mesh.normals[mesh.triangles[:, 0]])


def test_planar_surfaces_and_models_of_a_map():
    bsp = Bsp(room(entities='{"a" "b"}\n{"classname" "light" "origin" "1 2 3"}'), "tiny")
    assert bsp.entities[1] == {"classname": "light", "origin": "1 2 3"}
    world = {bsp.shaders[k]: mesh for k, mesh in bsp.meshes(0).items()}
    assert set(world) == {"textures/floor", "textures/sky", "textures/lamp", "textures/wall"}
    floor = world["textures/floor"]
    assert np.abs(floor.places[:, :2]).max() == 256 and len(floor.triangles) == 2
    for name in ("textures/floor", "textures/sky", "textures/lamp"):
        assert facing(world[name]).min() > 0.999
    assert [bsp.shaders[k] for k in bsp.meshes(1)] == ["textures/door"]


def test_a_curved_surface_is_its_bezier_pieces():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(3, 5, 3)) + np.stack(np.meshgrid(np.arange(5), np.arange(3), [0]), -1)[:, :, 0] * 3
    normals = np.tile([0.0, 0, 1], (15, 1))
    surface = ("curve", PATCH, vertices(points.reshape(-1, 3), normals), np.zeros(0, int), (5, 3))
    mesh = Bsp(map_bytes([surface]), "test").meshes(0)[0]
    fine = mesh.places.reshape(STEPS + 1, 2 * STEPS + 1, 3)
    t = np.linspace(0, 1, STEPS + 1)
    weights = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], 1)
    for piece in (0, 1):
        exact = np.einsum("ai,bj,ijc->abc", weights, weights, points[:, 2 * piece : 2 * piece + 3])
        assert np.abs(fine[:, piece * STEPS : (piece + 1) * STEPS + 1] - exact).max() < 1e-5
    assert len(mesh.triangles) == 2 * STEPS * 2 * STEPS


def test_curves_have_the_winding_of_planes():
    flat = np.stack(np.meshgrid([0, 1, 2], [0, 1, 2], [0]), -1).reshape(-1, 3).astype(float)
    surface = ("c", PATCH, vertices(flat, [0, 0, 1]), np.zeros(0, int), (3, 3))
    assert facing(Bsp(map_bytes([surface]), "t").meshes(0)[0]).min() > 0.999


def test_triangles_without_area_are_left_out():
    flat = vertices([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], [0, 0, 1])
    mesh = Bsp(map_bytes([("a", 3, flat, np.array([0, 1, 2, 0, 3, 1]), (0, 0))]), "t").meshes(0)[0]
    assert len(mesh.triangles) == 1 and len(mesh.places) == 3


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s.__setitem__(3, np.array([0, 1, 9])),
        lambda s: s.__setitem__(1, PATCH),
        lambda s: s[2]["place"].__setitem__(0, np.nan),
    ],
)
def test_invalid_maps_are_refused(change):
    surface = list(quad([0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], "a"))
    change(surface)
    with pytest.raises(SceneError):
        Bsp(map_bytes([surface]), "t").meshes(0)


def test_curved_surfaces_have_a_budget(monkeypatch):
    points = vertices(np.zeros((129 * 129, 3)), [0, 0, 1])
    data = map_bytes([("a", PATCH, points, np.zeros(0, int), (129, 129))])
    monkeypatch.setenv("TAUBENCH_MAX_MEMORY", "2MiB")
    with pytest.raises(SceneError):
        Bsp(data, "t")


# ------------------------------------------------------------------------------------------------------------ models
def test_a_model_has_places_normals_and_tags_for_every_frame():
    turned = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    model = Md3(box_model(3, {"tag_a": [((1.0, 2, 3), np.eye(3)), ((4.0, 5, 6), turned), ((0, 0, 0), np.eye(3))]}), "t")
    assert model.frames == 3 and model.surfaces[0].shader == "models/box"
    places, normals = model.surfaces[0].shape(2)
    assert places.tolist() == [[0, 0, 2], [0, 8, 2], [8, 0, 2]]
    assert np.allclose(normals, [0, 0, 1])
    assert np.allclose(model.tags["tag_a"][0][1], [4, 5, 6]) and np.allclose(model.tags["tag_a"][1][1], turned)


def test_normals_are_two_angles():
    data = bytearray(box_model())
    data[-2:] = bytes([64, 0])  # of the last vertex: 90 degrees from up, around 0
    _, normals = Md3(bytes(data), "t").surfaces[0].shape(0)
    angle = 64 * 2 * np.pi / 255
    assert np.allclose(normals[2], [np.sin(angle), 0, np.cos(angle)])


def test_animations_and_skins():
    rows = [f"{i * 10} {-5 if i == 20 else 5} {i % 2} {20 if i else 0} // name" for i in range(25)]
    clips = read_clips("sex m\n" + "\n".join(rows), "t")
    assert clips[0].fps == 1.0 and clips[6].first == 60 and clips[20].backward and not clips[19].backward
    assert clips[13].first == 60 and clips[14].first == 70  # the legs' rows count from the torso's first
    assert clips[32].backward and clips[32].first == clips[13].first
    assert read_skin("Lower,models/a.tga\n\ntag_torso,\n") == {"lower": "models/a.tga", "tag_torso": ""}
    with pytest.raises(SceneError):
        read_clips("1 2 3 4\n", "t")


def test_invalid_models_are_refused():
    with pytest.raises(SceneError):
        Md3(model_bytes([("a", "", [[0, 1, 7]], [[0, 0]] * 3, np.zeros((1, 3, 3)))]), "t")
    with pytest.raises(SceneError):
        Md3(box_model()[:150], "t")


# ------------------------------------------------------------------------------------------------------------- light
def test_light_has_one_unit():
    # q3map: at d units, a light entity gives 7500 light / d^2, the same irradiance as the sun's intensity.
    d, unit = 100.0, 1 / 32
    assert np.isclose(light.entity_candela(300, unit) / (d * unit) ** 2, light.sun_lux(7500 * 300 / d**2))
    # An infinite plane of radiance L gives irradiance pi L: q3map's surface light of value v gives pi v / 4.
    assert np.isclose(np.pi * light.surface_luminance(100), light.sun_lux(np.pi * 100 / 4))
    assert np.isclose(light.dynamic_candela(300, unit) / (300 * unit) ** 2, light.sun_lux(16))
    assert np.isclose(np.pi * light.FULL_BRIGHT, light.sun_lux(255))


def test_the_light_of_a_map_is_that_of_its_lightmaps(game_folder):
    import struct

    paks = Paks(game_folder)
    data = paks.read("maps/oa_shouse.bsp")
    bsp, scripts = Bsp(data, "oa_shouse"), read_scripts(paks)
    looks = [describe(name, scripts.get(name)) for name in bsp.shaders]
    (sun,) = {sun for look in looks for sun in look.suns}
    sky = next(look for look in looks if look.sky and look.surface_light)
    at, size = struct.unpack_from("<ii", data, 8 + 8 * 14)
    maps = np.frombuffer(data, "u1", size, at).reshape(-1, 128, 128, 3)
    # Vertices of surfaces that look up, at their places in the lightmaps.
    flat = bsp.surfaces[(bsp.surfaces["kind"] == 1) & (bsp.surfaces["baked"][:, 0] >= 0)]
    found = []
    for surface in flat:
        v = bsp.vertices[surface["vertex"] : surface["vertex"] + surface["vertices"]]
        xy = (v["baked"] * 128).astype(int).clip(0, 127)
        found.append(maps[surface["baked"][0], xy[:, 1], xy[:, 0]][v["normal"][:, 2] > 0.99])
    measured = np.percentile(np.concatenate(found).astype(float), 90, axis=0)
    color = np.array(sun[:3]) / max(sun[:3])
    direct = color * sun[3] * np.sin(np.radians(sun[5]))
    image = paks.image(next(filter(None, map(paks.image_name, [sky.light_image or "", *sky.images]))), 64)
    tint = image[..., :3].reshape(-1, 3).mean(0)
    predicted = direct + tint / tint.max() * np.pi * sky.surface_light / 4
    ratio = measured / predicted
    assert 0.6 < ratio.mean() < 1.1  # walls hide some of the sky
    assert ratio.max() / ratio.min() < 1.15  # the same color


# --------------------------------------------------------------------------------------------------- the game's files
def test_every_map_and_model_of_the_game_is_read(game_folder):
    paks = Paks(game_folder)
    maps = paks.names("maps/", ".bsp")
    assert len(maps) > 60
    up = total = 0
    for name in maps[::8]:
        bsp = Bsp(paks.read(name), name)
        for mesh in bsp.meshes(0).values():
            cosines = facing(mesh)
            up, total = up + int((cosines > 0).sum()), total + len(cosines)
    assert total > 50_000 and up / total > 0.99
    models = paks.names("models/", ".md3")
    assert len(models) > 200
    for name in models[::5]:
        for surface in Md3(paks.read(name), name).surfaces:
            places, normals = surface.shape(0)
            assert np.isfinite(places).all() and np.allclose(np.linalg.norm(normals, axis=1), 1)
