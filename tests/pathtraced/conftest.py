from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # helpers shared by the tests of this folder
sys.path.append(str(Path(__file__).parents[1] / "frame"))  # fixed_orbit


@pytest.fixture
def renders(tmp_path):
    """Frames 4 to 6 of a camera that moves to the right above a floor, with noise as light, and its sidecar."""
    from exr_files import HEIGHT, WIDTH, blender_frame, view_at, write

    from taubench_gl.pathtraced.cameras import camera_file_text

    folder = tmp_path / "renders"
    folder.mkdir()
    views = {f: view_at(0.3 * f) for f in (4, 5, 6)}
    for f, v in views.items():
        write(folder / f"frame_{f:04d}.exr", blender_frame(v.position, seed=f)[0])
    (folder / "camera.json").write_text(camera_file_text(views, 30.0, (WIDTH, HEIGHT)))
    return folder


@pytest.fixture(scope="session")
def blender() -> str:
    """The interpreter that has bpy.  Tests that need it are skipped without one."""
    from taubench_gl.pathtraced.blender.process import INTERPRETER, blender_python, blender_version

    python = blender_python()
    if blender_version(python) is None:
        pytest.skip(f"no bpy in {INTERPRETER} or this interpreter")
    return python
