"""The named levels: presets of the package, which tools/cost_levels.py makes of a recorded study."""

from __future__ import annotations

import importlib.util
import json
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from taubench_gl.apps.cli import cli
from taubench_gl.errors import SettingsError
from taubench_gl.preset import LEVEL_FIELDS, LEVEL_NAMES, LEVELS, level_settings
from taubench_gl.settings import FIELDS

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def tool():
    spec = importlib.util.spec_from_file_location("cost_levels", ROOT / "tools" / "cost_levels.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def defaults():
    """Not those that the tests set."""
    return {name: FIELDS[name].default for name in LEVEL_FIELDS}


def test_the_recorded_study_gives_the_levels(tool, monkeypatch, tmp_path):
    study = json.loads(tool.RECORDED.read_text(encoding="utf-8"))
    monkeypatch.setattr(tool, "Settings", lambda: tool_defaults())

    def tool_defaults():
        from taubench_gl.settings import Settings

        return Settings(light="auto")

    for name, (values, measured) in tool.levels(study).items():
        tool.save_level(tmp_path / f"{name}.toml", values, measured)
        assert (tmp_path / f"{name}.toml").read_text() == LEVELS[name].read_text(), f"run tools/cost_levels.py: {name}"


def test_levels_are_ordered(tool):
    """In time, and up to ``accurate`` in exactness."""
    named = tool.chosen_points(json.loads(tool.RECORDED.read_text(encoding="utf-8")))
    assert list(named) == list(LEVEL_NAMES)
    times = [p["ms"]["median"] for p in named.values()]
    assert times == sorted(times)
    wrong = [p["masks"]["overall"]["percent"] for p in named.values()]
    assert wrong[:4] == sorted(wrong[:4], reverse=True)


def test_balanced_is_the_defaults():
    assert level_settings("balanced") == {n: v for n, v in defaults().items() if v is not None}


@pytest.mark.parametrize("name", LEVEL_NAMES)
def test_each_level_says_what_it_costs_and_loses(name):
    measured = tomllib.loads(LEVELS[name].read_text())["measured"]
    assert measured["ms_per_frame"] > 0 and measured["wrong_percent"]["overall"] >= 0
    assert measured["driver"] and measured["date"] and measured["scene"]


def test_evaluate_uses_a_level(demo, tmp_path):
    command = ["evaluate", str(demo), "--size", "24x14", "--frames", "20:22", "--out", str(tmp_path / "run")]
    done = CliRunner().invoke(cli, [*command, "--quality", "draft", "--shadow-size", "64"])
    assert done.exit_code == 0, done.output
    used = json.loads((tmp_path / "run" / "summary.json").read_text())["settings"]
    wanted = level_settings("draft") | {"shadow_size": 64}
    assert {name: used[name] for name in wanted} == wanted, "options given beside the level take precedence"


def test_preset_and_quality_exclude_each_other(demo, tmp_path):
    both = ["evaluate", str(demo), "--out", str(tmp_path), "--quality", "fast", "--preset", str(LEVELS["fast"])]
    assert isinstance(CliRunner().invoke(cli, both).exception, SettingsError)
