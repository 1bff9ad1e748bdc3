"""Output folders that hold links, pipes and files of others: nothing outside the folder changes, nothing hangs."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings
from repeated import few

from taubench_gl import evaluate
from taubench_gl.errors import OutputError
from taubench_gl.export.run import ExportOptions, export_scene
from taubench_gl.folder_lock import LOCK_FILE, FolderLock, lock_holder
from taubench_gl.outputs import folder_in, log_file, new_file, new_partial, replacing, write_arrays, write_atomically
from taubench_gl.paths import PACKAGE
from taubench_gl.run import FRAMES_FILE, SUMMARY_FILE, RunWriter
from taubench_gl.study.engines import Processes

pytestmark = pytest.mark.usefixtures("fixed_light")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
SMALL = {"size": "32x18", "frames": range(3), "columns": "frustum,position"}
MINE = b"not yours\n" * 40


@pytest.fixture
def foreign(tmp_path) -> Path:
    """A file of somebody else; checked at the end of the test."""
    folder = tmp_path / "foreign"
    folder.mkdir()
    file = folder / "file"
    file.write_bytes(MINE)
    os.utime(file, (1, 1))
    yield file
    assert file.read_bytes() == MINE and file.stat().st_mtime == 1 and os.listdir(folder) == ["file"]


@pytest.fixture
def out(tmp_path) -> Path:
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_lock_that_is_no_file_is_refused(out, foreign, kind):
    (out / LOCK_FILE).symlink_to(foreign) if kind == "link" else os.mkfifo(out / LOCK_FILE)
    with pytest.raises(OutputError) as caught, FolderLock(out):
        pass
    assert caught.value.where == str(out) and (out / LOCK_FILE).is_symlink() == (kind == "link")
    assert lock_holder(out) is None


@pytest.mark.parametrize("name", few([SUMMARY_FILE, "mask.png", FRAMES_FILE, "report.html"], 2))
def test_a_link_in_the_place_of_a_result_is_replaced(out, foreign, name):
    (out / name).symlink_to(foreign)
    run = evaluate(DEMO, out=out, report=True, **SMALL)
    assert run.out == out and (out / name).is_file() and not (out / name).is_symlink()


@pytest.mark.parametrize("name", [".", FRAMES_FILE])
def test_an_interrupted_run_leaves_the_file_behind_a_link(out, foreign, name):
    (out / FRAMES_FILE).symlink_to(foreign)
    with pytest.raises(KeyboardInterrupt), RunWriter(out) as writer:
        writer.write_row({"frame": 1})
        raise KeyboardInterrupt
    assert (out / FRAMES_FILE).read_text().count("\n") == 2


@pytest.mark.parametrize("name", ["masks", "channels", "images"])
def test_a_folder_of_results_that_is_a_link_is_refused(out, foreign, name):
    (out / name).symlink_to(foreign.parent)
    with pytest.raises(OutputError):
        evaluate(DEMO, out=out, save="masks,channels", report=True, **SMALL)
    assert not (out / SUMMARY_FILE).exists()


def test_the_folder_that_the_user_names_may_be_a_link(tmp_path, out):
    (tmp_path / "link").symlink_to(out)
    evaluate(DEMO, out=tmp_path / "link", **SMALL)
    assert (out / SUMMARY_FILE).is_file()


@pytest.mark.parametrize("form", ["zarr", "npz", "exr"])
def test_an_export_does_not_write_through_links(out, foreign, form):
    if form == "zarr":
        pytest.importorskip("zarr")
    name = "frames.zarr" if form == "zarr" else f"frame_00000.{form}"
    (out / name).symlink_to(foreign.parent if form == "zarr" else foreign)
    settings = fixed_settings(width=32, height=18, frames=(0, 2))
    with contextlib.suppress(OutputError):  # refused, or left as it is
        export_scene(DEMO, out, settings, ExportOptions(form, ("normal",)), overwrite=True)


def test_logs_and_records_do_not_grow_through_links(tmp_path, out, foreign):
    for name in ("render.log", "records.jsonl"):
        (out / name).symlink_to(foreign)
    with pytest.raises(OutputError):
        log_file(out / "render.log")
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "worker-0.log").symlink_to(foreign)
    with pytest.raises(OutputError), Processes(1, logs):
        pass


def test_every_way_to_create_a_file_stays_in_its_folder(out, foreign):
    def linked(name: str) -> Path:
        (out / name).symlink_to(foreign)
        return out / name

    write_atomically(linked("a"), b"new")
    write_arrays(linked("b.npz"), {"a": np.zeros(2)})
    with replacing(linked("c")) as partial:
        partial.write_bytes(b"new")
    with new_file(linked("d")) as file:
        file.write(b"new")
    assert not any(path.is_symlink() for path in out.iterdir())
    linked("e")
    with pytest.raises(OutputError):
        folder_in(out, "e")


def test_a_partial_file_never_opens_what_is_there(out, foreign, monkeypatch):
    """Another writer guesses the next hidden name."""
    monkeypatch.setattr("taubench_gl.outputs._writes", iter([7, 8, 7, 8]))
    name = new_partial(out / "file").name
    (out / name).unlink()
    (out / name.replace("-7-", "-8-")).symlink_to(foreign)
    with pytest.raises(OutputError):
        write_atomically(out / "file", b"new")
    assert not (out / "file").exists()


def test_the_folder_is_on_the_disk_before_a_file_counts_as_written(out, monkeypatch):
    synced, real = [], os.fsync

    def fsync(descriptor):
        synced.append(os.readlink(f"/proc/self/fd/{descriptor}"))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    write_atomically(out / "file", b"new")
    assert synced[-1] == str(out) and len(synced) == 2


def test_masks_that_vanish_during_a_run_are_named(out):
    def remove(pair):
        if pair.frame == 2:
            (out / "masks" / "mask_00001.npz").unlink()

    with pytest.raises(OutputError) as caught:
        evaluate(DEMO, out=out, save="masks", on_pair=remove, **SMALL)
    assert caught.value.where == str(out / "masks" / "mask_00001.npz")
    assert not (out / SUMMARY_FILE).exists() and (out / FRAMES_FILE).is_file()
