"""Scores that few pixels decide: emitters apart, clipped radiance, the two halves of a reference, ties, yardsticks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from reuse_scenes import still
from reuse_tools import evaluate, truth_of, with_weight

from taubench_gl.metrics.blending import blend, nearest_clipped_weight, nearest_weight
from taubench_gl.report.reuse import BELOW_NOISE, reuse_tables
from taubench_gl.reuse import quality
from taubench_gl.reuse.bound import Blended, BoundRecord, bound_of_frame
from taubench_gl.reuse.comparison import compare_methods
from taubench_gl.reuse.quality import MEASURES, WHITE
from taubench_gl.reuse.scores import FrameTruth, MethodRecord

H, W = 20, 50
RNG = np.random.default_rng(7)


def record_of(image: np.ndarray, reference: FrameTruth) -> MethodRecord:
    record = MethodRecord("a", frozenset(), True, warmup=0)
    record.begin(0)
    record.add(reference, with_weight(image), "linear", None)
    return record


def test_product_of_the_errors_against_two_halves_is_unbiased():
    """All 16 pairs of halves of a truth that lie a distance off with equal probability: the exact expectation."""
    truth, image, off = RNG.random((3, H, W, 3))
    signs = list(itertools.product((-1.0, 1.0), repeat=2))
    products = [quality.independent_squared_error(image, truth + s * off, truth + t * off) for s, t in signs]
    np.testing.assert_allclose(np.mean(products, axis=0), ((image - truth) ** 2).mean(axis=-1), rtol=1e-9, atol=1e-15)
    biased = [quality.linear_squared_error(image, truth + 0.5 * (s + t) * off) for s, t in signs]
    noise = np.mean(biased) - np.mean(products)
    assert noise == pytest.approx((off**2).mean() / 2.0)
    everywhere = np.ones((H, W), bool)
    halves = [
        quality.half_noise(truth + s * off, truth + t * off, "linear", everywhere)["linear_mse"] for s, t in signs
    ]
    assert np.mean(halves) == pytest.approx(noise)  # what the noise of the reference adds


def test_error_below_the_noise_of_the_reference_is_negative_and_said_to_be_below_it():
    truth = np.full((H, W, 3), 0.5)
    record = record_of(truth, truth_of(truth, halves=(truth + 0.1, truth - 0.1)))
    assert record.rows[0]["linear_mse"] == pytest.approx(-0.01) and record.rows[0]["relmse"] == 0.0
    assert record.summary()["classes"]["rest"]["linear_mse"] == pytest.approx(-0.01)


def test_emitters_are_left_out_of_linear_errors_and_have_their_own():
    truth = np.full((H, W, 3), 0.5)
    image, emitters = truth + 0.1, np.zeros((H, W), bool)
    emitters[3, 4:6] = True
    truth = np.where(emitters[..., None], 286.0, truth)
    record = record_of(image, truth_of(truth, emitters=emitters))
    row, mean = record.rows[0], record.summary()
    assert row["linear_mse"] == row["clipped_mse"] == pytest.approx(0.01)
    assert row["relmse"] == pytest.approx(0.01 / 0.26)
    assert row["emitter_percent"] == pytest.approx(0.2) and row["emitter_linear_mse"] == pytest.approx(285.4**2)
    assert mean["classes"]["rest"]["linear_mse"] == pytest.approx(0.01) and mean["classes"]["rest"]["pixels"] == H * W
    plain = record_of(image, truth_of(truth))
    assert plain.rows[0]["psnr_db"] == row["psnr_db"] and plain.rows[0]["emitter_percent"] is None
    blended = Blended(image, truth, np.ones((H, W), bool), None)
    bound = bound_of_frame(blended, with_weight(image), truth, np.ones((H, W), bool), emitters)
    assert bound.method_mse == pytest.approx(0.01) and bound.mse == 0.0


def test_share_of_the_largest_thousandth_of_the_pixels():
    truth = np.zeros((H, W, 3))
    image = np.full_like(truth, 0.1)
    image[0, 0] = 3.0  # 1 of 1000 pixels
    share = record_of(image, truth_of(truth)).summary()["tail_percent"]
    assert share["linear_mse"] == pytest.approx(100.0 * 9.0 / (9.0 + 999 * 0.01))
    image[0, 0] = 300.0
    clipped = record_of(image, truth_of(truth))
    assert clipped.rows[0]["clipped_mse"] == pytest.approx((WHITE**2 + 999 * 0.01) / 1000)


def test_clipped_bound_is_the_best_of_all_weights():
    reference, now, history = 4.0 * RNG.random((3, 20, 20, 3)) ** 2 * np.array([1.0, 3.0, 8.0])[:, None, None, None]
    plain = nearest_weight(reference, now, history)
    weight = nearest_clipped_weight(reference, now, history, WHITE, plain)
    target = np.minimum(reference, WHITE)

    def error(w):
        return ((np.minimum(blend(now, history, w), WHITE) - target) ** 2).sum(axis=-1)

    grid = np.min([error(np.full((20, 20), w)) for w in np.linspace(0.0, 1.0, 2001)], axis=0)
    assert (error(weight) <= grid + 1e-9).all() and (grid - error(weight)).max() < 0.02
    assert (error(plain) > error(weight) + 1e-3).any()
    dark = (0.1 * reference, 0.1 * now, 0.1 * history)
    np.testing.assert_array_equal(nearest_clipped_weight(*dark, WHITE, nearest_weight(*dark)), nearest_weight(*dark))


def test_headroom_has_the_ratio_of_the_means_and_its_intervals():
    record, everywhere = BoundRecord(), np.ones((4, 5), bool)
    for seed in range(5):
        for _ in range(24):
            now = np.full((4, 5, 3), 0.4 + 0.04 * RNG.random())
            blended = Blended(now, np.full_like(now, 0.6), everywhere, None)
            frame = bound_of_frame(blended, with_weight(now + 0.1), np.full_like(now, 0.7), everywhere)
            record.seeds.setdefault(seed, []).append(frame)
    bound = record.summary()
    expected = 10.0 * np.log10(bound["method_linear_mse"] / bound["linear_mse"])
    interval = bound["intervals"]["headroom_db"]
    assert bound["headroom_db"] == pytest.approx(expected)
    assert interval["low"] < expected < interval["high"]
    assert interval["over_seeds"]["low"] < interval["over_seeds"]["high"]


def rows_of(**errors: np.ndarray) -> list[dict]:
    """``clipped_mse`` and ``linear_mse`` of methods, (frames,) each."""
    return [
        dict.fromkeys(MEASURES) | {"method": m, "seed": 0, "frame": f, "clipped_mse": v, "linear_mse": v}
        for m, values in errors.items() for f, v in enumerate(values)
    ]  # fmt: skip


def test_differences_within_the_noise_of_the_reference_are_ties():
    base = 1.0 + 0.01 * RNG.random(24)
    rows = rows_of(a=base, b=base + 0.1, c=base + 0.5)
    ranks = {}
    for noise in (0.01, 0.2):
        block = compare_methods(rows, range(24), noise={"clipped_mse": noise})["measures"]["clipped_mse"]
        ranks[noise] = [(e["method"], e["rank"], e["last_rank"]) for e in block["ranking"]]
        assert [d["tied"] for d in block["differences"]] == [noise > 0.1, False, False]
    assert ranks[0.01] == [("a", 1, 1), ("b", 2, 2), ("c", 3, 3)]
    assert ranks[0.2] == [("a", 1, 2), ("b", 1, 2), ("c", 3, 3)]


def test_unbounded_radiance_ranks_by_its_clipped_twin():
    measures = compare_methods(rows_of(a=np.ones(24), b=np.full(24, 2.0)), range(24))["measures"]
    assert measures["linear_mse"]["ranking"] == [] and measures["linear_mse"]["ranked_by"] == "clipped_mse"
    assert len(measures["linear_mse"]["means"]) == len(measures["clipped_mse"]["ranking"]) == 2


class Cheat:
    """Returns the reference."""

    reads = ("reference",)

    def __init__(self, size, settings): ...

    def step(self, frame):
        return frame["reference"]


def test_method_that_returns_the_reference_is_in_no_ranking_and_no_difference():
    methods = ["none", "accumulate", f"{__name__}:Cheat"]
    done = evaluate(still(), methods, (0, 10), input="noisy", metrics=("relmse",))
    cheat, label = done.summary["methods"][methods[2]], methods[2]
    assert cheat["yardstick"] and cheat["mean"]["linear_mse"] < 1e-12
    measures = done.summary["statistics"]["measures"]
    assert label in measures["clipped_mse"]["means"]
    for block in measures.values():
        assert all(label not in (d["a"], d["b"]) for d in block["differences"])
        assert label not in [entry["method"] for entry in block["ranking"]]
    alone = evaluate(still(), methods[:2], (0, 10), input="noisy", metrics=("relmse",))
    assert (
        alone.summary["statistics"]["measures"]["clipped_mse"]["differences"] == measures["clipped_mse"]["differences"]
    )


def test_tables_say_what_is_below_the_noise():
    done = evaluate(still(), ["none"], (0, 3), input="noisy", metrics=("relmse",))
    method = done.summary["methods"]["none"]
    method["mean"]["linear_mse"] = -1e-6
    (table,) = [t for t in reuse_tables(done.summary) if t.number == 7]
    assert table.rows[0].values[0] is None and table.rows[0].reasons[0] == BELOW_NOISE
