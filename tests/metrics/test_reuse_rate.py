"""Reuse rates and disjoint reasons against masks made by hand."""

from __future__ import annotations

import itertools
from math import fsum

import numpy as np
import pytest

from taubench_gl.conventions import COLUMNS, FEATURES, HISTOGRAM_BINS, Reason
from taubench_gl.frame.counting import SequenceStats
from taubench_gl.frame.passes.masks import Counts
from taubench_gl.glossary import REUSE_REASONS
from taubench_gl.metrics.counts import counts_of
from taubench_gl.metrics.pair_sample import PairSample, estimate
from taubench_gl.metrics.reuse_rate import (
    ReuseStats,
    disjoint_reasons,
    reusable_pixels,
    unmeasured_rates,
)

NO_CUT = np.zeros(2, dtype=bool)
PAIR = {
    Reason(0): 400,
    Reason.SKY | Reason.HISTORY_SKY: 100,  # sky on sky: reusable
    Reason.COLOR: 7,  # color alone: reusable
    Reason.FIRST: 1,
    Reason.CUT: 2,
    Reason.INVALID: 3,
    Reason.BEHIND: 4,
    Reason.SKY | Reason.OUTSIDE: 50,
    Reason.POSITION | Reason.NORMAL | Reason.OCCLUDING | Reason.HISTORY_SKY: 20,
    Reason.POSITION | Reason.DISOCCLUDED | Reason.DIRECT | Reason.LIT | Reason.COLOR: 90,
    Reason.POSITION: 5,
    Reason.NORMAL | Reason.INDIRECT: 6,
    Reason.DIRECT | Reason.LIT: 30,
    Reason.DIRECT | Reason.SHADOWED | Reason.INDIRECT: 31,
    Reason.DIRECT: 8,
    Reason.INDIRECT | Reason.COLOR: 9,
}


def histogram(pixels: dict[Reason, int]) -> np.ndarray:
    out = np.zeros(1 << 16, dtype=np.uint32)
    for word, count in pixels.items():
        out[int(word)] = count
    return out


def stats_of(unmeasured: dict[str, str], *pairs: dict[Reason, int]) -> ReuseStats:
    stats = ReuseStats(unmeasured)
    for pair in pairs:
        stats.add(histogram(pair))
    return stats


def test_rates_and_reasons_of_a_mask_made_by_hand():
    shading = 400 + 100 + 7
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
    counts = np.random.default_rng(1).integers(0, 2**32, 1 << 16, dtype=np.uint32)
    total = reusable_pixels(counts)[rate] + sum(disjoint_reasons(counts, rate).values())
    assert total == int(counts.astype(np.int64).sum())


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
    assert (counts["reusable_surface"], counts["reusable_shading"]) == (585, 507)


def test_means_add_up_to_100_percent():
    other = {Reason(0): 700, Reason.OUTSIDE: 66}
    block = stats_of({}, PAIR, other).block("camera", NO_CUT)
    total = sum(PAIR.values())
    assert total == 766 == sum(other.values())
    assert block["reasons_of"] == "shading"
    assert block["shading"]["pixels"] + sum(e["pixels"] for e in block["reasons"].values()) == 2 * total
    shares = [block["shading"]["mean_percent"], *(e["mean_percent"] for e in block["reasons"].values())]
    assert fsum(shares) == pytest.approx(100.0, abs=1e-12)
    assert block["shading"]["mean_percent"] == pytest.approx(50.0 * (507 + 700) / 766)
    assert block["shading"]["min_percent"] == pytest.approx(100.0 * 507 / 766)
    assert block["shading"]["max_percent"] == pytest.approx(100.0 * 700 / 766)
    comparable = total - (1 + 2 + 3 + 4 + 50)
    assert block["shading"]["comparable_mean_percent"] == pytest.approx(50.0 * (507 / comparable + 1.0))
    assert block["color_only"] == {"mean_percent": pytest.approx(50.0 * 7 / 766), "pixels": 7}


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
        assert block[expected]["pixels"] + sum(e["pixels"] for e in block["reasons"].values()) == 766
    assert (block["color_only"] is None) == ("color" in missing or expected != "shading")
    assert block["reprojection"] == "motion"


def test_a_run_without_pairs_has_no_rate():
    block = ReuseStats({}).block("camera", np.zeros(0, dtype=bool))
    assert all(block[rate]["mean_percent"] is None and block[rate]["reason"] for rate in ("surface", "shading"))
    assert block["reasons"] == {} and block["reasons_of"] is None and block["color_only"] is None


def test_sampled_pairs_are_weighted_by_their_stratum():
    sample = PairSample(10, ((8, (0, 4)), (2, (8,))))
    assert sample.weights.tolist() == [0.4, 0.4, 0.2]
    pairs = [{Reason(0): 100 - out, Reason.OUTSIDE: out} for out in (0, 50, 100)]
    stats = stats_of({}, *pairs)
    block = stats.block("camera", np.zeros(3, dtype=bool), sample.weights)
    assert block["shading"]["mean_percent"] == pytest.approx(0.4 * 100 + 0.4 * 50)
    assert block["reasons"]["outside"]["mean_percent"] == pytest.approx(0.4 * 50 + 0.2 * 100)
    assert estimate(sample, stats.per_pair("shading")).mean == pytest.approx(block["shading"]["mean_percent"])


def test_the_histogram_of_a_run_is_the_sum_over_its_pairs_in_any_split():
    whole = stats_of({}, PAIR, PAIR, {Reason.OUTSIDE: 2**32 - 1}, {Reason.OUTSIDE: 2**32 - 1}).histogram()
    assert whole["words"] == sorted(whole["words"])
    found = dict(zip(whole["words"], whole["pixels"], strict=True))
    assert found[int(Reason.OUTSIDE)] == 2 * (2**32 - 1)
    assert found[int(Reason.NORMAL | Reason.INDIRECT)] == 12
    assert sum(found.values()) == 2 * 766 + 2 * (2**32 - 1)
