"""A whole study: its points and files, presets, resuming after a kill, and invalid requests."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
from itertools import pairwise

import pytest
from click.testing import CliRunner
from cost_tools import SMALL, ModelClock

from taubench_gl.apps.cli import cli
from taubench_gl.conventions import COLUMNS
from taubench_gl.cost import PARAMETERS, cost, load_preset, save_preset
from taubench_gl.cost.records import RECORDS_FILE, Records
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.settings import Settings

PRESET = 'schema = "taubench-gl/preset/1"\n'


def test_study_measures_declared_configurations(small_study):
    _, study = small_study
    assert study.columns == ["frustum", "position", "normal"]
    named = {p.name: p for p in study.points}
    assert named.keys() >= {
        "baseline", "highest_quality", "scale=0.5", "storage=half", "storage=double", "samples_per_pixel=4", "fps=48.0",
    }  # fmt: skip
    for column in study.columns:
        assert named["highest_quality"].error(column) == 0.0
        front = study.front(column)
        assert front and all(a.time.median <= b.time.median for a, b in pairwise(front))
        assert all(a.error(column) > b.error(column) for a, b in pairwise(front))
    timed = [p for p in study.points if p.name != "storage=double"]
    assert all(p.time.samples == 3 and p.time.median > 0 and p.clock for p in timed)
    assert all(p.passes["masks"] > 0.0 for p in timed)
    assert named["storage=half"].bytes < named["baseline"].bytes
    exact, half = (named[n].features["position_mm"]["median"] for n in ("baseline", "storage=half"))
    assert exact == 0.0 < half
    assert named["fps=48.0"] not in study.front("position")


def test_float64_masks_agree_with_the_gpu(small_study):
    _, study = small_study
    reference = study.point("storage=double")
    assert reference.time is None and not reference.usable
    for column in ("position", "normal"):
        gpu = study.point("baseline").columns[column].percent
        assert reference.columns[column].percent == pytest.approx(gpu, abs=2 * 100.0 / (48 * 28))


def test_written_files_agree_with_the_study(small_study):
    out, study = small_study
    values = json.loads((out / "study.json").read_text())
    assert values == json.loads(json.dumps(study.as_json()))
    rows = list(csv.DictReader((out / "study.csv").open()))
    assert len(rows) == len(study.points) * (len(COLUMNS) + 1), "every column, and the worst of the chosen ones"
    of_half = {r["column"]: r for r in rows if r["configuration"] == "scale=0.5"}
    point = study.point("scale=0.5")
    assert float(of_half["all"]["error"]) == max(point.error("position"), point.error("normal"))
    assert float(of_half["position"]["points"]) == point.columns["position"].points
    assert values["front_columns"]["all"] == ["position", "normal"]
    assert values["fronts"]["all"] == [p.name for p in study.front("all")]
    assert values["clock"] == "finish + monotonic clock" and values["machine"]["renderer"]
    for column in study.columns:
        assert (out / f"front_{column}.png").stat().st_size > 5000
        assert (out / f"front_{column}.svg").read_text().startswith("<?xml")


def test_preset_gives_the_validated_errors(small_study, demo):
    out, study = small_study
    assert study.chosen.point is not None and study.validation["errors_pass"]
    settings = Settings(**load_preset(out / "preset.toml"), frames=SMALL["frames"])
    run = evaluate_scene(demo, settings)
    for column in SMALL["choose_for"]:
        error = run.summary["discard"][column]["mean_percent"] - study.about["reference"]["percent"][column]
        assert abs(error) <= 1.0


def test_evaluate_options_take_precedence_over_the_preset(demo, tmp_path):
    preset = tmp_path / "preset.toml"
    preset.write_text(
        f'{PRESET}[settings]\nwidth = 48\nheight = 28\nstorage = "half"\nfps = 12.0\ncolumns = ["position"]\n'
    )
    more = ["--frames", "0:3", "--fps", "30", "--out", str(tmp_path / "run")]
    done = CliRunner().invoke(cli, ["evaluate", str(demo), "--preset", str(preset), *more])
    assert done.exit_code == 0, done.output
    used = json.loads((tmp_path / "run" / "summary.json").read_text())["settings"]
    assert (used["width"], used["height"], used["storage"], used["fps"]) == (48, 28, "half", 30.0)
    assert used["columns"] == ["position"]


@pytest.mark.parametrize(
    "text",
    [
        "width = 3",
        "schema = [",
        f"{PRESET}[setting]\nwidth = 48",
        f"{PRESET}settings = 3",
        f"{PRESET}[settings]\nspeed = 3",
        f'{PRESET}[settings]\nwidth = "wide"',
        f'{PRESET}[settings]\nstorage = "tiny"',
    ],
)
def test_invalid_presets_are_refused(tmp_path, text):
    path = tmp_path / "p.toml"
    path.write_text(text)
    with pytest.raises(SettingsError) as refused:
        load_preset(path)
    assert refused.value.where == str(path)


def test_preset_of_a_scene_whose_name_is_not_utf8(tmp_path):
    save_preset(tmp_path / "p.toml", Settings(width=48, height=28), {"scene": 'caf\udce9 "1"'})
    assert load_preset(tmp_path / "p.toml") == {"width": 48, "height": 28}
    assert "caf\\\\udce9" in (tmp_path / "p.toml").read_text(encoding="utf-8")


def run_command(demo, out):
    command = [sys.executable, "-m", "taubench_gl", "cost", str(demo), "--out", str(out), "--size", "48x28"]
    command += ["--frames", "20:29", "--columns", "frustum,position,normal", "--repeats", "3"]
    command += ["--parameters", "storage,scale,samples_per_pixel"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.long
def test_killed_study_resumes_to_the_same_errors(demo, tmp_path):
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
    path.write_text(kept + '{"kind": "time", "configuration": "ba')  # an incomplete last line
    for folder in ("killed", "whole"):
        process = run_command(demo, tmp_path / folder)
        _, errors = process.communicate()
        assert process.returncode == 0, errors
    assert path.read_text().startswith(kept), "no finished measurement is lost or repeated"
    killed, whole = (json.loads((tmp_path / f / "study.json").read_text()) for f in ("killed", "whole"))
    same = ("name", "label", "role", "values", "columns", "features", "bytes", "clock")
    for a, b in zip(killed["points"], whole["points"], strict=True):
        assert {k: a[k] for k in same} == {k: b[k] for k in same}
        assert a["ms"] is b["ms"] is None or a["ms"]["samples"] == b["ms"]["samples"] == 3
    assert killed["reference"] == whole["reference"]


def test_interrupted_study_resumes_to_the_same_front(demo, tmp_path):
    class Stop(Exception):
        pass

    request = SMALL | {"parameters": ("scale", "samples_per_pixel"), "frames": (20, 26), "within": 1.0}

    def run(folder, stop_at=None):
        clock, steps = ModelClock(), []

        def progress(step):
            if step.what == stop_at:
                raise Stop
            steps.append(step.what)
            clock.listen(step)

        return cost(demo, out=folder, now=clock, progress=progress, **request), steps

    for stop_at in ("errors: scale=0.5", "round 2 of 3: scale=0.5"):
        with pytest.raises(Stop):
            run(tmp_path / "resumed", stop_at)
    path = tmp_path / "resumed" / RECORDS_FILE
    kept = path.read_text()
    path.write_text(kept + '{"kind": "time", "configuration": "ba')  # an incomplete last line
    resumed, steps = run(tmp_path / "resumed")
    assert path.read_text().startswith(kept)
    assert not any(what.startswith(("errors", "round 1")) for what in steps), "no measurement is repeated"
    whole, _ = run(tmp_path / "whole")
    for name in whole.fronts:
        assert [p.name for p in resumed.front(name)] == [p.name for p in whole.front(name)]
    for a, b in zip(resumed.points, whole.points, strict=True):
        assert a.time.rounds == pytest.approx(b.time.rounds)
    assert resumed.chosen.point.name == whole.chosen.point.name
    assert resumed.validation["errors"] == whole.validation["errors"]


def test_records_of_another_study_are_refused(small_study, demo):
    out, _ = small_study
    for other in ({"frames": (20, 28)}, {"parameters": ("storage",)}):
        with pytest.raises(OutputError) as refused:
            cost(demo, out=out, **SMALL | other)
        assert refused.value.where == str(out)


def test_records_refuse_other_files(tmp_path):
    (tmp_path / RECORDS_FILE).write_text("hello\nworld\n")
    with pytest.raises(OutputError) as refused:
        Records(tmp_path, {"identity": {}, "machine": {}})
    assert refused.value.where == f"{tmp_path / RECORDS_FILE}:1"


def test_records_refuse_another_machine(tmp_path):
    Records(tmp_path, {"identity": {"scene": "a"}, "machine": {"renderer": "x"}}).close()
    with pytest.raises(OutputError) as refused:
        Records(tmp_path, {"identity": {"scene": "a"}, "machine": {"renderer": "y"}})
    assert refused.value.where == str(tmp_path)


@pytest.mark.parametrize(
    "wrong",
    [
        {"parameters": ("speed",)}, {"reference": "perfect"}, {"within": -1.0}, {"budget_ms": 0.0}, {"repeats": 0},
        {"choose_for": ("beauty",)}, {"choose_for": ("color",)}, {"parameters": ()}, {"frames": (0, 1)},
        {"parameters": ("light_error",)},
    ],
)  # fmt: skip
def test_invalid_requests_are_refused(demo, tmp_path, wrong):
    with pytest.raises(SettingsError):
        cost(demo, out=tmp_path / "study", **SMALL | wrong)
    assert not (tmp_path / "study").exists()


def test_former_options_print_one_line(demo, tmp_path):
    command = ["cost", str(demo), "--out", str(tmp_path), "--size", "16x9", "--frames", "0:1"]
    former = ["--knobs", "storage", "--front", "6", "--summation", "plain", "--histogram-bits", "1"]
    done = CliRunner().invoke(cli, [*command, *former])
    assert isinstance(done.exception, SettingsError), "one frame has no pair"
    assert len(done.stderr.splitlines()) == 4 and "--parameters" in done.stderr


def test_parameters_are_documented():
    for name, parameter in PARAMETERS.items():
        assert parameter.doc and parameter.name == name and len(parameter.values) >= 2
        assert all(isinstance(parameter.phrase(v), str) and parameter.phrase(v) for v in parameter.values)
        assert set(parameter.columns) <= set(COLUMNS)


def test_a_preset_leaves_open_what_the_study_left_open(tmp_path, demo):
    auto = {"exposure": "auto", "light_unit": "auto", "environment": "auto"}
    small = SMALL | {"parameters": ("storage",), "columns": ("frustum", "direct"), "choose_for": ("direct",)}
    small |= {"repeats": 1, "frames": (20, 23), "indirect": "none"}
    study = cost(demo, out=tmp_path, within=100.0, check=False, **small, **auto)
    lighting = study.about["lighting"]
    assert lighting["light_unit"] == "candela" and lighting["exposure"] not in (1.0, "auto")
    configurations = {c.settings.lighting.exposure for c in study.plan.configurations}
    assert configurations == {lighting["exposure"]}
    study.save()
    preset = load_preset(tmp_path / "preset.toml")
    assert {name: preset.get(name, "auto") for name in auto} == auto
