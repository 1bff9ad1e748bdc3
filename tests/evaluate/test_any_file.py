"""Files of any origin at the default options: six columns, an image neither black nor white, the reuse rate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.features import COLUMNS
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_metering")

SIZE = {"width": 64, "height": 36, "frames": (0, 2), "shadow_size": 64, "probes": 32}
NO_LIGHT = (
    "BoxAnimated/BoxAnimated.glb",  # animated, no camera
    "Duck/Duck.glb",  # still, with a camera
    "Fox/Fox.gltf",  # skinned, 155 m long
    *(
        pytest.param(name, marks=pytest.mark.long)
        for name in (
            "BoxInterleaved/BoxInterleaved.glb",  # still, saturated color
            "MorphStressTest/MorphStressTest.glb",
            "NegativeScaleTest/NegativeScaleTest.glb",  # the sun in a mirror
            "TwoSidedPlane/TwoSidedPlane.gltf",
        )
    ),
)
OWN_LIGHT = (
    "tauray_test/test.glb",
    "playcanvas/Lights/Lights.glb",
    "khronos/LightsPunctualLamp/LightsPunctualLamp.gltf",
)


def evaluated(scene: Scene | Path, **settings):
    """The summary, and color and surface of the surface pixels of the last pair."""
    kept = {}

    def keep(pair) -> None:
        surface = pair.source.read("position")[..., 3] > 0
        kept["color"] = pair.source.read("color")[surface][:, :3]

    run = evaluate_scene(scene, Settings(**(SIZE | settings)), observers=Observers(on_pair=keep))
    return run.summary, kept["color"]


def check(summary, color) -> None:
    for column in COLUMNS:
        assert summary["discard"][column]["mean_percent"] is not None, column
    for kind in ("surface", "shading"):
        assert 0.0 < summary["reusable"][kind]["mean_percent"] <= 100.0
    assert len(color) > 100, "the subject is too small"
    assert np.mean(color.max(axis=-1) < 1 / 255) < 0.2, "the image is black"
    assert np.mean(color.min(axis=-1) >= 1.0) < 0.2, "the image is white"
    assert 0.1 < color.mean() < 0.9


@pytest.mark.parametrize("name", NO_LIGHT)
def test_a_file_without_light(data, name):
    summary, color = evaluated(data / "khronos" / name)
    assert summary["settings"]["environment"] == "default" and summary["settings"]["exposure"] != 1.0
    check(summary, color)


@pytest.mark.parametrize("name", OWN_LIGHT)
def test_a_file_with_lights_of_any_exporter(data, name):
    summary, color = evaluated(data / name)
    assert summary["settings"]["environment"] == "none" and summary["settings"]["light_unit"] == "candela"
    check(summary, color)
