"""The modules behind tools/bench: ratios, fitted powers, tables, and missing peers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(autouse=True)
def tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))


def test_ratios_are_relative_to_the_base_row() -> None:
    from benches import Result, cells, missing, row, with_ratios

    rows = [row("a", [2.0, 2.0]), row("b", [6.0, 6.0]), missing("c", "not installed")]
    given = with_ratios(Result("t", rows, [], base=0)).rows
    assert [r.ratio for r in given] == [1.0, 3.0, None]
    assert [r.ratio for r in with_ratios(Result("t", rows, [], base=1)).rows][:2] == [1 / 3, 1.0]
    assert [r.ratio for r in with_ratios(Result("t", rows, [], base=-1)).rows] == [None] * 3
    assert [r.ratio for r in with_ratios(Result("t", rows[::-1], [], base=0)).rows] == [None] * 3  # no base, no ratio
    assert cells(given[2]) == ["c: not installed", "–", "–", "–", "–", "0"]
    assert cells(given[1])[:3] == ["b", "3", "6.00"]


def test_a_power_law_is_fitted_exactly() -> None:
    from scaling_benches import fit

    counts = [1.0, 2.0, 5.0, 9.0]
    assert np.allclose(fit(counts, [3.0 * c**0.75 for c in counts]), 0.75)
    mixed = [1.0 + c**2 for c in (0.01, 0.1, 10.0, 100.0)]  # a fixed cost first, a square later
    whole, upper = fit([0.01, 0.1, 10.0, 100.0], mixed)
    assert whole < 1.5 < upper < 2.01


def test_claims_hold_fail_or_are_not_measured() -> None:
    from benches import Claim, claim_cells, claim_lines, unmeasured

    fast, slow = Claim("a", ">=", 5.0, 5.0, 4.0, 6.0), Claim("b", "<=", 0.3, 0.31, note="at 4x4")
    absent = unmeasured("c", ">=", 30.0, "no bpy")
    assert [c.holds for c in (fast, slow, absent)] == [True, False, None]
    assert claim_cells(fast) == ["a", ">= 5 x", "5 x", "4 to 6", "yes"]
    assert claim_cells(slow) == ["b (at 4x4)", "<= 0.3 x", "0.31 x", "–", "NO"]
    assert claim_cells(absent) == ["c (no bpy)", ">= 30 x", "–", "–", "not measured"]
    assert len(claim_lines([fast, slow, absent])) == 5
