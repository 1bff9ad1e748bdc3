"""Materials, textures and images, one tiny file per feature."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from gltf_builders import (
    notes_about,
    png,
    textured,
)
from gltf_files import Gltf

from taubench_gl.effects.path_tracing import absorbs, has_dielectric, transmits
from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene
from taubench_gl.scene.files import ROWS_AT_ONCE, decode_image
from taubench_gl.scene.model import Material


def test_material_defaults_and_extensions(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.extension("KHR_materials_emissive_strength")
    gltf.extension("KHR_materials_unlit")
    gltf.extension("KHR_materials_clearcoat")
    gltf.extension("ACME_unheard_of")
    gltf.add("materials", {})
    gltf.add("materials", {
        "emissiveFactor": [1, 0.5, 0], "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": True,
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}, "KHR_materials_unlit": {},
                       "KHR_materials_clearcoat": {"clearcoatFactor": 1}},
    })  # fmt: skip
    scene = load_scene(gltf.save(tmp_path))
    plain, rich = scene.materials
    assert plain.base_color == (1, 1, 1, 1) and plain.metallic == plain.roughness == 1.0 and not plain.unlit
    assert rich.emissive == (4.0, 2.0, 0.0) and rich.unlit and rich.double_sided
    assert (rich.alpha_mode, rich.alpha_cutoff) == ("MASK", 0.25)
    for name in ("KHR_materials_clearcoat", "ACME_unheard_of"):
        assert notes_about(scene, name)
    assert not notes_about(scene, "unlit")


def test_extensions_of_the_dielectric_lobe(tmp_path: Path) -> None:
    gltf = Gltf()
    names = ("ior", "specular", "transmission", "volume")
    for name in names:
        gltf.extension(f"KHR_materials_{name}")

    def add(**parts: dict) -> None:
        gltf.add("materials", {"extensions": {f"KHR_materials_{name}": part for name, part in parts.items()}})

    add(**{name: {} for name in names})
    volume = {"thicknessFactor": 0.1, "attenuationColor": [0.5, 1, 0], "attenuationDistance": 2.5}
    specular = {"specularFactor": 0.5, "specularColorFactor": [0.1, 2, 1]}
    add(ior={"ior": 1.33}, specular=specular, transmission={"transmissionFactor": 0.75}, volume=volume)
    add(ior={"ior": 0.0}, transmission={"transmissionFactor": 1.0})
    scene = load_scene(gltf.save(tmp_path))
    plain, glass, mirror = scene.materials
    assert plain == Material() and not scene.notes
    assert (glass.ior, glass.specular, glass.specular_color) == (1.33, 0.5, (0.1, 2.0, 1.0))
    assert (glass.transmission, glass.thick, glass.attenuation_distance) == (0.75, True, 2.5)
    assert glass.attenuation_color == (0.5, 1.0, 0.0) and not mirror.thick
    assert transmits(glass) and absorbs(glass) and not transmits(mirror) and has_dielectric(mirror)
    assert not any(check(plain) for check in (transmits, absorbs, has_dielectric))


def test_texture_transform(tmp_path: Path) -> None:
    transform = {"offset": [0.1, 0.2], "rotation": math.pi / 2, "scale": [2, 3], "texCoord": 1}
    gltf = textured({"texCoord": 0, "extensions": {"KHR_texture_transform": transform}})
    gltf.extension("KHR_texture_transform")
    texture = load_scene(gltf.save(tmp_path)).materials[0].base_color_texture
    assert texture.texcoord == 1
    # Scale, then counter-clockwise rotation in the image (v down: u to -v), then translation.
    np.testing.assert_allclose(texture.uv_transform @ [1, 0, 1], [0.1, 0.2 - 2.0], atol=1e-12)
    np.testing.assert_allclose(texture.uv_transform @ [0, 1, 1], [0.1 + 3.0, 0.2], atol=1e-12)


def test_missing_texture_coordinates_are_zero(tmp_path: Path) -> None:
    gltf = textured({})
    gltf.mesh()
    gltf.json["meshes"][0]["primitives"][0]["material"] = 0
    scene = load_scene(gltf.save(tmp_path))
    np.testing.assert_array_equal(scene.meshes[0].primitives[0].texcoords[0], np.zeros((3, 2)))
    assert notes_about(scene, "TEXCOORD_0")


def test_third_texture_coordinates_are_noted(tmp_path: Path) -> None:
    scene = load_scene(textured({"texCoord": 2}).save(tmp_path))
    assert scene.materials[0].base_color_texture is None and notes_about(scene, "TEXCOORD_2")


def test_sampler_defaults(tmp_path: Path) -> None:
    gltf = textured({})
    gltf.add("samplers", {"wrapS": 33071, "magFilter": 9728})
    gltf.json["textures"][0]["sampler"] = 0
    sampler = load_scene(gltf.save(tmp_path)).materials[0].base_color_texture.sampler
    assert (sampler.mag_filter, sampler.min_filter, sampler.wrap_s, sampler.wrap_t) == (9728, 9987, 33071, 10497)


def test_image_in_a_buffer_view_and_lazy(tmp_path: Path) -> None:
    gltf = textured({})
    gltf.json["images"] = [{"bufferView": gltf.view(png((5, 4))), "mimeType": "image/png", "name": "tile"},
                           {"uri": "nowhere.png"}]  # fmt: skip
    images = load_scene(gltf.save(tmp_path)).images
    assert images[0].size == (5, 4) and images[0].name == "tile"
    pixels = images[0].decode()
    assert pixels.shape == (4, 5, 4) and pixels[0, 0].tolist() == [10, 20, 30, 255]
    assert images[1].size == (0, 0)


def test_sixteen_bit_gray_is_scaled(tmp_path: Path) -> None:
    gltf = textured({})
    gltf.json["images"] = [{"bufferView": gltf.view(png(mode="I;16", color=0x8000)), "mimeType": "image/png"}]
    assert load_scene(gltf.save(tmp_path)).images[0].decode()[0, 0].tolist() == [128, 128, 128, 255]


@pytest.mark.parametrize("mode", ["RGB", "P", "LA", "L"])
def test_tall_images_are_converted_as_a_whole(tmp_path: Path, mode: str) -> None:
    values = np.random.default_rng(1).integers(0, 255, (2 * ROWS_AT_ONCE + 3, 5, 3), np.uint8)
    image, saved = PIL.Image.fromarray(values).convert(mode), tmp_path / "tall.png"
    image.save(saved, transparency=7) if mode in "PL" else image.save(saved)
    with PIL.Image.open(saved) as whole:
        expected = np.asarray(whole.convert("RGBA"))
    np.testing.assert_array_equal(decode_image(saved, ("PNG",), lambda what, hint: SceneError(what)), expected)


def test_webp(tmp_path: Path) -> None:
    out = io.BytesIO()
    PIL.Image.new("RGB", (4, 4), (200, 0, 0)).save(out, "WEBP", lossless=True)
    gltf = textured({})
    gltf.add("images", {"bufferView": gltf.view(out.getvalue()), "mimeType": "image/webp"})
    gltf.json["textures"][0]["extensions"] = {"EXT_texture_webp": {"source": 1}}
    gltf.extension("EXT_texture_webp")
    scene = load_scene(gltf.save(tmp_path))
    assert scene.materials[0].base_color_texture.image == 1
    assert scene.images[1].decode()[0, 0].tolist() == [200, 0, 0, 255]
