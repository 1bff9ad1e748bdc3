"""Validation of the chosen configuration: the rule, and a study with a synthetic clock."""

from __future__ import annotations

import json

import pytest
from cost_tools import point

from taubench_gl.cost import choose, cost
from taubench_gl.cost.analysis import validate

BASELINE = point("baseline", 0.0, 20.0)
CHEAP = point("cheap", 0.2, 10.0)


def validated(frame_ms, baseline_ms, percent=10.2, **limits):
    repeated = {"percent": {"direct": percent}, "frame_ms": frame_ms, "baseline_ms": baseline_ms}
    choice = choose([BASELINE, CHEAP], ("direct",), **limits)
    return validate(choice, BASELINE.time, {"direct": 10.0}, repeated)


def test_errors_are_compared_with_the_limit():
    assert validated([1.0] * 3, [2.0] * 3, within=0.25)["errors_pass"]
    worse = validated([1.0] * 3, [2.0] * 3, percent=10.3, within=0.25)
    assert not worse["errors_pass"] and worse["errors"]["direct"] == pytest.approx(0.3)
    assert worse["time_pass"] is None and worse["allowed_ratio"] is None, "without a budget time is not validated"


def test_without_a_limit_errors_are_compared_with_the_measured_ones():
    found = validated([10.0] * 3, [20.0] * 3, budget_ms=12.0)
    assert found["limit_points"] == 0.2 and found["errors_pass"]


@pytest.mark.parametrize("pace", [0.2, 1.0, 7.0])
def test_budget_is_a_ratio_to_the_baseline(pace):
    # 12 ms were 0.6 of the baseline's 20 ms.  The configuration takes half the baseline on a machine of any speed.
    found = validated([10.0 * pace] * 5, [20.0 * pace] * 5, budget_ms=12.0)
    assert found["allowed_ratio"] == 0.6 and found["ratio"] == 0.5 and found["time_pass"]
    assert found["baseline_drift"] == pytest.approx(pace)
    slow = validated([14.0 * pace] * 5, [20.0 * pace] * 5, budget_ms=12.0)
    assert slow["ratio"] == pytest.approx(0.7) and not slow["time_pass"]


def test_load_within_a_round_cancels():
    load = [1.0, 9.0, 2.0, 30.0, 4.0]
    found = validated([10.0 * x for x in load], [20.0 * x for x in load], budget_ms=12.0)
    assert (found["ratio"], found["ratio_spread"], found["time_pass"]) == (0.5, 0.0, True)


def test_spread_is_subtracted_from_the_ratio():
    found = validated([12.4, 11.0, 12.6, 13.0, 11.6], [20.0] * 5, budget_ms=12.0)
    assert found["ratio"] == pytest.approx(0.62) and found["ratio_spread"] > 0.02 and found["time_pass"]


def test_single_round_has_a_ratio_without_spread():
    found = validated([10.0], [20.0], budget_ms=12.0)
    assert (found["ratio"], found["ratio_spread"]) == (0.5, None)


MS = {"baseline": 20.0, "highest_quality": 50.0, "scale=0.5": 6.0, "storage=half": 15.0}


class Clock:
    """Seconds by a model: each reading takes the time that ``MS`` gives for the configuration being measured.

    The machine becomes 0.005 % slower with every reading.  ``later``: factor on a configuration during validation.
    """

    def __init__(self, later):
        self.seconds, self.pace, self.later, self.step = 0.0, 1.0, later, 0.0

    def __call__(self):
        self.seconds += self.step * self.pace
        self.pace *= 1.00005
        return self.seconds

    def listen(self, step):
        _, _, name = step.what.partition(": ")
        if name in MS and "round" in step.what:
            factor = self.later.get(name, 1.0) if step.what.startswith("validation") else 1.0
            self.step = 4e-3 * MS[name] * factor


@pytest.mark.parametrize(
    ("later", "passes"),
    [
        # The whole machine is three times slower; then the configuration alone.
        pytest.param({"baseline": 3.0, "storage=half": 3.0}, True, marks=pytest.mark.long),
        ({"storage=half": 3.0}, False),
    ],
)
def test_study_validates_its_budget(demo, tmp_path, later, passes):
    clock = Clock(later)
    study = cost(
        demo, out=tmp_path, width=24, height=14, frames=(20, 26), columns=("frustum", "position"), repeats=3,
        parameters=("scale", "storage"), choose_for=("position",), budget_ms=18.5, now=clock, progress=clock.listen,
    )  # fmt: skip
    named = {p.name: p for p in study.points}
    assert named["baseline"].time.median == pytest.approx(20.0, rel=0.5), "by the clock of the test"
    assert study.chosen.point is named["storage=half"], study.chosen.words
    assert study.validation["errors_pass"], "the same settings give the same counts"
    assert study.validation["time_pass"] is passes
    study.save()
    found = json.loads((tmp_path / "study.json").read_text())["validation"]
    assert found["ratio"] == pytest.approx(0.75 * later.get("storage=half", 1.0) / later.get("baseline", 1.0), rel=0.01)
    text = (tmp_path / "study.txt").read_text()
    assert ("FAIL" in text) is not passes and "PASS" in text
