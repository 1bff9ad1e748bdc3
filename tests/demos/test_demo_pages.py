"""The pages of the demos in headless Chromium: steps, flicker, guess, parameter, lecture; no console output."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import page_tools
import pytest
from repeated import few

from taubench_gl.demos.demo import Demo
from taubench_gl.demos.gallery import demo_page, index_page
from taubench_gl.demos.lessons import DEMOS, find_demo
from taubench_gl.demos.texts import TEXTS

LECTURE = TEXTS.lecture
WINDOWS = ((1280, 720), (1920, 1080), (390, 844))
QUICK = "thresholds"
"""A parameter that repaints a mask."""
FILLED = 0.45
"""Least part of a window's width and height below the title that the content of a step spans."""


@pytest.fixture
def opened(browser) -> Iterator[Any]:
    """opened(file) -> page, checked for console output and requests at the end."""
    usual = {"viewport": {"width": 1280, "height": 720}, "reduced_motion": "no-preference"}
    with contextlib.ExitStack() as pages:

        def open_page(file, place: str = "") -> Any:
            page = pages.enter_context(contextlib.contextmanager(page_tools.opened)(browser, file, place, **usual))
            page.wait_for_selector("#drawn[data-value]", state="attached")
            return page

        yield open_page


def canvas(page: Any) -> np.ndarray:
    """Pixels of the drawn image, (h, w, 3)."""
    return page_tools.image_of(page.evaluate("document.getElementById('drawn').toDataURL('image/png')"))[
        ..., :3
    ].astype(int)


def press(page: Any, *keys: str) -> None:
    for key in keys:
        page.keyboard.press(key)


def now(page: Any) -> str:
    """The step of the lecture that is shown."""
    return page.locator(".step.now").get_attribute("id")


def body(page: Any) -> str:
    return page.locator("body").inner_text()


def drive_steps(name: str, page: Any) -> None:
    """Every step in three windows, with the keys of the lecture."""
    page.click("#lecture")
    count = page.locator(".step").count()
    for width, height in WINDOWS:
        page.set_viewport_size({"width": width, "height": height})
        press(page, "Home")
        for i in range(count):
            assert page.locator("#place").inner_text() == f"{i + 1} / {count}"
            check_slide(page, f"{name}, step {i + 1}, {width}x{height}")
            press(page, "ArrowRight")
    page.set_viewport_size({"width": 1280, "height": 720})
    press(page, "Escape")
    assert page.locator("html.lecture").count() == 0 and page.locator("#numbers").is_visible()


def check_slide(page: Any, where: str) -> None:
    """One step with the title above it, which fill the window without being wider."""
    window, title = page.viewport_size, page.locator("h1").bounding_box()
    assert page.locator(".step.now").count() == 1 and page.locator("h1").is_visible(), where
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), f"{where} is too wide"
    if window["width"] > window["height"]:  # a tall window is of a telephone, which scrolls
        assert page.evaluate("document.documentElement.scrollHeight <= 1.1 * innerHeight"), f"{where} is too high"
    boxes = page.locator(".step.now > :not(h2)").evaluate_all("all => all.map((part) => part.getBoundingClientRect())")
    sides = zip(*((box["left"], box["right"], box["top"], box["bottom"]) for box in boxes if box["width"]))
    left, right, top, bottom = (pick(side) for pick, side in zip((min, max, min, max), sides))
    below = title["y"] + title["height"]
    assert title["y"] >= 0 and top >= below - 1, f"{where}: the title is hidden"
    assert right - left >= 0.9 * window["width"], f"{where}: {right - left} of {window['width']} px wide"
    assert bottom - top >= FILLED * (window["height"] - below), f"{where}: {bottom - top} px high"


def drive_question(demo: Demo, result: Any, page: Any) -> None:
    """Before the guess neither text, name of an image nor key shows the number, its theory or the answer's image."""
    (low, high), first = demo.text.guess, result.findings[0]
    secrets = [first.text, first.expected_text, first.about.source, demo.text.caption, *demo.text.look_for]
    before, tree = body(page), page.locator("body").aria_snapshot()
    assert [s for s in secrets if s in before or s in tree] == []
    assert low < high and low <= first.number <= high
    assert [s.get_attribute("id") for s in page.locator(".step").all() if s.is_visible()] == ["idea", "question"]
    press(page, "3")
    page.locator("#guess").focus()
    press(page, "End")
    assert seen_images(page) == ["current"] and first.text not in body(page)
    assert float(page.locator("#guessed").inner_text().split()[0]) == pytest.approx(high)
    page.click("#reveal")
    words = page.locator("#answer").inner_text()
    assert first.text in words and first.expected_text in words and page.locator(".guessmark").count() == 1
    assert [s for s in secrets if s not in body(page)] == [] and seen_images(page) == ["answer"]


def seen_images(page: Any) -> list[str]:
    """Which images of the pair are visible."""
    return page.locator(".screen img").evaluate_all(
        "all => all.filter(i => getComputedStyle(i).visibility === 'visible').map(i => i.className)"
    )


def drive_frames(page: Any) -> None:
    for key, name in (("1", "previous"), ("3", "answer"), ("2", "current")):
        press(page, key)
        assert seen_images(page) == [name]
    press(page, "f")
    for name in ("previous", "current", "previous"):
        page.wait_for_selector(f".screen[data-shown={name}]")
    page.click("#flicker")
    assert page.get_attribute("#flicker", "aria-pressed") == "false"


def drive_parameter(parameter: Any, page: Any) -> None:
    last = len(parameter.values) - 1
    assert page.get_attribute("#drawn", "data-value") == str(parameter.start)
    page.locator("#value").focus()
    for key, i in (("Home", 0), ("End", last), ("ArrowLeft", last - 1)):
        press(page, key)
        assert page.get_attribute("#drawn", "data-value") == str(i)
        number = f"{parameter.measured[i]:.{parameter.about.digits}f} {parameter.about.number_unit}".strip()
        assert page.locator("#reading b").inner_text() == number
        drawn, stored = canvas(page), parameter.picture(i).astype(int)
        assert drawn.shape == stored.shape and np.abs(drawn - stored).mean() < 12.0  # WebP loses a little
        if parameter.plane is not None:
            marked = parameter.plane > i
            assert (drawn[marked] == parameter.mark).all()
            assert (drawn == parameter.mark).all(axis=-1).sum() == marked.sum()
    assert page.locator("#curve circle").count() == len(parameter.values) + 1


@pytest.mark.parametrize("name", few(sorted(DEMOS, key=lambda name: name != QUICK)))
def test_lesson(name, runs, gpu, opened):
    """The guess, the images of the pair, every way to drag, and every step."""
    demo = find_demo(name)
    shown = runs.shown(demo, gpu)
    page = opened(shown.page)
    drive_question(demo, shown.result, page)
    drive_frames(page)
    drive_parameter(shown.result.parameter, page)
    drive_steps(name, page)


def check_typed_addresses(page: Any) -> None:
    """A page that is open already enters the lecture, and goes to another step of it."""
    assert page.locator("html.lecture").count() == 0
    for typed, place in (("#lecture-2", "2 /"), ("#lecture", "1 /")):
        page.evaluate("hash => { location.hash = hash; }", typed)
        page.wait_for_function("place => document.getElementById('place').textContent.startsWith(place)", arg=place)
        page.wait_for_selector("html.lecture .step.now")
    press(page, "Escape")


def test_keyboard_and_screen_reader(runs, gpu, opened):
    """A lesson by keys alone; every control and image has a name, and values are read with their unit."""
    shown = runs.shown(find_demo(QUICK), gpu)
    page = opened(shown.page)
    check_typed_addresses(page)

    def tab_to(selector: str) -> None:
        for _ in range(12):
            press(page, "Tab")
            if page.evaluate("(s) => document.activeElement.matches(s)", selector):
                return
        raise AssertionError(f"{selector} is not reached")

    tab_to("#lecture")
    press(page, "Enter")
    page.wait_for_selector("html.lecture")
    press(page, "PageDown")
    assert page.evaluate("document.activeElement.id") == "question"  # a screen reader reads the name of the step
    tab_to("#guess")
    press(page, "End")
    assert page.get_attribute("#guess", "aria-valuetext") == page.locator("#guessed").inner_text()
    tab_to("#reveal")
    press(page, "Enter")
    assert shown.result.findings[0].text in page.locator("#answer").inner_text()
    press(page, "1", "3")
    assert page.get_by_role("img", name="Answer in the current frame").count() == 1
    press(page, "PageDown", "PageDown")
    tab_to("#value")
    press(page, "End")
    last = page.get_attribute("#value", "aria-valuetext")
    assert last.endswith(" m") and page.get_by_role("img", name=f"Image at position threshold {last}").count() == 1
    press(page, "Escape")
    tree = page.locator("body").aria_snapshot()
    names = ('slider "Your guess"', 'slider "Position threshold:"', 'button "Flicker"', 'region "Guess first"')
    assert [name for name in names if name not in tree] == []
    assert not re.search(r"- (slider|button|img|radio|columnheader|region)(:|\n)", tree)


@pytest.mark.long
def test_firefox_redraws_the_parameter(runs, gpu, firefox):
    shown = runs.shown(find_demo(QUICK), gpu)
    parameter = shown.result.parameter
    page = firefox(shown.page, "#drawn[data-value]")
    last = len(parameter.values) - 1
    script = "const s = document.getElementById('value'); s.value = arguments[0]; s.dispatchEvent(new Event('input'));"
    page.execute_script(script, [last])
    # The number of a threshold is counted from the pixels that were painted.
    number = f"{parameter.measured[last]:.{parameter.about.digits}f} {parameter.about.number_unit}"
    assert page.execute_script("return document.querySelector('#reading b').textContent") == number


def test_the_lecture_goes_on_with_the_next_demo(runs, gpu, opened, tmp_path):
    first, second = (find_demo(name) for name in ("rotations", "thresholds"))
    for demo, around in ((first, (None, second)), (second, (first, None))):
        page = demo_page(demo, runs.of(demo, gpu), runs.pair(demo, gpu), around)
        (tmp_path / f"{demo.stem}.html").write_text(page, encoding="utf-8")
    page = opened(tmp_path / f"{first.stem}.html", "#lecture-4")
    for keys, step in (((), "question"), (("Home",), "idea"), (("End",), "question")):
        press(page, *keys)
        assert now(page) == step, "no key and no address leads past the question"
    assert page.locator("#answer").inner_text() == ""
    press(page, "PageDown")  # the next step of the question is its answer
    assert now(page) == "question" and page.locator(".guessmark").count() == 0
    assert runs.of(first, gpu).findings[0].text in page.locator("#answer").inner_text()
    press(page, "End", "PageDown")
    page.wait_for_url(re.compile(second.stem))
    page.wait_for_selector("html.lecture")
    assert now(page) == "idea"
    press(page, "ArrowLeft")
    page.wait_for_url(re.compile(first.stem))


def test_without_scripts_everything_is_shown(runs, gpu, browser):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(runs.shown(find_demo(QUICK), gpu).page.as_uri())
    assert all(page.locator(".step").nth(i).is_visible() for i in range(page.locator(".step").count()))
    assert page.locator(".findings").is_visible() and seen_images(page) == ["answer"]
    context.close()


def test_paper_has_everything_and_the_notes(runs, gpu, opened, tmp_path):
    page = opened(lecture_page(runs, gpu, tmp_path))
    page.emulate_media(media="print")
    assert all(step.is_visible() for step in page.locator(".step").all())
    assert all(note.is_visible() for note in page.locator(".notes").all()) and seen_images(page) == ["answer"]


def lecture_page(runs, gpu, folder):
    """The page of lesson 4 of the lecture; those before and after it are copies."""
    before, demo, after = (find_demo(part.demo) for part in LECTURE[2:5])
    text = demo_page(demo, runs.of(demo, gpu), runs.pair(demo, gpu), (before, after), LECTURE)
    for one in (before, demo, after):
        (folder / f"{one.stem}.html").write_text(text, encoding="utf-8")
    return folder / f"{demo.stem}.html"


def test_notes_and_lessons_of_the_lecture(runs, gpu, opened, tmp_path):
    """N shows the notes of the step with the minutes; they, and the time, go on to the next lesson."""
    page = opened(lecture_page(runs, gpu, tmp_path), "#lecture")
    part, note = LECTURE[3], page.locator(".step.now .notes")
    assert not note.is_visible()
    press(page, "n")
    start = sum(p.minutes for p in LECTURE[:3])
    assert part.idea in note.inner_text()
    assert f"Lesson 4 of 7, minutes {start} to {start + part.minutes}" in note.inner_text()
    page.wait_for_selector(".step.now .clock:text('now 0:')")
    for size in WINDOWS:
        page.set_viewport_size(dict(zip(("width", "height"), size)))
        box, screen = note.bounding_box(), page.locator(".step.now .two").bounding_box()
        assert box["y"] + box["height"] == pytest.approx(size[1], abs=1)
        if size[0] > size[1]:
            assert screen["y"] + screen["height"] <= box["y"], "the notes cover the images"
    press(page, "PageDown")
    assert part.question in note.inner_text()
    before = re.search(r"@\d+n$", page.url)
    assert before
    press(page, "Shift+ArrowRight")
    page.wait_for_url(re.compile(f"{find_demo(LECTURE[4].demo).stem}.html#lecture{before.group()}"))
    page.wait_for_selector("html.noted.lecture")
    press(page, "n")
    assert not note.is_visible() and not page.url.endswith("n")


@pytest.mark.long
def test_both_browsers_open_the_lecture(runs, gpu, both_browsers, tmp_path):
    """The index of the lecture and a lesson with notes open without an error."""
    lesson = lecture_page(runs, gpu, tmp_path)
    index = tmp_path / "index.html"
    index.write_text(index_page([runs.shown(find_demo(QUICK), gpu)], LECTURE[3:4]), encoding="utf-8")
    both_browsers(index, "a[href*='#lecture'] img")
    both_browsers(lesson, "#drawn[data-value]")


def test_the_lecture_is_seven_demos_in_twenty_minutes(runs, gpu):
    """The index links demos with their minutes; neither index nor notes name a number that a page asks for."""
    assert len({part.demo for part in LECTURE}) == 7 and sum(part.minutes for part in LECTURE) == 20
    shown = [runs.shown(find_demo(part.demo), gpu) for part in LECTURE]
    page = index_page(shown, LECTURE)
    assert re.findall(r'<a href="([^"]+)"', page) == [f"{s.demo.stem}.html#lecture" for s in shown]
    assert re.findall(r"Minutes (\d+) to", page)[-1] == str(20 - LECTURE[-1].minutes)
    notes = [text for part in LECTURE for text in (part.idea, part.question, part.figure, part.parameter)]
    assert all(notes) and not any(s.result.findings[0].text in text for s in shown for text in (page, *notes))
