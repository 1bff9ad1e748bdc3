"""Table 4 at random pixels: with all pixels it is that of whole images; with some, the truth lies in its interval."""

from __future__ import annotations

import json

import numpy as np
import pytest

from taubench_gl.batch.spec import Job
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.features import COLUMNS
from taubench_gl.paper.pixels import PixelRun, random_pixels
from taubench_gl.paper.study import PaperOptions
from taubench_gl.paths import ASSETS
from taubench_gl.settings import Settings

DEMO = str(ASSETS / "demo.glb")
SIZE = (32, 18)
SETTINGS = Settings(width=SIZE[0], height=SIZE[1], frames=(18, 23), light="path-traced", spp=2, bounces=2, exposure=1.0)


def counted(folder, count, settings=SETTINGS):
    job = Job(f"demo-{count}", DEMO, settings, {})
    pairs = PixelRun(job, count, folder)
    for part in pairs.missing:
        pairs.count(part)
    return pairs.result()


@pytest.fixture(scope="module")
def whole():
    return evaluate_scene(DEMO, SETTINGS)


def test_all_pixels_give_the_rates_of_whole_images(whole, tmp_path):
    run = counted(tmp_path, 10_000)
    assert run.summary["sampling"]["pixels"] == SIZE[0] * SIZE[1]
    assert [row["frame"] for row in run.frames] == [row["frame"] for row in whole.frames]
    for name in COLUMNS:
        ours, expected = (s["discard"][name]["mean_percent"] for s in (run.summary, whole.summary))
        assert ours == pytest.approx(expected, abs=0.1), name  # float64 against shaders: pixels at a threshold
        assert run.summary["sampling"]["columns"][name]["half_width_points"] == 0.0
        curve, known = (
            (np.array(s["curves"][name]["at_or_above"]) for s in (run.summary, whole.summary))
            if name != "frustum"
            else (np.zeros(1), np.zeros(1))
        )
        assert np.abs(curve - known).max() <= 0.02 * len(run.frames) * SIZE[0] * SIZE[1]
    assert run.summary["discard"]["direct"]["mean_percent"] > 1.0


def test_some_pixels_give_an_interval_that_holds_the_rate(whole, tmp_path):
    run = counted(tmp_path, 100)
    for name, one in run.summary["sampling"]["columns"].items():
        expected = whole.summary["discard"][name]["mean_percent"]
        assert 0.0 < one["half_width_points"] < 5.0
        assert abs(one["mean_percent"] - expected) < 1.5 * one["half_width_points"] + 0.1, name
        assert run.summary["discard"][name]["mean_percent"] == pytest.approx(one["mean_percent"])


def test_counted_pairs_are_kept(tmp_path, monkeypatch):
    first = counted(tmp_path, 20)
    place = tmp_path / "demo-20"
    (place / "20.json").write_text("{")  # damaged: counted again
    job = Job("demo-20", DEMO, SETTINGS, {})
    pairs = PixelRun(job, 20, tmp_path)
    assert pairs.missing == [[20]] and pairs.total == 4 and len(pairs.seconds) == 3
    pairs.count([20])
    assert pairs.result().summary["discard"] == first.summary["discard"]
    values = json.loads((place / "21.json").read_text())
    (place / "21.json").write_text(json.dumps(values | {"scene": "another"}))
    assert PixelRun(job, 20, tmp_path).missing == [[21]]


def test_pixels_differ_between_pairs_and_none_is_twice():
    a, b = random_pixels(5, 400, (64, 36)), random_pixels(6, 400, (64, 36))
    assert len(np.unique(a, axis=0)) == len(a) == 400 and not np.array_equal(a, b)
    assert np.array_equal(a, random_pixels(5, 400, (64, 36)))
    assert a.max(axis=0).tolist() <= [63, 35] and np.abs(a.mean(axis=0) - (31.5, 17.5)).max() < 4.0
    assert len(random_pixels(5, 400, (6, 4))) == 24


@pytest.mark.parametrize(
    "options", [{"pixels": 100}, {"pixels": 1, "lights": ("path-traced",)},
                {"pixels": 100, "lights": ("path-traced",), "lobes": ("diffuse",)}],
)  # fmt: skip
def test_pixels_are_of_path_traced_light(options):
    with pytest.raises(SettingsError):
        PaperOptions(**options)
