"""Comparison of two runs: columns, masks, features, time, and the tables printed."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from click.testing import CliRunner
from exr_files import options
from fixed import fixed_settings

from taubench_gl.api import evaluate
from taubench_gl.apps.cli import cli
from taubench_gl.conventions import Reason
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.metrics.feature_errors import FeatureErrors
from taubench_gl.pathtraced.compare import (
    NO_CHANNELS,
    NO_MASKS,
    compare_runs,
    edge_band,
    mask_agreement,
)
from taubench_gl.pathtraced.compare_report import comparison_tables
from taubench_gl.report.table import to_text
from taubench_gl.run import Run
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")


@pytest.mark.parametrize(
    ("summary", "missing"),
    [({}, "scene"), ({"scene": {"name": "a"}, "discard": None}, "discard"),
     ({"scene": {"name": "a"}, "discard": {"frustum": {}}, "settings": {"width": 4}}, "settings.height")],
)  # fmt: skip
def test_a_run_without_a_needed_value_is_refused(tmp_path, summary, missing):
    (tmp_path / "summary.json").write_text(json.dumps({"schema": "taubench-gl/summary/2"} | summary))
    (tmp_path / "frames.csv").write_text("frame,pixels\n")
    with pytest.raises(OutputError) as error:
        compare_runs(tmp_path, tmp_path)
    assert error.value.where == str(tmp_path) and missing in error.value.what


def test_a_comparison_and_its_tables(renders, tmp_path):
    """A run with itself, another threshold, fewer pairs; tables and JSON; times; the worst pair."""
    known = {"job": "1", "settings": {"samples": 4, "bounces": 12, "seed": 0, "crisp": False},
             "frame_seconds": {"4": 9.0, "5": 1.0, "6": 2.0}}  # fmt: skip
    for name, threshold in (("a", 0.1255), ("b", 0.9)):
        (renders / "provenance.json").write_text(json.dumps(known))
        known["frame_seconds"] = {"4": 6.0, "5": 6.0}
        settings = fixed_settings(thresholds={"direct": threshold})
        evaluate(
            f"exr:{renders}", settings, out=tmp_path / name, save=("masks", "channels"), path_traced=options(renders)
        )
    same = compare_runs(tmp_path / "a", tmp_path / "a")
    assert all(entry["difference_pp"] == 0.0 for entry in same["columns"].values())
    assert all(entry["iou"] == 1.0 for entry in same["masks"].values())
    assert all(entry["max"] == 0.0 for entry in same["features"].values())
    assert {"position_mm", "normal_deg", "direct_percent", "indirect_percent", "color_levels"} <= set(same["features"])
    evaluate(f"exr:{renders}", fixed_settings(frames=(5, None)), out=tmp_path / "c", path_traced=options(renders))
    assert compare_runs(tmp_path / "a", tmp_path / "c")["pairs"] == 1
    evaluate(f"exr:{renders}", fixed_settings(frames=(4, 6)), out=tmp_path / "d", path_traced=options(renders))
    with pytest.raises(OutputError):  # no common pair
        compare_runs(tmp_path / "c", tmp_path / "d")
    result = compare_runs(tmp_path / "a", tmp_path / "b")
    assert result["columns"]["direct"]["difference_pp"] > 0 and result["masks"]["direct"]["iou"] < 1.0
    assert result["columns"]["position"]["difference_pp"] == 0.0
    assert [entry["seconds"] for entry in result["time"]["runs"]] == [4.0, 6.0] and result["time"]["ratio"] == 1.5
    assert "thresholds" in result["settings_that_differ"]
    masks = [np.load(tmp_path / n / "masks" / f"mask_{result['worst']['frame']:05d}.npz")["mask"] for n in "ab"]
    differ = np.count_nonzero((masks[0] ^ masks[1]) & int(Reason.DIRECT))
    assert result["worst"]["differing_percent"] == pytest.approx(100.0 * differ / masks[0].size) and differ > 0
    done = CliRunner().invoke(cli, f"reference compare {tmp_path / 'a'} {tmp_path / 'b'}".split())
    assert done.exit_code == 0 and "difference" in done.output and "1.5" in done.output
    assert f"frames {result['worst']['frame'] - 1} and" in done.output
    stated = CliRunner().invoke(cli, f"reference compare {tmp_path / 'a'} {tmp_path / 'b'} --json".split())
    assert json.loads(stated.output) == result
    both = CliRunner().invoke(cli, f"reference compare {tmp_path / 'a'} {tmp_path / 'b'} --json --format csv".split())
    assert isinstance(both.exception, SettingsError)
    for name in ("masks/mask", "channels/channels"):
        file = tmp_path / "b" / f"{name}_{result['worst']['frame']:05d}.npz"
        whole = file.read_bytes()
        damaged, other = bytearray(whole), io.BytesIO()
        damaged[len(whole) // 2] ^= 0x55  # a byte of an array
        np.savez(other, unknown=np.zeros(3))
        for data in (damaged, other.getvalue()):
            file.write_bytes(data)
            with pytest.raises(OutputError) as error:
                compare_runs(tmp_path / "a", tmp_path / "b")
            assert error.value.where == str(file)
        file.write_bytes(whole)


def test_a_comparison_without_masks_has_reasons(renders, tmp_path):
    evaluate(f"exr:{renders}", out=tmp_path / "a", path_traced=options(renders))
    result = compare_runs(tmp_path / "a", tmp_path / "a")
    assert result["masks"] == result["worst"] == {"reason": NO_MASKS} and result["features"] == {"reason": NO_CHANNELS}
    assert all("seconds" not in entry and entry["reason"] for entry in result["time"]["runs"])
    assert NO_MASKS in to_text(comparison_tables(result))


def test_feature_errors_are_the_planted_ones():
    """1 mm, 2 degrees, 10 % of direct light, 51 levels; different surfaces count in position only."""
    h, w = 4, 5
    rng = np.random.default_rng(0)
    second = {"position": np.concatenate([rng.normal(size=(h, w, 3)), np.ones((h, w, 1))], -1).astype("f4"),
              "normal": np.tile(np.array([0, 0, 1, 0], "f4"), (h, w, 1)), "motion": np.zeros((h, w, 2), "f4"),
              "direct": rng.uniform(1, 2, (h, w, 4)).astype("f4"), "indirect": np.zeros((h, w, 4), "f4"),
              "color": np.full((h, w, 4), 0.5, "f4"), "camera_position": np.zeros(3)}  # fmt: skip
    first = {name: values.copy() for name, values in second.items()}
    first["camera_position"] = np.array([0.0, 1e-3, 0.0])
    angle = np.radians(2.0)
    first["normal"][..., :3] = (np.sin(angle), 0, np.cos(angle))
    first["direct"] *= np.float32(1.1)
    first["motion"][..., 0] = 0.25
    first["color"][..., 1] = 0.7
    first["position"][0, 0, 0] += 5.0
    first["normal"][0, 0, :3] = (1, 0, 0)
    second["position"][3, 4] = 0.0  # sky
    errors = FeatureErrors(same_place_m=0.1255)
    errors.add(first, second)
    summary = errors.summary()
    medians = {name: entry["median"] for name, entry in summary.items()}
    expected = dict(position_mm=1.0, normal_deg=2.0, direct_percent=10.0, indirect_percent=0.0, color_levels=51.0)
    assert medians == pytest.approx(expected, rel=1e-3)  # motion of a run is made of its positions: no error of its own
    assert summary["position_mm"]["max"] == pytest.approx(5000.0, rel=1e-3) and summary["normal_deg"]["max"] < 2.01
    assert (summary["position_mm"]["pixels"], summary["normal_deg"]["pixels"]) == (h * w - 1, h * w - 2)
    assert summary["direct_percent"]["total_percent"] == pytest.approx(10.0, rel=1e-3)


def test_edge_band_and_mask_agreement():
    mask = np.zeros((7, 7), dtype=bool)
    mask[:, 3:] = True
    band = edge_band(mask)
    assert band[:, 2:4].all() and not band[:, :2].any() and not band[:, 4:].any()
    shifted = np.zeros_like(mask)
    shifted[:, 4:] = True
    intersection, union, equal, outside = mask_agreement(shifted, mask)
    assert (intersection, union) == (21, 28) and equal == outside == 35


def changed(run, **settings):
    """``run`` with other settings in its summary."""
    summary = run.summary | {"settings": run.summary["settings"] | settings}
    return Run(summary, run.frames, run.out)


def test_other_exposures_and_light_units_are_refused(renders):
    runs = [evaluate(f"exr:{renders}", fixed_settings(exposure=e), path_traced=options(renders)) for e in (1.0, 2.0)]
    with pytest.raises(OutputError) as error:
        compare_runs(*runs)
    assert "exposure" in error.value.what and "--exposure 1" in error.value.hint
    watt, candela = (changed(runs[0], light_unit=unit) for unit in ("watt", "candela"))
    with pytest.raises(OutputError) as error:
        compare_runs(watt, candela)
    assert "watt" in error.value.what and "candela" in error.value.what
    assert compare_runs(watt, changed(candela, light_unit=None))["pairs"] > 0  # unknown, as of other programs
    assert compare_runs(watt, watt)["settings_that_differ"] == {}


def test_runs_without_light_may_have_other_exposures(renders):
    settings = Settings(columns=("frustum", "position", "normal"))
    run = evaluate(f"exr:{renders}", settings, path_traced=options(renders))
    for column in ("direct", "indirect", "color"):
        run.summary["discard"][column] = {"mean_percent": None, "reason": "not requested"}
    assert compare_runs(run, changed(run, exposure=7.0))["pairs"] > 0


def test_light_unit_and_environment_of_recorded_renders(renders):
    record = {"job": "1", "settings": {"samples": 4}, "lighting": {"light_unit": "watt", "environment": "none"}}
    for values, unit in (({}, None), (record, "watt"), ({"job": "1", "settings": {"samples": 4}}, None)):
        (renders / "provenance.json").write_text(json.dumps(values))
        found = evaluate(f"exr:{renders}", path_traced=options(renders)).summary["settings"]
        assert found["light_unit"] == unit and found["exposure"] == 1.0
