"""History from the other eye: disparity, occluded strips, counts and mirror images against closed forms and NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fixed import fixed_settings
from lamp_scenes import matte_room

from taubench_gl.animation import Poser, choose_camera
from taubench_gl.animation.eyes import other_eye
from taubench_gl.animation.pairs import sky_directions
from taubench_gl.api import pairs
from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.evaluation.decided_pixels import Decisions, PreviewPair
from taubench_gl.evaluation.histories import merge_histories
from taubench_gl.features import COLUMNS
from taubench_gl.metrics.histories import uses_other_eye
from taubench_gl.metrics.reuse_rate import RATE_BITS
from taubench_gl.metrics.sampled_light import PixelMasks
from taubench_gl.paths import ASSETS
from taubench_gl.scene.builder import SceneBuilder, box, quad, turn_x, turn_y
from taubench_gl.settings import Settings

YFOV, BASE = 1.0, 0.064
GEOMETRIC = ("frustum", "position", "normal")
FINE = 32


def settings(**more) -> Settings:
    own = {"size": (96, 54), "frames": (0, 2), "columns": GEOMETRIC, "history": "eye", "pairs": "all", "camera": 0}
    return fixed_settings(**own | more)


def focal(height: float) -> float:
    return 0.5 * height / np.tan(0.5 * YFOV)


def boards(*depths: float, half=(0.5, 20.0), at: float = 0.0, moves: bool = False):
    """Boards that face the camera; the last one fills the picture.  The first may move to the right and back."""
    b = SceneBuilder()
    for depth in depths[:-1]:
        node = b.node(mesh=b.mesh(quad(*half)), translation=(at, 0.0, -depth))
        if moves:
            b.animate(node, "translation", [0, 0.5, 1], [(at, 0, -depth), (at + 0.3, 0, -depth), (at, 0, -depth)])
    wall = b.node(mesh=b.mesh(quad(200.0, 200.0)), translation=(0.0, 0.0, -depths[-1]))
    camera = b.camera(yfov=YFOV, znear=0.05, zfar=1000.0)
    for node, place in ((wall, (0.0, 0.0, -depths[-1])), (camera, (0.0, 0.0, 0.0))):
        b.animate(node, "translation", [0.0, 1.0], [place, place])
    return b.build()


def only_pair(scene, **more):
    [pair] = pairs(scene, settings(**more))
    return pair


@pytest.mark.parametrize(("eye", "side"), [("left", -1.0), ("right", 1.0)])
@pytest.mark.parametrize(("depth", "convergence"), [(0.5, None), (2.0, None), (2.0, 1.0), (2.0, 2.0), (7.0, 0.8)])
def test_a_board_at_depth_z_shifts_by_f_b_over_z(eye, side, depth, convergence):
    """The left eye's other eye is to its right and sees the board further left; convergence takes f b / c away."""
    pair = only_pair(boards(depth), eye=eye, convergence=convergence)
    shift = focal(54) * BASE * (1.0 / depth - (0.0 if convergence is None else 1.0 / convergence))
    seen = (pair.mask & int(FRUSTUM)) == 0
    np.testing.assert_allclose(
        pair.motion[seen], np.broadcast_to([side * shift, 0.0], pair.motion[seen].shape), atol=2e-4
    )
    columns = np.arange(96) + side * shift
    outside = (columns < -1 / 256) | (columns > 95 + 1 / 256)
    assert np.array_equal(
        pair.mask, np.where(outside, np.uint32(Reason.OUTSIDE), np.uint32(0)) * np.ones((54, 1), np.uint32)
    )


@pytest.mark.parametrize(("eye", "convergence"), [("left", None), ("right", None), ("left", 1.5)])
def test_the_occluded_strip_is_exact_to_a_32nd_of_a_pixel(eye, convergence):
    """f b (1 / z1 - 1 / z2) pixels of an image of 48x1 pixels, measured in one of 32 times as many."""
    near, far = 1.3, 4.7
    scene = boards(near, far, half=(0.31, 20.0), at=0.037)
    pair = only_pair(scene, size=(48 * FINE, FINE), eye=eye, eyes=3.0 * BASE, convergence=convergence)
    hidden = (pair.mask & np.uint32(Reason.DISOCCLUDED)) != 0
    strip = focal(1) * 3.0 * BASE * (1.0 / near - 1.0 / far)
    assert np.abs(hidden.sum(axis=1) / FINE - strip).max() <= 1.0 / FINE
    assert strip * FINE > 3.0
    edge = 24.0 + focal(1) * (0.037 + (-0.31 if eye == "left" else 0.31)) / near  # of the board, base pixels
    across = (np.flatnonzero(hidden[0]) + 0.5) / FINE
    span = (edge - strip, edge) if eye == "left" else (edge, edge + strip)
    assert (across > span[0] - 1 / FINE).all() and (across < span[1] + 1 / FINE).all()


def room():
    """Boxes at general places, lit by a lamp."""
    b = SceneBuilder()
    matte = b.material(metallic=0.0, roughness=0.4)
    b.node(mesh=b.mesh(box((3.1, 1.7, 4.3), inside=True, material=matte)))
    boxes = ((0.43, -0.31, -1.9, 25.0, 0.41), (-0.71, 0.23, -1.1, -40.0, 0.29), (1.3, 0.1, -3.0, 10.0, 0.6))
    for x, y, z, turn, size in boxes:
        b.node(mesh=b.mesh(box((size,) * 3, material=matte)), translation=(x, y, z), rotation=turn_y(turn))
    b.light(translation=(0.9, 1.3, -0.4), intensity=30.0)
    camera = b.camera(translation=(0.11, 0.07, 0.9), yfov=YFOV, znear=0.05, zfar=100.0)
    b.animate(camera, "translation", [0, 1], [(0.11, 0.07, 0.9), (0.5, 0.07, 0.9)])
    return b.build()


def test_both_eyes_see_the_same_time():
    """A board that moves has history in the other eye, with either reprojection; a lamp has the same light."""
    camera, motion = (only_pair(boards(1.0, 3.0, moves=True), fps=4.0, reprojection=r) for r in ("camera", "motion"))
    assert np.array_equal(camera.mask, motion.mask) and np.array_equal(camera.motion, motion.motion)
    still = only_pair(boards(1.0, 3.0, at=0.15), fps=4.0)
    assert (still.mask == camera.mask).mean() > 0.99  # 0.3 m in 0.5 s, seen after 0.25 s
    frame = only_pair(boards(1.0, 3.0, moves=True), fps=4.0, history="frame")
    moved = (frame.mask & np.uint32(Reason.POSITION)) != 0
    assert moved.sum() > 2 * ((camera.mask & np.uint32(Reason.POSITION)) != 0).sum()


def test_a_camera_of_the_file_is_the_same_eye():
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(0.5, 0.5)), translation=(0.1, 0.0, -2.0))
    b.node(mesh=b.mesh(quad(50.0, 50.0)), translation=(0.0, 0.0, -9.0))
    turn = turn_x(-3.0)
    b.camera(yfov=YFOV, znear=0.05, rotation=turn, name="left")
    right = b.camera(translation=(0.1, 0.0, 0.0), yfov=YFOV, znear=0.05, rotation=turn, name="right")
    b.animate(right, "translation", [0.0, 1.0], [(0.1, 0.0, 0.0)] * 2)
    scene = b.build()
    named, apart = only_pair(scene, other_eye="right"), only_pair(scene, camera=0, eyes=0.1)
    assert np.array_equal(named.mask, apart.mask) and (named.mask != 0).any()
    with pytest.raises(SettingsError, match="which is the camera"):
        only_pair(scene, other_eye="left")
    with pytest.raises(SettingsError):
        only_pair(scene, other_eye="middle")


@pytest.mark.parametrize(
    "wrong",
    [{"eyes": -0.064}, {"eyes": float("nan")}, {"convergence": 0.0}, {"history": "both", "exact": True},
     {"history": "both", "samples_per_pixel": 4}],
)  # fmt: skip
def test_settings_that_are_no_eyes(wrong):
    with pytest.raises(SettingsError) as raised:
        fixed_settings(**wrong)
    assert raised.value.setting in wrong


@pytest.mark.parametrize(
    "light",
    [{"light": "raster", "indirect": "none"}, pytest.param({"light": "path-traced", "spp": 4}, marks=pytest.mark.long)],
)
def test_both_is_the_better_history_of_every_pixel(light):
    more = {"columns": (*GEOMETRIC, "direct", "color"), "fps": 2.0, **light}
    frame, eye, both = (only_pair(room(), history=kind, **more) for kind in ("frame", "eye", "both"))
    assert np.array_equal(both.mask, np.where(both.uses_other_eye, eye.mask, frame.mask))
    for rate, bits in RATE_BITS.items():
        free = [(pair.mask & np.uint32(bits)) == 0 for pair in (frame, eye, both)]
        assert np.array_equal(free[2], free[0] | free[1]), rate
        assert max(free[0].sum(), free[1].sum()) < free[2].sum()
    assert both.row["reusable_surface"] == np.count_nonzero(
        both.mask & np.uint32(RATE_BITS["surface"] | Reason.SKY) == 0
    )
    run = evaluate_scene(room(), settings(history="both", **more))
    position = run.summary["curves"]["position"]
    at = np.searchsorted(position["edges"], 32 / 255) - 1
    assert position["at_or_above"][at + 1] <= both.row["position"] <= position["at_or_above"][at]


def test_better_takes_every_reason_word():
    words = np.array(
        [0, Reason.SKY, Reason.COLOR, Reason.DIRECT, Reason.POSITION, Reason.NORMAL, Reason.OUTSIDE, Reason.FIRST]
    )
    rank = np.array([0, 0, 0, 1, 2, 2, 3, 3])
    assert np.array_equal(uses_other_eye(words[:, None], words[None]), rank[None] < rank[:, None])


def test_decisions_of_two_histories_are_those_of_the_better_one_and_of_the_rarer_audit():
    sky, out, lit = int(Reason.SKY | Reason.HISTORY_SKY), int(Reason.OUTSIDE), int(Reason.DIRECT)
    words = np.array([[0, 0, 0, out, sky]], np.uint32), np.array([[0, 0, out, 0, sky]], np.uint32)
    surface = np.array([[True] * 4 + [False]])
    none = np.zeros((1, 5, 2))
    both = [PreviewPair(1, w, {"direct": np.full((1, 5), 9.0)}, none, (surface, surface), None, None) for w in words]
    traced = [np.flatnonzero(pair.traced[0]) for pair in both]
    assert [t.tolist() for t in traced] == [[0, 1, 2], [0, 1, 3]]

    def found(end, first, audited, undecided, half_words):
        distances, ones = {"direct": np.array([1.0, 2.0, 3.0])}, 64 * np.ones(3, np.int64)
        halves = np.array(half_words, np.uint32), {"direct": np.array([[1.0, 1.5], [2.0, 2.5], [3.0, 3.5]])}
        masks = (PixelMasks(np.array(words, np.uint32), distances, *halves) for words in (first, end))
        return Decisions(*masks, np.zeros(3), ones, ones, np.array(undecided), np.array(audited))

    halves = [[lit, lit], [lit, lit], [lit, 0]]
    frame = found([lit, 0, 0], [lit, lit, 0], [0.1, 0.02, 0.0], [False, False, True], halves)
    eye = found([0, lit, lit], [lit, lit, lit], [0.02, 0.1, 0.1], [False, False, False], [[lit, lit]] * 3)
    rows = np.zeros(5, np.int64), np.arange(5)
    got = merge_histories(both, (frame, eye), traced, rows)
    assert got.end.words.tolist() == [0, 0, 0, lit, sky] and got.first.words.tolist() == [lit, lit, 0, lit, sky]
    assert got.first.half_words.tolist() == [[lit, lit], [lit, lit], [lit, 0], [lit, lit], [sky, sky]]
    of_halves = [[1.0, 1.5], [2.0, 2.5], [3.0, 3.5], [3.0, 3.5], [9.0, 9.0]]
    assert got.first.half_distances["direct"].tolist() == of_halves
    assert got.audited.tolist() == [0.02, 0.02, 0.0, 0.1, 0.0]
    assert got.undecided.tolist() == [False, False, True, False, False]
    assert got.end.distances["direct"].tolist() == [1.0, 2.0, 3.0, 3.0, 9.0]
    assert got.samples.tolist() == [128, 128, 64, 64, 0]


def test_exact_reasons_of_the_other_eye_have_no_change_of_light():
    """A moving lamp brightens a matte room since the last frame, and nothing between the eyes."""
    chosen = settings(
        columns=(*GEOMETRIC, "direct"), exact=True, fps=1.0, size=(48, 27), light="raster", indirect="none",
        shadow_lights=0,
    )  # fmt: skip
    frame, eye = (
        evaluate_scene(matte_room((0.7, 1.0, 0.0)), chosen.replace(history=h)).frames[0] for h in ("frame", "eye")
    )
    assert frame["brightened"] > 100 and frame["occluded"] == 0
    assert eye["brightened"] == eye["darkened"] == eye["view_dependent"] == 0 < eye["occluded"]
    assert eye["exact_new"] == 0 < eye["exact_outside"]


@pytest.mark.parametrize("jitter", [(0.0, 0.0), (0.25, -0.4)])
def test_rays_of_an_off_axis_image_are_those_that_its_projection_inverts(jitter):
    """Sky directions, and with it the sky's motion: far points of both eyes differ by -f b / c pixels."""
    camera, state = choose_camera(boards(2.0)), Poser(boards(2.0)).sample(0.0)
    view = camera.view_at(state)
    other = replace(
        other_eye(boards(2.0), camera, settings(convergence=1.5)).view_at(state), jitter_px=np.array(jitter)
    )
    corner, dx, dy = sky_directions(other, 96, 54)
    for column, row in ((0, 0), (95, 53), (17, 40)):
        clip = other.clip_from_relative(96, 54) @ np.append(corner + column * dx + row * dy, 0.0)
        pixel = 0.5 * np.array([96, 54]) * (clip[:2] / clip[3] + 1.0) - 0.5
        np.testing.assert_allclose(pixel, [column, row], atol=1e-9)
    far = np.array([3.0, 2.0, -1e9])
    at = [
        0.5 * 96 * (m @ np.append(far, 1.0))[0] / (m @ np.append(far, 1.0))[3]
        for m in (v.centered().clip_from_relative(96, 54, np.zeros(3)) for v in (other, view))
    ]
    assert at[0] - at[1] == pytest.approx(focal(54) * BASE / 1.5, abs=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("history", ["eye", "both"])
def test_sampled_light_estimates_what_every_decided_pixel_says(history):
    how = {"history": history, "size": (48, 27), "frames": (0, 3), "columns": COLUMNS, "pairs": "all", "camera": None}
    sampled = evaluate_scene(
        ASSETS / "demo.glb", fixed_settings(light="auto", light_within=3.0, **how), sampled=True
    ).summary
    decided = evaluate_scene(ASSETS / "demo.glb", fixed_settings(light="path-traced", **how), sampled=True).summary
    for column in ("color", "direct", "indirect"):
        low, high = sampled["discard"][column]["interval95_percent"]
        assert low <= decided["discard"][column]["mean_percent"] <= high, column
    low, high = sampled["reusable"]["shading"]["interval95_percent"]
    assert low <= decided["reusable"]["shading"]["mean_percent"] <= high
    for column in ("frustum", "position", "normal"):
        assert sampled["discard"][column]["mean_percent"] == decided["discard"][column]["mean_percent"]
