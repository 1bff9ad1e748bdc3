"""The track of generated frames: who runs in it, what it counts, and what its results hold."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fixed import FIXED

from taubench_gl.benchmark.merge import merge
from taubench_gl.benchmark.run import entries_of
from taubench_gl.benchmark.scenes import scene_file
from taubench_gl.benchmark.suite import read_suite
from taubench_gl.benchmark.unit import BenchmarkUnit, applicable, evaluate_case, inapplicable
from taubench_gl.datasets.scene_cache import sha256_of
from taubench_gl.errors import SettingsError
from taubench_gl.report.benchmark import benchmark_sections, benchmark_tables

pytestmark = pytest.mark.usefixtures("coarse_metering", "coarse_space")

TRACK = "generated frames"
GENERATING = {"extrapolate", "interpolate", "present-last", "space-warp"}


def labels(entries):
    return {entry.label for entry in entries}


@pytest.mark.parametrize("name", ["quick", "full"])
def test_methods_run_where_frames_are_of_their_kind(name):
    entries, cases = entries_of([]), read_suite(name).cases
    assert labels(entries) > GENERATING
    for case in cases:
        ran = {spec.label for spec in applicable(case, entries)}
        assert ran == GENERATING if case.track == TRACK else ran and not ran & GENERATING
    made_elsewhere = entries_of(["exr:nowhere@label=x"])[1]
    assert "no frames" in inapplicable(next(case for case in cases if case.generated), made_elsewhere)


def test_the_last_rendered_frame_stands_beside_methods_that_generate():
    assert labels(entries_of(["extrapolate"])) == {"none", "present-last", "extrapolate"}
    assert labels(entries_of(["svgf"])) == {"none", "svgf"}


def test_generated_cases_have_hashes_of_their_own(tmp_path):
    text = 'schema = "suite/1"\nname = "t"\nsize = "48x27"\nframes = 7\nreference_samples = 1\n'
    case = '[[cases]]\nscene = "demo"\ntrack = "t"\ninput = "full"\n'
    found = {}
    for line in ("", "render_every = 2\n", "render_every = 3\n", "render_every = 4\n"):
        (tmp_path / "suite.toml").write_text(text + case + line)
        if line.endswith("4\n"):
            with pytest.raises(SettingsError):
                read_suite(tmp_path / "suite.toml")
        else:
            (only,) = read_suite(tmp_path / "suite.toml").cases
            found[only.identity("a" * 64)] = only.generated, only.evaluated_frames
    assert list(found.values()) == [(False, 7), (True, 3), (True, 4)]


@pytest.mark.parametrize(
    ("lines", "valid"),
    [
        ("render_every = 4\nframes = 13\nwarmup = 2\n", True),
        ("render_every = 4\nframes = 13\nwarmup = 3\n", False),  # intervals, of which there are three
        ("render_every = 2\ncut = [3]\n", False),
        ('render_every = 2\ninput = "checkerboard"\n', False),
        ('render_every = 2\ninput = "jittered+upscale@2"\n', False),
    ],
)
def test_cases_in_which_no_method_could_run_are_refused_with_the_suite(tmp_path, lines, valid):
    text = 'schema = "suite/1"\nname = "t"\nsize = "48x28"\nframes = 7\nreference_samples = 4\n'
    text += '[[cases]]\nscene = "demo"\ntrack = "t"\n' + ("" if "input" in lines else 'input = "full"\n') + lines
    (tmp_path / "suite.toml").write_text(text)
    if valid:
        assert read_suite(tmp_path / "suite.toml").cases
    else:
        with pytest.raises(SettingsError):
            read_suite(tmp_path / "suite.toml")


@pytest.fixture(scope="module")
def small():
    """A small suite of one case of the track, with its unit."""
    suite = read_suite("quick")
    case = next(case for case in suite.cases if case.track == TRACK)
    case = replace(
        case, frames=7, settings=case.settings.replace(width=32, height=18, frames=(0, 7), indirect="none", **FIXED)
    )
    unit = BenchmarkUnit.of(case, entries_of(["interpolate", "taa_clamp"]), sha256_of(scene_file(case.scene)))
    return replace(suite, cases=(case,)), unit


@pytest.fixture(scope="module")
def result(small):
    suite, unit = small
    images = []
    stored = evaluate_case(unit.case, unit.entries, scene_file(unit.case.scene), lambda: images.append(1))
    assert len(images) * len(unit.entries) == unit.weight
    stored["times"]["seconds"] = 0.0
    alone = evaluate_case(unit.case, unit.entries[2:3], scene_file(unit.case.scene))
    assert unit.entries[2].label == "interpolate" and labels(unit.entries[2:3]) == set(alone["methods"])
    assert alone["methods"]["interpolate"]["generated"] == stored["methods"]["interpolate"]["generated"]
    return merge(suite, unit.entries, {unit.identity: stored}, {unit.case.scene: unit.sha256})


def test_results_hold_gain_and_latency(result):
    tracks = {label: method["tracks"][TRACK] for label, method in result["methods"].items()}
    psnr = {label: tracks[label]["mean"]["psnr_db"] for label in ("interpolate", "present-last")}
    assert tracks["interpolate"]["gain_db"] == pytest.approx(psnr["interpolate"] - psnr["present-last"])
    assert tracks["interpolate"]["latency_frames"] == 1.0
    assert tracks["interpolate"]["latency_ms"] == pytest.approx(1000 / 24)
    assert tracks["present-last"]["gain_db"] == tracks["present-last"]["latency_ms"] == 0.0
    assert {tracks[label]["state"] for label in ("none", "taa_clamp")} == {"not applicable"}
    assert "flicker" not in result["rankings"][TRACK] and "flip" in result["rankings"][TRACK]


def test_the_scorecard_has_rows_of_the_methods_that_ran(result):
    (table,) = benchmark_sections(result)["ranks"]
    assert {row.label for row in table.rows} == {"interpolate", "present-last"}
    titles = [column.name for column in table.columns]
    assert titles.count("latency") == 2 and "headroom" not in titles
    assert any("none, taa_clamp" in note for note in table.notes)


def test_a_track_in_which_no_method_runs_is_named_with_the_reasons(small):
    suite, unit = small
    entries = entries_of(["taa_clamp"])
    stored = evaluate_case(unit.case, entries, scene_file(unit.case.scene))
    stored["times"]["seconds"] = 0.0
    unit = BenchmarkUnit.of(unit.case, entries, unit.sha256)
    (table,) = benchmark_tables(merge(suite, entries, {unit.identity: stored}, {unit.case.scene: unit.sha256}))
    assert any(TRACK in note and "taa_clamp (" in note for note in table.notes)
