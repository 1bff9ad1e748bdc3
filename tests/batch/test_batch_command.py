"""Wrong input of ``taubench-gl batch``: one line, exit code 2, nothing written."""

from __future__ import annotations

import fcntl
import json
import struct
from pathlib import Path

import pytest
from batch_tools import DEMO, SMALL, study_of, write_study

from taubench_gl.apps import cli
from taubench_gl.batch.lock import FolderLock, holder
from taubench_gl.batch.run import make_engine, run_study, study_status
from taubench_gl.errors import OutputError, SettingsError, TaubenchError
from taubench_gl.scene import load_scene


def taubench(capsys, *arguments):
    with pytest.raises(SystemExit) as caught:
        cli.main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return caught.value.code, out, err


def test_a_bad_study_writes_nothing(tmp_path, capsys):
    study = write_study(tmp_path, 'scenes = ["gone.glb"]\nfps = -1')
    code, _, err = taubench(capsys, "batch", study, "--out", tmp_path / "out")
    assert code == 2 and err.count("\n") == 1
    assert "2 faults" in err and "gone.glb" in err and "fps" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--engine", "slurm"), "no engine is named 'slurm'"),
        (("--workers", "0"), "workers is 0"),
        (("--workers", "100000"), "workers is 100000 (give at most"),
        (("--chunk", "0"), "chunk is 0"),
        (("--engine", "dask://host:1", "--workers", "2"), "a cluster has the workers it has"),
        (("--engine", "dask://not a host"), "no Dask scheduler answers"),
    ],
)
def test_engines_that_are_none(tmp_path, capsys, arguments, complaint):
    study = write_study(tmp_path, f'scenes = ["{DEMO}"]\n{SMALL}')
    code, _, err = taubench(capsys, "batch", study, "--out", tmp_path / "out", *arguments)
    assert code == 2 and complaint in err and err.count("\n") == 1


@pytest.mark.parametrize("command", ["status", "resume", "report"])
def test_folders_that_hold_no_batch(tmp_path, capsys, command):
    for folder, complaint in (
        (tmp_path, "holds no batch"),
        (tmp_path / "gone", "does not exist"),
        (DEMO, "is not a folder"),
    ):
        code, _, err = taubench(capsys, "batch", command, folder)
        assert code == 2 and complaint in err and err.count("\n") == 1
        assert "Errno" not in err
    assert not (tmp_path / "gone").exists()


@pytest.mark.parametrize("text", ["[]", "{", "\x00"])
def test_a_damaged_study_is_one_line(tmp_path, capsys, text):
    (tmp_path / "study.json").write_text(text)
    code, _, err = taubench(capsys, "batch", "status", tmp_path)
    assert code == 2 and "is damaged" in err and err.count("\n") == 1


def test_other_peoples_folders_are_left_alone(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(OutputError, match="holds other files and no batch"):
        run_study(study_of(tmp_path, f'scenes = ["{DEMO}"]'), tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["study.toml", "thesis.tex"]


def test_what_a_killed_start_leaves_is_no_other_peoples_folder(tmp_path):
    """Workers' logs and the lock are there before the study is: a driver killed then must not lock its folder out."""
    (tmp_path / "out" / "logs").mkdir(parents=True)
    for name in (".lock", ".study.json.123-0.partial"):
        (tmp_path / "out" / name).touch()
    study = study_of(tmp_path, f'scenes = ["{DEMO}"]\nframes = "0:1"\n{SMALL}')
    assert run_study(study, tmp_path / "out").summary["done"] == 1


def test_an_engine_that_does_not_start_leaves_no_study(tmp_path):
    study = study_of(tmp_path, f'scenes = ["{DEMO}"]\n{SMALL}')
    with pytest.raises(TaubenchError, match="no Dask scheduler answers"):
        run_study(study, tmp_path / "out", engine="dask://not a host")
    assert not (tmp_path / "out" / "study.json").exists()


def test_another_version_is_not_mixed_in(tmp_path, monkeypatch):
    study = study_of(tmp_path, f'scenes = ["{DEMO}"]\nframes = "0:1"\n{SMALL}')
    run_study(study, tmp_path / "out")
    monkeypatch.setattr("taubench_gl.batch.store.__version__", "99")
    with pytest.raises(OutputError, match=r"was begun by taubench-gl .*, this is 99"):
        run_study(None, tmp_path / "out")


def test_one_driver_at_a_time(tmp_path):
    with FolderLock(tmp_path):
        assert holder(tmp_path).startswith("process ")
        with pytest.raises(OutputError, match=r"process .* is working here"), FolderLock(tmp_path):
            pass
    assert holder(tmp_path) is None
    with FolderLock(tmp_path):
        pass


def test_a_grown_study_keeps_what_is_done(tmp_path):
    """Another scene in the study: only it is evaluated, and the summary holds both."""
    text = f'frames = "0:3"\n{SMALL}scenes = ["{DEMO}"'
    first = run_study(study_of(tmp_path, f"{text}]"), tmp_path / "out")
    done = (tmp_path / "out" / "jobs" / first.summary["jobs"][0]["id"] / "summary.json").stat().st_mtime_ns
    (tmp_path / "other.glb").write_bytes(DEMO.read_bytes())
    both = run_study(study_of(tmp_path, f'{text}, "other.glb"]'), tmp_path / "out")
    assert both.summary["done"] == 2
    again = (tmp_path / "out" / "jobs" / first.summary["jobs"][0]["id"] / "summary.json").stat().st_mtime_ns
    assert again == done


def test_threads_are_shared_out(monkeypatch):
    from taubench_gl.batch.engines import processes

    monkeypatch.setattr(processes, "available_cores", lambda: 8)
    monkeypatch.delenv("LP_NUM_THREADS", raising=False)
    assert [processes.worker_environment(n)["LP_NUM_THREADS"] for n in (1, 2, 3, 8, 20)] == ["8", "4", "2", "1", "1"]
    monkeypatch.setenv("LP_NUM_THREADS", "5")
    assert processes.worker_environment(4)["LP_NUM_THREADS"] == "5"


def test_engine_names(tmp_path):
    from taubench_gl.batch.engines.cluster import DaskCluster

    assert make_engine("dask://a:1", None, tmp_path, print)._address == "tcp://a:1"
    assert isinstance(make_engine("dask-local", 3, tmp_path, print), DaskCluster)
    with pytest.raises(SettingsError, match=r"choose from dask://HOST:PORT"):
        make_engine("dask", None, tmp_path, print)


def test_a_batch_is_no_run_and_is_told_apart(tmp_path, capsys):
    (tmp_path / "summary.json").write_text('{"schema": "taubench-gl/batch/1"}')
    code, _, err = taubench(capsys, "compare", tmp_path)
    assert code == 2 and "batch report" in err and err.count("\n") == 1


def test_a_look_at_the_folder_stops_no_driver(tmp_path, monkeypatch):
    real, seen = fcntl.flock, []

    def busy_once(file, operation):
        if operation & fcntl.LOCK_EX and not seen:
            seen.append(operation)
            raise BlockingIOError
        return real(file, operation)

    monkeypatch.setattr(fcntl, "flock", busy_once)
    with FolderLock(tmp_path):
        assert seen and holder(tmp_path) is not None
    assert holder(tmp_path) is None


def split_demo(folder: Path, name: str = "demo.gltf") -> tuple[Path, dict]:
    """The demo, .gltf or .glb, with its buffer in a file of its own; and its JSON."""
    data = DEMO.read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    root = json.loads(data[20 : 20 + length])
    root["buffers"][0]["uri"] = "demo.bin"
    (folder / "demo.bin").write_bytes(data[28 + length :])
    text = json.dumps(root).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4s4I", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A)  # version, bytes, chunk, "JSON"
    (folder / name).write_bytes(head + text if name.endswith(".glb") else text)
    return folder / name, root


@pytest.mark.parametrize("name", ["demo.gltf", "demo.glb"])
def test_a_buffer_that_changed_beside_its_scene_is_noticed(tmp_path, name):
    """The file itself is as it was: only reading its buffers tells."""
    scene, root = split_demo(tmp_path, name)
    study = study_of(tmp_path, f'scenes = ["{scene}"]\nframes = "0:3"\n{SMALL}')
    first = run_study(study, tmp_path / "out").summary["jobs"][0]
    blob = bytearray((tmp_path / "demo.bin").read_bytes())
    normals = root["accessors"][root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]]
    at = root["bufferViews"][normals["bufferView"]].get("byteOffset", 0) + normals.get("byteOffset", 0)
    blob[at] ^= 1  # the last bit of a normal
    (tmp_path / "demo.bin").write_bytes(blob)
    again = run_study(study, tmp_path / "out")
    assert not again.failed and again.summary["jobs"][0]["id"] == first["id"]
    job = tmp_path / "out" / "jobs" / first["id"]
    assert json.loads((job / "summary.json").read_text())["scene"]["sha256"] == load_scene(scene).sha256


def test_status_needs_no_scene(tmp_path):
    """A finished job is finished, also where the scene's files cannot be seen or are not one file."""
    scene, _ = split_demo(tmp_path)
    run_study(study_of(tmp_path, f'scenes = ["{scene}"]\nframes = "0:3"\n{SMALL}'), tmp_path / "out")
    for _ in range(2):
        (status,) = study_status(tmp_path / "out")[2]
        assert (status.state, status.done, status.total) == ("done", 2, 2)
        scene.unlink(missing_ok=True)
