"""A disk that fills up while a run is written: no damaged file, no summary.json without all other files."""

from __future__ import annotations

import contextlib
import os
import resource
from collections.abc import Iterator
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from repeated import few

from taubench_gl import evaluate
from taubench_gl.errors import OutputError
from taubench_gl.paths import PACKAGE
from taubench_gl.run import FRAMES_FILE, SUMMARY_FILE, load_run, read_frames

pytestmark = pytest.mark.usefixtures("fixed_light")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
OPTIONS = {"size": "64x36", "frames": range(3), "columns": "frustum,position", "save": "masks", "report": True}


@contextlib.contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Inside, no file grows beyond ``size`` bytes: the system error is that of a full disk, but for its number."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def whole_files(out: Path) -> set[str]:
    """Relative names of the files in ``out``, images and arrays of which are read to the end."""
    found = {str(path.relative_to(out)): path for path in out.rglob("*") if path.is_file()}
    for name, path in found.items():
        if path.suffix in (".png", ".webp"):
            assert iio.imread(path).size, name
        elif path.suffix == ".npz":
            with np.load(path) as arrays:
                assert all(arrays[key].size for key in arrays), name
        elif path.suffix in (".html", ".svg"):
            assert path.read_text().rstrip().endswith((">",)), name
    return set(found)


@pytest.fixture(scope="module")
def complete(tmp_path_factory) -> dict[str, int]:
    """Name -> size of every file of a run."""
    out = tmp_path_factory.mktemp("complete")
    evaluate(DEMO, out=out, **OPTIONS)
    return {name: (out / name).stat().st_size for name in whole_files(out)}


@pytest.mark.parametrize("too_large", few(["mask.png", "report.html", "frames.png", "masks/mask_00002.png"], 1))
def test_a_full_disk_leaves_whole_files_and_no_summary(complete, tmp_path, too_large):
    """The limit is below the size of one file: it, and every larger one, cannot be written.  Sizes vary a little."""
    evaluate(DEMO, out=tmp_path, **OPTIONS | {"save": (), "report": False})  # whose summary must not survive
    with largest_file(complete[too_large] * 9 // 10), pytest.raises(OutputError) as caught:
        evaluate(DEMO, out=tmp_path, **OPTIONS)
    assert "\n" not in str(caught.value)
    left = whole_files(tmp_path)
    assert SUMMARY_FILE not in left and not [name for name in left if "partial" in name]
    assert len(read_frames(tmp_path / FRAMES_FILE)) in (1, 2)
    evaluate(DEMO, out=tmp_path, **OPTIONS)
    assert whole_files(tmp_path) == set(complete) and load_run(tmp_path).summary["pairs"] == 2


def test_summary_is_the_last_file(tmp_path, monkeypatch):
    """In the order in which files get their names; a folder with a summary.json lacks nothing."""
    names, replace = [], os.replace

    def record(source, target, **folders):
        names.append(Path(target).name)
        replace(source, target, **folders)

    monkeypatch.setattr(os, "replace", record)
    evaluate(DEMO, out=tmp_path, **OPTIONS)
    assert names[-1] == SUMMARY_FILE and names.count(SUMMARY_FILE) == 1
    others = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert others == set(names)


SMALL = {"size": "64x36", "columns": "frustum,position"}


def files_in(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_a_rerun_removes_what_it_makes_stale_and_nothing_else(tmp_path: Path) -> None:
    """Pages, images, masks and channels of earlier pairs go, also those that no summary names; a user's files stay."""
    run = evaluate(DEMO, **SMALL, frames=(0, 4), out=tmp_path / "run", save=("masks", "channels"), report=True)
    (tmp_path / "run" / "masks" / "mask_00099.npz").write_bytes(b"of an interrupted run")
    (tmp_path / "run" / "share.html").write_text("of share")
    for mine in ("notes.txt", "masks/mine.png"):
        (tmp_path / "run" / mine).write_text("mine")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "channels_00001.npz").write_text("of others")
    evaluate(DEMO, **SMALL, frames=(0, 2), out=tmp_path / "run")
    evaluate(DEMO, **SMALL, frames=(0, 2), out=tmp_path / "new")
    assert files_in(tmp_path / "run") == files_in(tmp_path / "new") | {"notes.txt", "masks/mine.png"}
    assert load_run(tmp_path / "run").summary["pairs"] == 1 and not (tmp_path / "run" / "channels").exists()
    (tmp_path / "run" / "channels").symlink_to(tmp_path / "elsewhere")
    evaluate(DEMO, **SMALL, frames=(0, 2), out=tmp_path / "run")
    assert files_in(tmp_path / "elsewhere") == {"channels_00001.npz"} and run.summary["pairs"] == 3


def test_a_run_without_a_pair_writes_nothing_and_keeps_an_earlier_one(tmp_path: Path) -> None:
    assert evaluate(DEMO, **SMALL, frames=(3, 4), out=tmp_path / "none", report=True).out is None
    assert not (tmp_path / "none").exists()
    evaluate(DEMO, **SMALL, frames=(0, 3), out=tmp_path / "run")
    before = {name: (tmp_path / "run" / name).read_bytes() for name in files_in(tmp_path / "run")}
    assert evaluate(DEMO, **SMALL, frames=(3, 4), out=tmp_path / "run", save="masks").summary["pairs"] == 0
    assert before == {name: (tmp_path / "run" / name).read_bytes() for name in files_in(tmp_path / "run")}
