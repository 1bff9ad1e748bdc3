"""UpSet plot of the reasons of a run."""

from __future__ import annotations

import importlib.util
import re
import xml.etree.ElementTree as ElementTree

import pytest

from taubench_gl.conventions import Reason
from taubench_gl.report import upset
from taubench_gl.report.upset import upset_plot

TURNED_ONLY = {"words": [0, int(Reason.NORMAL)], "pixels": [90, 10]}


@pytest.fixture
def library():
    pytest.importorskip("marsilea", reason="the upset extra is not installed")


def texts(svg: str) -> list[str]:
    root = ElementTree.fromstring(svg.replace("xlink:href", "href"))
    return [node.text for node in root.iter("text") if node.text]


def test_the_plot_shows_the_shares_of_combinations_and_reasons(library, summary):
    found = texts(upset_plot(summary).svg)
    for label in ("off-screen", "disoccluded", "newly occluding", "changed in normal"):
        assert label in found
    # 800 pixels a pair: 130 off-screen, 50 disoccluded, 15 turned, 5 occluding and turned; turned in all: 20
    for share in ("16.25", "6.25", "1.88", "0.62", "2.50"):
        assert share in found


def test_the_element_fits_into_a_page(library, summary):
    first, second = (upset_plot(summary, name).svg for name in ("a", "b"))
    assert "<style" not in first and "<metadata" not in first and "#000000" not in first
    names = [set(re.findall(r'id="([^"]+)"', svg)) for svg in (first, second)]
    assert names[0] and not names[0] & names[1]
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', first)) <= names[0]
    root = ElementTree.fromstring(first.replace("xlink:href", "href"))
    assert root.get("role") == "img" and "off-screen 16.25 %" in root.get("aria-label")
    assert first == upset_plot(summary, "a").svg


def test_only_the_largest_combinations_are_drawn(library, summary, monkeypatch):
    monkeypatch.setattr(upset, "MOST", 2)
    found = upset_plot(summary)
    assert "2 more combinations, 2.50 %" in found.text
    assert "newly occluding" not in texts(found.svg)


def test_without_the_library_one_line_says_so(summary, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    found = upset_plot(summary)
    assert found.svg is None and "taubench-gl[upset]" in found.text and "off-screen 16.25 %" in found.text


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"mask_histogram": {"words": [0], "pixels": [800]}}, "Every"),
        ({"mask_histogram": TURNED_ONLY}, "10.00 %"),
        ({"mask_histogram": None}, "No plot"),
        ({"reusable": {"surface": {"reason": "not here"}}}, "not here"),
    ],
)
def test_a_run_without_combinations_has_no_plot(summary, change, word):
    found = upset_plot(summary | change)
    assert found.svg is None and word in found.text
