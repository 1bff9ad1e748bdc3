"""Numbers of the recorded benchmark come out again."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.benchmark.output import load_benchmark
from taubench_gl.benchmark.suite import read_suite
from taubench_gl.benchmark.unit import Entry


@pytest.mark.long
def test_a_recorded_cell_of_the_quick_suite_comes_out_again():
    """docs/benchmark-quick.json: one case of a deterministic input, two methods."""
    from taubench_gl.benchmark.scenes import scene_file
    from taubench_gl.benchmark.unit import evaluate_case

    recorded = load_benchmark(Path(__file__).resolve().parents[2] / "docs" / "benchmark-quick.json")
    suite = read_suite("quick")
    case = next(case for case in suite.cases if case.id == "demo/checkerboard")
    entries = [Entry.of("none"), Entry.of("checkerboard")]
    found = evaluate_case(case, entries, scene_file(case.scene))
    assert recorded["suite"] == suite.describe()
    for entry in entries:
        known = recorded["methods"][entry.label]["cases"][case.id]["mean"]
        for name in ("flip", "psnr_db", "relmse", "flicker"):
            assert found["methods"][entry.label]["mean"][name] == pytest.approx(known[name], rel=0.02)
