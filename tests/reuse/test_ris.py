"""Resampled importance sampling: its float64 reference, each stage, and no bias on six scenes of lamps.

Bias: over 64 seeds, Student's t of four quarters of the image in three colors against the closed form, all twelve at a
significance of 1e-4 together (|t| < 4.9 with 63 degrees of freedom).
"""

from __future__ import annotations

import numpy as np
import pytest
from references.own_light import direct_light
from references.reuse_methods.restir import Moment, ris
from reuse_tools import bypassed
from sample_tools import SCENES, lamps, opened, run_seeds, t_values, triangles_of

from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.runner import MethodRunner

LIMIT = 4.9


def shares(gpu, method, count: int = 8) -> float:
    """Share of pixels that differ from the reference on a scene with an occluder."""
    scene = lamps(occluder=True, glossy=True)
    with opened(gpu, scene, method.reads) as inputs, MethodRunner(gpu, method, inputs.size, {"candidates": count}) as r:
        frame = inputs.advance(0)
        got = read_result(r.step(frame))[..., :3]
        now = Moment(frame.light.surfaces(), frame.light.lights, triangles_of(scene, frame.view), 0, 0)
    expected = ris(now, count)
    return float((np.abs(got - expected) > 1e-5 + 1e-3 * expected).any(axis=-1).mean())


def test_equals_its_reference(gpu):
    """All pixels but those where rounding decides a choice or an edge of a shadow."""
    assert shares(gpu, load_method("ris")) < 0.02


@pytest.mark.parametrize(
    ("stage", "file", "text", "replacement"),
    [
        ("candidates", "ris.glsl", "k < candidates", "k < 1"),
        ("resampling", "reservoir.glsl", "u * r.sum < weight", "r.sum == weight"),
        ("shadow", "ris.glsl", "if (visible(x, at)) light", "light"),
    ],
)
def test_every_stage_is_needed(gpu, tmp_path, stage, file, text, replacement):
    assert stage in {s.name for s in load_method("ris").stages}
    method = load_method(bypassed(tmp_path / "ris", "ris", (file, text, replacement)))
    assert shares(gpu, method) > 0.05


@pytest.mark.parametrize("name", SCENES)
def test_no_bias(gpu, name):
    results, surfaces, rows, triangles = run_seeds(
        gpu, SCENES[name](), load_method("ris"), 2, range(64), {"candidates": 4}
    )
    exact = direct_light(surfaces, rows, triangles)
    assert exact.mean() > 0.02 and np.abs(t_values(results, exact)).max() < LIMIT


def test_a_wrong_density_is_seen(gpu, tmp_path):
    """The test of bias finds a density that is off by a tenth."""
    change = ("reservoir.glsl", "target / candidate.density", "target / (0.9 * candidate.density)")
    method = load_method(bypassed(tmp_path / "ris", "ris", change))
    results, surfaces, rows, triangles = run_seeds(gpu, lamps(), method, 1, range(64), {"candidates": 4})
    assert np.abs(t_values(results, direct_light(surfaces, rows, triangles))).max() > LIMIT


def test_counts(gpu):
    """A pixel draws its candidates, evaluates them and the winner, and traces at most one ray."""
    method = load_method("ris")
    with opened(gpu, lamps(), method.reads) as inputs:
        with MethodRunner(gpu, method, inputs.size, {"candidates": 5}, count=True) as runner:
            frame = inputs.advance(0)
            runner.step(frame)
            counts = runner.light_counts()
        lit = frame.light.surfaces()["position"][..., 3] > 0
    assert np.all(counts[lit, 1] == 5) and np.all(counts[~lit] == 0) and counts[..., 0].max() == 1
    assert set((counts[..., 2] - 5 * lit)[lit]) <= {0, 1}, "the winner, where it is visible, is evaluated again"
