"""Files appear whole, or one line says why not."""

from __future__ import annotations

import imageio.v3 as iio
import numpy as np
import pytest

from taubench_gl.errors import OutputError
from taubench_gl.outputs import write_atomically, write_png


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
