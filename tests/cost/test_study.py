"""A whole study: what it holds, that it goes on after being killed, and that its preset keeps its promise."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
from itertools import pairwise

import pytest
from click.testing import CliRunner
from cost_tools import SMALL

from taubench_gl.apps.evaluate_command import evaluate
from taubench_gl.conventions import COLUMNS
from taubench_gl.cost import KNOBS, cost, load_preset, save_preset
from taubench_gl.cost.records import RECORDS_FILE, Records
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.settings import Settings

COMMAND = [
    "--size",
    "48x28",
    "--frames",
    "20:29",
    "--columns",
    "frustum,position,normal",
    "--repeats",
    "3",
]
KNOB_LIST = "storage,scale,samples_per_pixel"


def run_command(demo, out, *more):
    command = [
        sys.executable,
        "-m",
        "taubench_gl",
        "cost",
        str(demo),
        "--out",
        str(out),
        "--knobs",
        KNOB_LIST,
        *COMMAND,
    ]
    return subprocess.Popen([*command, *more], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_study_measures_what_it_declares(small_study):
    _, study = small_study
    assert study.columns == ["frustum", "position", "normal"]
    named = {p.name: p for p in study.points}
    assert {
        "base",
        "best",
        "scale=0.5",
        "storage=half",
        "storage=double",
        "samples_per_pixel=4",
        "fps=48.0",
    } <= named.keys()
    assert len([p for p in study.points if p.role != "question"]) >= 12
    for column in study.columns:
        assert named["best"].error(column) == 0.0
        front = study.front(column)
        assert front and all(a.time.median <= b.time.median for a, b in pairwise(front))
        assert all(a.error(column) > b.error(column) for a, b in pairwise(front))
    assert all(p.time.samples == 3 and p.time.median > 0 and p.clock for p in study.points)
    assert named["storage=half"].bytes < named["base"].bytes
    assert (
        named["base"].features["position_mm"]["median"] == 0.0 < named["storage=half"].features["position_mm"]["median"]
    )
    assert "fps=48.0" not in study.front("position")


def test_the_double_twin_agrees_with_the_gpu(small_study):
    _, study = small_study
    for column in ("position", "normal"):
        gpu, twin = (study.point(n).columns[column].percent for n in ("base", "storage=double"))
        assert twin == pytest.approx(gpu, abs=2 * 100.0 / (48 * 28))


def test_files_say_the_same(small_study):
    out, study = small_study
    values = json.loads((out / "study.json").read_text())
    assert values == json.loads(json.dumps(study.as_json()))
    rows = list(csv.DictReader((out / "study.csv").open()))
    assert len(rows) == len(study.points) * (len(COLUMNS) + 1), "every column, and the worst of those asked for"
    worst = next(r for r in rows if r["setting"] == "scale=0.5" and r["column"] == "all")
    point = study.point("scale=0.5")
    assert float(worst["error"]) == max(point.error("position"), point.error("normal"))
    assert values["front_columns"]["all"] == ["position", "normal"]
    assert values["fronts"]["all"] == [p.name for p in study.front("all")]
    row = next(r for r in rows if r["setting"] == "scale=0.5" and r["column"] == "position")
    assert float(row["points"]) == study.point("scale=0.5").columns["position"].points
    text = (out / "study.txt").read_text()
    assert "clock: frames by finish + monotonic clock" in text and values["machine"]["renderer"] in text
    for column in study.columns:
        assert (out / f"front_{column}.png").stat().st_size > 5000
        assert (out / f"front_{column}.svg").read_text().startswith("<?xml")


def test_the_preset_keeps_its_promise(small_study, demo):
    out, study = small_study
    assert study.chosen.point is not None and study.checked["errors_kept"]
    settings = Settings.of(**load_preset(out / "preset.toml"), frames=SMALL["frames"])
    run = evaluate_scene(demo, settings)
    for column in SMALL["choose_for"]:
        apart = run.summary["discard"][column]["mean_percent"] - study.about["reference"]["percent"][column]
        assert abs(apart) <= 1.0


def test_evaluate_takes_the_preset_and_what_is_said_beside_it_wins(demo, tmp_path):
    preset = tmp_path / "preset.toml"
    values = 'width = 48\nheight = 28\nstorage = "half"\nfps = 12.0\ncolumns = ["position"]\n'
    preset.write_text(f'schema = "taubench-gl/preset/1"\n[settings]\n{values}')
    more = ["--frames", "0:3", "--fps", "30", "--out", str(tmp_path / "run")]
    done = CliRunner().invoke(evaluate, [str(demo), "--preset", str(preset), *more])
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "run" / "summary.json").read_text())["settings"]
    assert (told["width"], told["height"], told["storage"], told["fps"]) == (48, 28, "half", 30.0)
    assert told["columns"] == ["position"]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("width = 3", "schema"),
        ("schema = [", "is not TOML"),
        ('schema = "taubench-gl/preset/1"\n[setting]\nwidth = 48', "has no table"),
        ('schema = "taubench-gl/preset/1"\nsettings = 3', "is no table"),
        ('schema = "taubench-gl/preset/1"\n[settings]\nspeed = 3', "no setting is named 'speed'"),
        ('schema = "taubench-gl/preset/1"\n[settings]\nwidth = "wide"', "is .wide."),
        ('schema = "taubench-gl/preset/1"\n[settings]\nstorage = "tiny"', "storage is 'tiny'"),
    ],
)
def test_broken_presets_are_refused(tmp_path, text, complaint):
    path = tmp_path / "p.toml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=complaint):
        load_preset(path)


def test_a_preset_of_a_scene_whose_name_is_no_utf8_can_be_read(tmp_path):
    save_preset(tmp_path / "p.toml", Settings.of(width=48, height=28), {"scene": 'caf\udce9 "1"'})
    assert load_preset(tmp_path / "p.toml") == {"width": 48, "height": 28}
    assert "caf\\\\udce9" in (tmp_path / "p.toml").read_text(encoding="utf-8")


@pytest.mark.long
def test_killed_and_called_again_it_goes_on(demo, tmp_path):
    process = run_command(demo, tmp_path / "killed")
    for line in process.stderr:
        if "round 2" in line:
            break
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close(), process.stderr.close()
    path = tmp_path / "killed" / RECORDS_FILE
    kept = path.read_text()
    assert kept.count("\n") > 10 and not (tmp_path / "killed" / "study.json").exists()
    path.write_text(kept + '{"kind": "time", "setting": "ba')  # as if the last line had been cut in two
    for folder in ("killed", "whole"):
        process = run_command(demo, tmp_path / folder)
        _, errors = process.communicate()
        assert process.returncode == 0, errors
    assert path.read_text().startswith(kept), "nothing measured is lost or measured again"
    killed, whole = (json.loads((tmp_path / f / "study.json").read_text()) for f in ("killed", "whole"))
    for a, b in zip(killed["points"], whole["points"], strict=True):
        same = ("name", "label", "role", "choice", "columns", "features", "bytes", "clock")
        assert {k: a[k] for k in same} == {k: b[k] for k in same}
        assert a["ms"]["samples"] == b["ms"]["samples"] == 3
    assert killed["sanity"] == whole["sanity"] and killed["reference"] == whole["reference"]


def test_interrupted_and_called_again_nothing_is_measured_twice(demo, tmp_path):
    class Stop(Exception):
        pass

    def until_round_2(step):
        if "round 2" in step.what:
            raise Stop

    tiny = SMALL | {"knobs": ("storage",), "frames": (20, 23), "columns": ("frustum", "position")}
    tiny["choose_for"] = ("position",)
    with pytest.raises(Stop):
        cost(demo, out=tmp_path, progress=until_round_2, **tiny)
    path = tmp_path / RECORDS_FILE
    kept = path.read_text()
    path.write_text(kept + '{"kind": "time", "setting": "ba')  # as if the last line had been cut in two
    said = []
    study = cost(demo, out=tmp_path, progress=lambda step: said.append(step.what), **tiny)
    assert path.read_text().startswith(kept) and not any("round 1" in what or "errors" in what for what in said)
    assert all(p.time.samples == 3 for p in study.points)


def test_another_study_in_the_same_folder_is_refused(small_study, demo):
    out, _ = small_study
    with pytest.raises(OutputError, match="a study with other settings"):
        cost(demo, out=out, **SMALL | {"frames": (20, 28)})
    with pytest.raises(OutputError, match="other knobs"):
        cost(demo, out=out, **SMALL | {"knobs": ("storage",)})


def test_records_refuse_what_is_none(tmp_path):
    (tmp_path / RECORDS_FILE).write_text("hello\nworld\n")
    with pytest.raises(OutputError, match="not a record"):
        Records(tmp_path, {"identity": {}, "machine": {}})


def test_records_refuse_another_machine(tmp_path):
    Records(tmp_path, {"identity": {"scene": "a"}, "machine": {"renderer": "x"}}).close()
    with pytest.raises(OutputError, match="another machine"):
        Records(tmp_path, {"identity": {"scene": "a"}, "machine": {"renderer": "y"}})


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"knobs": ("speed",)}, "no knob is named 'speed'"),
        ({"reference": "perfect"}, "no reference is named"),
        ({"within": -1.0}, "within is -1"),
        ({"budget_ms": 0.0}, "budget is 0.0 ms"),
        ({"repeats": 0}, "repeats is 0"),
        ({"choose_for": ("beauty",)}, "no column is named"),
        ({"choose_for": ("color",)}, "nothing can be chosen for color"),
        ({"knobs": ()}, "no knob is given"),
        ({"frames": (0, 1)}, "no pair of frames"),
        ({"knobs": ("light_error",)}, "no knob changes anything here"),
    ],
)
def test_what_cannot_be_studied_is_said(demo, tmp_path, wrong, complaint):
    with pytest.raises(SettingsError, match=complaint):
        cost(demo, out=tmp_path / "study", **SMALL | wrong)
    assert not (tmp_path / "study").exists()


def test_every_knob_says_what_it_is():
    for name, knob in KNOBS.items():
        assert knob.doc and knob.name == name and len(knob.values) >= 2
        assert all(isinstance(knob.phrase(v), str) and knob.phrase(v) for v in knob.values)
        assert set(knob.columns) <= set(COLUMNS)
