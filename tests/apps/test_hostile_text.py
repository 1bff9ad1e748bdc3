"""Text from files on the terminal and in tables: no commands of terminals, no formulas; hostile presets and specs."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import pytest

from taubench_gl.paths import PACKAGE

sys.path.append(str(Path(__file__).parents[1] / "scene"))
from gltf_files import glb, read_parts

pytestmark = pytest.mark.usefixtures("coarse_light", "coarse_metering")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
EVIL = "\x1b[2J\x1b]0;owned\x07\x9b31m"
SMALL = ("--size", "32x18", "--frames", "0:3", "--columns", "frustum,position")


def with_names(path: Path, prefix: str) -> Path:
    """The demo scene; ``prefix`` is put before every name in it."""
    root, blob = read_parts(DEMO)
    for values in root.values():
        for one in values if isinstance(values, list) else ():
            if isinstance(one, dict):
                one["name"] = prefix + one.get("name", "unnamed")
    for light in root["extensions"]["KHR_lights_punctual"]["lights"]:
        light["name"] = prefix + light.get("name", "light")
    root["asset"]["generator"] = prefix
    path.write_bytes(glb(json.dumps(root).encode(), blob))
    return path


def control_characters(text: str) -> set[str]:
    return {c for c in text if not c.isprintable() and c not in "\n\t"}


@pytest.mark.parametrize(
    "command",
    [
        ("inspect",),
        ("evaluate", *SMALL),
        ("evaluate", *SMALL, "--light-unit", "auto"),
        ("evaluate", *SMALL, "--camera", "missing"),
        ("export", "--frames", "0:1"),
    ],
    ids=lambda command: command[0],
)
def test_names_do_not_control_the_terminal(taubench, tmp_path, command):
    scene = with_names(tmp_path / f"{EVIL[:4]}.glb", EVIL)
    out = ("--out", tmp_path / "out") if command[0] == "export" else ()
    _, printed, errors = taubench(command[0], scene, *command[1:], *out)
    assert not control_characters(printed) and not control_characters(errors)
    assert printed or errors


def test_tables_of_hostile_names_hold_no_formula(taubench, tmp_path):
    scene = with_names(tmp_path / "=HYPERLINK(1).glb", "=1+1")
    code, _, errors = taubench("evaluate", scene, *SMALL, "--out", tmp_path / "out")
    assert code == 0, errors
    rows = list(csv.reader((tmp_path / "out" / "tables.csv").read_text().splitlines()))
    cells = [cell for row in rows for cell in row if cell.startswith(("=", "+", "-", "@"))]
    for cell in cells:
        float(cell)
    assert any("'=HYPERLINK" in cell for row in rows for cell in row)


PRESET = 'schema = "taubench-gl/preset/1"\n[settings]\n'


HOSTILE = (
    [PRESET + 'thresholds = "x"', PRESET + "thresholds = [1]", PRESET + "thresholds = { normal = nan }",
     PRESET + "width = " + "9" * 5000, PRESET + "width = 1e400", PRESET + "exposure = " + "1" + "0" * 300,
     "a = " + "[" * 100_000, "settings." + "a." * 5000 + "b = 1", PRESET + "columns = [[[1]]]",
     PRESET + 'camera = { x = "y" }', PRESET + "fps = inf", "\0"]
)  # fmt: skip


@pytest.mark.parametrize("text", [*HOSTILE, "schema = 5", ""], ids=range(len(HOSTILE) + 2))
def test_hostile_presets_and_specs_are_one_line(taubench, tmp_path, text):
    """A spec without settings is valid."""
    preset, spec = tmp_path / "preset.toml", tmp_path / "spec.toml"
    preset.write_text(text)
    spec.write_text(f'scenes = ["{DEMO}"]\n' + text.removeprefix(PRESET))
    commands = [("evaluate", DEMO, *SMALL, "--preset", preset), ("batch", "run", spec, "--out", tmp_path / "out")]
    for command in commands[: 1 if text not in HOSTILE else 2]:
        code, printed, errors = taubench(*command)
        assert code == 2 and not printed and errors.startswith("taubench-gl: error: ") and errors.count("\n") == 1
    assert not (tmp_path / "out").exists()
