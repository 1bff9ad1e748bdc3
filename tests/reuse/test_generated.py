"""Methods that generate frames, against closed forms: constant motion, constant acceleration, the area of holes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references.reuse_methods.caching import timewarp_px
from reuse_scenes import glowing
from reuse_tools import arrays, blend_model, evaluate, open_inputs, play, still_steps, write_method

from taubench_gl.errors import MethodError, SettingsError
from taubench_gl.reuse.check import EVERY, FRAMES, check_method, write_example
from taubench_gl.reuse.evaluate import Evaluation
from taubench_gl.reuse.generated import GeneratedInputs
from taubench_gl.reuse.helpers import Helpers
from taubench_gl.reuse.loading import MethodSpec, load_method
from taubench_gl.reuse.splatting import background, splat
from taubench_gl.scene.builder import SceneBuilder, quad

W, H, FPS = 96, 12, 24
SCALE = 10.0
"""Pixels that a meter on the wall covers in an image."""
SLOPE = 0.02
"""Radiance of the wall per pixel to the right."""
METHODS = ["extrapolate", "space-warp", "interpolate"]


def wall(places: list[float], *, of_camera: bool = False):
    """A wall whose radiance grows by SLOPE per pixel; it, or the camera, is ``places[n]`` pixels to the right in frame
    n."""
    b = SceneBuilder()
    mover = b.node()
    for k in range(-130, 130):
        shade = 3.0 + SLOPE * k
        strip = b.mesh(quad(1 / SCALE, 4.0, material=glowing(b, (shade, shade, shade))))
        b.node(-1 if of_camera else mover, mesh=strip, translation=((k + 0.5) / SCALE, 0.0, -3.0))
    camera = b.camera(kind="orthographic", ymag=H / SCALE / 2, znear=0.1, zfar=10.0)
    times = [n / FPS for n in range(len(places))]
    b.animate(camera if of_camera else mover, "translation", times, [(x / SCALE, 0.0, 0.0) for x in places])
    return b.build()


def images(scene, methods, count: int, every: int = 2, **more) -> tuple[dict[int, dict[str, np.ndarray]], Evaluation]:
    """Frame -> linear radiance (h, w) of every method and of the reference; and the evaluation."""
    shown = {}

    def look(evaluated):
        shown[evaluated.frame] = {name: image[..., 0] for name, image in evaluated.radiance.items()}

    size = {"width": W, "height": H}
    run = evaluate(scene, methods, (0, count), on_frame=look, render_every=every, settings=size, **more)
    assert not run.failed
    return shown, run


@pytest.mark.parametrize("of_camera", [False, True])
def test_a_wall_that_moves_steadily_is_generated_exactly(gpu, of_camera):
    """One pixel a frame: only the columns that come into view are wrong, and interpolation knows those too."""
    shown, run = images(wall([float(n) for n in range(9)], of_camera=of_camera), METHODS, 9)
    assert sorted(shown) == [1, 3, 5, 7] and run.summary["evaluated_frames"] == 3
    inner = slice(None, -1) if of_camera else slice(1, None)
    for frame in (3, 5, 7):
        found = shown[frame]
        for name in METHODS:
            np.testing.assert_allclose(found[name][:, inner], found["reference"][:, inner], atol=1e-5, err_msg=name)
        np.testing.assert_allclose(found["interpolate"], found["reference"], atol=1e-5)
        assert np.abs(found["extrapolate"] - found["reference"]).max() == pytest.approx(SLOPE, rel=1e-3)
        assert np.abs(found["present-last"] - found["reference"]).min() == pytest.approx(SLOPE, rel=1e-3)
    blocks = {name: method["generated"] for name, method in run.summary["methods"].items()}
    assert blocks["interpolate"]["latency_frames"] == 1
    assert blocks["interpolate"]["latency_ms"] == pytest.approx(1000 / FPS)
    assert blocks["extrapolate"]["latency_frames"] == blocks["extrapolate"]["latency_ms"] == 0


def test_positional_warp_alone_knows_the_camera_but_no_object(gpu):
    places, still = [float(n) for n in range(7)], "space-warp@objects=false"
    shown, _ = images(wall(places), [still], 7)
    np.testing.assert_allclose(shown[5][still], shown[5]["present-last"], atol=1e-5)
    shown, _ = images(wall(places, of_camera=True), [still], 7)
    np.testing.assert_allclose(shown[5][still][:, :-1], shown[5]["reference"][:, :-1], atol=1e-5)


@pytest.mark.parametrize("every", [2, 4])
def test_errors_of_accelerated_motion(gpu, every):
    """x = a t^2 / 2, whole pixels; the radiance of the wall measures the shift where both rendered frames show it."""
    count, a = 2 * every + 1, 2.0
    shown, _ = images(wall([a * n * n / 2 for n in range(count)]), METHODS, count, every)
    for t in range(1, every):
        found, middle = shown[every + t], slice(40, 58)
        # Extrapolation lags behind the wall, which moves to the right; interpolation is ahead of it.
        for name, expected in (("extrapolate", a * t * (t + every) / 2), ("interpolate", -a * t * (every - t) / 2)):
            lag = (found[name] - found["reference"])[:, middle] / SLOPE
            np.testing.assert_allclose(lag, expected, atol=1e-3)


def test_a_disk_before_a_wall_leaves_the_hole_that_it_uncovers():
    size, shift = (48, 32), 5
    pixels = Helpers({}, size, size).pixels()
    before, after = (np.linalg.norm(pixels - [x, 15], axis=-1) <= 8.3 for x in (20, 20 + shift))
    moved = splat(pixels + np.where(before[..., None], [shift, 0], 0), np.where(before, 1.0, 4.0))
    np.testing.assert_array_equal(~moved.covered, before & ~after)
    np.testing.assert_array_equal(moved.depth == 1.0, after)
    image = np.where(before[..., None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    filled = moved.values(image, Helpers({}, size, size))
    np.testing.assert_array_equal(filled, np.where(after[..., None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]))


def test_magnified_surfaces_have_no_cracks_and_the_sky_is_behind():
    size = (40, 30)
    pixels = Helpers({}, size, size).pixels().astype(np.float64)
    for factor in (1.0, 1.1, 1.19):
        grown = splat((pixels - 15.3) * factor + 15.3, np.full(size[::-1], 2.0))
        assert grown.covered.all(), factor
    both = splat(np.where(pixels[..., :1] < 5, pixels + [5, 0], pixels), np.where(pixels[..., 0] < 5, 3.0, 0.0))
    assert (both.depth[:, 5:10] == 3.0).all() and np.isinf(both.depth[:, 10:]).all() and not both.covered[:, :5].any()
    assert splat(np.full((4, 5, 2), np.nan), np.ones((4, 5))).covered.sum() == 0


def test_holes_have_the_background_of_their_row_or_column():
    covered = np.array([[True, False, False, False, True]])
    for depth, columns in (([1, 0, 0, 0, 9], [0, 4, 4, 4, 4]), ([2, 0, 0, 0, 2.1], [0, 0, 0, 4, 4])):
        np.testing.assert_array_equal(background(covered, np.array([depth], float))[1], [columns])
    np.testing.assert_array_equal(background(np.zeros((2, 3), bool), np.full((2, 3), np.inf)), np.indices((2, 3)))


@pytest.mark.parametrize("depth", [0.0, 1.0, 50.0])
def test_a_camera_that_only_turns_is_the_homography_of_time_warp(gpu, depth):
    """Of a wall at any depth, and of the sky: a smooth image at the pixels of K R K^-1."""
    size = (64, 36)
    y, x = np.mgrid[: size[1], : size[0]]
    image = np.stack([0.01 * x, 0.02 * y, 0.5 + 0.0 * x], axis=-1)
    steps = still_steps(size, [image])
    view, pair = steps[0].view, steps[0].pair
    rays = pair.sky_origin + x[..., None] * pair.sky_dx + (size[1] - 1 - y)[..., None] * pair.sky_dy
    position = np.concatenate([depth * rays[..., :3], np.full((*x.shape, 1), depth)], axis=-1)
    steps[0] = replace(steps[0], inputs=steps[0].inputs | {"position": position, "prev_position": position})
    c, s = np.cos(0.02), np.sin(0.02)
    shown = replace(view, world_from_view=view.world_from_view @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))
    (found,) = play(gpu, "space-warp", steps, shown=shown, phase=0.5)
    at = timewarp_px(view.clip_from_view(*size), view.world_from_view.T @ shown.world_from_view, size)
    inside = ((at >= 0) & (at <= [size[0] - 1, size[1] - 1])).all(axis=-1)
    expected = np.stack([0.01 * at[..., 0], 0.02 * at[..., 1]], axis=-1)
    assert inside.mean() > 0.9
    np.testing.assert_allclose(found[inside][:, :2], expected[inside], atol=1e-3)


PROBE = """
class Probe:
    generates = "{kind}"
    reads = ("radiance", "motion", "position")
    seen = []

    def __init__(self, size, settings):
        self.seen.append("new")

    def step(self, frame):
        self.seen.append((frame["index"], frame["phase"], float(frame["radiance"][0, 40, 0])))
        return frame["radiance"][..., :3]
"""


@pytest.mark.parametrize("kind", ["extrapolate", "interpolate"])
def test_methods_get_rendered_frames_only(gpu, tmp_path, kind):
    """Every frame in the order of display; the image is that of the last, or of the next, rendered one."""
    (tmp_path / "probe.py").write_text(PROBE.format(kind=kind))
    method = load_method(tmp_path / "probe.py")
    images(wall([float(n) for n in range(9)]), [MethodSpec("probe", method)], 9, 4)
    seen = method.factory.seen
    steps = [entry for entry in seen if entry != "new"]
    assert seen[0] == "new" and seen.count("new") == 1
    assert [p for _, p, _ in steps] == [0.0, 0.25, 0.5, 0.75] * 2
    first = steps[0][2]
    moved = [round((first - value) / SLOPE) for *_, value in steps]
    assert moved == ([0] * 4 + [4] * 4 if kind == "extrapolate" else [0] + [4] * 4 + [8] * 3)


@pytest.mark.parametrize("kind", ["extrapolate", "interpolate"])
def test_a_check_runs_every_phase(gpu, kind):
    """In the order of display, with the camera of each frame; the error is that of generated frames alone."""
    seen = []

    class Probe:
        generates, reads = kind, ("radiance",)

        def __init__(self, size, settings):
            pass

        def step(self, frame):
            still = np.allclose(frame["shown_clip_from_current"], frame["clip_from_current"])
            seen.append((frame["index"], frame["phase"], still, frame["radiance"][..., :3].sum()))
            return frame["radiance"][..., :3]

    report = check_method(gpu, Probe)
    count = (FRAMES - 1) * EVERY + 1
    assert report.frames == count and [s[0] for s in seen] == list(range(count))
    assert [s[1] for s in seen] == [n % EVERY / EVERY for n in range(count)]
    assert all(still == (phase == 0) for _, phase, still, _ in seen)
    rendered, middle = [s[3] for s in seen[::EVERY]], [s[3] for s in seen[1::EVERY]]
    assert middle == (rendered[:-1] if kind == "extrapolate" else rendered[1:])
    last = check_method(gpu, "present-last").error
    assert report.error_without_reuse == pytest.approx(last)
    assert (report.error == pytest.approx(last)) == (kind == "extrapolate")


def run_onnx(color, history, weight):
    import onnxruntime

    session = onnxruntime.InferenceSession(blend_model(), providers=["CPUExecutionProvider"])
    return session.run(None, {"color": color, "history": history, "weight": weight})[0]


@pytest.mark.parametrize("blend", [run_onnx, lambda color, history, weight: color + weight * (history - color)],
                         ids=["onnx", "python"])  # fmt: skip
@pytest.mark.parametrize("kind", ["extrapolate", "interpolate"])
def test_an_onnx_model_and_python_run_under_one_contract(gpu, kind, blend):
    """Pixels go on as they changed, computed by ONNX Runtime or in NumPy: exact for light that changes steadily."""
    if blend is run_onnx:
        pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")

    class Steady:
        generates, reads = kind, ("radiance",)

        def __init__(self, size, settings):
            self.before = self.last = None

        def step(self, frame):
            color, phase = frame["radiance"][..., :3].copy(), np.float32(frame["phase"])
            if phase == 0:
                self.before, self.last = color if self.last is None else self.last, color
            other, weight = (self.before, -phase) if kind == "extrapolate" else (self.last, 1 - phase)
            return blend(color, other, np.full_like(color[..., :1], weight))

    shown, run = images(wall([float(n) for n in range(9)]), [MethodSpec("steady", load_method(Steady))], 9, 4)
    assert run.summary["methods"]["steady"]["generates"] == kind
    for frame in (5, 6, 7):  # of the first interval, extrapolation knows one rendered frame
        np.testing.assert_allclose(shown[frame]["steady"], shown[frame]["reference"], atol=1e-4)
        assert np.abs(shown[frame]["present-last"] - shown[frame]["reference"]).min() > 0.9 * SLOPE


def test_motion_is_between_rendered_frames_and_masks_since_the_last_one(gpu):
    with open_inputs(gpu, wall([float(n) for n in range(9)]), settings={"width": W, "height": H}) as inputs:
        request = inputs.request
    with GeneratedInputs(request, ("radiance", "motion", "mask"), ["extrapolate"], 4, None) as inputs:
        assert inputs.frames == [1, 2, 3, 5, 6, 7]
        for frame in inputs.frames:
            inputs.before(frame)
            got = inputs.advance(frame)
            if frame > 4:
                motion = arrays(got)["motion"][4:8, 10:-10]
                np.testing.assert_allclose(motion, np.broadcast_to([-4.0, 0.0], motion.shape), atol=1e-3)


def test_what_cannot_be_generated_is_refused(gpu):
    scene = wall([float(n) for n in range(9)])
    for methods, more in (
        (["extrapolate", "none"], {}), (["extrapolate"], {"cuts": (4,)}), (["extrapolate"], {"input": "checkerboard"}),
        (["extrapolate"], {"render_every": 6}), (["extrapolate"], {"render_every": 1}),
    ):  # fmt: skip
        with pytest.raises(SettingsError):
            evaluate(scene, methods, (0, 9), settings={"width": W, "height": H}, **more)
    with pytest.raises(MethodError):  # the last rendered frame alone is no evaluation of the methods given
        evaluate(scene, ["extrapolate@nosuch=1", "interpolate@nosuch=1"], (0, 9), settings={"width": W, "height": H})
    with pytest.raises(MethodError):
        load_method("extrapolate>none")


def test_a_method_from_the_template_generates(gpu, tmp_path):
    """The example in GLSL with ``generates``: the last frame, shifted by its motion."""
    write_example(tmp_path / "mine")
    shader = "void reuse(ivec2 p) { write_result(p, sample_radiance(vec2(p) + frame.phase * fetch_motion(p)).rgb); }\n"
    toml = (
        'generates = "extrapolate"\nreads = ["radiance", "motion"]\n[[pass]]\nshader = "a.glsl"\nwrites = ["result"]\n'
    )
    path = write_method(tmp_path / "mine", toml, a=shader)
    shown, run = images(wall([float(n) for n in range(9)]), [str(path)], 9)
    np.testing.assert_allclose(shown[5]["mine"][:, 1:], shown[5]["reference"][:, 1:], atol=1e-5)
    errors = {name: method["mean"]["linear_mse"] for name, method in run.summary["methods"].items()}
    assert 0 < errors["mine"] < errors["present-last"]
