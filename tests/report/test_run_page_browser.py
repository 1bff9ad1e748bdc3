"""The HTML report in headless Chromium: keys, switches, dragging, themes, narrow screens, print, no console output."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_tools import mask_pixels, opened, shown_frame

from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.report.run_frames import FrameRecorder
from taubench_gl.report.run_page import ReportRun, write_html_report
from taubench_gl.run import Run

pytestmark = pytest.mark.usefixtures("coarse_light")

WIDTH, HEIGHT, PAIRS = 40, 20, 12  # of the synthetic run

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

BITS = (Reason.OUTSIDE, Reason.POSITION, Reason.NORMAL | Reason.POSITION, Reason.DIRECT)


def _mask(frame: int) -> np.ndarray:
    """A quarter of the width each: outside, position, position and normal, direct; shifted by the frame."""
    columns = (np.arange(WIDTH) + frame) % WIDTH * 4 // WIDTH
    return np.tile(np.array([int(b) for b in BITS], np.uint32)[columns], (HEIGHT, 1))


@pytest.fixture(scope="module")
def runs(tmp_path_factory, make_run) -> list[Run]:
    made = []
    for which in range(2):
        run = make_run()
        run.summary = copy.deepcopy(run.summary)
        run.summary["scene"]["name"] = "</script><b>'\"walk"
        run.summary["camera"]["cuts"] = [5]
        out = tmp_path_factory.mktemp("run")
        run.save(out)
        recorder = FrameRecorder(out)
        for i in range(1, PAIRS + 1):
            image = np.full((HEIGHT, WIDTH, 3), i / 20 + 0.3 * which)
            recorder.add(i, 9 if i == 7 else 0, image, 1 - image, _mask(i), np.zeros((HEIGHT, WIDTH, 2)))
        recorder.finish(out / "frames.csv")
        made.append(Run(run.summary, run.frames, out))
    return made


@pytest.fixture(scope="module")
def page_file(runs, tmp_path_factory) -> Path:
    loaded = [ReportRun(run.summary, run.frames, run.out) for run in runs]
    return write_html_report(loaded, tmp_path_factory.mktemp("page") / "report.html")


@pytest.fixture(scope="module")
def opened_page(browser, page_file) -> Iterator[Any]:
    yield from opened(browser, page_file)


@pytest.fixture
def page(opened_page) -> Any:
    """The page of both runs at frame 7, opened once: tests leave masks and thresholds as they found them."""
    opened_page.locator("#frame").fill("6")
    opened_page.locator("[data-mode=masks]").click()
    shown_frame(opened_page, 7)
    return opened_page


def test_keys_move_the_frame_slider(page):
    slider = page.locator("#frame")
    slider.focus()
    page.keyboard.press("ArrowRight")
    shown_frame(page, 8)
    page.keyboard.press("Home")
    shown_frame(page, 1)
    page.keyboard.press("End")
    shown_frame(page, PAIRS)
    assert "frame 12" in slider.get_attribute("aria-valuetext")
    assert "120" not in page.locator(".bar output").inner_text()
    # The percentage next to a reason is that of the frame: frustum is 10 i of 800 pixels.
    row = page.locator(".reason", has=page.locator("[data-reason=frustum]"))
    assert row.locator(".pc").inner_text() == f"{100 * 10 * PAIRS / (WIDTH * HEIGHT):.2f} %"


def test_switch_changes_the_pixels_of_its_reason_only(page):
    mask = _mask(7)
    drawn = mask_pixels(page)[..., 3] > 0
    every = int(FRUSTUM | Reason.POSITION | Reason.NORMAL | Reason.DIRECT)
    assert (drawn == ((mask & every) != 0)).all()
    page.locator("[data-reason=direct]").uncheck()
    drawn = mask_pixels(page)[..., 3] > 0
    assert (drawn == ((mask & (every & ~int(Reason.DIRECT))) != 0)).all()
    page.locator("[data-reason=direct]").focus()
    page.keyboard.press("Space")
    assert (mask_pixels(page)[..., 3] > 0).all()
    # Two reasons on one pixel are striped: both colors are present.
    both = mask_pixels(page)[(mask & int(Reason.NORMAL)) != 0][:, :3]
    assert {tuple(c) for c in both.tolist()} == {(0x00, 0x72, 0xB2), (0x00, 0x9E, 0x73)}


def test_opacity_slider_sets_the_alpha_of_the_mask(page):
    opacity = page.locator(".opacity input")
    before = opacity.input_value()
    opacity.fill("25")
    assert set(np.unique(mask_pixels(page)[..., 3])) == {round(255 * 0.25)}
    opacity.fill(before)


def test_divider_splits_reprojected_history_and_current_frame(page):
    script = """() => { const c = document.querySelector('.base');
        return Array.from(c.getContext('2d').getImageData(0, 0, c.width, 1).data) }"""
    page.locator("[data-mode=history]").click()
    page.wait_for_selector(".divider:not([hidden])")
    page.locator(".divider").focus()
    for key in ("Home", "PageUp", "PageUp", "PageUp", "ArrowUp"):
        page.keyboard.press(key)
    row = np.array(page.evaluate(script)).reshape(-1, 4)[:, 0]
    before, after = 255 * (1 - 7 / 20), 255 * 7 / 20
    at = round(0.32 * WIDTH)  # left of it the history; columns 0 to 2 have none and show a checkerboard
    assert np.abs(row[5 : at - 1] - before).max() < 8 and np.abs(row[at + 1 :] - after).max() < 8
    assert np.abs(row[:2] - before).min() > 8
    box = page.locator(".stage").first.bounding_box()
    page.locator(".divider").hover()
    page.mouse.down()
    page.mouse.move(box["x"] + 0.75 * box["width"], box["y"] + 20, steps=4)
    page.mouse.up()
    assert page.locator(".divider").get_attribute("aria-valuenow") == "75"


def test_mode_with_the_frame_of_another_run(page):
    page.locator("[data-mode=runs]").click()
    page.wait_for_selector(".tag.left:not([hidden])")
    assert page.locator(".tag.left").first.inner_text() == "</script><b>'\"walk #2, frame 7"
    page.select_option("#run", "1")
    playwright.expect(page.locator(".tag.right").first).to_have_text(re.compile("#2$"))


@pytest.mark.parametrize("feature", ["color", "normal"])
def test_dragged_threshold_shows_the_recorded_number(page, runs, feature):
    summary = runs[0].summary
    curve, cell = summary["curves"][feature], page.locator(f"[data-live={feature}]")
    assert cell.inner_text() == f"{summary['discard'][feature]['mean_percent']:.2f} %"
    handle = page.locator(f".handle[data-feature={feature}]")
    handle.scroll_into_view_if_needed()
    area = page.locator("#curves svg.plot").bounding_box()
    box = handle.locator(".dot").bounding_box()
    # Other dots may cover this one: bring it to the front.
    handle.evaluate("node => node.parentNode.append(node)")
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(area["x"] + 0.35 * area["width"], area["y"] + 60, steps=5)
    page.mouse.up()
    seen = [expected_at(cell, curve, summary)]
    handle.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("PageUp")
    seen.append(expected_at(cell, curve, summary))
    assert seen[1][0] > seen[0][0] and seen[1][1] < seen[0][1]
    page.get_by_role("button", name=re.compile("Reset")).click()
    assert cell.inner_text() == f"{summary['discard'][feature]['mean_percent']:.2f} %"


def expected_at(cell: Any, curve: dict, summary: dict) -> tuple[float, float]:
    """Threshold and percentage on the page, checked against the histogram in the summary."""
    threshold, shown = float(cell.get_attribute("data-threshold")), float(cell.get_attribute("data-percent"))
    (index,) = np.flatnonzero(np.array(curve["edges"]) == threshold)
    expected = 100.0 * sum(curve["counts"][index + 1 :]) / (PAIRS * WIDTH * HEIGHT)
    assert shown == pytest.approx(expected)
    assert cell.inner_text() == (f"{expected:.2f} %" if expected >= 0.005 else "<0.01 %")
    return threshold, shown


def test_triangle_moves_all_thresholds(page):
    page.locator(".handle[data-feature=all]").focus()
    page.keyboard.press("PageDown")
    values = {page.locator(f"[data-live={f}]").get_attribute("data-threshold") for f in ("color", "position", "direct")}
    assert len(values) == 1 and float(values.pop()) < 32 / 255
    page.get_by_role("button", name=re.compile("Reset")).click()


def test_hover_reads_a_pair_and_click_shows_it(page, runs):
    plot = page.locator("#plots svg.plot")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    page.mouse.move(box["x"] + box["width"] - 10, box["y"] + 80)
    readout = page.locator("#plots .readout").inner_text()
    frustum = 100 * runs[0].frames[-1]["frustum"] / (WIDTH * HEIGHT)
    assert "frame 12" in readout and f"frustum {frustum:.2f} %" in readout
    page.mouse.click(box["x"] + box["width"] - 10, box["y"] + 80)
    shown_frame(page, 12)
    assert page.locator("#plots line.cut").count() == 1
    page.locator("#plots [role=application]").focus()
    page.keyboard.press("ArrowLeft")
    shown_frame(page, 11)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_theme_follows_the_system_and_the_button(browser, page_file, scheme):
    for page in opened(browser, page_file, color_scheme=scheme):
        background = "getComputedStyle(document.body).backgroundColor"
        first = page.evaluate(background)
        page.locator("#theme").click()
        second = page.evaluate(background)
        page.locator("#theme").click()
        assert first == page.evaluate(background) != second
        brightness = [sum(map(int, re.findall(r"\d+", c)[:3])) for c in (first, second)]
        assert (brightness[0] > brightness[1]) == (scheme == "light")


def test_narrow_screens_scroll_vertically_only(browser, page_file):
    for page in opened(browser, page_file, viewport={"width": 320, "height": 700}, has_touch=True, is_mobile=True):
        wide = "[...document.querySelectorAll('body *')].filter(e => e.getBoundingClientRect().right > innerWidth + 1"
        wide += " && !e.closest('.wide, nav')).map(e => e.tagName + '.' + e.className.baseVal + e.className)"
        for width, checked in ((320, False), (768, True)):
            page.set_viewport_size({"width": width, "height": 700})
            assert page.evaluate(wide) == []
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            page.locator(".reason label").first.tap()
            assert page.locator(".reason input").first.is_checked() == checked


def test_print_shows_all_details_and_no_controls(browser, page_file):
    for page in opened(browser, page_file, viewport={"width": 720, "height": 1000}):
        closed = page.locator("details:not([open])")
        before = closed.count()
        page.emulate_media(media="print")
        playwright.expect(closed).to_have_count(0)
        assert before > 0
        assert page.locator(".figure .big").first.is_visible()
        assert not page.locator("#theme").is_visible() and not page.locator("#frame").is_visible()
        assert page.evaluate("document.documentElement.scrollWidth") <= 720
        assert page.pdf(format="A4").startswith(b"%PDF")
        page.emulate_media(media="screen")
        playwright.expect(closed).to_have_count(before)


def test_first_image_is_drawn_before_the_load_event_ends(browser, page_file):
    """A page that is printed as soon as it has loaded, as ``chromium --print-to-pdf`` does, has its image."""
    context = browser.new_context()
    page = context.new_page()
    page.add_init_script("addEventListener('load', () => { atLoad = document.querySelector('.stage').dataset.frame; })")
    page.goto(page_file.as_uri())
    shown = page.evaluate("document.querySelector('.stage').dataset.frame")
    assert page.evaluate("atLoad") == shown == "7", "the worst frame"
    context.close()


def test_table_captions_and_row_names_stay_visible_on_a_phone(browser, page_file):
    for page in opened(browser, page_file, viewport={"width": 375, "height": 700}, is_mobile=True):
        rights = page.evaluate("[...document.querySelectorAll('caption')].map(e => e.getBoundingClientRect().right)")
        assert len(rights) == 6 and max(rights) <= 375
        names = "[...document.querySelectorAll('.wide tbody th')].map(e => e.getBoundingClientRect().left)"
        before = page.evaluate(names)
        page.evaluate("document.querySelectorAll('.wide').forEach(e => e.scrollTo(150, 0))")
        assert page.evaluate(names) == before


def test_tab_reaches_every_control_with_visible_focus(page):
    names, expected = set(), {"theme", "run", "frame", "masks", "history", "frustum", "color", "all", "wide"}
    for _ in range(200):
        if expected <= names:
            break
        page.keyboard.press("Tab")
        names.add(page.evaluate(
            "(() => { const a = document.activeElement;"
            " return a.id || a.dataset.feature || a.dataset.reason || a.dataset.mode || a.className || a.tagName })()"
        ))  # fmt: skip
    assert expected <= names
    outline = page.evaluate("document.getElementById('theme').focus({focusVisible: true}) || "
                            "getComputedStyle(document.getElementById('theme')).outlineStyle")  # fmt: skip
    assert outline == "solid"


def test_run_without_images_or_pairs(browser, tmp_path, make_run):
    run = make_run()
    run.summary |= {"pairs": 0, "curves": {}, "discard": {}}
    file = write_html_report([ReportRun(run.summary, [])], tmp_path / "report.html")
    for page in opened(browser, file):
        for part in ("#viewer", "#plots", "#curves"):
            assert page.locator(f"{part} .missing").count() == 1
