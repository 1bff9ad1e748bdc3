"""Output files of an evaluation: complete files, numbers before images, and files after an interrupt."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from reuse_scenes import SIZE, passing_box
from reuse_tools import evaluate, run_cli

from taubench_gl.checksums import KEY
from taubench_gl.errors import OutputError
from taubench_gl.paths import ASSETS
from taubench_gl.reuse.evaluate_output import ReuseFolder, detail_window, finite, side_by_side
from taubench_gl.reuse.quality import MEASURES
from taubench_gl.reuse.scores import CLASSES, ROW_COLUMNS

pytestmark = pytest.mark.usefixtures("coarse_light")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("results") / "run"
    frames = []
    with ReuseFolder(out, 24.0, "webm") as folder:

        def seen(frame):
            frames.append(frame)
            folder.on_frame(frame)

        done = evaluate(
            passing_box(), ["accumulate", "ideal-masks", "nosuch"], (8, 11), metrics=("flip",), on_frame=seen
        )
        files = folder.finish(done)
    return out, done, files, frames


def test_output_folder_is_complete(written):
    out, done, files, _ = written
    assert {f.name for f in files} == {f.name for f in out.iterdir()} and not list(out.glob(".*"))
    stored = json.loads((out / "reuse.json").read_text())
    assert stored.pop(KEY) and stored == done.summary and stored["schema"] == "taubench-gl/reuse/3"
    assert set(stored["measures"]) == set(MEASURES) and set(stored["classes"]) == set(CLASSES)
    assert stored["provenance"]["clock"] == stored["clock"] and stored["methods"]["nosuch"]["failed"]
    with open(out / "frames.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == ROW_COLUMNS and len(rows) == 2 * 3
    assert [float(row["relmse"]) for row in rows] == [row["relmse"] for row in done.rows]
    assert rows[0]["flicker"] == ""
    table = (out / "tables.txt").read_text()
    assert "accumulate" in table and "'nosuch'" in table


@pytest.mark.parametrize("error", [OutputError("cannot be written: No space left on device"), KeyboardInterrupt()])
def test_numbers_are_written_before_images(written, tmp_path, monkeypatch, error):
    def full(*_):
        raise error

    monkeypatch.setattr("taubench_gl.reuse.evaluate_output.plot_reuse", full)
    with pytest.raises(type(error)), ReuseFolder(tmp_path / "run", 24.0, "none") as folder:
        folder.on_frame(written[3][0])
        folder.finish(written[1])
    stored = json.loads((tmp_path / "run" / "reuse.json").read_text())
    assert stored.pop(KEY) and stored == written[1].summary and folder.written_frames == 3
    assert (tmp_path / "run" / "frames.csv").read_bytes() == (written[0] / "frames.csv").read_bytes()


def test_numbers_that_are_not_finite_are_null_and_named(written, tmp_path):
    summary = written[1].summary | {"own": {"list": [1.0, float("inf")], "number": float("nan")}}
    with ReuseFolder(tmp_path / "run", 24.0, "none") as folder:
        folder.on_frame(written[3][0])
        folder.finish(replace(written[1], summary=summary))
    stored = json.loads((tmp_path / "run" / "reuse.json").read_text())
    assert stored["own"] == {"list": [1.0, None], "number": None}
    assert stored["not_finite"] == ["own.list.1", "own.number"]
    assert "not_finite" not in written[1].summary and finite(written[1].summary) == written[1].summary


def test_video_has_every_frame_at_its_size(written):
    import imageio_ffmpeg

    out, _, _, frames = written
    count, _ = imageio_ffmpeg.count_frames_and_secs(str(out / "side_by_side.webm"))
    assert count == len(frames) == 3
    shape = side_by_side(frames[0]).shape
    reader = imageio_ffmpeg.read_frames(str(out / "side_by_side.webm"))
    assert tuple(next(reader)["source_size"]) == (shape[1] + shape[1] % 2, shape[0] + shape[0] % 2)
    reader.close()


def test_detail_window_is_where_methods_differ(written):
    frames = written[3]
    top, left, h, w = detail_window(frames[-1])
    spread = np.abs(frames[-1].errors["accumulate"] - frames[-1].errors["ideal-masks"])
    assert spread[top : top + h, left : left + w].sum() == pytest.approx(
        max(spread[y : y + h, x : x + w].sum() for y in range(SIZE[1] - h + 1) for x in range(SIZE[0] - w + 1))
    )


@pytest.mark.parametrize(
    ("errors", "worst"), [([0.9, 0.1, 0.3, 0.2], 2), ([0.9, 0.4, 0.3], 1), ([0.1, 0.0, 0.0], 1), ([0.9], 0)]
)
def test_worst_frame_excludes_the_first(written, tmp_path, errors, worst):
    """side_by_side.png shows the worst of the frames that have history."""
    one, size = written[3][0], SIZE[::-1]
    frames = [
        replace(
            one, frame=i, reference=np.full((*size, 3), 0.1 * i), errors=dict.fromkeys(one.errors, np.full(size, e))
        )
        for i, e in enumerate(errors)
    ]
    with ReuseFolder(tmp_path / "run", 24.0, "none") as folder:
        for frame in frames:
            folder.on_frame(frame)
        np.testing.assert_array_equal(folder._worst_image, side_by_side(frames[worst], crop=True))


def test_a_rerun_without_a_video_removes_that_of_the_earlier_one(written, tmp_path):
    for name in ("side_by_side.mp4", "side_by_side.webm", "side_by_side.mine.mp4"):
        (tmp_path / name).write_text("of an earlier evaluation, or of a user")
    with ReuseFolder(tmp_path, 24.0, "none") as folder:
        folder.on_frame(written[3][0])
        files = folder.finish(written[1])
    assert {f.name for f in files} | {"side_by_side.mine.mp4"} == {f.name for f in tmp_path.iterdir()}


def test_no_incomplete_video_after_an_error(tmp_path):
    with pytest.raises(ZeroDivisionError), ReuseFolder(tmp_path / "run", 24.0) as folder:

        def seen(frame):
            folder.on_frame(frame)
            if frame.frame == 1:
                raise ZeroDivisionError

        evaluate(passing_box(), ["none"], (0, 3), on_frame=seen)
    assert list(tmp_path.iterdir()) == []


def test_command_line(tmp_path, capsys):
    code = run_cli(
        "reuse", "evaluate", ASSETS / "demo.glb", "--methods", "none,nosuch", "--size", "48x32", "--frames", "0:3",
        "--indirect", "none", "--shadow-size", "64", "--reference-samples", "1", "--metrics", "flip", "--video", "none",
        "--input", "noisy", "--out", tmp_path / "out",
    )  # fmt: skip
    out, err = capsys.readouterr()
    assert code == 2 and "'nosuch'" in err and "Traceback" not in err
    assert "Quality against the reference" in out and (tmp_path / "out" / "reuse.json").is_file()


def test_an_interrupt_keeps_and_names_the_rows_of_evaluated_frames(tmp_path, monkeypatch, capsys):
    """Files of an earlier evaluation go: they are of other frames."""
    seen, out = [], tmp_path / "run"

    def interrupted(scene, methods, settings, *, progress=None, on_frame=None, **request):
        def keep(frame):
            seen.append(frame)
            if on_frame is not None:
                on_frame(frame)
            if frame.frame == 2:
                raise KeyboardInterrupt

        evaluate(passing_box(), ["none", "accumulate"], (0, 4), on_frame=keep)

    monkeypatch.setattr("taubench_gl.reuse.evaluate.evaluate_methods", interrupted)
    out.mkdir()
    for name in ("reuse.json", "report.html", "tables.txt", "convergence.svg", "side_by_side.webm"):
        (out / name).write_text("of an earlier evaluation")
    for more, names in ((["--out", out], ("3", str(out / "frames.csv"))), ([], ("--out",))):
        assert run_cli("reuse", "evaluate", "s.glb", "--methods", "none", *more) == 130
        err = capsys.readouterr().err
        assert err.count("\n") == 1 and all(name in err for name in names)
    assert [path.name for path in out.iterdir()] == ["frames.csv"]
    with open(out / "frames.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(int(r["frame"]), r["method"]) for r in rows] == [(f, m) for f in range(3) for m in ("none", "accumulate")]
    assert [float(r["relmse"]) for r in rows] == [row["relmse"] for frame in seen[:3] for row in frame.rows.values()]
