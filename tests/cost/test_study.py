"""A whole study: its points and files, presets, resuming after a kill, and invalid requests."""

from __future__ import annotations

import csv
import json

import pytest
from click.testing import CliRunner
from cost_tools import SMALL, ModelClock

from taubench_gl.apps.cli import cli
from taubench_gl.cost import PARAMETERS, cost, load_preset, save_preset
from taubench_gl.cost import study as study_module
from taubench_gl.cost.records import RECORDS_FILE, Records
from taubench_gl.cost.result import machine_state
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

PRESET = 'schema = "taubench-gl/preset/1"\n'


def test_study_measures_declared_configurations(small_study):
    _, study = small_study
    assert study.columns == ["frustum", "position", "normal"]
    named = {p.name: p for p in study.points}
    assert named.keys() >= {"baseline", "scale=0.5", "storage=half", "storage=double"}
    assert all(p.time.samples == 3 and p.time.median > 0 for p in study.points if p.time)
    assert named["storage=half"].bytes < named["baseline"].bytes
    assert named["storage=half"].error("position") > named["baseline"].error("position")
    grid = named["scale=0.5"]
    assert not grid.masks and grid.columns["position"].points is not None and grid not in study.front()


def test_float64_masks_are_the_reference(small_study):
    _, study = small_study
    double = study.point("storage=double")
    assert double.time is None and not double.usable and double.error() == 0.0
    assert study.point("baseline").error() < 1.0, "masks of the GPU differ from float64 at few pixels"
    assert study.floor() == 0.0 and study.about["reference"]["kind"] == "highest-quality"


def test_recommendation_is_on_the_printed_front(small_study):
    _, study = small_study
    assert study.chosen.point in study.front() and len(study.answer()) == 3
    assert study.chosen.point.label in study.answer()[0]


def test_written_files_agree_with_the_study(small_study):
    out, study = small_study
    values = json.loads((out / "study.json").read_text())
    assert values == json.loads(json.dumps(study.as_json()))
    rows = list(csv.DictReader((out / "study.csv").open()))
    assert len(rows) == len(study.points) * (len(study.columns) + 1), "every column, and overall"
    of_half = {r["column"]: r for r in rows if r["configuration"] == "storage=half"}
    assert float(of_half["overall"]["wrong_percent"]) == study.point("storage=half").error()
    assert values["fronts"]["overall"] == [p.name for p in study.front()]
    assert values["clock"] == "finish + monotonic clock" and values["machine"]["renderer"]
    assert (out / "front.png").stat().st_size > 5000 and (out / "front.svg").read_text().startswith("<?xml")
    assert (out / "study.txt").read_text().splitlines()[0] == study.answer()[0]


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


@pytest.mark.long
def test_interrupted_study_resumes_to_the_same_front(demo, tmp_path):
    class Stop(BaseException):
        """As if the process were killed."""

    request = SMALL | {"parameters": ("storage", "scale"), "frames": (20, 24)}

    def run(folder, steps, stop_at=None):
        clock = ModelClock()

        def progress(step):
            if step.what == stop_at:
                raise Stop
            steps.append(step.what)
            clock.listen(step)

        return cost(demo, out=folder, now=clock, progress=progress, **request)

    steps: list[str] = []
    for stop_at in ("masks: storage=half", "round 2 of 3: storage=half"):
        with pytest.raises(Stop):
            run(tmp_path / "resumed", steps, stop_at)
    path = tmp_path / "resumed" / RECORDS_FILE
    kept = path.read_text()
    path.write_text(kept + '{"kind": "time", "configuration": "ba')  # an incomplete last line
    resumed = run(tmp_path / "resumed", steps)
    assert path.read_text().startswith(kept)
    assert len(steps) == len(set(steps)), "nothing is measured twice"
    whole = run(tmp_path / "whole", [])
    assert [p.name for p in resumed.front()] == [p.name for p in whole.front()]
    for a, b in zip(resumed.points, whole.points, strict=True):
        assert a.time is b.time is None or a.time.rounds == pytest.approx(b.time.rounds)
        assert {c: e.percent for c, e in a.masks.items()} == {c: e.percent for c, e in b.masks.items()}
    assert resumed.chosen.point.name == whole.chosen.point.name


def test_an_interrupt_gives_the_answer_so_far(demo, tmp_path):
    request = SMALL | {"parameters": ("storage",), "frames": (20, 22)}

    def progress(step):
        if step.what.startswith("round 1 of 3: storage"):
            raise KeyboardInterrupt

    study = cost(demo, out=tmp_path, progress=progress, **request)
    assert study.about["interrupted"] and study.chosen.point is not None
    assert study.point("storage=half").time is None and study.point("storage=half").masks
    study.save()
    assert (tmp_path / "study.html").is_file()


def test_the_time_limit_ends_a_study_that_more_time_finishes(demo, tmp_path):
    request = SMALL | {"parameters": ("storage",), "frames": (20, 22), "repeats": 1}
    short = cost(demo, out=tmp_path, time_limit=1e-6, **request)
    assert [p.name for p in short.points if p.masks] == ["baseline"] and short.chosen.point is None
    assert all(p.masks and (p.time or not p.usable) for p in cost(demo, out=tmp_path, **request).points)


def test_a_slow_measurement_is_abandoned_at_its_share_of_the_time(demo, tmp_path, monkeypatch):
    """Masks during which the limit passes are left to a later run; the others are timed."""
    passed, render = [], study_module.rendered_masks

    class Passing(study_module.Deadline):
        def check(self, share=1.0):
            if share == study_module.MASK_SHARE and passed:
                raise study_module.OutOfTime

    def slow(subject, settings, without=(), check=None):
        passed.extend(["now"] if settings.device.storage == "half" else [])
        return render(subject, settings, without, check)

    monkeypatch.setattr(study_module, "rendered_masks", slow)
    monkeypatch.setattr(study_module, "Deadline", Passing)
    request = SMALL | {"parameters": ("storage",), "frames": (20, 22), "repeats": 1}
    study = cost(demo, out=tmp_path, **request)
    assert not study.point("storage=half").masks and study.point("baseline").time is not None
    monkeypatch.undo()
    assert cost(demo, out=tmp_path, **request).point("storage=half").time is not None


def test_the_clock_is_named_and_clocks_are_not_mixed(demo, tmp_path):
    request = SMALL | {"parameters": ("storage",), "frames": (20, 22), "repeats": 1}
    study = cost(demo, out=tmp_path, clock="cpu", **request)
    assert study.about["clock"].startswith("CPU time") and study.point("baseline").clock == study.about["clock"]
    assert study.point("baseline").time.median > 0
    with pytest.raises(OutputError):
        cost(demo, out=tmp_path, **request)


@pytest.mark.parametrize(
    ("other", "times", "busy"),
    [
        (0.1, [10, 10.5], False),
        (0.5, [10], True),
        (0.1, [10, 14], True),
        (0.1, [10, 14, 9, 10, 14], False),
    ],
)
def test_a_busy_machine_is_detected(other, times, busy):
    """Visits of 1 s on two cores, during each of which other processes take ``other`` seconds."""
    tag = {"kind": "time", "configuration": "baseline", "seconds": 1.0, "other_seconds": other}
    state = machine_state([tag | {"round": i, "frame_ms": t} for i, t in enumerate(times)], 2)
    assert state["busy"] is busy
    assert state["other_work"] == pytest.approx(0.5 * other)


def test_drift_is_that_of_most_configurations():
    """One noisy visit is no drift; a machine that becomes slower is."""

    def state(*last):
        visits = [[(name, 10.0) for name in "abc"], list(zip("abc", last, strict=True))]
        tag = {"kind": "time", "seconds": 1.0, "other_seconds": 0.0}
        records = [tag | {"configuration": n, "round": i, "frame_ms": t} for i, v in enumerate(visits) for n, t in v]
        return machine_state(records, 2)

    assert not state(10.0, 20.0, 10.0)["busy"] and state(13.0, 14.0, 10.0)["drift"] == pytest.approx(0.3)
    assert state(7.0, 7.0, 7.0)["busy"] and machine_state([], 2) == {"other_work": None, "drift": None, "busy": False}


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
        {"choose_for": "beauty"}, {"choose_for": "color"}, {"parameters": ()}, {"frames": (0, 1)}, {"time_limit": 0.0},
        {"parameters": ("light_error",)}, {"clock": "sun"},
    ],
)  # fmt: skip
def test_invalid_requests_are_refused(demo, tmp_path, wrong):
    with pytest.raises(SettingsError):
        cost(demo, out=tmp_path / "study", **SMALL | wrong)
    assert not (tmp_path / "study").exists()


def test_parameters_are_documented():
    for name, parameter in PARAMETERS.items():
        assert parameter.doc and parameter.name == name and len(parameter.values) >= 2
        assert all(isinstance(parameter.phrase(v), str) and parameter.phrase(v) for v in parameter.values)


@pytest.mark.long
def test_a_preset_leaves_open_what_the_study_left_open(tmp_path, demo):
    auto = {"exposure": "auto", "light_unit": "auto", "environment": "auto"}
    small = SMALL | {"parameters": ("storage",), "columns": ("frustum", "direct"), "choose_for": "direct"}
    small |= {"repeats": 1, "frames": (20, 23), "indirect": "none", "reference": "path-traced@2"}
    study = cost(demo, out=tmp_path, within=100.0, **small, **auto)
    lighting = study.about["lighting"]
    assert lighting["light_unit"] == "candela" and lighting["exposure"] not in (1.0, "auto")
    configurations = {c.settings.lighting.exposure for c in study.plan.configurations}
    assert configurations == {lighting["exposure"]}
    study.save()
    preset = load_preset(tmp_path / "preset.toml")
    assert {name: preset.get(name, "auto") for name in auto} == auto
