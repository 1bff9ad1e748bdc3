"""``Scene.sha256`` covers exactly the files that a scene is read from."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import pytest
from gltf_builders import png
from gltf_files import Gltf

from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene
from taubench_gl.scene.files import Identity


def gltf(folder: Path) -> Path:
    """A triangle with a buffer and two images; a third image is in the file, but no material samples it."""
    made = Gltf()
    for index, name in enumerate(("color.png", "glow.png", "idle.png")):
        (folder / name).write_bytes(png(color=(index, 0, 0)))
        made.add("textures", {"source": made.add("images", {"uri": name})})
    texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "emissiveFactor": [1, 1, 1]}
    made.add("materials", texture | {"emissiveTexture": {"index": 1}})
    made.node(mesh=made.mesh())
    made.json["meshes"][0]["primitives"][0]["material"] = 0
    made.json["buffers"] = [{"byteLength": len(made.blob), "uri": "data.bin"}]
    (folder / "data.bin").write_bytes(made.blob)
    return made.save(folder)


def texts(folder: Path, **files: str) -> Path:
    """A scene in text ``files`` (name, _ for the dot -> text; the first is the scene) with two images."""
    for name in ("color.png", "idle.png"):
        (folder / name).write_bytes(png())
    paths = [folder / name.replace("_", ".") for name in files]
    for path, text in zip(paths, files.values(), strict=True):
        path.write_text(text)
    return paths[0]


def obj(folder: Path) -> Path:
    triangle = "mtllib colors.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl one\nf 1 2 3\n"
    return texts(folder, scene_obj=triangle, colors_mtl="newmtl one\nKd 1 1 1\nmap_Kd color.png\n")


def aff(folder: Path) -> Path:
    return texts(folder, scene_aff="i 0 part.aff\n", part_aff="tt color.png 0 0 0 0 1  1 0 0 1 1  0 1 0 0 0\n")


CASES = [
    pytest.param(gltf, "data.bin", True, id="glTF buffer"),
    pytest.param(gltf, "color.png", True, id="glTF texture"),
    pytest.param(gltf, "glow.png", True, id="glTF second texture"),
    pytest.param(gltf, "idle.png", False, id="glTF image that is not sampled"),
    pytest.param(obj, "colors.mtl", True, id="OBJ materials"),
    pytest.param(obj, "color.png", True, id="OBJ texture"),
    pytest.param(obj, "idle.png", False, id="file beside an OBJ"),
    pytest.param(aff, "part.aff", True, id="AFF include"),
    pytest.param(aff, "color.png", True, id="AFF texture"),
    pytest.param(aff, "idle.png", False, id="file beside an AFF"),
]


@pytest.mark.parametrize(("make", "name", "counts"), CASES)
def test_changed_file_changes_the_identity(
    tmp_path: Path, make: Callable[[Path], Path], name: str, counts: bool
) -> None:
    path = make(tmp_path)
    before = load_scene(path).sha256
    old = (tmp_path / name).read_bytes()
    # The same size, which a comparison of size and time can miss; else a comment, or bytes that a buffer may have.
    new = png(color=(200, 100, 50)) if name.endswith(".png") else old + b"# another\n"
    assert new != old
    (tmp_path / name).write_bytes(new)
    assert (load_scene(path).sha256 != before) == counts
    (tmp_path / name).write_bytes(old)
    assert load_scene(path).sha256 == before


@pytest.mark.parametrize(("make", "files"), [(gltf, 4), (obj, 3), (aff, 3)])
def test_identity_is_independent_of_the_folder(tmp_path: Path, make: Callable[[Path], Path], files: int) -> None:
    (tmp_path / "here").mkdir()
    path = make(tmp_path / "here")
    shutil.copytree(tmp_path / "here", tmp_path / "there")
    here, there = load_scene(path), load_scene(tmp_path / "there" / path.name)
    assert here.sha256 == there.sha256 and here.files == there.files == files


def test_exchanged_images_change_the_identity(tmp_path: Path) -> None:
    path = gltf(tmp_path)
    before = load_scene(path).sha256
    color, glow = ((tmp_path / name).read_bytes() for name in ("color.png", "glow.png"))
    (tmp_path / "color.png").write_bytes(glow)
    (tmp_path / "glow.png").write_bytes(color)
    assert load_scene(path).sha256 != before


def test_identity_of_a_single_file_is_its_checksum(tmp_path: Path) -> None:
    made = Gltf()
    made.node(mesh=made.mesh())
    path = made.save(tmp_path)
    scene = load_scene(path)
    assert (scene.sha256, scene.files) == (sha256(path.read_bytes()).hexdigest(), 1)


def test_files_are_added_once_and_in_order(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"a" * (3 << 20))  # larger than one block
    identity = Identity()
    identity.add(b"first")
    for _ in range(2):
        identity.add_file(tmp_path / "a")
    assert identity.hexdigest() == sha256(b"first" + b"a" * (3 << 20)).hexdigest() and identity.files == 2
    with pytest.raises(SceneError, match="gone"):
        identity.add_file(tmp_path / "gone")
