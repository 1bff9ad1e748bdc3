"""Fits against errors known in closed form; ranges; notes about the edge of a range."""

from __future__ import annotations

import csv
import json
from types import MappingProxyType

import numpy as np
import pytest
from reuse_scenes import passing_box, settings
from reuse_tools import run_cli

from taubench_gl.errors import MethodError, SettingsError
from taubench_gl.paths import ASSETS
from taubench_gl.reuse.evaluate_output import write_fit
from taubench_gl.reuse.fit import (
    AT_LIMIT,
    MAX_POINTS,
    MAY_BE_OUTSIDE,
    Range,
    expand_methods,
    fit_setting,
    parse_range,
)
from taubench_gl.reuse.loading import MethodSpec, load_method
from taubench_gl.reuse.scores import EQUAL

pytestmark = pytest.mark.usefixtures("coarse_light")


class Gain:
    """Radiance times ``gain`` plus ``lift``: exact at 1 and 0."""

    reads = ("radiance",)
    settings = MappingProxyType({
        "gain": {"default": 0.5, "min": 0.0, "max": 4.0, "doc": "factor"},
        "lift": {"default": 0.0, "min": -1.0, "max": 1.0, "doc": "added"},
        "whole": {"default": 3, "min": 1, "max": 9, "doc": "nothing"},
        "kind": {"default": "a", "choices": ["a", "b"], "doc": "nothing"},
        "open": {"default": 0.1, "doc": "without a range"},
    })  # fmt: skip

    def __init__(self, size, settings):
        self.settings = settings

    def step(self, frame):
        if self.settings["gain"] > 3.5:
            raise ValueError("too bright")
        return frame["radiance"][..., :3] * self.settings["gain"] + self.settings["lift"]


GAIN = MethodSpec("gain", Gain)


def fit(ranges, method=GAIN, **more):
    more = {"input": "full", "reference_samples": 1, "settings": settings(frames=(0, 3), width=16, height=12)} | more
    return fit_setting(passing_box(), method, ranges, **more)


def test_ranges_include_their_ends():
    assert Range("a", 0.1, 0.7, 3, "linear", False).values == pytest.approx((0.1, 0.4, 0.7))
    log = Range("a", 0.01, 1.0, 5, "log", False).values
    assert log[0] == 0.01 and log[-1] == 1.0
    np.testing.assert_allclose(np.diff(np.log(log)), np.log(100.0) / 4)
    assert Range("a", 1, 4, 9, "linear", True).values == (1, 2, 3, 4)


def test_parse_range():
    method = load_method("taa_clamp")
    full = parse_range("alpha", method)
    assert (full.low, full.high, full.steps, full.scale) == (0.01, 1.0, 9, "log")
    assert parse_range("alpha=0.1:0.5:4", method) == Range("alpha", 0.1, 0.5, 4, "log", False)


@pytest.mark.parametrize(
    ("text", "error", "value"),
    [
        ("beta", MethodError, "'beta'"),
        ("clamping", SettingsError, "clamping"),
        ("alpha=0.5", SettingsError, "'alpha=0.5'"),
        ("alpha=a:b", SettingsError, "'alpha=a:b'"),
        ("alpha=0.5:0.1:4", SettingsError, "0.5 .*0.1"),
        ("alpha=0.1:0.5:1", SettingsError, "1"),
        ("alpha=0.1:7", SettingsError, "7.0"),
    ],
)
def test_invalid_ranges(text, error, value):
    with pytest.raises(error, match=value or None):
        parse_range(text, load_method("taa_clamp"))


def test_optimum_is_found_and_refined():
    found = fit(["gain=0:3:6"], refine=3, metric="relmse")  # the metric with a closed form
    assert found.best["gain"] == pytest.approx(1.0, abs=0.05)
    points = found.summary["points"]
    radiance = {p["settings"]["gain"]: p["value"] for p in points}
    # (g - 1)^2 times a constant of the scene.
    scale = radiance[3.0] / 4.0
    for gain, value in radiance.items():
        assert value == pytest.approx(scale * (gain - 1.0) ** 2, rel=1e-3, abs=1e-9)
    assert found.summary["default"] == {"settings": {"gain": 0.5}, "value": radiance[0.5]}
    assert found.notes == []
    values = [p["settings"]["gain"] for p in points]
    assert values == sorted(values) and len(set(values)) == len(values)


def test_grid_of_two_settings():
    found = fit(["gain=0.5:1.5:3", "lift=-0.5:0.5:3"], refine=0)
    assert found.best == {"gain": 1.0, "lift": 0.0}
    assert len(found.summary["points"]) == 9  # including the default


def test_maximized_metric_and_equal_images():
    near = fit(["gain=0.4:0.9:3"], metric="psnr", refine=0)
    assert near.summary["better"] == "higher" and near.best["gain"] == 0.9
    finite = [p["value"] for p in near.summary["points"]]
    assert near.summary["best"]["value"] == max(finite)
    equal = fit(["gain=0.5:1.5:3"], metric="psnr", refine=0)
    assert equal.best["gain"] == 1.0 and equal.summary["best"]["value"] is None
    assert any(EQUAL in note for note in equal.notes)


@pytest.mark.parametrize(("text", "edge"), [("gain=0.1:0.8:4", "high edge"), ("gain=1.2:3:4", "low edge")])
def test_note_about_an_optimum_at_the_edge(text, edge):
    found = fit([text], refine=1)
    assert any(edge in note and MAY_BE_OUTSIDE in note for note in found.notes)


def test_note_about_an_optimum_at_the_limit_of_a_setting():
    """For noise-free input, the optimum is alpha 1, the largest allowed value."""
    found = fit(["alpha=0.1:1:3"], "taa_clamp", settings=settings(frames=(8, 14)), refine=0)
    assert found.best["alpha"] == 1.0
    assert any("high edge" in note and AT_LIMIT in note for note in found.notes)


def test_note_about_a_setting_without_effect():
    found = fit(["whole"], refine=2)
    assert found.notes and len({p["value"] for p in found.summary["points"]}) == 1


def test_failed_point_is_recorded_and_excluded(tmp_path):
    found = fit(["gain=1:4:4"], refine=0)
    failed = [p for p in found.summary["points"] if p["value"] is None]
    assert [p["settings"]["gain"] for p in failed] == [4.0] and "too bright" in failed[0]["failed"]
    files = write_fit(tmp_path / "fit", found.summary)
    assert {f.name for f in files} == {f.name for f in (tmp_path / "fit").iterdir()}
    assert json.loads((tmp_path / "fit" / "fit.json").read_text()) == found.summary
    with open(tmp_path / "fit" / "curve.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["flip"] == "" for row in rows] == [p["value"] is None for p in found.summary["points"]]
    with pytest.raises(MethodError, match="too bright"):
        fit(["gain=3.6:4:2"], MethodSpec("gain", Gain, {"gain": 3.7}), refine=0)


@pytest.mark.parametrize(
    ("ranges", "more", "value"),
    [
        ([], {}, ""),
        (["gain", "gain"], {}, ""),
        (["gain=0:1:90", "lift=0:1:90"], {}, str(MAX_POINTS)),
        (["open"], {}, "open"),
        (["gain"], {"metric": "vmaf"}, "'vmaf'"),
        (["gain"], {"refine": -1}, "-1"),
    ],
)
def test_invalid_fits(ranges, more, value):
    with pytest.raises(SettingsError, match=value or None):
        fit(ranges, **more)


@pytest.mark.filterwarnings("error")
def test_command_line(tmp_path, capsys):
    code = run_cli(
        "reuse", "fit", ASSETS / "demo.glb", "--method", "taa_clamp", "--setting", "alpha=0.2:1:2", "--size", "32x18",
        "--frames", "0:2", "--input", "full", "--indirect", "none", "--shadow-size", "64", "--reference-samples", "1",
        "--refine", "0", "--out", tmp_path / "fit",
    )  # fmt: skip
    out, _ = capsys.readouterr()
    assert code == 0 and "best: alpha=1" in out and (tmp_path / "fit" / "curve.png").is_file()


def test_output_folder_is_checked_before_the_fit(tmp_path, monkeypatch, capsys):
    def never(*_, **__):
        raise AssertionError("the fit began")

    monkeypatch.setattr("taubench_gl.reuse.fit.fit_setting", never)
    (tmp_path / "file").touch()
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        code = run_cli("reuse", "fit", "s.glb", "--method", "taa_clamp", "--setting", "alpha", "--out", out)
        err = capsys.readouterr().err
        assert code == 2 and str(out) in err and err.count("\n") == 1


def test_values_of_methods_make_a_grid():
    found = expand_methods(["taa_variance@gamma=0.5:2:4@dilate=true/false", "none", "exr:a/b@label=c/d"])
    assert [s.label for s in found[:8]] == [
        f"taa_variance@gamma={g:g}@dilate={d}" for g in (0.5, 1, 1.5, 2) for d in ("true", "false")
    ]
    assert [s.label for s in found[8:]] == ["none", "c/d"], "paths and labels of files are no grid"
    for wrong in ("taa_variance@gamma=2:1:4", "taa_variance@gama=1/2", "taa_variance@dilate=1:2:3", "svgf@alpha=7/8"):
        with pytest.raises((MethodError, SettingsError)):
            expand_methods([wrong])
    with pytest.raises(SettingsError):
        expand_methods(["taa_variance@gamma=0.5:2:49"])


def test_a_method_of_a_file_is_called_by_its_class_file_or_folder():
    texts = ["some/where/first.py", "some/where/file.py:Second@alpha=0.1", "else/third/", "package.module:Fourth"]
    assert [s.label for s in expand_methods(texts)] == ["first", "Second@alpha=0.1", "third", "package.module:Fourth"]
    with pytest.raises(SettingsError):
        expand_methods(["a/mine.py", "b/mine"])
