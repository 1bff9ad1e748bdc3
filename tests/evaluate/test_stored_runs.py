"""Stored runs: checksums notice damaged numbers, rows and files, and every kind of run is read as it was written."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path
from typing import Any

import pytest
from repeated import few

from taubench_gl import evaluate, load_run
from taubench_gl.checksums import KEY
from taubench_gl.errors import OutputError
from taubench_gl.paths import PACKAGE
from taubench_gl.run import FRAMES_FILE, SUMMARY_FILE

pytestmark = pytest.mark.usefixtures("fixed_light")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
SMALL: dict[str, Any] = {"size": "32x18", "light_unit": "candela", "exposure": 1, "shadow_size": 64, "probes": 32}
EDITS = 6

KINDS: dict[str, dict[str, Any]] = {
    "strata": {"frames": range(15), "pairs": "strata:5"},
    "exact": {"frames": range(4), "exact": True},
    "lobes": {"frames": range(3), "lobes": "diffuse"},
    "geometry": {"frames": range(3, 6), "columns": "position,normal", "unit_scale": 3.0},
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


def write_json(folder: Path, summary: dict) -> None:
    (folder / SUMMARY_FILE).write_text(json.dumps(summary, indent=2))


def refusal(folder: Path) -> str:
    """The one line with which ``load_run`` refuses a run."""
    with pytest.raises(OutputError) as caught:
        load_run(folder)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("name", [SUMMARY_FILE, FRAMES_FILE])
def test_a_changed_digit_is_refused(folder, name):
    text = (folder / name).read_text()
    digits = [at for at, letter in enumerate(text) if letter.isdigit()]
    for at in random.Random(1).sample(digits, EDITS):
        (folder / name).write_text(f"{text[:at]}{(int(text[at]) + 5) % 10}{text[at + 1 :]}")
        refusal(folder)
    (folder / name).write_text(text)
    load_run(folder)


def test_rows_that_are_empty_doubled_swapped_or_missing(folder):
    lines = (folder / FRAMES_FILE).read_text().splitlines(keepends=True)
    cases = {
        "none": lines[:1],
        "empty": [*lines[:2], "," * lines[0].count(",") + "\n", *lines[3:]],
        "swapped": [lines[0], lines[2], lines[1], *lines[3:]],
        "last": lines[:-1],
        "torn": [*lines[:-1], lines[-1].rstrip("\n")],
    }
    for name, rows in cases.items():
        (folder / FRAMES_FILE).write_text("".join(rows))
        assert FRAMES_FILE in refusal(folder), name


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


def test_missing_files_are_named(folder, stored, taubench):
    (folder / "masks" / "mask_00002.npz").unlink()
    assert load_run(folder).missing == ["masks/mask_00002.npz"] and load_run(stored).missing == []
    code, out, err = taubench("compare", folder, "--no-paper")
    assert code == 0 and out and "masks/mask_00002.npz" in err
    code, _, err = taubench("reference", "compare", folder, stored)
    assert code == 2 and "mask_00002.npz" in err


@pytest.mark.parametrize("kind", few(KINDS, 3))
def test_every_kind_of_run_is_read_as_it_was(tmp_path, kind):
    run = evaluate(DEMO, out=tmp_path, **SMALL | KINDS[kind])
    again = load_run(tmp_path)
    assert again.summary == run.summary and again.frames == run.frames and again.missing == []
