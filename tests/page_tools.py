"""Pages as text and in headless Chromium: their data, tags and images."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image


def data_of(page: str) -> Any:
    """The data of the scripts of a page."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])


def image_of(uri: str) -> np.ndarray:
    """The pixels of a data URI."""
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))))


class Tags(HTMLParser):
    """``tags``: name and attributes of each element of a page; ``text``: all of its text; ``open``: not closed."""

    VOID = ("meta", "link", "img", "br", "input")

    def __init__(self, page: str):
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.text, self.open = "", []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.open += [tag] * (tag not in self.VOID)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"</{tag}> closes another element"

    def handle_data(self, data):
        self.text += data

    @property
    def addresses(self) -> list[str]:
        """What the elements load or link to."""
        return [v for _, a in self.tags for k, v in a.items() if k in ("src", "href", "srcset", "data", "action") and v]

    @property
    def names(self) -> list[str]:
        return [name for name, _ in self.tags]

    def policy(self) -> str:
        return next(a["content"] for _, a in self.tags if a.get("http-equiv") == "Content-Security-Policy")


def opened(browser: Any, file: Path, place: str = "", **options: Any) -> Iterator[Any]:
    """Opens a page at ``#place`` and checks that it causes no console error, no exception and no request but files."""
    usual = {"viewport": {"width": 1100, "height": 900}, "color_scheme": "light", "reduced_motion": "reduce"}
    context = browser.new_context(**usual | options)
    page, faults = context.new_page(), []
    page.on("console", lambda m: faults.append(m.text) if m.type in ("error", "warning") else None)
    page.on("pageerror", lambda e: faults.append(str(e)))
    page.on("requestfailed", lambda r: faults.append(r.url))
    page.on("request", lambda r: None if r.url.startswith(("file:", "data:", "blob:")) else faults.append(r.url))
    page.goto(file.as_uri() + place)
    if page.locator(".stage").count():
        page.wait_for_selector(".stage[data-frame]")
    yield page
    context.close()
    assert faults == []


def shown_frame(page: Any, frame: int) -> None:
    page.wait_for_selector(f".stage[data-frame='{frame}']")


def mask_pixels(page: Any) -> np.ndarray:
    """(h, w, 4) uint8 of the mask canvas."""
    script = """() => { const c = document.querySelector('.mask');
        return [c.width, c.height, Array.from(c.getContext('2d').getImageData(0, 0, c.width, c.height).data)] }"""
    width, height, values = page.evaluate(script)
    return np.array(values, np.uint8).reshape(height, width, 4)
