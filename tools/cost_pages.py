"""docs/cost-measured.md and its figures out of the studies that tools/cost_study made: ``cost_pages.py OUT DOCS``."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any

from taubench_gl.conventions import COLUMNS
from taubench_gl.cost.result import ALL
from taubench_gl.cost.rounds import SWEEPS
from taubench_gl.report.study_grid import Grid, ms_text, ratio_text
from taubench_gl.report.study_tables import front_errors, grids, heading, spoken, worst_of

STUDIES = ("cesiumman", "fox", "truck", "lamp", "sponza", "demo", "ladder")
INTRODUCTION = """# What accuracy costs: measured

Made by `DOCS=1 tools/cost_study`; what the words mean is in [cost.md](cost.md). Every study names its machine, its
clock and the load it was measured under. With a load above 1 the milliseconds are those of a busy machine; comparisons
between settings, which are taken round by round, bear that better than the milliseconds themselves.
"""


def main() -> int:
    out, docs = Path(sys.argv[1]), Path(sys.argv[2])
    files = {name: out / name / "study.json" for name in STUDIES}
    studies = {n: json.loads(f.read_text(encoding="utf-8")) for n, f in files.items() if f.is_file()}
    parts = [INTRODUCTION, fullness(studies)]
    for name, study in studies.items():
        parts.append(section(name, study, bool(study["quality"])))
        copy(out / name / "fronts.png", docs / "pictures" / f"cost-{name}.png")
        if study["quality"]:
            copy(out / name / "methods_flip.png", docs / "pictures" / f"cost-{name}-methods.png")
    (docs / "cost-measured.md").write_text("\n".join(parts), encoding="utf-8")
    return 0


def fullness(studies: dict[str, Any]) -> str:
    """How many settings stand on every front."""
    rows = []
    for name, study in studies.items():
        counts = {front: len(found) for front, found in study["fronts"].items()}
        cells = [str(counts.get(column, "")) for column in (*COLUMNS, ALL)]
        rows.append((name, str(settings_of(study)), *cells))
    heads = ("settings on the front", "measured", *COLUMNS, "worst of them")
    words = "So many of the settings that were measured stand on each front."
    return "\n".join([words, "", *table(Grid("fronts", heads, tuple(rows)))])


def settings_of(study: dict[str, Any]) -> int:
    """How many settings were measured and timed, questions aside."""
    return sum(p["role"] != "question" and p["ms"] is not None for p in study["points"])


def section(name: str, study: dict[str, Any], methods: bool) -> str:
    """Provenance, figure, fronts and words.  Of a path-traced reference the folder's own name alone is told."""
    if study["reference"].get("path"):
        study["reference"]["path"] = "exr:" + Path(study["reference"]["path"]).name
    title, *about = heading(study)
    commit, visits = study["provenance"]["git"] or "unknown", study["points"][0]["ms"]["samples"]
    lines = [f"## {title.partition(': ')[2]}", "", f"![fronts of {name}](pictures/cost-{name}.png)", ""]
    lines += [f"- {cell(line)}" for line in about]
    lines += [
        f"- {settings_of(study)} settings, {visits} rounds of {SWEEPS} visits each; commit {commit}",
        "",
    ]
    for grid in fronts(study):
        lines += table(grid)
    if methods:
        lines += [f"![reuse methods of {name}](pictures/cost-{name}-methods.png)", ""]
        for grid in grids(study):
            if grid.title.startswith("Reuse methods"):
                lines += table(grid)
    lines += [f"- {cell(line.strip())}" for line in spoken(study) if not line.endswith(":")]
    return "\n".join([*lines, ""])


def fronts(study: dict[str, Any]) -> list[Grid]:
    """All settings that are on some front, in one table per front."""
    points = {p["name"]: p for p in study["points"]}
    out = []
    for name in study["front_columns"]:
        rows = [
            (p["label"], front_errors(study, name, p), ms_text(p), ratio_text(p))
            for p in (points[n] for n in study["fronts"][name])
        ]
        title = name if name in study["columns"] else worst_of(study, name)
        out.append(Grid(name, (f"front of {title}", "error, points", "ms/frame", "against the base"), tuple(rows)))
    return out


def table(grid: Grid) -> list[str]:
    rule = ("---", *["---:"] * (len(grid.heads) - 1))
    rows = (tuple(map(cell, grid.heads)), rule, *(tuple(map(cell, row)) for row in grid.rows))
    return ["| " + " | ".join(row) + " |" for row in rows] + ["", *(f"{cell(note)}\n" for note in grid.notes)]


def cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;")


def copy(source: Path, target: Path) -> None:
    """A picture for the docs, in a palette of 64 colours: lines and letters need no more."""
    from PIL import Image

    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        Image.open(source).convert("RGB").quantize(64).save(target, optimize=True)
    except OSError:
        shutil.copyfile(source, target)


if __name__ == "__main__":
    sys.exit(main())
