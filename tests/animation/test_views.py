"""Cameras of the file and the framing orbit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_scenes import make_channel, make_scene, triangle_mesh
from pyrr import matrix44

from taubench_gl.animation import FileCamera, OrbitCamera, Poser, bounding_sphere, choose_camera, pose_vertices, sample
from taubench_gl.errors import SettingsError
from taubench_gl.scene.model import Camera, Mesh, Primitive

HALF_Y = [0, np.sin(np.pi / 4), 0, np.cos(np.pi / 4)]


def is_rotation(m):
    return np.allclose(m.T @ m, np.eye(3), atol=1e-14) and np.linalg.det(m) > 0


def camera_scene(**fields):
    cameras = [Camera("Main", yfov=0.6), Camera("")]
    return make_scene(
        [-1, 0, 0, -1], cameras=cameras, camera=[-1, 0, 1, 1], names=["root", "Camera_Orientation", "other", "gone"],
        in_scene=[1, 1, 1, 0], **fields,
    )  # fmt: skip


def test_choose_camera_by_name_index_and_default():
    scene = camera_scene()
    for requested, node in [(None, 1), ("Camera_Orientation", 1), ("Main", 1), ("other", 2), (0, 1), (1, 2), ("1", 2)]:
        assert choose_camera(scene, requested).node == node
    assert choose_camera(scene).describe() == "camera 'Main' (node 'Camera_Orientation')"
    assert choose_camera(scene, 1).describe() == "camera 'other' (node 'other')"


@pytest.mark.parametrize("requested", ["main", "gone", 2, -1, "2", "", "²"])
def test_error_for_unknown_cameras_lists_cameras(requested):
    with pytest.raises(SettingsError, match=r"Camera_Orientation.*other"):
        choose_camera(camera_scene(), requested)


def test_scene_without_cameras_gets_an_orbit():
    scene = make_scene([-1], meshes=[triangle_mesh()], mesh=[0])
    assert choose_camera(scene).describe() == "framing orbit (the scene has no camera)"
    with pytest.raises(SettingsError, match="no camera"):
        choose_camera(scene, "Main")


def test_file_camera_follows_its_node_and_parameters():
    channels = [
        make_channel(0, "translation", [0, 1], [[0, 0, 0], [2, 0, 0]]),
        make_channel(0, "yfov", [0, 1], [[0.6], [0.8]], target="camera"),
    ]
    scene = camera_scene(channels=channels, rotation=[HALF_Y] + [[0, 0, 0, 1]] * 3)
    view = FileCamera(scene, 1).view_at(sample(scene, 0.5))
    assert np.allclose(view.position, [1, 0, 0])
    assert np.allclose(-view.world_from_view[:, 2], [-1, 0, 0])  # +90 degrees about +Y: from -Z to -X
    assert view.camera.yfov == pytest.approx(0.7)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_scale_and_mirror_of_a_camera_node_are_ignored(seed):
    rng = np.random.default_rng(seed)
    scale = rng.uniform(0.1, 4, size=3) * rng.choice([-1, 1], size=3)
    scene = camera_scene(rotation=rng.normal(size=(4, 4)), scale=[[1, 1, 1], scale, [1, 1, 1], [1, 1, 1]])
    state = sample(scene, 0.0)
    view = FileCamera(scene, 1).view_at(state)
    assert is_rotation(view.world_from_view)
    looks = -state.world[1][:3, 2]
    assert np.allclose(-view.world_from_view[:, 2], looks / np.linalg.norm(looks))


def test_camera_with_scale_zero_has_a_view():
    scene = camera_scene(scale=[[0, 0, 0]] * 4)
    assert is_rotation(FileCamera(scene, 1).view_at(sample(scene, 0.0)).world_from_view)


# --- the framing orbit ---------------------------------------------------------------------------------------------


def orbit_scene(offset=(0.0, 0.0, 0.0), size=1.0, **fields):
    offset = np.array(offset)
    return make_scene(
        [-1, -1], meshes=[triangle_mesh()], mesh=[0, 0], translation=[offset, offset + np.array([3, 1, 2]) * size],
        scale=[[size] * 3] * 2, **fields,
    )  # fmt: skip


@pytest.mark.parametrize("offset", [(0, 0, 0), (1e6, -1e5, 3e6)])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_orbit_shows_every_vertex_at_all_times(offset, size):
    scene = orbit_scene(offset, size)
    orbit, poser = OrbitCamera(scene), Poser(scene)
    for t in np.linspace(0, orbit.period, 13):
        state = poser.sample(t)
        view = orbit.view_at(state)
        assert is_rotation(view.world_from_view)
        for node in (0, 1):
            pos = pose_vertices(scene, state, node, scene.meshes[0].primitives[0]) - view.position
            clip = np.append(pos, np.ones((3, 1)), axis=1) @ view.clip_from_relative(640, 480).T
            ndc = clip[:, :3] / clip[:, 3:]
            assert np.all(clip[:, 3] > view.camera.znear)
            assert np.all(np.abs(ndc[:, :2]) < 1) and np.all((ndc[:, 2] > 0) & (ndc[:, 2] < 1))


def test_orbit_is_periodic_and_looks_at_the_center():
    scene = orbit_scene()
    orbit, poser = OrbitCamera(scene), Poser(scene)
    start, quarter, whole = (orbit.view_at(poser.sample(t)) for t in (0, orbit.period / 4, orbit.period))
    assert np.array_equal(start.position, whole.position)
    assert np.array_equal(start.world_from_view, whole.world_from_view)
    towards = start.position - orbit.center
    assert towards[0] == 0 and towards[2] > 0
    assert np.allclose(quarter.position - orbit.center, [towards[2], towards[1], 0])
    assert np.allclose(-start.world_from_view[:, 2], -towards / np.linalg.norm(towards))
    assert abs(start.world_from_view[1, 0]) < 1e-15  # no roll


def test_pyrr_look_at_against_explicit_cross_products():
    eye = np.array([0.3, 0.4, -0.7])
    z = eye / np.linalg.norm(eye)
    x = np.cross([0, 1, 0], z)
    x /= np.linalg.norm(x)
    ours = np.stack([x, np.cross(z, x), z], axis=1)
    assert np.allclose(matrix44.create_look_at(eye, np.zeros(3), np.array([0.0, 1.0, 0.0]))[:3, :3], ours, atol=1e-15)


def test_bounds_cover_the_animation_without_hidden_nodes():
    channels = [make_channel(0, "translation", [0, 1], [[0, 0, 0], [10, 0, 0]])]
    scene = orbit_scene(channels=channels, visible=[1, 0])
    center, radius = bounding_sphere(Poser(scene), [0.0, 1.0])
    assert np.allclose(center, [5.5, 0.5, 0])
    assert radius == pytest.approx(math.hypot(5.5, 0.5))


def test_bounds_of_an_empty_scene_and_of_a_point():
    assert bounding_sphere(Poser(make_scene([])), [0.0])[1] == 1.0
    point = Primitive(np.full((3, 3), 2, np.float32), np.array([[0, 1, 2]], np.uint32))
    center, radius = bounding_sphere(Poser(make_scene([-1], meshes=[Mesh("p", (point,))], mesh=[0])), [0.0])
    assert center.tolist() == [2, 2, 2] and radius == 1.0
    assert np.isfinite(OrbitCamera(make_scene([])).view_at(sample(make_scene([]), 1.0)).position).all()


def test_bounds_cover_instances():
    places = np.tile(np.eye(4), (2, 1, 1))
    places[1, 0, 3] = 100
    scene = make_scene([-1], meshes=[triangle_mesh()], mesh=[0], instances={0: places})
    center, radius = bounding_sphere(Poser(scene), [0.0])
    assert np.allclose(center, [50.5, 0.5, 0]) and radius == pytest.approx(math.hypot(50.5, 0.5))
