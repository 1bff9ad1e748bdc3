"""The command line: help without OpenGL, doctor, compare, inspect, exit codes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
import types

import pytest
from click.testing import CliRunner

from taubench_gl.apps.cli import cli
from taubench_gl.datasets.gltf_from_scene import write_scene
from taubench_gl.errors import GraphicsError
from taubench_gl.paths import PACKAGE
from taubench_gl.run import Run, RunWriter
from taubench_gl.run_schema import COUNT_COLUMNS
from taubench_gl.selftest.scenes import SceneBuilder, quad

pytestmark = pytest.mark.usefixtures("coarse_metering")

REPORT = {
    "backend": "egl",
    "renderer": "llvmpipe [x]",
    "vendor": "Mesa",
    "version": "4.5",
    "glsl": "4.50",
    "limits": {"texture size": 16384},
    "timer": {"usable": False, "why": "reads 1 ns"},
    "libraries": {"numpy": "2.0", "glfw": None},
    "backends": {"egl": {"usable": True, "why": "works"}, "osmesa": {"usable": False, "why": "libOSMesa is absent"}},
}


def fresh(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *command], capture_output=True, text=True, timeout=120)


def test_help_needs_no_opengl_and_no_numpy():
    code = """
import sys
from taubench_gl.apps.cli import main
for command in ([], ["doctor"], ["inspect"], ["evaluate"], ["compare"]):
    try:
        main([*command, "--help"])
    except SystemExit as ended:
        assert ended.code in (0, None)
    heavy = {"moderngl", "numpy", "matplotlib", "rich"} & set(sys.modules)
    assert not heavy, (command, heavy)
import taubench_gl.api, taubench_gl.evaluation
from taubench_gl.viewer import state, actions, engine
assert not {"glfw", "imgui_bundle"} & set(sys.modules), "libraries of the viewer extra"
"""
    done = fresh("-c", code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Examples:") == 5


def test_a_closed_pipe_is_no_traceback(tmp_path):
    with RunWriter(tmp_path) as writer:
        writer.write_summary({"schema": "taubench-gl/summary/2", "pairs": 0})
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "taubench_gl", "compare", str(tmp_path)]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, timeout=120)
    os.close(write)
    assert done.returncode == 1 and done.stderr == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a file that is always full")
@pytest.mark.parametrize(
    ("command", "buffered"), [(("--version",), "1"), (("scenes", "list"), ""), (("doctor", "--help"), "")]
)
def test_output_on_a_full_disk_is_one_line(command, buffered):
    environment = os.environ | {"PYTHONUNBUFFERED": buffered}
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "taubench_gl", *command],
            stdout=full, stderr=subprocess.PIPE, text=True, timeout=120, env=environment,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("taubench-gl: error: ") and done.stderr.count("\n") == 1


@pytest.fixture
def gpu(monkeypatch):
    module = types.ModuleType("taubench_gl.gpu.capabilities")

    def capability_report(backend, device):
        if backend == "osmesa":
            raise GraphicsError("no OpenGL 4.5 context", hint="install it")
        if backend == "egl":
            raise KeyboardInterrupt
        return REPORT

    module.capability_report = capability_report
    monkeypatch.setitem(sys.modules, "taubench_gl.gpu.capabilities", module)


def test_doctor_prints_the_report(taubench, gpu):
    code, out, _ = taubench("doctor")
    assert code == 0
    for text in ("llvmpipe [x]", "16384", "reads 1 ns", "libOSMesa is absent"):
        assert text in out
    assert json.loads(taubench("doctor", "--json")[1]) == REPORT


def test_doctor_without_opengl(taubench, gpu):
    code, out, err = taubench("doctor", "--backend", "osmesa")
    assert (code, out) == (2, "") and err.count("\n") == 1


def test_an_interrupted_command_is_exit_code_130(taubench, gpu):
    code, out, err = taubench("doctor", "--backend", "egl")
    assert (code, out) == (130, "") and "Traceback" not in err


@pytest.fixture
def stored(tmp_path):
    for name in ("one", "two"):
        discard = {"frustum": {"mean_percent": 12.5}}
        scene = {"schema": "taubench-gl/summary/2", "scene": {"name": name}, "pairs": 1, "discard": discard}
        counts = dict.fromkeys(COUNT_COLUMNS, 0) | {"pixels": 8, "outside": 1, "frustum": 1, "comparable": 7}
        Run(scene, [counts | {"frame": 1}]).save(tmp_path / name)
    return [tmp_path / "one", tmp_path / "two"]


def test_compare_lists_every_run(taubench, stored, tmp_path):
    code, out, _ = taubench("compare", *stored)
    assert code == 0
    assert "one" in out and "two" in out and "Emerald Square" in out
    _, without, _ = taubench("compare", *stored, "--no-paper")
    assert "Emerald Square" not in without
    code, out, err = taubench("compare", tmp_path / "gone")
    assert (code, out) == (2, "") and "gone" in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("look", "start"),
    [("markdown", "**Table 1"), ("csv", "table,row,source"), ("latex", "% needs"), ("html", "<div")],
)
def test_compare_formats(taubench, stored, look, start):
    code, out, _ = taubench("compare", stored[0], "--format", look)
    assert code == 0 and start in out and "12.5" in out


def hall(path):
    """A scene file with a square, a moving camera and a point light."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad()), translation=(1.0, 1.0, 0.0))
    b.light(kind="point", name="lamp", intensity=7.0)
    b.animate(b.camera(name="eye", yfov=1.0, znear=0.1), "translation", [0.0, 0.5], [(0, 0, 5), (0, 0, 6)])
    write_scene(b.build(), path)
    return path


def test_inspect(taubench, tmp_path):
    code, out, err = taubench("inspect", hall(tmp_path / "hall.glb"))
    assert code == 0, err
    for text in ("0.500 s, 13 frames at 24 fps", "static rigid objects", "kind perspective", "name lamp"):
        assert text in out
    code, out, err = taubench("inspect", tmp_path / "hall.glb", "--json")
    assert code == 0, err
    facts = json.loads(out)
    assert facts["duration_s"] == 0.5 and facts["frames"] == 13
    assert [(a["duration_s"], a["channels"], a["plays"]) for a in facts["animations"]] == [(0.5, 1, True)]
    assert facts["cameras"][0]["name"] == "eye"
    assert facts["lights"][0]["intensity"] == 7 and facts["lights"][0]["unit"] == "cd"
    assert facts["census"]["static_rigid_objects"] == 1 and facts["census"]["static_point_lights"] == 1
    assert facts["bounds"] == {"center": [1, 1, 0], "radius_m": pytest.approx(2**0.5)}


def test_inspect_without_opengl_prints_no_exposure(taubench, tmp_path, monkeypatch):
    def none(*_):
        raise GraphicsError("no OpenGL")

    monkeypatch.setattr("taubench_gl.evaluation.exposure.opened_gpu", none)
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))  # which has no exposure of the scene
    code, out, err = taubench("inspect", hall(tmp_path / "hall.glb"), "--json")
    assert code == 0, err
    facts = json.loads(out)
    assert facts["exposure"]["value"] is None and facts["exposure"]["reason"]
    assert facts["frames"] == 13


def console_script() -> str:
    """The Python code that the installed ``taubench-gl`` runs."""
    scripts = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    module, _, function = scripts["taubench-gl"].partition(":")
    return f"import sys; from {module} import {function}; sys.exit({function}())"


STARTS = pytest.mark.parametrize(
    "start", [["-m", "taubench_gl"], ["-c", console_script()]], ids=["module", "console script"]
)


@STARTS
def test_module_and_console_script_run_the_command_line(start):
    done = fresh(*start, "--version")
    assert done.returncode == 0 and done.stdout.startswith("taubench-gl, version"), done.stderr


@STARTS
def test_an_interrupt_while_importing_is_no_traceback(tmp_path, start):
    """Ctrl-C before the command line is imported."""
    (tmp_path / "click.py").write_text("raise KeyboardInterrupt\n")
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, *start, "doctor"],
        capture_output=True, text=True, timeout=120, env=os.environ | {"PYTHONPATH": paths},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


@pytest.mark.parametrize("group", [(), ("reuse",), ("scenes",)])
def test_help_lists_every_command_with_its_whole_sentence(group):
    command = cli
    for name in group:
        command = command.commands[name]
    shown = " ".join(CliRunner().invoke(cli, [*group, "--help"]).output.split())
    for name, one in command.commands.items():
        assert f"{name} {one.get_short_help_str(1000)}" in shown
