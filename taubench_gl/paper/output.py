"""The files of the paper's tables: paper.html, paper.tex, paper.json, tables in all formats, and the figures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taubench_gl import __version__
from taubench_gl.data_files import read_bytes
from taubench_gl.errors import TaubenchError
from taubench_gl.features import COLUMNS
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.paper.figures import draw_figures
from taubench_gl.paper.fit import Fitted, fit_thresholds
from taubench_gl.paper.scenes import DATASET, AvailableScenes
from taubench_gl.paper.study import PaperOptions, SceneJobs, SceneResult
from taubench_gl.paper.tables import COUNTS, POSITION, ROTATION, paper_row, paper_study_tables, value_at
from taubench_gl.report.page import Page, data_uri, tag, text_lines
from taubench_gl.report.paper import paper_numbers
from taubench_gl.report.table import Table, latex_text, to_html, to_latex, write_tables

SCHEMA = "taubench-gl/paper/1"
PAGE, LATEX, VALUES = "paper.html", "paper.tex", "paper.json"
FIGURES = "figures"

PREAMBLE = r"""\documentclass{article}
\usepackage[utf8]{inputenc}
\usepackage{booktabs}
\usepackage{graphicx}
\usepackage[margin=15mm]{geometry}
\setlength{\tabcolsep}{4pt}
\begin{document}
\footnotesize"""

Figure = tuple[Path, str]
"""The file of a figure, a PNG, and its caption."""


def write_study(
    results: Sequence[SceneResult],
    jobs: Sequence[SceneJobs],
    available: AvailableScenes,
    options: PaperOptions,
    out: Path,
) -> tuple[list[Table], list[Path]]:
    """Write tables, figures, page, LaTeX and JSON of finished runs.  -> tables, files.  Raises TaubenchError."""
    folder = output_folder(out)
    fitted = fitted_of(results)
    tables = paper_study_tables(results, fitted, quick=options.quick)
    figures, notes = _figures(results, jobs, folder)
    write_tables(folder, tables)
    files = {
        PAGE: page(tables, figures, _about(results, available, options) + notes),
        LATEX: latex(tables, figures, folder),
        VALUES: json.dumps(values_of(results, jobs, available, fitted, options), indent=2, ensure_ascii=False) + "\n",
    }
    for name, text in files.items():
        write_atomically(folder / name, text)
    return tables, [folder / name for name in files]


def fitted_of(results: Sequence[SceneResult]) -> dict[str, Fitted]:
    """The fit over the datasets among ``results``, by the first light of each; stand-ins are left out."""
    runs = {
        result.scene.name: (next(iter(result.images.values())).summary, paper_row(result.scene.row)["discard"])
        for result in results if result.scene.kind == DATASET and result.images
    }  # fmt: skip
    return fit_thresholds(runs)


def _figures(results: Sequence[SceneResult], jobs: Sequence[SceneJobs], folder: Path) -> tuple[list[Figure], list[str]]:
    """Figures 1 and 2 of every scene, and why one is missing."""
    drawn: list[Figure] = []
    notes: list[str] = []
    place = output_folder(folder / FIGURES)
    for result, scene in zip(results, jobs, strict=True):
        first = next(iter(scene.images.values())).settings.sequence.fps
        at_first_rate = [name for name in result.images if scene.images[name].settings.sequence.fps == first]
        if not at_first_rate:
            continue
        light = at_first_rate[-1]  # path-traced where it was asked for: it has the better indirect light
        run, job = result.images[light], scene.images[light]
        stem = f"{result.scene.name}-{job.id[-8:]}".replace(".", "-")
        files = place / f"{stem}-figure-1.png", place / f"{stem}-figure-2.png"
        try:
            drawn += draw_figures(job.scene, run, job.settings, result.scene.label, files)
        except TaubenchError as error:
            notes.append(f"No figures of {result.scene.label}: {error}")
    return drawn, notes


def _about(results: Sequence[SceneResult], available: AvailableScenes, options: PaperOptions) -> list[str]:
    """Sentences of the page: which scenes, and how they differ from the paper's."""
    lines = [f"Scenes: {', '.join(result.scene.label for result in results)}."]
    lines += [f"Not measured: {name}: {why}." for name, why in available.missing.items()]
    if any(result.scene.kind != DATASET for result in results):
        lines.append("A stand-in is not the dataset: footnotes mark the figures that it was made to have.")
    if options.quick:
        lines.append("A quick run: Table 4 is estimated of a sample of the pairs.")
    if options.size != (paper_numbers()["settings"]["width"], paper_numbers()["settings"]["height"]):
        lines.append(f"Images of {options.size[0]}x{options.size[1]} pixels: rates depend on the size.")
    return [*lines, f"Made by taubench-gl {__version__}."]


def page(tables: Sequence[Table], figures: Sequence[Figure], about: Sequence[str]) -> str:
    """The page as HTML that loads no other file."""
    sheet = Page("The paper's tables and figures", intro=(text_lines(about),))
    sheet.add("tables", "Tables", to_html(tables, scroll=True))
    images = [(tag("img", src=data_uri(read_bytes(path)), alt=text), tag("figcaption", text)) for path, text in figures]
    if images:
        sheet.add("figures", "Figures", *(tag("figure", *parts) for parts in images))
    return sheet.html()


def latex(tables: Sequence[Table], figures: Sequence[Figure], folder: Path) -> str:
    """A complete LaTeX document: tables with booktabs rules, figures by graphicx.  ``folder``: of the document."""
    lines = [PREAMBLE, to_latex(tables, shrink=True)]
    for path, caption in figures:
        name = path.relative_to(folder).as_posix()
        lines += [r"\begin{figure}", r"\centering", rf"\includegraphics[width=\linewidth]{{{name}}}",
                  rf"\caption{{{latex_text(caption)}}}", r"\end{figure}", ""]  # fmt: skip
    return "\n".join([*lines, r"\end{document}", ""])


def values_of(
    results: Sequence[SceneResult],
    scenes: Sequence[SceneJobs],
    available: AvailableScenes,
    fitted: Mapping[str, Fitted],
    options: PaperOptions,
) -> dict[str, Any]:
    """The contents of paper.json (docs/paper.md)."""
    blocks = []
    for result, jobs in zip(results, scenes, strict=True):
        scene = result.scene
        block = {"name": scene.name, "paper_row": scene.row, "kind": scene.kind, "fitted": sorted(scene.fitted)}
        block |= {} if result.camera is None else _camera_values(result.camera.summary)
        block["images"] = {
            light: {
                "job": jobs.images[light].id,
                "pairs": run.summary["pairs"],
                "settings": run.summary["settings"],
                "discard": {name: run.summary["discard"][name] for name in COLUMNS},
                **{key: run.summary[key] for key in ("lobes", "sampling") if key in run.summary},
                "notes": run.summary["notes"],
                "provenance": run.summary["provenance"],
            }
            for light, run in result.images.items()
        }
        blocks.append(block | {"paper": paper_row(scene.row), "failed": result.failed})
    thresholds = {n: {"threshold": f.threshold, "rms": f.rms, "residuals": f.residuals} for n, f in fitted.items()}
    return {
        "schema": SCHEMA,
        "version": __version__,
        "citation": paper_numbers()["citation"],
        "quick": options.quick,
        "size": list(options.size),
        "scenes": blocks,
        "missing": available.missing,
        "thresholds": thresholds,
    }


def _camera_values(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Our values of Tables 1 to 3, and of which file, rate and pairs they are."""
    return {
        "sha256": summary["scene"]["sha256"],
        "census": {key: value_at(summary, ("census", key)) for key in COUNTS},
        "position": {key: value_at(summary, ("camera", "position", key)) for key in POSITION},
        "rotation": {f"{axis}_{key}": value_at(summary, ("camera", axis, key)) for axis, key in ROTATION},
        "camera_fps": summary["camera"]["fps"],
        "camera_samples": summary["camera"]["samples"],
    }
