"""Statistics of evaluations from rows: verdicts, Holm's correction, rankings, convergence."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.reuse.comparison import FEW_FRAMES, FEW_SEEDS, NOT_FINITE, compare_methods, over_frames, series_of
from taubench_gl.reuse.quality import MEASURES

FRAMES = range(1, 41)


def rows_of(methods: dict[str, np.ndarray], first: int = 1, measure: str = "flip") -> list[dict]:
    """Rows with one measure.  ``methods``: label -> (seeds, frames)."""
    empty = dict.fromkeys(MEASURES)
    return [
        empty | {"method": label, "seed": seed, "frame": first + i, measure: value}
        for label, values in methods.items()
        for seed, one in enumerate(values)
        for i, value in enumerate(one)
    ]


def noise(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(shape)


def test_large_and_small_differences():
    content = 0.1 * noise(1, 1, 40)
    methods = {
        "good": 1.0 + content + 0.01 * noise(2, 1, 40),
        "same": 1.0 + content + 0.01 * noise(3, 1, 40),
        "bad": 1.2 + content + 0.01 * noise(4, 1, 40),
    }
    found = compare_methods(rows_of(methods), FRAMES)["measures"]["flip"]
    by_pair = {(d["a"], d["b"]): d for d in found["differences"]}
    assert by_pair["good", "same"]["low"] < 0 < by_pair["good", "same"]["high"]
    assert by_pair["good", "same"]["verdict"].startswith("statistically indistinguishable (interval ")
    assert by_pair["good", "bad"]["high"] < 0 and by_pair["good", "bad"]["p_holm"] < 1e-6
    assert by_pair["good", "bad"]["difference"] == pytest.approx(np.mean(methods["good"] - methods["bad"]))
    ranks = {r["method"]: (r["rank"], r["last_rank"], r["indistinguishable"]) for r in found["ranking"]}
    assert ranks == {"good": (1, 2, ["same"]), "same": (1, 2, ["good"]), "bad": (3, 3, [])}
    # Unpaired, the content of the frames would hide nothing of 0.2, but would widen the interval tenfold.
    assert by_pair["good", "same"]["high"] - by_pair["good", "same"]["low"] < 0.02


def test_holm_can_take_back_a_single_difference():
    # One small difference among many equal methods: significant alone, not among 28 pairs.
    methods = {f"m{k}": 1.0 + 0.02 * noise(10 + k, 1, 40) for k in range(8)}
    methods["m0"] += 1.01 - methods["m0"].mean()
    methods["m1"] += 1.0 - methods["m1"].mean()
    found = compare_methods(rows_of(methods), FRAMES)["measures"]["flip"]["differences"]
    alone = [d for d in found if d["p_value"] < 0.05]
    assert alone and all(d["p_holm"] >= d["p_value"] for d in found)
    taken_back = [d for d in alone if d["p_holm"] >= 0.05]
    assert taken_back and all("Holm" in d["verdict"] for d in taken_back)


def test_decibels_are_of_the_mean_squared_error():
    mse = np.array([[0.01, 0.1] * 20])
    rows = rows_of({"a": 10.0 * np.log10(1.0 / mse), "b": 10.0 * np.log10(0.5 / mse)}, measure="psnr_db")
    found = compare_methods(rows, FRAMES)["measures"]["psnr_db"]
    assert found["means"]["a"]["mean"] == pytest.approx(10.0 * np.log10(1.0 / 0.055))
    (pair,) = found["differences"]
    assert pair["difference"] == pytest.approx(10.0 * np.log10(2.0)) == pytest.approx(pair["low"])
    assert pair["verdict"].startswith("a is better")  # b has half the signal to noise: higher is better


def test_a_difference_that_is_not_finite_says_why():
    columns = np.concatenate([np.ones(2), np.zeros(10)])[:, None]
    found = over_frames(columns, lambda means: np.log10(means[..., 0]), columns[:, 0])
    assert found["low"] is found["p_value"] is None and found["interval_reason"] == NOT_FINITE


def test_few_frames_and_few_seeds_have_no_interval():
    values = 1.0 + 0.1 * noise(1, 4, 5)
    found = compare_methods(rows_of({"a": values, "b": values + 1.0}), range(1, 6))["measures"]["flip"]
    assert found["reason"] == FEW_FRAMES and found["means"]["a"]["block_length"] is None
    assert found["means"]["a"]["low"] is None and found["ranking"][0]["rank"] is None
    assert found["means"]["a"]["over_seeds"] is None and found["means"]["a"]["over_seeds_reason"] == FEW_SEEDS
    five = 1.0 + 0.1 * noise(1, 5, 5)
    over = compare_methods(rows_of({"a": five}), range(1, 6))["measures"]["flip"]["means"]["a"]["over_seeds"]
    assert over["mean"] == pytest.approx(five.mean()) and over["low"] < over["mean"] < over["high"]


def test_seeds_of_a_block_stay_together():
    # Seeds that repeat the same frames add no information: the interval of five equal seeds is that of one.
    one = 1.0 + 0.1 * noise(6, 1, 40)
    single, fivefold = (
        compare_methods(rows_of({"a": values}), FRAMES)["measures"]["flip"]["means"]["a"]
        for values in (one, np.repeat(one, 5, axis=0))
    )
    assert fivefold["low"] == pytest.approx(single["low"]) and fivefold["high"] == pytest.approx(single["high"])


def test_method_without_values_is_left_out_by_name():
    rows = rows_of({"a": np.ones((1, 40)), "b": np.ones((1, 40))})
    rows[-1] = rows[-1] | {"flip": None}
    found = compare_methods(rows, FRAMES)["measures"]["flip"]
    assert list(found["means"]) == ["a"] and list(found["left_out"]) == ["b"]
    assert series_of(rows, "ssim").values == {}


def test_convergence_is_by_frames_since_the_cut():
    values = np.array([[4.0, 2.0, 1.0, 8.0, 4.0, 2.0, 1.0]])
    rows = rows_of({"a": values, "b": np.stack([values[0], 3 * values[0]])}, first=0, measure="linear_mse")
    found = compare_methods(rows, range(1, 7), cuts=(3,))["convergence"]
    assert found["starts"] == [0, 3]
    assert found["methods"] == {"a": [6.0, 3.0, 1.5], "b": [12.0, 6.0, 3.0]}
