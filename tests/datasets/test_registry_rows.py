"""Every scene of the registry: ``scenes get`` and ``evaluate`` by name, on a small file of its format."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from repeated import few
from row_files import SECONDS, row_file

from taubench_gl.apps.cli import cli
from taubench_gl.datasets.registry import Entry, load_registry
from taubench_gl.datasets.scene_cache import CachedScene, find_named, scene_text
from taubench_gl.errors import DatasetError
from taubench_gl.pathtraced.blender.process import INTERPRETER, blender_python, blender_version
from taubench_gl.report.paper import paper_numbers
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.usefixtures("coarse_metering", "fixed_light")

ENTRIES = {name: entry for name, entry in load_registry().items() if entry.recording is None}
ROWS = few(sorted(ENTRIES, key=lambda name: ENTRIES[name].format == "fbx"), 3)
PAPER = {scene["name"]: scene for scene in paper_numbers()["scenes"]}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """One file per format and scene name; Blender writes the FBX file once."""
    files: dict[tuple[str, str | None], Path] = {}

    def make(entry: Entry) -> Path:
        key = entry.format, entry.scene
        if key not in files:
            blender = blender_python() if entry.format == "fbx" else None
            if blender is not None and blender_version(blender) is None:
                pytest.skip(f"no bpy in {INTERPRETER} or this interpreter")
            files[key] = row_file(entry, tmp_path_factory.mktemp("rows"), blender)
        return files[key]

    return make


def run(*words: str):
    return CliRunner().invoke(cli, words, catch_exceptions=False)


@pytest.mark.parametrize("name", ROWS)
def test_scene_by_name_gives_tables(name, made, gpu, tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    entry = ENTRIES[name]
    got = run("scenes", "get", name, "--from", str(made(entry)), "--accept-license")
    assert got.exit_code == 0 and f"taubench-gl evaluate {name}" in got.output, got.output
    done = run("evaluate", name, "--size", "32x18", "--indirect", "rsm", "--shadow-size", "64", "--out", "out")
    assert done.exit_code == 0, done.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    fps = entry.fps or 24.0
    settings = summary["settings"]
    assert settings["fps"] == fps and settings["unit_scale"] == entry.unit_scale
    assert summary["pairs"] == round(SECONDS * fps)
    if entry.camera is not None:
        assert entry.camera in summary["camera"]["source"]
    # Table 1: one object or its vertices move.  Tables 2 and 3: the camera moves by 1 m.
    census = summary["census"]
    moved = "morphs_dynamic" if entry.format == "obj sequence" else "dynamic_rigid_objects"
    assert census[moved] == 1 and census["static_point_lights"] == (0 if entry.format == "obj sequence" else 1)
    if entry.format != "obj sequence":
        travelled = summary["camera"]["position"]["mean"] * summary["pairs"]
        whole = 1.2 if entry.format == "fbx" else 1.0
        assert travelled == pytest.approx(whole * summary["pairs"] / (fps * SECONDS), rel=1e-3)
    # Table 4: measured if the scene has light, otherwise null with a reason.
    for column, found in summary["discard"].items():
        lit = entry.format != "obj sequence" or column in ("frustum", "position", "normal")
        assert (found["mean_percent"] is not None) == lit and (lit or found["reason"]), column
    assert summary["discard"]["position"]["mean_percent"] > 0.0
    assert ("  " + entry.paper if entry.paper else "Toasters") in (tmp_path / "out" / "tables.txt").read_text()
    assert entry.paper is None or entry.paper in PAPER


def test_options_override_the_registry(made, gpu, tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    assert run("scenes", "get", "BART-Kitchen", "--from", str(made(ENTRIES["bart-kitchen"])), "--accept-license")
    words = ["evaluate", "scene:BartKitchen", "--size", "32x18", "--columns", "frustum", "--out", "out"]
    assert run(*words, "--fps", "12", "--unit-scale", "2").exit_code == 0
    settings = json.loads((tmp_path / "out" / "summary.json").read_text())["settings"]
    assert (settings["fps"], settings["unit_scale"], settings["first_frame"], settings["last_frame"]) == (12, 2, 0, 3)
    assert "fps" in (shown := run("inspect", "bart-kitchen", "--json").output) and json.loads(shown)["fps"] == 40


def test_settings_of_a_user_registry_apply(made, gpu, tmp_path, monkeypatch):
    (tmp_path / "mine.toml").write_text(
        '[my-hall]\ntitle = "Hall"\nformat = "gltf"\nfps = 30.0\nframes = [2, 6]\ncamera = "eye"\nunit_scale = 100.0\n'
    )
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("TAUBENCH_SCENES", str(tmp_path / "mine.toml"))
    monkeypatch.chdir(tmp_path)
    run("scenes", "get", "my-hall", "--from", str(made(ENTRIES["eternal-valley-fps"])), "--accept-license")
    done = run("evaluate", "my-hall", "--size", "32x18", "--columns", "frustum,position", "--out", "out")
    assert done.exit_code == 0, done.output
    settings = json.loads((tmp_path / "out" / "summary.json").read_text())["settings"]
    assert (settings["fps"], settings["first_frame"], settings["last_frame"]) == (30, 2, 5)
    assert settings["unit_scale"] == 100 and settings["thresholds"]["position"] == 32 / 255
    (tmp_path / "mine.toml").write_text((tmp_path / "mine.toml").read_text().replace('"eye"', '"orbit"'))
    assert "orbit" in json.loads(run("inspect", "my-hall", "--json").output)["camera"]


def test_names_and_paths(tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    for text in ("toasters.glb", "./toasters", "exr:toasters", "nothing-of-ours", ""):
        assert find_named(text) is None, text
    assert find_named("Toasters").name == "toasters"
    with pytest.raises(DatasetError, match=r"toasters .*taubench-gl scenes get"):
        scene_text(find_named("toasters"))
    (tmp_path / "toasters").mkdir()
    assert find_named("toasters") is None and find_named("scene:toasters").name == "toasters"
    with pytest.raises(DatasetError, match="'toaster'"):
        find_named("scene:toaster")


def test_sequence_has_the_rate_of_its_entry(made, tmp_path):
    cached = CachedScene("quick", Entry(title="x", format="obj sequence", fps=48.0), tmp_path)
    cached.take(made(ENTRIES["toasters"]))
    assert load_scene(scene_text(cached)).duration == pytest.approx(0.125)


def test_a_recorded_game_is_made_not_downloaded(tmp_path):
    with pytest.raises(DatasetError):
        run("scenes", "get", "arena-human", "--from", str(tmp_path / "x.glb"), "--accept-license")
