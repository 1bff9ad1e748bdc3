"""Files as people download them (``reports4/sweep``): avatars, Draco of other writers, pointers, pages, old files."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from gltf_builders import notes_about, refuse
from gltf_files import triangle_scene

from taubench_gl.animation import choose_camera
from taubench_gl.animation.views import UNUSED_CAMERAS, OrbitCamera
from taubench_gl.errors import SceneError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.scene import CONVERTIBLE, READERS, load_scene
from taubench_gl.settings import Settings


@pytest.fixture
def sweep(data: Path) -> Path:
    return data / "reports4" / "sweep"


@pytest.mark.parametrize("name", ["avatar10.vrm", "avatar00.vrm"])
def test_avatars_are_binary_gltf(sweep: Path, tmp_path: Path, name: str) -> None:
    shutil.copyfile(sweep / name, tmp_path / "same.glb")
    scene, same = load_scene(sweep / name), load_scene(tmp_path / "same.glb")
    assert [len(p.triangles) for m in scene.meshes for p in m.primitives] == [1]
    assert [n.message for n in scene.notes] == [n.message for n in same.notes] and scene.notes


def test_draco_data_with_more_vertices_than_declared(sweep: Path) -> None:
    """Other readers take it: a box, from the compressed data."""
    pytest.importorskip("DracoPy")
    scene = load_scene(sweep / "draco_more_vertices.glb")
    (primitive,) = scene.meshes[0].primitives
    assert primitive.positions.shape == (24, 3) and len(primitive.triangles) == 12
    np.testing.assert_allclose(np.abs(primitive.positions), 0.5, atol=1e-3)
    assert notes_about(scene, "24 for 20") == ["/meshes/0/primitives/0"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("lfs_pointer.glb", "Git LFS pointer"),
        ("page.glb", "web page (HTML), not a glTF file"),
        ("version1.gltf", "glTF 1.0, only 2.0"),
    ],
)
def test_files_that_are_something_else_are_named(sweep: Path, name: str, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(sweep / name)
    assert words in caught.value.what and Path(caught.value.where).name == name and caught.value.hint


def test_known_endings_are_all_that_is_read() -> None:
    error = refuse(Path("model.xyz"), "", ".xyz")
    assert all(suffix in error.hint for suffix in (*READERS, *CONVERTIBLE))


def test_cameras_that_no_node_refers_to(tmp_path: Path) -> None:
    gltf = triangle_scene()
    for _ in range(2):
        gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}})
    path = gltf.save(tmp_path)
    scene = load_scene(path)
    camera = choose_camera(scene)
    assert isinstance(camera, OrbitCamera) and camera.reason == UNUSED_CAMERAS
    assert notes_about(scene, 2, "camera") == ["/cameras"]


@pytest.mark.usefixtures("coarse_light")
def test_a_scene_whose_surfaces_all_have_opacity_0(tmp_path: Path) -> None:
    """One note says so, and none is about light units."""
    gltf = triangle_scene()
    pbr = {"baseColorFactor": [1, 1, 1, 0]}
    gltf.add("materials", {"name": "glass", "alphaMode": "BLEND", "pbrMetallicRoughness": pbr})
    gltf.json["meshes"][0]["primitives"][0]["material"] = 0
    gltf.json["asset"]["generator"] = "Khronos glTF Blender I/O v4.5.51"  # unit watt
    settings = Settings(size=(64, 36), columns=("direct",), light="preview", frames=(0, 3))
    notes = evaluate_scene(gltf.save(tmp_path), settings).summary["notes"]
    assert sum("opacity 0" in note for note in notes) == 1
    assert not any("--light-unit" in note or "exposure" in note for note in notes)
