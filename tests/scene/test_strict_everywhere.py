"""``--strict`` reaches every command that reads scenes, and the API."""

from __future__ import annotations

from pathlib import Path

import pytest
from gltf_files import Gltf

import taubench_gl
from taubench_gl.errors import SceneError
from taubench_gl.settings import Settings


@pytest.fixture
def departed(tmp_path: Path) -> Path:
    """A triangle with a rotation of length 2."""
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(), rotation=[0, 0, 0, 2])
    return gltf.save(tmp_path)


@pytest.mark.parametrize(
    "command",
    ["inspect", "evaluate --out OUT", "export --format npz --out OUT", "cost --out OUT",
     "reuse evaluate --methods none --out OUT", "stress --out OUT.glb", "reference render --out OUT"],
)  # fmt: skip
def test_commands(departed: Path, tmp_path: Path, command: str, taubench) -> None:
    words = command.replace("OUT", str(tmp_path / "out")).split()
    names = 2 if words[0] in ("reuse", "reference") else 1
    code, _, err = taubench(*words[:names], departed, *words[names:], "--strict")
    assert code == 2 and "/nodes/0/rotation" in err


def test_inspect_notes_the_repair(departed: Path, taubench) -> None:
    code, out, err = taubench("inspect", departed)
    assert code == 0 and "rotation of another length" in " ".join((out + err).split())


def test_api(departed: Path) -> None:
    for call in (taubench_gl.evaluate, lambda path, **more: next(taubench_gl.pairs(path, **more))):
        with pytest.raises(SceneError):
            call(departed, strict=True)
    with pytest.raises(SceneError):
        taubench_gl.load_scene(departed, strict=True)
    assert taubench_gl.load_scene(departed).notes[0].kind == "quaternion-length"


def test_the_summary_has_the_note(departed: Path) -> None:
    run = taubench_gl.evaluate(departed, size="16x9", frames="0:2", columns="position")
    assert any("rotation of another length" in note for note in run.summary["notes"])
    assert "strict" not in run.summary["settings"] and Settings(strict=True).to_dict()["strict"] is True
