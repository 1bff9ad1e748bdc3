"""Light of other qualities: coarse while the image moves, path-traced sample by sample while it is still."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from viewer_tools import evaluated

from taubench_gl.frame.targets import read_channel
from taubench_gl.viewer.light import COARSE

LIT = fixed_settings(width=48, height=28, indirect="none", exposure=1.0)


def test_geometry_is_exact_and_light_coarse_while_playing(drive):
    row, geometry = evaluated(8, LIT), ("frustum", "position", "normal")
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset channel color\nexpect light.quality != ''")
    engine = driven.engine
    assert driven.counts_are_those_of(row, *geometry, "direct", "color")
    driven.run("set playing on")
    assert driven.counts_are_those_of(row, *geometry)
    coarse = COARSE["quarter"].settings(engine.feed.settings)
    assert (coarse.sequence.width, coarse.sequence.height) == (12, 7)
    small = evaluated(8, coarse)
    assert engine.counts["direct"] == 16 * small["direct"] and engine.counts["color"] == 16 * small["color"]
    assert engine.percentages()["indirect"] is None and engine.percentages()["reusable_shading"] is None
    driven.run("set playing off")
    assert driven.counts_are_those_of(row, *geometry, "direct", "color")
    driven.run("set moving_light full\nset playing on")
    assert driven.counts_are_those_of(row, *geometry, "direct", "color") and engine.lights.active is None


def test_coarse_light_is_not_brighter(drive):
    """All lights have their shadows and indirect light in motion too: the means of both images agree to 2 %."""
    driven = drive(settings=LIT.replace(width=96, height=56, indirect="auto"), light=True)
    driven.run("frame 8\nset channel color\nset overlays off")
    still = driven.engine.image().mean()
    driven.run("set playing on")
    assert driven.engine.lights.active is not None and driven.engine.image().mean() == pytest.approx(still, rel=0.02)


def test_indirect_light_is_kept_for_some_frames_while_playing(drive):
    """Solved once for every ``hold`` frames that are drawn; a pair of the first frame shown draws two."""
    driven = drive(settings=LIT.replace(width=32, height=18, indirect="auto"), light=True)
    driven.run("frame 8\nset channel color\nset playing on")
    indirect, solved = driven.engine.lights.coarse.source.light.indirect, []
    solve = indirect._solve
    indirect._solve = lambda *a: (solved.append(driven.state.frame), solve(*a))
    hold = COARSE["quarter"].hold
    for _ in range(2 * hold):
        driven.state.go_to(driven.state.frame + 1)
        driven.viewer.tick(0.0)
    assert len(solved) == 2 and solved[1] - solved[0] == hold > 1
    assert driven.engine.percentages()["indirect"] is None


def test_coarse_light_is_shown_between_its_pixels(drive):
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset channel color\nset overlays off\nset moving_light unshadowed\nset playing on")
    engine = driven.engine
    small = read_channel(engine.lights.coarse.source.current["color"], "color")[..., :3]
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
    light = driven.engine.lights.coarse.mask
    bits = read_channel(light, "mask")[..., 0].repeat(4, axis=0).repeat(4, axis=1)
    from taubench_gl.conventions import NOT_COMPARABLE, Reason

    expected = (bits & int(Reason.DIRECT) != 0) & (driven.engine.mask() & int(NOT_COMPARABLE) == 0)
    changed = (driven.engine.image() != bare).any(axis=-1)
    assert expected.sum() > 20 and (changed == expected).mean() > 0.99


def test_the_probe_is_complete_while_playing(drive):
    """The probe has the light of the coarse pixel over its own; previous and reprojected are shown."""
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset channel color\nset probe 20,14\nset probe_pinned on")
    still, tiles = driven.viewer.probe(), magnified(driven)
    driven.run("set playing on")
    moving, coarse = driven.viewer.probe(), driven.engine.lights.coarse
    assert set(moving.features) == set(still.features) == {"color", "position", "normal", "direct"}
    assert moving.features["normal"].distance == still.features["normal"].distance
    expected = coarse.explain(20, 14, driven.state.thresholds).features
    assert moving.features["direct"].distance == expected["direct"].distance
    assert np.array_equal(moving.features["color"].history, expected["color"].history)
    black = (magnified(driven) == 0).all(axis=-1).mean(axis=(0, 1))
    assert black.max() <= (tiles == 0).all(axis=-1).mean(axis=(0, 1)).max() + 0.1
    driven.run("expect probe.direct >= 0\nexpect probe.material != none")


def magnified(driven) -> np.ndarray:
    """The three magnified images of the probe, (side, side, 3 images, 3 channels)."""
    texture = driven.engine.magnify(driven.state, driven.viewer.probe())
    pixels = np.frombuffer(texture.read(), np.uint8).reshape(texture.height, 3, texture.height, 4)
    return pixels.transpose(0, 2, 1, 3)[..., :3]


def test_light_bits_of_a_coarse_pixel_join_the_surface_bits_of_the_fine_one():
    from taubench_gl.conventions import Reason
    from taubench_gl.evaluation.explain import Explanation, FeatureValues, in_words, with_light

    def explained(word: Reason, *names: str) -> Explanation:
        values = {n: FeatureValues(np.zeros(3), np.ones(3), 1.0, 0.1, True) for n in names}
        return Explanation((1, 2), int(word), (0.0, 0.0), (1.0, 2.0), values, in_words(int(word)))

    light = explained(Reason.DIRECT | Reason.LIT | Reason.NORMAL, "normal", "direct")
    joined = with_light(explained(Reason.POSITION, "position", "normal"), light)
    assert joined.word == Reason.POSITION | Reason.DIRECT | Reason.LIT
    assert tuple(joined.features) == ("position", "normal", "direct") and joined.reason == in_words(joined.word)
    outside = with_light(explained(Reason.OUTSIDE, "position", "normal"), light)
    assert outside.word == Reason.OUTSIDE and "direct" in outside.features


@pytest.mark.parametrize("channel", ["direct", "color"])
def test_a_still_image_is_path_traced_sample_by_sample(drive, channel):
    driven = drive(settings=LIT.replace(width=24, height=14), light=True)
    driven.run(f"frame 8\nset overlays off\nset channel {channel}\nset samples 3\nexpect light.traced == 0")
    driven.run("wait 8\nexpect light.traced == 1\nexpect light.samples == 0")
    refiner = driven.engine.lights._refiner
    driven.run("wait 9\nexpect light.traced == 3")
    assert not driven.engine.lights.pending(driven.state)
    mean = refiner.source.read("direct")[..., :3].astype(np.float64)
    singles = []
    for k in range(3):
        refiner.source.trace(8, k, 1)
        singles.append(refiner.source.read("direct")[..., :3].astype(np.float64))
    assert np.allclose(mean, np.mean(singles, axis=0), rtol=1e-4, atol=1e-6)
    driven.run("key RIGHT\nexpect light.traced == 0\nset samples 0\nwait 10\nexpect light.traced == 0")


def test_path_traced_light_is_shown_once_it_is_nearer_to_the_truth(drive):
    driven = drive(settings=LIT.replace(width=24, height=14), light=True)
    driven.run("frame 8\nset overlays off\nset channel color\nset samples 32\nwait 8")
    engine, shown = driven.engine, []
    while engine.lights.pending(driven.state):
        driven.run("wait 1")
        shown.append(engine.lights.samples)
        if shown[-1] and not shown[:-1].count(shown[-1]) and sum(map(bool, shown)) == 1:
            traced = displayed(engine.lights._refiner.source)
    first = next(i for i, samples in enumerate(shown) if samples)
    assert shown[first] in (2, 4, 8, 16, 32) and all(shown[first:])
    truth, preview = displayed(engine.lights._refiner.source), displayed(engine.feed.source)
    assert np.square(traced - truth).mean() < np.square(preview - truth).mean()


def displayed(source) -> np.ndarray:
    return np.clip(sum(source.read(n)[..., :3] for n in ("direct", "indirect") if n in source.current), 0.0, 1.0)


def test_path_traced_light_with_more_noise_than_the_light_method_has_error_is_not_shown(drive, tmp_path):
    """The light method is exact here: a convex object in front of nothing, in a uniform sky."""
    ball = tmp_path / "ball.aff"
    ball.write_text(
        "v\nfrom 0 0 4\nat 0 0 0\nup 0 1 0\nangle 45\nhither 1\nresolution 64 64\nf 0.8 0.8 0.8 1 0 1 0 0\ns 0 0 0 1\n"
    )
    settings = fixed_settings(
        width=24, height=14, exposure=1.0, light="raster", indirect="none", environment=(1.0, 1.0, 1.0)
    )
    driven = drive(scene=ball, settings=settings, light=True)
    driven.run("set overlays off\nset channel color\nset samples 16\nwait 30\nexpect light.traced == 16")
    driven.run("expect light.samples == 0")


def test_the_corner_names_path_traced_light_of_the_light_method(drive):
    driven = drive(settings=LIT.replace(width=24, height=14, light="path-traced", spp=1, indirect="auto"), light=True)
    driven.run("frame 8\nset channel color")
    assert driven.engine.lights.text(driven.state) == "path-traced light, 1 sample per pixel"


def test_images_are_compared_in_the_light_of_the_same_method(drive):
    """History has no path-traced light: beside it the image has none either."""
    driven = drive(settings=LIT.replace(width=24, height=14), light=True)
    driven.run("frame 8\nset overlays off\nset channel color\nset samples 32")
    raster = driven.engine.image()
    driven.run("wait 40\nexpect light.samples > 0")
    assert (driven.engine.image() != raster).any()
    driven.run("set against history\nset comparison split\nset split 1\nwait 1\nexpect light.samples == 0")
    assert (driven.engine.image()[:, :-1] == raster[:, :-1]).all()
    driven.run("set comparison off\nwait 1\nexpect light.samples > 0")


def test_a_moving_camera_has_coarse_light(drive):
    driven = drive(settings=LIT, light=True)
    driven.run("frame 8\nset channel color\nkey F")
    driven.viewer.input.key("W", True)
    driven.viewer.tick(1 / 24)
    assert driven.engine.lights.text(driven.state) == COARSE["quarter"].text
    driven.viewer.input.key("W", False)
    driven.run("wait 1")
    assert driven.engine.lights.text(driven.state) != COARSE["quarter"].text


def test_path_tracing_that_fails_leaves_rasterized_light(drive, monkeypatch):
    from taubench_gl.errors import GraphicsError
    from taubench_gl.viewer import light

    def fail(*_: object) -> None:
        raise GraphicsError("too little memory")

    monkeypatch.setattr(light, "Refiner", fail)
    driven = drive(settings=LIT.replace(width=24, height=14), light=True)
    driven.run("frame 8\nset channel color\nwait 9\nexpect light.traced == 0\nexpect samples == 0")
    assert "too little memory" in driven.state.message
    driven.run("key RIGHT\nwait 9")
    assert driven.engine.shots[1].frame == 9
