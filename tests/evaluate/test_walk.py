"""Every shared scene, evaluated at a small size: a consistent Run, or one error."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from fixed import fixed_settings

from taubench_gl.errors import SceneError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.run import Run, load_run
from taubench_gl.run_schema import COUNT_COLUMNS
from taubench_gl.scene import load_scene

SETTINGS = {"width": 96, "height": 54, "frames": (0, 3), "shadow_size": 64, "indirect": "none"}
POINTS_AND_LINES = (0, 1, 2, 3, 7, 8, 9, 10)
NOTHING_TO_DRAW = {f"Mesh_PrimitiveMode_{i:02}" for i in POINTS_AND_LINES} | {"sponza_man_camera_lights"}
STATISTICS = {"mean", "variance", "max", "median", "p95"}


def assert_consistent(run: Run, pixels: int) -> None:
    """Classes partition the image, reasons stay within their class, and counts are integers in range."""
    for row in run.frames:
        for name in COUNT_COLUMNS:
            assert row[name] is None or (isinstance(row[name], int) and 0 <= row[name] <= pixels), (name, row[name])
        assert row["pixels"] == pixels
        assert row["first"] + row["cut"] + row["invalid"] + row["frustum"] + row["comparable"] == pixels
        assert row["behind"] + row["outside"] == row["frustum"]
        assert row["invalid"] == 0
        for name in ("position", "normal", "direct", "indirect", "color"):
            assert row[name] is None or row[name] <= row["comparable"]
        if row["position"] is not None:
            assert row["disoccluded"] + row["occluding"] <= row["position"]
        if row["direct"] is not None:
            assert row["lit"] + row["shadowed"] <= row["direct"]


def assert_summary(summary: dict, pairs: int) -> None:
    """Statistics and shares are numbers in range, or None with a reason; load_run checks that all are there."""
    for quantity in ("position", "yaw", "pitch", "roll", "angle"):
        for name in STATISTICS:
            value = summary["camera"][quantity][name]
            assert value is None if pairs == 0 else math.isfinite(value)
    for column, entry in summary["discard"].items():
        if entry["mean_percent"] is None:
            assert entry["reason"], column
        else:
            assert 0 <= entry["mean_percent"] <= entry["max_percent"] <= 100


def test_every_scene(sampled_scene: Path, tmp_path) -> None:
    path = sampled_scene
    if path.stem in NOTHING_TO_DRAW:
        with pytest.raises(SceneError) as caught:
            evaluate_scene(path, fixed_settings(**SETTINGS), out=tmp_path / "out")
        assert "\n" not in str(caught.value) and caught.value.hint
        assert not (tmp_path / "out").exists()
        return
    run = evaluate_scene(path, fixed_settings(**SETTINGS), out=tmp_path / "out")
    pairs = len(run.frames)
    assert pairs == run.summary["pairs"] <= 2
    still_with_camera = run.summary["scene"]["duration_s"] == 0 and "orbit" not in run.summary["camera"]["source"]
    assert pairs == (0 if still_with_camera else 2)
    assert_consistent(run, 96 * 54)
    assert_summary(run.summary, pairs)
    again = load_run(tmp_path / "out")
    assert again.summary == json.loads(json.dumps(run.summary, default=lambda x: x.tolist()))
    assert again.frames == run.frames
    if "orbit" in run.summary["camera"]["source"]:
        assert any("orbit" in note for note in run.summary["notes"])


def test_every_scene_with_motion_reprojection(sampled_scene: Path) -> None:
    """Motion reprojection is consistent, and equals camera reprojection where no surface moves."""
    if sampled_scene.stem in NOTHING_TO_DRAW:
        return
    scene = load_scene(sampled_scene)
    tiny = {"width": 64, "height": 36, "frames": (0, 3), "columns": ("frustum", "position", "normal")}
    bilinear = evaluate_scene(scene, fixed_settings(**tiny, reprojection="motion", sampling="bilinear"))
    assert_consistent(bilinear, 64 * 36)
    if not bilinear.summary["effects"]["previous_pose"]["on"]:
        camera, motion = (evaluate_scene(scene, fixed_settings(**tiny, reprojection=r)) for r in ("camera", "motion"))
        assert camera.frames == motion.frames
        # Simulating it anyway changes no count.
        forced = evaluate_scene(scene, fixed_settings(**tiny, reprojection="motion", effects="all", indirect="none",
                                                shadow_size=64))  # fmt: skip
        keys = ("frustum", "comparable", "position", "normal", "disoccluded", "occluding")
        assert [[row[k] for k in keys] for row in forced.frames] == [[row[k] for k in keys] for row in camera.frames]
