"""Files appear whole, or one line says why not."""

from __future__ import annotations

import json
import os

import imageio.v3 as iio
import numpy as np
import pytest

from taubench_gl.errors import OutputError
from taubench_gl.outputs import make_folders, plain_text, remove_folders, text_bytes, write_atomically, write_png


@pytest.mark.parametrize("data", ["länger\n", b"\x00\xff\r\n"])
def test_what_is_written_is_there_whole_and_alone(tmp_path, data):
    path = tmp_path / "new" / "folder" / "file"
    with pytest.raises(OutputError, match="No such file"):
        write_atomically(path, "before")
    write_atomically(path, "before", parents=True)
    write_atomically(path, data)
    assert path.read_bytes() == (data.encode() if isinstance(data, str) else data)
    assert list(path.parent.iterdir()) == [path]


def test_what_cannot_be_written_is_one_line_and_leaves_nothing(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "file" / "below", tmp_path / "folder"):
        with pytest.raises(OutputError, match="cannot be written"):
            write_atomically(path, "x")
    assert (tmp_path / "file").read_text() == "mine"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


def test_a_picture_comes_back(tmp_path):
    picture = np.random.default_rng(1).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    write_png(tmp_path / "a.png", picture[:, ::-1])
    np.testing.assert_array_equal(iio.imread(tmp_path / "a.png"), picture[:, ::-1])


LOST = os.fsdecode(b"caf\xe9")  # a file name that is no UTF-8: Python holds the byte as a lone surrogate


def test_bytes_of_a_path_come_back_from_json_and_can_be_read_elsewhere(tmp_path):
    write_atomically(tmp_path / "a.json", json.dumps({"path": LOST}, ensure_ascii=False))
    data = (tmp_path / "a.json").read_bytes()
    assert data == rb'{"path": "caf\udce9"}'
    assert os.fsencode(json.loads(data.decode("utf-8"))["path"]) == b"caf\xe9"
    assert text_bytes("länger") == "länger".encode() and plain_text(LOST) == r"caf\udce9"
    assert str(OutputError("is lost", where=LOST)) == r"caf\udce9: is lost"


def test_two_writers_of_one_path_do_not_meet(tmp_path, monkeypatch):
    """While one file is between write and rename another is written to the same path, by this process or a fork."""
    path, seen, real = tmp_path / "file", [], os.replace

    def replace(partial, target):
        seen.append(os.path.basename(partial))
        if len(seen) == 1:
            write_atomically(path, "second")
        real(partial, target)

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


def test_folders_that_were_made_go_again_as_far_as_they_are_empty(tmp_path):
    made = make_folders(tmp_path / "a" / "b" / "c")
    (tmp_path / "a" / "mine").touch()
    remove_folders(made)
    assert [p.name for p in tmp_path.rglob("*")] == ["a", "mine"]
    assert make_folders(tmp_path / "a") == []
    with pytest.raises(FileExistsError):
        make_folders(tmp_path / "a" / "mine")
    with pytest.raises(NotADirectoryError):
        make_folders(tmp_path / "a" / "mine" / "below")
