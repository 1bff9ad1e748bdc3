"""The Blender driver with a stand-in for Blender: jobs, resampled scenes, resuming, errors."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
from cycles_scenes import DOWN, LAMP, blinking, fake_blender, plane

from taubench_gl.animation import choose_camera, sample
from taubench_gl.effects.lighting import DEFAULT_SUN
from taubench_gl.errors import OutputError, PathTracedError, SettingsError
from taubench_gl.pathtraced.blender import process
from taubench_gl.pathtraced.blender.job import KEY_FPS, Quality, identity, make_job, write_resampled
from taubench_gl.pathtraced.blender.process import HOW_TO_GET_BPY
from taubench_gl.pathtraced.blender.render import PROVENANCE_FILE, read_render, render_reference
from taubench_gl.pathtraced.cameras import CAMERA_FILE, read_camera_file
from taubench_gl.pathtraced.sequence import find_frames
from taubench_gl.scene import load_scene

TURN = [[0, 0, 0, 1], [0, math.sin(1.5), 0, math.cos(1.5)]]  # by 3 rad: interpolation by component is wrong
MOVE = [[0, 0, 0], [1, 0, 0]]


@pytest.fixture
def scene(tmp_path):
    return load_scene(plane(tmp_path / "plane.glb", [LAMP], keys={"rotation": TURN, "translation": MOVE}))


def render(scene, out, frames=range(0, 3), *, python, size=(16, 9), **quality):
    steps = []
    notes = render_reference(
        scene,
        choose_camera(scene),
        frames,
        out,
        fps=24.0,
        size=size,
        quality=Quality(samples=1, **quality),
        progress=lambda p: steps.append((p.done, p.share)),
        python=python,
    )
    return steps, notes


def test_resampled_scenes_play_the_same_animation(scene, tmp_path):
    folder = tmp_path / "job"
    folder.mkdir()
    frames, fps = range(-1, 14), 25.0
    again = load_scene(write_resampled(scene, frames, fps, folder))
    assert len(again.animations) == 1 and not again.cameras and not again.lights
    for i, frame in enumerate(frames):
        expected, resampled = sample(scene, frame / fps), sample(again, i / KEY_FPS)
        np.testing.assert_allclose(resampled.world[0], expected.world[0], atol=1e-6)
    assert all(c.interpolation == "LINEAR" and len(c.times) == len(frames) for c in again.channels)


def test_resampled_real_scenes_still_load(data, tmp_path):
    for name in ("CesiumMan/CesiumMan.glb", "AnimatedMorphCube/AnimatedMorphCube.glb", "Fox/Fox.gltf"):
        scene = load_scene(data / "khronos" / name)
        folder = tmp_path / name.split("/")[0]
        folder.mkdir()
        path = write_resampled(scene, range(3), 24.0, folder)
        # Files outside the temporary folder are refused by the scene reader: check the keys only.
        root = json.loads(path.read_text())
        assert (
            len(root["animations"]) == 1 and (folder / "keys.bin").stat().st_size == root["buffers"][-1]["byteLength"]
        )
        for item in (*root["buffers"], *root.get("images", ())):
            uri = item.get("uri", "data:")
            assert uri.startswith("data:") or (folder / uri).resolve().is_file()


def test_jobs_have_cameras_and_lights_of_neighboring_frames(scene):
    job, views, notes = make_job(scene, choose_camera(scene), range(2, 4), 24.0, (16, 9), Quality())
    assert sorted(map(int, job["camera"])) == [1, 2, 3, 4] and sorted(views) == [2, 3]
    np.testing.assert_allclose(np.array(job["camera"]["2"]["world_from_view"])[:3, 3], [0, 3, 0])
    (light,) = job["lights"]
    assert light["kind"] == "point" and len(light["frames"]) == 1  # constant: one entry
    assert next(iter(light["frames"].values()))["intensity"] == 10.0 and notes == []
    assert job["camera"]["2"]["zfar"] is None and json.loads(json.dumps(job)) == job


def test_hidden_meshes_and_lights_are_in_the_job(tmp_path):
    """Keys every half second: on, off, on.  A light of scale 0 is off, as a hidden one; hidden meshes are listed."""
    scene = load_scene(blinking(tmp_path / "blink.glb"))
    frames = range(10, 14)
    job, _, notes = make_job(scene, choose_camera(scene), frames, 24.0, (16, 9), Quality())
    assert notes == [] and job["hidden"] == {"12": [0], "13": [0]}
    for light in job["lights"]:
        assert [light["frames"][str(f)]["intensity"] for f in (11, 12)] == [10.0, 0.0]
        assert np.isfinite(light["frames"]["12"]["rotation"]).all()
    folder = tmp_path / "job"
    folder.mkdir()
    root = json.loads(write_resampled(scene, frames, 24.0, folder).read_text())
    assert root["nodes"][0]["name"] == "taubench node 0" and "KHR_node_visibility" not in json.dumps(root)


def test_limits_of_cycles_are_noted(tmp_path):
    spot = {"light": {"type": "spot", "intensity": 1.0, "range": 5.0, "spot": {}}, "node": {"rotation": DOWN}}
    scene = load_scene(plane(tmp_path / "s.glb", [spot]))
    _, _, notes = make_job(scene, choose_camera(scene), range(1), 24.0, (16, 9), Quality())
    assert len(notes) == 2 and "range" in notes[0] and "cone" in notes[1]


def test_a_render_writes_frames_sidecar_and_provenance(scene, tmp_path):
    out = tmp_path / "out"
    steps, _ = render(scene, out, python=fake_blender(tmp_path))
    assert list(find_frames(out)) == [0, 1, 2]
    assert steps[0] == (1, 0.0) or steps[0][1] == 0.5
    assert steps[-1] == (3, 0.0)
    file = read_camera_file(out / CAMERA_FILE)
    assert sorted(file.views) == [0, 1, 2] and file.size == (16, 9) and file.fps == 24.0
    assert json.loads((out / PROVENANCE_FILE).read_text())["blender"] == "4.5.0 stand-in"
    record = read_render(out)
    assert record.frame_seconds == {"0": 0.5, "1": 0.5, "2": 0.5} and record.settings.samples == 1
    assert record.summary(range(1, 3))["seconds_per_frame"] == 0.5
    assert record.summary(range(7, 9))["seconds_per_frame"] is None
    assert read_render(tmp_path) is None
    assert "Blender says hello" in (out / "render.log").read_text()


def test_an_interrupted_render_continues_with_the_first_missing_frame(scene, tmp_path, monkeypatch):
    out, python = tmp_path / "out", fake_blender(tmp_path)
    monkeypatch.setenv("FAKE_STOPS_AFTER", "2")
    with pytest.raises(PathTracedError) as error:
        render(scene, out, range(0, 5), python=python)
    assert error.value.where == str(out / "render.log")
    assert "code 3" in error.value.what and error.value.what.endswith("Error: out of pixels")
    assert list(find_frames(out)) == [0, 1]
    before = {p: os.stat(p).st_mtime_ns for p in out.glob("frame_*.exr")}
    (out / ".frame_0002.exr.partial.exr").write_bytes(b"half")
    (out / "frame_0003.exr").write_bytes(b"broken by someone else")
    monkeypatch.setenv("FAKE_STOPS_AFTER", "99")
    steps, _ = render(scene, out, range(0, 5), python=python)
    assert list(find_frames(out)) == [0, 1, 2, 3, 4] and steps[0][0] in (2, 3) and steps[-1][0] == 5
    assert all(os.stat(p).st_mtime_ns == time for p, time in before.items())
    assert not list(out.glob(".*"))
    assert render(scene, out, range(0, 5), python="no such interpreter")[0] == []  # complete: nothing is started


def test_frames_of_another_job_are_never_mixed(scene, tmp_path):
    out, python = tmp_path / "out", fake_blender(tmp_path)
    render(scene, out, python=python)
    for other in ({"seed": 1}, {"size": (17, 9)}):
        with pytest.raises(PathTracedError) as error:
            render(scene, out, python=python, **other)
        assert error.value.where == str(out)
    render(scene, out, range(3, 5), python=python)
    assert sorted(read_camera_file(out / CAMERA_FILE).views) == [0, 1, 2, 3, 4]


def test_without_bpy_the_error_says_how_to_install_it(scene, tmp_path):
    for python in (str(tmp_path / "none"), "false"):
        with pytest.raises(PathTracedError) as error:
            render(scene, tmp_path / "new" / "out", python=python)
        assert python in error.value.what and error.value.hint == HOW_TO_GET_BPY
    assert not (tmp_path / "new").exists()


def test_invalid_qualities_are_refused():
    for values in ({"samples": 0}, {"bounces": -1}, {"seed": -1}):
        with pytest.raises(SettingsError):
            Quality(**values)


@pytest.mark.parametrize("script", ["render_script.py", "convert_script.py"])
def test_scripts_are_standalone(script):
    folder = Path(process.__file__).parent
    text = (folder / script).read_text(encoding="utf-8")
    beside = {path.stem for path in folder.glob("*.py")}  # on the path of a script that is started
    modules = set(re.findall(r"^(?:import|from) (\w+)", text, flags=re.M))
    assert modules <= {"bpy", "mathutils", *beside, *sys.stdlib_module_names}
    assert "bpy" not in sys.modules


def test_environment_and_scattering_are_part_of_a_render_and_its_identity(scene):
    camera, frames = choose_camera(scene), range(1)

    def job_of(**quality):
        return make_job(scene, camera, frames, 24.0, (16, 9), Quality(**quality))[0]

    plain, sunny = job_of(), job_of(sun=DEFAULT_SUN)
    (entry,) = sunny["lights"][-1]["frames"].values()
    shines = -np.array(entry["rotation"])[:, 2]
    np.testing.assert_allclose(shines, DEFAULT_SUN.direction, atol=1e-12)
    np.testing.assert_allclose(np.multiply(entry["color"], entry["intensity"]), DEFAULT_SUN.irradiance)
    assert len(sunny["lights"]) == len(plain["lights"]) + 1
    jobs = [plain, sunny, job_of(image="a.hdr", image_sha256="1"), job_of(image="a.hdr", image_sha256="2")]
    jobs += [job_of(single_scatter=not Quality().single_scatter)]
    assert len({identity(job, "scene") for job in jobs}) == 5
    moved = job_of(image="elsewhere.hdr", image_sha256="1")
    assert identity(moved, "scene") == identity(jobs[2], "scene")


FAKE_MODULES = {
    "bpy.py": """
import os, sys, time
from unittest.mock import MagicMock
module = MagicMock()
module.app.version_string = "4.5.0 stand-in"
def endless(**options):
    print(f"rendering in {os.getpid()}", flush=True)
    time.sleep(1000)
module.ops.render.render = endless
sys.modules["bpy"] = module
""",
    "mathutils.py": "from unittest.mock import MagicMock\nMatrix = Vector = MagicMock()\n",
}
DRIVER = """
import sys
from taubench_gl.animation import choose_camera
from taubench_gl.pathtraced.blender.job import Quality
from taubench_gl.pathtraced.blender.render import render_reference
from taubench_gl.scene import load_scene
scene = load_scene(sys.argv[1])
render_reference(scene, choose_camera(scene), range(2), sys.argv[2], fps=24.0, size=(16, 9), quality=Quality(samples=1),
                 python=sys.argv[3])
"""


@pytest.mark.parametrize("wrapped", [False, True])
def test_blender_ends_when_its_driver_is_killed(scene, tmp_path, wrapped):
    """Blender ends behind a wrapper script too, which is its parent; meanwhile a second driver is refused."""
    modules, out, python = tmp_path / "modules", tmp_path / "out", sys.executable
    modules.mkdir()
    for name, text in FAKE_MODULES.items():
        (modules / name).write_text(text)
    if wrapped:
        python = tmp_path / "python.sh"
        python.write_text(f'#!/bin/sh\n"{sys.executable}" "$@"\necho ended\n')
        python.chmod(0o755)
    path = os.pathsep.join([str(modules), *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-c", DRIVER, scene.path, out, python]
    with subprocess.Popen(command, env=os.environ | {"PYTHONPATH": path}) as driver:
        log = out / "render.log"
        while not (log.exists() and (started := re.search(r"rendering in (\d+)\n", log.read_text()))):
            with contextlib.suppress(subprocess.TimeoutExpired):
                pytest.fail(f"the driver ended with code {driver.wait(timeout=0.02)}")
        blender = psutil.Process(int(started[1]))
        with pytest.raises(OutputError, match=f"process {driver.pid} "):
            render(scene, out, python="false")
        driver.kill()
    gone, alive = psutil.wait_procs([blender], timeout=60)
    for survivor in alive:
        survivor.kill()
    assert gone and not alive
    frames = range(0, 2)
    assert render(scene, out, frames, python=fake_blender(tmp_path))[0][-1] == (2, 0.0)
    assert not list(out.glob(".*"))
