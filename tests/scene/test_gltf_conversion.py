"""Specular-glossiness materials against closed forms, and KTX 2 textures of known texels."""

from __future__ import annotations

import base64
import io
import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from gltf_builders import png, refuse
from gltf_files import Gltf
from ktx2_files import ktx2

from taubench_gl.errors import SceneError
from taubench_gl.scene import Scene, load_scene
from taubench_gl.scene.gltf.specular_glossiness import metallic_roughness
from taubench_gl.srgb import srgb_decode, srgb_encode

GLOSSY = "KHR_materials_pbrSpecularGlossiness"


def gray(*values: float) -> np.ndarray:
    return np.array(values)[:, None] * np.ones(3)


@pytest.mark.parametrize("metal", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_inverse_of_metallic_roughness(metal: float) -> None:
    """s = 0.04 (1 - m) + b m and d = b (1 - m) 0.96 / (1 - s), for grays b, give b and m again."""
    base = gray(0.1, 0.4, 0.7)
    specular = 0.04 * (1 - metal) + base * metal
    diffuse = base * (1 - metal) * 0.96 / (1 - specular)
    found, metallic = metallic_roughness(diffuse, specular)
    np.testing.assert_allclose(metallic, metal, atol=1e-6)
    np.testing.assert_allclose(found, base, atol=1e-5)


def glossy_scene(folder: Path, images: tuple[bytes, ...] = (), infos: tuple[dict, ...] = ({}, {}), **fields) -> Scene:
    gltf = Gltf()
    uv = gltf.accessor([[0, 0], [1, 0], [0, 1]])
    gltf.node(mesh=gltf.mesh(TEXCOORD_0=uv))
    gltf.json["meshes"][0]["primitives"][0]["material"] = 0
    gltf.extension(GLOSSY)
    gltf.json["extensionsRequired"] = [GLOSSY]
    values = dict(fields)
    names = ("diffuseTexture", "specularGlossinessTexture")
    for name, data, info in zip(names, images, infos):
        if not data:
            continue
        index = gltf.add("images", {"uri": "data:image/png;base64," + base64.b64encode(data).decode()})
        values[name] = {"index": gltf.add("textures", {"source": index}), **info}
    gltf.add("materials", {"name": "m", "extensions": {GLOSSY: values}})
    return load_scene(gltf.save(folder), strict=True)


def test_factors(tmp_path: Path) -> None:
    scene = glossy_scene(tmp_path, diffuseFactor=[0.3, 0.6, 0.9, 0.5], specularFactor=[0.04] * 3, glossinessFactor=0.7)
    (material,) = scene.materials
    np.testing.assert_allclose(material.base_color, [0.3, 0.6, 0.9, 0.5], atol=1e-12)
    assert material.metallic == 0.0 and material.roughness == pytest.approx(0.3)
    assert [(n.kind, n.count) for n in scene.notes] == [("specular-glossiness", 1)]


def test_textures(tmp_path: Path) -> None:
    """Texels are converted one by one: a dielectric, and a metal with its glossiness in alpha."""

    def image(texels: list) -> bytes:
        out = io.BytesIO()
        PIL.Image.fromarray(np.uint8([texels]), "RGBA").save(out, "PNG")
        return out.getvalue()

    dark = round(float(srgb_encode(np.array(0.04))) * 255)
    diffuse = image([[120, 60, 200, 90], [0, 0, 0, 255]])
    specular = image([[dark] * 3 + [51], [180, 180, 180, 204]])
    scene = glossy_scene(tmp_path, (diffuse, specular))
    (material,) = scene.materials
    assert material.base_color == (1, 1, 1, 1) and material.metallic == material.roughness == 1.0
    base = scene.images[material.base_color_texture.image].decode()
    other = scene.images[material.metallic_roughness_texture.image].decode()
    assert base.shape == other.shape == (1, 2, 4)
    np.testing.assert_allclose(base[0].astype(int), [[120, 60, 200, 90], [180, 180, 180, 255]], atol=1)
    assert abs(int(other[0, 0, 2])) <= 1 and other[0, 1, 2] == 255  # metallic
    assert other[0, :, 1].tolist() == [204, 51]  # roughness
    assert scene.images[0].size == (2, 1) and len(scene.images) == 4


def test_textures_of_other_sizes_are_resampled(tmp_path: Path) -> None:
    scene = glossy_scene(tmp_path, (png((8, 4), "RGB", (100, 100, 100)), png((2, 2), "RGBA", (0, 0, 0, 128))))
    pixels = scene.images[scene.materials[0].metallic_roughness_texture.image].decode()
    assert pixels.shape == (4, 8, 4) and np.all(pixels[..., 1] == 127) and np.all(pixels[..., 2] == 0)
    expected = srgb_decode(np.array(100 / 255)) / 0.96  # a specular color of 0
    base = scene.images[scene.materials[0].base_color_texture.image].decode()
    np.testing.assert_allclose(srgb_decode(base[..., 0] / 255), expected, atol=0.004)


def test_a_texture_beside_a_factor(tmp_path: Path) -> None:
    """Texels of a texture that is not square are converted with the factor that stands for the other texture."""
    images = (b"", png((4, 2), "RGBA", (0, 0, 0, 128)))
    scene = glossy_scene(tmp_path, images, diffuseFactor=[0.24, 0.48, 0.72, 1.0])
    base = scene.images[scene.materials[0].base_color_texture.image].decode()
    assert base.shape == (2, 4, 4)
    np.testing.assert_allclose(srgb_decode(base[..., :3] / 255), [[[0.25, 0.5, 0.75]] * 4] * 2, atol=0.004)


def test_textures_with_other_coordinates(tmp_path: Path) -> None:
    """Textures at other coordinates cannot be combined by texels: the specular factor is used, with a note."""
    scene = glossy_scene(tmp_path, (png(), png((3, 2), "RGBA", (9, 9, 9, 9))), ({}, {"texCoord": 1}))
    assert [n.kind for n in scene.notes] == ["specular-texture", "specular-glossiness"]
    assert scene.materials[0].base_color_texture is not None


# KTX 2

COLORS = [(10, 200, 30, 255), (255, 0, 128, 40)]


def ktx2_scene(folder: Path, data: bytes, fallback: bool = False) -> Path:
    gltf = Gltf()
    gltf.extension("KHR_texture_basisu")
    gltf.node(mesh=gltf.mesh(TEXCOORD_0=gltf.accessor([[0, 0], [1, 0], [0, 1]])))
    gltf.json["meshes"][0]["primitives"][0]["material"] = 0
    (folder / "image.ktx2").write_bytes(data)
    gltf.add("images", {"uri": "image.ktx2", "mimeType": "image/ktx2"})
    texture = {"extensions": {"KHR_texture_basisu": {"source": 0}}}
    if fallback:
        gltf.add("images", {"uri": "data:image/png;base64," + base64.b64encode(png()).decode()})
        texture["source"] = 1
    else:
        gltf.json["extensionsRequired"] = ["KHR_texture_basisu"]
    gltf.add("textures", texture)
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    return gltf.save(folder)


def test_ktx2(tmp_path: Path) -> None:
    pytest.importorskip("opengl_basisu")
    scene = load_scene(ktx2_scene(tmp_path, ktx2((8, 4), COLORS)), strict=True)
    image = scene.images[scene.materials[0].base_color_texture.image]
    pixels = image.decode()
    assert image.size == (8, 4) and image.name == "image" and not scene.notes
    np.testing.assert_array_equal(pixels[:, :4], np.broadcast_to(COLORS[0], (4, 4, 4)))
    np.testing.assert_array_equal(pixels[:, 4:], np.broadcast_to(COLORS[1], (4, 4, 4)))


def test_ktx2_is_preferred_to_its_fallback(tmp_path: Path) -> None:
    pytest.importorskip("opengl_basisu")
    scene = load_scene(ktx2_scene(tmp_path, ktx2((5, 3), COLORS), fallback=True))
    assert scene.images[scene.materials[0].base_color_texture.image].size == (5, 3)


def test_damaged_ktx2(tmp_path: Path) -> None:
    pytest.importorskip("opengl_basisu")
    whole = ktx2((8, 4), COLORS)
    for data in (whole[:30], whole[:-8], whole[:20] + b"\xff" * 8 + whole[28:], whole[:20] + bytes(4) + whole[24:]):
        path = ktx2_scene(tmp_path, data)
        assert [n.kind for n in load_scene(path).notes] == ["texture-unreadable"]
        refuse(path, "/images/0")
    path = ktx2_scene(tmp_path, whole[:44] + b"\2" + whole[45:])  # declared as Zstandard data
    assert [n.kind for n in load_scene(path).notes] == ["texture-unreadable"]
    with pytest.raises(SceneError):
        load_scene(path, strict=True).images[0].decode()


def test_without_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A flat color and a note by default; the error names the extra."""
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    path = ktx2_scene(tmp_path, ktx2((8, 4), COLORS))
    scene = load_scene(path)
    assert [n.kind for n in scene.notes] == ["texture-unreadable"] and scene.materials[0].base_color_texture is None
    assert "taubench-gl[ktx2]" in refuse(path, "/images/0").hint
