"""Live settings, comparison with history and other images, and scaled arrows."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from references.display import channel_rgb, color_scale
from viewer_tools import QUIET, evaluated

from taubench_gl.animation import View
from taubench_gl.scene.model import Camera
from taubench_gl.viewer.comparisons import frame_offset
from taubench_gl.viewer.feeds import Shot

pytestmark = pytest.mark.usefixtures("coarse_light")

LIT = fixed_settings(width=48, height=27, columns=("direct", "color", "position"), indirect="none", exposure=1.0)


def headlight(driven, *, previous: bool = False) -> np.ndarray:
    source = driven.engine.feed.source
    position = source.read("position", previous=previous)
    return channel_rgb("headlight", source.read("normal", previous=previous), 0.0, 1.0, position=position)


def test_reprojection_sampling_and_size_change_live(drive):
    driven = drive()
    driven.run("frame 8\nset probe 30,20\nset reprojection motion\nset sampling bilinear\nset scale 0.5")
    expected = QUIET.replace(reprojection="motion", sampling="bilinear", width=48, height=27)
    assert driven.counts_are_those_of(evaluated(8, expected))
    driven.run("expect image.width == 48\nexpect probe == 15,10\nset scale 1\nset reprojection camera")
    driven.run("set sampling nearest\nexpect image.width == 96\nexpect probe == 30,20")
    assert driven.counts_are_those_of(evaluated(8))


def test_exposure_changes_the_color_and_its_masks(drive):
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset channel headlight\nset overlays off\nset channel color")
    dark = driven.engine.feed.source.read("color")[..., :3]
    driven.run("set stops 1\nexpect stops == 1")
    bright = driven.engine.feed.source.read("color")[..., :3]
    assert (bright >= dark - 1e-3).all() and bright.mean() > 1.1 * dark.mean()
    assert driven.counts_are_those_of(evaluated(8, LIT.replace(exposure=2.0)), "direct", "color")


@pytest.mark.long
def test_the_light_method_changes_live(drive):
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset channel direct")
    raster = driven.engine.feed.source.read("direct")[..., :3]
    driven.run("set light path-traced\nexpect light == path-traced")
    traced = driven.engine.feed.source.read("direct")[..., :3]
    assert driven.engine.feed.effects["path_traced"].enabled and (raster != traced).any()
    assert traced.mean() == pytest.approx(raster.mean(), rel=0.2)


def test_a_light_method_that_fails_changes_nothing(drive, monkeypatch):
    from taubench_gl.errors import GraphicsError

    driven = drive()
    driven.run("frame 8")
    counts = dict(driven.engine.counts)

    def fail(*_: object, **__: object) -> None:
        raise GraphicsError("no memory for this")

    monkeypatch.setattr("taubench_gl.evaluation.owner.RasterSource", fail)
    driven.run("set reprojection motion\nexpect reprojection == camera")
    assert "no memory for this" in driven.state.message and driven.engine.counts == counts


def test_history_and_reprojected_history(drive):
    driven = drive()
    driven.run(
        "frame 8\nset channel headlight\nset overlays off\nset comparison split\nset split 0\nset against history"
    )
    before = headlight(driven, previous=True)
    assert np.abs(driven.engine.image()[:, 2:] / 255.0 - before[:, 2:]).max() < 2 / 255
    assert driven.engine.titles(driven.state) == ("this image", "history")
    driven.run("set against reprojected")
    now, moved = headlight(driven), driven.engine.image()[:, 2:] / 255.0
    good = (driven.engine.mask() & np.uint32(0x7FFF & ~0x18) == 0)[:, 2:]  # sky bits aside
    assert np.abs(moved - now[:, 2:])[good].mean() < 0.5 * np.abs(before - now)[:, 2:][good].mean()
    driven.run("set channel motion")
    assert "motion" in driven.state.message, "the previous frame has none to compare with"


def test_flicker_shows_one_image_then_the_other(drive):
    driven = drive()
    driven.run("frame 8\nset channel headlight\nset overlays off\nset against history\nset flicker_hz 12")
    now, before = headlight(driven), headlight(driven, previous=True)
    driven.run("set comparison flicker")
    seen = []
    for _ in range(6):
        image = driven.engine.image() / 255.0
        seen.append(np.abs(image - now).max() < 2 / 255)
        assert seen[-1] or np.abs(image - before).max() < 2 / 255
        driven.run("wait 1")
    assert 1 < sum(seen) < 6


def test_the_error_map_is_scaled_by_the_gain(drive):
    driven = drive()
    driven.run(
        "frame 8\nset channel headlight\nset overlays off\nset against history\nset comparison error\nset gain 2"
    )
    difference = np.abs(headlight(driven) - headlight(driven, previous=True)).max(axis=-1)
    assert np.abs(driven.engine.image() / 255.0 - color_scale(2.0 * difference)).max() < 0.03


def test_arrows_are_scaled(drive):
    driven = drive()
    driven.run("frame 8\nset channel headlight\nset overlays off\nset arrows on\nset arrow_scale 1")
    short = driven.engine.image().copy()
    driven.run("set arrow_scale 6")
    assert driven.engine.arrow_scale == 6 and (driven.engine.image() != short).any()
    driven.run("set arrow_scale 0")
    assert driven.engine.arrow_scale > 0


@pytest.mark.parametrize(("per_point", "length"), [(1.0, 50.0), (0.1, 5.0), (1 / 59, 1.0), (0.004, 0.2), (3.5, 200.0)])
def test_the_legend_has_a_round_length(per_point, length):
    pytest.importorskip("imgui_bundle")
    from taubench_gl.viewer.image_marks import legend_length

    assert legend_length(per_point) == pytest.approx(length)


def test_passes_are_timed(drive):
    driven = drive(window=(1280, 720))
    driven.run("frame 8\nset section.time on\nframe 9\nframe 10\nwait 1")
    assert {"gbuffer", "masks", "image"} <= set(driven.viewer.timer.ms)
    assert "time.masks" in driven.viewer.panels.widgets


class Moving:
    """A feed whose camera moves by ``step`` a frame; frame ``start`` is where it begins."""

    def __init__(self, frames, start, step):
        self.frames, self._start, self._step = frames, start, step
        self.size, self.radius = (4, 2), 10.0

    def file_shot(self, frame):
        position = np.array([self._step * (frame - self._start), 0.0, 0.0])
        return Shot(frame, View(position, np.eye(3), Camera()))


@pytest.mark.parametrize(
    ("first", "start", "step", "offset"),
    [(1, 1, 0.1, 1), (1, 0, 0.1, 0), (1, 0, 0.0, 0), (0, 0, 0.1, 0), (5, 0, 0.1, 0)],
)
def test_frames_of_a_reference_are_matched_by_its_camera(first, start, step, offset):
    """Renderers count from 0 or from 1; glTF files of Blender begin with its frame 0, its renders with frame 1."""
    assert frame_offset(Moving(range(first, 6), start, step), Moving(range(8), 0, step)) == offset
