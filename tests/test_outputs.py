"""Atomic writing, and the removal of partial files that killed writers left."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from taubench_gl.errors import OutputError
from taubench_gl.outputs import (
    DAY,
    is_partial_of,
    make_folders,
    new_partial,
    plain_text,
    remove_folders,
    text_bytes,
    write_atomically,
)


@pytest.mark.parametrize("data", ["länger\n", b"\x00\xff\r\n"])
def test_write_atomically_leaves_the_whole_file_and_nothing_else(tmp_path, data):
    path = tmp_path / "new" / "folder" / "file"
    with pytest.raises(OutputError):
        write_atomically(path, "before")
    write_atomically(path, "before", parents=True)
    write_atomically(path, data)
    assert path.read_bytes() == (data.encode() if isinstance(data, str) else data)
    assert list(path.parent.iterdir()) == [path]


def test_a_failed_write_raises_output_error_and_leaves_nothing(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "file" / "below", tmp_path / "folder"):
        with pytest.raises(OutputError) as caught:
            write_atomically(path, "x")
        assert caught.value.where == str(path) and "\n" not in str(caught.value)
    assert (tmp_path / "file").read_text() == "mine"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


NOT_UTF8 = os.fsdecode(b"caf\xe9")  # Python holds the byte as a lone surrogate


def test_paths_that_are_not_utf8_survive_json(tmp_path):
    write_atomically(tmp_path / "a.json", json.dumps({"path": NOT_UTF8}, ensure_ascii=False))
    data = (tmp_path / "a.json").read_bytes()
    assert data == rb'{"path": "caf\udce9"}'
    assert os.fsencode(json.loads(data.decode("utf-8"))["path"]) == b"caf\xe9"
    assert text_bytes("länger") == "länger".encode() and plain_text(NOT_UTF8) == r"caf\udce9"
    assert str(OutputError("missing", where=NOT_UTF8)) == r"caf\udce9: missing"


def test_two_writers_of_one_path_use_separate_partial_files(tmp_path, monkeypatch):
    """A second write to the path happens between the write and the rename of the first."""
    path, seen, real = tmp_path / "file", [], os.replace

    def replace(partial, target, **folders):
        seen.append(os.path.basename(partial))
        if len(seen) == 1:
            write_atomically(path, "second")
        real(partial, target, **folders)

    monkeypatch.setattr(os, "replace", replace)
    write_atomically(path, "first")
    assert path.read_text() == "first" and len(set(seen)) == 2
    assert all(f".{os.getpid()}-" in name for name in seen) and list(tmp_path.iterdir()) == [path]


def test_an_interrupted_write_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "file", "x")
    assert not list(tmp_path.iterdir())


KILLED = """
import os, pathlib, signal, sys
from taubench_gl.outputs import replacing

with replacing(pathlib.Path(sys.argv[1])) as partial:
    partial.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def killed(path) -> int:
    """Write ``path`` in a process that is killed before it ends.  -> its process number."""
    with subprocess.Popen([sys.executable, "-c", KILLED, path]) as child:
        assert child.wait() == -signal.SIGKILL
    return child.pid


def test_partial_file_of_a_killed_writer_is_removed_by_the_next_write(tmp_path):
    path, other = tmp_path / "file", tmp_path / "file.txt"
    for each in (path, other):
        killed(each)
    mine, others = sorted(tmp_path.iterdir(), key=lambda p: len(p.name))
    assert is_partial_of(path, mine) and is_partial_of(other, others) and not is_partial_of(path, others)
    write_atomically(path, "whole")
    assert set(tmp_path.iterdir()) == {path, others}


@pytest.mark.parametrize("writer", ["running", "other namespace", "unknown namespace"])
def test_partial_file_of_a_possibly_running_writer_is_removed_after_a_day(tmp_path, monkeypatch, writer):
    """A process that runs (the parent), and process numbers of another or an unknown PID namespace."""
    pid = os.getppid() if writer == "running" else killed(tmp_path / "else")
    space = {"other namespace": "-01234567", "unknown namespace": ""}.get(writer)
    with monkeypatch.context() as there:
        there.setattr(os, "getpid", lambda: pid)
        if space is not None:
            there.setattr("taubench_gl.outputs._process_space", lambda: space)
        name = new_partial(tmp_path / "file", ".mp4").name
    for age, left in ((DAY - 60, True), (DAY + 60, False)):
        folder = tmp_path / str(left)  # a new one: listings are cached
        folder.mkdir()
        found = folder / name
        found.write_bytes(b"half")
        os.utime(found, (time.time() - age,) * 2)
        write_atomically(folder / "file", "whole")
        assert found.exists() == left and (folder / "file").read_text() == "whole"


def test_files_with_similar_names_are_kept(tmp_path):
    names = {".file.partial", ".file.1.partial", ".file.1-x.partial", "file.1-1.partial", ".file.1-1.partial.a.b"}
    for name in names:
        (tmp_path / name).write_bytes(b"mine")
        os.utime(tmp_path / name, (0, 0))
    write_atomically(tmp_path / "file", "whole")
    assert {p.name for p in tmp_path.iterdir()} == {"file", *names}


def test_remove_folders_removes_created_empty_folders_only(tmp_path):
    made = make_folders(tmp_path / "a" / "b" / "c")
    (tmp_path / "a" / "mine").touch()
    remove_folders(made)
    assert [p.name for p in tmp_path.rglob("*")] == ["a", "mine"]
    assert make_folders(tmp_path / "a") == []
    with pytest.raises(FileExistsError):
        make_folders(tmp_path / "a" / "mine")
    with pytest.raises(NotADirectoryError):
        make_folders(tmp_path / "a" / "mine" / "below")
