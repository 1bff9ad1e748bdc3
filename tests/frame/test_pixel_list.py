"""Path-traced light for a list of pixels: the same light as in a whole frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.scene import load_scene

DEMO = Path(__file__).resolve().parents[2] / "assets" / "demo.glb"
SETTINGS = fixed_settings(width=20, height=12, light="path-traced", pattern="independent", spp=2, bounces=2,
                    columns=("direct", "indirect"))  # fmt: skip
FRAME, NUMBER, SAMPLES = 20, 7, (3, 2)


def traced(pixels):
    """direct and indirect of one frame, (h, w, 3) or of ``pixels`` (n, 2) without number, (n, 3); None: of all."""
    scene, gpu = load_scene(DEMO), open_gpu("auto", None)
    with gpu, RasterSource(gpu, AnimatedScene(scene), SETTINGS, pixel_list=pixels is not None) as source:
        source.draw(FRAME)
        if pixels is None:
            source.trace(NUMBER, *SAMPLES)
            return {name: source.read(name)[..., :3] for name in ("direct", "indirect")}
        light = source.listed_light(NUMBER, pixels, pixels, range(SAMPLES[0], sum(SAMPLES)), drawn=True)
        lobes = light.astype(np.float64).mean(axis=1)
        return {"direct": lobes[:, 0] + lobes[:, 1], "indirect": lobes[:, 2] + lobes[:, 3]}


@pytest.mark.parametrize("count", [1, 17])
def test_listed_pixels_are_those_of_the_whole_frame(count):
    whole = traced(None)
    x, y = np.random.default_rng(count).permutation(20 * 12)[:count] % 20, np.arange(count) % 12
    listed = traced(np.stack([x, y], axis=-1))
    for name, image in whole.items():
        assert listed[name] == pytest.approx(image[y, x], rel=1e-5, abs=1e-7)
    assert count == 1 or any(image[y, x].any() for image in whole.values())
