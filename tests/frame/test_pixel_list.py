"""Path-traced light for a list of pixels: the same light as in a whole frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

DEMO = Path(__file__).resolve().parents[2] / "assets" / "demo.glb"
SETTINGS = Settings(width=20, height=12, light="path-traced", pattern="independent", spp=2, bounces=2,
                    columns=("direct", "indirect"))  # fmt: skip
FRAME, NUMBER, SAMPLES = 20, 7, (3, 2)


def traced(pixels):
    """direct and indirect of one frame, (h, w, 3); ``pixels``: None for all."""
    scene, gpu = load_scene(DEMO), open_gpu("auto", None)
    with gpu:
        source = RasterSource(gpu, AnimatedScene(scene), SETTINGS, pixel_list=pixels is not None)
        source.draw(FRAME)
        source.trace(NUMBER, *SAMPLES, pixels)
        found = {name: source.read(name)[..., :3] for name in ("direct", "indirect")}
        source.release()
    return found


@pytest.mark.parametrize("count", [1, 17])
def test_listed_pixels_are_those_of_the_whole_frame(count):
    whole = traced(None)
    x, y = np.random.default_rng(count).permutation(20 * 12)[:count] % 20, np.arange(count) % 12
    listed = traced(np.stack([x, y], axis=-1))
    for name, image in whole.items():
        assert np.array_equal(listed[name][y, x], image[y, x])
    assert count == 1 or any(image[y, x].any() for image in whole.values())
