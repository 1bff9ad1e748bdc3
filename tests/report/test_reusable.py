"""The reuse rate in words and tables."""

from __future__ import annotations

import copy
import csv
import io

import numpy as np
import pytest

from taubench_gl.conventions import Reason
from taubench_gl.features import MASK_WORDS
from taubench_gl.glossary import REUSE_REASONS
from taubench_gl.metrics.reuse_rate import NO_SURFACE, ReuseStats
from taubench_gl.report import FORMATS, run_tables, short_tables
from taubench_gl.report.reusable import headline, percent_text, reusable_sentence, sentence

LABELS = {term.key: term.label for term in REUSE_REASONS.values()}


def test_the_sentence_names_the_two_largest_reasons():
    shares = {"disoccluded": 9.1, "lit": 4.0, "shadowed": 2.0, "outside": 1.6, "normal": 1.0, "indirect": 1.0}
    assert sentence(81.3, shares) == (
        "81.3 % of surface pixels can be reused; most of the rest is disoccluded (9.1 %) or brightened or darkened "
        "(6.0 %)"
    )


@pytest.mark.parametrize(
    ("percent", "shares", "named", "without"),
    [
        (100.0, {}, (), ("rest",)),
        (90.0, {"outside": 10.0}, ("outside",), ("most",)),
        (90.0, {"outside": 6.0, "normal": 4.0}, ("outside", "normal"), ("most",)),
        (90.0, {"outside": 5.0, "normal": 3.0, "occluding": 2.0}, ("outside", "normal", "occluding"), ("most",)),
        (
            80.0, {"outside": 5.0, "normal": 4.0, "occluding": 4.0, "disoccluded": 4.0, "position": 3.0},
            ("outside", "disoccluded"), ("most", "the rest"),
        ),
    ],
)  # fmt: skip
def test_the_sentence_claims_no_more_than_the_reasons_cover(percent, shares, named, without):
    text = sentence(percent, shares)
    for name in LABELS:
        assert (LABELS[name] in text) == (name in named)
    assert not any(word in text for word in without)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0 %"), (0.01, "less than 0.1 %"), (12.34, "12.3 %"), (99.97, "more than 99.9 %"), (100.0, "100 %")],
)
def test_rounding_never_claims_all_or_nothing(value, text):
    assert percent_text(value) == text


def test_the_headline_has_the_reprojection_mode_and_names_the_rate(summary):
    assert summary["reusable"]["reasons_of"] == "surface"
    assert headline(summary).startswith("camera") and "geometry" in headline(summary)
    assert "75 " not in headline(summary) and "75.0 %" in headline(summary) and "20.0 %" in headline(summary)
    del summary["reusable"]
    assert "unknown" in reusable_sentence(summary)


def test_the_sentence_states_the_share_of_sky_where_there_is_any():
    assert sentence(50.0, {"outside": 50.0}, sky_percent=90.36).startswith(sentence(50.0, {"outside": 50.0}))
    assert "90.4 %" in sentence(50.0, {"outside": 50.0}, sky_percent=90.36)
    assert sentence(50.0, {"outside": 50.0}, sky_percent=0.0) == sentence(50.0, {"outside": 50.0})


def test_an_image_of_sky_alone_has_no_rate_and_the_reason_is_stated(summary):
    stats = ReuseStats({})
    words = np.zeros(MASK_WORDS, dtype=np.int64)
    words[Reason.SKY | Reason.HISTORY_SKY] = 800
    stats.add(words)
    summary["reusable"] = stats.block("camera", np.zeros(1, dtype=bool))
    assert NO_SURFACE in headline(summary)
    rates, reasons, *_ = run_tables([summary])
    for row in rates.rows:
        assert row.values[1:6] == (None, None, None, None, 100.0) and row.reasons[1] == NO_SURFACE
    assert reasons.rows[0].values[0] is None


def test_reusable_pixels_come_before_the_tables_of_the_paper(summary):
    rates, reasons, *paper = run_tables([summary])
    assert [table.number for table in paper] == [1, 2, 3, 4]
    surface, shading = rates.rows
    assert surface.values == ("camera", 75.0, 75.0, 75.0, 60.0, 20.0, 24.0, 12)
    assert shading.values == ("camera", *(None,) * 4, 20.0, 24.0, 12) and shading.reasons[1].startswith("indirect")
    assert dict(zip((c.name for c in reasons.columns), reasons.rows[0].values, strict=True)) == pytest.approx(
        {"reusable": 75.0, "off-screen": 16.25, "disoccluded": 6.25, "newly occluding": 0.625,
         "changed in normal": 1.875, "fps": 24.0, "N": 12}
    )  # fmt: skip


def test_short_tables_state_each_fact_once(summary):
    summary["camera"] |= {"position": {"mean": 0.25}, "angle": {"mean": 1.5}}
    tables = short_tables([summary])
    assert [table.number for table in tables] == ["reusable", "reasons", 4]
    assert not any(row.paper for table in tables for row in table.rows)
    notes = [note for table in tables for note in table.notes]
    assert len(set(notes)) == len(notes) and sum("0.25 m" in note and "1.5°" in note for note in notes) == 1
    del summary["camera"]["angle"]
    assert not any("0.25 m" in note for note in short_tables([summary])[-1].notes)


def test_reasons_beyond_the_largest_are_summed_up(summary):
    other = copy.deepcopy(summary)
    block = other["reusable"]
    block["reasons_of"], block["shading"] = "shading", dict(block["surface"], mean_percent=65.0)
    for name, share in {"lit": 1.0, "shadowed": 2.0, "direct": 3.0, "indirect": 4.0}.items():
        block["reasons"][name] = {"mean_percent": share, "pixels": 1}
    table = run_tables([summary, other])[1]
    for row, one in zip(table.rows, (summary, other), strict=True):
        assert sum(value or 0.0 for value in row.values[:-2]) == pytest.approx(100.0)
        assert row.values[0] == one["reusable"][one["reusable"]["reasons_of"]]["mean_percent"]
    assert len(table.columns) <= 9


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_has_the_headline(summary, form):
    text = FORMATS[form](run_tables([summary]))
    if form == "csv":
        rows = [row for row in csv.DictReader(io.StringIO(text)) if row["table"] == "reusable"]
        assert float(rows[1]["value"]) == 75.0 and rows[0]["value"] == "camera"
        assert [row["unit"] for row in rows[1:6]] == ["% of surface pixels"] * 3 + ["% of all pixels"] * 2
    else:
        assert "75.0" in text and text.index("75.0") < text.index("Animation details")
