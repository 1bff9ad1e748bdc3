"""The commands ``evaluate exr:DIR`` and ``reference``."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from taubench_gl.animation import choose_camera
from taubench_gl.apps.cli import cli
from taubench_gl.paths import ASSETS
from taubench_gl.pathtraced.blender.job import Quality, identity, make_job
from taubench_gl.run import load_run
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.usefixtures("coarse_light", "coarse_metering")

DEMO = ASSETS / "demo.glb"


def test_evaluate_and_compare(renders, tmp_path):
    out = tmp_path / "out"
    options = ("--lobe", "glossy", "--second-seed", f"exr:{renders}", "--save", "masks,channels")
    done = CliRunner().invoke(cli, ["evaluate", f"exr:{renders}", "--out", str(out), *options])
    assert done.exit_code == 0 and "Table 4" in done.output, done.output
    summary = load_run(out).summary
    assert summary["lobes"]["glossy"]["direct"]["mean_percent"] > 0 and summary["noise_floor"]["color"]
    done = CliRunner().invoke(cli, ["reference", "compare", str(out), str(out)])
    assert done.exit_code == 0 and "median" in done.output and "worst pair" in done.output


def test_errors_are_one_line_and_exit_code_2(taubench, renders, tmp_path):
    for arguments, named in (
        (("evaluate", f"exr:{tmp_path / 'none'}"), "none"),
        (("evaluate", f"exr:{renders}", "--mapping", "x.toml"), "x.toml"),
        (("check", f"exr:{renders}", "--layer", "none"), "'none'"),
        (("check", f"exr:{renders}", "--mapping", "godott"), "godott"),
        (("check", f"exr:{renders}", "--frames", "90:95"), "4:7"),
        (("reference", "render", tmp_path / "none.glb", "--out", tmp_path / "o"), "none.glb"),
    ):
        code, _, err = taubench(*arguments)
        assert code == 2 and named in err and err.count("\n") == 1, err


def test_a_render_gets_the_lighting_of_evaluate(tmp_path, monkeypatch):
    """Light unit, exposure and environment as resolved; a continued render keeps its exposure."""
    calls = []
    target = "taubench_gl.pathtraced.blender.render.render_reference"
    monkeypatch.setattr(target, lambda *_, **options: calls.append(options) or [])
    command = ["reference", "render", str(DEMO), "--out", str(tmp_path), "--size", "64x48"]
    command += [word for name in ("--light-unit", "--exposure", "--environment") for word in (name, "auto")]
    for frames in ("0:2", "10:12"):
        done = CliRunner().invoke(cli, [*command, "--frames", frames])
        assert done.exit_code == 0, done.output
        record = {"job": "1", "settings": {"samples": 4}, "lighting": calls[-1]["lighting"]}
        (tmp_path / "provenance.json").write_text(json.dumps(record))
    first, second = (call["lighting"] for call in calls)
    assert first == second and first["light_unit"] == "candela"
    assert first["environment"] == list(load_scene(DEMO).environment)
    assert first["exposure"] not in (1.0, "auto")
    assert f"--exposure {first['exposure']:g}" in done.output
    assert {call["quality"].light_unit for call in calls} == {"candela"}
    for text, sky in (("none", (0, 0, 0)), ("0.1,0.2,0.3", (0.1, 0.2, 0.3))):
        done = CliRunner().invoke(
            cli, [*command[:3], "--out", str(tmp_path / text), "--exposure", "1", "--environment", text]
        )
        assert done.exit_code == 0 and calls[-1]["quality"].sky == sky, done.output


def test_intensities_of_a_job_are_divided_for_watt():
    scene = load_scene(DEMO)
    jobs = [
        make_job(scene, choose_camera(scene), range(2), 24.0, (64, 48), Quality(light_unit=unit))[0]
        for unit in ("candela", "watt")
    ]
    intensities = [
        [entry["intensity"] for light in job["lights"] for entry in light["frames"].values()] for job in jobs
    ]
    assert any(intensities[0]) and intensities[1] == [value / 683.0 for value in intensities[0]]
    assert len({identity(job, "x") for job in jobs}) == 2
