"""The engine against offscreen evaluation: counts, pixels, distances; it renders only what changed."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from fixed import fixed_settings
from viewer_tools import DEMO, QUIET, ROOT, evaluated, pixels

from taubench_gl.conventions import FRUSTUM, Reason, Visibility
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.evaluation.explain import in_words
from taubench_gl.glossary import label_of
from taubench_gl.metrics.counts import percent
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.report.palette import EXACT_COLORS, color_of
from taubench_gl.settings import Settings
from taubench_gl.viewer.model import LiveTimer

pytestmark = pytest.mark.usefixtures("coarse_light")


@pytest.mark.parametrize("reprojection", ["camera", "motion"])
def test_percentages_are_those_of_evaluate(drive, reprojection):
    settings = QUIET.replace(reprojection=reprojection)
    driven = drive(settings=settings)
    for frame in (8, 9):
        driven.run(f"frame {frame}")
        row = evaluated(frame, settings)
        assert driven.counts_are_those_of(row)
        expected = 100.0 * row["reusable_surface"] / (row["pixels"] - row["sky"])
        shares = driven.engine.percentages()
        assert shares["position"] == percent(row, "position") > 0 and shares["sky"] == percent(row, "sky") > 0
        assert shares["reusable_surface"] == expected > 0 and shares["reusable_shading"] is None  # no light
        rate, share, words = driven.engine.reusable()
        assert (rate, share) == ("surface", expected) and f"{share:.1f} %" in words
        other = 100.0 * row["other_reusable_surface"] / (row["pixels"] - row["sky"])
        assert other != expected and f"{other:.1f} %" in words
        assert f"{percent(row, 'sky'):.1f} %" in words


def test_light_counts_are_those_of_evaluate(drive):
    settings = QUIET.replace(columns=("direct", "color", "position"), indirect="none", width=48, height=27)
    driven = drive(settings=settings, light=True)
    driven.run("frame 5\nexpect overlay.direct > 0")
    assert driven.counts_are_those_of(evaluated(5, settings), "direct", "color", "lit")
    assert driven.engine.reusable()[1] is None  # without frustum and normal nothing is known
    driven.run("set effect.direct off")
    assert driven.engine.percentages()["direct"] is driven.engine.percentages()["lit"] is None


def test_pixels_of_a_mask_have_its_color(drive, tmp_path):
    driven = drive()
    driven.run(
        "frame 8\nset opacity 1\nset show.frustum off\nset show.normal off\nscreenshot " + str(tmp_path / "a.png")
    )
    mask, image = driven.engine.mask(), pixels(tmp_path / "a.png")
    hit = (mask & np.uint32(Reason.POSITION)) != 0
    assert 10 < hit.sum() < hit.size / 2
    assert (image[hit] == color_of(Reason.POSITION)).all()
    driven.run("key H\nscreenshot " + str(tmp_path / "b.png"))
    bare = pixels(tmp_path / "b.png")
    assert (bare[~hit] == image[~hit]).all() and (bare[hit] != image[hit]).any(axis=-1).all()


def test_only_changed_parts_are_rendered(drive):
    driven = drive()
    driven.run("frame 5")
    before = replace(driven.engine.drawn)
    driven.run("wait 3")
    assert driven.engine.drawn == before
    driven.run("set threshold.normal 0.3")
    after = driven.engine.drawn
    assert (after.pairs, after.masks, after.plans) == (before.pairs, before.masks + 1, before.plans)
    driven.run("set opacity 0.2")
    assert (after.masks, after.images) == (before.masks + 1, before.images + 2)


def test_a_still_camera_in_a_still_frame_discards_nothing(drive):
    driven = drive()
    driven.run("frame 6\nkey F\nkey R\nwait 1")
    driven.engine._last = driven.engine._before = None  # as if the camera had never moved
    driven.run("wait 1")
    assert not any(driven.engine.counts[n] for n in ("frustum", "position", "normal"))


def test_fly_compares_with_the_last_view(drive):
    driven = drive()
    driven.run("frame 6\nkey F\nhold L 2\nexpect count.frustum > 0")
    counts = dict(driven.engine.counts)
    driven.run("wait 3")
    assert driven.engine.counts == counts, "a still camera must keep the last pair"
    driven.run("key RIGHT")
    previous, current = driven.engine.shots
    assert (previous.frame, current.frame) == (6, 7)
    assert (previous.view.position == current.view.position).all()


def test_frozen_cameras(drive):
    driven = drive()
    driven.run("frame 6\nkey F\nkey X\nwait 1")
    frozen = driven.engine.shots[0].view
    driven.run("hold D 6\nexpect overlay.frustum > 1")
    assert driven.engine.shots[0].view is frozen
    driven.run("key C\nwait 1")
    pair, counts = driven.engine.shots, dict(driven.engine.counts)
    lines = driven.engine.image()
    driven.run("hold S 6")
    assert driven.engine.shots == pair and driven.engine.counts == counts
    outside = driven.engine.image()
    assert (outside != lines).any()
    driven.run("key B\nwait 1")
    assert (driven.engine.image() != outside).any(axis=-1).sum() > 20, "the outlines of two frusta"
    driven.run("key ESCAPE\nexpect freeze_current == 0\nexpect freeze_previous == 0")


def test_points_outside_the_frozen_camera_are_dark(drive):
    driven = drive()
    driven.run("frame 6\nkey F\nset overlays off\nset frusta off\nkey C\nwait 1")
    inside = driven.engine.image().astype(float).mean()
    driven.run("hold J 48")  # turn away
    assert driven.engine.image().max() <= 0.31 * 255 < inside


def test_object_motion_of_static_surfaces_is_zero(drive):
    driven = drive()
    driven.run("frame 12\nset channel object_motion")
    error, position = driven.engine.object_motion(), driven.engine.feed.source.read("position")
    assert (error[position[..., 3] > 0] < 1e-3).mean() > 0.5 and error.max() > 1.0
    driven.run("set overlays off\nset auto_range off\nset range.low 0\nset range.high 4")
    from references.display import channel_rgb

    expected = channel_rgb("object_motion", np.repeat(error[..., None], 3, -1), 0.0, 4.0, position=position)
    assert np.abs(driven.engine.image() / 255.0 - expected).max() < 0.02


@pytest.mark.parametrize("sampling", ["nearest", "bilinear"])
@pytest.mark.parametrize("reprojection", ["camera", "motion"])
def test_the_probe_agrees_with_the_float64_reference(drive, sampling, reprojection):
    driven = drive(settings=QUIET.replace(sampling=sampling, reprojection=reprojection))
    driven.run("frame 10")
    engine, s = driven.engine, driven.state
    source = engine.feed.source
    names = ["position", "normal"] + (["prev_position"] if reprojection == "motion" else [])
    reference = pair_masks(
        {n: source.read(n) for n in names}, {n: source.read(n, previous=True) for n in names[:2]}, engine.pair,
        s.thresholds, sampling=sampling, reprojection=reprojection,
    )  # fmt: skip
    rng, reasons = np.random.default_rng(1), set()
    interesting = np.argwhere(engine.mask() & np.uint32(int(Reason.POSITION | Reason.NORMAL | FRUSTUM)))
    for row, x in [*interesting[rng.permutation(len(interesting))[:12]], *rng.integers(0, (54, 96), (8, 2))]:
        found = engine.evaluator.explain(int(x), int(row), thresholds=s.thresholds)
        reasons.add(found.reason.split(":")[0])
        assert found.word == engine.mask()[row, x]
        if found.at is not None:
            assert np.allclose(found.at, reference.at_px[row, x], atol=1e-3)
        for feature, seen in found.features.items():
            expected = reference.distances[feature][row, x]
            if np.isnan(expected):
                assert seen.distance is None
            else:
                assert seen.distance == pytest.approx(expected, rel=1e-3, abs=2e-4)
    assert reasons - {"reusable"}, "only reusable pixels were probed"


@pytest.mark.parametrize(
    ("word", "reasons"),
    [
        (0, ()),
        (Reason.SKY | Reason.HISTORY_SKY, (Reason.SKY,)),
        (Reason.SKY | Reason.HISTORY_SKY | Reason.COLOR, (Reason.SKY, Reason.COLOR)),
        (Reason.SKY | Reason.OUTSIDE, (Reason.SKY, FRUSTUM, Reason.OUTSIDE)),
        (Reason.SKY | Reason.INVALID, (Reason.SKY, Reason.INVALID)),
        (Reason.FIRST, (Reason.FIRST,)),
        (Reason.INVALID, (Reason.INVALID,)),
        (Reason.BEHIND, (FRUSTUM, Reason.BEHIND)),
        (Reason.OUTSIDE, (FRUSTUM, Reason.OUTSIDE)),
        (Reason.POSITION | Reason.DISOCCLUDED, (Reason.POSITION, Reason.DISOCCLUDED)),
        (Reason.SKY | Reason.POSITION | Reason.NORMAL | Reason.DISOCCLUDED, (Reason.SKY,)),
        (Reason.POSITION | Reason.OCCLUDING | Reason.NORMAL, (Reason.POSITION, Reason.OCCLUDING, Reason.NORMAL)),
        (Reason.DIRECT | Reason.SHADOWED, (Reason.DIRECT, Reason.SHADOWED)),
        (Reason.INDIRECT | Reason.COLOR, (Reason.INDIRECT, Reason.COLOR)),
    ],
)
def test_reasons_in_words(word, reasons):
    words = in_words(int(word))
    assert all(label_of(reason) in words for reason in reasons)
    assert words.startswith("reusable") == (not reasons)
    assert words.startswith("sky") == bool(word & Reason.SKY)


@pytest.mark.parametrize(
    ("columns", "least"),
    [(("position",), 9), pytest.param(("direct", "color"), 13, marks=pytest.mark.long)],
    ids=["geometry", "light"],
)
def test_every_visualization_can_be_shown(drive, columns, least):
    driven = drive(light=True, settings=fixed_settings(width=32, height=18, indirect="none", columns=columns))
    driven.run("frame 6")
    assert len(driven.state.channels) >= least
    for name in driven.state.channels:
        driven.run(f"set channel {name}\nexpect channel == {name}")
        assert np.ptp(driven.engine.image()) > 20, name


def test_a_run_opens_at_its_worst_frame_with_its_settings(drive, tmp_path):
    settings = QUIET.replace(frames=(5, 12), thresholds={"normal": 0.31}, unit_scale=2.0)
    settings = settings.replace(camera="orbit", animation=("carousel", "morph"))
    run = evaluate_scene(DEMO, settings, out=tmp_path / "run")
    worst = max(run.frames, key=lambda r: sum(r[n] or 0 for n in ("frustum", "position", "normal")))
    driven = drive(tmp_path / "run", Settings())
    assert driven.engine.feed.scene.playing == ("carousel", "morph")
    driven.run(f"expect frame == {worst['frame']}\nexpect first == 5\nexpect last == 11\nexpect image.width == 96")
    assert driven.state.thresholds["position"] == pytest.approx(2 * 32 / 255)
    assert driven.engine.counts["normal"] == worst["normal"] and driven.engine.counts["position"] == worst["position"]


class TestPathTraced:
    """Path-traced files, alone and compared with the rasterizer."""

    renders = ROOT / "tests" / "pathtraced" / "references" / "rigid"

    def options(self):
        from taubench_gl.pathtraced.evaluation import PathTracedOptions

        return PathTracedOptions(camera_file=self.renders / "camera.json")

    def test_alone(self, drive):
        from taubench_gl.pathtraced.evaluation import evaluate_path_traced

        row = evaluate_path_traced(f"exr:{self.renders}", Settings(), self.options()).frames[0]
        driven = drive(f"exr:{self.renders}", Settings(), options=self.options())
        driven.run("expect frame == 21\nkey F\nexpect camera == file")
        assert driven.engine.counts["position"] == row["position"] and driven.engine.counts["normal"] == row["normal"]
        driven.run("frame 20\nexpect count.first == 5184\nframe 21\nexpect count.first == 0")
        assert driven.engine.counts["position"] == row["position"]

    def test_compared_with_the_rasterizer(self, drive, data):
        scene = data / "khronos" / "BoxAnimated" / "BoxAnimated.glb"
        driven = drive(scene, QUIET, reference=f"exr:{self.renders}", options=self.options())
        driven.run("frame 21\nset channel normal\nset overlays off\nset split 0\nset comparison split")
        reference = driven.engine.image()[:, 2:]
        driven.run("set comparison off")
        ours = driven.engine.image()[:, 2:]
        assert ((np.abs(reference.astype(int) - ours) <= 2).all(axis=-1)).mean() > 0.9
        driven.run("set gain 1\nset comparison difference")
        found = driven.engine.image()[:, 2:].astype(int)
        assert (np.abs(found - np.abs(reference.astype(int) - ours)) <= 2).mean() > 0.99
        driven.run("set channel headlight\nframe 3")
        assert driven.state.comparison == "difference"

    def test_another_size_is_an_error(self, drive, data):
        scene = data / "khronos" / "BoxAnimated" / "BoxAnimated.glb"
        with pytest.raises(SettingsError) as error:
            drive(scene, QUIET.replace(width=64), reference=f"exr:{self.renders}", options=self.options())
        assert "--size 96x54" in error.value.hint


def test_exact_reasons_are_those_of_evaluate(drive, tmp_path):
    """Shares and colors of the mode; the masks come back without it."""
    settings = QUIET.replace(columns=("frustum", "position", "direct"), indirect="none", width=64, height=36)
    row = evaluated(5, settings.replace(exact=True))
    driven = drive(settings=settings, light=True)
    driven.run("frame 5\nset opacity 1\nset exact on\nscreenshot " + str(tmp_path / "a.png"))
    percentages = driven.engine.percentages()
    for name, column in (("disoccluded", "occluded"), ("brightened", "brightened"), ("darkened", "darkened"),
                         ("view_dependent", "view_dependent"), ("new", "exact_new")):  # fmt: skip
        assert percentages[f"exact_{name}"] == pytest.approx(100.0 * row[column] / row["pixels"]), name
    assert percentages["exact_disoccluded"] > 1.0 and percentages["exact_brightened"] > 0.5
    image = pixels(tmp_path / "a.png")
    drawn = (image == EXACT_COLORS[Visibility.OCCLUDED]).all(axis=-1)
    assert drawn.sum() == row["occluded"]
    found = driven.engine.source.read("prev_visibility")[..., 0]
    for bit, words in ((Visibility.OCCLUDED, "disoccluded"), (Visibility.OUTSIDE, "off-screen"),
                       (Visibility.VISIBLE, "visible")):  # fmt: skip
        y, x = np.argwhere(found == bit)[0]
        driven.run(f"set probe {x},{y}\nset probe_pinned on\nwait 1")
        assert driven.runner._read("probe.exact").startswith(words)
    driven.run("set exact off\nscreenshot " + str(tmp_path / "b.png"))
    assert driven.runner._read("probe.exact") is None
    assert driven.engine.source.visibility is None and not driven.state.exact
    hit = (driven.engine.mask() & np.uint32(Reason.POSITION)) != 0
    assert (pixels(tmp_path / "b.png")[hit] != image[hit]).any()


def test_times_of_the_last_image_are_told_from_those_of_earlier_ones():
    class Nothing:
        def finish(self) -> None: ...

    timer = LiveTimer(Nothing())
    timer.enabled = True
    for passes in (("gbuffer", "masks"), ("paths",), ()):
        timer.update()
        for name in passes:
            with timer.measure(name):
                pass
    timer.update()
    assert timer.latest == {"paths"} and set(timer.ms) == {"gbuffer", "masks", "paths"}


def test_exact_reasons_need_positions_of_32_bits(drive):
    driven = drive(settings=QUIET.replace(storage="half"))
    driven.run("frame 5\nset exact on\nwait 1")
    assert not driven.state.exact and driven.state.message


def test_vectors_of_files_are_shown_beside_those_of_positions(drive, tmp_path):
    """Vectors with the wrong sign: channel, arrows and probe show them, those of positions are the right ones."""
    from foreign_frames import MAPPING, passes_of, write_frames

    def flip(channels, frame):
        return channels | {name: -values for name, values in channels.items() if name.startswith("Velocity")}

    folder, mapping = write_frames(tmp_path / "f", change=flip), tmp_path / "m.json"
    mapping.write_text(json.dumps(MAPPING))
    options = PathTracedOptions(camera_file=folder / "camera.json", mapping=mapping)
    driven = drive(f"exr:{folder}", Settings(), options=options)
    driven.run("frame 2\nset channel vectors\nset probe 24,16\nset probe_pinned on\nwait 1")
    passes = passes_of(2)
    wall, stored = passes["wall"], -passes["motion"]
    assert wall[16, 24]
    assert driven.engine.explain(driven.state).vector_px == pytest.approx(tuple(stored[16, 24]), abs=1e-4)
    length = np.linalg.norm(stored, axis=-1).max()
    assert driven.state.display_range == pytest.approx((0.0, length), rel=1e-3)
    camera = driven.engine.motion()[16, 24]
    driven.run("set reprojection motion\nwait 1")
    np.testing.assert_allclose(driven.engine.motion()[~passes["sky"]], stored[~passes["sky"]], atol=1e-4)
    assert np.abs(camera - stored[16, 24]).max() > 1.0
