"""``taubench-gl share``: every recorded pair on one page below 5 MB, which plays at once."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from page_tools import data_of, image_of, opened

from taubench_gl.conventions import Reason
from taubench_gl.report import run_page
from taubench_gl.report.frame_store import FOLDER
from taubench_gl.report.run_frames import FrameRecorder

pytestmark = pytest.mark.usefixtures("fixed_light")

SIZE = (64, 36)
WORDS = np.uint32([0, int(Reason.POSITION), int(Reason.NORMAL), int(Reason.POSITION | Reason.NORMAL)])


@pytest.fixture
def recorded(run, tmp_path) -> Path:
    """The folder of a stored run with images: frames of noise, masks of four blocks."""
    folder = tmp_path / "run"
    run.save(folder)
    rng = np.random.default_rng(1)
    recorder = FrameRecorder(folder)
    mask = np.repeat(np.repeat(WORDS.reshape(2, 2), SIZE[1] // 2, axis=0), SIZE[0] // 2, axis=1)
    for row in run.frames:
        image = rng.random((*SIZE[::-1], 3))
        recorder.add(row["frame"], 1, image, image, mask, np.zeros((*SIZE[::-1], 2)))
    recorder.finish(folder / "frames.csv")
    return folder


def images_of(page: Path) -> dict:
    data = data_of(page.read_text())
    assert data["play"]
    return data["runs"][0]["images"]


@pytest.mark.parametrize("step", [1, 2, 3])
def test_all_pairs_in_the_bytes_that_a_page_may_have(recorded, run, monkeypatch, step, taubench):
    """Frames of noise take as many bytes as pixels do: a quarter of the budget keeps every second row and column."""
    assert taubench("share", recorded)[0] == 0
    page = recorded / "share.html"
    whole = images_of(page)
    size = sum(len(item["frame"]) + len(item["mask"]) for item in whole["items"])
    monkeypatch.setattr(run_page, "SHARED_IMAGE_BYTES", int(1.2 * size / step**2) if step > 1 else size)
    assert taubench("share", recorded)[0] == 0
    images = images_of(page)
    assert [item["n"] for item in images["items"]] == [row["frame"] for row in run.frames]
    assert sum(len(item["frame"]) + len(item["mask"]) for item in images["items"]) <= run_page.SHARED_IMAGE_BYTES
    assert images["step"] == step if step < 3 else images["step"] >= 2
    for item in images["items"]:
        mask = image_of(item["mask"]).astype(int)
        assert image_of(item["frame"]).shape[:2] == mask.shape[:2] == (images["height"], images["width"])
        corners = mask[:: mask.shape[0] - 1, :: mask.shape[1] - 1]
        assert ((corners @ [1, 256, 65536]) == WORDS.reshape(2, 2)).all()
    assert page.stat().st_size < 5_000_000


@pytest.mark.parametrize("motion", ["no-preference", "reduce"])
def test_the_page_plays_masks_and_has_no_button_for_what_it_leaves_out(recorded, browser, motion, taubench):
    """The page stands still where the reader's system asks for less motion."""
    assert taubench("share", recorded)[0] == 0
    with contextlib.contextmanager(opened)(browser, recorded / "share.html", reduced_motion=motion) as page:
        if motion == "reduce":
            assert page.locator(".bar button").get_attribute("aria-label") == "Play"
        else:
            first = page.locator(".stage").first.get_attribute("data-frame")
            page.wait_for_selector(f".stage[data-frame]:not([data-frame='{first}'])")
        assert page.locator("[data-mode=history]").count() == 0
        assert page.locator("[data-mode=masks]").count() == 1


@pytest.mark.long
def test_both_browsers_open_a_shared_run(recorded, both_browsers, taubench):
    assert taubench("share", recorded)[0] == 0
    both_browsers(recorded / "share.html", ".stage[data-frame]")


@pytest.mark.parametrize("lost", ["images", "all"])
def test_a_run_without_images_is_refused(recorded, tmp_path, lost, taubench):
    if lost == "images":
        (recorded / FOLDER / "index.json").unlink()
    code, _, err = taubench("share", recorded if lost == "images" else tmp_path / "none")
    assert code == 2 and err.count("\n") == 1 and not list(tmp_path.rglob("share.html"))


@pytest.mark.parametrize("made", ["report", "share"])
def test_a_truncated_image_is_left_out_with_a_note(recorded, made, taubench):
    """The page has the other pairs; standard error and the page name the file."""
    image = recorded / FOLDER / "frame_00001.webp"
    image.write_bytes(image.read_bytes()[:100])
    code, _, err = taubench(made, recorded)
    assert code == 0 and image.name in err
    images = data_of((recorded / f"{made}.html").read_text())["runs"][0]["images"]
    assert 1 not in [item["n"] for item in images["items"]] and images["items"] and image.name in images["summary"]


@pytest.mark.parametrize("made", ["report", "share"])
def test_a_damaged_index_of_images_is_a_note(recorded, made, taubench):
    """The pages have the images that are there."""
    assert taubench(made, recorded)[0] == 0
    before = data_of((recorded / f"{made}.html").read_text())["runs"][0]["images"]
    (recorded / FOLDER / "index.json").write_text("{")
    code, _, err = taubench(made, recorded)
    assert code == 0 and "index.json" in err
    images = data_of((recorded / f"{made}.html").read_text())["runs"][0]["images"]
    assert images["items"] == before["items"] and "index.json" in images["summary"]
