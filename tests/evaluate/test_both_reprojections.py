"""Both reprojections of one run: a closed form, two runs, path-traced light, and the same numbers in every place."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.evaluation import evaluate_scene, sampled_light
from taubench_gl.evaluation.sampled_light import RoundSizes
from taubench_gl.metrics.reuse_rate import RATES
from taubench_gl.paths import PACKAGE
from taubench_gl.report import run_tables
from taubench_gl.report.reusable import headline, percent_text
from taubench_gl.report.run_page import ReportRun, report_html
from taubench_gl.run import Run, not_reusable
from taubench_gl.scene.builder import SceneBuilder, quad
from taubench_gl.scene.model import Scene

pytestmark = pytest.mark.usefixtures("coarse_light")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
OTHER = {"camera": "motion", "motion": "camera"}
GEOMETRY = ("frustum", "position", "normal")
WIDTH, HEIGHT, PLATE, STEP = 96, 64, (20, 16), 3  # pixels; STEP: per frame


def plate_before_wall(moves: bool = True, wall: bool = True) -> Scene:
    """A plate of PLATE pixels that moves by STEP pixels to the right per frame, parallel to the wall behind it."""
    builder, meter = SceneBuilder(), 4.0 / HEIGHT  # of a pixel at the distance of the plate
    builder.camera(yfov=2.0 * math.atan(0.5))
    if wall:
        builder.node(mesh=builder.mesh(quad(40.0, 40.0)), translation=(0.0, 0.0, -8.0))
    sides = (0.5 * meter * side for side in PLATE)
    plate = builder.node(mesh=builder.mesh(quad(*sides)), translation=(-1.0, 0.0, -4.0))
    if moves:
        end = (-1.0 + 24 * STEP * meter, 0.0, -4.0)
        builder.animate(plate, "translation", (0.0, 1.0), [(-1.0, 0.0, -4.0), end])
    return builder.build()


def evaluated(scene: Scene | Path, sampled: bool = False, **settings) -> Run:
    chosen = {"width": WIDTH, "height": HEIGHT, "frames": (0, 5), "columns": GEOMETRY} | settings
    return evaluate_scene(scene, fixed_settings(**chosen), sampled=sampled)


@pytest.mark.parametrize("chosen", OTHER)
@pytest.mark.parametrize("sampling", ["nearest", "bilinear"])
def test_with_motion_vectors_all_but_the_disocclusion_is_reusable(chosen, sampling):
    """Camera reprojection also discards what the plate newly covers; inside, it stays in its own plane."""
    run, strip = evaluated(plate_before_wall(), reprojection=chosen, sampling=sampling), STEP * PLATE[1]
    reusable = {"camera": WIDTH * HEIGHT - 2 * strip, "motion": WIDTH * HEIGHT - strip}
    for row in run.frames:
        assert (row["reusable_surface"], row["other_reusable_surface"]) == (reusable[chosen], reusable[OTHER[chosen]])
        assert row["other_reusable_shading"] is None
    for mode, pixels in reusable.items():
        assert run.summary["reusable"][mode]["surface"]["mean_percent"] == 100.0 * pixels / (WIDTH * HEIGHT)


@pytest.mark.parametrize("changes", [
    {}, {"sampling": "bilinear"}, {"samples_per_pixel": 4}, {"storage": "half"}, {"pairs": "strata:2"},
    {"columns": (*GEOMETRY, "direct", "indirect", "color"), "light": "raster"},
])  # fmt: skip
def test_one_run_has_the_numbers_of_two(changes):
    """Exact columns: bit for bit, means and pairs."""
    runs = {mode: evaluated(DEMO, reprojection=mode, frames=(8, 16), **changes) for mode in OTHER}
    moving = 0
    for mode, other in OTHER.items():
        block, alone = runs[mode].summary["reusable"], runs[other].summary["reusable"]
        assert block[mode] == {rate: block[rate] for rate in RATES}
        assert block[other] == {rate: alone[rate] for rate in RATES}
        for row, expected in zip(runs[mode].frames, runs[other].frames, strict=True):
            for rate in RATES:
                assert row[f"other_reusable_{rate}"] == expected[f"reusable_{rate}"]
            moving += row["other_reusable_surface"] != row["reusable_surface"]
    assert moving


def test_what_does_not_move_is_equal_and_what_was_not_counted_is_null():
    still = evaluated(plate_before_wall(moves=False))
    eyes = {history: evaluated(plate_before_wall(), history=history, eyes=0.1) for history in ("eye", "both")}
    for run in (still, eyes["eye"]):  # both eyes see the scene at the same time
        assert run.summary["reusable"]["motion"] == run.summary["reusable"]["camera"]
        assert all(row["other_reusable_surface"] == row["reusable_surface"] for row in run.frames)
        assert "motion" not in headline(run.summary)
    assert eyes["both"].summary["reusable"]["motion"]["surface"]["mean_percent"] is None
    assert eyes["both"].summary["reusable"]["motion"]["surface"]["reason"]
    assert eyes["both"].frames[0]["other_reusable_surface"] is None


LIT = {"columns": (*GEOMETRY, "direct", "indirect"), "width": 32, "height": 18, "frames": (20, 23)}


def test_sampled_light_of_both_agrees_with_a_run_of_each(monkeypatch):
    """Both draw the same pixels with the same random numbers, so that they differ by far less than their intervals."""
    monkeypatch.setattr(sampled_light, "ROUND_SIZES", RoundSizes(pairs=2, pixels=96, limit=64, samples=15_000))
    runs = {mode: evaluated(DEMO, True, reprojection=mode, light="auto", **LIT) for mode in OTHER}
    for mode, other in OTHER.items():
        entry = runs[mode].summary["reusable"][other]["shading"]
        alone = runs[other].summary["reusable"]["shading"]
        halves = [np.subtract(*of["interval95_percent"][::-1]) / 2 for of in (entry, alone)]
        assert entry["method"] == "sampled" and entry["preview_percent"] == alone["preview_percent"]
        assert abs(entry["mean_percent"] - alone["mean_percent"]) < 0.2
        assert 0.0 < halves[0] < 15.0
        assert runs[mode].summary["reusable"][mode]["shading"] == runs[mode].summary["reusable"]["shading"]


@pytest.mark.parametrize("decided", [False, True])
def test_path_traced_light_of_both_agrees_with_a_run_of_each(decided, monkeypatch):
    """Images: exactly.  Decided pixels have floors of errors of other lists, so that undecided ones can differ."""
    monkeypatch.setattr("taubench_gl.evaluation.decided_light.LIMIT", 256)
    small = LIT | {"width": 16, "height": 9, "frames": (20, 22), "spp": None if decided else 16}
    runs = {mode: evaluated(DEMO, decided, reprojection=mode, light="path-traced", **small) for mode in OTHER}
    for mode, other in OTHER.items():
        for row, alone in zip(runs[mode].frames, runs[other].frames, strict=True):
            assert row["other_reusable_surface"] == alone["reusable_surface"]
            assert abs(row["other_reusable_shading"] - alone["reusable_shading"]) <= alone.get("undecided", 0)


def test_every_place_has_the_same_numbers(tmp_path):
    settings = fixed_settings(width=WIDTH, height=HEIGHT, frames=(8, 12), columns=GEOMETRY)
    run = evaluate_scene(DEMO, settings, out=tmp_path)
    with (tmp_path / "frames.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    surface = sum(int(row["pixels"]) - int(row["sky"]) for row in rows)
    text, page = headline(run.summary), report_html([ReportRun(run.summary, run.frames)])
    table = {(row.values[0], row.label.split(", ")[-1]): row.values[1] for row in run_tables([run.summary])[0].rows}
    for mode, column in (("camera", "reusable_surface"), ("motion", "other_reusable_surface")):
        percent = run.summary["reusable"][mode]["surface"]["mean_percent"]
        assert percent == 100.0 * sum(int(row[column]) for row in rows) / surface == table[mode, "surface"]
        assert f"{mode} " in text and percent_text(percent) in text
    assert text[1:] in page


def test_table_4_has_shares_of_surface_pixels_where_the_sky_is_large():
    """Only the plate is a surface; camera reprojection discards its newly covered strip."""
    run = evaluated(plate_before_wall(wall=False))
    expected = 100.0 * STEP / PLATE[0]
    assert run.summary["discard"]["position"]["of_surface_percent"] == expected
    table = next(table for table in run_tables([run.summary], paper=False) if table.number == 4)
    assert [row.values[2] for row in table.rows if "surface" in row.label] == [expected]
    table = next(table for table in run_tables([evaluated(plate_before_wall()).summary]) if table.number == 4)
    assert not [row for row in table.rows if "surface" in row.label]


def test_the_worst_frame_has_the_lowest_reuse_rate():
    """Not the most discards: those count sky, and a pixel once for each column."""
    row = {"pixels": 100, "sky": 50, "reusable_surface": 40, "reusable_shading": 30, "position": 10, "normal": 5}
    assert not_reusable(row) == pytest.approx(1.0 - 30 / 50)
    assert not_reusable(row | {"reusable_shading": None}) == pytest.approx(1.0 - 40 / 50)
    assert not_reusable(row | {"sky": 100, "reusable_shading": 0}) == 0.0
    assert not_reusable({"pixels": 100, "position": 10, "normal": None}) == pytest.approx(0.1)
