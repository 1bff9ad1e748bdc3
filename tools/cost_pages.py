"""Writes docs/cost-measured.md and its figure from the studies of tools/cost_study: ``cost_pages.py OUT DOCS``."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl.cost.result import ALL
from taubench_gl.report.cost_tables import Table, markdown_table, three

FIGURE = "images/cost-fronts.png"


@dataclass(frozen=True, slots=True)
class Measured:
    """One study.  ``front``: (time over the baseline's, error in pp), fastest first."""

    name: str
    subject: str  # size, pairs, columns
    configurations: int
    chosen: str
    error: str
    ms: str
    ratio: str
    validation: str
    front: Sequence[tuple[float, float]]


def main() -> int:
    out, docs = Path(sys.argv[1]), Path(sys.argv[2])
    files = sorted(out.glob("*/study.json"))
    studies = {f.parent.name: json.loads(f.read_text(encoding="utf-8")) for f in files}
    found = [measured(name, study) for name, study in studies.items()]
    about = sorted({about_line(study) for study in studies.values()})
    write_page(found, about, docs)
    return 0


def measured(name: str, study: Mapping[str, Any]) -> Measured:
    width, height = study["size"]
    points = {p["name"]: p for p in study["points"]}
    front = ALL if ALL in study["fronts"] else study["columns"][0]
    columns = study["front_columns"][front]
    steps = [points[n] for n in study["fronts"][front] if points[n]["role"] != "path_traced"]
    errors = {p["name"]: max(p["columns"][c]["error"] for c in columns) for p in steps}
    chosen = points.get((study["chosen"] or {}).get("configuration"))
    cells = ("–", "–", "–", "–", "–")
    if chosen is not None:
        error = max(chosen["columns"][c]["error"] for c in study["chosen"]["columns"])
        found = study["validation"] or {}
        passed = found.get("errors_pass") and found.get("time_pass") is not False
        ratio = f"{chosen['against_baseline']['ratio']:.3g}"
        cells = (chosen["label"], three(error), three(chosen["ms"]["median"]), ratio, "PASS" if passed else "FAIL")
    return Measured(
        name,
        f"{width}x{height}, {study['pairs']} pairs, {', '.join(columns)}",
        sum(p["role"] != "definition" and p["ms"] is not None for p in points.values()),
        *cells,
        front=[(p["against_baseline"]["ratio"], errors[p["name"]]) for p in steps],
    )


def about_line(study: Mapping[str, Any]) -> str:
    machine, commit = study["machine"], study["provenance"]["git"] or "unknown"
    load = "unknown" if study["load"] is None else f"{study['load']:.1f}"
    return f"{machine['renderer']}, {machine['processor']}, {machine['cores']} cores; load {load}; commit {commit}"


def write_page(found: Sequence[Measured], about: Iterable[str], docs: Path) -> None:
    """docs/cost-measured.md and its figure."""
    heads = ("scene", "measured", "configurations", "chosen", "error, pp", "ms/frame", "x baseline", "validation")
    rows = [(m.name, m.subject, str(m.configurations), m.chosen, m.error, m.ms, m.ratio, m.validation) for m in found]
    lines = [
        "# Cost studies: measurements",
        "",
        "Words: [cost.md](cost.md). `DOCS=1 tools/cost_study` measures the studies and writes this page.",
        "",
        markdown_table(Table("chosen", heads, tuple(rows))),
        "",
        f"![Error against time of the Pareto fronts]({FIGURE})",
        "",
        "Pareto fronts of the worst error over the columns. Time is relative to the baseline of each scene.",
        "",
        *(f"- {line}" for line in about),
    ]
    (docs / "cost-measured.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    plot_fronts(found, docs / FIGURE)


def plot_fronts(found: Sequence[Measured], path: Path) -> None:
    """Fronts of all studies in one figure: time over the baseline's, error in pp."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.6, 5.0), dpi=110, layout="constrained")
    axes = figure.subplots()
    for m, marker in zip(found, "osD^vP*X"):
        axes.step(*zip(*m.front), where="post", marker=marker, markersize=5, linewidth=1.3, label=m.name)
    axes.axvline(1.0, color="#888888", linewidth=0.9, linestyle="--")
    axes.set(xscale="log", xlabel="time of a frame / baseline (log)", ylabel="error, pp (linear near 0)")
    axes.set_yscale("symlog", linthresh=1e-2)
    axes.set_ylim(bottom=0.0)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.grid(True, alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9)
    figure.savefig(path, metadata={"Software": None})


if __name__ == "__main__":
    sys.exit(main())
