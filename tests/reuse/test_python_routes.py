"""Python methods: helpers as in GLSL, torch tensors and ONNX models that share memory, examples of the guide."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from reuse_tools import blend_model, play, write_method

from taubench_gl.errors import MethodError
from taubench_gl.reuse.helpers import Helpers
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.synthetic import synthetic_steps

GUIDE = (Path(__file__).resolve().parents[2] / "docs" / "reuse.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL)
GLSL = dict(re.findall(r"File `ema/([\w.]+)`:\n\n```\w+\n(.*?)```", GUIDE, re.DOTALL))
SIZE, SMALL = (40, 24), (20, 12)


def example(name, **names):
    """A class of the guide."""
    (text,) = [block for block in BLOCKS if f"class {name}:" in block]
    space = dict(names)
    exec(text, space)
    return space[name]


def steps(count=6, size=SIZE):
    return list(synthetic_steps(size, count, speed=2.0, cut_at=4))


def test_one_method_in_three_languages(gpu, tmp_path):
    """A method in GLSL, NumPy and torch gives one image; each text has at most 25 lines."""
    pytest.importorskip("torch", reason="torch is not installed")
    ema = example("Ema")
    methods = {
        "glsl": str(write_method(tmp_path / "ema", GLSL["method.toml"], ema=GLSL["ema.glsl"])),
        "numpy": ema,
        "torch": type("EmaTorch", (ema,), {"arrays": "torch"}),
    }
    (text,) = [block for block in BLOCKS if "class Ema:" in block]
    assert len(text.splitlines()) <= 25 and sum(len(t.splitlines()) for t in GLSL.values()) <= 25
    images = {name: play(gpu, method, steps()) for name, method in methods.items()}
    for name in ("numpy", "torch"):
        for got, expected in zip(images[name], images["glsl"], strict=True):
            np.testing.assert_allclose(got, expected, rtol=2e-4, atol=2e-5)
    assert (images["glsl"][3][..., 3] > 0).mean() > 0.5 and not images["glsl"][4][..., 3].any()


COMPARED = """\
void reuse(ivec2 p) {
    vec2 at = previous_px(p);
    vec3 low = vec3(0.2, 0.3, 0.1), high = vec3(0.5, 0.6, 0.4), c = fetch_radiance(p).rgb;
    write_nearest(p, nearest_radiance(at));
    write_bilinear(p, sample_radiance(at));
    write_cubic_tap(p, cubic_radiance(at));
    write_box(p, vec4(clip_to_box(low, high, c), luminance(c)));
    write_color(p, vec4(rgb_from_ycocg(ycocg_from_rgb(c) * vec3(1.0, 0.5, 0.25)), float(inside(at))));
    vec2 surface = vec2(nearest_surface(p));
    write_result(p, vec4(surface.x, float(frame.size.y - 1) - surface.y, float(reusable(p)), float(reusable_exact(p))));
}
"""
TESTED = ("nearest", "bilinear", "cubic_tap", "box", "color")


def write_compared(folder, output):
    toml = 'reads = ["radiance", "motion", "mask", "exact_mask", "position"]\n[buffers]\n'
    toml += "".join(f'{name} = "rgba32f"\n' for name in TESTED)
    toml += f'[[pass]]\nshader = "a.glsl"\nwrites = {[*TESTED, "result"]}\n'.replace("'", '"')
    if output != "result":
        toml = toml.replace('"result"]\n', '"shown"]\n').replace("[buffers]\n", '[buffers]\nshown = "rgba32f"\n')
        toml += '[[pass]]\nshader = "b.glsl"\nwrites = ["result"]\n'
    shown = COMPARED if output == "result" else COMPARED.replace("write_result", "write_shown")
    return write_method(folder, toml, a=shown, b=f"void reuse(ivec2 p) {{ write_result(p, fetch_{output}(p)); }}\n")


def expected_of(output, frame):
    h, c = frame["helpers"], frame["radiance"][..., :3]
    at = h.previous_px()
    if output in ("nearest", "bilinear", "cubic_tap"):
        return {"nearest": h.nearest, "bilinear": h.sample, "cubic_tap": h.cubic}[output](frame["radiance"], at)
    low, high = (np.array(v, dtype=np.float32) for v in ((0.2, 0.3, 0.1), (0.5, 0.6, 0.4)))
    if output == "box":
        return h.concatenate([h.clip_to_box(low, high, c), h.luminance(c)[..., None]])
    if output == "color":
        scale = np.array([1.0, 0.5, 0.25], dtype=np.float32)
        return h.concatenate([h.rgb_from_ycocg(h.ycocg_from_rgb(c) * scale), h.inside(at)[..., None]])
    flags = np.stack([h.reusable(), h.reusable_exact()], axis=-1)
    return h.concatenate([h.nearest_surface().astype(np.float32), flags])


@pytest.mark.parametrize("output", [*TESTED, "result"])
def test_helpers_equal_the_functions_of_glsl(gpu, tmp_path, output):
    class Compared:
        reads = ("radiance", "motion", "mask", "exact_mask", "position")

        def __init__(self, size, settings): ...

        def step(self, frame):
            return expected_of(output, frame)

    found = play(gpu, Compared, steps())
    expected = play(gpu, str(write_compared(tmp_path / "m", output)), steps())
    for got, wanted in zip(found, expected, strict=True):
        same = np.isclose(got, wanted, rtol=1e-3, atol=1e-3).all(axis=-1)
        assert same.mean() > 0.995  # a rounding at the boundary of two pixels may choose the other


def test_helpers_of_an_upscaler_use_both_sizes():
    step = steps(2, SMALL)[1]
    frame = {n: np.asarray(step.inputs[n], dtype=np.float32) for n in ("motion", "position")}
    frame |= {"mask": step.inputs["mask"][..., None] if step.inputs["mask"].ndim == 2 else step.inputs["mask"]}
    frame["has_history"] = True
    h = Helpers(frame, SIZE, SMALL)
    assert h.reusable().shape == SIZE[::-1] and h.pixels().shape == (*SIZE[::-1], 2)
    at = h.pixels()
    np.testing.assert_allclose(h.output_from_input(h.input_from_output(at)), at, atol=1e-4)
    np.testing.assert_array_equal(h.input_pixels()[::2, ::2], h.pixels()[:12, :20])  # 2 x 2 pixels for each
    expected = h.pixels() + 2 * np.repeat(np.repeat(frame["motion"], 2, axis=0), 2, axis=1)
    np.testing.assert_allclose(h.previous_px(), expected, rtol=1e-5, atol=1e-4)


# --------------------------------------------------------------------------------------------------- torch and ONNX
def test_tensors_share_the_memory_of_the_arrays():
    torch = pytest.importorskip("torch", reason="torch is not installed")
    from taubench_gl.reuse.python_method import _tensor

    for dtype in (np.float32, np.float16, np.uint32):
        array = np.ones((4, 5, 2), dtype=dtype)
        tensor = _tensor(array, torch)
        assert tensor.data_ptr() == array.ctypes.data
        assert tensor.numpy().ctypes.data == array.ctypes.data
    assert _tensor("text", torch) == "text"


def test_the_torch_example_of_the_guide(gpu):
    pytest.importorskip("torch", reason="torch is not installed")
    made = steps()
    results = play(gpu, example("Filter"), made)
    assert all(np.isfinite(r).all() and r.shape == (SIZE[1], SIZE[0], 4) for r in results)
    kernel = np.array([1, 4, 6, 4, 1]) / 16
    image = np.pad(made[0].inputs["radiance"][..., :3], ((2, 2), (2, 2), (0, 0)), mode="edge")
    image = sum(kernel[k] * image[k : k + SIZE[1]] for k in range(5))
    image = sum(kernel[k] * image[:, k : k + SIZE[0]] for k in range(5))
    np.testing.assert_allclose(results[0][..., :3], image, rtol=1e-4, atol=1e-5)


def test_the_onnx_example_of_the_guide(gpu, tmp_path):
    """The ONNX example is the method of the guide with alpha 0.1, without reported weights."""
    pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    found = play(gpu, example("Model", MODEL=blend_model()), steps())
    expected = play(gpu, str(write_method(tmp_path / "ema", GLSL["method.toml"], ema=GLSL["ema.glsl"])), steps())
    for got, wanted in zip(found, expected, strict=True):
        np.testing.assert_allclose(got[..., :3], wanted[..., :3], rtol=2e-4, atol=2e-5)


def test_a_method_for_torch_without_torch_says_so(gpu, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "torch", None)
    method = load_method(type("EmaTorch", (example("Ema"),), {"arrays": "torch"}))
    with pytest.raises(MethodError, match=r"taubench-gl\[torch\]"):
        MethodRunner(gpu, method, SIZE)
    with pytest.raises(MethodError, match="arrays"):
        load_method(type("EmaJax", (example("Ema"),), {"arrays": "jax"}))
