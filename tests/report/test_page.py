"""The report kit: the shell of pages, escaping, and the functions of the plot module."""

from __future__ import annotations

import itertools

import pytest
from jinja2 import UndefinedError
from page_tools import Tags, data_of

from taubench_gl.report.page import Page, asset, bullets, data_uri, macro, picture, tag, text_lines
from taubench_gl.report.table import Column, Row, Table, to_html

EVIL = """</script><script>alert("x")</script>'"&<!--{{ 7 * 7 }}"""
TABLE = Table(EVIL, EVIL, (Column(EVIL, EVIL, definition=EVIL),), (Row(EVIL, (EVIL,), reasons={0: EVIL}),), (EVIL,),
              (EVIL,))  # fmt: skip


def evil_page(**more) -> Page:
    page = Page(EVIL, EVIL, intro=(text_lines([EVIL, EVIL]), bullets([(EVIL, EVIL)])), **more)
    page.add("tables", EVIL, to_html([TABLE], scroll=True), picture(data_uri(b"png"), EVIL), tag("p", EVIL, id=EVIL))
    return page


def test_page_without_scripts_forbids_them_and_escapes_every_value():
    tags = Tags(evil_page().html())
    assert "script" not in tags.names and "script-src" not in tags.policy()
    assert "default-src 'none'" in tags.policy()
    assert tags.text.count(EVIL) >= 14 and "49" not in tags.text


def test_page_with_scripts_holds_its_data_and_the_plot_module():
    data = {"text": EVIL, "numbers": [1.5, None]}
    page = evil_page(scripts=("run.js",), data=data).html()
    tags = Tags(page)
    assert tags.names.count("script") == 2 and "script-src" in tags.policy() and data_of(page) == data
    assert asset("plot.js") in page and asset("page.css") in page


def test_values_that_json_lacks_and_missing_names_raise():
    with pytest.raises(ValueError):
        evil_page(scripts=("run.js",), data={"x": float("nan")}).html()
    with pytest.raises(UndefinedError):
        macro("run_details", "run.html")([{}], False)


@pytest.fixture(scope="module")
def plot_module(browser):
    """Evaluates an expression with the functions of plot.js."""
    page = browser.new_page()
    yield lambda expression: page.evaluate(f"(() => {{ {asset('plot.js')}; return {expression}; }})()")
    page.close()


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("evenTicks(0, 10, 5)", [0, 2, 4, 6, 8, 10]),
        ("evenTicks(0.8, 2.6, 6)", [1, 1.5, 2, 2.5]),
        ("evenTicks(3, 3, 5)", [3]),
        ("logTicks(0.01, 10, 3)", [0.01, 0.1, 1, 10]),
        ("logTicks(1, 10, 8)", [1, 2, 5, 10]),
        ("[0, 5, 10].map(linearScale(0, 10, 100, 0))", [100, 50, 0]),
        ("[0.001, 0.1, 1, 10, 99].map(logScale(0.1, 10, 0, 100))", [0, 0, 50, 100, 100]),
        ("logScale(0.1, 10, 0, 100).invert(50)", 1),
        ("short(0.00012345)", "0.000123"),
        ("[percent(null), percent(0.001), percent(12.345)]", ["–", "<0.01 %", "12.35 %"]),
        ("[44.625, 44.635, 4.35, 0.125, 1.5].map((v) => fixed(v, 2))", ["44.62", "44.63", "4.35", "0.12", "1.50"]),
        ("[4.35, 0.25, 0.75, 2.5].map((v) => fixed(v, 1))", ["4.3", "0.2", "0.8", "2.5"]),
        ("linePath([0, 1, 2, 3], [0, null, 1, 2])", "M0.00 0.00M2.00 1.00L3.00 2.00"),
        ("stepPath([0, 2, 3], [9, 5, 4])", "M0,9H2V5H3V4"),
    ],
)
def test_scales_ticks_numbers_and_paths(plot_module, expression, expected):
    found = plot_module(expression)
    numeric = not isinstance(expected, str) and not (isinstance(expected, list) and isinstance(expected[0], str))
    assert found == (pytest.approx(expected) if numeric else expected)


def test_symlog_scale_places_zero_and_rises(plot_module):
    values = plot_module("[0, 0.001, 0.01, 0.1, 1].map(symlogScale(0.001, 1, 100, 0))")
    assert values[0] < 100 and all(a > b for a, b in itertools.pairwise(values))
    steps = [a - b for a, b in itertools.pairwise(values[1:])]
    assert steps == pytest.approx([steps[0]] * len(steps))
