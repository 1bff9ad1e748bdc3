"""The defaults of ``reuse evaluate``: path-traced frames of one sample, and a path-traced reference within a time."""

from __future__ import annotations

import json
import math
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO

import pytest
from reuse_tools import run_cli

from taubench_gl.paths import ASSETS
from taubench_gl.report.reuse import class_label, reuse_tables

pytestmark = pytest.mark.usefixtures("coarse_light")

DEMO = ASSETS / "demo.glb"
COMMAND = (
    "reuse", "evaluate", DEMO, "--methods", "none,accumulate", "--size", "32x18", "--frames", "0:3", "--bounces",
    "2", "--reference-time", "1", "--light", "auto", "--exposure", "1", "--metrics", "psnr,flicker", "--video", "none",
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("default")


def run(folder, name):
    """``reuse evaluate demo.glb --methods none,accumulate``, small: its summary, and what it prints."""
    out, err = StringIO(), StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setenv("TAUBENCH_CACHE", str(folder / "cache"))
        code = run_cli(*COMMAND, "--out", folder / name)
    assert code == 0, err.getvalue()
    return json.loads((folder / name / "reuse.json").read_text()), out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def evaluated(folder):
    return run(folder, "first")


def test_reuse_has_a_smaller_relative_error_than_none(evaluated):
    summary, *_ = evaluated
    means = {label: method["mean"] for label, method in summary["methods"].items()}
    assert means["accumulate"]["relmse"] < means["none"]["relmse"]
    assert means["accumulate"]["flicker"] < means["none"]["flicker"]
    assert summary["input"]["path_samples"] == 1 and summary["input"]["kind"] == "path-traced@1"


def test_the_reference_is_path_traced_with_a_power_of_two_of_samples_and_stored(folder, evaluated):
    summary, *_ = evaluated
    again, _, err = run(folder, "again")
    samples = summary["reference"]["samples"]
    assert summary["reference"]["kind"] == "path-traced" and samples >= 4 and math.log2(samples).is_integer()
    assert summary["reference"]["noise_percent"] > 0
    assert again["reference"]["samples"] == samples  # stored: the same reference
    assert again["methods"]["none"]["mean"] == summary["methods"]["none"]["mean"] and "to trace" not in err


def test_classes_without_pixels_are_named_but_no_columns(evaluated):
    summary, *_ = evaluated
    table = reuse_tables(summary)[2]
    pixels = {name: entry["pixels"] for name, entry in summary["methods"]["none"]["classes"].items()}
    assert [c.name for c in table.columns] == [class_label(name) for name, count in pixels.items() if count]
    label = class_label("not_classified")
    assert pixels["not_classified"] == 0 and any(label in note for note in table.notes)


def test_the_time_is_announced_and_the_noise_floor_printed(evaluated):
    summary, out, err = evaluated
    assert "to trace" in err and str(summary["reference"]["samples"]) in err
    assert "oise floor" in out


@pytest.mark.parametrize(
    "options",
    [["--light", "raster"], ["--spp", "4"], ["--indirect", "none"], ["--reference", "max"], ["--reference-time", "0"]],
)
def test_what_path_traced_input_cannot_use_is_one_line(options, capsys):
    code = run_cli("reuse", "evaluate", DEMO, "--methods", "none", "--frames", "0:2", *options)
    assert code == 2 and capsys.readouterr().err.count("\n") == 1
