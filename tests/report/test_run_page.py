"""The HTML report as text: complete, escaped, self-contained."""

from __future__ import annotations

import re

import numpy as np
import pytest
from page_tools import Tags, data_of

from taubench_gl.errors import OutputError
from taubench_gl.features import MASK_WORDS
from taubench_gl.report.run_frames import FrameRecorder
from taubench_gl.report.run_page import ReportRun, report_html, write_html_report
from taubench_gl.report.run_plots import discard_curve

EVIL = """</script><script>alert("x")</script>'"&<!--${title}$"""


def test_page_is_self_contained_and_its_names_are_escaped(summary, frames):
    summary["scene"]["name"] = EVIL
    summary["notes"] = [EVIL]
    summary["discard"]["indirect"]["reason"] = EVIL
    summary["effects"] = {EVIL: {"on": True, "reason": EVIL}}
    summary["provenance"] = {"command": EVIL}
    page = report_html([ReportRun(summary, frames)])
    tags = Tags(page)
    assert tags.names.count("script") == 2 and "link" not in tags.names and "default-src 'none'" in tags.policy()
    assert all(v.startswith(("#", "data:")) for v in tags.addresses) and tags.open == []
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", page)
    (values,) = data_of(page)["runs"]
    assert values["label"] == values["discard"]["indirect"]["reason"] == EVIL


def test_unmeasured_column_is_a_dash_with_its_reason(summary, frames):
    page = report_html([ReportRun(summary, frames)])
    tile = re.search(r'<dl class="figure none".*?</dl>', page, re.S)[0]
    assert "indirect" in tile and "–" in tile and "no indirect light here" in tile
    data = data_of(page)["runs"][0]
    assert "indirect" not in data["measured"] and data["curves"]["indirect"] is None
    assert data["rows"]["indirect"] == [None] * len(frames)


def test_curves_equal_those_of_the_plots(summary, frames):
    for row in frames:
        row["pixels"] *= 4  # samples
    data = data_of(report_html([ReportRun(summary, frames)]))["runs"][0]
    pixels = data["pixels"]
    assert pixels == 4 * data["pairs"] * data["width"] * data["height"]
    for name in ("color", "position", "normal", "direct"):
        edges, percents = discard_curve(summary["curves"][name], pixels)
        assert data["curves"][name]["edges"] == edges.tolist()
        assert 100.0 * np.array(data["curves"][name]["above"]) / pixels == pytest.approx(percents)


def test_run_without_images_has_a_reason(run, tmp_path):
    run.save(tmp_path)
    data = data_of(report_html([ReportRun(run.summary, run.frames, tmp_path)]))["runs"][0]
    assert data["images"] is None and data["no_images"]
    without = data_of(report_html([ReportRun(run.summary | {"pairs": 0}, [])]))["runs"][0]
    assert without["images"] is None and without["no_images"] and "--report" not in without["no_images"]


def test_failed_write_leaves_no_file(run, tmp_path):
    with pytest.raises(OutputError):
        write_html_report([ReportRun(run.summary, run.frames)], tmp_path / "none" / "report.html")
    assert list(tmp_path.iterdir()) == []


RNG = np.random.default_rng(3)
MASK = RNG.integers(0, MASK_WORDS, (12, 20)).astype(np.uint32)
IMAGE = RNG.random((12, 20, 3))
MOTION = np.zeros((12, 20, 2), np.float32)


def test_number_of_images_is_limited_by_their_bytes(tmp_path, run, monkeypatch):
    from taubench_gl.report import run_page

    run.save(tmp_path)
    recorder = FrameRecorder(tmp_path)
    for i in range(12):
        recorder.add(i + 1, 1 if i == 4 else 0, IMAGE, IMAGE, MASK, MOTION)
    recorder.finish(tmp_path / "frames.csv")
    monkeypatch.setattr(run_page, "MAX_IMAGE_BYTES", 12_000)
    page = report_html([ReportRun(run.summary, run.frames, tmp_path)])
    shown = data_of(page)["runs"][0]["images"]
    assert 2 <= len(shown["items"]) < 12
    assert sum(len(v) for i in shown["items"] for v in i.values() if isinstance(v, str)) <= 12_000
    assert 5 in [i["n"] for i in shown["items"]]


def test_each_of_several_runs_has_the_reusable_pixels_first_then_figures_and_details(summary, frames):
    page = report_html([ReportRun(summary, frames), ReportRun(summary, frames)])
    assert len({run["label"] for run in data_of(page)["runs"]}) == 2
    assert page.count('class="figures"') == page.count('<section class="run">') == 2
    assert page.index("75.0 % of surface pixels") < page.index('id="figures"')
    assert page.count('class="headline"') == 2 and page.count('"big mode">camera<') == 2
    assert page.count('20.00<small> %</small></dd><dd class="small">of all pixels') == 2
    names = [a["id"] for _, a in Tags(page).tags if a.get("id")]
    assert len(set(names)) == len(names)
    del summary["reusable"], summary["mask_histogram"]
    assert "not recorded" in report_html([ReportRun(summary, frames)])
