"""The demo scene: size, license and contents."""

from __future__ import annotations

from fixed import fixed_settings

from taubench_gl.evaluation import evaluate_scene
from taubench_gl.paths import PACKAGE
from taubench_gl.scene import load_scene

ROOT = PACKAGE.parent
DEMO = ROOT / "assets" / "demo.glb"


def test_demo_scene_is_small_and_licensed() -> None:
    assert DEMO.stat().st_size < 300_000
    assert "CC0-1.0" in (ROOT / "assets" / "README.md").read_text()
    scene = load_scene(DEMO)
    assert 2.0 <= scene.duration <= 3.0
    assert not scene.notes, [str(n) for n in scene.notes]
    assert len(scene.playing) == len(scene.animations) == 6


def test_demo_scene_has_every_feature() -> None:
    run = evaluate_scene(DEMO, fixed_settings(width=64, height=36, shadow_size=64, indirect="none", pairs="every:4"))
    census = run.summary["census"]
    assert census["armatures"] == 1 and census["bones"] == 6 and census["morphs"] == 1
    assert census["dynamic_rigid_objects"] >= 6 and census["static_rigid_objects"] >= 6
    assert census["static_point_lights"] == 2 and census["dynamic_point_lights"] == 2
    camera = run.summary["camera"]
    assert camera["position"]["mean"] > 0.05 and camera["yaw"]["mean"] > 0.5 and camera["cuts"] == []
    for column in ("frustum", "position", "normal", "direct", "color"):
        share = run.summary["discard"][column]["mean_percent"]
        assert share is not None and 0.1 < share < 50, column
    assert all(row["invalid"] == 0 for row in run.frames)
    assert max(row["behind"] for row in run.frames) == 0
