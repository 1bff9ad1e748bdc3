"""The track of methods that sample lights: who runs in it, and what its results hold."""

from __future__ import annotations

from dataclasses import replace

import pytest

from taubench_gl.benchmark.merge import merge
from taubench_gl.benchmark.run import entries_of
from taubench_gl.benchmark.scenes import scene_file
from taubench_gl.benchmark.suite import read_suite
from taubench_gl.benchmark.unit import Entry, applicable, evaluate_case, inapplicable
from taubench_gl.datasets.scene_cache import sha256_of
from taubench_gl.report.benchmark import benchmark_sections

pytestmark = pytest.mark.usefixtures("coarse_metering", "coarse_space")


def tracks(entries, label):
    """Tracks of the quick suite in whose cases a method runs."""
    (entry,) = (entry for entry in entries if entry.label == label)
    cases = {case.track: case for case in read_suite("quick").cases}
    return {track for track, case in cases.items() if inapplicable(case, entry) is None}


def test_methods_that_sample_lights_run_in_their_track_unless_named():
    given, named = entries_of([]), entries_of(["restir-di"])
    for label in ("ris", "restir-di", "restir-di>svgf"):
        assert tracks(given, label) == {"samples"}
    assert tracks(named, "restir-di") == {"samples", "path-traced"} and "samples" in tracks(given, "svgf")
    cases = [case for case in read_suite("quick").cases if case.track == "samples"]
    assert len(cases) == 5 and all(case.kind.path_samples == 1 for case in cases)
    assert all(case.settings.lighting.bounces == 1 for case in cases)


@pytest.fixture(scope="module")
def result():
    """A small case of the track with three methods."""
    suite = read_suite("quick")
    case = next(case for case in suite.cases if case.id == "demo/path-traced@1")
    request = replace(case.request, reference="path-traced@8", metrics=("psnr",), seeds=1)
    settings = case.settings.replace(width=32, height=18, frames=(20, 23))
    case = replace(case, first=20, frames=3, request=request, settings=settings)
    entries = tuple(Entry.of(text) for text in ("none", "ris@candidates=2", "restir-di@candidates=2"))
    path = scene_file(case.scene)
    assert len(applicable(case, entries)) == 3
    stored = evaluate_case(case, entries, path)
    stored["times"]["seconds"], sha256 = 0.0, sha256_of(path)
    return merge(replace(suite, cases=(case,)), entries, {case.identity(sha256): stored}, {case.scene: sha256})


def test_results_hold_samples(result):
    cells = {label: method["cases"]["demo/path-traced@1"] for label, method in result["methods"].items()}
    assert "samples" not in cells["none"] and cells["none"]["state"] == "done"
    kept = cells["restir-di@candidates=2"]["samples"]["history"]["all"]
    assert kept["kept"] > 0 and cells["ris@candidates=2"]["samples"]["history"] is None


def test_the_table_of_samples(result):
    (table,) = benchmark_sections(result)["samples"]
    assert [row.label for row in table.rows] == ["ris@candidates=2", "restir-di@candidates=2"]
    rays = [row.values[0] for row in table.rows]
    assert 0.5 < rays[0] <= rays[1] <= 1.0 and table.rows[0].values[3] is None
