"""Running methods: history, passes, arrays for Python; and broken methods, with one-line errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reuse_tools import PLAIN_TOML, play, still_steps, write_method

from taubench_gl.conventions import Reason
from taubench_gl.errors import MethodError
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.reuse.frame import EYE_INPUTS, INPUTS, read_result
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.synthetic import Uploader, synthetic_steps

SIZE = (40, 23)  # no multiple of any work group
COUNTER = {
    "toml": 'reads = ["radiance"]\n[history]\nn = "r32ui"\n[[pass]]\nshader = "a.glsl"\nwrites = ["n", "result"]\n',
    "a": "void reuse(ivec2 p) { uint n = fetch_prev_n(p) + 1u; write_n(p, n);\n"
    "write_result(p, vec4(float(n), float(frame.has_history), float(frame.index), 1.0)); }\n",
}


def flat(value: float = 0.5) -> np.ndarray:
    return np.full((SIZE[1], SIZE[0], 3), value)


def test_history_starts_at_zero_at_first_frames_cuts_and_resets(gpu, tmp_path):
    folder = write_method(tmp_path / "m", COUNTER["toml"], a=COUNTER["a"])
    uploader = Uploader(gpu, SIZE)
    steps = still_steps(SIZE, [flat()] * 6)
    steps[4] = replace(steps[4], cut=True)
    with MethodRunner(gpu, str(folder), SIZE) as runner:
        seen = [read_result(runner.step(uploader.frame(s))) for s in steps]
        assert all((r == r[0, 0]).all() for r in seen), "all pixels have the same count"
        assert [r[0, 0, 0] for r in seen] == [1, 2, 3, 4, 1, 2]
        assert [r[0, 0, 1] for r in seen] == [0, 1, 1, 1, 0, 1]
        runner.reset()
        assert read_result(runner.step(uploader.frame(steps[5])))[0, 0, :2].tolist() == [1, 0]
        runner.configure()
        assert read_result(runner.step(uploader.frame(steps[5])))[0, 0, 0] == 1
        # A sequence that starts again from frame 0 has no history either.
        assert read_result(runner.step(uploader.frame(steps[0])))[0, 0, 1] == 0
    other = (24, 10)
    with MethodRunner(gpu, str(folder), other) as runner:
        assert runner.bytes == other[0] * other[1] * (16 + 2 * 4)
        with pytest.raises(MethodError, match=r"40x23.*24x10"):
            runner.step(uploader.frame(steps[0]))
        small = Uploader(gpu, other)
        counts = [
            read_result(runner.step(small.frame(s)))[..., 0] for s in still_steps(other, [np.ones((10, 24, 3))] * 2)
        ]
        assert counts[1].shape == (10, 24) and (counts[1] == 2).all()
        small.release()
    uploader.release()


def test_repeated_passes_read_their_previous_result(gpu, tmp_path):
    """A pass that doubles its buffer and shifts it by one pixel, iterated: ping-pong, not a race."""
    toml = (
        'reads = ["radiance"]\n[buffers]\nb = "r32f"\n[settings]\ntimes = { default = 3, min = 1, max = 9 }\n'
        '[[pass]]\nshader = "a.glsl"\nwrites = ["b"]\n'
        '[[pass]]\nshader = "b.glsl"\nreads = ["b"]\nwrites = ["b"]\nrepeat = "times"\n'
        '[[pass]]\nshader = "c.glsl"\nwrites = ["result"]\n'
    )
    folder = write_method(
        tmp_path / "m",
        toml,
        a="void reuse(ivec2 p) { write_b(p, float(p.x)); }\n",
        b="void reuse(ivec2 p) { write_b(p, 2.0 * fetch_b(p + ivec2(1, 0)) + float(iteration)); }\n",
        c="void reuse(ivec2 p) { write_result(p, vec3(fetch_b(p))); }\n",
    )
    for times in (1, 3, 4):
        result = play(gpu, folder, still_steps(SIZE, [flat()]), {"times": times})[0][0, :, 0]
        row = np.arange(SIZE[0], dtype=float)
        for i in range(times):
            row = 2 * np.append(row[1:], row[-1]) + i
        np.testing.assert_array_equal(result, row)


def test_frame_constants(gpu, tmp_path):
    step = list(synthetic_steps(SIZE, 3, noise=0.0))[2]
    members = {
        "vec3(frame.size.xy, frame.index)": [*SIZE, 2],
        "vec3(frame.time, frame.exposure, frame.has_history)": [2 / 24, 0.25, 0],
        "frame.camera_delta.xyz": step.pair.camera_delta,
        "frame.prev_forward.xyz": step.pair.prev_forward,
        "vec3(frame.near, frame.prev_near, 0)": [0.1, 0.1, 0],
        "frame.sky_origin.xyz": step.pair.sky_origin[:3],
        "vec3(frame.jitter_px, frame.prev_jitter_px.y)": [0.25, -0.5, 0.125],
        "(frame.clip_from_current * vec4(1.0, 2.0, -3.0, 1.0)).xyw": (
            step.pair.clip_from_current @ [1.0, 2.0, -3.0, 1.0]
        )[[0, 1, 3]],
        "vec3(MASK_B, mode, on ? 1.0 : 0.0)": [1, 1, 1],
    }
    settings = 'mode = { default = "b", choices = ["a", "b"] }\non = true\n'
    for i, (text, expected) in enumerate(members.items()):
        folder = write_method(
            tmp_path / str(i),
            PLAIN_TOML + "[settings]\n" + settings,
            a=f"void reuse(ivec2 p) {{ write_result(p, vec3({text.replace('MASK_B', 'MODE_B')})); }}\n",
        )
        result = play(gpu, folder, [step], exposure=0.25, jitter_px=np.array([0.25, -0.5]),
                      prev_jitter_px=np.array([0.0, 0.125]))[0]  # fmt: skip
        np.testing.assert_allclose(result[3, 4, :3], expected, rtol=1e-6, atol=1e-6, err_msg=text)


def test_inputs_are_read_by_name(gpu, tmp_path):
    """The method outputs the first two components of each input."""
    step = list(synthetic_steps(SIZE, 2, noise=0.2))[1]
    for name, info in ((name, info) for name, info in INPUTS.items() if name not in EYE_INPUTS):
        value = "vec2(fetch_X(p), 0.0)" if info.components == 1 else "vec2(fetch_X(p).xy)"
        folder = write_method(
            tmp_path / name,
            f'reads = ["{name}"]\n' + PLAIN_TOML.split("\n", 1)[1],
            a=f"void reuse(ivec2 p) {{ write_result(p, vec3({value.replace('X', name)}, 1.0)); }}\n",
        )
        result = play(gpu, folder, [step])[0]
        expected = np.asarray(step.inputs[name], dtype=np.float64)
        expected = expected[..., None] if expected.ndim == 2 else expected
        if name == "motion":
            expected = expected * [1, -1]  # +y up in GLSL
        for i in range(min(2, expected.shape[-1])):
            np.testing.assert_allclose(result[..., i], expected[..., i], rtol=1e-3, atol=1e-6, err_msg=name)


def test_reusable_is_the_geometry_mask(gpu, tmp_path):
    steps = list(synthetic_steps(SIZE, 3, speed=2.0, noise=0.0))
    toml = 'reads = ["mask"]\n' + PLAIN_TOML.split("\n", 1)[1]
    folder = write_method(tmp_path / "m", toml, a="void reuse(ivec2 p) { write_result(p, vec3(reusable(p))); }\n")
    results = play(gpu, folder, steps)
    assert not results[0][..., :3].any()
    assert (results[0][..., 3] == -1).all(), "the method reports no weight of history"
    against = (
        Reason.FIRST | Reason.CUT | Reason.INVALID | Reason.BEHIND | Reason.OUTSIDE | Reason.POSITION | Reason.NORMAL
    )
    for step, result in zip(steps[1:], results[1:]):
        expected = (step.inputs["mask"] & np.uint32(against)) == 0
        assert 0 < expected.mean() < 1
        np.testing.assert_array_equal(result[..., 0], expected)


# ------------------------------------------------------------------------------------------------------------- Python
class Recorder:
    """Records its arguments and reports a weight of history."""

    reads = ("radiance", "motion", "ids")
    settings = {"gain": {"default": 2.0, "min": 0.0, "max": 9.0, "doc": "factor"}}  # noqa: RUF012
    made = 0

    def __init__(self, size, settings):
        type(self).made += 1
        self.size, self.gain, self.frames = size, settings["gain"], 0

    def step(self, frame):
        self.frames += 1
        assert frame["radiance"].shape == (self.size[1], self.size[0], 4)
        assert frame["ids"].dtype == np.uint32 and frame["motion"].shape[-1] == 2
        type(self).last = frame
        image = self.gain * frame["radiance"][..., :3]
        return np.concatenate([image, np.full((*image.shape[:2], 1), 0.25)], axis=-1)


def test_python_method(gpu):
    steps = list(synthetic_steps(SIZE, 4, cut_at=2, noise=0.1))
    Recorder.made = 0
    results = play(gpu, Recorder, steps, {"gain": 3.0}, jitter_px=np.array([0.25, -0.5]))
    np.testing.assert_allclose(results[3][..., :3], 3.0 * steps[3].inputs["radiance"][..., :3], rtol=1e-6)
    assert (results[3][..., 3] == 0.25).all()
    assert Recorder.made == 2, "a new instance after the cut"
    np.testing.assert_allclose(Recorder.last["motion"], steps[3].inputs["motion"], rtol=1e-6, atol=1e-5)
    assert Recorder.last["jitter_px"].tolist() == [0.25, 0.5], "y points down in arrays"
    assert Recorder.last["has_history"] and Recorder.last["index"] == 3
    np.testing.assert_array_equal(Recorder.last["camera_delta"], steps[3].pair.camera_delta)


def test_timer_entries_of_methods(gpu):
    timer = PassTimer(gpu)
    uploader = Uploader(gpu, SIZE)
    for method in ("none", Recorder):
        with MethodRunner(gpu, method, SIZE, timer=timer) as runner:
            for step in still_steps(SIZE, [flat()] * 2):
                runner.step(uploader.frame(step))
    uploader.release()
    samples = timer.samples_ms()
    assert set(samples) == {"none", "Recorder", "Recorder: read inputs", "Recorder: upload"}
    assert all(len(v) == 2 and (v > 0).all() for v in samples.values())


# ------------------------------------------------------------------------------------------------------------- broken
class Raises(Recorder):
    def step(self, frame):
        if frame["index"] == 1:
            raise ValueError("no such thing\nin two lines")
        return frame["radiance"][..., :3]


class WrongShape(Recorder):
    def step(self, frame):
        return frame["radiance"][:-1, :, :3]


class NoArray(Recorder):
    def step(self, frame):
        return {"not": "an array"}


class NotANumber(Recorder):
    def step(self, frame):
        image = frame["radiance"][..., :3].copy()
        image[5, 7] = np.nan if frame["index"] == 1 else 0.0
        return image


class CannotBeMade(Recorder):
    def __init__(self, size, settings):
        self.table = settings["there is no such setting"]


@pytest.mark.parametrize(
    ("method", "part"),
    [
        (Raises, r"ValueError: no such thing in two lines \(test_reuse_runner\.py:\d+\)"),
        (WrongShape, r"\(22, 40, 3\).*\(23, 40, 3\)"),
        (NoArray, "step"),
        (NotANumber, r"frame 1: 1 of 920 .*column 7, row 5"),
        (CannotBeMade, "__init__ .*KeyError"),
    ],
)
def test_errors_of_broken_classes(gpu, method, part):
    with pytest.raises(MethodError, match=part) as caught:
        play(gpu, method, still_steps(SIZE, [flat()] * 2))
    assert "\n" not in str(caught.value) and caught.value.where == f"method {method.__name__!r}"


@pytest.mark.parametrize(
    ("glsl", "part"),
    [
        ("void reuse(ivec2 p) {\n  vec3 c = 1.0;\n  write_result(p, c);\n}\n", r"method 'm': .*m/a\.glsl:2\b"),
        ('#include "b.glsl"\nvoid reuse(ivec2 p) { write_result(p, b(p)); }\n', r"m/b\.glsl:3\b.*undeclared_thing"),
        ("void reuse(ivec2 p) { write_result(p, vec3(uintBitsToFloat(0x7fc00000u))); }\n", "920 of 920 "),
        ("void reuse(ivec2 p) { write_result(p, p == ivec2(3, 2) ? vec3(1.0 / float(p.x - 3)) : vec3(0.0)); }\n",
         r"1 of 920 .*column 3, row 20"),
        ("void reuse(ivec2 p) { write_result(p, undeclared); }\n", r"a\.glsl:1\b.*undeclared"),
    ],
)  # fmt: skip
def test_errors_of_broken_shaders_do_not_affect_others(gpu, tmp_path, glsl, part):
    folder = write_method(
        tmp_path / "m", PLAIN_TOML, a=glsl, b="\nvec3 b(ivec2 p) {\n  return undeclared_thing;\n}\n"
    )  # fmt: skip
    steps = still_steps(SIZE, [flat(0.25)] * 2)
    uploader = Uploader(gpu, SIZE)
    with MethodRunner(gpu, "accumulate", SIZE) as other:
        other.step(uploader.frame(steps[0]))
        with pytest.raises(MethodError, match=part) as caught, MethodRunner(gpu, folder, SIZE) as broken:
            broken.step(uploader.frame(steps[0]))
        assert "\n" not in str(caught.value)
        result = read_result(other.step(uploader.frame(steps[1])))
        np.testing.assert_array_equal(result[..., :3], 0.25)
        np.testing.assert_array_equal(result[..., 3], 0.5)
    uploader.release()


def test_non_finite_input_is_no_error_of_the_method(gpu):
    image = flat()
    image[4, 4] = np.nan
    assert np.isnan(play(gpu, "none", still_steps(SIZE, [image]))[0][4, 4, :3]).all()


def test_missing_inputs_are_an_error(gpu):
    uploader = Uploader(gpu, SIZE)
    frame = uploader.frame(still_steps(SIZE, [flat()])[0])
    frame = replace(frame, textures={"radiance": uploader.textures["radiance"]})
    runner = MethodRunner(gpu, "taa_clamp", SIZE)
    with pytest.raises(MethodError, match=r"frame 0 .*motion, position"):
        runner.step(frame)
    runner.release()
    uploader.release()


def test_runner_releases_its_memory(gpu):
    import psutil

    process = psutil.Process()

    def churn(times: int) -> None:
        for _ in range(times):
            MethodRunner(gpu, "svgf", (256, 144)).release()
        gpu.finish()

    churn(3)
    before = process.memory_info().rss
    churn(12)
    held = MethodRunner(gpu, "svgf", (256, 144))
    assert process.memory_info().rss - before < 8 * held.bytes
    held.release()
