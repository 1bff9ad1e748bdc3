"""Stored reuse evaluations: read back, shown again by ``report``, listed by ``compare``; damaged files are one line."""

from __future__ import annotations

import json
import random
import re

import pytest
from reuse_scenes import passing_box
from reuse_tools import evaluate, run_cli

from taubench_gl.errors import OutputError
from taubench_gl.report.reuse import merged_summaries
from taubench_gl.reuse.evaluate_output import ReuseFolder
from taubench_gl.reuse.stored import is_evaluation, load_evaluation

pytestmark = pytest.mark.usefixtures("coarse_light")


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Two evaluations of the same frames, the first with images and a method that failed."""
    folders, done = [], []
    for name, methods in (("first", ["none", "accumulate", "nosuch"]), ("second", ["none"])):
        out = tmp_path_factory.mktemp("stored") / name
        with ReuseFolder(out, 24.0, "none", report=name == "first") as folder:
            done.append(evaluate(passing_box(), methods, (8, 11), on_frame=folder.on_frame))
            folder.finish(done[-1])
        folders.append(out)
    return folders, done


@pytest.fixture
def copy(stored, tmp_path):
    """A copy of the first evaluation to damage."""
    for name in ("reuse.json", "frames.csv"):
        (tmp_path / name).write_bytes((stored[0][0] / name).read_bytes())
    return tmp_path


def data_of(page: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])


def test_an_evaluation_is_read_as_it_was(stored):
    (first, _), (done, _) = stored
    found = load_evaluation(first / "reuse.json")
    assert found.summary == json.loads(json.dumps(done.summary)) and found.rows == done.rows and found.out == first
    assert is_evaluation(first) and is_evaluation(first / "reuse.json") and not is_evaluation(first / "images")


def test_report_writes_the_same_page_again(stored, capsys):
    first = stored[0][0]
    before = (first / "report.html").read_text()
    (first / "report.html").unlink()
    assert run_cli("report", first) == 0 and (first / "report.html").read_text() == before
    data = data_of(before)
    assert data["images"]["names"] == ["input", "none", "accumulate", "reference"]
    assert [item["n"] for item in data["images"]["items"]] == [8, 9, 10]
    assert data["viewer"]["error"] == "4 |error|"  # FLIP was not requested
    assert [one["name"] for one in data["viewer"]["classes"]] == list(stored[1][0].summary["classes"])


def test_report_limits_the_images(stored, tmp_path, capsys):
    out = tmp_path / "small.html"
    run_cli("report", stored[0][0], "--images", "2", "--out", out)
    assert len(data_of(out.read_text())["images"]["items"]) == 2


def test_compare_puts_the_methods_of_the_same_frames_into_one_table(stored, capsys):
    code = run_cli("compare", *stored[0], "--format", "csv")
    out = capsys.readouterr().out
    rows = {line.split(",")[1] for line in out.splitlines() if line.startswith("1,")}
    assert code == 0 and rows == {"first: none", "accumulate", "nosuch", "second: none"}


def test_evaluations_of_other_frames_have_tables_of_their_own(stored):
    summary = stored[1][1].summary
    other = summary | {"settings": summary["settings"] | {"first_frame": 9}}
    assert len(merged_summaries([("a", summary), ("b", other)])) == 2
    (merged,) = merged_summaries([("a", summary), ("a", summary)])
    assert list(merged["methods"]) == ["a: none", "a: none'"]


def test_runs_and_reuse_evaluations_are_not_mixed(stored, tmp_path, capsys):
    for command in (["compare", stored[0][0], tmp_path], ["report", *stored[0]]):
        assert run_cli(*command) == 2 and capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s.update(schema="taubench-gl/reuse/1"),
        lambda s: s.pop("measures"),
        lambda s: s["settings"].update(width="wide"),
        lambda s: s["methods"]["none"].pop("classes"),
        lambda s: s["methods"]["none"]["classes"].pop("rest"),
        lambda s: s["methods"].update(none=3),
    ],
)
def test_a_damaged_summary_is_refused(copy, change):
    summary = json.loads((copy / "reuse.json").read_text())
    change(summary)
    (copy / "reuse.json").write_text(json.dumps(summary))
    with pytest.raises(OutputError) as error:
        load_evaluation(copy)
    assert error.value.where == str(copy / "reuse.json")


def test_a_changed_digit_is_refused(copy):
    text = (copy / "reuse.json").read_text()
    digits = [at for at, letter in enumerate(text) if letter.isdigit()]
    for at in random.Random(1).sample(digits, 6):
        (copy / "reuse.json").write_text(f"{text[:at]}{(int(text[at]) + 5) % 10}{text[at + 1 :]}")
        with pytest.raises(OutputError):
            load_evaluation(copy)
    (copy / "reuse.json").write_text(text)
    assert load_evaluation(copy).rows
    with pytest.raises(OutputError):
        load_evaluation(copy / "nowhere")


@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.replace("relmse", "mse", 1),
        lambda t: t + "1,none\n",
        lambda t: t.replace("\n", "\nx", 1),
        lambda t: "",
        lambda t: lines_of(t, 0),
        lambda t: lines_of(t, 0, 2, 1, *range(3, 7)),
        lambda t: lines_of(t, 0, 1, 1, *range(3, 7)),
        lambda t: lines_of(t, 0, *range(2, 7)),
    ],
    ids=["name", "short", "text", "nothing", "no rows", "swapped", "doubled", "missing"],
)
def test_damaged_rows_are_refused(copy, change):
    text = (copy / "frames.csv").read_text()
    (copy / "frames.csv").write_text(change(text))
    with pytest.raises(OutputError, match=r"frames\.csv"):
        load_evaluation(copy)


def lines_of(text: str, *kept: int) -> str:
    """The header (0) and rows ``kept`` of a table of six rows."""
    return "".join(text.splitlines(keepends=True)[i] for i in kept)
