from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # cycles_scenes: helpers shared by the tests of this folder


@pytest.fixture(scope="session")
def blender() -> str:
    """The configured interpreter that has bpy; tests that need it are skipped, by name, where there is none."""
    from taubench_gl.cycles.render import INTERPRETER, blender_python, blender_version

    python = blender_python()
    if blender_version(python) is None:
        pytest.skip(f"no bpy in {INTERPRETER} or this interpreter")
    return python
