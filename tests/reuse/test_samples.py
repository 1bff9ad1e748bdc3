"""Scores of light samples: what rays say of reservoirs against float64, and the numbers that are made from it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from references import sample_scores
from references.reuse_methods.restir import Moment
from reuse_scenes import settings as small_settings
from reuse_tools import truth_of
from sample_tools import SCENES, lamps, opened, triangles_of

from taubench_gl.conventions import Reason
from taubench_gl.frame.targets import read_channel
from taubench_gl.report.reuse import merged_summaries, reuse_tables
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.sample_rays import REASONS, Fact, SampleFrame, SampleRays
from taubench_gl.reuse.samples import (
    SampleRecord,
    duplicates,
    history_counts,
    light_colors,
    outcome_colors,
    sign_test,
)

SMALL = {"candidates": 4}


def played(gpu, scene, frames: int, settings=SMALL):
    """The last frame of restir-di: its facts, its mask (h, w), and the moments of that frame and of the one before."""
    method = load_method("restir-di")
    with (
        opened(gpu, scene, (*method.reads, "motion", "mask")) as inputs,
        MethodRunner(gpu, method, inputs.size, settings, count=True) as runner,
    ):
        rays = moment = None
        for number in range(frames):
            inputs_now = inputs.advance(number)
            runner.step(inputs_now)
            light = inputs_now.light
            before = moment
            moment = Moment(
                light.surfaces().copy(), light.lights.copy(), triangles_of(scene, inputs_now.view), number, 0
            )
        rays = SampleRays(gpu, light, inputs.size, 0.1)
        try:
            counts = runner.light_counts()
            frame = rays.of(runner.reported(inputs_now), inputs_now.textures["motion"], counts)
        finally:
            rays.release()
        mask, motion = (read_channel(inputs_now.textures[name], name) for name in ("mask", "motion"))
        return frame, mask.reshape(counts.shape[:2]), motion, moment, before


def test_wrong_keeps_equal_a_count_in_float64(gpu):
    """Camera and lamp move behind an occluder: history is kept and rejected, rightly and wrongly."""
    scene = lamps(moving=(20.0, 0.0, 0.0), camera_speed=12.0, occluder=True)
    frame, mask, _, moment, _ = played(gpu, scene, 3, SMALL | {"visibility_reuse": False})
    reaches = sample_scores.held_reaches(moment, frame.history)
    np.testing.assert_array_equal(frame.has(Fact.HISTORY_REACHES), reaches)
    np.testing.assert_array_equal(frame.has(Fact.KEPT_REACHES), sample_scores.held_reaches(moment, frame.kept))
    held, kept = frame.history[..., 0] >= 0, frame.history[..., 3] > 0.5
    expected = sample_scores.count(held, kept, reaches, frame.reasons(mask), len(REASONS))
    np.testing.assert_array_equal(history_counts(frame, mask), expected)
    assert (expected.sum(axis=0) > 0).all(), "each of the four is met"
    assert not np.any(kept & ((mask & Reason.DISOCCLUDED) != 0))


@pytest.mark.parametrize("reuse", [True, False])
def test_no_wrong_keeps_where_nothing_changes(gpu, reuse):
    """A still scene: with visibility reuse only what is visible is passed on; without it, also what is not."""
    frame, mask, *_ = played(gpu, SCENES["occluder"](), 3, SMALL | {"visibility_reuse": reuse})
    kept, wrong, rejected, _ = history_counts(frame, mask).sum(axis=0)
    assert kept > 100 and rejected == 0
    assert wrong == 0 if reuse else wrong > 10


def test_lights_that_are_born_or_gone(gpu):
    """Lamp 0 is off from frame 2 on, lamp 1 on: where either reaches, and which gives most, is that of float64."""
    frame, mask, _, moment, before = played(gpu, SCENES["born and killed"](), 3)
    now, then = (sample_scores.reaching(m) for m in (moment, before))
    np.testing.assert_array_equal(frame.has(Fact.BORN), now[1])
    np.testing.assert_array_equal(frame.has(Fact.GONE), then[0])
    np.testing.assert_array_equal(frame.born, np.where(now[1], 1, -1))
    expected = np.where(now[1], moment.reflected()[1] @ [0.2126, 0.7152, 0.0722], 0.0)
    np.testing.assert_allclose(frame.born_light, expected, rtol=1e-3, atol=1e-7)
    reason = frame.reasons(mask)
    assert now[1].any() and then[0].any()
    np.testing.assert_array_equal(reason[then[0]], list(REASONS).index("light_gone"))
    np.testing.assert_array_equal(reason[now[1] & ~then[0]], list(REASONS).index("light_born"))


def test_points_that_moved(gpu):
    """A still scene has none; a camera alone moves no point."""
    for scene in (SCENES["many lamps"](), lamps(camera_speed=12.0)):
        assert not played(gpu, scene, 2)[0].has(Fact.MOVED).any()


def made(history=None, kept=None, facts=0, born=-1, born_light=0.0, shape=(3, 4)) -> SampleFrame:
    """A frame of the same values in every pixel."""
    none = (-1.0, 0.0, 0.0, 0.0)
    samples = (np.broadcast_to(np.float32(none if s is None else s), (*shape, 4)) for s in (history, kept))
    plain = (np.full(shape, v) for v in (int(Fact.LIT) | int(facts), born, born_light))
    return SampleFrame(*samples, *plain, np.full((*shape, 3), [1, 2, 3], dtype=np.uint32))


@pytest.mark.parametrize(
    ("word", "facts", "name"),
    [
        (0, 0, "unchanged"),
        (Reason.OUTSIDE | Reason.DISOCCLUDED, 0, "off_screen"),
        (Reason.DISOCCLUDED | Reason.LIT, Fact.BORN, "disoccluded"),
        (Reason.NORMAL, Fact.GONE, "geometry"),
        (Reason.LIT, Fact.BORN | Fact.GONE, "light_gone"),
        (Reason.LIT, Fact.BORN | Fact.MOVED, "light_born"),
        (Reason.SHADOWED, Fact.MOVED, "moved"),
        (Reason.SHADOWED | Reason.DIRECT, 0, "darkened"),
        (Reason.LIT | Reason.DIRECT, 0, "brightened"),
        (Reason.INDIRECT, 0, "other_light"),
        (Reason.FIRST, Fact.BORN, None),
    ],
)
def test_reasons_are_disjoint_and_in_order(word, facts, name):
    index = -1 if name is None else list(REASONS).index(name)
    assert (made(facts=facts).reasons(np.full((3, 4), word, dtype=np.uint32)) == index).all()


def test_duplicates_equal_a_loop():
    rng = np.random.default_rng(3)
    samples = np.concatenate([rng.integers(-1, 3, (7, 9, 1)), rng.integers(0, 2, (7, 9, 2)), rng.random((7, 9, 1))], -1)
    assert duplicates(samples) == sample_scores.duplicates(samples, 2)
    assert duplicates(made(kept=(4, 0.5, 0.5, 1)).kept) == (57, 57)
    assert duplicates(made().kept) == (0, 0)


@pytest.mark.parametrize(("split", "p"), [((1, 0), 1.0), ((5, 0), 1 / 16), ((3, 3), 1.0), ((1, 7), 18 / 256)])
def test_sign_test(split, p):
    assert sign_test(*split) == pytest.approx(p)


def gray(values) -> np.ndarray:
    return np.repeat(np.asarray(values, dtype=np.float64)[..., None], 3, axis=-1)


def test_bias_and_correlation_of_made_images():
    """Six seeds of 0.5 plus noise of standard deviation 0.1 and bias 0.02, once equal in both frames."""
    shape, rng = (40, 50), np.random.default_rng(7)
    records = {"fresh": SampleRecord(1, 1.0), "held": SampleRecord(1, 1.0)}
    for _ in range(6):
        images = 0.52 + 0.1 * rng.standard_normal((3, *shape))
        for name, record in records.items():
            record.begin()
            for frame in range(3):
                image = images[frame if name == "fresh" else 0]
                record.add(made(shape=shape), gray(image), truth_of(gray(np.full(shape, 0.5)), frame))
    fresh, held = (record.summary() for record in records.values())
    assert fresh["bias"]["mean"] == pytest.approx(0.02, abs=4 * 0.1 / np.sqrt(6 * 2 * 2000))
    assert fresh["bias"]["percent"] == pytest.approx(200 * fresh["bias"]["mean"])
    assert fresh["bias"]["low"] < fresh["bias"]["mean"] < fresh["bias"]["high"]
    assert fresh["bias"]["brighter_seeds"] == fresh["bias"]["seeds"] == 6
    assert fresh["bias"]["sign_test_p"] == pytest.approx(2 / 64)
    share = 0.02**2 / (0.01 + 0.02**2)  # of squared errors that the bias explains
    assert fresh["pixel_correlation"] == pytest.approx(share, abs=0.02)
    assert fresh["frame_correlation"] == pytest.approx(share, abs=0.03) and held["frame_correlation"] == pytest.approx(
        1.0
    )
    assert fresh["per_pixel"] == {"shadow_rays": 1.0, "light_samples": 2.0, "evaluations": 3.0}
    assert fresh["history"] is None and fresh["born"] == {"pixels": 0, "found_percent": None, "frames": None}


def test_one_seed_has_no_interval():
    record = SampleRecord(1, 1.0)
    record.begin()
    for frame in range(2):
        record.add(made(), gray(np.zeros((3, 4))), truth_of(gray(np.ones((3, 4))), frame))
    out = record.summary()
    assert out["bias"]["low"] is None and out["bias"]["mean"] == pytest.approx(-1.0)


@pytest.mark.parametrize("light", [0.25, 0.1])
def test_frames_until_a_new_light_is_found(light):
    """Born in frame 1, found two frames later, never in the first row; half of all light counts, a fifth does not."""
    record, none = SampleRecord(1, 2.0), (0, 0.5, 0.5, 4)
    record.begin()
    expected = gray(np.ones((3, 4)))
    for number in range(5):
        frame = made(kept=none, born=7 if number == 1 else -1, born_light=light)
        if number >= 3:
            kept = frame.kept.copy()
            kept[1:, :, 0] = 7
            frame = SampleFrame(frame.history, kept, frame.facts, frame.born, frame.born_light, frame.counts)
        record.add(frame, expected, truth_of(expected, number))
    born = record.summary()["born"]
    found = {"pixels": 12, "found_percent": pytest.approx(100 * 8 / 12), "frames": 2.0}
    assert born == (found if light == 0.25 else {"pixels": 0, "found_percent": None, "frames": None})


def test_words_and_colors_of_a_reservoir():
    seen, hidden = (made(history=(7, 0.1, 0.2, 1), kept=(7, 0.1, 0.2, 20), facts=f)
                    for f in (Fact.KEPT_REACHES | Fact.HISTORY_REACHES, 0))  # fmt: skip
    assert "7" in seen.words(1, 2) and "20" in seen.words(1, 2) and seen.words(1, 2) != hidden.words(1, 2)
    assert light_colors(hidden).max() < light_colors(seen).max() and not light_colors(made()).any()
    assert len({tuple(outcome_colors(frame)[0, 0]) for frame in (seen, hidden, made())}) == 3


def test_an_evaluation_scores_them(gpu):
    """Rows of frames stay as they are; a method of shaded frames has no such block."""
    options = {"width": 16, "height": 12, "bounces": 1, "exposure": 1.0, "light": "auto", "frames": (0, 3)}
    maps = []
    done = evaluate_methods(
        SCENES["moving camera"](), ["none", "ris@candidates=2", "restir-di@candidates=2"], small_settings(**options),
        input="path-traced@1", reference="path-traced@16", metrics=("psnr",), seeds=2,
        on_frame=lambda frame: maps.append(dict(frame.maps)),
    )  # fmt: skip
    methods = done.summary["methods"]
    assert not done.failed and "samples" not in methods["none"]
    ris, restir = (methods[f"{name}@candidates=2"]["samples"] for name in ("ris", "restir-di"))
    assert ris["history"] is None and ris["repeated_percent"] is None and ris["duplicates_percent"] == 0.0
    assert 0.5 < ris["per_pixel"]["shadow_rays"] <= restir["per_pixel"]["shadow_rays"] <= 1.0
    assert ris["per_pixel"]["light_samples"] == restir["per_pixel"]["light_samples"] <= 2.0
    assert restir["history"]["all"]["kept"] == sum(e["kept"] for n, e in restir["history"].items() if n != "all") > 100
    assert restir["repeated_percent"] > 20.0 and restir["duplicates_percent"] > 1.0
    assert methods["none"]["error_parts"]["variance"]["mean"] > 0.0 and restir["bias"]["seeds"] == 2
    assert {name.rpartition(": ")[0] for name in maps[0]} == {"ris@candidates=2", "restir-di@candidates=2"}
    assert all(image.shape == (12, 16, 3) and 0.0 <= image.min() <= image.max() <= 1.0 for image in maps[2].values())
    json.dumps(done.summary, allow_nan=False)
    assert [table.number for table in reuse_tables(done.summary)][-4:] == [8, 9, 10, 12]
    plain = done.summary | {"methods": {"none": methods["none"]}}
    (merged,) = merged_summaries([("a", plain), ("b", done.summary)])
    assert [table.number for table in reuse_tables(merged)][-4:] == [8, 9, 10, 12]
