"""The interactive page in a browser, and the tables of fronts."""

from __future__ import annotations

import json

import numpy as np
import pytest

from taubench_gl.report.cost import answer, cost_html, tables


@pytest.fixture(scope="module")
def values(small_study):
    """study.json with synthetic, well separated times, so that no mark hides another."""
    values = json.loads(json.dumps(small_study[1].as_json()))
    for i, p in enumerate(p for p in values["points"] if p["ms"]):
        p["ms"] |= {"median": 10.0 * 1.12**i, "spread": 0.01}
    return values


@pytest.fixture(scope="module")
def page(browser, values, tmp_path_factory):
    """The page, opened without a network."""
    path = tmp_path_factory.mktemp("page") / "study.html"
    path.write_text(cost_html(values), encoding="utf-8")
    context = browser.new_context(viewport={"width": 1280, "height": 900}, offline=True)
    opened = context.new_page()
    opened.messages, opened.requests = [], []
    opened.on("console", lambda message: opened.messages.append(message.text))
    opened.on("pageerror", lambda error: opened.messages.append(str(error)))
    opened.on("request", lambda request: opened.requests.append(request.url))
    opened.goto(path.as_uri())
    yield opened
    context.close()


def marks(page):
    return page.locator("#plot .mark")


def test_page_loads_nothing_and_logs_nothing(page):
    assert page.messages == []
    assert len(page.requests) == 1 and page.requests[0].startswith("file:")


def test_every_timed_configuration_has_a_mark(page, small_study):
    _, study = small_study
    page.select_option("#column", "overall")
    shown = {m.get_attribute("data-name") for m in marks(page).all()}
    assert shown == {p.name for p in study.points if p.masks and p.time}
    bright = {m.get_attribute("data-name") for m in page.locator("#plot .mark:not(.dim)").all()}
    assert bright == {p.name for p in study.front()}
    options = [o.get_attribute("value") for o in page.locator("#column option").all()]
    assert options == ["overall", *study.columns]


def test_the_page_starts_with_the_answer(page, values):
    assert page.inner_text(".answer").splitlines() == answer(values)
    assert page.locator("#plot .chosen").count() == 1


@pytest.mark.parametrize(("ratio", "shown"), [(1.001, 1), (30.0, 2)])
def test_names_do_not_cover_each_other(browser, values, tmp_path, ratio, shown):
    """Two named configurations with the same error: near each other in time one name is left out, apart none is."""
    first = next(p for p in values["points"] if p["name"] == "baseline")
    other = first | {"name": "other", "label": "other", "ms": first["ms"] | {"median": ratio * first["ms"]["median"]}}
    study = values | {"points": [first, other], "fronts": {c: ["baseline"] for c in values["fronts"]}, "chosen": None}
    (tmp_path / "study.html").write_text(cost_html(study), encoding="utf-8")
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto((tmp_path / "study.html").as_uri())
    assert page.locator("#plot text.name").count() == shown
    page.close()


def test_time_axis_is_logarithmic(page, values):
    times = {p["name"]: p["ms"]["median"] for p in values["points"] if p["ms"]}
    page.select_option("#column", "position")
    boxes = {m.get_attribute("data-name"): m.bounding_box() for m in marks(page).all()}
    places = np.array([box["x"] + box["width"] / 2 for box in boxes.values()])
    logs = np.log([times[name] for name in boxes])
    slope, start = np.polyfit(logs, places, 1)
    assert slope > 0 and np.abs(start + slope * logs - places).max() < 2.0  # pixels


def test_hovering_describes_a_configuration(page, small_study):
    _, study = small_study
    page.select_option("#column", "normal")
    page.locator('#plot .mark[data-name="storage=half"]').hover()
    text = page.inner_text("#status")
    assert all(part in text for part in (study.point("storage=half").label, "ms per frame", "normal:", "clock"))


def test_arrow_keys_select_marks(page):
    page.select_option("#column", "position")
    marks(page).first.focus()
    first = page.inner_text("#status")
    page.keyboard.press("ArrowRight")
    second = page.inner_text("#status")
    assert first != second
    page.keyboard.press("ArrowLeft")
    assert page.inner_text("#status") == first
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == first


def test_roles_can_be_hidden(page):
    page.select_option("#column", "position")
    before = marks(page).count()
    page.locator('#roles input[value="single"]').uncheck()
    assert 0 < marks(page).count() < before
    page.locator('#roles input[value="single"]').check()
    assert marks(page).count() == before


def test_names_are_escaped(small_study):
    _, study = small_study
    values = json.loads(json.dumps(study.as_json()))
    values["scene"]["name"] = "</script><script>alert(1)</script>"
    values["points"][0]["label"] = "<img src=x onerror=alert(1)>"
    text = cost_html(values)
    assert "<script>alert" not in text and "<img src=x" not in text


def test_tables_list_the_front_first(small_study):
    _, study = small_study
    front, configurations, *others = tables(study.as_json())
    assert [row.label for row in front.rows] == [p.label for p in study.front()]
    assert [row.label for row in configurations.rows] == [p.label for p in study.points if p.masks]
    baseline = next(row for row in configurations.rows if row.label == "baseline")
    assert baseline.values[-2] == "1x"
    (grid,) = [t for t in others if t.title.startswith("Other pixels")]
    assert {row.label for row in grid.rows} == {p.label for p in study.points if p.role == "grid"}


def test_the_answer_names_the_choice_and_its_neighbors(values):
    """Twice and half the time, a third and three times the error, of a baseline with 3 % wrong masks in 10 ms."""
    numbers = {"baseline": (3.0, 10.0), "storage=half": (9.0, 5.0), "storage=double": (1.0, 20.0)}
    points = [p | {"masks": {c: e | {"percent": numbers[p["name"]][0]} for c, e in p["masks"].items()}}
              | {"ms": {"median": numbers[p["name"]][1], "spread": None, "samples": 3}} for p in values["points"]
              if p["name"] in numbers]  # fmt: skip
    study = values | {"points": points, "reference": values["reference"] | {"floor": {}}}
    labels = {p["name"]: p["label"] for p in points}
    chosen = {"column": "position", "configuration": "baseline", "faster": "storage=half", "finer": "storage=double"}
    assert answer(study | {"chosen": chosen})[0] == (
        f"Use {labels['baseline']}: 3 % of the masks are wrong, 10 ms/frame; 2x the time ({labels['storage=double']}) "
        f"leaves 1 %; 0.5x the time ({labels['storage=half']}) leaves 9 %"
    )
    alone = answer(study | {"chosen": chosen | {"faster": None, "finer": None}})[0]
    assert alone.endswith("10 ms/frame; nothing measured is more exact beyond noise")
    below = study | {"chosen": chosen, "reference": values["reference"] | {"floor": {"position": 4.0}}}
    assert "below the noise floor" in answer(below)[0]
    nothing = answer(study | {"chosen": chosen | {"configuration": None}})[0]
    assert nothing.startswith("no configuration") and labels["storage=half"] in nothing and "1 %" in nothing
    assert answer(study | {"chosen": None})[0] == "nothing has been measured yet"


@pytest.mark.long
def test_both_browsers_open_the_page(values, tmp_path, both_browsers):
    (tmp_path / "study.html").write_text(cost_html(values), encoding="utf-8")
    both_browsers(tmp_path / "study.html", "#plot .mark")
