"""The HTML page of a demo and the index of all demos: templates/demo.html and demos.html of the report kit.

Images are inside the pages; there are no scripts.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path

from taubench_gl import __version__
from taubench_gl.demos.demo import Demo, Finding, Result
from taubench_gl.report.page import data_uri, render_page

INDEX_FILE = "index.html"
_CARD_WIDTH = 640  # pixels


def demo_page(demo: Demo, result: Result, around: tuple[Demo | None, Demo | None] | None = None) -> str:
    """The page of one demo.  ``around``: the previous and the next demo, whose pages are in the same folder."""
    return render_page(
        "demo.html",
        styles=("demo.css",),
        demo=demo,
        findings=result.findings,
        strips=[_strip(finding) for finding in result.findings],
        figures=[{"uri": data_uri(figure.path.read_bytes()), "caption": figure.caption} for figure in result.figures],
        links=_links(around),
        version=__version__,
    )


def index_page(shown: Sequence[tuple[Demo, Result]]) -> str:
    """One card per demo with a link to its page in the same folder."""
    return render_page(
        "demos.html",
        styles=("demo.css",),
        cards=[
            {"demo": demo, "uri": data_uri(_thumbnail(result.figures[0].path)), "finding": result.findings[0],
             "as_expected": result.as_expected}
            for demo, result in shown
        ],
        good=sum(result.as_expected for _, result in shown),
        version=__version__,
    )  # fmt: skip


def _strip(finding: Finding) -> dict[str, float] | None:
    """Pixels (0 .. 120) of the expected range and of the measured value on a line; None for infinite ones."""
    low, high, value = finding.expected.low, finding.expected.high, finding.number
    if not all(map(math.isfinite, (low, high, value))):
        return None
    middle = 0.5 * (low + high)
    reach = max(high - low, 2.2 * abs(value - middle)) or 1.0

    def x(number: float) -> float:
        return 60.0 + 52.0 * (number - middle) / reach * 1.6

    start, end = max(x(low) - 1.0, 2.0), min(x(high) + 1.0, 118.0)
    return {"start": start, "width": max(end - start, 2.0), "value": min(max(x(value), 5.0), 115.0)}


def _links(around: tuple[Demo | None, Demo | None] | None) -> list[dict[str, str]]:
    """Links to the previous demo, the index and the next demo."""
    if around is None:
        return []
    before, after = around
    links = [{"rel": "", "file": INDEX_FILE, "text": "all demos"}]
    if before is not None:
        links.insert(0, {"rel": "prev", "file": f"{before.stem}.html", "text": f"← {before.number}. {before.title}"})
    if after is not None:
        links.append({"rel": "next", "file": f"{after.stem}.html", "text": f"{after.number}. {after.title} →"})
    return links


def _thumbnail(path: Path) -> bytes:
    """A PNG of the width of a card."""
    from PIL import Image

    with Image.open(path) as image:
        image = image.convert("RGB")
        image.thumbnail((_CARD_WIDTH, 2000))
        buffer = io.BytesIO()
        image.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
