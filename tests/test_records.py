"""Records of tools/record: what is declared exists, cheap ones are current, stale ones are named."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))
from records import EVERY, Records

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
