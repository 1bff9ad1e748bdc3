"""The pages of the demos in headless Chromium: steps, flicker, guess, parameter; no console output, no overflow."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from PIL import Image

from taubench_gl.demos.demo import Demo
from taubench_gl.demos.gallery import demo_page
from taubench_gl.demos.lessons import demos, find_demo

WINDOWS = ((1280, 720), (1920, 1080), (390, 844))
QUICK = ("thresholds",)
"""A parameter that repaints a mask."""


@pytest.fixture
def opened(browser) -> Iterator[Any]:
    """opened(file) -> page, checked for console output and requests at the end."""
    context = browser.new_context(viewport={"width": 1280, "height": 720}, color_scheme="light")
    faults: list[str] = []

    def open_page(file, hash: str = "") -> Any:
        page = context.new_page()
        page.on("console", lambda m: faults.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda e: faults.append(str(e)))
        page.on("request", lambda r: None if r.url.startswith(("file:", "data:")) else faults.append(r.url))
        page.goto(file.as_uri() + hash)
        page.wait_for_selector("#drawn[data-value]", state="attached")
        return page

    yield open_page
    context.close()
    assert faults == []


def canvas(page: Any) -> np.ndarray:
    """Pixels of the drawn image, (h, w, 3)."""
    data = page.evaluate("document.getElementById('drawn').toDataURL('image/png').split(',')[1]")
    import base64

    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)


def drive(demo: Demo, runs: Any, gpu: Any, opened: Any) -> None:
    """One lesson: every step in three windows, the guess, the images of the pair, and every way to drag."""
    shown = runs.shown(demo, gpu)
    page = opened(shown.page, "#lecture")
    count = page.locator(".step").count()
    for width, height in WINDOWS:
        page.set_viewport_size({"width": width, "height": height})
        page.keyboard.press("Home")
        for i in range(count):
            assert page.locator("#place").inner_text() == f"{i + 1} / {count}"
            assert page.locator(".step.now").count() == 1 and page.locator(".step.now").is_visible()
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), f"step {i + 1} is too wide"
            page.keyboard.press("ArrowRight")
    page.set_viewport_size({"width": 1280, "height": 720})
    page.keyboard.press("Escape")
    assert page.locator("html.lecture").count() == 0 and page.locator("#numbers").is_visible()
    drive_question(demo, shown.result, page)
    drive_frames(page)
    drive_parameter(shown.result.parameter, page)


def drive_question(demo: Demo, result: Any, page: Any) -> None:
    asked = demo.question
    assert asked.low < asked.high and page.locator("#answer").inner_text() == ""
    page.locator("#guess").focus()
    page.keyboard.press("End")
    assert float(page.locator("#guessed").inner_text().split()[0]) == pytest.approx(asked.high)
    page.click("#reveal")
    words = page.locator("#answer").inner_text()
    assert result.findings[0].text in words and result.findings[0].expected_text in words
    assert asked.low <= result.findings[0].number <= asked.high


def drive_frames(page: Any) -> None:
    for key, name in (("1", "previous"), ("3", "mask"), ("2", "current")):
        page.keyboard.press(key)
        seen = page.locator(".screen img").evaluate_all(
            "all => all.filter(i => getComputedStyle(i).visibility === 'visible').map(i => i.className)"
        )
        assert seen == [name]
    page.keyboard.press("f")
    for name in ("previous", "current", "previous"):
        page.wait_for_selector(f".screen[data-shown={name}]")
    page.click("#flicker")
    assert page.get_attribute("#flicker", "aria-pressed") == "false"


def drive_parameter(parameter: Any, page: Any) -> None:
    slider, last = page.locator("#value"), len(parameter.values) - 1
    assert page.get_attribute("#drawn", "data-value") == str(parameter.start)
    slider.focus()
    for key, i in (("Home", 0), ("End", last), ("ArrowLeft", last - 1)):
        page.keyboard.press(key)
        assert page.get_attribute("#drawn", "data-value") == str(i)
        number = f"{parameter.measured[i]:.{parameter.digits}f} {parameter.number_unit}".strip()
        assert page.locator("#reading b").inner_text() == number
        drawn, stored = canvas(page), parameter.picture(i).astype(int)
        assert drawn.shape == stored.shape and np.abs(drawn - stored).mean() < 12.0  # WebP loses a little
        if parameter.plane is not None:
            marked = parameter.plane > i
            assert (drawn[marked] == parameter.mark).all()
            assert (drawn == parameter.mark).all(axis=-1).sum() == marked.sum()
    assert page.locator("#curve circle").count() == len(parameter.values) + 1


@pytest.mark.parametrize("name", QUICK)
def test_lesson(name, runs, gpu, opened):
    drive(find_demo(name), runs, gpu, opened)


@pytest.mark.long
@pytest.mark.parametrize("name", [d.name for d in demos() if d.name not in QUICK])
def test_every_lesson(name, runs, gpu, opened):
    drive(find_demo(name), runs, gpu, opened)


def test_keyboard_and_screen_reader(runs, gpu, opened):
    """A lesson by keys alone; every control and image has a name, and values are read with their unit."""
    shown = runs.shown(find_demo("thresholds"), gpu)
    page = opened(shown.page)

    def tab_to(selector: str) -> None:
        for _ in range(12):
            page.keyboard.press("Tab")
            if page.evaluate("(s) => document.activeElement.matches(s)", selector):
                return
        raise AssertionError(f"{selector} is not reached")

    tab_to("#lecture")
    page.keyboard.press("Enter")
    page.wait_for_selector("html.lecture")
    page.keyboard.press("PageDown")
    assert page.evaluate("document.activeElement.id") == "frames"  # a screen reader reads the name of the step
    page.keyboard.press("3")
    assert page.get_by_role("img", name="Mask over the current frame").count() == 1
    page.keyboard.press("PageDown")
    tab_to("#guess")
    page.keyboard.press("End")
    assert page.get_attribute("#guess", "aria-valuetext") == page.locator("#guessed").inner_text()
    tab_to("#reveal")
    page.keyboard.press("Enter")
    assert shown.result.findings[0].text in page.locator("#answer").inner_text()
    page.keyboard.press("PageDown")
    page.keyboard.press("PageDown")
    tab_to("#value")
    page.keyboard.press("End")
    last = page.get_attribute("#value", "aria-valuetext")
    assert last.endswith(" m") and page.get_by_role("img", name=f"Image at position threshold {last}").count() == 1
    page.keyboard.press("Escape")
    tree = page.locator("body").aria_snapshot()
    names = ('slider "Your guess"', 'slider "Position threshold:"', 'button "Flicker"', 'region "Guess first"')
    assert [name for name in names if name not in tree] == []
    assert not re.search(r"- (slider|button|img|radio|columnheader|region)(:|\n)", tree)


@pytest.mark.long
def test_firefox_redraws_the_parameter(runs, gpu, firefox):
    shown = runs.shown(find_demo("thresholds"), gpu)
    parameter = shown.result.parameter
    page = firefox(shown.page, "#drawn[data-value]")
    last = len(parameter.values) - 1
    page.execute_script(
        "const s = document.getElementById('value'); s.value = arguments[0]; s.dispatchEvent(new Event('input'));",
        [last],
    )
    # The number of a threshold is counted from the pixels that were painted.
    number = f"{parameter.measured[last]:.{parameter.digits}f} {parameter.number_unit}"
    assert page.execute_script("return document.querySelector('#reading b').textContent") == number


def test_the_lecture_goes_on_with_the_next_demo(runs, gpu, opened, tmp_path):
    first, second = (find_demo(name) for name in ("rotations", "thresholds"))
    for demo, around in ((first, (None, second)), (second, (first, None))):
        page = demo_page(demo, runs.of(demo, gpu), runs.pair(demo, gpu), around)
        (tmp_path / f"{demo.stem}.html").write_text(page, encoding="utf-8")
    page = opened(tmp_path / f"{first.stem}.html", "#lecture-2")
    assert page.locator(".step.now").get_attribute("id") == "frames"
    page.keyboard.press("End")
    page.keyboard.press("PageDown")
    page.wait_for_url(re.compile(second.stem))
    page.wait_for_selector("html.lecture")
    assert page.locator(".step.now").get_attribute("id") == "idea"
    page.keyboard.press("ArrowLeft")
    page.wait_for_url(re.compile(first.stem))


def test_without_scripts_everything_is_shown(runs, gpu, browser):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(runs.shown(find_demo("thresholds"), gpu).page.as_uri())
    assert all(page.locator(".step").nth(i).is_visible() for i in range(page.locator(".step").count()))
    assert page.locator(".findings").is_visible() and page.locator(".screen .current").is_visible()
    context.close()
