"""Numbers of tools/bench that pages print: ratios and fitted powers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(autouse=True)
def tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))


def test_ratios_are_relative_to_the_base_row() -> None:
    from benches import Result, missing, row, with_ratios

    rows = [row("a", [2.0, 2.0]), row("b", [6.0, 6.0]), missing("c", "not installed")]
    given = with_ratios(Result("t", rows, [], base=0)).rows
    assert [r.ratio for r in given] == [1.0, 3.0, None]
    assert [r.ratio for r in with_ratios(Result("t", rows, [], base=1)).rows][:2] == [1 / 3, 1.0]
    assert [r.ratio for r in with_ratios(Result("t", rows, [], base=-1)).rows] == [None] * 3
    assert [r.ratio for r in with_ratios(Result("t", rows[::-1], [], base=0)).rows] == [None] * 3  # no base, no ratio


def test_a_power_law_is_fitted_exactly() -> None:
    from scaling_benches import fit

    counts = [1.0, 2.0, 5.0, 9.0]
    assert np.allclose(fit(counts, [3.0 * c**0.75 for c in counts]), 0.75)
    mixed = [1.0 + c**2 for c in (0.01, 0.1, 10.0, 100.0)]  # a fixed cost first, a square later
    whole, upper = fit([0.01, 0.1, 10.0, 100.0], mixed)
    assert whole < 1.5 < upper < 2.01
