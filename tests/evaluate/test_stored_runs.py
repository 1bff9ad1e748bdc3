"""Stored runs check themselves: edits of numbers, rows and files are found, and every kind of run passes its check."""

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
from taubench_gl.run_check import contradiction

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


@pytest.mark.parametrize("block", ["reusable", "discard", "classes", "camera", "curves", "mask_histogram"])
def test_edits_of_shown_numbers_are_recomputed_without_the_checksums(folder, block):
    """Every number of these blocks follows from rows and histogram, so the line names key and both values."""
    summary = json.loads((folder / SUMMARY_FILE).read_text())
    del summary[KEY]
    places = [at for at in numbers(summary[block], (block,)) if at[-1] != "fps"]
    write_json(folder, summary)
    rows = load_run(folder).frames
    rng = random.Random(block)
    for at in rng.sample(places, min(40, len(places))):
        wrong = copy.deepcopy(summary)
        inner = wrong
        for key in at[:-1]:
            inner = inner[key]
        inner[at[-1]] += 3
        found = contradiction(wrong, rows)
        assert found is not None and not found.in_rows, at
        assert found.key.startswith(block) or found.key.startswith("the length"), (at, found)


@pytest.mark.parametrize("sealed", [True, False], ids=["with checksums", "without"])
def test_rows_that_are_empty_doubled_swapped_or_missing(folder, sealed):
    lines = (folder / FRAMES_FILE).read_text().splitlines(keepends=True)
    if not sealed:
        summary = json.loads((folder / SUMMARY_FILE).read_text())
        del summary[KEY]
        write_json(folder, summary)
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


def test_compare_refuses_1234_percent_and_an_unknown_reason(folder, capsys):
    summary = json.loads((folder / SUMMARY_FILE).read_text())
    recorded = summary["discard"]["normal"]["mean_percent"]
    for change in ({"mean_percent": 1234.5}, None):
        wrong = copy.deepcopy(summary)
        if change is None:
            wrong["reusable"]["reasons"]["moonlight"] = {"mean_percent": 1.0, "pixels": 1}
            del wrong[KEY]
        else:
            wrong["discard"]["normal"] |= change
        write_json(folder, wrong)
        with pytest.raises(SystemExit) as ended:
            cli.main(["compare", str(folder)])
        printed = capsys.readouterr()
        assert ended.value.code == 2 and not printed.out and len(printed.err.strip().splitlines()) == 1
        wanted = ["discard.normal.mean_percent", "1234.5", f"{recorded:.10g}"] if change else ["moonlight"]
        assert all(text in printed.err for text in wanted)


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
def test_every_kind_of_run_passes_its_check(tmp_path, kind):
    run = evaluate(DEMO, out=tmp_path, **SMALL | KINDS[kind])
    again = load_run(tmp_path)
    assert again.summary == run.summary and again.missing == []
    summary = json.loads((tmp_path / SUMMARY_FILE).read_text())
    del summary[KEY]
    for block, key in (("reusable", "surface"), ("discard", "normal")):
        wrong = copy.deepcopy(summary)
        wrong[block][key]["mean_percent"] = (wrong[block][key]["mean_percent"] or 0.0) + 0.001
        found = contradiction(wrong, again.frames)
        assert found is not None and found.key == f"{block}.{key}.mean_percent"
