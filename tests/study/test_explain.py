"""Why a finer dial may err more: masks compared pixel by pixel, and what is said of them."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.animation import choose_camera
from taubench_gl.conventions import Reason
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.metrics.counts import percent
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings
from taubench_gl.study.analysis import Sanity
from taubench_gl.study.explain import Apart, apart, explained, masks_of


def mask(rows, reason=Reason.POSITION):
    """A mask from a drawing: # is discarded."""
    return np.array([[int(reason) if c == "#" else 0 for c in row] for row in rows], dtype=np.uint32)


def test_wrong_and_missed_pixels_by_hand():
    found = apart({3: mask(["##..", "....", "..#.", "...."])}, {3: mask([".#..", "....", ".##.", "...."])}, "position")
    assert (found.wrong, found.missed, found.pairs) == (100 / 16, 100 / 16, 1)
    assert found.left == 0.0 and found.otherwise == 200 / 16, "they cancel in the column, not in the pixels"
    assert found.border == 0.5, "one of the two lies at the edge of the picture"


def test_what_one_pair_lacks_does_not_cancel_what_another_has_too_much():
    found = apart({1: mask(["#."]), 2: mask([".."])}, {1: mask([".."]), 2: mask(["#."])}, "position")
    assert (found.wrong, found.missed, found.left) == (25.0, 25.0, 50.0)


def test_other_columns_do_not_count():
    found = apart({1: mask(["#."], Reason.NORMAL)}, {1: mask([".."], Reason.NORMAL)}, "position")
    assert found.otherwise == 0.0 and found.border == 0.0
    assert apart({1: mask(["#."], Reason.OUTSIDE)}, {1: mask([".."])}, "frustum").wrong == 50.0
    assert apart({1: mask(["#."], Reason.BEHIND)}, {1: mask([".."])}, "frustum").wrong == 50.0


def test_a_coarser_mask_is_read_at_the_pixel_centres_of_the_finer():
    fine = mask(["##..", "##..", "....", "...#"])
    found = apart({1: mask(["#.", ".."])}, {1: fine}, "position")
    assert (found.wrong, found.missed) == (0.0, 100 / 16)
    assert found.border == 1.0, "a coarse pixel is two wide: everything is within one of the border"


def test_only_common_pairs_are_compared():
    a = {1: mask(["#."]), 2: mask(["##"])}
    found = apart(a, {2: mask([".."]), 3: mask(["##"])}, "position")
    assert (found.wrong, found.pairs) == (100.0, 1)


FAULT = Sanity("scale", "position", ((0.25, 0.1), (0.5, 1.0)), False, "0.5 is further off", ((0.25, 0.5),))


@pytest.mark.parametrize(
    ("coarse", "fine", "begins"),
    [
        # Fewer pixels are wrong, but they no longer cancel.
        (Apart(3.0, 2.9, 0.0, 0.1, 4), Apart(1.5, 0.5, 0.0, 1.0, 4), "explained: fewer pixels"),
        # More pixels are wrong: the finer setting is worse.
        (Apart(0.5, 0.4, 0.0, 0.1, 4), Apart(1.5, 0.5, 0.0, 1.0, 4), "not explained"),
        # Fewer pixels are wrong, and less is left of them at these pixel centres: it does not explain a rise.
        (Apart(3.0, 2.0, 0.0, 1.0, 4), Apart(1.5, 1.4, 0.0, 0.1, 4), "not explained"),
    ],
)
def test_what_is_said_of_a_rise(coarse, fine, begins):
    words = explained(FAULT, {0.25: coarse, 0.5: fine})
    assert words.startswith(begins) and f"{coarse.wrong:.3g} wrongly discarded" in words and "border" not in words


def test_what_no_pixel_centre_shows_is_not_told_as_a_difference():
    same = Apart(0.5, 0.25, 0.0, 0.25, 4)
    words = explained(FAULT, {0.25: same, 0.5: same})
    assert words == "not explained: at pixel centres of 4 pairs both judge 0.75 % otherwise than the reference"


def test_the_border_is_named_where_most_of_it_lies_there():
    words = explained(FAULT, {0.25: Apart(3.0, 2.9, 0.8, 0.1, 4), 0.5: Apart(1.5, 0.5, 0.2, 1.0, 4)})
    assert words.endswith("next to the border lie 80 % of them at 0.25")


def test_masks_add_up_to_the_columns(demo):
    scene = load_scene(demo)
    settings = Settings(width=48, height=28, frames=(20, 24), columns=("frustum", "position", "normal"))
    camera = choose_camera(scene)
    run = evaluate_scene(scene, settings, camera=camera)
    fine = masks_of(scene, camera, settings, (20, 24))
    none = {frame: np.zeros_like(m) for frame, m in fine.items()}
    for column in ("frustum", "position", "normal"):
        found = apart(fine, none, column)
        assert found.wrong == pytest.approx(np.mean([percent(row, column) for row in run.frames]), rel=1e-12)
        assert apart(fine, fine, column).otherwise == 0.0
