"""Scores as plain data (schema ``taubench-gl/conformance/1``), tables, JUnit XML and one HTML page."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from markupsafe import Markup

from taubench_gl import __version__
from taubench_gl.conformance.cases import CASES
from taubench_gl.conformance.score import NO_PLACE, NOT_JUDGED, RIGHT, WRONG, CaseScore, ClassScore, WorstPixel
from taubench_gl.conformance.truth import Frame, Truth
from taubench_gl.conventions import DEFINITIONS
from taubench_gl.outputs import image_bytes, output_folder, write_atomically
from taubench_gl.report.page import Page, data_uri, tag, text_lines
from taubench_gl.report.table import Column, Row, Table, to_html

Array = np.ndarray
SCHEMA = "taubench-gl/conformance/1"
SCORE_FILE, JUNIT_FILE, PAGE_FILE = "conformance.json", "junit.xml", "conformance.html"
_SCALE = 4
"""Width and height, in pixels of the page, of one pixel of a frame that the page shows."""


def score_summary(scores: Sequence[CaseScore], about: Mapping[str, Any]) -> dict[str, Any]:
    """Scores as plain data, the content of the JSON file.  ``about``: engine, frames, mapping and size.  Percentages
    are of the scored pixels of a class.
    """
    states = Counter(score.status for score in scores)
    causes = Counter(cause for score in scores for cause in score.causes)
    return {
        "schema": SCHEMA, **about, "provenance": {"version": __version__, "definitions": DEFINITIONS},
        "right": states[RIGHT], "wrong": states[WRONG], "not_judged": states[NOT_JUDGED],
        "causes": [{"text": text, "cases": count} for text, count in causes.most_common()],
        "cases": [_case_summary(score) for score in scores],
    }  # fmt: skip


def _case_summary(score: CaseScore) -> dict[str, Any]:
    out: dict[str, Any] = {"name": score.name, "status": score.status, "reason": score.reason or None}
    out["classes"] = [
        {
            "name": each.name, "pixels": each.pixels, "wrong_percent": 100 * each.wrong / each.pixels,
            "median_px": _number(each.median_px), "p95_px": _number(each.p95_px), "max_px": _number(each.max_px),
            "missing": each.missing, "cause": each.text if each.failed else None,
        }
        for each in score.classes
    ]  # fmt: skip
    if score.rejection is not None:
        out["rejection"] = dict(zip(("precision", "recall"), score.precision_recall, strict=True))
    if score.worst is not None:
        w = score.worst
        vectors = {"vector_px": [_number(x) for x in w.vector], "right_px": [_number(x) for x in w.right]}
        out["worst"] = {"frame": w.frame, "column": w.column, "row": w.row, "class": w.kind} | vectors
    return out


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def score_tables(scores: Sequence[CaseScore], summary: Mapping[str, Any]) -> list[Table]:
    """A table with a row for each case: its verdict, the share of wrong vectors, errors, and why."""
    columns = (
        Column("verdict"), Column("wrong", "%", 2, "Vectors off by more than 0.1 px, of the scored pixels"),
        Column("p95", "px", 3), Column("largest", "px", 2, "The largest error"),
        Column("precision", "%", 1, "Of rejected pixels, those without history"),
        Column("recall", "%", 1, "Of pixels without history, those that were rejected"),
    )  # fmt: skip
    rows = []
    for score in scores:
        pixels = sum(each.pixels for each in score.classes)
        wrong = 100 * sum(each.wrong for each in score.classes) / pixels if pixels else None
        errors = [[getattr(each, name) for each in score.classes] for name in ("p95_px", "max_px")]
        largest = [max(filter(math.isfinite, values), default=None) for values in errors]
        shares = [None if x is None else 100 * x for x in score.precision_recall]
        reasons = {0: score.why} if score.why else {}
        rows.append(Row(score.name, (score.status, wrong, *largest, *shares), reasons=reasons))
    counts = f"{summary['right']} cases right, {summary['wrong']} wrong, {summary['not_judged']} not judged"
    lead = [f"{summary['engine']}: {counts}", *(f"{c['text']}: cases {c['cases']}" for c in summary["causes"])]
    return [Table("conformance", "Conformance", columns, tuple(rows), lead=tuple(lead))]


def junit(scores: Sequence[CaseScore], summary: Mapping[str, Any]) -> str:
    """The scores as JUnit XML: wrong cases are failures, cases that are not judged are skipped."""
    suite = ElementTree.Element("testsuite", name=f"conformance of {summary['engine']}", errors="0",
                                tests=str(len(scores)), failures=str(summary["wrong"]),
                                skipped=str(summary["not_judged"]))  # fmt: skip
    for score in scores:
        element = ElementTree.SubElement(suite, "testcase", classname="conformance", name=score.name)
        if score.status == NOT_JUDGED:
            ElementTree.SubElement(element, "skipped", message=score.reason)
        elif score.status == WRONG:
            text = "; ".join(_class_line(each) for each in score.classes if each.failed)
            ElementTree.SubElement(element, "failure", message=text)
    ElementTree.indent(suite)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(suite, encoding="unicode") + "\n"


def save_scores(
    scores: Sequence[CaseScore], summary: Mapping[str, Any], sizes: Mapping[str, tuple[int, int]], out: Path
) -> None:
    """Write the scores to ``out`` as JSON, JUnit XML and a page; ``sizes``: of each case.  Raises OutputError."""
    out = output_folder(out)
    write_atomically(out / SCORE_FILE, json.dumps(summary, indent=1, allow_nan=False) + "\n")
    write_atomically(out / JUNIT_FILE, junit(scores, summary))
    write_atomically(out / PAGE_FILE, _page(scores, summary, sizes).html())


def _page(scores: Sequence[CaseScore], summary: Mapping[str, Any], sizes: Mapping[str, tuple[int, int]]) -> Page:
    """The page: the worst pixel of the worst case first, then the table, then every other wrong case."""
    page = Page(f"{summary['engine']}: conformance", kind="conformance suite")
    wrong = [score for score in scores if score.worst and score.status == WRONG]
    wrong.sort(key=lambda score: _number(score.worst.error_px) or 0.0, reverse=True)
    for score in wrong[:1]:
        page.add("worst", f"The worst pixel: case {score.name}", *_shown(score, sizes[score.name]))
    page.add("cases", "All cases", to_html(score_tables(scores, summary), scroll=True))
    for score in wrong[1:]:
        page.add(score.name, f"Case {score.name}", *_shown(score, sizes[score.name]))
    return page


def _shown(score: CaseScore, size: tuple[int, int]) -> list[Markup]:
    """HTML of a wrong case: its causes, its worst pixel in both frames with both vectors, its classes."""
    truth, w = Truth(CASES[score.name], size), score.worst
    vector, right = (f"({v[0]:+.2f}, {v[1]:+.2f}) px" if np.isfinite(v).all() else "none" for v in (w.vector, w.right))
    said = f"Pixel {w.column}, {w.row} of frame {w.frame} ({w.kind}): the vector is {vector}, the right one is {right}."
    note = ("Left: the frame. Right: the previous one. The pixel is circled; red: where the vector leads, green: where "
            "the surface point was. Shaded by the scorer from the scene file.")  # fmt: skip
    now, before = truth.frame(w.frame), truth.frame(max(w.frame - 1, 0))
    images = [_svg(now, w, size, False), _svg(before, w, size, True)]
    listed = tag("ul", *(tag("li", _class_line(each)) for each in score.classes if each.failed))
    return [text_lines([CASES[score.name].text]), text_lines([f"{score.why}.", said]), tag("div", *images),
            text_lines([note]), listed]  # fmt: skip


def _class_line(each: ClassScore) -> str:
    errors = f"errors: median {each.median_px:.3g}, 95 % within {each.p95_px:.3g}, largest {each.max_px:.3g} px"
    share = 100 * each.wrong / each.pixels
    what = "they lead into the image" if each.name == NO_PLACE else errors
    return f"{each.name}: {share:.1f} % of {each.pixels} vectors wrong; {what}; {each.text}"


def _svg(frame: Frame, worst: WorstPixel, size: tuple[int, int], arrows: bool) -> Markup:
    """SVG of a frame with the worst pixel circled and, with ``arrows``, both vectors."""
    width, height = (n * _SCALE for n in size)
    x, y = ((n + 0.5) * _SCALE for n in (worst.column, worst.row))
    parts = [tag("image", href=data_uri(_picture(frame)), width=str(width), height=str(height),
                 style="image-rendering: pixelated")]  # fmt: skip
    for (dx, dy), color in ((worst.right, "#009e73"), (worst.vector, "#d00000")) if arrows else ():
        if math.isfinite(dx) and math.isfinite(dy):
            end = {"x2": f"{x + _SCALE * dx:.1f}", "y2": f"{y + _SCALE * dy:.1f}"}
            parts.append(tag("line", x1=str(x), y1=str(y), **end, stroke=color, stroke_width="2"))
            parts.append(tag("circle", cx=end["x2"], cy=end["y2"], r="3", fill=color))
    parts.append(tag("circle", cx=str(x), cy=str(y), r=str(2 * _SCALE), fill="none", stroke="#ffffff"))
    parts.append(tag("circle", cx=str(x), cy=str(y), r=str(2 * _SCALE + 1), fill="none", stroke="#000000"))
    return tag("svg", *parts, viewBox=f"0 0 {width} {height}", style="max-width: 49%; width: 30rem; margin-right: 1%")


def _picture(frame: Frame) -> bytes:
    """PNG of a frame lit from the camera, with a color for each object."""
    colors = np.random.default_rng(5).uniform(0.35, 0.95, (int(frame.node.max()) + 2, 3))
    colors[-1] = (0.62, 0.75, 0.9)  # node -1: sky
    facing = np.abs(frame.normal @ frame.view.world_from_view[:, 2])
    shade = np.where(frame.node >= 0, 0.35 + 0.65 * facing, 1.0)
    return image_bytes((255 * colors[frame.node] * shade[..., None]).astype(np.uint8))
