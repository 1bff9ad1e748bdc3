"""Both eyes in the viewer: the counts of ``evaluate``, with any camera, from the first frame on."""

from __future__ import annotations

import numpy as np
import pytest
from viewer_tools import DEMO, QUIET, evaluated

from taubench_gl.animation import choose_camera
from taubench_gl.animation.eyes import both_eyes
from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.frame.targets import read_channel
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.usefixtures("coarse_light")

EYE = QUIET.replace(history="eye", eyes=0.2, convergence=3.0)


def test_counts_are_those_of_evaluate_and_the_history_can_change(drive):
    driven = drive(settings=EYE)
    for frame, settings, line in ((8, EYE, "frame 8"), (8, EYE.replace(history="frame"), "set history frame"),
                                  (9, EYE, "set history eye\nframe 9")):  # fmt: skip
        driven.run(line)
        assert driven.counts_are_those_of(evaluated(frame, settings)) and driven.engine.counts["position"] > 0


def test_the_first_frame_and_a_free_camera_have_another_eye(drive):
    driven = drive(settings=EYE)
    driven.run("frame 0")
    assert driven.engine.counts["first"] == 0 < driven.engine.counts["position"]
    driven.run("frame 5\nset camera fly\nhold W 3")
    other, view = (shot.view for shot in driven.engine.shots)
    np.testing.assert_allclose(other.position - view.position, 0.2 * view.world_from_view[:, 0], atol=1e-12)
    assert np.array_equal(other.world_from_view, view.world_from_view) and other.shift == -0.2 / 3.0
    assert [shot.frame for shot in driven.engine.shots] == [5, 5]
    rows, columns = np.nonzero(driven.engine.mask() & np.uint32(FRUSTUM))
    driven.run(f"set probe {columns[0]},{rows[0]}")
    assert "other eye" in driven.engine.explain(driven.viewer.state).reason


def test_both_histories_begin_with_the_last_frame(drive):
    driven = drive(settings=EYE.replace(history="both"))
    assert driven.viewer.state.live.history == "frame"
    driven.run("set history eye\nframe 4\nset against history\nset comparison difference\nset beside on")
    assert driven.counts_are_those_of(evaluated(4, EYE), "position") and driven.engine.counts["position"] > 0


def test_the_image_beside_has_the_masks_of_the_other_eye(drive):
    scene, settings = load_scene(DEMO), EYE.replace(frames=(7, 9))
    camera, there = both_eyes(scene, choose_camera(scene), settings)["right"]
    row = evaluate_scene(scene, there, camera=camera).frames[0]
    driven = drive(settings=EYE)
    driven.run("frame 8\nset against history\nset comparison difference\nset beside on")
    mask = read_channel(driven.engine._reversed.mask_texture, "mask")[..., 0]
    assert np.count_nonzero(mask & np.uint32(FRUSTUM)) == row["frustum"]
    assert np.count_nonzero(mask & np.uint32(Reason.POSITION)) == row["position"] > 0
    assert driven.engine.titles(driven.viewer.state)[1] == "the other eye"
