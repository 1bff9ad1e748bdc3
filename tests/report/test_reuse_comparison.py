"""Tables of paired differences: all pairs of a few methods, those with the best of many."""

from __future__ import annotations

import numpy as np

from taubench_gl.report.reuse import MOST_PAIRS, comparison_tables, ranking_texts
from taubench_gl.reuse.comparison import compare_methods
from taubench_gl.reuse.quality import MEASURES


def summary_of(methods: int, seeds: int = 1, frames: int = 24) -> dict:
    """``m0`` has the smallest FLIP and relMSE, and the largest relMSE of clipped radiance."""
    rng = np.random.default_rng(1)
    rows = [
        dict.fromkeys(MEASURES) | {"method": f"m{m}", "seed": s, "frame": f}
        | {"flip": m + rng.random(), "relmse": m, "clipped_relmse": methods - m}
        for m in range(methods) for s in range(seeds) for f in range(1, frames + 1)
    ]  # fmt: skip
    measures = {name: {"unit": m.unit, "better": m.better, "doc": m.doc} for name, m in MEASURES.items()}
    return {"measures": measures, "statistics": compare_methods(rows, range(1, frames + 1))}


def test_all_pairs_of_few_methods_and_those_with_the_best_of_many():
    (few,) = comparison_tables(summary_of(3))
    assert [row.label for row in few.rows] == ["m0 - m1", "m0 - m2", "m1 - m2"]
    (many,) = comparison_tables(summary_of(8))
    assert MOST_PAIRS < 8 * 7 // 2 and [row.label for row in many.rows] == [f"m0 - m{k}" for k in range(1, 8)]


def test_intervals_over_seeds_are_columns_from_five_seeds_on():
    names = {seeds: [c.name for c in comparison_tables(summary_of(2, seeds))[0].columns] for seeds in (4, 5)}
    assert len(names[4]) == 4 and names[5][:3] == names[4][:3] and len(names[5]) == 6
    (table,) = comparison_tables(summary_of(2, 5))
    difference, low, high, first, last, p = table.rows[0].values
    assert low < difference < high < 0 and first < difference < last and p < 0.05


def test_every_measure_has_a_ranking():
    """A method that is best by one measure and worst by another is printed with both; unbounded radiance ranks none."""
    assert ranking_texts(summary_of(3))[1:] == ["FLIP: 1 m0; 2 m1; 3 m2.", "relMSE clipped: 1 m2; 2 m1; 3 m0."]
    assert ranking_texts(summary_of(3, frames=4))[1:] == ["FLIP: m0; m1; m2.", "relMSE clipped: m2; m1; m0."]
    (table,) = comparison_tables(summary_of(3))
    assert set(ranking_texts(summary_of(3))) < set(table.notes)


def test_one_method_or_an_older_file_has_no_table():
    assert comparison_tables(summary_of(1)) == [] == comparison_tables({"measures": {}})
