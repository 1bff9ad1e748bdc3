"""Reuse rates and disjoint reasons against masks made by hand."""

from __future__ import annotations

import itertools
from math import fsum

import numpy as np
import pytest

from taubench_gl.conventions import HISTOGRAM_BINS, Reason
from taubench_gl.features import COLUMNS, FEATURES, MASK_WORDS
from taubench_gl.glossary import REUSE_REASONS
from taubench_gl.metrics.counts import Counts, counts_of
from taubench_gl.metrics.pair_sample import PairSample, estimate, sample_pairs
from taubench_gl.metrics.reuse_rate import (
    NO_SURFACE,
    ReuseStats,
    disjoint_reasons,
    reusable_pixels,
    surface_pixels,
    unmeasured_rates,
)
from taubench_gl.metrics.sequence_stats import SequenceStats

NO_CUT = np.zeros(2, dtype=bool)
PAIR = {
    Reason(0): 400,
    Reason.SKY | Reason.HISTORY_SKY: 100,  # sky is no surface pixel
    Reason.COLOR: 7,  # color alone: reusable
    Reason.FIRST: 1,
    Reason.CUT: 2,
    Reason.INVALID: 3,
    Reason.BEHIND: 4,
    Reason.OUTSIDE: 50,
    Reason.SKY | Reason.OUTSIDE: 60,
    Reason.SKY | Reason.POSITION | Reason.NORMAL | Reason.DISOCCLUDED: 70,
    Reason.SKY | Reason.INVALID: 5,
    Reason.SKY | Reason.HISTORY_SKY | Reason.COLOR: 11,
    Reason.POSITION | Reason.NORMAL | Reason.OCCLUDING | Reason.HISTORY_SKY: 20,
    Reason.POSITION | Reason.DISOCCLUDED | Reason.DIRECT | Reason.LIT | Reason.COLOR: 90,
    Reason.POSITION: 5,
    Reason.NORMAL | Reason.INDIRECT: 6,
    Reason.DIRECT | Reason.LIT: 30,
    Reason.DIRECT | Reason.SHADOWED | Reason.INDIRECT: 31,
    Reason.DIRECT: 8,
    Reason.INDIRECT | Reason.COLOR: 9,
}
SKY = 100 + 60 + 70 + 5 + 11
TOTAL = sum(PAIR.values())
SURFACE = TOTAL - SKY


def histogram(pixels: dict[Reason, int]) -> np.ndarray:
    out = np.zeros(MASK_WORDS, dtype=np.uint32)
    for word, count in pixels.items():
        out[int(word)] = count
    return out


def stats_of(unmeasured: dict[str, str], *pairs: dict[Reason, int]) -> ReuseStats:
    stats = ReuseStats(unmeasured)
    for pair in pairs:
        stats.add(histogram(pair))
    return stats


def test_rates_and_reasons_of_a_mask_made_by_hand():
    shading = 400 + 7
    assert surface_pixels(histogram(PAIR)) == SURFACE == 666
    assert reusable_pixels(histogram(PAIR)) == {"surface": shading + 30 + 31 + 8 + 9, "shading": shading}
    assert disjoint_reasons(histogram(PAIR)) == {
        "first": 1, "cut": 2, "invalid": 3, "behind": 4, "outside": 50, "disoccluded": 90, "occluding": 20,
        "position": 5, "normal": 6, "lit": 30, "shadowed": 31, "direct": 8, "indirect": 9,
    }  # fmt: skip
    surface = disjoint_reasons(histogram(PAIR), "surface")
    assert surface == {n: v for n, v in disjoint_reasons(histogram(PAIR)).items()
                       if n not in ("lit", "shadowed", "direct", "indirect")}  # fmt: skip


@pytest.mark.parametrize("rate", ["surface", "shading"])
def test_reasons_and_reusable_pixels_add_up_for_every_word(rate):
    counts = np.random.default_rng(1).integers(0, 2**32, MASK_WORDS, dtype=np.uint32)
    total = reusable_pixels(counts)[rate] + sum(disjoint_reasons(counts, rate).values())
    surface = sum(int(counts[word]) for word in range(MASK_WORDS) if not word & Reason.SKY)
    assert total == surface == surface_pixels(counts)


def test_the_order_of_the_reasons_is_that_of_the_glossary():
    bits = list(REUSE_REASONS)
    assert set(bits) == set(Reason) - {Reason.SKY, Reason.HISTORY_SKY, Reason.COLOR}
    for first, second in itertools.combinations(bits, 2):
        word = first | second
        if word & (Reason.LIT | Reason.SHADOWED | Reason.DISOCCLUDED | Reason.OCCLUDING):
            word |= Reason.POSITION if word & (Reason.DISOCCLUDED | Reason.OCCLUDING) else Reason.DIRECT
        found = disjoint_reasons(histogram({word: 5}))
        assert {name for name, count in found.items() if count} == {REUSE_REASONS[first].key}


def test_counts_of_a_pair_contain_both_rates():
    counts = counts_of(histogram(PAIR))
    assert (counts["reusable_surface"], counts["reusable_shading"]) == (485, 407)
    assert counts["pixels"] - counts["sky"] == SURFACE


def test_means_are_totals_over_totals_and_add_up_to_100_percent():
    other = {Reason(0): 30, Reason.OUTSIDE: 20, Reason.SKY | Reason.HISTORY_SKY: TOTAL - 50}
    block = stats_of({}, PAIR, other).block("camera", NO_CUT)
    shading, surface = block["shading"], SURFACE + 50
    assert block["reasons_of"] == "shading"
    assert shading["pixels"] + sum(e["pixels"] for e in block["reasons"].values()) == surface
    shares = [shading["mean_percent"], *(e["mean_percent"] for e in block["reasons"].values())]
    assert fsum(shares) == pytest.approx(100.0, abs=1e-12)
    assert shading["mean_percent"] == pytest.approx(100.0 * (407 + 30) / surface)
    assert block["surface"]["mean_percent"] == pytest.approx(100.0 * (485 + 30) / surface)
    assert block["reasons"]["outside"]["mean_percent"] == pytest.approx(100.0 * (50 + 20) / surface)
    assert shading["of_picture_percent"] == pytest.approx(100.0 * (407 + 30) / (2 * TOTAL))
    assert block["sky_percent"] == pytest.approx(100.0 * (SKY + TOTAL - 50) / (2 * TOTAL))
    assert shading["mean_percent"] * (100.0 - block["sky_percent"]) == pytest.approx(
        100.0 * shading["of_picture_percent"]
    )
    assert shading["min_percent"] == pytest.approx(100.0 * 30 / 50)
    assert shading["max_percent"] == pytest.approx(100.0 * 407 / SURFACE)
    assert block["color_only"] == {"mean_percent": pytest.approx(100.0 * 7 / surface), "pixels": 7}


def test_a_pair_without_surfaces_changes_neither_means_nor_extremes():
    empty = {Reason.SKY | Reason.HISTORY_SKY: 500, Reason.SKY | Reason.OUTSIDE: TOTAL - 500}
    one, two = (stats_of({}, *pairs).block("camera", NO_CUT[: len(pairs)]) for pairs in ((PAIR,), (PAIR, empty)))
    for rate in ("surface", "shading"):
        same = ("mean_percent", "min_percent", "max_percent", "without_cuts_mean_percent", "pixels")
        assert [two[rate][key] for key in same] == [one[rate][key] for key in same]
        assert two[rate]["of_picture_percent"] == pytest.approx(one[rate]["of_picture_percent"] / 2)
    assert two["reasons"] == one["reasons"]


def test_a_run_that_shows_no_surface_has_no_rate():
    stats = stats_of({}, {Reason.SKY | Reason.HISTORY_SKY: 9, Reason.SKY | Reason.OUTSIDE: 1})
    block = stats.block("camera", NO_CUT[:1])
    assert block["sky_percent"] == 100.0 and block["reasons_of"] is None and block["reasons"] == {}
    assert block["color_only"] is None and not stats.has_surface
    for rate in ("surface", "shading"):
        assert block[rate]["reason"] == NO_SURFACE
        assert all(block[rate][key] is None for key in block[rate] if key != "reason")
    with pytest.raises(ValueError, match=NO_SURFACE):
        stats.residuals("shading", np.ones(1))


def test_pairs_that_are_cuts_are_left_out_of_the_mean_without_cuts():
    stats = stats_of({}, PAIR, {Reason(0): 0, Reason.OUTSIDE: 766})
    block = stats.block("camera", np.array([False, True]))
    assert block["surface"]["without_cuts_mean_percent"] == block["surface"]["max_percent"]
    assert stats.block("camera", np.array([True, True]))["surface"]["without_cuts_mean_percent"] is None


@pytest.mark.parametrize(
    ("missing", "nulls"),
    [
        ((), ()),
        (("color",), ()),
        (("direct",), ("shading",)),
        (("indirect",), ("shading",)),
        (("position",), ("surface", "shading")),
        (("normal", "direct"), ("surface", "shading")),
        (("frustum",), ("surface", "shading")),
    ],
)
def test_a_rate_is_null_where_a_column_it_needs_is(missing, nulls):
    reasons = {column: f"no {column} here" for column in missing}
    assert tuple(unmeasured_rates(reasons)) == nulls
    stats = SequenceStats(tuple(c for c in COLUMNS if c not in missing), reasons)
    counts = stats.add(Counts(histogram(PAIR), np.zeros((len(FEATURES), HISTOGRAM_BINS), dtype=np.uint32)))
    block = stats.reuse.block("motion", NO_CUT[:1])
    for rate in ("surface", "shading"):
        assert (counts[f"reusable_{rate}"] is None) == (block[rate]["mean_percent"] is None) == (rate in nulls)
        if rate in nulls:
            assert any(f"no {column} here" in block[rate]["reason"] for column in missing)
    expected = "shading" if not nulls else "surface" if nulls == ("shading",) else None
    assert block["reasons_of"] == expected
    if expected is None:
        assert block["reasons"] == {}
    else:
        assert block[expected]["pixels"] + sum(e["pixels"] for e in block["reasons"].values()) == SURFACE
    assert (block["color_only"] is None) == ("color" in missing or expected != "shading")
    assert block["reprojection"] == "motion"
    assert (block["sky_percent"] is None) == ("position" in missing)


def test_a_run_without_pairs_has_no_rate():
    block = ReuseStats({}).block("camera", np.zeros(0, dtype=bool))
    assert all(block[rate]["mean_percent"] is None and block[rate]["reason"] for rate in ("surface", "shading"))
    assert block["reasons"] == {} and block["reasons_of"] is None and block["color_only"] is None


def test_sampled_pairs_are_weighted_by_their_stratum():
    sample = PairSample(10, ((8, (0, 4)), (2, (8,))))
    assert sample.weights.tolist() == [0.4, 0.4, 0.2]
    pairs = [{Reason(0): 100 - out, Reason.OUTSIDE: out} for out in (0, 50, 100)]
    block = stats_of({}, *pairs).block("camera", np.zeros(3, dtype=bool), sample.weights)
    assert block["shading"]["mean_percent"] == pytest.approx(0.4 * 100 + 0.4 * 50)
    assert block["reasons"]["outside"]["mean_percent"] == pytest.approx(0.4 * 50 + 0.2 * 100)


def test_the_interval_of_a_sampled_rate_is_that_of_a_ratio():
    """Pairs whose surface pixels differ widely: 95 % intervals hold the rate of all pairs, and are not too wide."""
    rng, size = np.random.default_rng(4), 40
    surface = rng.integers(100, 2000, size)
    kept = np.round(surface * np.clip(rng.normal(0.7, 0.1, size), 0.0, 1.0)).astype(int)
    pairs = [{Reason(0): k, Reason.OUTSIDE: n - k, Reason.SKY: 4000 - n} for k, n in zip(kept, surface, strict=True)]
    expected, held, widths, errors = 100.0 * kept.sum() / surface.sum(), 0, [], []
    for _ in range(300):
        sample = sample_pairs(size, "strata", 5, rng)
        stats = stats_of({}, *(pairs[p] for p in sample.positions))
        mean = stats.block("camera", np.zeros(10, bool), sample.weights)["shading"]["mean_percent"]
        width = estimate(sample, stats.residuals("shading", sample.weights)).half_width
        held += abs(mean - expected) <= width
        widths.append(width)
        errors.append(mean - expected)
    assert 0.88 <= held / 300 <= 1.0
    assert np.median(widths) < 5.0 * np.std(errors)


def test_the_histogram_of_a_run_is_the_sum_over_its_pairs_in_any_split():
    whole = stats_of({}, PAIR, PAIR, {Reason.OUTSIDE: 2**32 - 1}, {Reason.OUTSIDE: 2**32 - 1}).histogram()
    assert whole["words"] == sorted(whole["words"])
    found = dict(zip(whole["words"], whole["pixels"], strict=True))
    assert found[int(Reason.OUTSIDE)] == 2 * (50 + 2**32 - 1)
    assert found[int(Reason.NORMAL | Reason.INDIRECT)] == 12
    assert sum(found.values()) == 2 * TOTAL + 2 * (2**32 - 1)
