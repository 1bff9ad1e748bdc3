"""What is said of a name that is no scene."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene


@pytest.mark.parametrize(
    ("files", "says"),
    [
        ([], "is a folder with nothing in it (give a file (.aff, .glb, .gltf, .nff, .obj), or numbered .obj files)"),
        ([".hidden"], "is a folder with nothing in it"),
        (["a.txt"], "is a folder without a scene"),
        (["b.gltf", "a.glb", "a.bin"], "is a folder, with a.glb and 1 more in it (name one file)"),
        (["a_0001.exr"], "is a folder of EXR files (path-traced frames are exr:"),
    ],
)
def test_a_folder_says_what_is_in_it(tmp_path: Path, files, says: str):
    for name in files:
        (tmp_path / name).touch()
    with pytest.raises(SceneError) as caught:
        load_scene(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path}: {says}")


def test_no_name_at_all(tmp_path: Path, monkeypatch):
    """Not the current folder, whatever is in it."""
    (tmp_path / "a0001.obj").touch()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError, match="no scene was named"):
        load_scene("")
