"""The rasterizer against small stored Cycles renders, geometry only.

tools/cycles_references renders them.  The long test (test_cycles.py) renders these and more scenes again.
"""

from __future__ import annotations

import json

import pytest
from reference_scenes import CASES, POSITION_M, REFERENCES, PanCamera, compare, faults, open_case, reference_frames

STORED = [name for name, case in CASES.items() if case.stored]


@pytest.mark.parametrize("name", STORED)
def test_geometry_agrees_with_cycles(data, name):
    case, folder = CASES[name], REFERENCES / name
    if not (data / case.path).is_file():
        pytest.skip(f"no {case.path} among the real scenes")
    scene, camera = open_case(case, data)
    model = json.loads((folder / "camera.json").read_text())
    assert (model["model"], model["sha256"]) == (case.path, scene.sha256), "run tools/cycles_references: other model"
    result = compare(scene, camera, folder, reference_frames(case))
    assert not list(faults(result)), result


def test_another_camera_fails_the_comparison(data):
    """A camera at another position exceeds the limits."""
    case = CASES["rigid"]
    scene, _ = open_case(case, data)
    result = compare(scene, PanCamera(scene, degrees=0.0), REFERENCES / "rigid", reference_frames(case))
    assert result["position_m"] > POSITION_M and list(faults(result))


def test_masks_do_not_depend_on_mipmaps(data):
    """A pixel-center sample of a path tracer reads the finest texels, and so does an alpha mask with mipmaps."""
    case = CASES["alpha_masked"]
    scene, camera = open_case(case, data)
    folder, frames = REFERENCES / "alpha_masked", reference_frames(case)
    assert abs(compare(scene, camera, folder, frames, "mipmapped")["position"]) < 0.02
