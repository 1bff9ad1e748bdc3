"""Whole evaluations: repeated, sliced, interrupted, in constant memory, and with invalid arguments."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.animation import OrbitCamera
from taubench_gl.errors import OutputError, TaubenchError
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.features import COLUMNS
from taubench_gl.metrics.reuse_rate import RATES
from taubench_gl.paths import PACKAGE
from taubench_gl.run import FRAMES_FILE, SUMMARY_FILE, Run, load_run, read_frames
from taubench_gl.run_schema import COUNT_COLUMNS
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
GEOMETRY = ("frustum", "position", "normal")
LIGHT = {"shadow_size": 64, "probes": 64, "indirect_samples": 128, "light": "raster"}


def settings(**changes) -> Settings:
    return fixed_settings(**({"width": 96, "height": 54, "frames": (0, 6), "columns": GEOMETRY} | changes))


@pytest.fixture(scope="module")
def demo_run(coarse_light: None) -> Run:
    """The demo with ``settings()``, for tests that only read it."""
    return evaluate_scene(DEMO, settings())


def test_repeated_run_gives_the_same_counts(demo_run: Run) -> None:
    assert evaluate_scene(DEMO, settings()).frames == demo_run.frames
    changes = {"columns": COLUMNS, "reprojection": "motion", "sampling": "bilinear", **LIGHT}
    first, second = (evaluate_scene(DEMO, settings(**changes)) for _ in range(2))
    assert first.frames == second.frames
    for block in ("discard", "classes", "curves", "camera", "census"):
        assert first.summary[block] == second.summary[block]


@pytest.mark.parametrize("changes", [{}, {"reprojection": "motion"}])
def test_slices_give_the_rows_of_the_whole_run(changes) -> None:
    """A pose depends on time alone: the pair of frame 20 is the same whether or not frames 0 to 18 were drawn."""
    whole = {row["frame"]: row for row in evaluate_scene(DEMO, settings(frames=(None, None), **changes)).frames}
    assert sorted(whole) == list(range(1, 61))
    for first, stop in ((0, 2), (19, 24), (-3, None), (30, 31)):
        part = evaluate_scene(DEMO, settings(frames=(first, stop), **changes)).frames
        expected = range(61)[slice(first, stop)]
        assert [row["frame"] for row in part] == list(expected)[1:]
        for row in part:
            # A camera cut is detected against neighboring pairs, which a slice does not have.
            same = {k: v for k, v in whole[row["frame"]].items() if k != "camera_cut"}
            assert {k: v for k, v in row.items() if k != "camera_cut"} == same


def test_half_and_twice_the_exposure_are_those_of_runs_at_them() -> None:
    """Each curve is exact at the edges of its bins, so the values lie as close as the pixels of one bin."""
    runs = {factor: evaluate_scene(DEMO, settings(columns=COLUMNS, exposure=2.0 * factor, **LIGHT)).summary
            for factor in (0.5, 1, 2)}  # fmt: skip
    discard, pixels = runs[1]["discard"], 5 * 96 * 54
    for column in ("direct", "indirect"):
        curve, threshold = runs[1]["curves"][column], runs[1]["settings"]["thresholds"][column]
        for key, factor in (("at_half_exposure_percent", 0.5), ("at_twice_exposure_percent", 2)):
            found, expected = discard[column][key], runs[factor]["discard"][column]["mean_percent"]
            index = np.searchsorted(curve["edges"], threshold / factor, side="right")
            assert abs(found - expected) <= 100.0 * curve["counts"][index] / pixels
            assert abs(found - expected) < 0.2 < abs(found - discard[column]["mean_percent"])
    assert not any("exposure" in key for column in ("color", "position") for key in discard[column])


def test_shares_of_surface_pixels_are_totals_of_the_rows_whichever_pairs() -> None:
    for pairs in ("all", "every:2", "strata:2"):
        run = evaluate_scene(DEMO, settings(columns=COLUMNS, pairs=pairs, frames=(0, 9), **LIGHT))
        block = run.summary["reusable"]
        total = {name: sum(row[name] for row in run.frames) for name in COUNT_COLUMNS}  # strata of one size
        surface = total["pixels"] - total["sky"]
        assert 0 < total["sky"] < surface
        for rate in ("surface", "shading"):
            reusable = total[f"reusable_{rate}"]
            assert block[rate]["mean_percent"] == pytest.approx(100.0 * reusable / surface)
            assert block[rate]["of_picture_percent"] == pytest.approx(100.0 * reusable / total["pixels"])
        assert block["sky_percent"] == pytest.approx(100.0 * total["sky"] / total["pixels"])
        shares = [entry["mean_percent"] for entry in block["reasons"].values()]
        assert sum(shares) + block["shading"]["mean_percent"] == pytest.approx(100.0)
        if pairs != "all":
            assert all(run.summary["sampling"]["reusable"][rate]["half_width_points"] > 0 for rate in RATES)


def test_means_are_means_of_the_rows(demo_run: Run) -> None:
    run = demo_run
    for column in GEOMETRY:
        shares = [100.0 * row[column] / row["pixels"] for row in run.frames]
        entry = run.summary["discard"][column]
        assert entry["mean_percent"] == pytest.approx(np.mean(shares), rel=1e-12)
        assert entry["max_percent"] == pytest.approx(max(shares), rel=1e-12)
    for feature in ("position", "normal"):
        curve = run.summary["curves"][feature]
        assert sum(curve["counts"]) == sum(row["comparable"] for row in run.frames) == curve["comparable"]
        # The table is one point of the curve.
        threshold = run.summary["settings"]["thresholds"][feature]
        above = int(np.searchsorted(curve["edges"], threshold))
        total = sum(row[feature] for row in run.frames)
        assert curve["at_or_above"][above] <= total <= curve["at_or_above"][above - 1]


def test_an_interrupt_keeps_the_finished_pairs(tmp_path: Path, demo_run: Run) -> None:
    seen = []

    def stop_at_third(pair) -> None:
        seen.append(pair.frame)
        if len(seen) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate_scene(DEMO, settings(), Observers(on_pair=stop_at_third), out=tmp_path / "run")
    assert not (tmp_path / "run" / SUMMARY_FILE).exists()
    rows = read_frames(tmp_path / "run" / FRAMES_FILE)
    assert [row["frame"] for row in rows] == [1, 2, 3]
    for row, expected in zip(rows, demo_run.frames, strict=False):
        known = {k: v for k, v in row.items() if k != "camera_cut"}  # filled in when the sequence is complete
        assert known == {k: v for k, v in expected.items() if k != "camera_cut"}
    with pytest.raises(OutputError) as caught:
        load_run(tmp_path / "run")
    assert caught.value.where == str(tmp_path / "run")
    # The next run in the same process is not affected.
    assert evaluate_scene(DEMO, settings(), out=tmp_path / "run").frames == demo_run.frames
    assert load_run(tmp_path / "run").frames == demo_run.frames


def test_a_still_camera_that_is_requested_has_one_frame_and_no_pair(data: Path) -> None:
    run = evaluate_scene(data / "tauray_test" / "test.glb", settings(frames=(None, None), camera=0))
    assert run.summary["pairs"] == 0 and run.frames == []
    for entry in run.summary["discard"].values():
        assert entry["mean_percent"] is None and entry["reason"]
    json.dumps(run.summary, allow_nan=False)


def test_a_still_scene_with_a_camera_is_seen_from_an_orbit(data: Path) -> None:
    small = settings(frames=(0, 4), columns=("frustum", "position"), unit_scale=2.0)
    scene = load_scene(data / "tauray_test" / "test.glb")
    run, orbit = evaluate_scene(scene, small), evaluate_scene(scene, small.replace(camera="orbit"))
    assert run.summary["pairs"] == 3 and run.frames == orbit.frames
    step = OrbitCamera(scene, size=(96, 54)).step / 2.0
    assert run.summary["camera"]["position"]["mean"] == pytest.approx(step)
    assert f"{step:.4g} m" in run.summary["camera"]["source"]
    assert run.summary["discard"]["frustum"]["mean_percent"] > 0


def test_a_zero_length_animation_is_still(data: Path) -> None:
    """One key at t = 0 means duration 0; the orbit then moves the camera for two seconds."""
    scene = load_scene(data / "khronos" / "BoxAnimated" / "BoxAnimated.glb")
    single = tuple(replace(c, times=np.zeros(1), values=c.values[:1]) for c in scene.channels)
    run = evaluate_scene(replace(scene, channels=single), settings(frames=(None, 4)))
    assert run.summary["scene"]["duration_s"] == 0 and run.summary["pairs"] == 3
    assert any("orbit" in note for note in run.summary["notes"])
    assert run.summary["census"]["dynamic_rigid_objects"] == 0


def test_largest_width_is_drawn_or_is_an_error_of_the_device() -> None:
    """A width of 16384 is in range; a device that does not support it reports a one-line error."""
    try:
        run = evaluate_scene(DEMO, settings(width=16384, height=1, frames=(0, 2)))
    except TaubenchError as error:
        assert "\n" not in str(error) and "16384" in str(error)
    else:
        assert run.frames[0]["pixels"] == 16384


def test_a_file_in_the_place_of_the_output_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("a file, not a folder")
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(OutputError):
            evaluate_scene(DEMO, settings(), out=out)
