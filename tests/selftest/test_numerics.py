"""The recorded table of tests/selftest/numerics.json belongs to the guards and cases that there are."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))
from guards import GUARDS
from make_numerics import NUMERIC, NUMERICS, row

from taubench_gl.data_files import read_json
from taubench_gl.gpu.context import open_gpu
from taubench_gl.selftest import cases

GUARD = {g.name: g for g in GUARDS}


def test_every_row_is_of_a_guard_and_a_case():
    case, found = {c.name: c for c in cases()}, read_json(NUMERICS)
    assert [r["guard"] for r in found["rows"]] == list(NUMERIC), "run: tools/record numerics"
    assert found["driver"] and found["renderer"] and found["date"]
    for r in found["rows"]:
        assert r["case"] in GUARD[r["guard"]].detected_by
        assert r["error"] <= case[r["case"]].tolerance < r["error_without"]


@pytest.mark.parametrize("name", ["stable-variance", "chord-angle", "frame-tolerance"])
def test_the_recorded_errors_are_measured(name):
    """Errors of guards that do not depend on the driver are those of the record."""
    (there,) = [r for r in read_json(NUMERICS)["rows"] if r["guard"] == name]
    again = row(GUARD[name], open_gpu())
    assert again["case"] == there["case"] and again["error"] == pytest.approx(there["error"], rel=1e-6, abs=1e-15)
    assert again["error_without"] == pytest.approx(there["error_without"], rel=1e-6)
