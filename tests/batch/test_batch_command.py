"""Wrong input of ``taubench-gl batch``: one line, exit code 2, nothing written."""

from __future__ import annotations

import pytest
from batch_tools import DEMO, SMALL, study_of, write_study

from taubench_gl.apps import cli
from taubench_gl.batch.lock import FolderLock, holder
from taubench_gl.batch.run import make_engine, run_study
from taubench_gl.errors import OutputError, SettingsError


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
    for folder, complaint in ((tmp_path, "holds no batch"), (tmp_path / "gone", "does not exist")):
        code, _, err = taubench(capsys, "batch", command, folder)
        assert code == 2 and complaint in err and err.count("\n") == 1
    assert not (tmp_path / "gone").exists()


def test_other_peoples_folders_are_left_alone(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(OutputError, match="holds other files and no batch"):
        run_study(study_of(tmp_path, f'scenes = ["{DEMO}"]'), tmp_path)


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
