"""ReSTIR DI: its float64 reference, each stage, and bias on six scenes of lamps with a history of four frames.

Bias: as in test_ris.  Unbiased combinations are within |t| < 4.9, 1e-4 for all twelve values of a scene together.
"""

from __future__ import annotations

import numpy as np
import pytest
from references.own_light import direct_light
from references.reuse_methods.restir import Moment, Restir
from reuse_tools import bypassed, stages
from sample_tools import SCENES, Seeds, lamps, opened, run_seeds, t_values, triangles_of

from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.frame.targets import read_channel
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.runner import MethodRunner

LIMIT = 4.9
SMALL = {"candidates": 4, "radius": 1.0 / 3.0}
MOVING = {"moving": (20.0, 0.0, 0.0), "switched": ((1, (2, 9)),), "camera_speed": 6.0, "occluder": True}
_DISCARDED = int(NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL)


def differing(gpu, method, settings, frames: int = 3) -> float:
    """Share of pixels whose light or reservoir differs from the reference: lamp and camera move, a lamp is born."""
    scene = lamps(**MOVING)
    reference = Restir(**settings)
    reads = (*method.reads, "motion", "mask")
    with opened(gpu, scene, reads) as inputs, MethodRunner(gpu, method, inputs.size, settings) as runner:
        before = past = None
        for number in range(frames):
            frame = inputs.advance(number)
            got = read_result(runner.step(frame))[..., :3]
            triangles = triangles_of(scene, frame.view)
            now = Moment(frame.light.surfaces().copy(), frame.light.lights.copy(), triangles, number, 0)
            motion, mask = (read_channel(frame.textures[name], name) for name in ("motion", "mask"))
            mask = mask.reshape(now.surfaces.shape)
            y, x = np.indices(mask.shape) + np.moveaxis(motion[..., ::-1], -1, 0)
            at = np.stack([np.floor(x + 0.5), np.ceil(y - 0.5)], axis=-1).astype(int)  # GLSL rounds with y up
            reusable = np.full(mask.shape, number > 0) & ((mask & _DISCARDED) == 0)
            light, past = reference.frame(now, before, past, at, reusable)
            before = now
        records = runner._backend.records("kept")
    wrong = (np.abs(got - light) > 1e-5 + 1e-3 * light).any(axis=-1)
    wrong |= (records["light"] != past.light) & (past.weight > 0) | (records["count"] != past.count)
    return float(wrong.mean())


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"visibility_reuse": True, "rounds": 2},
        {"visibility_reuse": True, "combination": "unbiased"},
        {"visibility_reuse": True, "combination": "biased", "rounds": 2},
        {"history_limit": 1, "neighbors": 0},
    ],
    ids=["default", "visibility reuse", "counts", "biased", "temporal"],
)
def test_equals_its_reference(gpu, changes):
    """All pixels but those where rounding decides a choice or an edge of a shadow, and their later neighbors."""
    assert differing(gpu, load_method("restir-di"), SMALL | changes) < 0.02


BYPASSES = {
    "initial_candidates": ("initial.glsl", "k < candidates", "k < 1"),
    "visibility_reuse": ("initial.glsl", "visibility_reuse && r.sum > 0.0", "false"),
    "temporal_reuse": ("temporal.glsl", "temporal && x.lit", "false"),
    "history_limit": ("temporal.glsl", "float(history_limit) * fresh.count", "float(history_limit + 1) * fresh.count"),
    "spatial_reuse": ("spatial.glsl", "if (!similar(x, surface_at(q))) continue;", "continue;"),
    "similar_surfaces": ("spatial.glsl", "dot(a.s.n, b.s.n) > SIMILAR_NORMAL &&", "true ||"),
    "unbiased_combination": ("combine.glsl", "else if (combination == COMBINATION_BIASED)", "else if (true)"),
    "pairwise_weights": ("combine.glsl", "others * theirs / sum", "others / (others + count)"),
    "shading": ("shade.glsl", "if (visible(x, at))", "if (true)"),
}
CHANGES = {
    "visibility_reuse": {"visibility_reuse": True},
    "history_limit": {"history_limit": 1},
    "unbiased_combination": {"combination": "unbiased", "visibility_reuse": True},
}
"""Settings with which a stage has an effect."""


@pytest.mark.parametrize("stage", stages("restir-di"))
def test_every_stage_is_needed(gpu, tmp_path, stage):
    method = load_method(bypassed(tmp_path / "restir-di", "restir-di", BYPASSES[stage]))
    assert differing(gpu, method, SMALL | CHANGES.get(stage, {})) > 0.05


def bias(gpu, method, name: str, settings=()) -> np.ndarray:
    results, surfaces, rows, triangles = run_seeds(gpu, SCENES[name](), method, 4, range(64), SMALL | dict(settings))
    return t_values(results, direct_light(surfaces, rows, triangles))


@pytest.mark.parametrize(
    ("combination", "reuse"),
    [("pairwise", False), ("pairwise", True), ("unbiased", True)],
    ids=["pairwise", "pairwise with visibility reuse", "counts with visibility reuse"],
)
@pytest.mark.parametrize("name", SCENES)
def test_unbiased_combinations_have_no_bias(gpu, name, combination, reuse):
    settings = {"combination": combination, "visibility_reuse": reuse}
    assert np.abs(bias(gpu, load_method("restir-di"), name, settings)).max() < LIMIT


@pytest.mark.parametrize("name", ["occluder", "moving camera"])
def test_the_biased_combination_darkens_what_neighbors_cannot_see(gpu, name):
    """Section 4.3 and figure 5 of the paper: 1/M counts reservoirs that could not hold the sample."""
    settings = {"combination": "biased", "visibility_reuse": True}
    assert bias(gpu, load_method("restir-di"), name, settings).min() < -LIMIT


@pytest.mark.parametrize(
    ("combination", "change"),
    [
        ("unbiased", ("temporal.glsl", "target_of(before, was) > 0.0", "true")),
        ("unbiased", ("temporal.glsl", "prev_light_at(c.kept.light, c.kept.uv)", "light_at(c.kept.light, c.kept.uv)")),
        ("pairwise", ("temporal.glsl", "held(before, fresh, true, false)", "fresh_target")),
        ("pairwise", ("temporal.glsl", "held(before, fresh, true, false)", "held(before, fresh, false, false)")),
    ],
    ids=["no target", "light of this frame", "pairs, no target", "pairs, light of this frame"],
)
def test_a_missing_target_of_the_previous_frame_is_seen(gpu, tmp_path, combination, change):
    """A lamp is born: history could not hold it, and counts as if it could."""
    method = load_method(bypassed(tmp_path / "restir-di", "restir-di", change))
    settings = {"neighbors": 0, "visibility_reuse": False, "combination": combination}
    assert bias(gpu, method, "born and killed", settings).min() < -LIMIT


def squared_errors(gpu, scene, method, settings, frames: int, seeds: int):
    """Mean squared error of the last frame over seeds, and shadow rays a pixel."""
    with (
        opened(gpu, scene, method.reads) as inputs,
        MethodRunner(gpu, method, inputs.size, settings, count=True) as runner,
    ):
        many = Seeds(runner, range(seeds))
        for number in range(frames):
            frame = inputs.advance(number)
            results = many.step(frame)
        exact = direct_light(frame.light.surfaces(), frame.light.lights, triangles_of(scene, frame.view))
        return np.mean((results - exact) ** 2), runner.light_counts()[..., 0].mean()


@pytest.mark.parametrize(
    ("combination", "low", "high"), [("pairwise", 0.0, 2.0), ("unbiased", 8.0, np.inf)], ids=["pairwise", "counts"]
)
def test_the_error_where_lamps_are_born(gpu, combination, low, high):
    """In the frame of the birth, against ris of as many rays: counts have heavy tails, weights in pairs have none."""
    scene = lamps(switched=[(lamp, (3, 9)) for lamp in (0, 1, 2, 5)])
    ris, rays = squared_errors(gpu, scene, load_method("ris"), {"candidates": 8}, 4, 16)
    settings = {"candidates": 8, "combination": combination}
    restir, more_rays = squared_errors(gpu, scene, load_method("restir-di"), settings, 4, 16)
    assert more_rays <= 1.02 * rays and low * ris < restir < high * ris


@pytest.mark.parametrize(("name", "least"), [("many lamps", 3.0), ("two colors", 1.5)])
def test_less_error_than_ris_at_equal_rays_and_samples(gpu, name, least):
    """Mean squared error of the sixth frame over 16 seeds; both trace one ray a pixel, of equally many samples."""
    ris, rays = squared_errors(gpu, SCENES[name](), load_method("ris"), {"candidates": 4}, 6, 16)
    settings = SMALL | {"radius": 0.0}
    restir, more_rays = squared_errors(gpu, SCENES[name](), load_method("restir-di"), settings, 6, 16)
    assert more_rays <= 1.02 * rays and ris > least * restir


def test_runs_are_equal_bit_for_bit(gpu):
    method, scene = load_method("restir-di"), lamps(**MOVING)
    first, second = (run_seeds(gpu, scene, method, 4, [3], SMALL)[0] for _ in range(2))
    np.testing.assert_array_equal(first, second)
