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


@pytest.mark.parametrize("size", [(1280, 720), (390, 844)], ids=lambda size: str(size[0]))
def test_tables_are_shown_and_nothing_overflows(browser, page_file, size):
    methods = json.loads(RECORDED.read_text(encoding="utf-8"))["methods"]
    for page in opened(browser, page_file, viewport={"width": size[0], "height": size[1]}):
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
        rows = page.locator("table tbody th").all_inner_texts()  # a method runs in some of the tracks
        assert set(methods) <= set(rows)


def test_firefox_shows_the_tables(firefox, page_file):
    page = firefox(page_file, "table tbody th")
    assert page.execute_script("return document.documentElement.scrollWidth <= innerWidth")
