"""Files of other writers whose keys lie beside frames, at one time, or late: statistics, masks and notes."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.evaluation import evaluate_scene
from taubench_gl.run import Run

pytestmark = pytest.mark.usefixtures("coarse_light")


@pytest.fixture
def keys(data):
    return data / "reports4" / "keys"


def evaluated(path, **changes) -> Run:
    own = {"size": (64, 36), "columns": ("frustum", "position"), "pairs": "all"}
    return evaluate_scene(path, fixed_settings(**(own | changes)))


def pairs_with(run: Run, column: str) -> list[int]:
    return [row["frame"] for row in run.frames if row[column]]


def test_a_camera_with_a_step_key_in_every_frame(keys):
    run = evaluated(keys / "step-camera-24.glb")
    steps = [row["translation_m"] for row in run.frames]
    rounding = float(np.spacing(np.float32(2.4)))  # positions up to 2.4 m are float32
    np.testing.assert_allclose(steps, 0.05, rtol=0, atol=rounding)
    moved = run.summary["camera"]["position"]
    assert moved["mean"] == pytest.approx(0.05, rel=1e-6) and moved["max"] == pytest.approx(0.05, abs=rounding)
    assert moved["variance"] < 1e-14


def test_a_lamp_that_is_scaled_up_by_linear_keys(keys):
    run = evaluated(keys / "lamp-scale-linear-24.glb", columns=("direct",), light="preview")
    lights = run.summary["census"]["lights_per_frame"]
    assert [i for i, count in enumerate(lights["born"], start=1) if count] == [11] and not any(lights["killed"])
    assert pairs_with(run, "direct") == [11]


def test_two_keys_at_one_time(keys):
    """0:A 0.31:A 0.31:B 2:B, a jump between frames 7 and 8."""
    run = evaluated(keys / "repeated-key.glb")
    assert pairs_with(run, "position") == [8]


def test_a_scene_that_starts_at_frame_101(keys):
    path = keys / "blender52-starts-at-101.glb"
    notes = evaluated(path, columns=("frustum",)).summary["notes"]
    (note,) = (note for note in notes if "before the first key" in note)
    assert "101 pairs" in note and "--frames 101:150" in note
    run = evaluated(path, columns=("frustum",), frames=(101, 150))
    assert run.summary["camera"]["position"]["mean"] == pytest.approx(0.05 / 3, rel=1e-5)
    assert len(pairs_with(run, "frustum")) == 48
    assert not any("before the first key" in note for note in run.summary["notes"])
