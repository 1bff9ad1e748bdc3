"""A declared cut: every method of an evaluation starts again there, as if the frames began with it."""

from __future__ import annotations

import pytest
from fixed import fixed_settings

from taubench_gl.paths import ASSETS
from taubench_gl.reuse import evaluate_methods

pytestmark = pytest.mark.usefixtures("coarse_light")

METHODS = ("accumulate", "svgf", "ideal-masks")
FIRST, CUT, LAST = 21, 23, 24
ERRORS = ("linear_mse", "psnr_db", "relmse")
SAME = (*ERRORS, "reused_percent", "mean_weight")


def rows_of(frames: tuple[int, int], cuts: tuple[int, ...]) -> dict[tuple[str, int], dict]:
    settings = fixed_settings(width=48, height=28, frames=frames, reprojection="motion", indirect="none")
    done = evaluate_methods(
        ASSETS / "demo.glb",
        METHODS,
        settings,
        input="noisy",
        reference_samples=1,
        metrics=("psnr", "relmse"),
        cuts=cuts,
    )
    assert not done.failed
    return {(row["method"], row["frame"]): row for row in done.rows}


@pytest.fixture(scope="module")
def runs():
    return {
        "cut": rows_of((FIRST, LAST + 1), (CUT,)),
        "whole": rows_of((FIRST, LAST + 1), ()),
        "fresh": rows_of((CUT, LAST + 1), ()),
    }


@pytest.mark.parametrize("method", METHODS)
def test_frames_from_a_cut_on_are_those_of_an_evaluation_that_begins_there(runs, method):
    for frame in range(CUT, LAST + 1):
        found, fresh = runs["cut"][method, frame], runs["fresh"][method, frame]
        names = ERRORS if frame == CUT else SAME  # reuse of the first frame is not measured
        assert {name: found[name] for name in names} == {name: fresh[name] for name in names}
    assert runs["cut"][method, CUT]["reused_percent"] == 0.0
    assert runs["whole"][method, CUT]["reused_percent"] > 50.0


@pytest.mark.parametrize("method", METHODS)
def test_frames_before_a_cut_are_unchanged(runs, method):
    for frame in range(FIRST, CUT):
        found, whole = runs["cut"][method, frame], runs["whole"][method, frame]
        assert {name: found[name] for name in SAME} == {name: whole[name] for name in SAME}
