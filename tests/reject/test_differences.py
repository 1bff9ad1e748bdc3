"""Differences of every built-in test on the GPU against float64, from the same channels."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from references.rejection import REFERENCES, PixelRows, PointRows, smaller_change, smaller_turn

from taubench_gl.conventions import NOT_COMPARABLE
from taubench_gl.errors import MethodError
from taubench_gl.evaluation import PairEvaluator, plan_scene
from taubench_gl.frame.passes.pathtracing import pixel_footprint
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.paths import ASSETS
from taubench_gl.reject.contract import builtin_tests, load_test
from taubench_gl.reject.differences import CHANNELS, Differences

SIZE = (64, 36)
EXPOSURE = 0.7


@pytest.fixture
def pair(gpu):
    """Frame 22 of the demo, with what the passes read."""
    settings = fixed_settings(
        width=SIZE[0], height=SIZE[1], reprojection="motion", shadow_size=64, indirect="none",
        columns=("frustum", "position", "normal", "direct"),
    )  # fmt: skip
    given = plan_scene(ASSETS / "demo.glb", settings)
    source = RasterSource(gpu, given.animated, given.settings, extra=CHANNELS)
    context = GpuContext(gpu)
    evaluator = PairEvaluator(context, source, given.settings, images=True)
    differences = Differences(context, source, [load_test(name) for name in builtin_tests()])
    try:
        for frame in (20, 21, 22):
            evaluator.step(frame)
            if frame == 21:
                before = evaluator.motion()
                differences.keep_motion(evaluator.motion_texture)
        yield source, evaluator, differences, before
    finally:
        for part in (differences, evaluator, source, context):
            part.release()
        gpu.collect()


def rows(source, evaluator, before):
    """(pixels that are compared on both sides (h, w), PointRows now and history, PixelRows)."""
    (w, h), frame = SIZE, source.renderer.frame
    view = frame.before[1]
    forward = -view.world_from_view[:, 2]
    now = {n: source.read(n).astype(np.float64) for n in source.channels}
    then = {n: source.read(n, previous=True).astype(np.float64) for n in source.channels}
    motion = evaluator.motion().astype(np.float64)
    y, x = np.mgrid[:h, :w]
    column = np.clip(np.floor(x + motion[..., 0] + 0.5).astype(int), 0, w - 1)
    row = h - 1 - np.clip(np.floor((h - 1 - y) - motion[..., 1] + 0.5).astype(int), 0, h - 1)
    surface = now["position"][..., 3] > 0
    both = ((evaluator.mask() & NOT_COMPARABLE) == 0) & surface & (then["position"][row, column, 3] > 0)
    q = now["prev_position"][..., :3]
    depth = q @ forward
    radiance = (now["direct"][..., :3], then["direct"][..., :3])
    unit = [v["geometric_normal"][..., :3] for v in (now, then)]
    facing = [f / np.maximum(np.linalg.norm(f, axis=-1, keepdims=True), 1e-30) for f in unit]
    gradient = np.stack([smaller_change(depth, surface, 1), smaller_change(depth, surface, 0)], axis=-1)
    turn = smaller_turn(now["normal"][..., :3], surface, 1) + smaller_turn(now["normal"][..., :3], surface, 0)
    width = pixel_footprint(view, SIZE)
    footprint = width[0] + width[1] * depth
    p = now["position"][..., :3]
    cosine = np.abs((facing[0] * p).sum(axis=-1)) / np.maximum(np.linalg.norm(p, axis=-1), 1e-30)
    padded = np.pad(radiance[0] * EXPOSURE, ((1, 1), (1, 1), (0, 0)), mode="edge")
    box = np.stack([padded[i : i + h, j : j + w] for i in range(3) for j in range(3)])
    at = (row, column)
    current = PointRows(
        q[both], depth[both], now["normal"][both][:, :3], facing[0][both], now["ids"][both][:, 0], motion[both],
        radiance[0][both] * EXPOSURE,
    )  # fmt: skip
    history = PointRows(
        then["position"][at][both][:, :3], then["position"][at][both][:, 3], then["normal"][at][both][:, :3],
        facing[1][at][both], then["ids"][at][both][:, 0], before[at][both], radiance[1][at][both] * EXPOSURE,
    )  # fmt: skip
    pixel = PixelRows(
        gradient[both], turn[both], footprint[both], footprint[both] * h, cosine[both], box.min(axis=0)[both],
        box.max(axis=0)[both],
    )  # fmt: skip
    return both, current, history, pixel


def test_every_built_in_test_is_its_reference(pair):
    source, evaluator, differences, before = pair
    both, now, history, pixel = rows(source, evaluator, before)
    assert both.sum() > 1000
    forward = -source.renderer.frame.before[1].world_from_view[:, 2]
    textures = {"mask": evaluator.mask_texture, "motion": evaluator.motion_texture}
    compared = (evaluator.mask() & NOT_COMPARABLE) == 0
    for name in builtin_tests():
        found = differences.run(name, textures, forward, EXPOSURE)
        expected = REFERENCES[name](now, history, pixel, load_test(name).settings)
        # Differences of nearly equal numbers carry the rounding of their terms.
        np.testing.assert_allclose(
            found[both], expected, rtol=2e-3, atol=2e-4 * max(1.0, np.median(expected)), err_msg=name
        )
        assert np.ptp(expected) > 0, name
        sky = source.read("position")[..., 3] == 0
        assert (found[~compared] == -1).all() and np.isin(found[compared & sky], (-1, np.inf)).all()


def test_a_shader_that_does_not_compile_names_its_line(gpu, pair, tmp_path):
    source = pair[0]
    folder = tmp_path / "broken"
    folder.mkdir()
    (folder / "test.toml").write_text('title = "t"\nkind = "geometry"\nunit = "m"\nthreshold = 0.5\n')
    (folder / "test.glsl").write_text("float difference(Point now, Point history, Pixel pixel) {\n return oops;\n}\n")
    context = GpuContext(gpu)
    try:
        with pytest.raises(MethodError) as error:
            Differences(context, source, [load_test(str(folder))])
    finally:
        context.release()
    assert "line 2" in str(error.value) and "test.glsl" in str(error.value)
