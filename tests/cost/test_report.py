"""The interactive page in a real browser, and the front table against the study."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from taubench_gl.report.study_html import study_html
from taubench_gl.report.study_tables import grids, study_markdown

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def values(small_study):
    """study.json with times of our own, apart from each other, so that no mark hides another."""
    values = json.loads(json.dumps(small_study[1].as_json()))
    for i, p in enumerate(values["points"]):
        p["ms"] |= {"median": 10.0 * 1.12**i, "spread": 0.01}
    return values


@pytest.fixture(scope="module")
def page(values, tmp_path_factory):
    """Its page, opened with the network cut off."""
    sync = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    path = tmp_path_factory.mktemp("page") / "study.html"
    path.write_text(study_html(values), encoding="utf-8")
    with sync.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        context = browser.new_context(viewport={"width": 1280, "height": 900})
        context.set_offline(True)
        opened = context.new_page()
        opened.said, opened.asked = [], []
        opened.on("console", lambda message: opened.said.append(message.text))
        opened.on("pageerror", lambda error: opened.said.append(str(error)))
        opened.on("request", lambda request: opened.asked.append(request.url))
        opened.goto(path.as_uri())
        yield opened
        browser.close()


def marks(page):
    return page.locator("#plot .mark")


def test_the_page_loads_nothing_and_complains_of_nothing(page):
    assert page.said == []
    assert len(page.asked) == 1 and page.asked[0].startswith("file:")


def test_every_measured_setting_has_a_mark(page, small_study):
    _, study = small_study
    page.select_option("#column", "position")
    shown = {m.get_attribute("data-name") for m in marks(page).all()}
    assert shown == {p.name for p in study.points if p.role != "question"}
    bright = {m.get_attribute("data-name") for m in page.locator("#plot .mark:not(.dim)").all()}
    assert bright == {p.name for p in study.front("position")}


def test_the_page_has_the_front_that_recommendations_rest_on(page, small_study):
    _, study = small_study
    page.select_option("#column", "all")
    options = page.locator("#column option")
    assert [o.get_attribute("value") for o in options.all()] == [*study.columns, "all"]
    assert options.last.inner_text() == "worst of position, normal"
    bright = {m.get_attribute("data-name") for m in page.locator("#plot .mark:not(.dim)").all()}
    assert bright == {p.name for p in study.front("all")}
    page.locator('#plot .mark[data-name="best"]').hover()
    assert "worst of position, normal: " in page.inner_text("#status")


def test_the_time_axis_is_logarithmic(page, values):
    times = {p["name"]: p["ms"]["median"] for p in values["points"]}
    page.select_option("#column", "position")
    boxes = {m.get_attribute("data-name"): m.bounding_box() for m in marks(page).all()}
    places = np.array([box["x"] + box["width"] / 2 for box in boxes.values()])
    logs = np.log([times[name] for name in boxes])
    slope, start = np.polyfit(logs, places, 1)
    assert slope > 0 and np.abs(start + slope * logs - places).max() < 2.0  # pixels


def test_pointing_at_a_mark_tells_its_setting(page, small_study):
    _, study = small_study
    page.select_option("#column", "normal")
    page.locator('#plot .mark[data-name="best"]').hover()
    told = page.inner_text("#status")
    assert study.point("best").label in told and "ms per frame" in told and "normal:" in told and "clock" in told


def test_the_keyboard_walks_through_the_marks(page):
    page.select_option("#column", "position")
    marks(page).first.focus()
    first = page.inner_text("#status")
    page.keyboard.press("ArrowRight")
    second = page.inner_text("#status")
    assert first != second
    page.keyboard.press("ArrowLeft")
    assert page.inner_text("#status") == first
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == first


def test_kinds_of_settings_can_be_hidden(page):
    page.select_option("#column", "position")
    before = marks(page).count()
    page.locator('#roles input[value="one"]').uncheck()
    assert 0 < marks(page).count() < before
    page.locator('#roles input[value="one"]').check()
    assert marks(page).count() == before


def test_names_cannot_break_out_of_the_page(small_study):
    _, study = small_study
    values = json.loads(json.dumps(study.as_json()))
    values["scene"]["name"] = "</script><script>alert(1)</script>"
    values["points"][0]["label"] = "<img src=x onerror=alert(1)>"
    text = study_html(values)
    assert "<script>alert" not in text and "<img src=x" not in text


def test_tables_hold_the_front(small_study):
    _, study = small_study
    values = study.as_json()
    by_title = {g.title.split(":")[0]: g for g in grids(values)}
    for column in study.columns:
        rows = by_title[f"Front of the {column} column"].rows
        assert [r[0] for r in rows] == [p.label for p in study.front(column)]
    several = next(g for g in grids(values) if g.title.startswith("Front of the worst of position, normal"))
    assert [r[0] for r in several.rows] == [p.label for p in study.front("all")]
    for grid in (by_title["Front of the position column"], several):
        errors = [float(r[1].split()[0].rstrip(",").lstrip("<")) for r in grid.rows]
        assert errors == sorted(errors, reverse=True), "what counts is printed: of a sample at least its half width"
    base = next(r for r in by_title["All settings"].rows if r[0] == "as asked")
    assert base[-2] == "1x"
    assert "| as asked |" in study_markdown(values)
