"""A demo as one HTML file that needs nothing else: pictures inside, no script, light and dark, phone and paper."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Sequence

from taubench_gl import __version__
from taubench_gl.demos.demo import Demo, Finding, Result
from taubench_gl.report.page import asset

INDEX_FILE = "index.html"
escape = html.escape

_STYLE = """
header.demo { display: flex; gap: 1.2rem; align-items: baseline; padding-bottom: 1rem;
  border-bottom: 1px solid var(--line); }
header.demo .number { font: 500 clamp(2.6rem, 2rem + 3vw, 4.4rem)/1 var(--serif); color: var(--accent); }
header.demo h1 { margin: 0; }
.idea { font-size: 1.14rem; line-height: 1.6; margin: 1.4rem 0 0; max-width: 68ch; }
.look { margin: 1.4rem 0 0; padding: .9rem 1.2rem .6rem 2.4rem; background: var(--sheet); border: 1px solid var(--line);
  border-radius: 8px; max-width: 76ch; }
.look li { margin-bottom: .4rem; } .look b { margin-left: -1.2rem; display: block; margin-bottom: .3rem; }
figure { margin: 1.8rem 0 0; }
figure img { display: block; width: 100%; border: 1px solid var(--line); border-radius: 8px; background: #fbfaf7; }
figcaption { color: var(--soft); font-size: .92rem; margin-top: .5rem; max-width: 90ch; }
.answer { display: flex; flex-wrap: wrap; gap: .4rem 1.4rem; align-items: baseline; margin: 2.2rem 0 .6rem; }
.answer .big { font: 500 clamp(2.2rem, 1.7rem + 2.4vw, 3.4rem)/1.1 var(--serif); }
.findings td, .findings th { white-space: normal; text-align: left; vertical-align: top; }
.findings td.n { white-space: nowrap; } .findings .source { color: var(--soft); font-size: .82rem; }
.ok { color: #00775a; } .bad { color: #b43c00; font-weight: 600; }
:root[data-theme="dark"] .ok { color: #4ccfa6; }
@media (prefers-color-scheme: dark) { :root:not([data-theme="light"]) .ok { color: #4ccfa6; } }
nav.demo { display: flex; flex-wrap: wrap; gap: .6rem 1.6rem; margin: 2.4rem 0 0; }
.band { fill: var(--accent); opacity: .28; } .axis { stroke: var(--line); }
.dot { fill: var(--accent); stroke: var(--sheet); }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(19rem, 1fr)); gap: 1.2rem;
  margin-top: 1.8rem; padding: 0; }
.cards li { list-style: none; } .cards a { display: block; height: 100%; color: inherit; text-decoration: none;
  background: var(--sheet); border: 1px solid var(--line); border-radius: 8px; overflow: hidden; }
.cards a:hover { border-color: var(--accent); }
.cards img { display: block; width: 100%; aspect-ratio: 16 / 10; object-fit: cover; object-position: top left;
  background: #fbfaf7; }
.cards div { padding: .7rem .9rem .9rem; } .cards h2 { font-size: 1.08rem; margin: 0 0 .3rem; }
.cards p { margin: 0; font-size: .9rem; }
@media (max-width: 40rem) {
  .picture { overflow-x: auto; } .picture img { width: 46rem; max-width: none; }
  .findings .wide-only, .findings thead { display: none; }
  .findings tr, .findings td { display: block; padding: .1rem .75rem; } .findings tr { padding: .5rem 0; }
  .findings tbody tr + tr { border-top: 1px solid var(--line); } .findings tbody tr + tr > * { border-top: 0; }
  .findings td.n { font-weight: 600; } .findings td.n + td + td.n { font-weight: 400; }
  .findings td.n + td + td.n::before { content: "expected "; color: var(--soft); }
}
"""


def demo_page(demo: Demo, result: Result, around: tuple[Demo | None, Demo | None] | None = None) -> str:
    """The page of one demo.  ``around``: the demos before and after it, whose pages lie beside this one."""
    first = result.findings[0]
    look = "".join(f"<li>{escape(item)}</li>" for item in demo.look_for)
    figures = "".join(
        f"<figure><div class='picture' tabindex='0'><img src='{_inline(f.path.read_bytes())}'"
        f" alt='{escape(f.caption, quote=True)}'></div><figcaption>{escape(f.caption)}</figcaption></figure>"
        for f in result.figures
    )
    body = f"""
<header class="demo"><span class="number" aria-hidden="true">{demo.number}</span>
<div><h1>{escape(demo.title)}</h1><span class="muted">demo {demo.number}, {escape(demo.name)}</span></div></header>
<p class="idea">{escape(demo.idea)}</p>
<ul class="look"><b>What to look for</b>{look}</ul>
{figures}
<section><div class="answer"><span class="big">{escape(first.said)}</span><span>{escape(first.meaning)}</span></div>
<div class="wide">{_findings(result.findings)}</div></section>
{_see_also(demo)}{_neighbours(around)}"""
    return _page(f"{demo.number}. {demo.title}", body)


def index_page(shown: Sequence[tuple[Demo, Result]]) -> str:
    """A card for every demo, leading to its page beside this one."""
    cards = "".join(
        f"<li><a href='{demo.stem}.html'><img src='{_inline(_small(result.figures[0].path))}' alt=''>"
        f"<div><h2>{demo.number}. {escape(demo.title)}</h2><p>{escape(result.findings[0].said)} "
        f"{escape(result.findings[0].meaning)} {_verdict(result.as_expected)}</p></div></a></li>"
        for demo, result in shown
    )
    good = sum(result.as_expected for _, result in shown)
    body = f"""
<h1>Temporal reuse, one idea at a time</h1>
<p class="lead">{len(shown)} demos, drawn and measured on this machine. In {good} of {len(shown)} every number is what
theory says.</p><ul class="cards">{cards}</ul>"""
    return _page("Demos of temporal reuse", body)


def _page(title: str, body: str) -> str:
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title><link rel="icon" href="data:,">
<style>{asset("page.css")}{_STYLE}</style></head>
<body><main>{body}
<p class="muted">taubench-gl {escape(__version__)}</p></main></body></html>
"""


def _findings(findings: Sequence[Finding]) -> str:
    rows = "".join(
        f"<tr><td class='n'>{escape(f.said)}</td><td>{escape(f.meaning)}</td>"
        f"<td class='n'>{escape(f.expected.said)}<div class='source wide-only'>{escape(f.unit)}</div></td>"
        f"<td class='wide-only'>{_strip(f)}</td>"
        f"<td>{_verdict(f.as_expected)}<div class='source'>{escape(f.expected.source)}</div></td></tr>"
        for f in findings
    )
    return (
        "<table class='findings'><caption>Measured, and what theory says</caption><thead><tr><th>measured</th><th></th>"
        f"<th>expected</th><th class='wide-only'></th><th>because</th></tr></thead><tbody>{rows}</tbody></table>"
    )


def _strip(finding: Finding) -> str:
    """A line with the expected range as a band and the measured number as a dot."""
    low, high, at = finding.expected.low, finding.expected.high, finding.number
    if not all(map(math.isfinite, (low, high, at))):
        return ""
    middle, reach = 0.5 * (low + high), max(high - low, 2.2 * abs(at - 0.5 * (low + high))) or 1.0

    def x(value: float) -> float:
        return 60.0 + 52.0 * (value - middle) / reach * 1.6

    start, end = max(x(low) - 1.0, 2.0), min(x(high) + 1.0, 118.0)
    return (
        "<svg width='120' height='18' viewBox='0 0 120 18' aria-hidden='true'>"
        "<line class='axis' x1='2' x2='118' y1='9' y2='9'/>"
        f"<rect class='band' x='{start:.1f}' width='{max(end - start, 2):.1f}' y='3' height='12' rx='2'/>"
        f"<circle class='dot' cx='{min(max(x(at), 5), 115):.1f}' cy='9' r='4.5'/></svg>"
    )


def _verdict(good: bool) -> str:
    return "<span class='ok'>✓ as expected</span>" if good else "<span class='bad'>✗ not as expected</span>"


def _see_also(demo: Demo) -> str:
    pages = "; ".join(f"{escape(what)}: docs/{escape(page)}" for what, page in demo.see_also)
    return f"<p class='muted'>More about {pages}.</p>" if pages else ""


def _neighbours(around: tuple[Demo | None, Demo | None] | None) -> str:
    if around is None:
        return ""
    before, after = around
    links = [f"<a href='{INDEX_FILE}'>all demos</a>"]
    if before is not None:
        links.insert(0, f"<a rel='prev' href='{before.stem}.html'>← {before.number}. {escape(before.title)}</a>")
    if after is not None:
        links.append(f"<a rel='next' href='{after.stem}.html'>{after.number}. {escape(after.title)} →</a>")
    return f"<nav class='demo'>{''.join(links)}</nav>"


def _inline(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _small(path: object) -> bytes:
    """A picture at the width of a card."""
    import io

    from PIL import Image

    with Image.open(path) as picture:
        picture = picture.convert("RGB")
        picture.thumbnail((640, 2000))
        buffer = io.BytesIO()
        picture.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
