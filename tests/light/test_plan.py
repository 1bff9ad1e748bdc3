"""What the plan says before anything is drawn is what a frame then is: channels, shaders, textures, bytes."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest
from light_tools import opened, shoot
from test_effects_on_demand import everything

from taubench_gl.apps.inspect_command import describe
from taubench_gl.conventions import COLUMNS
from taubench_gl.frame.plan import FramePlan, frame_channels
from taubench_gl.scene import load_scene
from taubench_gl.selftest.scenes import busy_room, lamp_field
from taubench_gl.settings import Settings

ASSETS = Path(__file__).resolve().parents[2] / "assets"
SIZE = {"width": 64, "height": 48, "shadow_size": 64}
CASES = {
    "everything, all columns": (everything, {}),
    "everything, no light": (everything, {"columns": ("frustum", "position")}),
    "everything, direct": (everything, {"columns": ("direct",)}),
    "everything, rsm and a sky": (everything, {"indirect": "rsm", "sky": (0.1, 0.1, 0.1)}),
    "everything, indirect alone": (everything, {"columns": ("indirect",)}),
    "a dark room in motion": (busy_room, {"reprojection": "motion"}),
    "a lit room in motion": (lambda: busy_room(lamps=3), {"reprojection": "motion"}),
    "many lights": (lambda: lamp_field(3, 20, cells=4), {"columns": ("direct", "color"), "indirect": "none"}),
}


@pytest.mark.parametrize("case", CASES)
def test_the_plan_is_what_is_made(gpu, case):
    make, asked = CASES[case]
    scene, asked = make(), SIZE | {"columns": COLUMNS} | asked
    check(gpu, scene, asked)


REAL = ("CesiumMan.glb", "LightsPunctualLamp.gltf", "AlphaBlendModeTest.glb", "04_lights.gltf")


@pytest.mark.parametrize("name", REAL)
def test_real_scenes_are_planned_right(gpu, data, name):
    (path,) = data.rglob(name)
    check(gpu, load_scene(path), SIZE | {"columns": COLUMNS})


def test_the_demo_is_planned_right(gpu):
    check(gpu, load_scene(ASSETS / "demo.glb"), SIZE | {"columns": COLUMNS})


def check(gpu, scene, asked) -> None:
    settings = Settings.of(**asked)
    plan = FramePlan(scene, settings)
    needs = plan.needs(plan.effects)
    with opened(gpu, scene, **asked) as source:
        shoot(source, 0)
        assert source.effects == plan.effects
        assert source.channels == frame_channels(plan.effects)
        made = Counter(name.split(" [")[0] for name in source.renderer.shaders.names)
        pools = source.renderer.buffers.bytes - needs.memory.get("previous vertices", 0)
        held = source.describe()["memory"]["gpu_bytes"]
    planned = Counter(name.split(" [")[0] for name in needs.shaders if not name.startswith("masks/"))
    if "indirect/voxelize.frag.glsl" in planned:
        made = Counter({n.split(" + ")[-1] if "voxelize" in n else n: c for n, c in made.items()})
        made["indirect/voxelize.frag.glsl"] = 1  # of posed and of fixed draws
    assert made == planned
    assert sum(needs.memory.values()) + pools == held


def test_inspect_tells_effects_as_json():
    facts = json.loads(json.dumps(describe(everything(), Settings.of(**SIZE))))
    assert facts["effects"]["shadows"]["on"] is True and facts["effects"]["shadows"]["gpu_bytes"] > 0
    assert facts["effects"]["skinning"] == {
        "on": False, "reason": "no skins deform drawn meshes", "passes": [], "textures": [], "shaders": [],
        "gpu_bytes": 0,
    }  # fmt: skip


def test_costs_are_what_a_frame_loses_without_the_effect():
    costs = FramePlan(everything(), Settings.of(**SIZE)).costs()
    pixels = SIZE["width"] * SIZE["height"]
    assert costs["color"]["on"] and costs["color"]["passes"] == ["color"]
    assert costs["shadows"]["textures"] == ["indirect", "indirect buffers", "shadow atlas"]  # indirect rests on shadows
    assert costs["previous_pose"] == {
        "on": False,
        "reason": "the reprojection is 'camera'",
        "passes": [],
        "textures": ["prev_position"],
        "shaders": costs["previous_pose"]["shaders"],
        "gpu_bytes": 2 * 16 * pixels,
    }
    assert costs["normal_maps"]["textures"] == ["image 0"] and costs["normal_maps"]["gpu_bytes"] == 4 * 4 * 4 * 4 // 3
    assert costs["spot_lights"]["on"] is False and costs["spot_lights"]["gpu_bytes"] == 0
