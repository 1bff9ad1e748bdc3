"""Exact visibility against closed forms: a board before a wall, a turning cube, a swinging arm, what appears."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frame_tools import FormulaCamera, make_scene, quad, rotation_about, still_camera
from scipy.spatial.transform import Rotation
from sight_tools import look, surely

from taubench_gl.conventions import Visibility
from taubench_gl.scene.builder import SceneBuilder, box, morphed
from taubench_gl.scene.model import Camera, Channel

BOARD, WALL, HALF, STEP = 2.0, 5.0, 0.4, 0.35
"""Depths of board and wall, half the board's width, and how far the camera moves to the right: meters."""

LENS = Camera(yfov=np.radians(60.0), znear=0.1, zfar=100.0)


def board_and_wall():
    board = quad((-HALF, -9, -BOARD), (2 * HALF, 0, 0), (0, 18, 0))
    wall = quad((-30, -30, -WALL), (60, 0, 0), (0, 60, 0))
    return make_scene(board, wall)


def sideways(step=STEP, fps=24.0):
    return FormulaCamera(LENS, lambda t: ((step * t * fps, 0.0, 0.0), np.eye(3)))


def edges_in_pixels(x_wall, size):
    """Wall points at ``x_wall``, seen by the current camera at x = STEP, as pixel-index coordinates."""
    scale = size[1] / 2 / np.tan(LENS.yfov / 2)
    return (np.asarray(x_wall) - STEP) / WALL * scale + (size[0] - 1) / 2


@pytest.mark.parametrize("size", [(96, 54), (97, 31), (320, 60)])
def test_the_strip_behind_a_board_is_exact(gpu, size):
    """The previous camera at 0 saw the wall but for [-a, a] WALL / BOARD; the board hides part of that from both."""
    sight = look(gpu, board_and_wall(), sideways(), size)
    low, high = edges_in_pixels([-HALF * WALL / BOARD, HALF * WALL / BOARD], size)
    x = np.arange(size[0])
    wall = sight.channels["position"][..., 3] > 0.5 * (BOARD + WALL)
    on_edge = np.minimum(np.abs(x - low), np.abs(x - high)) < 1 / 32
    hidden = np.broadcast_to((x > low) & (x < high), wall.shape)
    at = STEP / WALL * size[1] / 2 / np.tan(LENS.yfov / 2)  # a wall point's motion, pixels
    inside = np.broadcast_to(x + at <= size[0] - 1, wall.shape)
    check = wall & ~on_edge
    expected = np.where(~inside, Visibility.OUTSIDE, np.where(hidden, Visibility.OCCLUDED, Visibility.VISIBLE))
    np.testing.assert_array_equal(sight.kind[check], expected[check])
    assert (sight.kind[check] == Visibility.OCCLUDED).sum() > 0.015 * wall.sum()
    board = ~wall & np.broadcast_to(x + STEP / BOARD * WALL * at / STEP < size[0] - 2, wall.shape)
    assert (sight.kind[board] == Visibility.VISIBLE).all()


def test_the_mask_does_not_depend_on_the_resolution(gpu):
    """Pixel centers of an image are those of every third pixel of one three times as large: the same answers there."""
    low, high = (look(gpu, board_and_wall(), sideways(), size).bits for size in ((63, 35), (189, 105)))
    same = high[1::3, 1::3]
    # The last pixel center of Eq. (3) lies a third of a pixel farther out in the larger image.
    inside = low != Visibility.OUTSIDE
    np.testing.assert_array_equal(low[inside], same[inside])
    assert len(np.unique(low[inside])) == 2 and (same == Visibility.OUTSIDE).sum() >= (~inside).sum() - len(low)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("morphing", [False, True])
def test_a_board_seen_from_its_undrawn_back_hides_nothing(gpu, mirrored, morphing):
    """The rasterizer does not draw a board that faces away, so the previous camera saw through it.

    A mirror turns the triangles over, and with them which side is drawn: the board faces away under it too.
    """
    board = quad((HALF, -9, -BOARD), (-2 * HALF, 0, 0), (0, 18, 0))
    wall = quad((-30, -30, -WALL), (60, 0, 0), (0, 60, 0))
    for double_sided in (False, True):
        b = SceneBuilder()
        material = b.material(double_sided=double_sided)
        shown = [replace(primitive, material=material) for primitive in (board, wall)]
        if morphing:
            shown[0] = morphed(shown[0], np.zeros_like(board.positions))
        node = b.node(mesh=b.mesh(shown[0], weights=(0.0,) * morphing), scale=(1.0 - 2.0 * mirrored, 1.0, 1.0))
        b.node(mesh=b.mesh(shown[1]))
        if morphing:
            b.animate(node, "weights", [0.0, 1.0], [(0.0,), (1.0,)])
        sight = look(gpu, b.build(), sideways(), (96, 54))
        assert (sight.kind == Visibility.OCCLUDED).any() == double_sided


@pytest.mark.parametrize("degrees", [10.0, 60.0, 80.0])
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_faces_of_a_turning_cube(gpu, degrees, mirrored):
    """A convex body hides its own point exactly if the point's face was turned away."""
    turn = np.radians(degrees)
    b = SceneBuilder()
    cube = b.node(mesh=b.mesh(box((0.5, 0.5, 0.5))), scale=(-1.0 if mirrored else 1.0, 1.0, 1.0))
    times = [0.0, 1 / 24]
    start = 0.9
    angles = [start, start + turn]
    b.animate(cube, "rotation", times, [(0.0, np.sin(a / 2), 0.0, np.cos(a / 2)) for a in angles])
    eye = np.array([0.0, 0.8, 3.0])
    pitch = -np.arctan2(0.8, 3.0)
    camera = still_camera(LENS, eye, rotation_about("x", np.degrees(pitch)))
    sight = look(gpu, b.build(), camera, (120, 80))
    drawn = sight.channels["position"][..., 3] > 0
    world = sight.channels["position"][drawn][:, :3] + eye
    local = world @ rotation_about("y", np.degrees(angles[1]))  # object <- world is the transpose
    axis = np.argmax(np.abs(local), axis=1)
    clear = np.sort(np.abs(local), axis=1)[:, 1] < 0.5 - 2e-3  # away from the cube's edges
    normal = np.zeros_like(local)
    normal[np.arange(len(local)), axis] = np.sign(local[np.arange(len(local)), axis])
    back = rotation_about("y", np.degrees(angles[0]))
    facing = np.sum((normal @ back.T) * (eye - local @ back.T), axis=1)
    clear &= np.abs(facing) > 1e-3
    seen = sight.kind[drawn] == Visibility.VISIBLE
    np.testing.assert_array_equal(seen[clear], facing[clear] > 0)
    assert seen.any() and (degrees < 60 or (~seen).any())


def arm():
    """A skinned bar before a wall: its upper joint swings, so the bar uncovers wall and covers other wall."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad((-9, -9, -6), (18, 0, 0), (0, 18, 0))))
    root = b.node(translation=(0.0, -1.0, -3.0))
    upper = b.node(root, translation=(0.0, 1.0, 0.0))
    bar = box((0.15, 1.0, 0.15), cells=2)
    weight = np.clip(bar.positions[:, 1], 0.0, 1.0)  # the upper half follows the upper joint
    joints = np.tile(np.uint16([0, 1, 0, 0]), (len(weight), 1))
    weights = np.stack([1 - weight, weight, 0 * weight, 0 * weight], axis=-1).astype(np.float32)
    bar = replace(bar, joints=joints, weights=weights)
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[0, 1, 3] = 1.0  # joint 0 is at the bar's lower end, joint 1 in its middle
    node = b.node(mesh=b.mesh(bar), skin=b.skin([root, upper], inverse))
    assert node >= 0
    angle = 0.6
    b.animate(upper, "rotation", [0.0, 1 / 24], [(0, 0, 0, 1), (0, 0, np.sin(angle / 2), np.cos(angle / 2))])
    return b.build()


def test_a_swinging_skinned_arm(gpu):
    """Points of the wall are hidden where the arm was; the float64 caster says where."""
    sight = look(gpu, arm(), still_camera(LENS), (80, 45))
    expected, sure = surely(sight)
    found = sight.bits & ~np.uint32(Visibility.MOVED)
    assert sure.mean() > 0.93
    np.testing.assert_array_equal(found[sure], expected[sure])
    wall = sight.channels["position"][..., 3] > 5
    assert 25 < (wall & (sight.kind == Visibility.OCCLUDED)).sum() < 2000
    moved = (sight.bits & Visibility.MOVED) != 0
    assert moved.any() and not (moved & wall).any()


@pytest.mark.parametrize("own", [0, 1, 2])
@pytest.mark.parametrize("world", [0, 1, 2])
def test_a_turning_plate_never_hides_itself(gpu, own, world):
    """A plate in any plane of its own space, and close to any of the world, turns in its plane.  Pixels of 0.04 degrees
    see it at a tenth to one degree: a ray ends so close to the plane that rounding decides on which side."""
    aside = Rotation.from_rotvec(np.roll([0.0, 0.3, -0.4], world)).as_matrix()
    turned = aside @ np.roll(np.eye(3), world - own, axis=0)  # takes axis ``own`` close to axis ``world``
    along, across = aside @ np.eye(3)[(world + 1) % 3], aside @ np.eye(3)[world]
    u, v = 10 * np.eye(3)[(own + 1) % 3], 10 * np.eye(3)[(own + 2) % 3]
    b = SceneBuilder()
    plate = b.node(mesh=b.mesh(quad(-0.5 * (u + v), u, v)))
    turns = [Rotation.from_matrix(turned) * Rotation.from_rotvec(angle * np.eye(3)[own]) for angle in (0.4, 0.5)]
    b.animate(plate, "rotation", [0.0, 1 / 24], [turn.as_quat() for turn in turns])
    axes = np.stack([np.cross(along, across), across, -along], axis=-1)
    lens = replace(LENS, yfov=np.radians(2.0))
    camera = still_camera(lens, 0.02 * across - 6.0 * along, axes)
    sight = look(gpu, b.build(), camera, (96, 54))
    drawn = sight.channels["position"][..., 3] > 0
    assert drawn.sum() > 500 and not (sight.kind[drawn] == Visibility.OCCLUDED).any()
    assert ((sight.bits[drawn] & Visibility.MOVED) != 0).any()


def test_what_was_not_there_is_new(gpu):
    """An object that appears between the frames has no history; what it uncovers when it vanishes was hidden."""
    board = quad((-1, -1, -2), (2, 0, 0), (0, 2, 0))
    wall = quad((-30, -30, -WALL), (60, 0, 0), (0, 60, 0))

    def scene(visible):
        channel = Channel("node", 1, "visible", "STEP", np.array([0.0, 1 / 24]), np.array([[not visible], [visible]]))
        return make_scene(board, wall, channels=(channel,))

    appears, vanishes = (look(gpu, scene(v), still_camera(LENS), (64, 36)) for v in (1.0, 0.0))
    board_now = appears.channels["position"][..., 3] < 3
    assert (appears.kind[board_now] == Visibility.NEW).all() and board_now.any()
    assert (appears.kind[~board_now] == Visibility.VISIBLE).all()
    assert (vanishes.kind[board_now] == Visibility.OCCLUDED).all()
    assert (vanishes.kind[~board_now] == Visibility.VISIBLE).all()


def test_a_still_frame_is_visible_everywhere(gpu):
    sight = look(gpu, board_and_wall(), still_camera(LENS, (0.3, 0.2, 0.0)), (96, 54))
    assert (sight.bits == Visibility.VISIBLE).all()
    for origin in (1e3, 1e6):
        scene = make_scene(*(m.primitives[0] for m in board_and_wall().meshes), origin=(origin, origin, origin))
        camera = still_camera(LENS, (origin + 0.3, origin + 0.2, origin))
        assert (look(gpu, scene, camera, (96, 54)).bits == Visibility.VISIBLE).all()


def test_sky_is_seen_past_what_has_left(gpu):
    """Sky beside a board that the camera passes: hidden where the board was, in closed form for directions."""
    size = (96, 54)
    board = quad((-HALF, -9, -BOARD), (2 * HALF, 0, 0), (0, 18, 0))
    sight = look(gpu, make_scene(board), sideways(), size)
    sky = sight.channels["position"][..., 3] == 0
    x = np.arange(size[0])
    scale = size[1] / 2 / np.tan(LENS.yfov / 2)
    edges = [side * HALF / BOARD * scale + (size[0] - 1) / 2 for side in (-1, 1)]
    hidden = np.broadcast_to((x > edges[0]) & (x < edges[1]), sky.shape)
    clear = sky & (np.min([np.abs(x - e) for e in edges], axis=0) > 1e-3)
    np.testing.assert_array_equal(sight.kind[clear] == Visibility.OCCLUDED, hidden[clear])
    assert (sight.bits[sky] & Visibility.SKY).all() and (sky & hidden).any()
