"""Evaluation of path-traced files: the float64 reference, results computed by hand, and real files."""

from __future__ import annotations

import numpy as np
import pytest
from exr_files import HEIGHT, WIDTH, blender_frame, options, view_at, window, write
from fixed import fixed_settings

import taubench_gl as tb
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Reason
from taubench_gl.errors import PathTracedError, SettingsError
from taubench_gl.evaluation import Observers
from taubench_gl.features import FEATURES
from taubench_gl.metrics.color import display_color
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.pathtraced.cameras import camera_file_text
from taubench_gl.pathtraced.evaluation import PathTracedOptions, evaluate_path_traced
from taubench_gl.pathtraced.passes import LOBES
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.pathtraced.source import frame_channels, mixed_pixels


def channels_of(renders):
    """Path and channels of each file of the fixture ``renders``."""
    for path in renders.glob("*.exr"):
        number = int(path.stem[-4:])
        yield path, blender_frame(view_at(0.3 * number).position, seed=number)[0]


def test_masks_equal_the_float64_reference(renders):
    settings = fixed_settings(thresholds={"direct": 0.4, "indirect": 0.3, "color": 0.2}, exposure=0.7, tone_map="aces")
    masks = {}

    def keep(pair):
        masks[pair.frame] = pair.mask

    run = evaluate_path_traced(f"exr:{renders}", settings, options(renders), Observers(on_pair=keep))
    sequence = PathTracedSequence.open(renders)
    views = {f: view_at(0.3 * f) for f in (4, 5, 6)}
    frames = {f: frame_channels(sequence.read(f), view, view, settings) for f, view in views.items()}
    thresholds = {f: settings.metrics.threshold(f) for f in FEATURES}
    assert run.summary["pairs"] == 2 and set(masks) == {5, 6}
    for f, mask in masks.items():
        pair = reprojection(views[f], views[f - 1], WIDTH, HEIGHT)
        expected = pair_masks(frames[f], frames[f - 1], pair, thresholds, exposure=settings.lighting.exposure)
        np.testing.assert_array_equal(mask, expected.mask)
        row = next(r for r in run.frames if r["frame"] == f)
        assert row["direct"] == int(((expected.mask & Reason.DIRECT) != 0).sum()) > 0


def test_frames_below_zero_are_in_order(data):
    run = tb.evaluate(f"exr:{data / 'reports4' / 'exr' / 'room_neg'}", columns=("frustum",))
    assert [row["frame"] for row in run.frames] == [-3, -2, -1]
    np.testing.assert_allclose([row["translation_m"] for row in run.frames], [0.5, 1.0, 1.5], rtol=1e-6)


def test_pairs_of_files_are_those_of_their_evaluation(renders):
    """Options of path-traced files are given by name."""
    camera_file = options(renders).camera_file
    run = tb.evaluate(f"exr:{renders}", camera_file=camera_file, lobes="diffuse")
    pairs = list(tb.pairs(f"exr:{renders}", camera_file=str(camera_file)))
    assert [pair.frame for pair in pairs] == [5, 6] and "diffuse" in run.summary["lobes"]
    for pair, row in zip(pairs, run.frames, strict=True):
        assert pair.color.shape == (HEIGHT, WIDTH, 3)
        assert pair.row == {name: value for name, value in row.items() if name != "camera_cut"}
    for pair in tb.pairs(f"exr:{renders}", camera_file=camera_file):
        assert pair.explain(1, 2).word == pair.mask[2, 1]


def test_the_summary_has_the_same_blocks_as_that_of_a_scene(renders):
    run = evaluate_path_traced(f"exr:{renders}", None, options(renders))
    settings = run.summary["settings"]
    assert (settings["width"], settings["height"], settings["fps"]) == (WIDTH, HEIGHT, 30.0)
    assert (settings["first_frame"], settings["last_frame"]) == (4, 6)
    blocks = {"scene", "census", "camera", "discard", "classes", "curves", "effects", "timing", "provenance"}
    assert blocks <= set(run.summary)
    assert run.summary["camera"]["position"]["mean"] == pytest.approx(0.3)
    frames = [PathTracedSequence.open(renders).read(number) for number in (5, 6)]  # evaluated are two
    depth = np.median([np.median(frame.depth[~frame.sky]) for frame in frames])
    assert run.summary["scale"] == {"frames": 2, "median_depth_m": pytest.approx(depth, rel=1e-5)}
    assert all(entry["mean_percent"] is not None for entry in run.summary["discard"].values())
    assert run.tables()


def test_hand_computed_direct_light(tmp_path):
    """A static camera; 5 of 96 pixels change their diffuse light by 0.2 in one channel."""
    channels = blender_frame((0, 1, 5))[0]
    for lobe in ("Diff", "Gloss", "Trans"):
        for c in "RGB":
            channels[f"ViewLayer.{lobe}Col.{c}"][:] = 1.0
    write(tmp_path / "a_1.exr", channels)
    channels["ViewLayer.DiffDir.G"][6, 2:7] += 0.2
    write(tmp_path / "a_2.exr", channels)
    run = evaluate_path_traced(f"exr:{tmp_path}", None, PathTracedOptions(lobes=("diffuse", "glossy", "volume")))
    share = 100.0 * 5 / (WIDTH * HEIGHT)
    discard = run.summary["discard"]
    assert discard["direct"]["mean_percent"] == pytest.approx(share)
    assert [discard[c]["mean_percent"] for c in ("frustum", "position", "normal", "indirect", "color")] == [0.0] * 5
    assert run.frames[0]["lit"] == 5 and run.frames[0]["shadowed"] == 0
    lobes = run.summary["lobes"]
    assert lobes["diffuse"]["direct"]["mean_percent"] == pytest.approx(share)
    assert lobes["glossy"]["direct"]["mean_percent"] == 0.0
    assert lobes["volume"]["direct"]["mean_percent"] is None and "VolumeDir" in lobes["volume"]["direct"]["reason"]


def test_pixels_outside_the_data_window_are_invalid(renders):
    for path, channels in channels_of(renders):
        cut = {k: np.ascontiguousarray(v[:, 3:]) for k, v in channels.items()}
        whole = window(0, 0, WIDTH - 1, HEIGHT - 1)
        write(path, cut, dataWindow=window(3, 0, WIDTH - 1, HEIGHT - 1), displayWindow=whole)
    run = evaluate_path_traced(f"exr:{renders}", None, options(renders))
    assert run.summary["classes"]["invalid"] >= 3 * HEIGHT
    assert sum(run.summary["classes"].values()) == pytest.approx(WIDTH * HEIGHT)


def test_a_camera_is_not_estimated_from_depth(renders):
    for path, channels in channels_of(renders):
        write(path, {k: v for k, v in channels.items() if "Position" not in k})
    run = evaluate_path_traced(f"exr:{renders}", None, options(renders))
    assert run.summary["path_traced"]["camera_mismatch_px"] is None
    with pytest.raises(PathTracedError) as error:
        evaluate_path_traced(f"exr:{renders}")
    assert "--camera-file" in error.value.hint


def test_a_camera_of_other_frames_or_another_size_is_refused(renders):
    (renders / "camera.json").write_text(camera_file_text({4: view_at(1.2)}, 30.0, (WIDTH, HEIGHT)))
    with pytest.raises(PathTracedError, match="frame 5"):
        evaluate_path_traced(f"exr:{renders}", None, options(renders))
    views = {f: view_at(0.3 * f) for f in (4, 5, 6)}
    (renders / "camera.json").write_text(camera_file_text(views, 30.0, (WIDTH + 1, HEIGHT)))
    with pytest.raises(PathTracedError, match="13x8"):
        evaluate_path_traced(f"exr:{renders}", None, options(renders))


def test_contradicting_and_unknown_options_are_refused(renders):
    for wrong in ({"camera_file": "a", "scene_file": "b"}, {"lobes": ("shiny",)}):
        with pytest.raises(SettingsError):
            PathTracedOptions(**wrong)
    mapping = renders / "still.toml"
    mapping.write_text('[passes]\nposition = "Position"\n')  # neither vectors nor previous positions
    with pytest.raises(SettingsError):
        evaluate_path_traced(f"exr:{renders}", fixed_settings(reprojection="motion"), options(renders, mapping=mapping))


def test_the_noise_floor_of_two_seeds_is_noise_and_that_of_one_is_zero(renders, tmp_path):
    floor = evaluate_path_traced(f"exr:{renders}", None, options(renders, second_seed=renders)).summary["noise_floor"]
    assert {c: e["mean_percent"] for c, e in floor.items()} == {"color": 0.0, "direct": 0.0, "indirect": 0.0}
    other = tmp_path / "other"
    other.mkdir()
    for f in (4, 5, 6):
        write(other / f"frame_{f:04d}.exr", blender_frame(view_at(0.3 * f).position, seed=f + 100)[0])
    floor = evaluate_path_traced(f"exr:{renders}", None, options(renders, second_seed=other)).summary["noise_floor"]
    assert {c: e["mean_percent"] > 20 for c, e in floor.items()} == dict(color=True, direct=True, indirect=True), floor


def test_real_cycles_files_with_a_fitted_and_a_scene_camera(data):
    """A fitted camera and that of the scene give the same counts."""
    folder = data / "cycles" / "sponza_man"
    scene = folder / "sponza_man_camera_lights.glb"
    fitted = evaluate_path_traced(f"exr:{folder}")
    given = evaluate_path_traced(f"exr:{folder}", None, PathTracedOptions(scene_file=scene, lobes=LOBES[:2]))
    for column, entry in given.summary["discard"].items():
        assert entry["mean_percent"] == pytest.approx(fitted.summary["discard"][column]["mean_percent"], abs=0.02)
    assert given.summary["path_traced"]["camera_mismatch_px"] < 1e-3
    assert given.summary["discard"]["direct"]["mean_percent"] == pytest.approx(11.40, abs=0.05)
    assert "estimated" in fitted.summary["path_traced"]["camera"]


@pytest.mark.parametrize("axis", [0, 1])
def test_mixed_pixels_lie_between_two_surfaces(axis):
    """A wall at 2 m and one at 4 m, each side of an edge: the mean of 1 / depth lies on neither."""
    inverse = np.array([0.5, 0.5, 0.5, 0.5, 0.375, 0.25, 0.25, 0.25, 0.25])
    for middle, mixed in ((0.375, 9), (0.5, 0), (0.25, 0)):
        inverse[4] = middle
        depth = np.moveaxis(np.broadcast_to(1.0 / inverse, (9, 9)), 1, axis)
        found, edges = mixed_pixels(depth, np.zeros((9, 9), bool))
        assert found == mixed and edges == (9 if mixed else 18)


@pytest.mark.parametrize("curve", ["linear", "reinhard", "aces"])
def test_display_color(curve):
    ramp = np.linspace(0.0, 20.0, 301)
    shown = display_color(np.stack([ramp] * 3, axis=-1), curve=curve)[:, 0]
    assert shown[0] == pytest.approx(0.0, abs=1e-6) and np.all(np.diff(shown) >= 0) and shown.max() <= 1.0
    aces = 0.5 * (2.51 * 0.5 + 0.03) / (0.5 * (2.43 * 0.5 + 0.59) + 0.14)
    expected = {"linear": 0.5, "reinhard": 1 / 3, "aces": aces}
    encoded = 1.055 * expected[curve] ** (1 / 2.4) - 0.055
    np.testing.assert_allclose(display_color(np.array([0.25]), exposure=2.0, curve=curve), encoded)
    assert np.isnan(display_color(np.array([np.nan, np.inf, -np.inf]), curve=curve)).all()
    assert display_color(np.array([-3.0]), curve=curve) == pytest.approx(0.0, abs=1e-9)
