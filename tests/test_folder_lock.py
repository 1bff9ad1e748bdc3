"""One writer per output folder: a second is refused in one line, a killed one leaves nothing in the way."""

from __future__ import annotations

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
SMALL = {"size": "32x18", "frames": range(3), "columns": "frustum,position"}

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


def refused(work, folder, process) -> None:
    with pytest.raises(OutputError) as caught:
        work()
    assert caught.value.where == str(folder) and f"process {process.pid} " in caught.value.what
    assert [p.name for p in folder.iterdir()] == [LOCK_FILE]


def test_a_second_writer_is_refused_and_changes_nothing(held):
    folder, process = held
    refused(lambda: evaluate(DEMO, out=folder, **SMALL), folder, process)
    refused(lambda: export_scene(DEMO, folder, Settings(width=32, height=18, frames=(0, 2))), folder, process)
    assert lock_holder(folder).startswith(f"process {process.pid} ")


def test_a_killed_writer_does_not_keep_the_folder(held):
    folder, process = held
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert (folder / LOCK_FILE).exists() and lock_holder(folder) is None
    run = evaluate(DEMO, out=folder, **SMALL)
    assert run.summary["pairs"] == 2 and not (folder / LOCK_FILE).exists()


def test_a_lock_removes_what_it_created(tmp_path):
    with FolderLock(tmp_path / "a" / "b"):
        assert lock_holder(tmp_path / "a" / "b")
    assert not list(tmp_path.iterdir())
    with FolderLock(tmp_path / "a"):
        (tmp_path / "a" / "result").touch()
    assert [p.name for p in tmp_path.rglob("*")] == ["a", "result"]


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
