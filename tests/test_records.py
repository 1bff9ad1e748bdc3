"""tools/record: what is declared exists, cheap records are current, stale ones are found by what they depend on."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))
import record_files
import recorders
from records import EVERY, Record, Records

ROOT = Path(__file__).resolve().parents[1]
HERE = Records(EVERY)


def test_every_declared_file_exists():
    missing = [path for r in EVERY for path in (*r.files, *r.depends) if not (ROOT / path).exists()]
    assert not missing
    assert all(bool(r.contents) != bool(r.depends) for r in EVERY), "hashes, or texts that are compared"
    assert len({r.name for r in EVERY}) == len(EVERY)


def test_images_and_marked_tables_are_declared():
    declared = {path for r in EVERY for path in r.files}
    images = {str(p.relative_to(ROOT)) for p in (ROOT / "docs" / "images").iterdir()}
    marked = {str(p.relative_to(ROOT)) for p in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
              if "<!-- record: " in p.read_text(encoding="utf-8")}  # fmt: skip
    assert images | marked <= declared


@pytest.mark.parametrize("record", [r for r in EVERY if r.contents], ids=lambda r: r.name)
def test_cheap_records_are_current(record):
    assert HERE.changed(record) == [], f"run: tools/record {record.name}"


def test_stale_records_are_named():
    """A note, not an error: an edited shader makes many stale that take hours."""
    stale = [r.name for r in EVERY if r.depends and HERE.changed(r)]
    if stale:
        warnings.warn(f"stale records, see tools/record: {', '.join(stale)}", stacklevel=1)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    (tmp_path / "shaders" / "topic").mkdir(parents=True)
    (tmp_path / "shaders" / "topic" / "a.glsl").write_text("1")
    (tmp_path / "scene.glb").write_text("2")
    (tmp_path / "hashes.json").write_text("{}")
    return tmp_path


def records(root: Path, *every: Record) -> Records:
    return Records(every, root, root / "hashes.json")


def test_a_record_is_stale_by_the_dependency_that_changed(checkout):
    table = Record("table", ("table.md",), ("shaders", "scene.glb"), lambda work: None)
    other = Record("other", ("other.md",), ("scene.glb",), lambda work: None)
    every = records(checkout, table, other)
    assert every.changed(table) == ["shaders", "scene.glb"], "never made"
    every.make(table, checkout / "work")
    every.keep(other, every.digests(other))
    assert every.changed(table) == every.changed(other) == []
    (checkout / "shaders" / "__pycache__").mkdir()
    (checkout / "shaders" / "__pycache__" / "a.pyc").write_text("compiled")
    assert every.changed(table) == []
    (checkout / "shaders" / "topic" / "a.glsl").write_text("3")
    assert every.changed(table) == ["shaders"] and every.changed(other) == []
    (checkout / "shaders" / "topic" / "a.glsl").write_text("1")
    assert every.changed(table) == []
    (checkout / "shaders" / "topic" / "a.glsl").rename(checkout / "shaders" / "a.glsl")
    assert every.changed(table) == ["shaders"]


def test_a_failed_command_keeps_the_hashes(checkout):
    def fails(work: Path) -> None:
        raise SystemExit("the command failed")

    table = Record("table", ("table.md",), ("scene.glb",), fails)
    every = records(checkout, table)
    with pytest.raises(SystemExit):
        every.make(table, checkout / "work")
    assert every.changed(table) == ["scene.glb"] and every.kept() == {}


def test_a_marked_part_is_replaced(tmp_path):
    page = tmp_path / "page.md"
    text = "before\n\n<!-- record: a -->\n\n| old |\n\n<!-- end -->\n\nafter\n<!-- record: b -->\n<!-- end -->\n"
    page.write_text(text)
    record_files.write_marked(page, "a", "| new |\n")
    assert page.read_text() == text.replace("old", "new")
    with pytest.raises(SystemExit):
        record_files.write_marked(page, "c", "text")


def test_the_readme_shows_parts_of_the_output():
    """The sample leaves out other tables of the output whose rows have the same titles."""
    head = "camera reprojection: 1 %\n  more\n\nTable 1: Details\n\n  a\n    Eternal Valley VR   9\n\n"
    table = "Table 4: Discarded\n\n  demo  1\n\n  the paper:\n    Eternal Valley FPS  2\n    Eternal Valley VR   3\n"
    rest = "    Toasters  4\n\nat half and twice the exposure: direct 1 and\n2.5 %.\nThe paper.\n"
    expected = f"camera reprojection: 1 %\n  more\n\n{table}\nat half and twice the exposure: direct 1 and\n2.5 %.\n"
    assert recorders.readme_sample(head + table + rest) == expected
    with pytest.raises(SystemExit):
        recorders.readme_sample(head + rest)
