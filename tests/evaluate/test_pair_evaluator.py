"""PairEvaluator: late and immediate read-back, restart, textures of the caller, and interrupts."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Reason
from taubench_gl.evaluation import ChannelPair, PairEvaluator
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.metrics.counts import counts_of
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

SIZE = (64, 36)
FRAMES = range(20, 25)
SETTINGS = fixed_settings(width=SIZE[0], height=SIZE[1], columns=("frustum", "position", "normal"))


@pytest.fixture
def context(gpu):
    made = GpuContext(gpu)
    yield made
    made.release()
    gpu.collect()


def source_of(context: GpuContext, settings: Settings) -> RasterSource:
    scene = load_scene(ASSETS / "demo.glb")
    return RasterSource(context.gpu, AnimatedScene(scene), settings)


def pairs_of(context: GpuContext, settings: Settings = SETTINGS, *, images: bool = False) -> list:
    source = source_of(context, settings)
    evaluator = PairEvaluator(context, source, settings, images=images)
    pairs = [pair for frame in FRAMES for pair in evaluator.step(frame)[1]]
    assert len(pairs) == len(FRAMES) - 1 - evaluator.deferred
    pairs += evaluator.finish()
    for part in (evaluator, source):
        part.release()
    return pairs


def test_late_and_immediate_read_back_give_the_same_counts(context):
    late, immediate = pairs_of(context), pairs_of(context, images=True)
    assert [pair.frame for pair in late] == [pair.frame for pair in immediate] == list(FRAMES)[1:]
    for a, b in zip(late, immediate, strict=True):
        np.testing.assert_array_equal(a.counts.mask_histogram, b.counts.mask_histogram)
        np.testing.assert_array_equal(a.counts.histograms, b.counts.histograms)
        assert a.seconds > 0


def test_samples_per_pixel_are_added(context):
    for pair in pairs_of(context, SETTINGS.replace(samples_per_pixel=3)):
        assert pair.counts.mask_histogram.sum() == 3 * SIZE[0] * SIZE[1]


def test_restarted_evaluator_has_no_history(context):
    source = source_of(context, SETTINGS)
    evaluator = PairEvaluator(context, source, SETTINGS, images=True)
    assert evaluator.step(20)[1] == [] and len(evaluator.step(21)[1]) == 1
    assert evaluator.step(22, evaluate=False)[1] == []
    evaluator.restart()
    assert evaluator.step(23)[1] == [] and evaluator.finish() == []
    for part in (evaluator, source):
        part.release()


def test_textures_thresholds_and_declared_bits_of_the_caller(context):
    """A frame compared with itself has no discard; declared FIRST, every pixel is of that class."""
    source = source_of(context, SETTINGS)
    view = source.advance(20)
    pair = reprojection(view, view, *SIZE)
    held = ChannelPair(SIZE, source.current, source.current)
    evaluator = PairEvaluator(context, held, SETTINGS)
    pixels = SIZE[0] * SIZE[1]
    counts = counts_of(evaluator.read(evaluator.submit(pair)).mask_histogram)
    assert counts["comparable"] == pixels and counts["position"] == counts["normal"] == 0
    counts = counts_of(evaluator.read(evaluator.submit(pair, declared=Reason.FIRST)).mask_histogram)
    assert counts["first"] == pixels
    source.advance(30)
    limits = SETTINGS.metrics.thresholds
    found = []
    for changed in (limits, {**limits, "normal": 0.0}):
        run = evaluator.submit(pair, current=source.current, thresholds=changed)
        found.append(counts_of(evaluator.read(run).mask_histogram)["normal"])
    assert 0 < found[0] <= found[1]
    for part in (evaluator, source):
        part.release()
