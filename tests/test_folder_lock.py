"""One writer per output folder: a second is refused in one line, a killed one leaves nothing in the way."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import threading

import pytest

from taubench_gl import Settings, evaluate
from taubench_gl.errors import OutputError
from taubench_gl.export.run import export_scene
from taubench_gl.folder_lock import LOCK_FILE, FolderLock, lock_holder
from taubench_gl.paths import PACKAGE

DEMO = PACKAGE.parent / "assets" / "demo.glb"

HOLDER = """
import sys
from taubench_gl.folder_lock import FolderLock
with FolderLock(sys.argv[1]):
    print("locked", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def held(tmp_path):
    """A folder into which another process writes, and that process."""
    folder = tmp_path / "out"
    with subprocess.Popen([sys.executable, "-c", HOLDER, folder], stdin=-1, stdout=-1, text=True) as process:
        assert process.stdout.readline() == "locked\n"
        yield folder, process
        process.kill()


def test_a_second_writer_is_refused_and_a_killed_one_is_no_writer(held):
    folder, process = held
    settings = Settings(width=32, height=18, frames=(0, 3), columns=("frustum", "position"))
    for write in (lambda: evaluate(DEMO, settings, out=folder), lambda: export_scene(DEMO, folder, settings)):
        with pytest.raises(OutputError) as caught:
            write()
        assert caught.value.where == str(folder) and f"process {process.pid} " in caught.value.what
        assert [p.name for p in folder.iterdir()] == [LOCK_FILE]
    assert lock_holder(folder).startswith(f"process {process.pid} ")
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert (folder / LOCK_FILE).exists() and lock_holder(folder) is None
    run = evaluate(DEMO, settings, out=folder)
    assert run.summary["pairs"] == 2 and not (folder / LOCK_FILE).exists()


def test_a_lock_removes_what_it_created(tmp_path):
    with FolderLock(tmp_path / "a" / "b"):
        assert lock_holder(tmp_path / "a" / "b")
    assert not list(tmp_path.iterdir())
    with FolderLock(tmp_path / "a"):
        (tmp_path / "a" / "result").touch()
    assert [p.name for p in tmp_path.rglob("*")] == ["a", "result"]


def test_a_reader_of_the_lock_does_not_stop_a_writer(tmp_path, monkeypatch):
    real, seen = fcntl.flock, []

    def busy_once(file, operation):
        if operation & fcntl.LOCK_EX and not seen:
            seen.append(operation)
            raise BlockingIOError
        return real(file, operation)

    monkeypatch.setattr(fcntl, "flock", busy_once)
    with FolderLock(tmp_path):
        assert seen and lock_holder(tmp_path) is not None
    assert lock_holder(tmp_path) is None


def test_many_writers_of_one_folder_never_overlap(tmp_path):
    """The lock file is removed with each lock: a writer that waits at a removed file must not think it holds one."""
    inside, most, done = 0, 0, 0
    guard = threading.Lock()

    def work() -> None:
        nonlocal inside, most, done
        for _ in range(100):
            try:
                with FolderLock(tmp_path / "out"):
                    with guard:
                        inside, done = inside + 1, done + 1
                        most = max(most, inside)
                    with guard:
                        inside -= 1
            except OutputError:
                continue

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1 and done > 0 and not list(tmp_path.glob("out/*"))
