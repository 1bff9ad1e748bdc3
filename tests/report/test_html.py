"""The report as text: complete, escaped, self-contained; and the pictures it is made from."""

from __future__ import annotations

import base64
import io
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from taubench_gl.conventions import Reason
from taubench_gl.errors import OutputError
from taubench_gl.report import frame_store
from taubench_gl.report.frame_store import FrameRecorder, reproject_image, spread, stored_frames
from taubench_gl.report.plots import discard_curve
from taubench_gl.report.run_page import ReportRun, report_html, write_html_report

EVIL = """</script><script>alert("x")</script>'"&<!--${title}$"""


def data_of(page: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])


class _Tags(HTMLParser):
    def __init__(self, page: str):
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))


def test_page_is_self_contained(run):
    page = report_html([ReportRun(run.summary, run.frames)])
    tags = _Tags(page).tags
    assert [t for t, _ in tags].count("script") == 2
    assert "link" not in {t for t, _ in tags}
    addresses = [v for _, a in tags for k, v in a.items() if k in ("src", "href") and v]
    assert all(v.startswith(("#", "data:")) for v in addresses)
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", page)
    assert any(t == "meta" and "default-src 'none'" in a.get("content", "") for t, a in tags)


def test_names_cannot_end_a_script_or_open_a_tag(summary, frames):
    summary["scene"]["name"] = EVIL
    summary["notes"] = [EVIL]
    summary["discard"]["indirect"]["reason"] = EVIL
    summary["effects"] = {EVIL: {"on": True, "reason": EVIL}}
    summary["provenance"] = {"command": EVIL}
    page = report_html([ReportRun(summary, frames)])
    tags = _Tags(page).tags
    assert [t for t, _ in tags].count("script") == 2
    assert data_of(page)["runs"][0]["label"] == EVIL
    assert data_of(page)["runs"][0]["discard"]["indirect"]["reason"] == EVIL


def test_what_was_not_measured_is_a_dash_with_its_reason(summary, frames):
    page = report_html([ReportRun(summary, frames)])
    tile = re.search(r'<dl class="figure none".*?</dl>', page, re.S)[0]
    assert "indirect" in tile and "–" in tile and "no indirect light here" in tile
    data = data_of(page)["runs"][0]
    assert "indirect" not in data["measured"] and data["curves"]["indirect"] is None
    assert data["rows"]["indirect"] == [None] * len(frames)


def test_curves_are_the_recorded_ones(summary, frames):
    data = data_of(report_html([ReportRun(summary, frames)]))["runs"][0]
    pixels = data["pixels"]
    assert pixels == data["pairs"] * data["width"] * data["height"]
    for name in ("color", "position", "normal", "direct"):
        edges, percents = discard_curve(summary["curves"][name], pixels)
        assert data["curves"][name]["edges"] == edges.tolist()
        assert 100.0 * np.array(data["curves"][name]["above"]) / pixels == pytest.approx(percents)


def test_percentages_are_of_all_samples_of_a_pixel(summary, frames):
    for row in frames:
        row["pixels"] *= 4
    data = data_of(report_html([ReportRun(summary, frames)]))["runs"][0]
    assert data["pixels"] == 4 * data["pairs"] * data["width"] * data["height"]


def test_several_runs_stand_side_by_side(summary, frames):
    page = report_html([ReportRun(summary, frames), ReportRun(summary, frames)])
    labels = [r["label"] for r in data_of(page)["runs"]]
    assert len(set(labels)) == 2
    assert page.count('class="figures"') == 2
    assert page.count('<section class="run">') == 2


def test_without_pictures_it_says_why(run, tmp_path):
    run.save(tmp_path)
    data = data_of(report_html([ReportRun(run.summary, run.frames, tmp_path)]))["runs"][0]
    assert data["images"] is None
    assert data["no_images"]


def test_nothing_half_written(run, tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        write_html_report([ReportRun(run.summary, run.frames)], tmp_path / "none" / "report.html")
    assert list(tmp_path.iterdir()) == []


# pictures

RNG = np.random.default_rng(3)
MASK = RNG.integers(0, 1 << 16, (12, 20)).astype(np.uint32)
PICTURE = RNG.random((12, 20, 3))
STILL = np.zeros((12, 20, 2), np.float32)


def keep(folder, count: int, discarded=lambda i: 0, mask=MASK, picture=PICTURE):
    folder.mkdir(exist_ok=True)
    (folder / "frames.csv").write_text("frame\n1\n")
    keeper = FrameRecorder(folder)
    for i in range(count):
        motion = np.zeros((*mask.shape, 2), np.float32)
        keeper.add(i + 1, discarded(i), picture, picture, mask, motion)
    keeper.finish(folder / "frames.csv")
    return stored_frames(folder)


def unpacked(uri: str) -> np.ndarray:
    image = np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))))
    return image[..., 0].astype(np.uint32) | image[..., 1].astype(np.uint32) << 8


def test_every_reason_survives_the_way_into_a_picture(tmp_path):
    stored, why = keep(tmp_path / "run", 3)
    assert why == "" and stored.frames == (1, 2, 3)
    assert (unpacked(stored.uri("mask", 2)) == MASK).all()


def test_few_evenly_spaced_pictures_and_the_worst(tmp_path, monkeypatch):
    monkeypatch.setattr(frame_store, "MAX_KEPT", 8)
    stored, _ = keep(tmp_path / "run", 61, discarded=lambda i: 100 if i == 37 else i)
    grid = [f for f in stored.frames if (f - 1) % 8 == 0]
    assert grid == list(range(1, 62, 8))
    assert set(stored.frames) - set(grid) == {38} and stored.worst == 38
    files = {p.name for p in stored.folder.iterdir()}
    assert files == {"index.json"} | {
        frame_store.file_name(p, f) for f in stored.frames for p in ("frame", "previous", "mask")
    }


def test_large_frames_are_made_smaller(tmp_path, monkeypatch):
    monkeypatch.setattr(frame_store, "MAX_WIDTH", 8)
    flat = np.full((12, 20, 3), 0.5)
    stored, _ = keep(tmp_path / "run", 1, picture=flat)
    assert (stored.width, stored.height, stored.step) == (7, 4, 3)
    assert (unpacked(stored.uri("mask", 1)) == MASK[1::3, 1::3]).all()
    with Image.open(stored.folder / "frame_00001.webp") as image:
        assert image.size == (7, 4) and abs(int(np.asarray(image).mean()) - 128) < 3


def test_an_earlier_runs_pictures_give_way_and_nothing_else(tmp_path):
    keep(tmp_path / "run", 5)
    (tmp_path / "run" / frame_store.FOLDER / "mine.png").write_bytes(b"kept")
    FrameRecorder(tmp_path / "run")
    assert stored_frames(tmp_path / "run")[0].frames == (1, 2, 3, 4, 5)  # untouched until there is a first pair
    stored, _ = keep(tmp_path / "run", 2)
    assert stored.frames == (1, 2)
    assert len(list(stored.folder.iterdir())) == 1 + 2 * 3 + 1


def test_pictures_of_another_run_are_not_shown(tmp_path):
    keep(tmp_path / "run", 2)
    (tmp_path / "run" / "frames.csv").write_text("frame\n1\n2\n")
    assert stored_frames(tmp_path / "run")[0] is None


def test_a_missing_or_broken_picture_is_said(tmp_path):
    stored, _ = keep(tmp_path / "run", 2)
    (stored.folder / "mask_00002.png").unlink()
    found, why = stored_frames(tmp_path / "run")
    assert found is None and "mask_00002.png" in why
    (stored.folder / "index.json").write_text("{")
    found, why = stored_frames(tmp_path / "run")
    assert found is None and "index.json" in why


def test_reprojected_picture_follows_motion_and_hatches_the_rest():
    mask = np.zeros((12, 20), np.uint32)
    mask[:, -3:] = int(Reason.OUTSIDE)
    motion = STILL.copy()
    motion[..., 0] = 3.0
    moved = reproject_image(PICTURE, mask, motion)
    assert (moved[:, :-3] == PICTURE[:, 3:]).all()
    assert set(np.unique(moved[:, -3:])) == {0.58, 0.82}


def test_spread_keeps_both_ends_and_the_one_always_wanted():
    assert spread(tuple(range(100)), 5, None) == [0, 25, 50, 74, 99]
    assert spread(tuple(range(100)), 4, 37) == [0, 37, 50, 99]
    assert spread((1, 2), 5, 2) == [1, 2]


def test_pictures_are_cut_to_the_budget(tmp_path, run, monkeypatch):
    from taubench_gl.report import run_page

    run.save(tmp_path)
    keeper = FrameRecorder(tmp_path)
    for i in range(12):
        keeper.add(i + 1, 1 if i == 4 else 0, PICTURE, PICTURE, MASK, STILL)
    keeper.finish(tmp_path / "frames.csv")
    monkeypatch.setattr(run_page, "MAX_IMAGE_BYTES", 12_000)
    page = report_html([ReportRun(run.summary, run.frames, tmp_path)])
    shown = data_of(page)["runs"][0]["images"]
    assert 2 <= len(shown["items"]) < 12
    assert sum(len(v) for i in shown["items"] for v in i.values() if isinstance(v, str)) <= 12_000
    assert 5 in [i["n"] for i in shown["items"]]
