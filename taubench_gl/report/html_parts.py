"""The parts of a report that need no script: heading, key figures, tables, effects, cuts, provenance."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

from taubench_gl.conventions import COLUMNS
from taubench_gl.report.palette import hex_of
from taubench_gl.report.render import NONE, to_html
from taubench_gl.report.tables import paper_numbers, paper_tables

Summary = Mapping[str, Any]

escape = html.escape


def about(summary: Summary) -> str:
    """``60 pairs at 24 fps · 320 × 180 · camera reprojection, nearest sampling``."""
    settings = summary.get("settings") or {}
    ways = f"{settings.get('reprojection', '?')} reprojection, {settings.get('sampling', '?')} sampling"
    size = f"{settings.get('width', '?')} × {settings.get('height', '?')} pixels"
    rate = settings.get("fps")
    rate = "?" if rate is None else f"{rate:g}"
    count = summary.get("pairs", 0)
    return escape(f"{count} pair{'' if count == 1 else 's'} at {rate} fps · {size} · {ways}")


def key_figures(summaries: Sequence[Summary], labels: Sequence[str]) -> str:
    """One row of figures per run: the mean of every column, its largest pair, and where the paper's scenes stand."""
    return "".join(
        f"<div class='figures' role='group' aria-label='{escape(label, quote=True)}'>"
        + (f"<h3>{escape(label)}</h3>" if len(labels) > 1 else "")
        + "".join(_figure(summary, column) for column in COLUMNS)
        + "</div>"
        for summary, label in zip(summaries, labels, strict=True)
    )


def _figure(summary: Summary, column: str) -> str:
    entry = (summary.get("discard") or {}).get(column) or {}
    mean = entry.get("mean_percent")
    head = f"<dt><i class='swatch' style='background:{hex_of(column)}'></i>{column}</dt>"
    if mean is None:
        reason = entry.get("reason") or "not measured"
        return f"<dl class='figure none'>{head}<dd class='big'>{NONE}</dd><dd class='small'>{escape(reason)}</dd></dl>"
    highest = entry.get("max_percent")
    small = "" if highest is None else f"at most {_percent(highest)} %"
    return (
        f"<dl class='figure'>{head}<dd class='big'>{_percent(mean)}<small> %</small></dd>"
        f"<dd class='small'>{small}</dd><dd>{_strip(column, mean)}</dd></dl>"
    )


def _strip(column: str, mean: float) -> str:
    """A line from 0 to 40 % (or the run's own value): rings are the paper's scenes, the dot is this run."""
    paper = {s["name"]: s["discard"][column] for s in paper_numbers()["scenes"]}
    end = max(40.0, 1.08 * mean)
    rings = "".join(
        f"<circle class='paper' cx='{4 + 112 * value / end:.1f}' cy='9' r='3'>"
        f"<title>{escape(name)}: {value:g} %</title></circle>"
        for name, value in paper.items()
        if value is not None
    )
    label = f"paper: {', '.join(f'{name} {value:g} %' for name, value in paper.items() if value is not None)}"
    return (
        f"<svg class='strip' viewBox='0 0 120 18' role='img' aria-label='{escape(label, quote=True)}'>"
        f"<line x1='4' x2='116' y1='9' y2='9'/>{rings}"
        f"<circle cx='{4 + 112 * mean / end:.1f}' cy='9' r='4.5' fill='{hex_of(column)}' class='own'/></svg>"
    )


def tables(summaries: Sequence[Summary]) -> str:
    """Tables 1 to 4 beside the paper's rows, each in a box of its own that scrolls on narrow screens."""
    boxes = []
    for table in paper_tables(summaries):
        opening = f"<div class='wide' tabindex='0' role='region' aria-label='Table {table.number}'><table>"
        boxes.append(to_html([table]).replace("<table>", opening).replace("</table>", "</table></div>"))
    return "".join(boxes)


def effects(summary: Summary) -> str:
    """What was simulated and what was not, with the evidence; those that are on first."""
    told = summary.get("effects") or {}
    if not told:
        return "<p class='muted'>No effects were decided: the pictures come from files.</p>"
    rows = ""
    for name, entry in sorted(told.items(), key=lambda item: not item[1].get("on")):
        state = "on" if entry.get("on") else "off"
        head = f"<b>{escape(name.replace('_', ' '))}</b> <span class='state'>{state}</span>"
        rows += f"<li class='{state}'>{head} <span>{escape(str(entry.get('reason') or ''))}</span></li>"
    return f"<ul class='effects'>{rows}</ul>"


def cuts(summary: Summary) -> str:
    """Cut pairs, or that there is none."""
    camera = summary.get("camera") or {}
    found = camera.get("cuts") or []
    gimbal = camera.get("gimbal_pairs") or []
    more = (
        f" In {len(gimbal)} pairs the camera looks straight up or down, where yaw and roll mean little."
        if gimbal
        else ""
    )
    if not found:
        return f"<p>No pair is a cut.{more}</p>"
    fps = (summary.get("settings") or {}).get("fps") or 0
    marks = "".join(f"<li><b>frame {c}</b>{f' <span>{c / fps:.3f} s</span>' if fps else ''}</li>" for c in found)
    told = f"{len(found)} of {summary.get('pairs')} pairs are cuts; figures without them stand beside.{more}"
    return f"<p>{told}</p><ul class='cuts'>{marks}</ul>"


def timing(summary: Summary) -> str:
    """Milliseconds of every pass, with the clock that measured them."""
    told = summary.get("timing") or {}
    passes = {k: v for k, v in (told.get("passes") or {}).items() if v is not None}
    if not passes:
        return "<p class='muted'>No pass was timed.</p>"
    most = max(passes.values()) or 1.0
    rows = "".join(
        f"<tr><th scope='row'>{escape(name)}</th><td>{ms:.2f}</td>"
        f"<td class='bar'><i style='width:{100 * ms / most:.1f}%'></i></td></tr>"
        for name, ms in passes.items()
    )
    clock = escape(str(told.get("clock") or "unknown"))
    head = "<thead><tr><th></th><th>ms</th><th></th></tr></thead>"
    told = f"<p class='muted'>Median per frame. Clock: {clock}.</p>"
    return f"<table class='timing'>{head}<tbody>{rows}</tbody></table>{told}"


def listing(block: Mapping[str, Any] | None) -> str:
    """A definition list of a block of the summary."""
    rows = "".join(
        f"<dt>{escape(k.replace('_', ' '))}</dt><dd>{escape(_plain(v))}</dd>" for k, v in (block or {}).items()
    )
    return f"<dl class='listing'>{rows}</dl>" if rows else "<p class='muted'>Not recorded.</p>"


def notes(summary: Summary) -> str:
    """What the reader and the light decided or left out."""
    told = [str(n) for n in summary.get("notes") or ()]
    if not told:
        return "<p>No note.</p>"
    more = f"<li>and {len(told) - 40} more, see summary.json</li>" if len(told) > 40 else ""
    return f"<ul>{''.join(f'<li>{escape(n)}</li>' for n in told[:40])}{more}</ul>"


def _plain(value: Any) -> str:
    if value is None:
        return NONE
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_plain(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_plain, value)) or NONE
    return str(value)


def _percent(value: float) -> str:
    if 0 < value < 0.005:
        return "<0.01".replace("<", "&lt;")
    return f"{value:.2f}"
