"""Light columns at sampled pixels: decided pixels, rounds, and what a run says of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings
from lamp_scenes import lamp_over_floor

from taubench_gl.batch.spec import BatchSpec, Job
from taubench_gl.batch.study import BatchStudy, batch_store
from taubench_gl.conventions import NOT_COMPARABLE
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import Readback, evaluate_scene, open_session, sampled_light
from taubench_gl.evaluation.brightness import Brightness
from taubench_gl.evaluation.decided_pixels import DecidedPixels, PreviewPair, read_preview
from taubench_gl.evaluation.sampled_light import RoundSizes, round_of
from taubench_gl.features import FEATURE_BIT
from taubench_gl.metrics.sampled_light import Visit
from taubench_gl.run import load_run

DEMO = Path(__file__).resolve().parents[2] / "assets" / "demo.glb"
SMALL = {"width": 32, "height": 18, "light": "auto"}
DEMO_SETTINGS = {"width": 48, "height": 27, "frames": (20, 24), "light": "auto", "shadow_size": 64, "probes": 32}
ALL = RoundSizes(pairs=4, pixels=10**6, limit=128, samples=1 << 40)


def opened(scene, **settings):
    chosen = fixed_settings(**({"fps": 24.0, "frames": (0, 3), "spp": 1} | SMALL | settings))
    return open_session(scene, chosen, Readback(images=True, distances=True, channels=("emission",)), sampled=True)


def decided(session, frame, limit, columns=("direct", "indirect", "color")):
    """The preview of a pair, its pixels (n, 2) that light decides, and their decisions."""
    with session.gpu:
        session.evaluator.restart()
        session.evaluator.step(frame - 1, False)
        session.evaluator.step(frame)
        pair = read_preview(session.source, session.evaluator, frame, columns)
        pixels = DecidedPixels(session.variant, session.settings, columns)
        pixels.draw(pair)
        rows, across = np.nonzero(pair.traced)
        at = np.stack([across, rows], axis=-1)
        return pair, at, pixels.decide(at, limit, np.random.default_rng(1).random(len(at)), halves=True)


@pytest.mark.parametrize("emits", [0.0, 40.0])
def test_a_still_pair_has_distances_of_zero(emits):
    """A surface point has the same numbers in both frames, so noise is no change."""
    with opened(lamp_over_floor(moves=False, emits=emits), camera=0, light_unit="candela") as session:
        _, at, found = decided(session, 1, 128)
    assert len(at) > 100
    for name, distance in found.end.distances.items():
        assert not distance.any(), name


def test_decisions_are_those_of_many_more_samples():
    with opened(lamp_over_floor(emits=2.0), width=24, height=14) as session:
        _, _, few = decided(session, 1, 512)
        _, _, many = decided(session, 1, 2048)
    bits = np.uint32(sum(FEATURE_BIT[n] for n in ("direct", "indirect", "color")))
    clear = ~few.undecided
    assert clear.mean() > 0.8
    assert np.mean(((few.end.words ^ many.end.words) & bits)[clear] != 0) < 0.01
    assert (many.samples >= few.samples).all() and (few.samples[few.undecided] == 512).all()


def test_only_pixels_that_light_decides_are_traced():
    with opened(DEMO, width=64, height=36, frames=(29, 31)) as session:
        pair, _, _ = decided(session, 30, 64)
    assert 0.5 < pair.traced.mean() < 1.0
    assert not (pair.words[pair.traced] & NOT_COMPARABLE).any()


@pytest.mark.long
def test_all_pixels_of_all_pairs_give_the_share_without_an_error(monkeypatch):
    monkeypatch.setattr(sampled_light, "ROUND_SIZES", ALL)
    scene = lamp_over_floor(emits=40.0)
    with opened(scene) as session:
        shares = []
        for frame in (1, 2):
            _, _, found = decided(session, frame, ALL.limit)
            bit = np.uint32(FEATURE_BIT["indirect"])
            first, end, halves = ((w & bit) != 0 for w in (found.first.words, found.end.words, found.end.half_words))
            # Twice the indicator less its mean over halves of the samples: without a bias of the first order.
            shares.append(np.where(found.undecided, 2.0 * end - halves.mean(axis=-1), first).sum() / (32 * 18))
    monkeypatch.setattr("taubench_gl.evaluation.decided_pixels.AUDITED", (0.0, 0.0))
    settings = fixed_settings(frames=(0, 3), spp=1, **SMALL)
    entry = evaluate_scene(scene, settings, sampled=True).summary["discard"]["indirect"]
    assert entry["mean_percent"] == pytest.approx(100 * np.mean(shares), abs=1e-9)
    assert entry["interval95_percent"] == pytest.approx([entry["mean_percent"]] * 2, abs=1e-6)
    assert entry["method"] == "sampled" and entry["pixels"] > 500


def test_emitters_are_seen_by_the_estimate_and_not_by_raster_light():
    settings = fixed_settings(frames=(0, 2), **SMALL | {"light_within": 2.5})
    scene = lamp_over_floor(emits=40.0)
    truth = evaluate_scene(scene, settings.replace(light="path-traced", spp=1024)).summary["discard"]["direct"]
    entry = evaluate_scene(scene, settings, sampled=True).summary["discard"]["direct"]
    low, high = entry["interval95_percent"]
    assert low - 1.0 < truth["mean_percent"] < high + 1.0 and truth["mean_percent"] > 5.0
    assert high - low <= 2.0 * settings.lighting.light_within + 1e-9


def test_a_run_says_what_is_sampled_and_keeps_the_rest(monkeypatch, tmp_path):
    monkeypatch.setattr(sampled_light, "ROUND_SIZES", RoundSizes(pairs=2, pixels=24, limit=64))
    settings = fixed_settings(**DEMO_SETTINGS, light_within=16.0)
    plain = evaluate_scene(DEMO, settings)
    evaluate_scene(DEMO, settings, out=tmp_path / "run", sampled=True)
    run = load_run(tmp_path / "run")  # which checks it
    summary, discard = run.summary, run.summary["discard"]
    for name, entry in discard.items():
        before = plain.summary["discard"][name]
        if name in ("direct", "indirect", "color"):
            low, high = entry["interval95_percent"]
            assert low <= entry["mean_percent"] <= high and entry["preview_percent"] == before["mean_percent"]
            assert entry["max_percent"] is None
        else:
            assert entry == before
    shading, reasons = summary["reusable"]["shading"], summary["reusable"]["reasons"]
    total = shading["mean_percent"] + sum(entry["mean_percent"] for entry in reasons.values())
    assert total == pytest.approx(100.0, abs=1e-9)
    assert summary["reusable"]["surface"] == plain.summary["reusable"]["surface"]
    visited = [row for row in run.frames if row["sampled"]]
    assert len(visited) == summary["sampled_light"]["pairs"] <= len(run.frames)
    assert sum(row["sampled"] for row in visited) == summary["sampled_light"]["pixels"]
    assert [{k: v for k, v in row.items() if not k.startswith("sampled")} for row in run.frames] == plain.frames


def test_lobes_are_sampled_too(monkeypatch):
    """A diffuse floor: its diffuse lobe changes as all of its light does, whatever the preview says."""
    monkeypatch.setattr(sampled_light, "ROUND_SIZES", ALL)
    settings = fixed_settings(frames=(0, 3), spp=1, **SMALL | {"width": 16, "height": 9})
    summary = evaluate_scene(lamp_over_floor(), settings, sampled=True, lobes=("diffuse", "volume")).summary
    lobe, whole = summary["lobes"]["diffuse"]["direct"], summary["discard"]["direct"]
    assert lobe["method"] == "sampled" and lobe["mean_percent"] == pytest.approx(whole["mean_percent"], abs=1.0)
    assert lobe["interval95_percent"][0] <= lobe["mean_percent"] <= lobe["interval95_percent"][1]
    assert summary["lobes"]["volume"]["direct"]["mean_percent"] is None


def test_a_run_within_its_budget_ends(monkeypatch):
    monkeypatch.setattr(sampled_light, "ROUND_SIZES", RoundSizes(pairs=2, pixels=8, limit=64, samples=20000))
    settings = fixed_settings(**DEMO_SETTINGS, light_within=1e-3)
    summary = evaluate_scene(DEMO, settings, sampled=True).summary["sampled_light"]
    assert not summary["narrow"] and summary["rounds"] > 1
    assert 20000 <= summary["samples"] < 20000 + 2 * 2 * 64 * (16 + 20)


def test_a_time_takes_the_place_of_the_number_of_samples(monkeypatch):
    """Rounds go on after the samples of a run without a time, until the intervals are narrow."""
    monkeypatch.setattr(sampled_light, "ROUND_SIZES", RoundSizes(pairs=2, pixels=8, limit=64, samples=1))
    settings = fixed_settings(**DEMO_SETTINGS | {"width": 32, "height": 18}, light_within=20.0)
    one, many = (
        evaluate_scene(DEMO, settings.replace(light_time=t), sampled=True).summary["sampled_light"]
        for t in (None, 1000.0)
    )
    assert one["rounds"] == 1 and not one["narrow"]
    assert many["rounds"] > 1 and many["narrow"]


def test_a_batch_refuses_a_time_of_light(tmp_path):
    job = Job("demo", str(DEMO), fixed_settings(light_time=5.0), {})
    with pytest.raises(SettingsError) as caught:
        BatchStudy(BatchSpec("timed", (job,)), batch_store(tmp_path))
    assert caught.value.setting == "light_time"


def test_noise_of_images_is_noted_only_where_columns_are_of_images():
    noisy = Brightness(frames=1, pixels=100, noisy=50)
    settings = fixed_settings(exposure=1.0)
    assert len(noisy.notes(settings)) == 1 and noisy.notes(settings, of_images=False) == []


def test_rounds_visit_other_pairs_until_all_had_a_visit():
    visits = [visit for number in range(6) for visit in round_of(number, 20, seed=0)]
    assert len(set(visits)) == len(visits) == 48
    assert {row for row, _ in visits[:20]} == set(range(20)) and {number for _, number in visits[:20]} == {0}
    assert visits[:8] != [visit for visit in round_of(0, 20, seed=1)]
    assert round_of(3, 2, seed=0)[0][1] == 3


def test_kept_previews_are_those_that_visits_draw(monkeypatch):
    monkeypatch.setattr(sampled_light, "ROUND_SIZES", RoundSizes(pairs=2, pixels=8, limit=64, samples=1000))
    settings = fixed_settings(**DEMO_SETTINGS)
    kept = evaluate_scene(DEMO, settings, sampled=True)
    monkeypatch.setattr(sampled_light.Previews, "keep", lambda *_: None)
    drawn = evaluate_scene(DEMO, settings, sampled=True)
    assert kept.summary["sampled_light"]["pairs"] == 3
    for block in ("discard", "reusable", "sampled_light"):
        assert kept.summary[block] == drawn.summary[block]


def test_reprojections_differ_where_a_pixel_has_another_history():
    """Not by what float32 makes of one place, unless it lies on the edge of two pixels."""
    at = np.array([[[3.2, 4.1], [3.2, 4.1], [3.49999, 4.1], [3.2, 4.1]]])
    other = at + np.array([[[2e-5, 0.0], [2e-3, 0.0], [2e-5, 0.0], [0.0, 0.0]]])
    words, surface = np.array([[0, 0, 0, 0]], np.uint32), np.full((1, 4), True)
    first, second = (PreviewPair(1, words, {}, a, (surface, surface), None, None) for a in (at, other))
    assert first.differs(second).tolist() == [[False, True, True, False]]


def test_records_of_visits_keep_every_bit():
    rng = np.random.default_rng(3)
    n = 5
    curves, discarded = {"direct": rng.random((3, 4))}, {"direct": rng.random()}
    difference = rng.random((n, 3))
    visit = Visit(3, rng.integers(0, 9, 16), rng.integers(0, 16, n), difference, curves, discarded, 1, 2, 1, 512)
    again = Visit.of_record(json.loads(json.dumps(visit.record())))
    for name in Visit.__slots__:
        a, b = (of["direct"] if isinstance(of, dict) else of for of in (getattr(visit, name), getattr(again, name)))
        assert np.array_equal(a, b) and np.asarray(a).dtype == np.asarray(b).dtype
