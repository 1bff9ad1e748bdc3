"""Writes docs/cost-measured.md and its figure from the studies of tools/cost_study: ``cost_pages.py OUT DOCS``."""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taubench_gl.cost.preset import LEVELS
from taubench_gl.report.cost_plots import plot_study
from taubench_gl.report.cost_tables import answer, three

Study = Mapping[str, Any]


def main() -> int:
    out, docs = Path(sys.argv[1]), Path(sys.argv[2])
    studies = {f.parent.name: json.loads(f.read_text(encoding="utf-8")) for f in sorted(out.glob("*/study.json"))}
    (docs / "cost-measured.md").write_text(page(studies), encoding="utf-8")
    for name, study in studies.items():
        for path in plot_study(study, docs / "images"):
            path.rename(path.with_name(f"cost-{name}{path.suffix}")) if path.suffix == ".png" else path.unlink()
    return 0


def page(studies: Mapping[str, Study]) -> str:
    lines = ["# Cost studies: measurements", "", "Words: [cost.md](cost.md).", "", "## Levels", "", *level_table(), ""]
    for name, study in studies.items():
        width, height = study["size"]
        about = f"{width}x{height}, {study['pairs']} pairs, {', '.join(study['columns'])}; {study['date']}"
        lines += [f"## {name}", "", about, "", *(f"- {line}" for line in answer(study)), ""]
        lines += [f"![Mask error against time, {name}](images/cost-{name}.png)", ""]
    return "\n".join(lines)


def level_table() -> Sequence[str]:
    """Markdown rows: what each level costs and loses, as its preset says."""
    found = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in LEVELS.items()}
    first = found["balanced"]["measured"]
    columns = list(first["wrong_percent"])
    rows = [
        f"Percent of wrong masks by column; ms/frame of {first['scene']}, {first['size']}, {first['renderer']}, "
        f"{first['driver']}, {first['date']}; reference: {first['reference_samples']} samples per pixel; noise floor "
        f"overall {three(first['noise_floor_percent'])} %; {first['rounds']} rounds of timing"
        + (", on a busy machine: times are rough." if first["machine_busy"] else "."),
        "",
        f"| level | ms/frame | of balanced | {' | '.join(columns)} | differs from the defaults |",
        f"| --- | ---: | ---: |{' ---: |' * len(columns)} --- |",
    ]
    defaults = found["balanced"]["settings"]
    for name, preset in found.items():
        measured, settings = preset["measured"], preset["settings"]
        changed = ", ".join(f"{k} {v}" for k, v in settings.items() if defaults.get(k) != v) or "–"
        wrong = " | ".join(three(measured["wrong_percent"][c]) for c in columns)
        ratio = f"{measured['times_balanced']:.3g}x"
        rows.append(f"| {name} | {three(measured['ms_per_frame'])} | {ratio} | {wrong} | {changed} |")
    return rows


if __name__ == "__main__":
    sys.exit(main())
