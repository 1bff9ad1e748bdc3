"""The page of a full report: thresholds redraw masks, shares and rates; probe, zoom, arrangements, damaged files."""

from __future__ import annotations

import itertools
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from page_tools import mask_pixels, opened, shown_frame
from PIL import Image

from taubench_gl.api import evaluate
from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.errors import SettingsError
from taubench_gl.features import FEATURE_BIT, FEATURES, MASK_WORDS
from taubench_gl.metrics.reuse_rate import ReuseStats
from taubench_gl.paths import PACKAGE
from taubench_gl.report.distance_planes import levels_of
from taubench_gl.report.reusable import TERMS, reusable_sentence
from taubench_gl.report.run_frames import LEVELS, stored_frames
from taubench_gl.report.run_page import ReportRun, report_data, write_html_report
from taubench_gl.run import Run
from taubench_gl.selftest.scenes import busy_room

pytestmark = pytest.mark.usefixtures("coarse_light")

WIDTH, HEIGHT = 64, 36
SETTINGS = {"width": WIDTH, "height": HEIGHT, "fps": 4, "indirect": "rsm"}
LOWER = {"color": 2.0**-5, "position": 2.0**-4, "normal": 2.0**-6, "direct": 2.0**-4, "indirect": 2.0**-8}
"""Edges of the threshold curve: a distance of exactly an edge is discarded at its stop."""
COUNTED = (*FEATURES, "frustum", "disoccluded", "occluding", "lit", "shadowed", "outside", "behind")


@pytest.fixture(scope="module")
def made(session_gpu, tmp_path_factory) -> SimpleNamespace:
    """A full report, the distances of its pairs, and a run at other thresholds."""
    out, distances = tmp_path_factory.mktemp("full"), {}

    def keep(pair):
        distances[pair.frame] = pair.distances

    run = evaluate(busy_room(lamps=1), out=out, report="full", on_pair=keep, **SETTINGS)
    masks = {}
    below = {name: float(np.nextafter(np.float32(edge), np.float32(0))) for name, edge in LOWER.items()}
    other = evaluate(
        busy_room(lamps=1), thresholds=below, on_pair=lambda p: masks.update({p.frame: p.mask}), **SETTINGS
    )
    return SimpleNamespace(out=out, run=run, distances=distances, other=other, masks=masks)


@pytest.fixture(scope="module")
def page(browser, made) -> Iterator[Any]:
    """The report, opened once: each test leaves its thresholds, zoom and probe as it found them."""
    for page in opened(browser, made.out / "report.html"):
        ready(page)
        yield page


def ready(page: Any) -> None:
    page.wait_for_selector("#curves[data-live=true]")


def stops(made, name: str) -> list[float]:
    """Thresholds of the stops of a slider: those of the levels that all frames keep."""
    stored, _ = stored_frames(made.out)
    levels = stored.planes.levels[name]
    kept = levels["kept"][max(stored.planes.steps.values())]
    used = made.run.summary["settings"]["thresholds"][name]
    return [used if code == levels["home"] else levels["values"][code - 1] for code in kept]


def set_threshold(page: Any, made, name: str, threshold: float) -> None:
    page.locator(f"[data-limit={name}]").fill(str(stops(made, name).index(threshold)))


def frame_counts(page: Any) -> dict[str, int | None]:
    cells = "[...document.querySelectorAll('.reason')].map(r => [r.querySelector('[data-reason]').dataset.reason,"
    cells += " r.querySelector('.pc').dataset.count])"
    return {name: int(text) if text else None for name, text in page.evaluate(cells)}


def stage_box(page: Any) -> dict[str, float]:
    """Position of the image in the window, scrolled into it."""
    stage = page.locator(".stage").first
    stage.evaluate("node => node.scrollIntoView({ block: 'center', behavior: 'instant' })")
    return stage.bounding_box()


def repainted(page: Any) -> None:
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def reset(page: Any) -> None:
    """Back to the thresholds of the run."""
    page.get_by_role("button", name=re.compile("Reset")).click()
    repainted(page)


def test_files_of_a_full_report(made):
    stored, why = stored_frames(made.out)
    assert why == "" and stored.planes is not None and stored.no_planes == ""
    assert set(stored.planes.features) == set(FEATURES)
    # Codes of the run itself: counts of every pair at its thresholds are those of frames.csv.
    for row, counts in zip(made.run.frames, stored.planes.counts, strict=True):
        for name, codes in zip(stored.planes.features, counts, strict=True):
            assert codes[stored.planes.levels[name]["home"] :].sum() == row[name]


def test_shares_and_masks_at_other_thresholds_are_those_of_a_run_at_them(page, made):
    for name, edge in LOWER.items():
        set_threshold(page, made, name, edge)
    repainted(page)
    for row in made.other.frames:
        page.locator("#frame").fill(str(row["frame"] - 1))
        shown_frame(page, row["frame"])
        found = frame_counts(page)
        assert {name: found[name] for name in COUNTED} == {name: row[name] for name in COUNTED}
        for rate in ("surface", "shading"):
            assert found[f"reusable_{rate}"] == row["pixels"] - row["sky"] - row[f"reusable_{rate}"]
    old = [row["position"] for row in made.run.frames]
    assert all(row["position"] > count for row, count in zip(made.other.frames, old, strict=True))
    frame = made.other.frames[-1]["frame"]
    for box in page.locator("[data-reason]").all():
        box.set_checked(box.get_attribute("data-reason") in ("position", "reusable_shading"))
    rates = NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL | Reason.DIRECT | Reason.INDIRECT
    bits = made.masks[frame]
    expected = ((bits & np.uint32(int(rates))) != 0) & ((bits & Reason.SKY) == 0)
    expected |= (bits & Reason.POSITION) != 0  # the column counts sky against surface
    np.testing.assert_array_equal(mask_pixels(page)[..., 3] > 0, expected)
    # The rates over time follow: the readout at a pair is that of the other run.
    page.locator("#plots [role=application]").focus()
    page.keyboard.press("End")
    shown_frame(page, frame)
    shares = [f"{name} {100 * made.other.frames[-1][name] / (WIDTH * HEIGHT):.2f} %" for name in ("position", "normal")]
    readout = page.locator("#plots .readout").inner_text()
    assert all(share in readout for share in shares)
    # Back at the thresholds of the run: its counts.
    reset(page)
    found = frame_counts(page)
    assert {name: found[name] for name in COUNTED} == {name: made.run.frames[-1][name] for name in COUNTED}


def counted(page: Any) -> dict[str, Any]:
    """The headline once it is counted: sentence, rates, bars of reasons, note."""
    page.wait_for_selector(".headline[data-counted]")
    rates = {rate: page.locator(f"[data-rate={rate}] dd").all_inner_texts() for rate in ("surface", "shading")}
    rates["sky"] = page.locator(".sky dd").all_inner_texts()
    words = {name: page.locator(f".answer .{name}").inner_text() for name in ("sentence", "live")}
    return words | {"rates": rates, "bars": bars(page)}


def bars(page: Any) -> list[list[str]]:
    """Label and share of each reason, from above."""
    return [row.locator("th, td").all_inner_texts()[:2] for row in page.locator(".headline .bars tr").all()]


def bars_of(summary: dict[str, Any]) -> list[list[str]]:
    """The bars of a run: its reasons, the largest first."""
    shares = {name: entry["mean_percent"] for name, entry in summary["reusable"]["reasons"].items()}
    return [
        [TERMS[n].label, f"{shares[n]:.2f} %"] for n in sorted(TERMS, key=lambda n: -shares.get(n, 0)) if shares.get(n)
    ]


def rates_of(summary: dict[str, Any]) -> dict[str, list[str]]:
    """What the figures of a run read: ``60.00 %``, ``50.00 to 70.00 %``, ``40.00 % of all pixels``; sky."""
    found = {}
    for rate in ("surface", "shading"):
        keys = ("mean", "min", "max", "of_picture")
        mean, low, high, whole = (summary["reusable"][rate][f"{key}_percent"] for key in keys)
        found[rate] = [f"{mean:.2f} %", f"{low:.2f} to {high:.2f} %", f"{whole:.2f} % of all pixels"]
    return found | {"sky": [f"{summary['reusable']['sky_percent']:.2f} %", "of all pixels"]}


def test_the_headline_at_other_thresholds_is_that_of_a_run_at_them(page, made):
    before = page.locator(".headline").inner_text()
    assert bars(page) == bars_of(made.run.summary)
    for name, edge in LOWER.items():
        set_threshold(page, made, name, edge)
    found, summary = counted(page), made.other.summary
    sentence = reusable_sentence({"reusable": summary["reusable"]})  # pages count again by one reprojection
    assert found["sentence"] == sentence[0].upper() + sentence[1:] + "." and found["sentence"] not in before
    assert found["rates"] == rates_of(summary) != rates_of(made.run.summary)
    assert found["bars"] == bars_of(summary) != bars_of(made.run.summary) and len(found["bars"]) > 3
    assert f"all {summary['pairs']} pairs" in found["live"]
    reset(page)
    assert page.locator(".headline").inner_text() == before


def test_the_headline_of_the_page_counts_surface_pixels_as_the_summary_does(page, made):
    """Frames made by hand, with sky in most words: the script and the package give one sentence and the same rates."""
    rng, words = np.random.default_rng(5), np.arange(MASK_WORDS)
    possible = words[(words & int(NOT_COMPARABLE)) == 0]
    frames, stats = [], ReuseStats({})
    for share in (0.9, 0.2):
        found = rng.choice(possible, 40, replace=False)
        sky = rng.random(40) < share
        found = np.where(sky, found | int(Reason.SKY), found & ~int(Reason.SKY))
        histogram = np.bincount(found, rng.integers(1, 500, 40), MASK_WORDS).astype(np.int64)
        stats.add(histogram)
        counts = [[int(word), int(histogram[word])] for word in np.flatnonzero(histogram)]
        frames.append({"pixels": int(histogram.sum()), "counts": counts})
    block = stats.block("camera", np.zeros(2, dtype=bool))
    data = report_data([ReportRun(made.run.summary, made.run.frames)], ["run"])
    code = "\n".join((PACKAGE / "report" / "assets" / name).read_text() for name in ("plot.js", "headline.js"))
    script = f"""(frames) => {{ {code}
        const data = {json.dumps(data)}, found = summarizeFrames(frames, data.runs[0], data);
        return [found, found.rate && reuseSentence(found, data.reuse)]; }}"""
    found, text = page.evaluate(script, frames)
    for rate, shown in found["rates"].items():
        keys = {"mean": "mean", "low": "min", "high": "max", "whole": "of_picture"}
        assert shown == pytest.approx({name: block[rate][f"{key}_percent"] for name, key in keys.items()})
    assert found["sky"] == pytest.approx(block["sky_percent"]) and 20.0 < found["sky"] < 80.0
    assert found["shares"] == pytest.approx({n: entry["mean_percent"] for n, entry in block["reasons"].items()})
    assert text == reusable_sentence({"reusable": block})
    sky = [{"pixels": 9, "counts": [[int(Reason.SKY), 9]]}]
    assert page.evaluate(script, sky)[0]["rate"] is None


def test_the_headline_of_a_part_of_the_pairs_states_it(browser, made, tmp_path):
    run = ReportRun(made.run.summary, made.run.frames, made.out)
    for page in opened(browser, write_html_report([run], tmp_path / "part.html", images=2)):
        ready(page)
        set_threshold(page, made, "position", LOWER["position"])
        shown = page.locator("#frame").get_attribute("max")
        frames = int(shown) + 1
        found = counted(page)
        assert frames < made.run.summary["pairs"]
        assert f"{frames} of {made.run.summary['pairs']} pairs" in found["live"]
        # The distances of a threshold far below that of the run do not tell these reasons apart.
        set_threshold(page, made, "position", stops(made, "position")[0])
        page.wait_for_function("document.querySelector('.answer .live').textContent.includes('changed in position')")


def test_firefox_repaints_masks_and_headline(firefox, made):
    from marionette_driver import Wait

    page = firefox(made.out / "report.html", "#curves[data-live=true]")
    for name, edge in LOWER.items():
        page.execute_script(
            """const range = document.querySelector(`[data-limit=${arguments[0]}]`);
            range.value = arguments[1]; range.dispatchEvent(new Event("input"));""",
            [name, stops(made, name).index(edge)],
        )
    text = "return document.querySelector('.headline[data-counted]') && document.querySelector('.sentence').textContent"
    sentence = Wait(page, timeout=60).until(lambda d: d.execute_script(text))
    expected = reusable_sentence({"reusable": made.other.summary["reusable"]})
    assert sentence == expected[0].upper() + expected[1:] + "."
    cells = """return Object.fromEntries([...document.querySelectorAll(".reason")].map((r) =>
        [r.querySelector("[data-reason]").dataset.reason, Number(r.querySelector(".pc").dataset.count)]))"""
    frame = int(page.execute_script("return document.querySelector('.stage').dataset.frame"))
    row = next(row for row in made.other.frames if row["frame"] == frame)
    # The masks are repainted at the next animation frame, which may come after the headline.
    Wait(page, timeout=60).until(
        lambda d: {n: d.execute_script(cells)[n] for n in COUNTED} == {n: row[n] for n in COUNTED}
    )


def test_reasons_that_the_distances_do_not_tell_are_dashes(page, made):
    set_threshold(page, made, "position", stops(made, "position")[0])
    set_threshold(page, made, "direct", stops(made, "direct")[0])
    repainted(page)
    found = frame_counts(page)
    assert {found[name] for name in ("disoccluded", "occluding", "lit", "shadowed")} == {None}
    assert found["position"] > 0 and found["reusable_shading"] is not None
    reset(page)


def test_probe_names_reasons_and_distances_of_the_pixel(page, made):
    frame = int(page.locator(".stage").first.get_attribute("data-frame"))
    stored, _ = stored_frames(made.out)
    mask = np.asarray(Image.open(stored.folder / f"mask_{frame:05d}.png")).astype(np.uint32)
    mask = mask[..., 0] | mask[..., 1] << 8
    rows, columns = np.nonzero((mask & int(Reason.NORMAL)) != 0)
    y, x = rows[len(rows) // 2], columns[len(rows) // 2]
    box = stage_box(page)
    page.mouse.move(box["x"] + (x + 0.5) / WIDTH * box["width"], box["y"] + (y + 0.5) / HEIGHT * box["height"])
    probe = page.locator(".probe")
    assert f"pixel ({x}, {y})" in probe.inner_text()
    reasons = [item.split()[0] for item in probe.locator("li b").all_inner_texts()]
    assert "normal" in reasons
    assert "unit shading normal" in probe.inner_text()  # the definition of the glossary
    for name, values in made.distances[frame].features.items():
        row = probe.locator(f"[data-probe={name}]")
        levels = levels_of(made.run.summary["settings"]["thresholds"][name])
        assert int(row.get_attribute("data-code")) == levels.codes(values[y, x])
        discarded = "discarded" in row.inner_text()
        assert discarded == bool(mask[y, x] & int(FEATURE_BIT[name]))
    # The same distances are marked on the tracks of the thresholds.
    assert page.locator("[data-probed]").count() == len(FEATURES)
    page.mouse.move(5, 5)
    assert page.locator("[data-probed]").count() == 0


def test_keys_move_pin_and_release_the_probe(page):
    stage = page.locator(".stage").first
    stage.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowDown")
    assert f"pixel ({WIDTH // 2 + 1}, {HEIGHT // 2 + 10})" in page.locator(".probe").inner_text()
    assert page.locator(".cross.pinned").first.is_visible()
    page.mouse.move(*(stage_box(page)[k] + 20 for k in ("x", "y")))
    assert f"pixel ({WIDTH // 2 + 1}, {HEIGHT // 2 + 10})" in page.locator(".probe").inner_text()
    page.keyboard.press("Escape")
    assert "Point at a pixel" in page.locator(".probe").inner_text()


def test_zoom_shows_pixels_and_keeps_the_probe_in_place(page):
    stage = page.locator(".stage").first
    box = stage_box(page)
    u, v = 0.3, 0.7
    at = box["x"] + u * box["width"], box["y"] + v * box["height"]
    page.mouse.dblclick(*at)
    page.mouse.dblclick(*at)
    assert page.locator(".zoom output").inner_text() == "400 %"
    assert page.evaluate("getComputedStyle(document.querySelector('.stage .base')).imageRendering") == "pixelated"
    page.mouse.move(*at)
    assert f"pixel ({int(u * WIDTH)}, {int(v * HEIGHT)})" in page.locator(".probe").inner_text()
    page.mouse.down()
    page.mouse.move(at[0] + box["width"] / 4, at[1], steps=4)  # a quarter of the stage is a sixteenth of the image
    page.mouse.up()
    page.mouse.move(*at)
    assert f"pixel ({int((u - 1 / 16) * WIDTH)}, {int(v * HEIGHT)})" in page.locator(".probe").inner_text()
    stage.focus()
    page.keyboard.press("0")
    assert page.locator(".zoom output").inner_text() == "100 %"


@pytest.fixture(scope="module")
def both(made, tmp_path_factory) -> Path:
    """Two runs in one page: the run itself, and a copy of it under another name."""
    copy = Run(json.loads(json.dumps(made.run.summary)), made.run.frames, made.out)
    copy.summary["scene"]["name"] = "second"
    runs = [ReportRun(run.summary, run.frames, made.out) for run in (made.run, copy)]
    return write_html_report(runs, tmp_path_factory.mktemp("both") / "both.html")


def test_two_runs_as_wipe_side_by_side_and_flicker(browser, made, both):
    for page in opened(browser, both):
        ready(page)
        tags = page.locator(".tag:visible")
        page.locator("[data-mode=runs]").click()
        page.wait_for_selector(".tag.left:visible")
        assert tags.first.inner_text().startswith("second, frame")
        page.locator("[data-layout=side]").click()
        stages = page.locator(".stage:visible")
        assert stages.count() == 2 and len(tags.all_inner_texts()) == 2
        one, two = stage_box(page), stages.nth(1).bounding_box()
        assert one["x"] + one["width"] <= two["x"]
        # Both show the same part and mark the same pixel.
        page.get_by_role("button", name="Zoom in").click()
        views = page.evaluate("[...document.querySelectorAll('.stage .view')].map(v => v.style.transform)")
        assert views[0] == views[1] != ""
        page.mouse.move(one["x"] + 30, one["y"] + 30)
        assert page.locator(".cross:visible").count() == 2
        page.locator("[data-layout=flicker]").click()
        for name in ("second", made.run.summary["scene"]["name"]):
            page.wait_for_function("(n) => document.querySelector('.tag.left').textContent.includes(n)", arg=name)


# ---- lost and damaged parts


@pytest.fixture
def copied(made, tmp_path) -> Path:
    shutil.copytree(made.out, tmp_path / "run")
    return tmp_path / "run"


def written(made, folder: Path) -> Path:
    return write_html_report([ReportRun(made.run.summary, made.run.frames, folder)], folder / "report.html")


def without_sums(images) -> None:
    """As earlier versions wrote the index, so that only the page can notice damage."""
    index = images / "index.json"
    index.write_text(json.dumps({k: v for k, v in json.loads(index.read_text()).items() if k != "files"}))


def test_swapped_planes_are_noticed_and_masks_stay_as_recorded(browser, made, copied):
    images = copied / "images"
    without_sums(images)
    frames = sorted(images.glob("planes_*.webp"))
    data = [file.read_bytes() for file in frames]
    for file, other in zip(frames, data[1:] + data[:1], strict=True):
        file.write_bytes(other)
    for page in opened(browser, written(made, copied)):
        ready(page)
        assert page.locator("#viewer .missing").is_visible()
        set_threshold(page, made, "position", LOWER["position"])
        repainted(page)
        frame = int(page.locator(".stage").first.get_attribute("data-frame"))
        row = next(row for row in made.run.frames if row["frame"] == frame)
        assert frame_counts(page)["position"] == row["position"]


@pytest.mark.parametrize("name", ["planes", LEVELS])
@pytest.mark.parametrize("damage", [pytest.param("missing", marks=pytest.mark.long), "broken"])
def test_lost_or_broken_files_leave_a_line_and_a_page_that_works(browser, made, copied, name, damage):
    for file in (copied / "images").glob("planes_*.webp" if name == "planes" else name):
        if damage == "missing":
            file.unlink()
        else:
            file.write_bytes(b"broken")
    without_sums(copied / "images")
    for page in opened(browser, written(made, copied)):
        if (name, damage) == ("planes", "broken"):  # only the browser decodes images
            ready(page)
            assert page.locator("#viewer .missing").is_visible()
        else:
            assert page.locator("#curves .note").is_visible()
        assert (mask_pixels(page)[..., 3] > 0).any()
        handle = page.locator(".handle[data-feature=color]")
        handle.focus()
        before = page.locator("[data-live=color]").get_attribute("data-threshold")
        page.keyboard.press("PageUp")
        assert float(page.locator("[data-live=color]").get_attribute("data-threshold")) > float(before)


@pytest.mark.parametrize("name", ["planes_*.webp", LEVELS])
def test_damaged_distances_are_noticed_by_their_sums(copied, name):
    """The images stay, without distances, and the reason names the file."""
    file = next((copied / "images").glob(name))
    file.write_bytes(file.read_bytes()[:-7])
    stored, _ = stored_frames(copied)
    assert stored.planes is None and file.name in stored.no_planes and stored.lost == "" and stored.index.frames


def test_distances_of_another_run_are_not_used_and_a_plain_report_says_how_to_get_them(made, copied):
    rows = [dict(row) for row in made.run.frames]
    rows[0]["position"] += 1
    reasons = set()
    for _ in range(2):
        images = report_data([ReportRun(made.run.summary, rows, copied)], ["run"])["runs"][0]["images"]
        assert images["planes"] is None and "--report-full" in images["no_planes"]
        reasons.add(images["no_planes"])
        index = copied / "images" / "index.json"
        index.write_text(json.dumps({k: v for k, v in json.loads(index.read_text()).items() if k != "planes"}))
    assert len(reasons) == 2


def test_options_that_a_full_report_cannot_serve(tmp_path):
    for options in ({"report": "whole"}, {"report": "full", "samples_per_pixel": 4}):
        with pytest.raises(SettingsError):
            evaluate(busy_room(), out=tmp_path / "out", **options, **SETTINGS)
    with pytest.raises(SettingsError):
        evaluate(busy_room(), report="full", **SETTINGS)


# ---- screens, keyboard, screen reader


@pytest.fixture(scope="module")
def phone(browser, both) -> Iterator[Any]:
    for page in opened(browser, both, viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True):
        ready(page)
        yield page


def check_layout(page: Any, width: int) -> None:
    """Two runs side by side: nothing is wider than the window, and no slider covers another."""
    page.locator("[data-mode=runs]").click()
    page.locator("[data-layout=side]").click()
    page.wait_for_selector(".stage:visible >> nth=1")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    boxes = [hit.bounding_box() for hit in page.locator(".handle .hit").all()]
    assert len(boxes) == len(FEATURES) + 1
    for a, b in itertools.combinations(boxes, 2):
        apart = a["y"] + a["height"] <= b["y"] + 1 or b["y"] + b["height"] <= a["y"] + 1
        assert apart, (width, a, b)
    assert min(box["height"] for box in boxes) >= 24


def test_nothing_overflows_and_no_sliders_overlap_on_a_phone(phone):
    check_layout(phone, 390)


def test_nothing_overflows_and_no_sliders_overlap_on_screens(browser, both):
    for page in opened(browser, both):
        ready(page)
        for size in ((1280, 720), (1920, 1080)):
            page.set_viewport_size(dict(zip(("width", "height"), size)))
            check_layout(page, size[0])


def test_bars_of_reasons_fit_on_a_phone(page, made):
    names = {term.label for term in TERMS.values()}
    spans = """box => [...box.querySelectorAll('.bars th, .bars td, .bars i')].map(e => {
        const here = e.getBoundingClientRect(), all = box.getBoundingClientRect();
        return [e.textContent.trim(), here.left - all.left, here.right - all.left, all.width] })"""
    usual = page.viewport_size
    page.set_viewport_size({"width": 360, "height": 844})
    box = page.locator(".headline")
    for moved in (False, True):
        if moved:
            for name, edge in LOWER.items():
                set_threshold(page, made, name, edge)
            counted(page)
        shown = box.evaluate(spans)
        assert sum(text in names for text, *_ in shown) > 3
        assert all(left >= -1 and right <= room + 1 for _, left, right, room in shown)
    page.set_viewport_size(usual)
    reset(page)


def test_definitions_open_by_touch(phone):
    row = phone.locator(".reason", has=phone.locator("[data-reason=disoccluded]"))
    checked = row.locator("input").is_checked()
    row.locator(".tip").tap()
    tip = phone.locator("#tip")
    assert "The surface was hidden" in tip.inner_text()
    box = tip.bounding_box()
    assert box["x"] >= 0 and box["x"] + box["width"] <= 390
    assert row.locator("input").is_checked() == checked
    phone.keyboard.press("Escape")
    assert not tip.is_visible()
    phone.locator("dl.figure .tip").first.tap()
    assert tip.is_visible()


def test_keys_alone_reach_a_threshold_and_are_answered(page):
    page.reload()
    ready(page)
    for _ in range(60):
        page.keyboard.press("Tab")
        outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert outline != "none", page.evaluate("document.activeElement.outerHTML.slice(0, 90)")
        if page.evaluate("document.activeElement.dataset.limit") == "position":
            break
    page.keyboard.press("End")
    assert "m:" in page.evaluate("document.activeElement.getAttribute('aria-valuetext')")
    assert counted(page)["bars"]
    assert page.locator(".answer").get_by_role("status").inner_text().startswith("At these thresholds")
    assert page.locator(".sentence").get_attribute("aria-live") == "polite"


def test_accessibility_tree_names_every_control(page):
    tree = page.locator("main").aria_snapshot()
    for feature in FEATURES:
        assert f'slider "threshold of {feature}"' in tree
    parts = ('group "Image: arrow keys', 'group "Pixel probe"', 'button "Zoom in"', 'slider "Frame"')
    parts += ('slider "threshold of all features"', 'slider "Mask opacity"', 'button "What is disoccluded?"')
    assert [part for part in parts if part not in tree] == []
    assert "slider:" not in tree and "- button\n" not in tree
    assert not re.search(r"- (table|columnheader|img|region)(:|\n)", tree)
    values = "[...document.querySelectorAll('[data-limit], .handle')].map(e => e.getAttribute('aria-valuetext'))"
    assert all(re.search(r"\d", value or "") for value in page.evaluate(values))
    controls = "[...document.querySelectorAll('.viewer .stage:not([hidden]), .viewer button, .viewer input')]"
    assert set(page.evaluate(f"{controls}.map(e => e.tabIndex)")) == {0}  # in the order of the document
