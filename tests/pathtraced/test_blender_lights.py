"""Direct light of scenes that Blender wrote, at the defaults, against Cycles' renders of the same scenes."""

from __future__ import annotations

import pytest
from blender_light_scenes import FOLDER, columns, scene_names

from taubench_gl.scene import load_scene

LIMIT = 0.7  # percentage points


@pytest.mark.parametrize("name", scene_names())
def test_the_direct_column_is_that_of_cycles(name):
    ours, cycles = columns(name)
    assert load_scene(FOLDER / f"{name}.glb").generator.startswith("Khronos glTF Blender I/O v4.5")
    assert ours.summary["settings"]["light_unit"] == "watt" and ours.summary["settings"]["exposure"] == 1.0
    assert ours.summary["settings"]["environment"] == "none"
    assert ours.summary["pairs"] == cycles.summary["pairs"] == 4
    a, b = (run.summary["discard"] for run in (ours, cycles))
    assert b["direct"]["mean_percent"] > 5.0, "too little changes for a comparison"
    assert a["direct"]["mean_percent"] == pytest.approx(b["direct"]["mean_percent"], abs=LIMIT)
    for column in ("frustum", "position"):
        assert a[column]["mean_percent"] == pytest.approx(b[column]["mean_percent"], abs=0.02)
