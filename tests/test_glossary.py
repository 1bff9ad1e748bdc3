"""The glossary defines everything that files and options name, once."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from taubench_gl import glossary
from taubench_gl.conventions import COLUMNS, FRUSTUM, Reason
from taubench_gl.metrics.activity import QUANTITIES, describe
from taubench_gl.report.palette import REASON_COLORS
from taubench_gl.run import FRAME_COLUMNS
from taubench_gl.settings import REPROJECTIONS, SAMPLINGS

GROUPS = {
    "concepts": glossary.CONCEPTS, "reasons": glossary.REASONS, "columns": glossary.COLUMNS,
    "camera": glossary.CAMERA, "statistics": glossary.STATISTICS, "scene": glossary.CENSUS,
    "frames": glossary.FRAMES, "options": glossary.OPTIONS,
}  # fmt: skip


def test_every_reason_bit_is_defined():
    assert set(glossary.REASONS) == {*Reason, FRUSTUM} == set(REASON_COLORS)


@pytest.mark.parametrize(
    ("defined", "used"),
    [
        (glossary.COLUMNS, COLUMNS),
        (glossary.FRAMES, FRAME_COLUMNS),
        (glossary.CAMERA, QUANTITIES),
        (glossary.OPTIONS, (*REPROJECTIONS, *SAMPLINGS)),
    ],
    ids=["columns", "frames.csv", "camera", "options"],
)
def test_every_name_is_defined_in_order(defined, used):
    assert tuple(defined) == tuple(used)


def test_every_statistic_of_the_summary_is_defined():
    assert set(describe(np.array([1.0, 2.0]))) <= set(glossary.STATISTICS)
    for name in ("mean_percent", "comparable_mean_percent", "max_percent", "without_cuts_mean_percent", "pairs"):
        assert name in glossary.STATISTICS


@pytest.mark.parametrize("group", GROUPS)
def test_a_definition_is_one_sentence(group):
    terms = GROUPS[group]
    assert len({term.key for term in terms.values()}) == len(terms)
    for term in terms.values():
        assert term.label and term.definition
        assert term.definition[0].isupper() or term.definition[0].isdigit()
        assert not term.definition.endswith(".") and ". " not in term.definition
        assert "|" not in term.definition  # a cell of a Markdown table


def test_labels_of_reasons_are_distinct():
    for a, b in itertools.combinations(glossary.REASONS.values(), 2):
        assert a.label != b.label and a.definition != b.definition
