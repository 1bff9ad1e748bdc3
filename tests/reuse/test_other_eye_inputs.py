"""Methods whose history is the other eye: its inputs, motion to it, and two samples where one was."""

from __future__ import annotations

import numpy as np
import pytest
from reuse_scenes import SIZE, settings, still
from reuse_tools import arrays

from taubench_gl.animation import choose_camera
from taubench_gl.animation.eyes import other_eye
from taubench_gl.errors import SettingsError
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.inputs import FrameRequest, RasterInputs

pytestmark = pytest.mark.usefixtures("fixed_light")

READS = ("radiance", "position", "normal", "motion", "mask", "history_position")
EYES = 0.2


def given(gpu, scene, reads=READS, camera=None, kind="full", **more):
    request = FrameRequest(gpu, scene, camera or choose_camera(scene), settings(**more), parse_input(kind, seed=3))
    return RasterInputs(request, reads)


def test_the_history_is_what_a_camera_at_the_other_eye_gets(gpu):
    scene = still()
    chosen = settings(history="eye", eyes=EYES)
    with given(gpu, scene, history="eye", eyes=EYES) as inputs:
        first = inputs.before(0)
        other, before = arrays(first), first
        frame = inputs.advance(0)
        got = arrays(frame)
        again = inputs.before(1)
        assert (before.cut, frame.cut, again.cut) == (True, False, True)
        assert (before.index, frame.index, again.index) == (0, 1, 2)
    with given(gpu, scene, camera=other_eye(scene, choose_camera(scene), chosen)) as there, given(gpu, scene) as here:
        assert np.array_equal(other["radiance"], arrays(there.advance(0))["radiance"])
        assert np.array_equal(got["radiance"], arrays(here.advance(0))["radiance"])
    assert np.array_equal(got["history_position"], other["position"])
    depth = got["position"][..., 3]
    seen = (got["mask"][..., 0] == 0) & (depth > 0)
    focal = 0.5 * SIZE[1] / np.tan(np.radians(25.0))
    np.testing.assert_allclose(got["motion"][seen][:, 0], -focal * EYES / depth[seen], atol=1e-3)
    assert seen.mean() > 0.3 and np.abs(got["motion"][seen][:, 1]).max() < 1e-3


@pytest.mark.parametrize(("history", "methods"), [("both", ["none"]), ("eye", ["greedy"])])
def test_histories_that_methods_do_not_have(history, methods):
    with pytest.raises(SettingsError):
        evaluate_methods(still(), methods, settings(history=history, frames=(0, 2)), input="full", metrics=("psnr",))
