"""The mask pass has two variants, one for llvmpipe and one for GPUs, with the same results bit for bit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from fixed import fixed_settings
from repeated import few

from taubench_gl.animation.pairs import reprojection
from taubench_gl.features import FEATURES
from taubench_gl.frame.passes.masks import MaskOptions, MaskPass
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.frame.targets import read_channel
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene

SIZE = (97, 54)
"""Neither a multiple of the work group nor of the pixels per invocation."""


@pytest.mark.parametrize("storage", few(["half", "float"]))
@pytest.mark.parametrize(
    ("mode", "sampling"),
    few([("motion", "bilinear"), ("camera", "nearest"), ("motion", "nearest"), ("camera", "bilinear")], 2),
)
def test_both_ways_give_the_same_bits(gpu, storage: str, mode: str, sampling: str) -> None:
    scene = load_scene(ASSETS / "demo.glb")
    settings = fixed_settings(width=SIZE[0], height=SIZE[1], reprojection=mode, storage=storage)
    source = RasterSource(gpu, AnimatedScene(scene), settings)
    views = [source.advance(10), source.advance(14)]
    pair = reprojection(views[1], views[0], *SIZE)
    thresholds = {f: settings.metrics.threshold(f) for f in FEATURES}
    found = []
    for software in (True, False):
        options = MaskOptions(mode, sampling, source.radiance, cuts=source.cuts, write_mask=True, write_motion=True)
        masks = MaskPass(GpuContext(dataclasses.replace(gpu, software=software)), SIZE, options)
        run = masks.run(pair, thresholds, source.current, source.previous)
        images = read_channel(masks.mask, "mask"), read_channel(masks.motion, "motion")
        found.append((masks.read(run), *images))
        masks.release()
    (one, mask, motion), (other, *images) = found
    assert (
        one.mask_histogram.sum() == SIZE[0] * SIZE[1]
        and np.count_nonzero(one.mask_histogram) > 3
        and one.histograms.sum() > 0
    )
    assert np.array_equal(one.mask_histogram, other.mask_histogram) and np.array_equal(one.histograms, other.histograms)
    assert np.array_equal(mask, images[0]) and motion.tobytes() == images[1].tobytes()
    source.release()
