"""Cameras that people move, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taubench_gl.animation import View
from taubench_gl.scene.model import Camera
from taubench_gl.viewer.cameras import MAX_PITCH, UserCamera, angles, frustum_lines, rotation

LENS = Camera(name="lens", yfov=math.radians(50.0), znear=0.1, zfar=100.0)


def user(position=(0.0, 1.0, 5.0)) -> UserCamera:
    return UserCamera(View(np.array(position), np.eye(3), LENS), np.array([0.0, 1.0, 0.0]), 2.0)


@pytest.mark.parametrize(("yaw", "pitch"), [(0.0, 0.0), (1.0, 0.5), (-3.0, -1.2), (2.5, 1.5)])
def test_angles_undo_the_rotation(yaw, pitch):
    r = rotation(yaw, pitch)
    assert np.allclose(r @ r.T, np.eye(3)) and np.isclose(np.linalg.det(r), 1.0)
    assert np.allclose(angles(r), (yaw, pitch))


def test_roll_is_left_out():
    roll = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.allclose(angles(rotation(0.4, 0.3) @ roll), (0.4, 0.3))


@pytest.mark.parametrize(
    ("key", "direction"),
    [("W", (0, 0, -1)), ("S", (0, 0, 1)), ("A", (-1, 0, 0)), ("D", (1, 0, 0)), ("Q", (0, -1, 0)), ("E", (0, 1, 0))],
)
def test_flying(key, direction):
    slow, fast = user(), user()
    slow.move({key}, 0.1, "fly")
    fast.move({key, "SHIFT"}, 0.1, "fly")
    moved = slow.position - (0, 1, 5)
    assert np.allclose(moved / np.linalg.norm(moved), direction)
    assert np.allclose(fast.position - (0, 1, 5), 5 * moved)


def test_flying_goes_where_one_looks():
    camera = user()
    camera.move({"J"}, math.radians(90) / math.radians(75), "fly")  # a quarter turn to the left
    camera.move({"W"}, 0.1, "fly")
    assert camera.position[0] < 0 and np.isclose(camera.position[2], 5.0)


def test_the_mouse_turns_the_way_it_moves():
    camera = user()
    camera.look(10, 20)
    forward = -rotation(camera.yaw, camera.pitch)[:, 2]
    assert forward[0] > 0 and forward[1] < 0
    camera.look(0, 1e5)
    assert camera.pitch == -MAX_PITCH


@pytest.mark.parametrize("drag", [(40, 0), (0, 60), (-30, 25)])
def test_an_orbit_keeps_centre_and_distance(drag):
    camera = user()
    camera.turn_about(*drag)
    view = camera.view()
    towards = np.array([0.0, 1.0, 0.0]) - view.position
    assert np.isclose(np.linalg.norm(towards), 5.0)
    assert np.allclose(-view.world_from_view[:, 2], towards / 5.0)
    assert not np.allclose(view.position, (0, 1, 5))


def test_zoom_never_passes_the_centre():
    camera = user()
    camera.zoom(1.0)
    assert np.isclose(camera.position[2], 4.5)
    camera.zoom(1000.0)
    assert camera.position[2] > 0


def test_frustum_lines_end_in_the_corners_of_clip_space():
    view = View(np.array([3.0, 1.0, 2.0]), rotation(0.7, -0.2), LENS)
    points = frustum_lines(view, 16 / 9, 30.0)
    assert points.shape == (24, 3)
    clip = np.c_[points - view.position, np.ones(24)] @ view.clip_from_relative(160, 90).T
    assert np.allclose(np.abs(clip[:, :2] / clip[:, 3:]), 1.0)
    assert np.allclose(sorted(set(np.round(clip[:, 3], 6))), [0.1, 30.0])
