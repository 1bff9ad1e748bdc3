"""The error that every reader of a text format raises: one line, with file, line number and the offending value."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene


def refused(path: Path, line: int, value: object = "", file: str | None = None) -> None:
    """Strict loading fails at ``line`` of ``file`` (default: ``path`` itself); the message contains ``value``."""
    with pytest.raises(SceneError) as caught:
        load_scene(path, strict=True)
    error = caught.value
    assert error.where == f"{file or path.name}:{line}" and str(value) in error.what, str(error)
    assert "\n" not in str(error)


def notes_about(scene, *values: object) -> list[str]:
    """``where`` of every note of the scene that contains all ``values``."""
    return [note.where for note in scene.notes if all(str(value) in note.message for value in values)]
