"""Positions where attributes are interpolated beside pixel centers, as GPUs do, which snap corners to 1/256 pixel.

llvmpipe interpolates at the center, so the fragment shader is given attributes of a place beside it.
"""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu import shader
from taubench_gl.selftest import run_selftest
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.scenes import busy_room

BESIDE = """
vec3 beside(vec3 v) { return v + 0.002 * dFdx(v) - 0.0015 * dFdy(v); }
#define pos_rel beside(pos_rel)
#define prev_pos_rel beside(prev_pos_rel)
"""


@pytest.fixture(params=[False, True], ids=["as interpolated", "moved to the center"])
def corrected(request, monkeypatch) -> bool:
    read, place = shader.read_source, "in vec3 prev_pos_rel;\n#endif\n"

    def read_source(entry, *more):
        text = read(entry, *more)
        if entry != "gbuffer/gbuffer.frag.glsl":
            return text
        assert text.count(place) == 1
        return text.replace(place, place + BESIDE)

    monkeypatch.setattr(shader, "read_source", read_source)
    monkeypatch.setattr(Tuning, "snapped_corners", property(lambda self: request.param))
    return request.param


def test_positions_lie_on_the_rays_of_pixel_centers(gpu, corrected):
    size = 96, 64
    with Bench(gpu, size) as bench:
        shot, view = bench.frame(busy_room())
    surface = shot["position"][..., 3] > 0
    p = shot["position"][surface][:, :3].astype(np.float64)
    clip = np.column_stack([p, np.ones(len(p))]) @ view.clip_from_relative(*size).T
    y, x = np.nonzero(surface)
    at = (clip[:, :2] / clip[:, 3:] * (1, -1) + 1.0) / 2.0 * size
    off = np.abs(at - np.column_stack([x, y]) - 0.5).max(axis=1)
    if corrected:
        assert np.quantile(off, 0.99) < 1e-4
    else:
        assert np.median(off) == pytest.approx(2e-3, rel=0.05)


def test_motion_is_that_of_the_pixel_center(gpu, corrected):
    """A floor whose motion grows by 13 pixels a pixel; and what stands still has no motion at all."""
    cases = {r.name: r for r in run_selftest(gpu, only=("near-crossing-motion", "still-scene", "still-far-away"))}
    assert cases["still-scene"].passed and cases["still-far-away"].passed
    error = cases["near-crossing-motion"].error
    assert error < 1e-4 if corrected else error > 0.02
