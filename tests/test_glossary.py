"""The glossary defines everything that files and options name, once."""

from __future__ import annotations

import itertools

import pytest

from taubench_gl import glossary
from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.features import COLUMNS
from taubench_gl.metrics.activity import QUANTITIES
from taubench_gl.paths import ASSETS
from taubench_gl.report.palette import REASON_COLORS
from taubench_gl.report.paper import paper_numbers
from taubench_gl.run_schema import FRAME_COLUMNS
from taubench_gl.settings import HISTORIES, REPROJECTIONS, SAMPLINGS, Settings

DEMO = ASSETS / "demo.glb"

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
        (glossary.OPTIONS, (*REPROJECTIONS, *SAMPLINGS, *HISTORIES)),
    ],
    ids=["columns", "frames.csv", "camera", "options"],
)
def test_every_name_is_defined_in_order(defined, used):
    assert tuple(defined) == tuple(used)


def test_every_statistic_of_the_summary_is_defined(gpu):
    settings = Settings(width=32, height=18, frames=(0, 3), columns=("frustum", "position"), pairs="every:2")
    summary = evaluate_scene(DEMO, settings).summary
    values = {key for name in QUANTITIES for key in summary["camera"][name]} | {"samples", "cuts", "gimbal_pairs"}
    values |= {key for block in ("discard", "curves") for entry in summary[block].values() for key in entry}
    values |= {key for entry in summary["sampling"]["columns"].values() for key in entry}
    defined = {*glossary.STATISTICS, *glossary.FRAMES, *glossary.CONCEPTS}
    assert values - defined - {"reason", "level"} == set()
    assert set(summary["classes"]) <= set(glossary.FRAMES)
    assert set(paper_numbers()["scenes"][0]["census"]) <= set(glossary.CENSUS)


@pytest.mark.parametrize("group", GROUPS)
def test_sources_in_the_docs_exist(group):
    for term in GROUPS[group].values():
        if term.source.startswith("docs/"):
            page, _, section = term.source.partition(", ")
            text = (DEMO.parents[1] / page).read_text(encoding="utf-8")
            assert not section or f"\n## {section}" in text, term.source


def test_labels_of_reasons_are_distinct():
    for a, b in itertools.combinations(glossary.REASONS.values(), 2):
        assert a.label != b.label and a.definition != b.definition
