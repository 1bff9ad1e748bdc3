"""Settings that trade accuracy for time: each against a law, or against another way to the same number."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import taubench_gl as tb
from taubench_gl.animation import choose_camera
from taubench_gl.animation.jitter import grid_offsets
from taubench_gl.conventions import histogram_bins
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import evaluate_scene, frame_schedule, sampled_pairs
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.metrics.counts import bin_of, edges
from taubench_gl.pathtraced.evaluation import evaluate_path_traced
from taubench_gl.run_schema import COUNT_COLUMNS
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

GEOMETRY = Settings(width=48, height=28, frames=(20, 29), columns=("frustum", "position", "normal"))
LIT = Settings(width=32, height=18, frames=(20, 22), indirect="none")


@pytest.fixture(scope="module")
def full(demo):
    return evaluate_scene(demo, GEOMETRY)


@pytest.mark.parametrize("pairs", ["every:3", "strata:2"])
def test_sampled_pairs_equal_those_of_the_full_run(demo, full, pairs):
    run = evaluate_scene(demo, GEOMETRY.replace(pairs=pairs))
    whole = {row["frame"]: row for row in full.frames}
    assert 0 < len(run.frames) < len(full.frames)
    for row in run.frames:
        assert {c: row[c] for c in COUNT_COLUMNS} == {c: whole[row["frame"]][c] for c in COUNT_COLUMNS}
        assert row["angle_deg"] == whole[row["frame"]]["angle_deg"]
    assert run.summary["camera"]["angle"] == full.summary["camera"]["angle"]  # that of all frames
    sampling = run.summary["sampling"]
    assert (sampling["drawn"], sampling["total"]) == (len(run.frames), len(full.frames))
    for column in ("position", "normal"):
        difference = run.summary["discard"][column]["mean_percent"] - full.summary["discard"][column]["mean_percent"]
        assert abs(difference) <= sampling["columns"][column]["half_width_points"]


def test_schedule_draws_the_history_of_every_sampled_pair():
    frames = range(100, 150)
    for pairs in ("all", "every:7", "strata:5"):
        settings = Settings(pairs=pairs)
        sample, schedule = sampled_pairs(frames, settings), frame_schedule(frames, settings)
        assert [f for f, evaluated in schedule if evaluated] == [frames[p + 1] for p in sample.positions]
        for i, (frame, evaluated) in enumerate(schedule):
            assert not evaluated or schedule[i - 1][0] == frame - 1
        assert len({f for f, _ in schedule}) == len(schedule)


def test_samples_per_pixel_are_sums_of_jittered_runs(demo):
    """Four samples are four runs with the camera shifted by fixed sub-pixel offsets."""

    class Shifted:
        def __init__(self, track, offset):
            self.track, self.offset, self.name = track, offset, track.name

        def describe(self):
            return self.track.describe()

        def view_at(self, state):
            return dataclasses.replace(self.track.view_at(state), jitter_px=self.offset)

    scene = load_scene(demo)
    short = GEOMETRY.replace(frames=(20, 23))
    many = evaluate_scene(scene, short.replace(samples_per_pixel=4))
    single = [evaluate_scene(scene, short, camera=Shifted(choose_camera(scene), offset)) for offset in grid_offsets(4)]
    for i, row in enumerate(many.frames):
        for column in COUNT_COLUMNS:
            if row[column] is not None:
                assert row[column] == sum(run.frames[i][column] for run in single), column
    assert many.frames[0]["pixels"] == 4 * 48 * 28
    assert len({run.frames[0]["position"] for run in single}) > 1, "the four offsets must not all give the same count"


def test_half_storage_rounds_float_storage(demo, gpu):
    scene = load_scene(demo)
    held = {}
    for storage in ("float", "half"):
        settings = LIT.replace(storage=storage)
        source = RasterSource(gpu, AnimatedScene(scene), settings)
        source.advance(20)
        held[storage] = {name: source.read(name) for name in ("position", "normal")}
        bits = {name: t.dtype for name, t in source.current.items()}
        assert {bits[n] for n in ("position", "normal", "direct", "color")} == {"f2" if storage == "half" else "f4"}
        sizes = source.renderer.history.bytes
        held[storage]["bytes"] = sizes
        source.release()
    for name in ("position", "normal"):
        full, half = held["float"][name], held["half"][name]
        assert half.dtype == np.float16
        # One step of a half float: drivers round or truncate.
        step = np.spacing(np.abs(full).astype(np.float16)).astype(np.float64)
        assert np.all(np.abs(full - half.astype(np.float64)) <= step)
        assert np.any(full != half)
    assert held["half"]["bytes"] < held["float"]["bytes"]


@pytest.mark.parametrize("bits", [0, 2, 8])
def test_bins_and_edges_agree(bits):
    lower = edges(bits)
    assert len(lower) == histogram_bins(bits) - 1
    assert np.array_equal(bin_of(lower, bits), np.arange(1, len(lower) + 1))
    below = np.nextafter(lower.astype(np.float32), np.float32(0))
    assert np.array_equal(bin_of(below, bits), np.arange(len(lower)))


@pytest.mark.parametrize(
    "wrong",
    [
        {"pairs": "every:0"}, {"pairs": "some"}, {"pairs": "strata:"}, {"storage": "double"},
        {"samples_per_pixel": 0}, {"samples_per_pixel": 65},
    ],
)  # fmt: skip
def test_invalid_values_are_refused(wrong):
    with pytest.raises(SettingsError):
        Settings(**wrong)


def test_path_traced_files_take_no_render_settings(tmp_path):
    for wrong in ({"pairs": "every:2"}, {"samples_per_pixel": 4}):
        with pytest.raises(SettingsError):
            evaluate_path_traced(f"exr:{tmp_path}", Settings(**wrong))
    assert tb.Settings().metrics.all_pairs
