"""``taubench-gl batch``: invalid input ends with one line and exit code 2; folders, changed scenes and specs."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from batch_tools import DEMO, SMALL, spec_of, write_spec

from taubench_gl.batch.study import batch_status, run_batch
from taubench_gl.errors import OutputError, TaubenchError
from taubench_gl.scene import load_scene
from taubench_gl.study import engines

sys.path.append(str(Path(__file__).parents[1] / "scene"))
from gltf_files import glb, read_parts


@pytest.fixture
def refused(taubench) -> Callable[..., str]:
    """refused(arguments) -> the one line with which a command ends that writes nothing."""

    def line(*arguments: object) -> str:
        code, _, err = taubench(*arguments)
        assert code == 2 and err.count("\n") == 1 and "Errno" not in err
        return err

    return line


def test_invalid_spec_writes_nothing(tmp_path, refused):
    spec = write_spec(tmp_path, 'scenes = ["gone.glb"]\nfps = -1')
    line = refused("batch", spec, "--out", tmp_path / "out")
    assert "gone.glb" in line and "fps" in line and not (tmp_path / "out").exists()


@pytest.mark.parametrize("options", [{"workers": -1}, {"workers": 100000}, {"chunk": 0}], ids=str)
def test_invalid_numbers_are_refused_before_anything_is_written(tmp_path, options):
    spec = spec_of(tmp_path, f'scenes = ["{DEMO}"]\n{SMALL}')
    with pytest.raises(TaubenchError) as caught:
        run_batch(spec, tmp_path / "out", **options)
    assert caught.value.hint and not (tmp_path / "out" / "study.json").exists()


@pytest.mark.parametrize("command", ["status", "resume", "report"])
def test_folders_without_a_batch_are_refused(tmp_path, refused, command):
    for folder in (tmp_path, tmp_path / "gone", DEMO):
        assert str(folder) in refused("batch", command, folder)
    assert not (tmp_path / "gone").exists()
    for text in ("[]", "{", "\x00"):
        (tmp_path / "study.json").write_text(text)
        assert "study.json" in refused("batch", command, tmp_path)


def test_a_folder_with_other_files_is_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(OutputError) as caught:
        run_batch(spec_of(tmp_path, f'scenes = ["{DEMO}"]'), tmp_path)
    assert caught.value.where == str(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["spec.toml", "thesis.tex"]


def test_a_folder_of_a_driver_killed_at_its_start_is_usable_by_its_version_alone(tmp_path, monkeypatch):
    """Logs and the lock are written before the spec."""
    (tmp_path / "out" / "logs").mkdir(parents=True)
    for name in (".lock", ".study.json.123-0.partial"):
        (tmp_path / "out" / name).touch()
    spec = spec_of(tmp_path, f'scenes = ["{DEMO}"]\nframes = "0:1"\n{SMALL}')
    assert run_batch(spec, tmp_path / "out").summary["done"] == 1
    monkeypatch.setattr("taubench_gl.study.store.__version__", "99")
    with pytest.raises(OutputError, match="99"):
        run_batch(None, tmp_path / "out")


def test_a_scene_added_to_the_spec_is_the_only_one_evaluated(tmp_path):
    text = f'frames = "0:3"\n{SMALL}scenes = ["{DEMO}"'
    first = run_batch(spec_of(tmp_path, f"{text}]"), tmp_path / "out").summary["jobs"][0]["id"]
    file = tmp_path / "out" / "jobs" / first / "summary.json"
    done = file.stat().st_mtime_ns
    (tmp_path / "other.glb").write_bytes(DEMO.read_bytes())
    both = run_batch(spec_of(tmp_path, f'{text}, "other.glb"]'), tmp_path / "out")
    assert both.summary["done"] == 2 and file.stat().st_mtime_ns == done


def test_worker_processes_share_the_cores(monkeypatch):
    monkeypatch.setattr(engines, "available_cores", lambda: 8)
    for name in engines.THREADS_VARIABLES:
        monkeypatch.delenv(name, raising=False)
        assert [engines.worker_environment(n)[name] for n in (1, 2, 3, 8, 20)] == ["8", "4", "2", "1", "1"]
    monkeypatch.setenv("LP_NUM_THREADS", "5")
    assert engines.worker_environment(4)["LP_NUM_THREADS"] == "5"


def test_compare_of_a_batch_names_batch_report(tmp_path, refused):
    (tmp_path / "summary.json").write_text('{"schema": "taubench-gl/batch/4"}')
    assert "batch report" in refused("compare", tmp_path)


def split_demo(folder: Path, name: str = "demo.gltf") -> tuple[Path, dict]:
    """The demo as .gltf or .glb with its buffer in a separate file, and its JSON."""
    root, blob = read_parts(DEMO)
    root["buffers"][0]["uri"] = "demo.bin"
    (folder / "demo.bin").write_bytes(blob)
    text = json.dumps(root).encode()
    (folder / name).write_bytes(glb(text) if name.endswith(".glb") else text)
    return folder / name, root


@pytest.mark.parametrize("name", ["demo.gltf", "demo.glb"])
def test_a_change_of_a_separate_buffer_is_detected(tmp_path, name):
    """The scene file itself is unchanged.  A finished job stays finished if the scene's files are missing."""
    scene, root = split_demo(tmp_path, name)
    spec = spec_of(tmp_path, f'scenes = ["{scene}"]\nframes = "0:3"\n{SMALL}')
    first = run_batch(spec, tmp_path / "out").summary["jobs"][0]
    blob = bytearray((tmp_path / "demo.bin").read_bytes())
    normals = root["accessors"][root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]]
    at = root["bufferViews"][normals["bufferView"]].get("byteOffset", 0) + normals.get("byteOffset", 0)
    blob[at] ^= 1  # the last bit of a normal
    (tmp_path / "demo.bin").write_bytes(blob)
    again = run_batch(spec, tmp_path / "out")
    assert not again.failed and again.summary["jobs"][0]["id"] == first["id"]
    job = tmp_path / "out" / "jobs" / first["id"]
    assert json.loads((job / "summary.json").read_text())["scene"]["sha256"] == load_scene(scene).sha256
    for _ in range(2):
        (status,) = batch_status(tmp_path / "out")[2]
        assert (status.state, status.done, status.total) == ("done", 2, 2)
        scene.unlink(missing_ok=True)
