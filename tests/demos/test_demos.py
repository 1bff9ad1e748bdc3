"""Each demo at a small size: numbers against theory, figures, page, colors in CIELAB."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from page_tools import Tags
from repeated import few

from taubench_gl.demos.gallery import index_page
from taubench_gl.demos.lessons import DEMOS, find_demo, sampling
from taubench_gl.demos.stage import Stage
from taubench_gl.errors import SettingsError
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.report.palette import color_of
from taubench_gl.scene import load_scene
from taubench_gl.selftest.bench import limits

pytestmark = pytest.mark.usefixtures("coarse_light")

DOCS = Path(__file__).resolve().parents[2] / "docs"
CLEAR = 25.0
"""Least distance (CIE 1976) of a mask's color; about 2.3 is just visible."""


def test_numbers_agree_with_theory(demo, runs, gpu):
    """The theoretical range holds the number, and could fail: not 0, 100 % and twice the number too."""
    for finding in runs.of(demo, gpu).findings:
        assert finding.as_expected, f"{finding.text} {finding.about.meaning}: expected {finding.expected.text}"
        assert finding.about.source and finding.about.meaning
        assert not all(map(finding.expected.met_by, (0.0, 100.0, 2.0 * finding.number + 1.0))), finding.about.meaning


def test_parameters_agree_with_theory_at_every_value(demo, runs, gpu):
    """Numbers of the parameter's other end, or none at all, do not, and the image follows the value."""
    parameter = runs.of(demo, gpu).parameter
    count = len(parameter.values)
    assert 3 <= count <= 64 and 0 <= parameter.start < count
    assert all(parameter.as_expected), list(zip(parameter.values, parameter.measured, parameter.expected))
    for wrong in (parameter.measured[::-1], tuple(2.0 * m + 1.0 for m in parameter.measured)):
        assert not all(dataclasses.replace(parameter, measured=wrong).as_expected)
    images = [parameter.picture(i) for i in range(count)]
    assert {image.shape for image in images} == {images[0].shape} and len({i.tobytes() for i in images}) > 2


def test_pages_are_self_contained(demo, runs, gpu):
    page = runs.shown(demo, gpu).page.read_text(encoding="utf-8")
    tags = Tags(page)
    assert tags.addresses and all(link.startswith(("data:", "#")) for link in tags.addresses) and tags.open == []
    own = re.sub(r"data:[^'\"]*", "", page).replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?:|url\(|<script src|@import", own)
    for expected in (demo.text.title, demo.text.look_for[0], runs.of(demo, gpu).findings[0].text):
        assert " ".join(expected.split()) in " ".join(tags.text.split())


@pytest.mark.parametrize("count", few([6, len(DEMOS)]))
def test_index_links_every_page(runs, gpu, count):
    shown = [runs.shown(d, gpu) for d in list(DEMOS.values())[:count]]
    page = index_page(shown)
    assert re.findall(r'<a href="([^"]+)"', page) == [f"{s.demo.stem}.html" for s in shown]
    assert [s.demo.name for s in shown if s.result.findings[0].text in page] == []
    assert page.count('class="ok"') == len(shown)
    tags = Tags(page)
    assert tags.open == [] and all(re.match(r"data:|\d\d-[a-z]+\.html$", link) for link in tags.addresses)


def test_numbers_and_names_are_in_order():
    """The table of docs/demos.md lists the same demos."""
    every = list(DEMOS.values())
    assert [d.number for d in every] == list(range(1, len(every) + 1))
    for one in every:
        assert find_demo(one.name) is find_demo(str(one.number)) is one
        assert len(one.text.look_for) >= 2 and one.text.idea.count(".") >= 2
        assert all((DOCS / page).is_file() for _, page in one.text.see_also)
    table = re.findall(r"^\| (\d+) \| `(\w+)` \|", (DOCS / "demos.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert table == [(str(d.number), d.name) for d in every]


@pytest.mark.parametrize("text", ["xyz", "", "0", "99", "o-", "r", "rotatoins"])
def test_unknown_names_are_errors_and_unique_prefixes_are_not(text):
    with pytest.raises(SettingsError) as caught:
        find_demo(text)
    assert "rotations" in caught.value.hint and ("1 rotations" in caught.value.hint) == (text != "rotatoins")
    assert find_demo("occ").name == "occlusion"


@pytest.mark.parametrize("size", [(16, 9), (160, 89), (4000, 2000)])
def test_sizes_are_checked(gpu, size):
    with pytest.raises(SettingsError):
        Stage(gpu, size)


def test_scenes_can_be_written_and_read_again(demo, tmp_path):
    """The file of ``--scene`` plays like the scene itself."""
    from taubench_gl.animation import Poser, choose_camera
    from taubench_gl.datasets.gltf_from_scene import write_scene

    made, path = demo.scene(), tmp_path / "scene.glb"
    write_scene(made, path)
    read = load_scene(path)
    assert read.duration == pytest.approx(made.duration)
    for time in (0.0, 0.5 * made.duration, made.duration):
        views = [choose_camera(s).view_at(Poser(s).sample(time)) for s in (made, read)]
        assert np.abs(views[0].position - views[1].position).max() < 1e-5


def test_the_float64_reference_agrees_with_the_pass_of_demo_6(gpu):
    """Demo 6 colors its figures by the float64 reference: the same discards as on the GPU."""
    stage = Stage(gpu, (160, 90))
    for name in ("nearest", "bilinear"):
        pair = stage.bench.pair(sampling.scene(), camera=sampling.camera(), sampling=name)
        reference = pair_masks(pair.current, pair.history, pair.pair, limits(None), sampling=name)
        assert np.count_nonzero(reference.mask != pair.mask) <= 2
    stage.release()


def test_mask_colors_differ_from_the_objects(demo, runs, gpu):
    """In both frames of a lesson, by CLEAR of CIELAB, in all but 0.5 % of the pixels, which noise may color."""
    rgb2lab = pytest.importorskip("skimage.color").rgb2lab
    pair = runs.pair(demo, gpu)
    for frame in (pair.before, pair.now):
        objects = rgb2lab(np.clip(frame["color"][..., :3], 0.0, 1.0))
        for mask in demo.text.opening.reasons:
            close = np.linalg.norm(objects - rgb2lab(np.divide(color_of(mask), 255.0)), axis=-1) < CLEAR
            assert close.mean() <= 0.005, f"{demo.name}: {100 * close.mean():.1f} % look like {mask!r}"
