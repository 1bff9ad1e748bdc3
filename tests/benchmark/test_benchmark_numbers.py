"""Suites, speeds and rankings: closed forms, no rendering."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from repeated import few

import taubench_gl.benchmark.suite as benchmark_suite
from taubench_gl.animation import FileCamera, Poser, camera_of_run
from taubench_gl.benchmark.merge import tracks_of
from taubench_gl.benchmark.scenes import scene_file
from taubench_gl.benchmark.scores import (
    ALWAYS,
    CROSSES,
    NEVER,
    CaseValues,
    by_seed,
    crossing_of,
    first_zero,
    over_cases,
    ranked,
    speed_curves,
)
from taubench_gl.benchmark.suite import BUILTIN, read_suite
from taubench_gl.datasets.stress import CAMERA_NAME
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import frame_range
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.usefixtures("coarse_metering", "coarse_space")

HEAD = 'schema = "suite/1"\nname = "t"\nsize = "48x27"\nframes = 4\n'
CASE = '[[cases]]\nscene = "demo"\ntrack = "noisy"\ninput = "noisy"\n'


def suite_of(folder, text):
    path = folder / "suite.toml"
    path.write_text(text)
    return read_suite(path)


@pytest.mark.parametrize("name", BUILTIN)
def test_built_in_suites_are_valid(name):
    suite = read_suite(name)
    assert {case.series for case in suite.cases} >= {"rotation", "translation", "light_speed", "object_speed", "cut"}
    assert {"eternal-valley-fps", "eternal-valley-vr", "demo"} <= {case.scene.source for case in suite.cases}
    assert any(case.kind.path_samples for case in suite.cases) and any(case.kind.upscale > 1 for case in suite.cases)


def test_quick_keeps_its_limits():
    for case in read_suite("quick").cases:
        request = case.request
        assert np.prod(case.size) * case.evaluated_frames <= 160 * 90 * 8 and request.reference_samples <= 256
        assert request.reference == "max" or int(request.reference.partition("@")[2]) <= 256


FAULTS = {
    "no cases": HEAD,
    "schema": HEAD.replace("suite/1", "suite/2") + CASE,
    "no track": HEAD + CASE.replace('track = "noisy"\n', ""),
    "scene": HEAD + CASE.replace("demo", "missing.glb"),
    "input": HEAD + CASE.replace('"noisy"\n', '"fog"\n'),
    "seeds without noise": HEAD + CASE.replace('input = "noisy"', 'input = "jittered"') + "seeds = 2\n",
    "one frame": HEAD + CASE + "frames = 1\n",
    "twice": HEAD + CASE + CASE,
    "syntax": "size = [",
}
FAULTS |= {
    line.strip(): f"{HEAD}{CASE}{line}\n"
    for line in (
        "speed = 1", "rotation = [0, 1]\ncut = [2]", "rotation = [1, 0]", "rotation = [-1]", "rotation = []",
        "rotation = [1]\nfirst = 3", "still = true", "cut = [2]\nstill = true", "exposure = 0.0", "bounces = 0",
        'light = "raster"', 'reference = "path-traced"',
    )
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_a_suite(tmp_path, fault):
    with pytest.raises(SettingsError):
        suite_of(tmp_path, FAULTS[fault])


@pytest.mark.parametrize("still", few([True, False]))
def test_only_the_camera_of_a_still_series_moves(tmp_path, still):
    """The camera's yaw changes by exactly the speed; without ``still``, the scene's own nodes move too."""
    for case in suite_of(tmp_path, HEAD + CASE + f"rotation = [0, 6]\nstill = {still}\n".lower()).cases:
        scene = load_scene(scene_file(case.scene))
        camera = camera_of_run(scene, case.settings.sequence)
        assert isinstance(camera, FileCamera) and case.settings.sequence.camera == CAMERA_NAME
        assert len(frame_range(scene, camera, case.settings)) == case.frames
        times = [frame / case.settings.sequence.fps for frame in range(case.frames)]
        states = [Poser(scene).sample(time) for time in times]
        own = [node for node in (*scene.mesh_nodes, *scene.light_nodes) if node != camera.node]
        moves = max(np.abs(state.world[own] - states[0].world[own]).max() for state in states)
        assert (moves == 0.0) == still
        turned = [state.world[camera.node][:3, :3] for state in states]
        cosines = [(np.trace(a.T @ b) - 1.0) / 2.0 for a, b in pairwise(turned)]
        assert np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))) == pytest.approx(case.value, abs=2e-2)


def test_a_part_of_a_suite_is_another_suite(tmp_path):
    suite = suite_of(tmp_path, HEAD + CASE + "rotation = [0, 1]\n" + CASE + "translation = [0.5, 1]\n")
    part = suite.part(["demo/rotation=*", "*=0.5/*"])
    assert [case.id for case in part.cases] == [suite.cases[i].id for i in (0, 1, 2)]
    assert part.cases == suite.cases[:3] and part.describe()["cases"] == 3
    assert len({suite.sha256, part.sha256, suite.part(["demo/rotation=*"]).sha256}) == 3
    assert suite.part([]) is suite and suite.part(["*"]) is suite
    for patterns in (["x"], ["*", "demo"]):
        with pytest.raises(SettingsError):
            suite.part(patterns)


def test_the_identity_of_a_case_is_what_is_evaluated(tmp_path):
    suite = suite_of(tmp_path, HEAD + CASE + "rotation = [0, 1]\n" + CASE + "translation = [0, 1]\n")
    still, _, still_too, _ = suite.cases
    same = replace(still, id="x", track="y", series=None, value=None)
    own, longer = still.identity("a" * 64), replace(still, request=replace(still.request, seeds=2))
    assert {case.identity("a" * 64) for case in (still_too, same)} == {own}
    assert len({own, still.identity("b" * 64), longer.identity("a" * 64)}) == 3


def test_settings_and_options_are_keys_of_tables_and_suites(tmp_path, monkeypatch):
    """One of a table is before that of the suite; what is not the default is part of the hash."""
    more = "bounces = 2\nthresholds = { normal = 0.25 }\nwarmup = 2\n"
    plain, own = (suite_of(tmp_path, HEAD + text).cases for text in (CASE + CASE.replace("noisy", "full"), more + CASE))
    (twice,) = suite_of(tmp_path, HEAD + more + CASE + 'bounces = 3\nsize = "64x36"\n').cases
    default = suite_of(tmp_path, f"{HEAD}bounces = {plain[0].settings.lighting.bounces}\n{CASE}").cases[0]
    assert default.identity("a") == plain[0].identity("a")
    assert own[0].settings.lighting.bounces == 2 and own[0].request.warmup == 2
    assert own[0].settings.metrics.thresholds["normal"] == 0.25
    assert twice.settings.lighting.bounces == 3 and twice.size == (64, 36)
    assert len({case.identity("a") for case in (*plain, *own, twice)}) == 4
    before, values = plain[0].identity("a"), benchmark_suite._values
    monkeypatch.setattr(benchmark_suite, "_values", lambda *given: values(*given) | {"new key": 1})
    assert plain[0].identity("a") == before  # stored results stay those of the case


def test_equal_cases_of_two_series_count_once(tmp_path):
    suite = suite_of(tmp_path, HEAD + CASE + "rotation = [0, 1]\n" + CASE + "translation = [0, 1]\n")
    scenes = {case.scene: "still" if case.value == 0 else case.series for case in suite.cases}
    assert tracks_of(suite, scenes) == {"noisy": [suite.cases[0], suite.cases[1], suite.cases[3]]}


def test_cuts_of_a_series_lie_within_the_frames(tmp_path):
    suite = suite_of(tmp_path, HEAD.replace("= 4", "= 7") + CASE + "first = 10\ncut = [0, 3, 9]\n")
    assert [case.request.cuts for case in suite.cases] == [(), (13, 16), ()]


# ---------------------------------------------------------------------------------------------------------- speeds
def test_first_zero_of_a_line():
    for gains, zero in {
        (1, 1, 1): None, (0, 1, 1): 0.0, (-1, 1, 1): 0.0, (3, -1, 1): 1.5, (1, 1, -3): 2.5, (1, 0, 1): 2.0,
    }.items():  # fmt: skip
        assert first_zero((0.0, 2.0, 4.0), gains) == zero


def steps(gains, width):
    return [{"value": float(v), "gain": g, "low": g - width, "high": g + width} for v, g in enumerate(gains)]


def test_a_crossing_lies_within_its_interval():
    found = crossing_of(steps((2.0, 1.0, -1.0, -2.0), 0.5))
    assert found["verdict"] == CROSSES and found["speed"] == pytest.approx(1.5)
    assert found["low"] == pytest.approx(1.25) and found["high"] == pytest.approx(1.75)


def test_methods_that_never_or_always_are_better_and_steps_without_intervals():
    never, always = crossing_of(steps((-1.0, 1.0), 0.1)), crossing_of(steps((3.0, 1.0), 2.0))
    assert (never["verdict"], never["speed"], never["low"], never["high"]) == (NEVER, None, 0.0, 0.0)
    assert (always["verdict"], always["speed"], always["high"]) == (ALWAYS, None, None)
    assert always["low"] == pytest.approx(0.5)  # 1 at 0 to -1 at 1
    found = crossing_of([step | {"low": None, "high": None} for step in steps((1.0, -1.0), 0.0)])
    assert found["speed"] == pytest.approx(0.5) and found["low"] is None and found["high"] is None


# -------------------------------------------------------------------------------------------------------- rankings
def methods_of(*done, **failed):
    states = {label: {"state": "done", "reason": None} for label in done}
    states |= {label: {"state": state, "reason": "why", "case": "c"} for label, state in failed.items()}
    return {label: {"yardstick": None, "tracks": {"t": state}} for label, state in states.items()}


def values_of(count=8, **means):
    noise = 0.01 * np.cos(np.arange(count)[None, :] * np.arange(1, len(means) + 1)[:, None])
    noise -= noise.mean(axis=1, keepdims=True)
    return {label: mean + row for (label, mean), row in zip(means.items(), noise, strict=True)}


@pytest.mark.parametrize(
    ("measure", "expected"),
    [("flip", {"a": (1, 2), "b": (1, 2), "c": (3, 3)}), ("psnr_db", {"c": (1, 1), "b": (2, 3), "a": (2, 3)})],
)
def test_ranks_respect_the_intervals(measure, expected):
    """a and b are alike within the noise of 0.01; c is far from both."""
    found = ranked(measure, CaseValues(values_of(a=1.0, b=1.001, c=2.0), {}, float), methods_of(*"abc"), "t")
    assert found["over"] == "cases" and found["count"] == 8
    ranks = {entry["method"]: (entry["rank"], entry["last_rank"]) for entry in found["ranking"]}
    assert ranks == expected and list(ranks) == list(expected)


def test_methods_that_are_closer_than_the_noise_of_every_reference_share_ranks():
    values = values_of(a=1.0, b=1.1)
    for tied, expected in (((), [(1, 1), (2, 2)]), ([("a", "b")], [(1, 2), (1, 2)])):
        found = ranked("clipped_mse", CaseValues(values, {}, float, tied), methods_of("a", "b"), "t")
        assert [(entry["rank"], entry["last_rank"]) for entry in found["ranking"]] == expected


def test_failed_methods_are_last_and_others_are_not_ranked():
    methods = methods_of("a", "b", "seen", x="failed", y="failed", z="not applicable")
    methods["seen"]["yardstick"] = "reads reference"
    found = ranked("flip", CaseValues(values_of(a=1.0, b=2.0), {}, float), methods, "t")
    assert [entry["method"] for entry in found["ranking"]] == ["a", "b", "x", "y"]
    assert all((e["rank"], e["last_rank"], e["mean"]) == (3, 4, None) for e in found["ranking"][2:])
    assert all("why" in entry["reason"] for entry in found["ranking"][2:])
    assert set(found["not_ranked"]) == {"seen", "z"}


def test_few_cases_are_ranked_by_seeds_or_not_at_all():
    cases, seeds = values_of(2, a=1.0, b=2.0), values_of(5, a=1.0, b=2.0)
    by_seeds = ranked("flip", CaseValues(cases, seeds, float), methods_of("a", "b"), "t")
    assert by_seeds["over"] == "seeds" and [e["rank"] for e in by_seeds["ranking"]] == [1, 2]
    alone = ranked("flip", CaseValues(cases, {}, float), methods_of("a", "b"), "t")
    assert alone["over"] is None and alone["reason"] and [e["rank"] for e in alone["ranking"]] == [None, None]


# ---------------------------------------------------------------------------------------------------------- values
def test_series_of_other_noise_are_apart_and_cross_where_their_own_gain_is_zero(tmp_path):
    """The gain falls by 0.1 per degree, from 0.2 and from 0.05: zero at 2 and at 0.5."""
    table = CASE + "rotation = [0, 1, 3]\n"
    suite = suite_of(tmp_path, HEAD + table + table + "light_samples = 8\n")
    start = {"noisy": 0.2, "noisy@8": 0.05}

    def of(value):
        return {"state": "done", "warmup": 0, "rows": [{"seed": 0, "frame": 0, "flip": value}]}

    results = {
        case.id: {"methods": {"none": of(0.4), "m": of(0.4 - start[case.id.split("/")[2]] + 0.1 * case.value)}}
        for case in suite.cases
    }
    found = speed_curves(suite, results, ["none", "m"], ["flip"])
    assert set(found) == {"demo/rotation/noisy", "demo/rotation/noisy@8"}
    for name, crossing in (("noisy", 2.0), ("noisy@8", 0.5)):
        curves = found[f"demo/rotation/{name}"]["measures"]["flip"]
        assert curves["m"]["crossing"]["speed"] == pytest.approx(crossing) and curves["none"]["crossing"] is None


def test_means_by_seed_leave_the_warmup_out_and_average_decibels_as_errors():
    rows = [{"seed": s, "frame": f, "flip": v, "psnr_db": v} for s in (0, 1) for f, v in enumerate((99.0, 10.0, 20.0))]
    method = {"warmup": 1, "rows": rows}
    assert by_seed(method, "flip").tolist() == [15.0, 15.0]
    assert by_seed(method, "psnr_db") == pytest.approx([-10 * np.log10((0.1 + 0.01) / 2)] * 2)
    rows[-1]["flip"] = None
    assert by_seed(method, "flip") is None


def test_the_mean_of_errors_without_a_common_scale_is_geometric():
    assert over_cases("relmse", (0.01, 100.0)) == pytest.approx(1.0)
    assert over_cases("flip", (0.25, 0.75)) == pytest.approx(0.5)
    assert over_cases("flip", ()) is None
    assert over_cases("linear_mse", (0.1, -1e-4)) is None  # below the noise of a reference
