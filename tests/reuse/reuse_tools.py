"""Frames for reuse methods as arrays, a function that runs a method over them, methods written to a folder, and fast
evaluations."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reuse_scenes import settings as small_settings

from taubench_gl.animation import choose_camera
from taubench_gl.apps import cli
from taubench_gl.frame.targets import read_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics.color import srgb_encode
from taubench_gl.reuse.evaluate import Evaluation, evaluate_methods
from taubench_gl.reuse.frame import FrameInputs, read_result
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.inputs import FrameRequest, RasterInputs
from taubench_gl.reuse.loading import BUILTIN, builtin_methods, load_method
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.scores import Displayed, FrameTruth, classify
from taubench_gl.reuse.synthetic import Step, Uploader, synthetic_steps

Array = np.ndarray


def frame_methods() -> list[str]:
    """Names of the built-in methods that reuse shaded frames: they neither sample lights nor generate frames."""
    methods = [load_method(name) for name in builtin_methods()]
    return [method.name for method in methods if not method.own_light and method.generates is None]


def blend_model() -> bytes:
    """result = color + weight (history - color), of any size."""
    onnx = pytest.importorskip("onnx", reason="onnx is not installed")
    value = lambda name, c: onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["h", "w", c])  # noqa: E731
    nodes = [
        onnx.helper.make_node("Sub", ["history", "color"], ["difference"]),
        onnx.helper.make_node("Mul", ["weight", "difference"], ["change"]),
        onnx.helper.make_node("Add", ["color", "change"], ["result"]),
    ]
    inputs = [value("color", 3), value("history", 3), value("weight", 1)]
    graph = onnx.helper.make_graph(nodes, "blend", inputs, [value("result", 3)])
    opset = [onnx.helper.make_opsetid("", 17)]
    return onnx.helper.make_model(graph, opset_imports=opset, ir_version=8).SerializeToString()


def still_steps(size: tuple[int, int], radiances: Iterable[Array]) -> list[Step]:
    """A still camera in the still synthetic scene, with the given radiance per frame, half of it direct light.

    ``radiances``: (h, w, 3 or 4).
    """
    radiances = list(radiances)
    steps = list(synthetic_steps(size, 2, speed=0.0, noise=0.0))
    out = []
    for index, radiance in enumerate(radiances):
        step = steps[min(index, 1)]
        if radiance.shape[-1] == 3:
            radiance = np.concatenate([radiance, np.ones((*radiance.shape[:2], 1))], axis=-1)
        surface = step.inputs["position"][..., 3:] > 0
        direct = np.where(surface, radiance * [0.5, 0.5, 0.5, 1.0], radiance)
        out.append(replace(step, index=index, inputs=step.inputs | {"radiance": radiance, "direct": direct}))
    return out


def play(
    gpu: Gpu, method, steps: Iterable[Step], settings=None, exposure: float = 1.0, size=None, **changes
) -> list[Array]:
    """The result of every frame, (h, w, 4) float32.

    ``size`` (width, height): of the result, by default that of the inputs; ``changes``: fields of FrameInputs to set,
    or functions of the number of the frame.
    """
    steps = list(steps)
    h, w = steps[0].clean.shape[:2]
    uploader = Uploader(gpu, (w, h))
    try:
        with MethodRunner(gpu, method, size or (w, h), settings, input_size=(w, h)) as runner:
            results = []
            for step in steps:
                frame = uploader.frame(step, exposure)
                fields = {n: getattr(frame, n) for n in FrameInputs.__dataclass_fields__}
                fields |= {n: v(step.index) if callable(v) else v for n, v in changes.items()}
                results.append(read_result(runner.step(FrameInputs(**fields))))
            return results
    finally:
        uploader.release()


def evaluate(scene, methods, frames: tuple[int, int], **more) -> Evaluation:
    """``evaluate_methods`` with noise-free input, cheap metrics and one reference sample by default.

    ``settings``: changes to ``reuse_scenes.settings``.
    """
    more = {"input": "full", "metrics": ("psnr", "relmse", "flicker"), "reference_samples": 1} | more
    return evaluate_methods(scene, methods, small_settings(frames=frames, **more.pop("settings", {})), **more)


def truth_of(radiance: Array, index: int = 0, previous: Displayed | None = None, mask: int = 0, **facts) -> FrameTruth:
    """Reference (h, w, 3) of a frame without motion, with one mask word.  ``facts``: further fields of FrameTruth."""
    shape = radiance.shape[:2]
    words, image = np.full(shape, mask, np.uint32), Displayed.of(radiance, np.full(shape, True), "linear")
    return FrameTruth(index, image, previous, words, classify(words), np.zeros((*shape, 2)), **facts)


def with_weight(image: Array, weight: Array | float = 0.0) -> Array:
    """A result (h, w, 4) of an image (h, w, 3) and the weight of its history."""
    weight = np.broadcast_to(weight, image.shape[:2])[..., None]
    return np.concatenate([image, weight], axis=-1)


@contextmanager
def open_inputs(gpu: Gpu, scene, kind="full", reads=(), *, seed=3, settings=None, **options) -> Iterator[RasterInputs]:
    """Inputs of a scene.  ``settings``: changes to ``reuse_scenes.settings``; ``options``: of ``RasterInputs``."""
    chosen = small_settings(**(settings or {}))
    request = FrameRequest(gpu, scene, choose_camera(scene), chosen, parse_input(kind, seed=seed))
    with RasterInputs(request, reads, **options) as inputs:
        yield inputs
    gpu.collect()


def arrays(frame: FrameInputs) -> dict[str, Array]:
    """The inputs of a frame, (h, w, components), row 0 at the top."""
    return {name: read_channel(texture, name).copy() for name, texture in frame.textures.items()}


def display(rgb: Array) -> Array:
    """sRGB-encoded, clipped to 0 .. 1."""
    return srgb_encode(np.clip(rgb[..., :3], 0.0, 1.0))


def run_cli(*words: object) -> int:
    """The exit code of the command line with ``words``."""
    with pytest.raises(SystemExit) as ended:
        cli.main([*map(str, words)])
    return ended.value.code


def write_method(folder: Path, toml: str, **shaders: str) -> Path:
    """``shaders``: file name without .glsl -> text."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "method.toml").write_text(toml, encoding="utf-8")
    for name, text in shaders.items():
        (folder / f"{name}.glsl").write_text(text, encoding="utf-8")
    return folder


PLAIN_TOML = 'reads = ["radiance"]\n[[pass]]\nshader = "a.glsl"\nwrites = ["result"]\n'
PLAIN_GLSL = "void reuse(ivec2 p) { write_result(p, fetch_radiance(p).rgb); }\n"


def bypassed(folder: Path, method: str, *changes: tuple[str, str, str]) -> Path:
    """A copy of a built-in method in which a stage is bypassed.

    ``changes``: file, text that is in it once, replacement.  A file of the method's base is copied too.
    """
    shutil.copytree(BUILTIN / method, folder)
    for file, text, replacement in changes:
        path = folder / file
        if not path.exists():
            shutil.copy(load_method(method).base / file, path)
        before = path.read_text(encoding="utf-8")
        assert before.count(text) == 1, f"{method}/{file}: {text!r} is {before.count(text)} times in it"
        path.write_text(before.replace(text, replacement), encoding="utf-8")
    return folder


def stages(method: str) -> list[str]:
    """Names of the stages that a method has, each of which needs a bypass in its test."""
    return [stage.name for stage in load_method(method).stages if stage.done]
