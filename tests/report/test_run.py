"""Runs on disk: what is written can be read, what is interrupted keeps its finished pairs, errors are one line."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from taubench_gl.conventions import SUMMARY_SCHEMA
from taubench_gl.errors import OutputError
from taubench_gl.run import FRAME_COLUMNS, FRAMES_FILE, SUMMARY_FILE, RunWriter, load_run, read_frames


def test_saved_run_comes_back_equal(run, tmp_path):
    folder = run.save(tmp_path / "deep" / "folder")
    loaded = load_run(folder)
    assert loaded.summary == run.summary
    assert loaded.frames == run.frames
    assert load_run(folder / SUMMARY_FILE).frames == run.frames


def test_cells_keep_every_digit_and_none(tmp_path):
    with RunWriter(tmp_path, ("a", "b", "c", "d")) as writer:
        writer.write_row({"a": np.float64(0.1) + 0.2, "b": np.uint64(2**63), "c": None, "d": np.bool_(True)})
    assert read_frames(tmp_path / FRAMES_FILE) == [{"a": 0.1 + 0.2, "b": 2**63, "c": None, "d": 1}]


def test_rows_are_readable_while_the_run_goes_on(frames, tmp_path):
    with RunWriter(tmp_path) as writer:
        for i, row in enumerate(frames, start=1):
            writer.write_row(row)
            assert read_frames(tmp_path / FRAMES_FILE) == frames[:i]


def test_a_row_cut_short_is_left_out(tmp_path):
    (tmp_path / FRAMES_FILE).write_text("a,b\n1,2\n3,4\n5,")
    assert read_frames(tmp_path / FRAMES_FILE) == [{"a": 1, "b": 2}, {"a": 3, "b": 4}]


def test_interrupted_run_has_no_summary_and_says_what_it_holds(run, frames, tmp_path):
    run.save(tmp_path)  # an older, finished run in the same place
    with pytest.raises(KeyboardInterrupt), RunWriter(tmp_path) as writer:
        writer.write_row(frames[0])
        raise KeyboardInterrupt
    assert sorted(os.listdir(tmp_path)) == [FRAMES_FILE]
    with pytest.raises(OutputError, match=r"not finished; frames\.csv holds 1 pairs"):
        load_run(tmp_path)


def test_summary_appears_whole_or_not_at_all(tmp_path):
    with RunWriter(tmp_path) as writer:
        with pytest.raises(ValueError, match="JSON"):
            writer.write_summary({"schema": SUMMARY_SCHEMA, "x": float("nan")})
        with pytest.raises(TypeError, match="set"):
            writer.write_summary({"x": {1}})
        assert os.listdir(tmp_path) == [FRAMES_FILE]
        writer.write_summary({"array": np.arange(2), "n": np.int64(3)})
    assert json.loads((tmp_path / SUMMARY_FILE).read_text()) == {"array": [0, 1], "n": 3}
    assert sorted(os.listdir(tmp_path)) == [FRAMES_FILE, SUMMARY_FILE]


def test_rows_can_be_replaced_at_the_end(frames, tmp_path):
    marked = [row | {"camera_cut": 1} for row in frames]
    with RunWriter(tmp_path) as writer:
        for row in frames:
            writer.write_row(row)
        with pytest.raises(KeyError, match="typo"):
            writer.rewrite_rows([{"typo": 1}])
        assert read_frames(tmp_path / FRAMES_FILE) == frames
        writer.rewrite_rows(marked)
        with pytest.raises(ValueError, match="not open"):
            writer.write_row(frames[0])
    assert read_frames(tmp_path / FRAMES_FILE) == marked
    assert os.listdir(tmp_path) == [FRAMES_FILE]


def test_unknown_column_is_a_fault_of_ours(tmp_path):
    with RunWriter(tmp_path, ("a",)) as writer, pytest.raises(KeyError, match="typo"):
        writer.write_row({"typo": 1})


def test_what_fails_before_its_first_row_leaves_nothing(frames, tmp_path):
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


def test_names_that_are_no_text_are_written_and_come_back(run, tmp_path):
    """A path with a byte that is no UTF-8: summary, tables, plots, page."""
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


def test_file_in_the_way(tmp_path):
    (tmp_path / "file").write_text("mine")
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(OutputError, match=r"file.*is not a folder") as caught, RunWriter(out):
            pass
        assert "\n" not in str(caught.value)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs a folder in which not even root may write")
def test_unwritable_folder():
    with pytest.raises(OutputError, match="cannot be written") as caught, RunWriter("/proc/self/out"):
        pass
    assert "/proc/self/out" in str(caught.value)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a file that is always full")
def test_full_disk_is_one_line(tmp_path):
    (tmp_path / FRAMES_FILE).symlink_to("/dev/full")
    with pytest.raises(OutputError, match="No space left"), RunWriter(tmp_path):
        pass


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{", "not valid JSON"),
        ("[]", "schema is None"),
        ('{"schema": "taubench-gl/summary/99"}', "taubench-gl/summary/99"),
        ("\udcff", "not valid JSON|utf-8"),
    ],
)
def test_load_run_refuses_what_is_not_a_run(tmp_path, text, complaint):
    (tmp_path / SUMMARY_FILE).write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(OutputError, match=complaint) as caught:
        load_run(tmp_path)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "value", "complaint"),
    [
        ("scene", 3, "scene is 3, expected an object"),
        ("settings", [], r"settings is \[\], expected an object"),
        ("settings.width", "wide", "settings.width is 'wide', expected a number"),
        ("discard.normal", 7, "discard.normal is 7, expected an object"),
        ("discard.normal.mean_percent", True, "discard.normal.mean_percent is True, expected a number"),
        ("camera.yaw.p95", {}, r"camera.yaw.p95 is \{\}, expected a number"),
    ],
)
def test_load_run_names_a_value_of_another_kind(run, tmp_path, keys, value, complaint):
    run.save(tmp_path)
    summary = json.loads((tmp_path / SUMMARY_FILE).read_text())
    *outer, last = keys.split(".")
    block = summary
    for key in outer:
        block = block.setdefault(key, {})
    block[last] = value
    (tmp_path / SUMMARY_FILE).write_text(json.dumps(summary))
    with pytest.raises(OutputError, match=complaint):
        load_run(tmp_path)
    block[last] = None
    (tmp_path / SUMMARY_FILE).write_text(json.dumps(summary))
    assert load_run(tmp_path).frames == run.frames, "null is no fault"


def test_load_run_of_nothing(tmp_path):
    with pytest.raises(OutputError, match="does not exist"):
        load_run(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="holds no run"):
        load_run(tmp_path)


def test_damaged_frames_name_the_line(run, tmp_path):
    run.save(tmp_path)
    with open(tmp_path / FRAMES_FILE, "a") as file:
        file.write("1,2\n")
    line = len(run.frames) + 2
    with pytest.raises(OutputError, match=rf"frames\.csv:{line}: 2 cells, expected {len(FRAME_COLUMNS)}"):
        load_run(tmp_path)


def test_columns_are_unique_and_repr_is_one_line(run):
    assert len(set(FRAME_COLUMNS)) == len(FRAME_COLUMNS)
    assert repr(run).startswith("<Run walk") and "normal 4.50 %" in repr(run) and "\n" not in repr(run)
    run.summary["discard"] = {}
    assert "nothing measured" in repr(run)
