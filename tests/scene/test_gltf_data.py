"""Real files: valid ones load, invalid ones are refused, and results agree with the Khronos validator and pygltflib."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pygltflib
import pytest
from gltf_files import read_json

from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene

# Errors of the Khronos validator that the reader accepts deliberately.
TOLERATED = {
    "DUPLICATE_ELEMENTS": "an extension declared twice is still declared",
    "MESH_PRIMITIVE_TOO_FEW_TEXCOORDS": "drawn with texture coordinate 0, noted; touches texturing only",
    "IMAGE_DATA_INVALID": "no material samples the image, so it is not opened",
    "IMAGE_UNEXPECTED_EOS": "the same; for a sampled image, Image.decode raises",
}
# Textures and images are read only if a material samples them.
TEXTURING = ("/images", "/textures", "/samplers")

# Files without validator errors that the reader refuses.
STRICTER = {
    "min_version_valid.gltf": "requires glTF 2.1",
    "perspective_yfov.gltf": "a field of view above 180 degrees, a warning of the validator",
    "integer_written_as_float.gltf": "its normals are all zero",
    "primitive_generated_tangent_space.gltf": "its normals are all zero",
    "named_objects.gltf": "an image in a buffer without data",
    "unused_objects.gltf": "an image in a buffer without data",
    "valid.gltf": "inverse bind matrices are all zero",
    "unknown_type.gltf": "a light that is neither point, spot nor directional",
}


def scenes(root: Path) -> list[Path]:
    return sorted(p for p in root.rglob("*") if p.suffix in (".gltf", ".glb"))


@functools.cache
def outcome(path: Path) -> SceneError | None:
    """None if the file loads strictly; the error if it is refused.  Any other exception fails the test."""
    try:
        load_scene(path, strict=True)
    except SceneError as e:
        assert "\n" not in str(e) and path.name in str(e), str(e)
        return e
    return None


def test_all_good_files_load(data: Path) -> None:
    """``reports4`` holds inputs that once went wrong; tests of their subjects name them."""
    files = [p for p in scenes(data) if not p.relative_to(data).parts[0].startswith(("bad_", "reports"))]
    assert len(files) >= 130
    refused = [str(e) for p in files if (e := outcome(p)) is not None]
    assert not refused


def test_bad_files_of_other_projects(data: Path) -> None:
    """All files of assimp are invalid; these of magnum and tinygltf are valid."""
    fine = {
        "buffer-long-size.glb", "empty.glb", "image-buffer-embedded.gltf", "image-embedded.gltf",
        "image-invalid-ktx.gltf", "image.gltf", "material-clearcoat.gltf", "material-sheen.gltf",
        "texture-extensions.gltf", "issue-492.glb",
        "zero-sized-bin-chunk-issue-440.glb",
    }  # fmt: skip
    files = [p for folder in ("assimp", "magnum", "tinygltf") for p in scenes(data / "bad_gltf" / folder)]
    assert {p.name for p in files if outcome(p) is None} == fine


def reports(data: Path) -> list[tuple[Path, list[dict]]]:
    out = []
    for report in sorted((data / "bad_gltf" / "validator").rglob("*.report.json")):
        messages = json.loads(report.read_text(encoding="utf-8"))["issues"]["messages"]
        out.append(
            (report.with_name(report.name.removesuffix(".report.json")), [m for m in messages if m["severity"] == 0])
        )
    assert len(out) >= 140
    return out


def test_validator_errors_are_refused(data: Path) -> None:
    missed = []
    for path, errors in reports(data):
        serious = [
            m for m in errors
            if m["code"] not in TOLERATED and not m.get("pointer", "").startswith(TEXTURING)
        ]  # fmt: skip
        if serious and outcome(path) is None:
            missed.append((path.name, serious[0]["code"]))
    assert not missed


def test_errors_are_at_the_pointers_of_the_validator(data: Path) -> None:
    """For most files the error is at, above or below a pointer of the validator."""
    hits = total = 0
    for path, errors in reports(data):
        error = outcome(path)
        pointers = [m["pointer"] for m in errors if m.get("pointer")]
        if error is None or not pointers:
            continue
        total += 1
        ours = str(error.where).partition("#")[2].replace("/*", "")
        hits += any(ours.startswith(p) or p.startswith(ours) for p in pointers)
    assert total >= 80 and hits >= 0.9 * total, f"{hits} of {total}"


def test_clean_reports_load(data: Path) -> None:
    refused = {path.name for path, errors in reports(data) if not errors and outcome(path) is not None}
    assert refused <= set(STRICTER), refused - set(STRICTER)


def test_clean_reports_load_by_default(data: Path) -> None:
    """Every file without validator errors, but for the reasons in docs/formats.md."""
    documented = {
        "min_version_valid.gltf": "another version",
        "named_objects.gltf": "vertices in a buffer without data",
        "unused_objects.gltf": "vertices in a buffer without data",
    }
    refused = set()
    for path, found in reports(data):
        if not found:
            try:
                load_scene(path)
            except SceneError:
                refused.add(path.name)
    assert refused == set(documented)


def test_bad_files_never_crash_and_repaired_ones_have_one_note_of_each_kind(data: Path) -> None:
    files, repaired = scenes(data / "bad_gltf"), 0
    assert len(files) >= 200
    for path in files:
        refused = outcome(path) is not None
        try:
            kinds = [note.kind for note in load_scene(path).notes if note.kind and note.kind != "extension"]
        except SceneError:
            continue
        assert len(set(kinds)) == len(kinds), path.name
        repaired += refused
    assert repaired >= 80


def test_broken_images_fail_when_sampled(data: Path, tmp_path: Path) -> None:
    """Broken images that a material samples make the file fail."""
    folder = data / "bad_gltf" / "validator" / "base" / "data" / "image"
    for name in ("invalid_data_uri", "invalid_image_data", "invalid_uri_scheme", "not_found", "png_eos"):
        document = read_json(folder / f"{name}.gltf")
        document["textures"] = [{"source": 0}]
        document["materials"] = [{"emissiveTexture": {"index": 0}}]
        for file in folder.iterdir():
            if file.suffix in (".png", ".jpg"):
                (tmp_path / file.name).write_bytes(file.read_bytes())
        path = tmp_path / f"{name}.gltf"
        path.write_text(json.dumps(document), encoding="utf-8")
        with pytest.raises(SceneError, match="/images/0"):
            load_scene(path, strict=True).images[0].decode()


SAMPLES = [
    "khronos/BoxInterleaved/BoxInterleaved.glb",
    "khronos/CesiumMan/CesiumMan.glb",
    "khronos/Fox/Fox.gltf",
    "khronos/MultipleScenes/MultipleScenes.gltf",
    "khronos/UnicodeTest/Unicode❤♻Test.gltf",
    "khronos/Box With Spaces/Box With Spaces.gltf",
    "khronos/AnimatedMorphCube/AnimatedMorphCube.glb",
    "khronos/Cameras/Cameras.gltf",
    "playcanvas/Lights/Lights.glb",
    "blender_io/24_animation_pointer/24_animation_pointer.gltf",
]
IDS = [Path(s).stem for s in SAMPLES]


@pytest.mark.parametrize("name", SAMPLES, ids=IDS)
def test_counts_agree_with_pygltflib(data: Path, name: str) -> None:
    scene, other = load_scene(data / name), pygltflib.GLTF2().load(str(data / name))
    assert len(scene.nodes) == len(other.nodes)
    assert len(scene.meshes) == len(other.meshes)
    assert len(scene.materials) == len(other.materials)
    assert len(scene.images) == len(other.images)
    assert len(scene.skins) == len(other.skins)
    assert len(scene.cameras) == len(other.cameras)
    assert len(scene.animations) == len(other.animations)
    assert len(scene.scene_names) == len(other.scenes)
    assert len(scene.lights) == len((other.extensions or {}).get("KHR_lights_punctual", {}).get("lights", []))
    for i, node in enumerate(other.nodes):
        for child in node.children or []:
            assert scene.nodes.parent[child] == i
        assert scene.nodes.names[i] == (node.name or "")


def test_interpolation_written_as_a_number(data: Path) -> None:
    scene = load_scene(data / "babylon" / "morphLoader" / "morphLoader.glb")
    assert {c.interpolation for c in scene.channels} == {"LINEAR"}
    assert [(n.kind, n.count) for n in scene.notes] == [("interpolation-number", 7)]


def test_takes_of_one_character_play_one_at_a_time(data: Path) -> None:
    fox = data / "khronos" / "Fox" / "Fox.gltf"
    scene = load_scene(fox)
    assert scene.playing == ("Survey",) and len(scene.animations) == 3
    assert any("--animation" in n.message and "'Run'" in n.message for n in scene.notes)
    assert load_scene(fox, animation=["Run"]).playing == ("Run",)
    assert load_scene(fox, animation=[1]).playing == load_scene(fox, animation=["1"]).playing == ("Walk",)
    with pytest.raises(SceneError):
        load_scene(fox, animation=["Run", "Walk"])
    with pytest.raises(SceneError, match="'Swim'"):
        load_scene(fox, animation=["Swim"])


def test_one_animation_per_object_all_play(data: Path) -> None:
    scene = load_scene(data / "cycles" / "sponza_man" / "sponza_man_camera_lights.glb")
    assert len(scene.playing) == len(scene.animations) >= 2


def test_texture_transform_markers(data: Path) -> None:
    """The asset marks the position of the arrow tip: there the transform gives the texture coordinates of the tip."""
    scene = load_scene(data / "khronos" / "TextureTransformTest" / "TextureTransformTest.gltf")
    for quad, correct, unsupported in ((3, 4, 5), (7, 8, 9)):
        primitive = scene.meshes[scene.nodes.mesh[quad]].primitives[0]
        design = np.c_[primitive.positions[:, :2], np.ones(len(primitive.positions))]
        uv_from_xy = np.linalg.lstsq(design, primitive.texcoords[0], rcond=None)[0]
        shown, tip = (np.r_[scene.nodes.translation[n, :2], 1.0] @ uv_from_xy for n in (correct, unsupported))
        transform = scene.materials[primitive.material].base_color_texture.uv_transform
        np.testing.assert_allclose(transform @ np.r_[shown, 1.0], tip, atol=1e-4)


def test_animation_pointer_file(data: Path) -> None:
    scene = load_scene(data / "blender_io" / "24_animation_pointer" / "24_animation_pointer.gltf")
    targets = {(c.target, c.index, c.path) for c in scene.channels}
    assert {("camera", 3, "yfov"), ("camera", 2, "ymag"), ("light", 0, "color"), ("light", 1, "outer_cone"),
            ("light", 3, "range"), ("node", 44, "scale"), ("node", 43, "weights")} <= targets  # fmt: skip
    assert any("/materials/2/" in n.message for n in scene.notes)


def test_arrays_are_read_only_and_finite(data: Path) -> None:
    scene = load_scene(data / "khronos" / "CesiumMan" / "CesiumMan.glb")
    primitive = scene.meshes[0].primitives[0]
    for array in (primitive.positions, primitive.triangles, primitive.normals, primitive.joints, primitive.weights,
                  scene.skins[0].inverse_bind, scene.nodes.parent, scene.channels[0].times):  # fmt: skip
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    np.testing.assert_allclose(primitive.weights.sum(axis=1), 1.0, atol=1e-6)
    assert primitive.joints.dtype == primitive.triangles.dtype == np.uint32
