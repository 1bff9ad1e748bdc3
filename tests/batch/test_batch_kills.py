"""Processes killed with SIGKILL at any moment: the batch ends with the same files."""

from __future__ import annotations

import json
import os
import shutil
import signal
from pathlib import Path

import psutil
import pytest
from batch_tools import DEMO, SMALL, batch_process, final_files, wait_until, write_spec

from taubench_gl.folder_lock import lock_holder

PATIENCE = 300


def partitions(out: Path) -> int:
    return len(list(out.glob("records/*/pairs-*.json")))


def test_killed_driver(reference, tmp_path):
    """The workers of a killed driver end, its lock is released, and resume writes the same files."""
    spec, expected = reference
    out = tmp_path / "out"
    driver = batch_process(spec, "--out", out, "--workers", "1", "--chunk", "1")
    wait_until(lambda: partitions(out) >= 2, driver)
    os.kill(driver.pid, signal.SIGSTOP)  # it holds its lock and makes no progress
    code, _, errors = finished(batch_process("resume", out))
    assert code == 2 and f"process {driver.pid} on " in errors and errors.count("\n") == 1
    code, printed, _ = finished(batch_process("status", out))
    assert code == 0 and f"process {driver.pid}" in printed and " part " in printed
    workers = psutil.Process(driver.pid).children()
    os.kill(driver.pid, signal.SIGKILL)
    driver.communicate(timeout=PATIENCE)
    gone, alive = psutil.wait_procs(workers, timeout=PATIENCE)
    assert gone and not alive
    kept = partitions(out)
    assert 2 <= kept < 30 and not (out / "summary.json").exists() and lock_holder(out) is None
    assert finished(batch_process("resume", out))[0] == 0
    assert final_files(out) == expected
    assert partitions(out) > kept


def finished(process) -> tuple[int, str, str]:
    """Exit code, output and errors of a process that ends by itself."""
    printed, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, printed, errors


def test_scenes_that_fail_or_kill_their_worker_fail_alone(tmp_path):
    """One scene is truncated, one kills its worker each time, the third is evaluated."""
    shutil.copy(DEMO, tmp_path / "crash.glb")
    (tmp_path / "cut.glb").write_bytes(DEMO.read_bytes()[:1000])
    shutil.copy(DEMO, tmp_path / "good.glb")
    (tmp_path / "sitecustomize.py").write_text(
        "import os, sys\n"
        "def audit(event, arguments):\n"
        "    if event == 'open' and str(arguments[0]).endswith('crash.glb'):\n"
        "        os.write(2, b'about to go\\n')\n"
        "        os.kill(os.getpid(), 9)\n"
        "sys.addaudithook(audit)\n"
    )
    spec = write_spec(tmp_path, f'scenes = ["crash.glb", "cut.glb", "good.glb"]\nframes = "0:3"\n{SMALL}')
    out = tmp_path / "out"
    path = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH"))))
    code, printed, errors = finished(batch_process(spec, "--out", out, "--workers", "1", PYTHONPATH=path))
    assert code == 2, errors
    assert "1 of 3 jobs done" in printed and "2 of 3 jobs failed" in errors
    jobs = {Path(job["scene"]).stem: job for job in json.loads((out / "summary.json").read_text())["jobs"]}
    assert {name: job["state"] for name, job in jobs.items()} == {"crash": "failed", "cut": "failed", "good": "done"}
    crash, cut = ((out / jobs[name]["log"]).read_text() for name in ("crash", "cut"))
    assert "SIGKILL, 3 times in head" in crash and "about to go" in crash
    assert "cut.glb" in cut.splitlines()[0] and "Traceback" in cut and "SceneError" in cut

    code, printed, _ = finished(batch_process("status", out))
    assert code == 2 and printed.count("failed") == 2 and "killed by SIGKILL" in printed
    code, printed, _ = finished(batch_process("report", out))
    assert code == 0 and "Table 4" in printed and printed.count("note: not finished: ") == 2


@pytest.mark.long
def test_no_worker_has_opengl(tmp_path):
    """The error is one line, and a resume with OpenGL finishes."""
    spec = write_spec(tmp_path, f'scenes = ["{DEMO}"]\nframes = "0:5"\n{SMALL}')
    out = tmp_path / "out"
    process = batch_process(spec, "--out", out, "--workers", "2", "--chunk", "1", TAUBENCH_BACKEND="nonsense")
    code, _, errors = finished(process)
    lines = errors.splitlines()
    assert code == 2 and "no job" not in errors
    assert lines[-1].startswith("taubench-gl: error: ") and "Traceback" not in errors
    assert finished(batch_process("resume", out))[0] == 0


@pytest.mark.long
@pytest.mark.parametrize("light", ["auto", "path-traced"])
def test_light_has_the_same_bits_for_any_number_of_workers_and_after_kills(tmp_path, light):
    """Killed while rounds of sampled light, or pairs of decided pixels, are on their way."""
    size, files = ("32x18", "light-*") if light == "auto" else ("16x9", "pairs-*")
    spec = write_spec(
        tmp_path,
        f'scenes = ["{DEMO}"]\nframes = "20:26"\nsize = "{size}"\nlight = "{light}"\nlight_within = 2.0\n',
    )
    expected = None
    for workers in ("1", "2", "3"):
        out = tmp_path / f"out{workers}"
        assert finished(batch_process(spec, "--out", out, "--workers", workers, "--chunk", "2"))[0] == 0
        expected = expected or final_files(out)
        assert final_files(out) == expected
    out = tmp_path / "killed"
    for kept in (1, 2):
        driver = batch_process(spec, "--out", out, "--workers", "2", "--chunk", "2")
        wait_until(lambda kept=kept: len(list(out.glob(f"records/*/{files}.json"))) >= kept, driver)
        workers = psutil.Process(driver.pid).children()
        os.kill(driver.pid, signal.SIGKILL)
        driver.communicate(timeout=PATIENCE)
        psutil.wait_procs(workers, timeout=PATIENCE)
        assert not (out / "summary.json").exists()
    assert finished(batch_process("resume", out))[0] == 0
    assert final_files(out) == expected
