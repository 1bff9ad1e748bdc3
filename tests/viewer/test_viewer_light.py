"""Light of other qualities: coarse while the image moves, path-traced sample by sample while it is still."""

from __future__ import annotations

import numpy as np
import pytest
from viewer_tools import DEMO

from taubench_gl.evaluation import evaluate_scene
from taubench_gl.frame.targets import read_channel
from taubench_gl.settings import Settings
from taubench_gl.viewer.light import COARSE

LIT = Settings(width=48, height=28, indirect="none", exposure=1.0)


def test_geometry_is_exact_and_light_coarse_while_playing(drive):
    row = evaluate_scene(DEMO, LIT.replace(frames=(7, 9))).frames[0]
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset channel color\nexpect light.quality != ''")
    engine = driven.engine
    exact = {n: engine.counts[n] for n in ("frustum", "position", "normal", "direct", "color")}
    assert exact == {n: row[n] for n in exact}
    driven.run("set playing on")
    assert {n: engine.counts[n] for n in ("frustum", "position", "normal")} == {
        n: row[n] for n in ("frustum", "position", "normal")
    }
    coarse = COARSE["quarter"].settings(engine.feed.settings)
    assert (coarse.sequence.width, coarse.sequence.height) == (12, 7)
    small = evaluate_scene(DEMO, coarse.replace(frames=(7, 9))).frames[0]
    assert engine.counts["direct"] == 16 * small["direct"] and engine.counts["color"] == 16 * small["color"]
    assert engine.percentages()["indirect"] is None and engine.percentages()["reusable_shading"] is None
    driven.run("set playing off")
    assert {n: engine.counts[n] for n in exact} == exact


def test_coarse_light_is_shown_between_its_pixels(drive):
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset channel color\nset overlays off\nset moving_light unshadowed\nset playing on")
    engine = driven.engine
    small = read_channel(engine._lights.coarse.source.current["color"], "color")[..., :3]
    assert small.shape == (7, 12, 3)
    from scipy.ndimage import map_coordinates

    rows, columns = np.indices((28, 48))
    at = [(rows + 0.5) / 4 - 0.5, (columns + 0.5) / 4 - 0.5]
    expected = np.stack([map_coordinates(small[..., i], at, order=1, mode="nearest") for i in range(3)], axis=-1)
    assert np.abs(engine.image() / 255.0 - np.clip(expected, 0.0, 1.0)).max() < 2 / 255


def test_light_masks_are_shown_from_coarse_light(drive):
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset channel headlight\nset overlays off\nset playing on")
    bare = driven.engine.image().copy()
    for name in driven.state.shown:
        driven.state.shown[name] = name == "direct"
    driven.run("set overlays on\nset opacity 1")
    light = driven.engine._lights.coarse.mask
    bits = read_channel(light, "mask")[..., 0].repeat(4, axis=0).repeat(4, axis=1)
    from taubench_gl.conventions import NOT_COMPARABLE, Reason

    expected = (bits & int(Reason.DIRECT) != 0) & (driven.engine.mask() & int(NOT_COMPARABLE) == 0)
    changed = (driven.engine.image() != bare).any(axis=-1)
    assert expected.sum() > 20 and (changed == expected).mean() > 0.99


def test_the_probe_leaves_out_coarse_light(drive):
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset probe 20,14\nset probe_pinned on\nexpect probe.direct >= 0\nset playing on")
    assert set(driven.viewer.probe().features) == {"position", "normal"}
    driven.run("expect probe.direct == none\nexpect probe.material != none")


def test_light_is_exact_while_moving_if_asked(drive):
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset moving_light full")
    before = driven.engine.counts["direct"]
    driven.run("set playing on")
    assert driven.engine.counts["direct"] == before and driven.engine._lights.coarse is None


@pytest.mark.parametrize("channel", ["direct", "color"])
def test_a_still_image_is_path_traced_sample_by_sample(drive, channel):
    driven = drive(settings=LIT.replace(width=24, height=14), light=True)
    driven.run(f"frame 8\nset overlays off\nset channel {channel}\nset samples 3\nexpect light.samples == 0")
    driven.run("wait 8\nexpect light.samples == 1")
    refiner = driven.engine._lights._refiner
    driven.run("wait 9\nexpect light.samples == 3")
    assert not driven.engine.refining(driven.state)
    mean = refiner.source.read("direct")[..., :3].astype(np.float64)
    singles = []
    for k in range(3):
        refiner.source.trace(8, k, 1)
        singles.append(refiner.source.read("direct")[..., :3].astype(np.float64))
    assert np.allclose(mean, np.mean(singles, axis=0), rtol=1e-4, atol=1e-6)
    driven.run("key RIGHT\nexpect light.samples == 0\nset samples 0\nwait 10\nexpect light.samples == 0")


def test_the_corner_names_path_traced_light_of_the_light_method(drive):
    driven = drive(settings=LIT.replace(width=24, height=14, light="path-traced", spp=1, indirect="auto"), light=True)
    driven.run("frame 8\nset channel color")
    assert driven.engine.light_text(driven.state) == "path-traced light, 1 sample per pixel"


def test_images_are_compared_in_the_light_of_the_same_method(drive):
    """History has no path-traced light: beside it the image has none either."""
    driven = drive(settings=LIT.replace(width=24, height=14), light=True)
    driven.run("frame 8\nset overlays off\nset channel color\nset samples 2")
    raster = driven.engine.image()
    driven.run("wait 9\nexpect light.samples == 2")
    assert (driven.engine.image() != raster).any()
    driven.run("set against history\nset comparison split\nset split 1\nwait 1\nexpect light.samples == 0")
    assert (driven.engine.image()[:, :-1] == raster[:, :-1]).all()
    driven.run("set comparison off\nwait 1\nexpect light.samples == 2")


def test_a_moving_camera_has_coarse_light(drive):
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset channel color\nkey F")
    driven.viewer.input.key("W", True)
    driven.viewer.tick(1 / 24)
    assert driven.engine.light_text(driven.state) == COARSE["quarter"].text
    driven.viewer.input.key("W", False)
    driven.run("wait 1")
    assert driven.engine.light_text(driven.state) != COARSE["quarter"].text


def test_path_tracing_that_fails_leaves_rasterized_light(drive, monkeypatch):
    from taubench_gl.errors import GraphicsError
    from taubench_gl.viewer import light

    def fail(*_: object) -> None:
        raise GraphicsError("too little memory")

    monkeypatch.setattr(light, "Refiner", fail)
    driven = drive(settings=LIT.replace(width=24, height=14), light=True)
    driven.run("frame 8\nset channel color\nwait 9\nexpect light.samples == 0\nexpect samples == 0")
    assert "too little memory" in driven.state.message
    driven.run("key RIGHT\nwait 9")
    assert driven.engine.shots[1].frame == 9
