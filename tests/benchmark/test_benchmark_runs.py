"""Benchmarks that render: equal bits on any engine and in any order, resumption, methods that fail, comparison."""

from __future__ import annotations

import json
import random
import re
import shutil
from pathlib import Path

import pytest

from taubench_gl.benchmark.output import compared, load_benchmark
from taubench_gl.benchmark.run import BenchmarkStudy, run_benchmark
from taubench_gl.benchmark.suite import read_suite
from taubench_gl.errors import OutputError, SceneError, SettingsError
from taubench_gl.paths import ASSETS
from taubench_gl.study.progress import Progress
from taubench_gl.study.store import RECORDS

pytestmark = pytest.mark.usefixtures("coarse_light", "coarse_metering", "coarse_space")

SUITE = """schema = "suite/1"
name = "tiny"
size = "48x27"
frames = 3
metrics = ["psnr", "flip"]
[[cases]]
scene = "demo"
track = "noisy"
input = "noisy"
rotation = [0.0, 6.0]
seeds = 2
reference_samples = 1
[[cases]]
scene = "demo"
track = "upscaling"
input = "jittered+upscale@3"
reference_samples = 1
"""
BROKEN = {
    "fails": "raise ValueError('on purpose')",
    "nan": "return np.full_like(frame['radiance'], np.nan)",
    "exits": "raise SystemExit(3)",
    "diverges": "self.factor *= np.float32(1e3); return frame['radiance'] * self.factor",
}
CLASS = """import numpy as np


class Method:
    reads = ("radiance",)

    def __init__(self, size, settings):
        self.factor = np.float32(1)

    def step(self, frame):
        {line}
"""
METHODS = ("none", "taa_clamp", "ideal-masks")
NOT_EQUAL = ("times", "provenance")


def values_of(summary):
    """All that two runs must have in common, as bits."""
    return json.dumps({name: value for name, value in summary.items() if name not in NOT_EQUAL})


def units_of(suite, entries):
    return list(BenchmarkStudy(read_suite(suite), entries, "nowhere").units.values())


@pytest.fixture(scope="module")
def suite_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("suite") / "tiny.toml"
    path.write_text(SUITE)
    return path


@pytest.fixture(scope="module")
def whole(suite_file, tmp_path_factory):
    """A benchmark in this process -> summary, folder."""
    out = tmp_path_factory.mktemp("whole") / "out"
    return run_benchmark(read_suite(suite_file), METHODS, out, workers=0), out


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    folder = tmp_path_factory.mktemp("methods")
    for name, line in BROKEN.items():
        (folder / f"{name}.py").write_text(CLASS.format(line=line))
    return folder


def test_the_result_is_complete_and_can_be_read(whole):
    summary, out = whole
    assert values_of(load_benchmark(out)) == values_of(summary)
    assert {"report.html", "tables.md", "speeds.png", "benchmark.json"} <= {path.name for path in out.iterdir()}
    first = summary["cases"]["demo/rotation=0/noisy"]
    turning = summary["cases"]["demo/rotation=6/noisy"]
    assert sum(first["classes_percent"].values()) == pytest.approx(100.0) and first["reference"]["samples"] == 1
    assert turning["classes_percent"]["frustum"] > 5.0 > 1.0 > first["classes_percent"]["frustum"]
    assert turning["discarded_percent"] > first["discarded_percent"]
    assert summary["methods"]["ideal-masks"]["yardstick"]
    assert summary["methods"]["ideal-masks"]["tracks"]["upscaling"]["state"] == "not applicable"
    cell = summary["methods"]["none"]["cases"]["demo/rotation=0/noisy"]
    assert cell["over_seeds"] is None and "over_seeds" in cell["reasons"]  # two seeds
    assert not {"lpips", "hdr_flip"} & set(cell["reasons"])  # the suite does not ask for them
    curve = summary["speeds"]["demo/rotation/noisy"]["measures"]["flip"]["taa_clamp"]
    means = [summary["methods"]["taa_clamp"]["cases"][c]["mean"]["flip"] for c in list(summary["cases"])[:2]]
    assert [step["mean"] for step in curve["steps"]] == pytest.approx(means)


@pytest.mark.long
def test_units_of_single_methods_give_equal_bits(suite_file, whole, tmp_path):
    """As after a lost worker: another order of methods, in units of their own."""
    out, suite = tmp_path / "out", read_suite(suite_file)
    run_benchmark(suite, ("none",), out, workers=0)
    stored = {path.name for path in (out / RECORDS).iterdir()}
    again = run_benchmark(suite, METHODS, out, workers=0)  # adds two methods
    assert stored < {path.name for path in (out / RECORDS).iterdir()}
    assert values_of(again) == values_of(whole[0])


@pytest.mark.long
def test_two_workers_give_equal_bits(suite_file, whole, tmp_path):
    found = run_benchmark(read_suite(suite_file), METHODS, tmp_path / "out", workers=2)
    assert values_of(found) == values_of(whole[0])


def test_a_worker_with_another_scene_is_refused(tmp_path, monkeypatch):
    """The scene changes after its hash was taken; no method is to blame."""
    (tmp_path / "scene.glb").write_bytes((ASSETS / "demo.glb").read_bytes())
    (tmp_path / "suite.toml").write_text(SUITE.replace('"demo"', '"scene.glb"').replace("rotation = [0.0, 6.0]\n", ""))
    missing = BenchmarkStudy.missing

    def changed(*arguments):
        units = missing(*arguments)
        with (tmp_path / "scene.glb").open("ab") as file:
            file.write(b" ")
        return units

    monkeypatch.setattr(BenchmarkStudy, "missing", changed)
    with pytest.raises(SceneError) as found:
        run_benchmark(read_suite(tmp_path / "suite.toml"), ("none",), tmp_path / "out", workers=0)
    assert "scene.glb" in str(found.value) and "\n" not in str(found.value)
    assert not list((tmp_path / "out").glob("records/*")) and not (tmp_path / "out" / "benchmark.json").exists()


@pytest.mark.long
def test_parts_of_two_folders_merge_in_any_order(suite_file, whole, tmp_path):
    """Each part has some cases; their records are copied into one folder."""
    suite = read_suite(suite_file)
    parts = {"turning": ["demo/rotation=6/*", "*upscale*"], "still": ["demo/rotation=0/*"]}
    for name, patterns in parts.items():
        part = run_benchmark(suite.part(patterns), METHODS, tmp_path / name, workers=0)
        assert part["suite"] != whole[0]["suite"]
    for order in (tuple(parts), tuple(reversed(parts))):
        out, lines = tmp_path / "-".join(order), []
        for name in order:
            shutil.copytree(tmp_path / name / RECORDS, out / RECORDS, dirs_exist_ok=True)
        found = run_benchmark(suite, METHODS, out, workers=0, listener=Progress(lines.append))
        assert sum("of an earlier run" in line for line in lines) == 3
        assert values_of(found) == values_of(whole[0])


@pytest.mark.long
def test_methods_that_fail_are_last_and_the_others_untouched(suite_file, whole, broken, tmp_path):
    texts = [*METHODS, *(str(broken / f"{name}.py") for name in BROKEN), str(broken / "missing.py")]
    found = run_benchmark(read_suite(suite_file), texts, tmp_path / "out", workers=0)
    ranking = found["rankings"]["noisy"]["flip"]["ranking"]
    assert {Path(entry["method"]).stem for entry in ranking[2:]} == {*BROKEN, "missing"}
    reasons = {Path(entry["method"]).stem: entry["reason"] for entry in ranking[2:]}
    assert "on purpose" in reasons["fails"] and "NaN" in reasons["nan"] and "diverges" in reasons["diverges"]
    assert "SystemExit" in reasons["exits"]
    assert {(e["rank"], e["last_rank"]) for e in ranking[2:]} == {(3, 3 + len(BROKEN))}
    for label in METHODS:
        assert found["methods"][label] == whole[0]["methods"][label]
    assert found["rankings"]["noisy"]["flip"]["differences"] == whole[0]["rankings"]["noisy"]["flip"]["differences"]


@pytest.mark.long
def test_methods_that_end_or_stop_their_worker_are_last_and_the_others_untouched(suite_file, whole, tmp_path):
    """One is killed, and one waits where Python runs no other thread."""
    lines = {"killed": "os.kill(os.getpid(), 9)", "waits": "ctypes.PyDLL(None).sleep(1000)"}
    for name, line in lines.items():
        (tmp_path / f"{name}.py").write_text("import ctypes\nimport os\n" + CLASS.format(line=line))
    texts = [*METHODS, *(str(tmp_path / f"{name}.py") for name in lines)]
    found = run_benchmark(read_suite(suite_file), texts, tmp_path / "out", workers=2, limit=30.0)
    reasons = {Path(e["method"]).stem: e["reason"] for e in found["rankings"]["noisy"]["flip"]["ranking"][2:]}
    assert set(reasons) == set(lines) and "SIGKILL" in reasons["killed"] and "30 s" in reasons["waits"]
    for label in METHODS:
        assert found["methods"][label] == whole[0]["methods"][label]


def test_a_folder_belongs_to_one_suite(suite_file, whole, tmp_path):
    other = tmp_path / "other.toml"
    other.write_text(SUITE.replace("frames = 3", "frames = 4"))
    with pytest.raises(OutputError):
        run_benchmark(read_suite(other), METHODS, whole[1], workers=0)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a.txt").write_text("")
    with pytest.raises(OutputError):
        run_benchmark(read_suite(suite_file), METHODS, tmp_path / "full", workers=0)
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["a.txt"]
    with pytest.raises(SettingsError):
        run_benchmark(read_suite(suite_file), ("none", "none"), tmp_path / "new", workers=0)
    assert not (tmp_path / "new").exists()


def test_comparison_refuses_other_suites_and_marks_what_differs(whole):
    summary = json.loads(json.dumps(whole[0]))
    same = compared(summary, summary)
    assert not same["other_driver"] and not same["notes"]
    assert all(m["difference"] in (0.0, None) for row in same["rows"] for m in row["measures"].values())
    driver = summary | {"provenance": summary["provenance"] | {"renderer": "another"}}
    assert compared(summary, driver)["other_driver"]
    cases = summary["cases"]
    first = next(iter(cases))
    for other in (
        {"suite": summary["suite"] | {"version": "suite/0"}},
        {"suite": summary["suite"] | {"sha256": "0" * 64}},
        {"cases": cases | {first: cases[first] | {"sha256": "0" * 64}}},
        {"cases": {name: case for name, case in cases.items() if name != first}},
    ):
        with pytest.raises(OutputError):
            compared(summary, summary | other)
    methods = {"none": summary["methods"]["none"], "mine": summary["methods"]["taa_clamp"]}
    found = compared(summary, summary | {"methods": methods})
    assert {row["method"] for row in found["rows"]} == {"none"}
    in_a, in_b = found["notes"]
    assert "taa_clamp" in in_a and "ideal-masks" in in_a and "mine" in in_b


def test_a_damaged_result_is_one_error(whole, tmp_path):
    good, text, file = json.loads(json.dumps(whole[0])), json.dumps(whole[0]), tmp_path / "x.json"
    none = good["methods"]["none"]
    some_tracks = none | {"tracks": {"noisy": none["tracks"]["noisy"]}}
    no_means = none | {"tracks": none["tracks"] | {"noisy": none["tracks"]["noisy"] | {"mean": [1.0]}}}
    damages = [{"schema": "taubench-gl/benchmark/0"}, {"cases": {"a": {}}}]
    damages += [{"methods": {"none": method}} for method in (1, some_tracks, no_means)]
    contents = ["", text[: len(text) // 2], "[]", "null", "\0", '{"schema": "taubench-gl/benchmark/1"}']
    for content in contents + [json.dumps(good | damage) for damage in damages]:
        file.write_text(content)
        with pytest.raises(OutputError) as found:
            load_benchmark(file)
        assert found.value.where == str(file)
    file.write_text(text)
    assert load_benchmark(file) == good
    with pytest.raises(OutputError):
        load_benchmark(tmp_path)  # a folder without benchmark.json


def test_edits_of_numbers_of_a_result_are_refused(whole, tmp_path):
    text = (whole[1] / "benchmark.json").read_text()
    digits = [m.start() for m in re.finditer(r"(?<=[ \[:.0-9])[0-9](?=[0-9.,\n ])", text)]
    file, rng = tmp_path / "benchmark.json", random.Random(1)
    for at in rng.sample(digits, 15):
        edited = f"{text[:at]}{int(text[at]) % 9 + 1}{text[at + 1 :]}"  # no leading zero, which is no JSON
        if json.loads(edited) == json.loads(text):
            continue  # the 17th digit of a number: both spellings are the same float64
        file.write_text(edited)
        with pytest.raises(OutputError) as refused:
            load_benchmark(file)
        assert refused.value.where == str(file) and refused.value.hint
    file.write_text(text)
    assert load_benchmark(file)["cases"]
