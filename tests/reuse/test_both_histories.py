"""Methods that ask for both histories: where the other eye shows a surface, their result there, and its bound."""

from __future__ import annotations

import numpy as np
import pytest
from reuse_scenes import passing_box, settings, still
from reuse_tools import PLAIN_GLSL, PLAIN_TOML, write_method

from taubench_gl.animation import choose_camera
from taubench_gl.conventions import Reason
from taubench_gl.errors import SettingsError
from taubench_gl.frame.targets import read_channel
from taubench_gl.reuse import evaluate_methods
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.inputs import FrameRequest, OtherEye, RasterInputs
from taubench_gl.reuse.loading import MethodSpec

pytestmark = pytest.mark.usefixtures("fixed_light")

EYES = 0.2
TOML = """
reads = ["radiance", "motion", "mask", "eye_motion", "eye_mask", "eye_result"]
history = { mean = "rgba32f" } # a: samples
[[pass]]
shader = "a.glsl"
writes = ["mean", "result", "reprojected_history", "eye_history"]
"""
GLSL = """
// The mean of the samples of this pixel, of its history, and of the other eye.
void reuse(ivec2 p) {
    vec4 past = reusable(p) ? nearest_prev_mean(previous_px(p)) : vec4(0.0);
    vec4 other = reusable_eye(p) ? vec4(nearest_eye_result(eye_px(p)).rgb, SHARE) : vec4(0.0);
    float n = 1.0 + past.a + other.a;
    vec3 mean = (fetch_radiance(p).rgb + past.a * past.rgb + other.a * other.rgb) / n;
    write_mean(p, vec4(mean, n));
    write_result(p, vec4(mean, 1.0 - 1.0 / n));
    write_reprojected_history(p, vec4(past.rgb, min(past.a, 1.0)));
    write_eye_history(p, vec4(other.rgb, min(other.a, 1.0)));
}
"""


class Steps:
    """The mean of the frame and of the other eye where it sees the surface, in NumPy."""

    reads = ("radiance", "eye_motion", "eye_mask", "eye_result")

    def __init__(self, size, settings):
        self.y, self.x = np.indices(size[::-1])

    def step(self, frame):
        here = frame["radiance"][..., :3]
        at_x, at_y = (
            np.floor(v + 0.5) for v in (self.x + frame["eye_motion"][..., 0], self.y + frame["eye_motion"][..., 1])
        )
        rows, columns = (np.clip(v, 0, n - 1).astype(int) for v, n in zip((at_y, at_x), here.shape, strict=False))
        there = frame["eye_result"][rows, columns, :3]
        return np.where(frame["eye_mask"] == 0, 0.5 * (here + there), here)


@pytest.fixture
def method(tmp_path) -> str:
    return str(write_method(tmp_path / "eyes", TOML, a=GLSL.replace("SHARE", "1.0")))


def run(scene, methods, history: str = "both", frames=(0, 3), **more):
    more = {"input": "path-traced@1", "reference": "path-traced@128", "metrics": ("psnr",), "statistics": False} | more
    return evaluate_methods(scene, methods, settings(history=history, eyes=EYES, frames=frames, bounces=1), **more)


def test_where_the_other_eye_shows_a_surface(gpu):
    """Motion and masks are those of history ``eye``; its own image has no eye before it."""
    reads, scene = ("radiance", "position", "motion", "mask"), passing_box()

    def request(history: str) -> FrameRequest:
        return FrameRequest(gpu, scene, choose_camera(scene), settings(history=history, eyes=EYES), parse_input("full"))

    with RasterInputs(request("both"), reads) as inputs, OtherEye(inputs, ()) as eyes:
        for number in (4, 5):
            eye = eyes.advance(number)
            first = read_channel(eye.textures["eye_mask"], "mask")
            frame = eyes.beside(inputs.advance(number), eye)
        own = read_channel(frame.textures["motion"], "motion")
        motion, mask = (read_channel(frame.textures[f"eye_{name}"], name) for name in ("motion", "mask"))
    with RasterInputs(request("eye"), reads) as across:
        across.before(5)
        expected = across.advance(5)
        np.testing.assert_array_equal(mask, read_channel(expected.textures["mask"], "mask"))
        np.testing.assert_allclose(motion, read_channel(expected.textures["motion"], "motion"), atol=1e-4)
    assert ((first & int(Reason.FIRST)) != 0).all() and np.abs(own).max() > 1.0, "the box moves in the camera"


def test_two_eyes_have_half_the_squared_error(method):
    """The first frame has two samples where the other eye sees the surface; a class in NumPy gets the same images."""
    done = run(still(), ["none", method, MethodSpec("numpy", Steps)], frames=(0, 2), seeds=2)
    assert not done.failed
    none, eyes, numpy = (
        np.mean([row["linear_mse"] for row in done.rows if row["method"] == name and row["frame"] == 0])
        for name in ("none", "eyes", "numpy")
    )
    assert 0.45 < eyes / none < 0.62 and numpy == pytest.approx(eyes, rel=1e-3)


def test_the_bound_of_the_other_eye(method):
    done = run(still(), ["none", method], seeds=1)
    found = done.summary["methods"]["eyes"]
    eye, own = found["eye_bound"], found["bound"]
    assert 0.0 < eye["linear_mse"] < done.summary["methods"]["none"]["mean"]["linear_mse"]
    assert eye["linear_mse"] != own["linear_mse"] and 0.2 < eye["weight"] < 0.8
    assert done.summary["methods"]["none"]["eye_bound"] is None


def test_both_histories_are_for_methods_that_ask(method, tmp_path):
    with pytest.raises(SettingsError):
        run(still(), ["none"])
    with pytest.raises(SettingsError):
        run(still(), [method], input="exr:none", reference="exr:none")
    plain = str(write_method(tmp_path / "plain", PLAIN_TOML, a=PLAIN_GLSL))
    done = run(still(), [plain, method], history="frame")
    assert list(done.failed) == ["eyes"] and "--history both" in done.failed["eyes"]
