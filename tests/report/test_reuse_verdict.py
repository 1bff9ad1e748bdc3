"""The sentence above a reuse evaluation: the best method, and where it gains and loses."""

from __future__ import annotations

from copy import deepcopy

import pytest

from taubench_gl.report.reuse import flip_notes, verdict


def method(flip: float, *, disoccluded: float, lit: float, rest: float, yardstick: str | None = None) -> dict:
    """Mean FLIP and those of three classes with 20, 30 and 50 % of the pixels."""
    shares = {"disoccluded": (20.0, disoccluded), "lit": (30.0, lit), "rest": (50.0, rest)}
    return {
        "failed": None, "mean": {"flip": flip, "psnr_db": 20.0}, "yardstick": yardstick,
        "classes": {name: {"percent": share, "pixels": 10, "flip": error} for name, (share, error) in shares.items()},
    }  # fmt: skip


SUMMARY = {
    "measures": {"flip": {"better": "lower"}, "psnr_db": {"better": "higher"}},
    "methods": {
        "none": method(0.2, disoccluded=0.2, lit=0.2, rest=0.2),
        "blend": method(0.1, disoccluded=0.2, lit=0.25, rest=0.02),
        "cheat": method(0.01, disoccluded=0.0, lit=0.0, rest=0.0, yardstick="reads reference"),
        "other": method(0.11, disoccluded=0.1, lit=0.1, rest=0.1),
    },
}


def changed(**methods: dict) -> dict:
    summary = deepcopy(SUMMARY)
    summary["methods"] |= methods
    return summary


def test_the_best_method_with_its_largest_gain_and_loss():
    """0.09 of 0.2 less in half of the pixels, 0.05 more in 30 %; the class without a difference is not named."""
    text = verdict(SUMMARY)
    assert "blend is best (0.1000; no reuse 0.2000)" in text and "cheat" not in text
    gains, losses = text.split(" Against no reuse it ")[1].split(" and loses in ")
    assert "unchanged" in gains and "brightened" in losses and "disoccluded" not in text


def test_methods_that_the_data_do_not_tell_apart_are_named():
    ranking = [{"method": m, "rank": r} for m, r in (("blend", 1), ("other", 1), ("cheat", 1), ("none", 3))]
    text = verdict(SUMMARY | {"statistics": {"measures": {"flip": {"ranking": ranking}}}})
    assert "indistinguishable from other" in text.split(". Against")[0]


def test_no_reuse_can_be_the_best_and_failed_methods_are_left_out():
    text = verdict(changed(none=method(0.05, disoccluded=0.05, lit=0.05, rest=0.05)))
    assert "none is best" in text and "Against" not in text
    text = verdict(changed(blend={"failed": "does not compile", "frames": 0}))
    assert "other is best" in text


def test_without_flip_it_is_psnr_of_which_more_is_better():
    summary = deepcopy(SUMMARY)
    for name, decibels in (("none", 20.0), ("blend", 24.0), ("other", 28.0)):
        summary["methods"][name]["mean"] = {"flip": None, "psnr_db": decibels}
    assert "other is best (28.00; no reuse 20.00)" in verdict(summary)


def test_one_method_has_no_verdict():
    summary = deepcopy(SUMMARY)
    summary["methods"] = {name: summary["methods"][name] for name in ("blend", "cheat")}
    assert verdict(summary) is None


@pytest.mark.parametrize(("width", "notes"), [(96, 1), (669, 1), (670, 0), (1920, 0)])
def test_a_warning_where_flip_sees_less_than_ten_degrees(width, notes):
    """67 pixels are a degree: 670 pixels are ten; without FLIP there is nothing to warn of."""
    summary = SUMMARY | {"settings": {"width": width}}
    assert len(flip_notes(summary)) == notes and all(
        f"{width / 67:.1f} degrees" in note for note in flip_notes(summary)
    )
    without = {name: method | {"mean": {"flip": None}} for name, method in SUMMARY["methods"].items()}
    assert not flip_notes(summary | {"methods": without})
