"""Response time: closed forms, a float64 simulation of exponential accumulation, and which events pixels have."""

from __future__ import annotations

import math

import numpy as np
import pytest
from reuse_scenes import passing_box
from reuse_tools import evaluate

from taubench_gl.conventions import Reason
from taubench_gl.report.reuse import mean_response, reuse_tables
from taubench_gl.report.reuse_plots import plot_reuse
from taubench_gl.reuse.response import (
    EVENTS,
    MIN_PIXELS,
    MOST_PIXELS,
    EventTracker,
    ResponseRecord,
    response_frames,
)
from taubench_gl.reuse.scores import CLASSES
from taubench_gl.scene.builder import SceneBuilder, quad
from taubench_gl.scene.model import Scene

EVENT, LAST, FPS = 3, 24, 24.0


def blend(alpha: float) -> str:
    """Exponential accumulation without any test of history."""
    return f"taa_clamp@alpha={alpha}@clamping=false@weighting=false@dilate=false@filtering=nearest"


def closed_form(alpha: float) -> int:
    """Frames until the squared error (1 - alpha)^(2 n) is a tenth."""
    return math.ceil(math.log(0.1) / (2.0 * math.log(1.0 - alpha)))


@pytest.mark.parametrize("alpha", [0.05, 0.1, 0.2, 0.5, 0.9])
def test_exponential_accumulation(alpha):
    errors = 3.0 * (1.0 - alpha) ** (2.0 * np.arange(1, 200))
    assert response_frames(errors) == response_frames(errors, 0.0) == closed_form(alpha)
    assert response_frames(errors + 0.25, 0.25) == (closed_form(alpha) if errors[0] > 0.25 else 0)


def test_never_and_never_disturbed():
    slow = 1.0 - 0.02 * np.arange(40)
    assert np.isnan(response_frames(slow, 0.0)) and np.isnan(response_frames(np.array([3.0] * 20 + [0.0] * 20)))
    noise = np.random.default_rng(1).exponential(size=(200, 40, MIN_PIXELS)).mean(axis=-1)
    assert np.mean(response_frames(noise) == 0.0) > 0.95, "errors of few pixels that are noise alone"


def test_errors_of_many_draws_at_once():
    curves = np.stack([(1.0 - a) ** np.arange(60) for a in (0.2, 0.4)])
    np.testing.assert_array_equal(response_frames(curves), [response_frames(curve) for curve in curves])


def lamp(event: str) -> Scene:
    """A wall with one steady lamp and another: on from frame EVENT on, on before it, or elsewhere from then on."""
    b = SceneBuilder()
    gray = b.material(base_color=(0.7, 0.6, 0.5, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
    b.node(mesh=b.mesh(quad(3.0, 2.0, material=gray)), translation=(0.0, 0.0, -4.0))
    b.light(translation=(-1.0, 0.5, -2.0), intensity=2.0)
    second = b.light(translation=(1.0, 0.5, -2.5), intensity=3.0)
    times = [0.0, (EVENT - 0.5) / FPS]
    on, off = (1.0,) * 3, (0.0,) * 3
    if event == "light_moved":
        b.animate(second, "translation", times, [(1.0, 0.5, -2.5), (-0.5, -0.5, -2.5)], "STEP")
    else:
        b.animate(second, "scale", times, [off, on] if event == "light_born" else [on, off], "STEP")
    camera = b.camera(yfov=np.radians(50.0), znear=0.1)
    b.animate(camera, "translation", [0.0, 2.0], [(0.0, 0.0, 0.0)] * 2)
    return b.build()


@pytest.mark.parametrize("event", ["light_born", "light_killed", "light_moved"])
def test_the_curve_is_that_of_a_simulation(event, tmp_path):
    """Exact light: history is right before the event, and the error is what exponential accumulation forgets of it."""
    frames, alpha = [], 0.2
    done = evaluate(lamp(event), [blend(alpha), "none"], (0, LAST), on_frame=frames.append)
    expected, shown, curve = frames[0].reference.astype(np.float64), None, []
    light = [frame.radiance["reference"].astype(np.float64) for frame in frames]
    names = list(CLASSES)
    changed = {"light_born": ("lit",), "light_killed": ("shadowed",), "light_moved": ("lit", "shadowed")}[event]
    pixels = np.flatnonzero(np.isin(frames[EVENT].classes, [names.index(name) for name in changed]))
    pixels = pixels[:: -(-len(pixels) // MOST_PIXELS)]
    shown = light[0]
    for number, expected in enumerate(light):
        shown = expected if number == 0 else (1.0 - alpha) * shown + alpha * expected
        if number >= EVENT:
            curve.append(float(((shown - expected) ** 2).reshape(-1, 3)[pixels].mean()))
    found = done.summary["methods"][blend(alpha)]["response"]
    assert set(found) == {event} and len(pixels) > 500
    np.testing.assert_allclose(found[event]["curve"], curve, rtol=1e-4, atol=1e-12)
    assert found[event]["frames"] == closed_form(alpha) and found[event]["never_percent"] == 0.0
    assert done.summary["methods"]["none"]["response"][event]["frames"] == 0.0
    (table,) = (table for table in reuse_tables(done.summary) if table.title == "Response time")
    assert [row.values[:1] for row in table.rows] == [(float(closed_form(alpha)),), (0.0,)]
    assert tmp_path / "response.png" in plot_reuse(done.summary, done.rows, tmp_path)


def test_the_table_of_a_benchmark_has_means_over_cases():
    frames = [{"disoccluded": {"frames": value}} for value in (2.0, 4.0, None)]
    methods = {"a": {"cases": {str(i): {"response": each} for i, each in enumerate(frames)}},
               "b": {"cases": {"0": {"state": "failed"}}}}  # fmt: skip
    table = mean_response({"methods": methods})
    assert [(row.label, row.values) for row in table.rows] == [("a", (3.0,))]


def test_disocclusion_and_a_cut():
    """A box passes a wall: untested history is a ghost, tested history has none; a cut restarts both."""
    done = evaluate(passing_box(1.5), [blend(0.2), "bmfr_temporal"], (0, 46), cuts=(36,))
    ghost, tested = (done.summary["methods"][name]["response"] for name in (blend(0.2), "bmfr_temporal"))
    assert ghost["disoccluded"]["events"] > 10 and ghost["disoccluded"]["frames"] == pytest.approx(
        closed_form(0.2), 0.2
    )
    assert tested["disoccluded"]["frames"] == 0.0 and tested["disoccluded"]["curve"][0] < 1e-6
    for found in (ghost, tested):
        assert found["cut"]["events"] == 1 and found["cut"]["frames"] == 0.0


def test_events_of_pixels():
    """Events move with their surface, end where history is discarded, and the later one replaces the earlier one."""
    tracker, motion = EventTracker({"born": [0, 1, 0], "killed": [0, 0, 0], "moved": [0, 0, 1]}), np.zeros((1, 4, 2))
    motion[..., 0] = -1.0  # the image moves to the right
    names = list(EVENTS)

    def keys(*bits: int, scored: bool = True) -> list[tuple[int, str] | None]:
        events = tracker.advance(np.uint32([bits]), motion, np.full((1, 4), scored))[0] // MOST_PIXELS
        return [None if key < 0 else (key // len(names), names[key % len(names)]) for key in events.tolist()]

    lit, off = int(Reason.LIT | Reason.DIRECT), int(Reason.DISOCCLUDED)
    assert keys(int(Reason.FIRST), 0, 0, lit) == [None] * 4
    assert keys(off, 0, 0, lit) == [(1, "disoccluded"), None, None, None], "no light is born in this frame"
    assert keys(int(Reason.POSITION), 0, lit, lit) == [None, (1, "disoccluded"), (2, "light_born"), (2, "light_born")]
    third = [None, None, (1, "disoccluded"), (3, "light_moved")]
    assert keys(0, 0, 0, int(Reason.DIRECT)) == third
    tracker.begin()
    assert keys(0, 0, 0, 0) == keys(off, off, off, off, scored=False) == [None] * 4


def test_the_error_is_that_of_the_same_pixels():
    """Bright pixels that leave after three frames are no recovery of those that stay."""
    record, ids = ResponseRecord(), np.arange(2 * MIN_PIXELS)[None]
    for _ in range(2):
        for age in range(12):
            stay = ids if age < 3 else np.where(ids < MIN_PIXELS, ids, -1)
            record.add(stay, np.where(ids < MIN_PIXELS, 1.0 + age, 100.0))
        record.end()
    assert record.summary()["cut"]["curve"] == [1.0 + age for age in range(12)]


def test_intervals_over_seeds():
    """Noise in the error of each seed moves the response, and the interval contains that of the mean."""
    record, rng, ids = ResponseRecord(), np.random.default_rng(2), np.arange(2 * MIN_PIXELS)[None]
    for _ in range(6):
        for age in range(40):
            record.add(ids, 0.9 ** (2 * age) + 0.05 * rng.exponential(size=ids.shape))
        record.end()
    found = record.summary()["cut"]
    assert (found["events"], found["followed"], found["interval_reason"]) == (1, 1, None)
    assert found["low"] <= found["frames"] <= found["high"] and 8 <= found["low"] < found["high"] <= 16
    few = ResponseRecord()
    for age in range(7):
        few.add(ids, np.full(ids.shape, 0.5**age))
    few.end()
    assert few.summary()["cut"]["frames"] is None and few.summary()["cut"]["reason"]
    assert ResponseRecord().summary() == {}
