"""The page of the recorded quick benchmark in browsers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from page_tools import opened

from taubench_gl.report.benchmark import benchmark_html

RECORDED = Path(__file__).resolve().parents[2] / "docs" / "benchmark-quick.json"


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("benchmark") / "benchmark.html"
    path.write_text(benchmark_html(json.loads(RECORDED.read_text(encoding="utf-8"))), encoding="utf-8")
    return path


def test_tables_are_shown_and_nothing_overflows(browser, page_file):
    methods = json.loads(RECORDED.read_text(encoding="utf-8"))["methods"]
    for page in opened(browser, page_file):
        for width, height in ((1280, 720), (390, 844)):
            page.set_viewport_size({"width": width, "height": height})
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        rows = page.locator("table tbody th").all_inner_texts()  # a method runs in some of the tracks
        assert set(methods) <= set(rows)


@pytest.mark.long  # of the usual run, tests/report/test_full_report.py opens Firefox
def test_firefox_shows_the_tables(firefox, page_file):
    page = firefox(page_file, "table tbody th")
    assert page.execute_script("return document.documentElement.scrollWidth <= innerWidth")
