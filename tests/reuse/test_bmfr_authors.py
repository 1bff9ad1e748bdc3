"""tools/bmfr_authors.py: what the code of BMFR's authors is given.  Nothing here needs OpenCL or their code."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from taubench_gl.reuse.synthetic import synthetic_steps

TOOLS = Path(__file__).resolve().parents[2] / "tools"
SIZE = (64, 48)


@pytest.fixture
def authors(monkeypatch):
    for folder in (TOOLS, TOOLS / "peer_programs"):
        monkeypatch.syspath_prepend(str(folder))
    import bmfr_authors

    yield bmfr_authors
    for name in ("bmfr_authors", "bmfr_opencl", "serve", "peers"):
        sys.modules.pop(name, None)


def frame_of(step, **changes):
    numbers = {"pair": step.pair, "view": step.view, "prev_view": step.prev_view, "exposure": 0.5}
    numbers |= {"jitter_px": np.zeros(2), "prev_clip_from_prev": step.pair.prev_clip_from_prev}
    return step.inputs | numbers | changes


def previous_px(given):
    """Where their accumulation reads history: -> (h, w, 2), x and y of pixels, row 0 at the bottom."""
    h, w = given["position"].shape[:2]
    point = np.concatenate([given["position"], np.ones((h, w, 1), np.float32)], axis=-1).astype(np.float64)
    clip = point @ given["matrix"].astype(np.float64)
    uv = clip[..., :2] / clip[..., 3:] / 2 + 0.5
    return uv * [w, h] - [given["offset"][0], 1 - given["offset"][1]]


def test_history_is_read_where_motion_says(authors):
    """Still surfaces move by ``motion`` in their reprojection by one matrix; the moving ball does not."""
    for step in list(synthetic_steps(SIZE, 3, speed=3.0))[1:]:
        at = previous_px(authors.their_inputs(frame_of(step), shift=7.0))
        y, x = np.mgrid[: SIZE[1], : SIZE[0]]
        expected = np.stack([x, y], axis=-1) + step.inputs["motion"][::-1] * [1, -1]
        ball = step.inputs["ids"][::-1, :, 0] == 2
        surface = (step.inputs["position"][::-1, :, 3] > 0) & ~ball
        assert np.abs(at - expected)[surface].max() < 5e-3
        assert np.abs(at - expected)[ball].max() > 0.5


def test_light_is_illumination_times_albedo_plus_emission(authors):
    (step,) = synthetic_steps(SIZE, 1)
    emission = np.full_like(step.inputs["emission"], 0.25)
    given = authors.their_inputs(frame_of(step, emission=emission))
    surface = step.inputs["position"][::-1, :, 3:] > 0
    light = given["noisy"] * given["albedo"] + np.where(surface, 0.5 * 0.25, 0.0)
    np.testing.assert_allclose(light, step.inputs["radiance"][::-1, :, :3], rtol=1e-6)
    assert given["albedo"].min() >= 0.01 and (given["albedo"][~surface[..., 0]] == 1).all()
