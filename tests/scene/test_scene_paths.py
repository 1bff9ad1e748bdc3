"""Paths that do not name a scene: the error lists what the folder contains."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.errors import SceneError
from taubench_gl.scene import READERS, load_scene


@pytest.mark.parametrize(
    ("files", "named"),
    [
        ([], tuple(READERS)),
        ([".hidden"], tuple(READERS)),
        (["a.txt"], tuple(READERS)),
        (["b.gltf", "a.glb", "a.bin"], ("a.glb", "1")),
        (["a_0001.exr"], ("exr:",)),
    ],
)
def test_folder_that_is_no_scene(tmp_path: Path, files, named):
    """The error names the scenes inside, the exr: form, or the suffixes that can be read."""
    for name in files:
        (tmp_path / name).touch()
    with pytest.raises(SceneError) as caught:
        load_scene(tmp_path)
    assert caught.value.where == str(tmp_path) and "\n" not in str(caught.value)
    assert all(name in f"{caught.value.what} {caught.value.hint}" for name in named)


def test_empty_name(tmp_path: Path, monkeypatch):
    """An empty name is not the current folder, even where that is a sequence."""
    (tmp_path / "a0001.obj").touch()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError) as caught:
        load_scene("")
    assert caught.value.where is None


@pytest.mark.parametrize("name", ["exr:renders", "exr:", "exr:renders/name*.exr"])
def test_path_traced_frames_are_no_scene(tmp_path: Path, monkeypatch, name: str):
    """Frames are refused as a scene, with and without a folder of that name."""
    (tmp_path / "exr:renders").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError) as caught:
        load_scene(name)
    assert caught.value.where == name and "evaluate" in caught.value.hint and "\n" not in str(caught.value)
