"""A-SVGF against its float64 reference, every stage of its own bypassed, and its two laws: no change of light, no
difference to SVGF; light that changes, less lag."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from references.reuse_methods import Asvgf
from reuse_tools import bypassed, open_inputs, play, still_steps
from stage_tools import differing, noisy_steps

from taubench_gl.frame.targets import read_channel
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.loading import BUILTIN, load_method
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.scene.builder import SceneBuilder, quad, turn_x

SIZE = (48, 28)  # blocks at the edge are cut
EXPOSURE, SETTINGS = 0.5, {"levels": 2, "gradient_levels": 2}
ROUNDING = 2e-3

BYPASSES = {
    "gradient_samples": ("gradient.glsl", "vec3(now - then, max(now, then), 1.0)", "vec3(0.0, max(now, then), 1.0)"),
    "gradient_budget": ("budget.glsl", "gradient_budget && fetch_reshaded(p).a > 0.5;", "false;"),
    "gradient_reconstruction": ("gradient_atrous.glsl", "if (other.z <= 0.0) continue;",
                                "if (other.z <= 0.0 || c != b) continue;"),
    "adaptive_alpha": ("share.glsl", "return g.y > 0.0 ? min(abs(g.x) / g.y, 1.0) : 0.0;", "return 0.0;"),
}  # fmt: skip


def reshaded_steps(steps, change: np.ndarray, share: float = 0.8, seed: int = 3):
    """``steps`` with a sample in ``share`` of the 3x3 blocks, of light that is now ``change`` times what it was."""
    rng = np.random.default_rng(seed)
    out = []
    for step in steps:
        h, w = step.clean.shape[:2]
        now, sampled = step.inputs["radiance"][..., :3] * (0.5 + rng.random((h, w, 1))), np.zeros((h, w, 1))
        for up in range(0, h, 3):
            for x in range(0, w, 3):
                if step.index > 0 and rng.random() < share:
                    sampled[h - 1 - rng.integers(up, min(up + 3, h)), rng.integers(x, min(x + 3, w))] = 1
        lights = {"reshaded": now, "reshaded_direct": 0.5 * now, "reshaded_before": now / change[..., None]}
        inputs = {
            n: np.concatenate([light * sampled, sampled], axis=-1).astype(np.float32) for n, light in lights.items()
        }
        out.append(replace(step, inputs=step.inputs | inputs))
    return out


@pytest.fixture(scope="module")
def steps():
    change = np.where(np.arange(SIZE[0]) < SIZE[0] // 2, 0.4, 1.0) * np.ones((SIZE[1], 1))
    return reshaded_steps(noisy_steps(SIZE), change)


@pytest.fixture(scope="module")
def expected(steps):
    asvgf = Asvgf(**SETTINGS)
    return [asvgf.frame(step.inputs, step.pair.prev_forward, EXPOSURE) for step in steps]


def test_every_stage_has_a_bypass():
    """Stages of SVGF are the shaders of SVGF, which its own tests bypass."""
    method = load_method("asvgf")
    own = {stage.name for stage in method.stages if (BUILTIN / "asvgf" / stage.shader).exists()}
    assert own == set(BYPASSES)
    assert {stage.name for stage in method.stages} == own | {stage.name for stage in load_method("svgf").stages}
    assert all(stage.done for stage in method.stages)


@pytest.mark.parametrize("stage", [None, *BYPASSES])
def test_a_bypassed_stage_is_noticed(gpu, steps, expected, stage, tmp_path):
    changes = [] if stage is None else [BYPASSES[stage]]
    got = play(gpu, bypassed(tmp_path / "asvgf", "asvgf", *changes), steps, SETTINGS, exposure=EXPOSURE)
    worst = max(map(differing, got, expected))
    assert (worst <= ROUNDING) if stage is None else (worst > 10 * ROUNDING), worst


def test_without_change_it_is_svgf(gpu):
    steps = reshaded_steps(noisy_steps(SIZE), np.ones(SIZE[::-1]))
    adaptive = play(gpu, "asvgf", steps, SETTINGS | {"gradient_budget": False})
    for got, plain in zip(adaptive, play(gpu, "svgf", steps, {"levels": 2})):
        np.testing.assert_array_equal(got, plain)


def test_no_pixel_uses_two_samples(gpu, steps):
    """Where a gradient sample is, the light of the pixel itself changes nothing: the budget is that of SVGF."""
    other = []
    for step in steps:
        again = step.inputs["reshaded"][..., 3:] > 0.5
        lights = {n: np.where(again, 7.0, step.inputs[n]).astype(np.float32) for n in ("radiance", "direct")}
        other.append(replace(step, inputs=step.inputs | lights))
    for within, got in zip(play(gpu, "asvgf", steps, SETTINGS), play(gpu, "asvgf", other, SETTINGS), strict=True):
        np.testing.assert_array_equal(got, within)
    more = SETTINGS | {"gradient_budget": False}
    assert not np.array_equal(play(gpu, "asvgf", steps, more), play(gpu, "asvgf", other, more))


def test_light_that_is_switched_off_does_not_lag(gpu):
    """The frame after the switch: SVGF shows most of the old light, A-SVGF almost none."""
    h, w = SIZE[::-1]
    lit = np.full((h, w, 3), 0.6)
    still = still_steps(SIZE, [lit] * 8 + [0.1 * lit] * 2)
    before = reshaded_steps(still[:8], np.ones((h, w)))
    after = reshaded_steps(still[8:9], np.full((h, w), 0.1)) + reshaded_steps(still[9:], np.ones((h, w)))
    left = {}
    for name in ("svgf", "asvgf"):
        result = play(gpu, name, before + after)[8][..., :3]
        surface = still[8].inputs["position"][..., 3] > 0
        left[name] = float(np.abs(result - 0.06)[surface].mean() / 0.54)
    assert left["svgf"] > 0.6 and left["asvgf"] < 0.25, left


def test_path_traced_light_that_moves_away(gpu):
    """One sample per pixel, shaded again by the path tracer: the share of the old light that is left a frame later.

    The mean of the noisy frame is the light that should be there.
    """
    b = SceneBuilder()
    gray = b.material(base_color=(0.7, 0.7, 0.7, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=gray)), rotation=turn_x(-90.0))
    lamp = b.light(translation=(0.0, 2.0, 0.0), intensity=20.0)
    b.light(translation=(1.0, 3.0, 1.0), intensity=4.0)
    b.animate(lamp, "translation", [0.0, 7.5 / 24, 7.51 / 24], [(0.0, 2.0, 0.0)] * 2 + [(0.0, -50.0, 0.0)])
    b.camera(translation=(0.0, 2.0, 3.0), rotation=turn_x(-35.0), yfov=np.radians(50.0), znear=0.1)
    names = {"svgf": ("svgf", {}), "asvgf": ("asvgf", {}), "additional": ("asvgf", {"gradient_budget": False})}
    reads = {name for method, _ in names.values() for name in load_method(method).reads}
    changes, means = {"width": 48, "height": 36, "indirect": "auto"}, []
    with ExitStack() as stack:
        inputs = stack.enter_context(open_inputs(gpu, b.build(), "path-traced@1", reads, seed=0, settings=changes))
        runners = {label: stack.enter_context(MethodRunner(gpu, name, inputs.size, values))
                   for label, (name, values) in names.items()}  # fmt: skip
        for index in range(9):
            frame = inputs.advance(index)
            images = {name: read_result(runner.step(frame)) for name, runner in runners.items()}
            images["input"] = read_channel(frame.textures["radiance"], "radiance")
            means.append({name: float(image[..., :3].mean()) for name, image in images.items()})
    before, after = means[7]["input"], means[8]["input"]
    assert before > 2 * after > 0
    left = {name: (means[8][name] - after) / (before - after) for name in names}
    assert left["svgf"] > 0.6 and left["asvgf"] < 0.3, left
    assert means[7]["additional"] == pytest.approx(means[7]["svgf"], rel=1e-6), "no gradient while nothing changes"
