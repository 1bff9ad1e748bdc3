"""Stored runs: checksums notice damaged numbers, rows and files, and every kind of run is read as it was written."""

from __future__ import annotations

import copy
import csv
import io
import json
import random
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from repeated import few

from taubench_gl import evaluate, load_run
from taubench_gl.apps import cli
from taubench_gl.checksums import KEY
from taubench_gl.errors import OutputError
from taubench_gl.paths import PACKAGE
from taubench_gl.run import FRAMES_FILE, SUMMARY_FILE

DEMO = PACKAGE.parent / "assets" / "demo.glb"
SMALL: dict[str, Any] = {"size": "32x18", "light_unit": "candela", "exposure": 1, "shadow_size": 64, "probes": 32}
EDITS = 60

KINDS: dict[str, dict[str, Any]] = {
    "strata": {"frames": range(15), "pairs": "strata:5"},
    "exact": {"frames": range(4), "exact": True},
    "lobes": {"frames": range(3), "lobes": "diffuse"},
    "geometry": {"frames": range(3, 6), "columns": "position,normal", "unit_scale": 3.0},
    "one frame": {"frames": range(1)},
    "every": {"frames": range(10), "pairs": "every:3"},
    "samples": {"frames": range(4), "samples_per_pixel": 4},
}


@pytest.fixture(scope="module")
def stored(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("stored") / "run"
    evaluate(DEMO, out=out, frames=range(6), save="masks", **SMALL)
    return out


@pytest.fixture
def folder(stored, tmp_path) -> Path:
    return shutil.copytree(stored, tmp_path / "run")


def numbers(value: Any, at: tuple = ()) -> Iterator[tuple]:
    """Paths of all numbers of a JSON value."""
    if isinstance(value, dict | list):
        for key, below in value.items() if isinstance(value, dict) else enumerate(value):
            yield from numbers(below, (*at, key))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield at


def changed(value: float, rng: random.Random) -> float:
    """Another number of the same type: a digit, a factor, a sign, another power of ten, or noise in the last digits."""
    if isinstance(value, int):
        return value + rng.choice([-1, 1, 2, 10, 1000])
    return rng.choice([value + 1.0, value * 10.0 + 0.5, -value - 1.0, value * (1 + 1e-12) + 1e-12])


def edited_summary(summary: dict, at: tuple, rng: random.Random) -> dict:
    out = copy.deepcopy(summary)
    block = out
    for key in at[:-1]:
        block = block[key]
    block[at[-1]] = changed(block[at[-1]], rng)
    return out


def edited_rows(text: str, rng: random.Random) -> str:
    rows = list(csv.reader(io.StringIO(text)))
    cells = [(r, c) for r in range(1, len(rows)) for c in range(len(rows[r])) if rows[r][c]]
    row, column = rng.choice(cells)
    old = rows[row][column]
    rows[row][column] = repr(changed(float(old) if "." in old or "e" in old else int(old), rng))
    return "".join(",".join(row) + "\n" for row in rows)


def write_json(folder: Path, summary: dict) -> None:
    (folder / SUMMARY_FILE).write_text(json.dumps(summary, indent=2))


def refusal(folder: Path) -> str:
    """The one line with which ``load_run`` refuses a run."""
    with pytest.raises(OutputError) as caught:
        load_run(folder)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("seed", few(range(2)))
def test_random_edits_of_numbers_are_refused(folder, seed):
    rng = random.Random(seed)
    summary, text = json.loads((folder / SUMMARY_FILE).read_text()), (folder / FRAMES_FILE).read_text()
    blocks = {key: list(numbers(summary[key], (key,))) for key in summary}
    blocks = {key: places for key, places in blocks.items() if places}  # equal shares: curves have most numbers
    for number in range(EDITS):
        (folder / FRAMES_FILE).write_text(edited_rows(text, rng) if number % 3 == 0 else text)
        at = rng.choice(blocks[rng.choice(list(blocks))])
        write_json(folder, summary if number % 3 == 0 else edited_summary(summary, at, rng))
        refusal(folder)
    write_json(folder, summary)
    (folder / FRAMES_FILE).write_text(text)
    load_run(folder)


def test_rows_that_are_empty_doubled_swapped_or_missing(folder):
    lines = (folder / FRAMES_FILE).read_text().splitlines(keepends=True)
    cases = {
        "none": lines[:1],
        "empty": [*lines[:2], "," * lines[0].count(",") + "\n", *lines[3:]],
        "doubled": [*lines[:3], lines[2], *lines[3:]],
        "swapped": [lines[0], lines[2], lines[1], *lines[3:]],
        "missing": [*lines[:2], *lines[3:]],
        "last": lines[:-1],
        "torn": [*lines[:-1], lines[-1].rstrip("\n")],
    }
    for name, rows in cases.items():
        (folder / FRAMES_FILE).write_text("".join(rows))
        assert FRAMES_FILE in refusal(folder), name


def test_compare_refuses_a_changed_number_in_one_line(folder, capsys):
    summary = json.loads((folder / SUMMARY_FILE).read_text())
    summary["discard"]["normal"]["mean_percent"] = 1234.5
    write_json(folder, summary)
    with pytest.raises(SystemExit) as ended:
        cli.main(["compare", str(folder)])
    printed = capsys.readouterr()
    assert ended.value.code == 2 and not printed.out and len(printed.err.strip().splitlines()) == 1


def test_values_without_checksums_are_read_as_they_are(folder):
    """A file that somebody changed on purpose, who removed the block ``stored``."""
    summary = json.loads((folder / SUMMARY_FILE).read_text())
    del summary[KEY]
    summary["discard"]["normal"]["mean_percent"] = 12.5
    write_json(folder, summary)
    assert load_run(folder).summary == summary


def test_order_and_indentation_are_no_edits(folder):
    summary = json.loads((folder / SUMMARY_FILE).read_text())
    (folder / SUMMARY_FILE).write_text(json.dumps(dict(reversed(summary.items())), separators=(",", ":")))
    assert len(load_run(folder).frames) == 5


def test_missing_files_are_named(folder, stored, capsys):
    (folder / "masks" / "mask_00002.npz").unlink()
    assert load_run(folder).missing == ["masks/mask_00002.npz"] and load_run(stored).missing == []
    with pytest.raises(SystemExit) as ended:
        cli.main(["compare", str(folder), "--no-paper"])
    printed = capsys.readouterr()
    assert not ended.value.code and printed.out and "masks/mask_00002.npz" in printed.err
    with pytest.raises(SystemExit) as ended:
        cli.main(["reference", "compare", str(folder), str(stored)])
    assert ended.value.code == 2 and "mask_00002.npz" in capsys.readouterr().err


def test_files_that_vanish_during_a_run(tmp_path):
    def on_pair(pair):
        if pair.frame == 2:
            (tmp_path / "masks" / "mask_00001.npz").unlink()

    with pytest.raises(OutputError, match="mask_00001"):
        evaluate(DEMO, out=tmp_path, frames=range(4), save="masks", on_pair=on_pair, columns="position,normal", **SMALL)
    assert not (tmp_path / SUMMARY_FILE).exists()


@pytest.mark.parametrize("kind", few(KINDS, 3))
def test_every_kind_of_run_is_read_as_it_was(tmp_path, kind):
    run = evaluate(DEMO, out=tmp_path, **SMALL | KINDS[kind])
    again = load_run(tmp_path)
    assert again.summary == run.summary and again.frames == run.frames and again.missing == []
