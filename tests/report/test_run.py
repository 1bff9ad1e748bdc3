"""Runs on disk: round trip, interrupted runs, errors."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from taubench_gl.checksums import KEY
from taubench_gl.conventions import SUMMARY_SCHEMA
from taubench_gl.errors import OutputError
from taubench_gl.folder_lock import LOCK_FILE
from taubench_gl.run import FRAMES_FILE, SUMMARY_FILE, RunWriter, load_run, read_frames
from taubench_gl.run_schema import FRAME_COLUMNS


def test_saved_run_is_loaded_equal(run, tmp_path):
    folder = run.save(tmp_path / "deep" / "folder")
    loaded = load_run(folder)
    assert loaded.summary == run.summary
    assert loaded.frames == run.frames
    assert load_run(folder / SUMMARY_FILE).frames == run.frames


def test_cells_keep_every_digit_and_none(tmp_path):
    with RunWriter(tmp_path, ("a", "b", "c", "d")) as writer:
        writer.write_row({"a": np.float64(0.1) + 0.2, "b": np.uint64(2**63), "c": None, "d": np.bool_(True)})
    assert read_frames(tmp_path / FRAMES_FILE) == [{"a": 0.1 + 0.2, "b": 2**63, "c": None, "d": 1}]


def test_rows_are_readable_during_the_run(frames, tmp_path):
    with RunWriter(tmp_path) as writer:
        for i, row in enumerate(frames, start=1):
            writer.write_row(row)
            assert read_frames(tmp_path / FRAMES_FILE) == frames[:i]
    with open(tmp_path / FRAMES_FILE, "a") as file:
        file.write("5,")  # a row of which a part is written
    assert read_frames(tmp_path / FRAMES_FILE) == frames


def test_interrupted_run_keeps_its_rows_without_a_summary(run, frames, tmp_path):
    run.save(tmp_path)  # an older, finished run in the same place
    with pytest.raises(KeyboardInterrupt), RunWriter(tmp_path) as writer:
        writer.write_row(frames[0])
        raise KeyboardInterrupt
    assert sorted(os.listdir(tmp_path)) == [FRAMES_FILE]
    with pytest.raises(OutputError, match="1 pair"):
        load_run(tmp_path)


def test_summary_is_written_completely_or_not_at_all(tmp_path):
    with RunWriter(tmp_path) as writer:
        with pytest.raises(ValueError):
            writer.write_summary({"schema": SUMMARY_SCHEMA, "x": float("nan")})
        with pytest.raises(TypeError):
            writer.write_summary({"x": {1}})
        assert sorted(os.listdir(tmp_path)) == [LOCK_FILE, FRAMES_FILE]
        writer.write_summary({"array": np.arange(2), "n": np.int64(3)})
    written = json.loads((tmp_path / SUMMARY_FILE).read_text())
    assert written.pop(KEY) and written == {"array": [0, 1], "n": 3}
    assert sorted(os.listdir(tmp_path)) == [FRAMES_FILE, SUMMARY_FILE]


def test_rewrite_rows_replaces_frames_csv(frames, tmp_path):
    marked = [row | {"camera_cut": 1} for row in frames]
    with RunWriter(tmp_path) as writer:
        for row in frames:
            writer.write_row(row)
        for write in (writer.write_row, lambda row: writer.rewrite_rows([row])):
            with pytest.raises(KeyError, match="typo"):
                write({"typo": 1})
        assert read_frames(tmp_path / FRAMES_FILE) == frames
        writer.rewrite_rows(marked)
        with pytest.raises(ValueError):
            writer.write_row(frames[0])
    assert read_frames(tmp_path / FRAMES_FILE) == marked
    assert os.listdir(tmp_path) == [FRAMES_FILE]


def test_failure_before_the_first_row_leaves_nothing(frames, tmp_path):
    out = tmp_path / "new" / "run"
    with pytest.raises(ZeroDivisionError), RunWriter(out):
        raise ZeroDivisionError
    assert not os.listdir(tmp_path)
    (tmp_path / "mine").mkdir()
    with pytest.raises(ZeroDivisionError), RunWriter(tmp_path / "mine") as writer:
        writer.path("masks/a")  # what a later output has begun
        raise ZeroDivisionError
    assert [p.name for p in tmp_path.rglob("*")] == ["mine", "masks"]
    with pytest.raises(ZeroDivisionError), RunWriter(out) as writer:
        writer.write_row(frames[0])
        raise ZeroDivisionError
    assert os.listdir(out) == [FRAMES_FILE]


@pytest.mark.usefixtures("plots")
def test_names_that_are_not_utf8_survive(run, tmp_path):
    """A path with a byte that is not UTF-8 in summary, tables, plots and page."""
    from taubench_gl.report import write_report
    from taubench_gl.report.run_page import ReportRun, write_html_report
    from taubench_gl.run import Run

    lost = os.fsdecode(b"caf\xe9.glb")
    summary = run.summary | {"scene": run.summary["scene"] | {"name": lost, "path": lost}, "notes": [lost]}
    again = load_run(Run(summary, run.frames).save(tmp_path))
    assert os.fsencode(again.summary["scene"]["path"]) == b"caf\xe9.glb" and again.frames == run.frames
    write_report(again.summary, again.frames, tmp_path)
    write_html_report([ReportRun(again.summary, again.frames, tmp_path)], tmp_path / "report.html")
    for name in ("tables.txt", "tables.md", "tables.csv", "tables.tex", "thresholds.svg", "report.html"):
        assert r"caf\udce9.glb" in (tmp_path / name).read_bytes().decode("utf-8").replace(r"\_", "_").replace(
            r"\textbackslash{}", "\\"
        ), name


def test_out_that_is_a_file_raises_output_error(tmp_path):
    (tmp_path / "file").write_text("mine")
    for out in (tmp_path / "file", tmp_path / "file" / "below", "/proc/self/out"):
        with pytest.raises(OutputError) as caught, RunWriter(out):
            pass
        assert caught.value.where == str(out) and "\n" not in str(caught.value)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a file that is always full")
def test_full_disk_raises_output_error(tmp_path, monkeypatch):
    monkeypatch.setattr("taubench_gl.run.new_file", lambda path: open("/dev/full", "wb", buffering=0))  # noqa: SIM115
    with pytest.raises(OutputError, match="No space left"), RunWriter(tmp_path):
        pass


@pytest.mark.parametrize(
    "text",
    ["{", "[]", '{"schema": "taubench-gl/summary/99"}', "\udcff"],
)
def test_load_run_raises_for_files_that_are_not_a_summary(tmp_path, text):
    (tmp_path / SUMMARY_FILE).write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(OutputError) as caught:
        load_run(tmp_path)
    assert caught.value.where == str(tmp_path / SUMMARY_FILE)
    (tmp_path / SUMMARY_FILE).unlink()
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(OutputError):
            load_run(folder)


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        ("scene", 3),
        ("settings", []),
        ("settings.width", "wide"),
        ("discard.normal", 7),
        ("discard.normal.mean_percent", True),
        ("camera.yaw.p95", {}),
    ],
)
def test_load_run_names_a_value_of_another_type(run, tmp_path, keys, value):
    run.save(tmp_path)
    summary = json.loads((tmp_path / SUMMARY_FILE).read_text())
    *outer, last = keys.split(".")
    block = summary
    for key in outer:
        block = block.setdefault(key, {})
    del summary[KEY]  # as somebody who changes a summary on purpose
    block[last] = value
    (tmp_path / SUMMARY_FILE).write_text(json.dumps(summary))
    with pytest.raises(OutputError) as caught:
        load_run(tmp_path)
    assert caught.value.what.startswith(f"{keys} ")
    block[last] = None
    (tmp_path / SUMMARY_FILE).write_text(json.dumps(summary))
    assert load_run(tmp_path).frames == run.frames, "null is valid"


def test_damaged_frames_name_the_line(run, tmp_path):
    run.save(tmp_path)
    with open(tmp_path / FRAMES_FILE, "a") as file:
        file.write("1,2\n")
    line = len(run.frames) + 2
    with pytest.raises(OutputError, match=rf"frames\.csv:{line}: "):
        load_run(tmp_path)


def test_columns_are_unique_and_repr_is_one_line(run):
    assert len(set(FRAME_COLUMNS)) == len(FRAME_COLUMNS)
    assert repr(run).startswith("<Run walk") and "normal 4.50 %" in repr(run) and "\n" not in repr(run)
    run.summary["discard"] = run.summary["reusable"] = {}
    assert "nothing measured" in repr(run)


@pytest.mark.parametrize("command", [["compare", "--no-paper"], ["report", "--out", "page.html"]])
def test_runs_whose_rates_count_sky_are_refused(run, tmp_path, command, taubench, monkeypatch):
    """Schema 1 counted sky as reusable: its rates never stand beside those of today."""
    new = run.save(tmp_path / "new")
    run.summary["schema"] = "taubench-gl/summary/1"
    old = run.save(tmp_path / "old")
    with pytest.raises(OutputError, match="summary/1") as caught:
        load_run(old)
    assert caught.value.hint
    monkeypatch.chdir(tmp_path)
    code, out, err = taubench(command[0], new, old, *command[1:])
    assert (code, out) == (2, "") and err.count("\n") <= 2 and not (tmp_path / "page.html").exists()


def test_rows_behind_a_link_are_not_read(tmp_path):
    """Others may have put the link there; its target would be quoted in an error."""
    (tmp_path / "secret").write_text("frame,pixels\n")
    (tmp_path / FRAMES_FILE).symlink_to(tmp_path / "secret")
    with pytest.raises(OutputError) as caught:
        read_frames(tmp_path / FRAMES_FILE)
    assert caught.value.where == str(tmp_path / FRAMES_FILE)
