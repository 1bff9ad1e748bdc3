"""Stored runs with wrong values: whatever reads them ends with a result or with one TaubenchError."""

from __future__ import annotations

import copy
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from taubench_gl import evaluate
from taubench_gl.apps import cli
from taubench_gl.errors import OutputError, TaubenchError
from taubench_gl.paths import PACKAGE
from taubench_gl.pathtraced.compare import compare_runs, save_comparison
from taubench_gl.pathtraced.compare_report import comparison_html, comparison_text
from taubench_gl.report.run_page import ReportRun, report_html
from taubench_gl.run import load_run

DEMO = PACKAGE.parent / "assets" / "demo.glb"
VALUES = ("x", [], {}, None, True, -1, 1e308, [[1]], {"a": "b"}, "\x1b[2J")


@pytest.fixture(scope="module")
def stored(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("stored") / "run"
    evaluate(DEMO, out=out, size="32x18", frames=range(4), save="masks", light_unit="candela", exposure=1)
    return out


def places(value: Any, at: tuple = (), depth: int = 4) -> Iterator[tuple]:
    """Paths of all keys of nested objects."""
    if isinstance(value, dict) and len(at) < depth:
        for key, below in value.items():
            yield (*at, key)
            yield from places(below, (*at, key), depth)


def put(summary: dict, at: tuple, value: Any) -> dict:
    changed = copy.deepcopy(summary)
    block = changed
    for key in at[:-1]:
        block = block[key]
    block[at[-1]] = value
    return changed


def read_everything(folder: Path, other: Path) -> None:
    """What ``report``, ``compare`` and a notebook do with a run, without its plots."""
    run = load_run(folder)
    repr(run)
    run._repr_html_()
    run.tables()
    report_html([ReportRun(run.summary, run.frames, None)])
    result = compare_runs(folder, other)
    comparison_text(result)
    comparison_html(result, None)


@pytest.mark.parametrize("every", [19, pytest.param(1, marks=pytest.mark.long)])
def test_keys_of_a_summary_with_wrong_values(stored, tmp_path, every):
    """Two values for each key, in turn, so that every value meets many keys; all keys, or one in ``every``."""
    folder = tmp_path / "run"
    shutil.copytree(stored, folder)
    summary = json.loads((stored / "summary.json").read_text())
    del summary["stored"]  # with its checksum no change would reach the readers
    keys = list(places(summary))
    assert len(keys) > 250
    refused = 0
    for number, at in list(enumerate(keys))[::every]:
        for turn in (0, 1):
            value = VALUES[(number + 5 * turn + number // len(VALUES)) % len(VALUES)]
            (folder / "summary.json").write_text(json.dumps(put(summary, at, value)))
            try:
                read_everything(folder, stored)
            except TaubenchError as error:
                refused += 1
                assert "\n" not in str(error) and "\x1b" not in str(error)
            except Exception as error:
                raise AssertionError(f"{'.'.join(at)} = {value!r}") from error
    assert refused > 300 // every


@pytest.mark.parametrize(
    "text",
    ['{"schema": "taubench-gl/summary/2", "pairs": NaN}', '{"schema": "taubench-gl/summary/2", "pairs": 1e400}',
     "[" * 100_000, "9" * 5000, '{"schema": ["x"]}', "", "\0"],
    ids=["nan", "infinite", "deep", "long", "schema", "empty", "zero"],
)  # fmt: skip
@pytest.mark.parametrize("command", ["report", "compare", "reference compare"])
def test_damaged_summaries_on_the_command_line(stored, tmp_path, capsys, text, command):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "summary.json").write_text(text)
    (folder / "frames.csv").write_bytes((stored / "frames.csv").read_bytes())
    other = [str(stored)] if "compare" in command else []
    with pytest.raises(SystemExit) as ended:
        cli.main([*command.split(), str(folder), *other])
    printed = capsys.readouterr().err
    assert ended.value.code == 2 and "error" in printed and "Traceback" not in printed
    assert len(printed.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "cell", ["nan", "1e400", "-inf", "9" * 5000, "x" * 200_000, '"', "1.5", "=1+1", "\x1b[2J", "0x10", "١"]
)
def test_rows_with_wrong_cells(stored, tmp_path, cell):
    folder = tmp_path / "run"
    shutil.copytree(stored, folder)
    lines = (stored / "frames.csv").read_text().splitlines()
    cells = lines[2].split(",")
    cells[0] = cell
    (folder / "frames.csv").write_text("\n".join([*lines[:2], ",".join(cells), *lines[3:]]) + "\n")
    with pytest.raises(OutputError) as caught:
        load_run(folder)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600


def test_saved_masks_with_one_flipped_byte(stored, tmp_path):
    """Archives of a run that ``compare`` reads: numpy, zipfile and zlib have exceptions of their own."""
    folder = tmp_path / "run"
    shutil.copytree(stored, folder)
    path = sorted(folder.glob("masks/*.npz"))[0]
    whole, refused = path.read_bytes(), 0
    for place in range(0, len(whole), max(1, len(whole) // 24)):
        flipped = bytearray(whole)
        flipped[place] ^= 0xFF
        path.write_bytes(flipped)
        try:
            save_comparison(compare_runs(folder, stored), tmp_path / "out")
        except TaubenchError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 4


def test_a_pipe_in_place_of_a_summary(tmp_path):
    os.mkfifo(tmp_path / "summary.json")
    with pytest.raises(OutputError, match="regular"):
        load_run(tmp_path)
