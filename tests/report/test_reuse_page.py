"""The page of a reuse evaluation: its data, and measure, frame and method selection in headless Chromium."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from page_tools import data_of, opened, shown_frame

from taubench_gl.conventions import Reason
from taubench_gl.glossary import label_of
from taubench_gl.report.reuse import class_label, reuse_html
from taubench_gl.report.reuse_frames import ReuseRecorder, reuse_images
from taubench_gl.reuse.scores import CLASSES

MEASURES = ("flip", "relmse", "ssim", "psnr_db", "tpsnr_db", "flicker")
FRAMES = (3, 4, 5)


def method(scale: float, time_ms: float) -> dict[str, Any]:
    quality = dict.fromkeys(("psnr_db", "ssim", "tpsnr_db", "flicker")) | {"flip": scale, "relmse": 2 * scale}
    reuse = dict.fromkeys(("reused_percent", "mean_weight", "wrongly_reused_percent", "wrongly_rejected_percent"))
    classes = {"rest": {"pixels": 10, "percent": 100.0, "flip": scale, "relmse": 2 * scale}}
    return {"failed": None, "mean": quality, "reuse": reuse, "classes": classes, "reasons": {}, "memory_bytes": 2**20,
            "time_ms": time_ms}  # fmt: skip


@pytest.fixture(scope="module")
def evaluation() -> tuple[dict[str, Any], list[dict[str, Any]]]:
    methods = {
        "slow": method(0.1, 20.0),
        "fast": method(0.4, 2.0),
        "<b>bad": {"failed": "it does not compile", "memory_bytes": None},
    }
    summary = {
        "scene": {"name": "</script><b>hall"},
        "settings": {"width": 8, "height": 4, "fps": 24.0, "first_frame": 3, "last_frame": 5},
        "input": {"kind": "clean", "light_samples": None, "notes": [], "shading_ms": 1.0},
        "reference": {"kind": "max", "samples": 16}, "clock": "a clock",
        "evaluated_frames": 2, "mask_source": "geometry",
        "measures": {name: {"unit": "", "better": "lower", "doc": f"definition of {name}"} for name in MEASURES},
        "classes": {"rest": "every pixel"}, "methods": methods,
    }  # fmt: skip
    rows = [
        dict.fromkeys(MEASURES)
        | {"frame": frame, "method": label, "flip": scale * frame, "relmse": 2.0 * scale * frame}
        for label, scale in (("slow", 0.1), ("fast", 0.4))
        for frame in FRAMES
    ]
    return summary, rows


def test_data_holds_measures_with_values_and_methods_that_ran(evaluation):
    page = reuse_html(*evaluation)
    data = data_of(page)
    assert [m["name"] for m in data["measures"]] == ["flip", "relmse"] and data["frames"] == list(FRAMES)
    assert {m["label"]: m["rows"]["flip"] for m in data["methods"]} == {
        "slow": pytest.approx([0.3, 0.4, 0.5]), "fast": pytest.approx([1.2, 1.6, 2.0])
    }  # fmt: skip
    assert "<b>bad" not in page and "&lt;b&gt;bad" in page and "<b>hall" not in page


@pytest.fixture(scope="module")
def page(browser, evaluation, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(reuse_html(*evaluation, b"not an image"), encoding="utf-8")
    yield from opened(browser, path)


CLASS_NAMES = ("lit", "rest")


@pytest.fixture(scope="module")
def viewer_file(evaluation, tmp_path_factory):
    """A page with images: the left half of each frame is ``lit``; image k has the gray k / 10."""
    summary, rows = evaluation
    summary = summary | {"classes": dict.fromkeys(CLASS_NAMES, "meaning")}
    for label, one in summary["methods"].items():
        classes = {name: {"pixels": 64, "percent": 50.0, "flip": 0.1, "relmse": 0.2} for name in CLASS_NAMES}
        summary["methods"] = summary["methods"] | {label: one | ({} if one["failed"] else {"classes": classes})}
    out = tmp_path_factory.mktemp("viewer")
    (out / "frames.csv").write_text("frame\n3\n")
    recorder = ReuseRecorder(out, len(CLASS_NAMES))
    halves = np.repeat(np.int8([[0, 1]]), 8, axis=0).repeat(8, axis=1)
    for frame in FRAMES:
        images = {name: np.full((8, 16, 3), 0.1 * k) for k, name in enumerate(("input", "slow", "fast", "reference"))}
        errors = {"slow": 0.2 + 0.1 * halves, "fast": 0.4 + 0.01 * frame + 0.0 * halves}
        recorder.add(frame, 0, images, errors, halves)
    recorder.finish(out / "frames.csv")
    path = out / "report.html"
    path.write_text(reuse_html(summary, rows, None, reuse_images(out)), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def viewer(browser, viewer_file):
    yield from opened(browser, viewer_file)


@pytest.mark.long
def test_firefox_draws_images_and_plots(firefox, viewer_file):
    page = firefox(viewer_file, ".stage[data-frame]")
    script = """const c = document.querySelector(".stage canvas");
        return Array.from(c.getContext("2d").getImageData(1, 1, 1, 1).data)"""
    assert page.execute_script(script)[3] == 255
    assert page.execute_script("return document.querySelectorAll('.plot .line').length") >= 2


@pytest.fixture
def fresh(viewer):
    viewer.reload()
    viewer.wait_for_selector(".stage[data-frame]")
    return viewer


def pixels(page) -> np.ndarray:
    """(h, w, 3) of the canvas, once it does not change any more."""
    script = """() => { const c = document.querySelector('.stage canvas');
        return [c.height, c.width, Array.from(c.getContext('2d').getImageData(0, 0, c.width, c.height).data)] }"""
    before = None
    for _ in range(50):
        height, width, values = page.evaluate(script)
        if values == before:
            break
        before = values
        page.wait_for_timeout(50)
    return np.array(values, np.float64).reshape(height, width, 4)[..., :3]


def test_the_divider_separates_two_images(fresh):
    fresh.select_option("#left", label="slow")
    fresh.select_option("#right", label="fast")
    image = pixels(fresh)
    assert np.abs(image[:, :7] - 25.5).max() < 4 and np.abs(image[:, 9:] - 51).max() < 4
    fresh.locator(".divider").focus()
    fresh.keyboard.press("End")
    assert np.abs(pixels(fresh) - 25.5).max() < 4
    tags = [fresh.locator(f".tag.{side}").first.inner_text() for side in ("left", "right")]
    assert tags == ["slow", "fast"]


def test_error_maps_are_magma_and_images_without_one_are_black(fresh):
    from matplotlib import colormaps

    fresh.select_option("#left", label="slow")
    fresh.select_option("#right", label="reference")
    fresh.click("button[data-mode=errors]")
    fresh.wait_for_selector(".stage[data-mode=errors]")
    image = pixels(fresh)
    expected = 255 * np.array(colormaps["magma"](0.2)[:3])
    assert np.abs(image[:, 1:6] - expected).max() < 12 and image[:, 9:].max() == 0
    assert "no error map" in fresh.locator(".tag.right").first.inner_text()


def test_the_class_filter_darkens_and_averages(fresh):
    fresh.select_option("#left", label="slow")
    fresh.select_option("#right", label="fast")
    cells = fresh.locator("tr.total td")
    assert cells.nth(1).inner_text() == "0.25"  # (0.2 + 0.3) / 2
    fresh.uncheck("#class-rest")
    assert cells.nth(0).inner_text() == "50.00 %" and cells.nth(1).inner_text() == "0.2"
    image = pixels(fresh)
    assert np.abs(image[:, :7] - 25.5).max() < 4 and np.abs(image[:, 9:] - 0.15 * 51).max() < 3
    fresh.select_option("#measure", "classes shown")
    assert "slow 0.2" in fresh.inner_text("#frames .readout") and "fast 0.445" in fresh.inner_text("#frames .readout")
    fresh.check("#class-rest")
    assert "slow 0.25" in fresh.inner_text("#frames .readout")


def test_classes_have_the_names_of_the_sentences(fresh):
    """Names for readers, not the keys of reuse.json; every class that an evaluation writes has one."""
    assert fresh.locator("table.classes label").all_inner_texts() == [f" {class_label(n)}" for n in CLASS_NAMES]
    labels = {name: class_label(name) for name in CLASSES}
    assert labels["lit"] == label_of(Reason.LIT) and labels["shadowed"] == label_of(Reason.SHADOWED)
    assert len(set(labels.values())) == len(CLASSES) and not any("_" in label for label in labels.values())


def test_the_slider_and_the_plot_select_the_same_frame(fresh):
    fresh.locator("#frame").focus()
    fresh.keyboard.press("Home")
    shown_frame(fresh, FRAMES[0])
    fresh.locator("#frames [role=application]").focus()
    fresh.keyboard.press("End")
    shown_frame(fresh, FRAMES[-1])
    assert fresh.locator("#frame").input_value() == str(len(FRAMES) - 1)


def test_it_plays(fresh):
    fresh.locator("#frame").focus()
    fresh.keyboard.press("Home")
    shown_frame(fresh, FRAMES[0])
    fresh.click("button[aria-label=Play]")
    for frame in (FRAMES[1], FRAMES[2], FRAMES[0]):
        shown_frame(fresh, frame)
    fresh.click("button[aria-label=Pause]")
    assert fresh.locator("button[aria-label=Play]").count() == 1


@pytest.mark.parametrize("width", [1280, 390])
def test_the_page_fits_its_width(fresh, width):
    fresh.set_viewport_size({"width": width, "height": 800})
    fresh.wait_for_timeout(100)
    assert fresh.evaluate("document.documentElement.scrollWidth") <= width
    box = fresh.locator(".stage").first.bounding_box()
    assert box["width"] > 0.5 * width and box["width"] / box["height"] == pytest.approx(2.0, rel=0.02)


def test_without_images_the_page_says_how_to_get_them(page):
    assert page.locator(".stage").count() == 0 and "--report" in page.inner_text(".missing")


def test_measure_changes_both_plots(page):
    assert page.locator("#frames path.line").count() == 2 and page.locator("#scatter .mark").count() == 2
    page.select_option("#measure", "flip")
    lines = [line.get_attribute("d") for line in page.locator("#frames path.line").all()]
    assert "slow 0.1" in page.inner_text("#frames .readout")
    page.select_option("#measure", "relmse")
    assert "slow 0.2" in page.inner_text("#frames .readout")
    assert page.inner_text("#definition") == "definition of relmse"
    assert len(lines) == 2


def test_keys_select_a_frame(page):
    page.select_option("#measure", "flip")
    page.locator("#frames [role=application]").focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    text = page.inner_text("#frames .readout")
    assert "frame 4" in text and "slow 0.4" in text and "fast 1.6" in text


def test_arrow_keys_walk_through_the_methods_by_time(page):
    page.select_option("#measure", "flip")
    page.locator('#scatter .mark[data-name="fast"]').focus()
    page.keyboard.press("ArrowRight")
    assert page.evaluate("document.activeElement.dataset.name") == "slow"
    status = page.inner_text("#status")
    assert "slow" in status and "20 ms" in status and "a clock" in status
