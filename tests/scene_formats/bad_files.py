"""What every reader of a text format owes: one line that names the file, the line and the fault."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.errors import SceneError
from taubench_gl.scene import load_scene


def refused(path: Path, line: int, what: str, named: str | None = None) -> None:
    """Loading ``path`` fails in one line that begins with ``named`` (by default the file itself) and ``line``."""
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    message = str(caught.value)
    assert message.startswith(f"{named or path.name}:{line}: ") and what in message and "\n" not in message, message
