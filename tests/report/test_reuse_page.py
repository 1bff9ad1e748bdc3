"""The page of a reuse evaluation: its data, and measure, frame and method selection in headless Chromium."""

from __future__ import annotations

import json
import re
import shutil
from typing import Any

import pytest

from taubench_gl.report.reuse import reuse_html

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
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
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])
    assert [m["name"] for m in data["measures"]] == ["flip", "relmse"] and data["frames"] == list(FRAMES)
    assert {m["label"]: m["rows"]["flip"] for m in data["methods"]} == {
        "slow": pytest.approx([0.3, 0.4, 0.5]), "fast": pytest.approx([1.2, 1.6, 2.0])
    }  # fmt: skip
    assert "<b>bad" not in page and "&lt;b&gt;bad" in page and "<b>hall" not in page


@pytest.fixture(scope="module")
def page(evaluation, tmp_path_factory):
    playwright = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(reuse_html(*evaluation, b"not an image"), encoding="utf-8")
    with playwright.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        opened, faults = browser.new_page(), []
        opened.on("console", lambda m: faults.append(m.text))
        opened.on("pageerror", lambda e: faults.append(str(e)))
        opened.on("request", lambda r: None if r.url.startswith(("file:", "data:")) else faults.append(r.url))
        opened.goto(path.as_uri())
        yield opened
        browser.close()
    assert faults == []


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
