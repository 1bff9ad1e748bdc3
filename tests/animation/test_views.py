"""Cameras of the file and the framing orbit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from made_scenes import make_channel, make_scene, triangle_mesh
from scipy.spatial import ConvexHull

from taubench_gl.animation import (
    FileCamera,
    OrbitCamera,
    Poser,
    bounding_sphere,
    camera_of_run,
    choose_camera,
    is_still,
    pose_vertices,
    sample,
    views,
)
from taubench_gl.errors import SettingsError
from taubench_gl.scene.model import Camera, Mesh, Primitive
from taubench_gl.settings import SequenceSettings

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
    assert isinstance(choose_camera(scene), OrbitCamera) and choose_camera(scene).reason == views.NO_CAMERA
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


def projected(scene, orbit, size, times):
    """Smallest and largest image coordinates, in [-1, 1], and depths of all vertices at ``times``."""
    poser, seen = Poser(scene), []
    for t in times:
        state = poser.sample(t)
        view = orbit.view_at(state)
        assert is_rotation(view.world_from_view)
        for node in scene.mesh_nodes.tolist():
            for primitive in scene.meshes[scene.nodes.mesh[node]].primitives:
                pos = pose_vertices(scene, state, node, primitive) - view.position
                clip = np.append(pos, np.ones((len(pos), 1)), axis=1) @ view.clip_from_relative(*size).T
                assert np.all(clip[:, 3] > view.camera.znear)
                seen.append(clip[:, :3] / clip[:, 3:])
    seen = np.concatenate(seen)
    return seen.min(axis=0), seen.max(axis=0)


@pytest.mark.parametrize("offset", [(0, 0, 0), (1e6, -1e5, 3e6)])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(("image", "tight"), [((640, 480), 0), ((1920, 1080), 1), ((100, 400), 0), ((64, 1), 1)])
def test_orbit_fills_95_percent_of_the_tighter_side(offset, size, image, tight):
    scene = orbit_scene(offset, size)
    orbit = OrbitCamera(scene, size=image)
    low, high = projected(scene, orbit, image, orbit.times)
    assert np.all(low[:2] >= -0.95 - 1e-5) and np.all(high[:2] <= 0.95 + 1e-5) and low[2] > 0 and high[2] < 1
    assert (low[tight], high[tight]) == pytest.approx((-0.95, 0.95), abs=1e-5)


def test_orbit_frames_the_whole_animation():
    """The subject moves and deforms while the camera moves."""
    channels = [
        make_channel(0, "translation", [0, 1.5], [[0, 0, 0], [4, 3, -2]]),
        make_channel(1, "scale", [0, 1.5], [[1, 1, 1], [1, 5, 1]]),
    ]
    scene = orbit_scene(channels=channels)
    orbit = OrbitCamera(scene, size=(400, 300))
    assert orbit.duration == 1.5
    low, high = projected(scene, orbit, (400, 300), orbit.times)
    assert max(np.abs(low[:2]).max(), high[:2].max()) == pytest.approx(0.95, abs=1e-9)
    assert max((high - low)[:2]) == pytest.approx(1.9, abs=1e-9)
    low, high = projected(scene, orbit, (400, 300), np.linspace(0, 1.5, 200))
    assert max(np.abs(low[:2]).max(), high[:2].max()) < 0.96


def test_orbit_follows_a_subject_that_travels():
    """A triangle that walks 60 sizes far in three seconds, up and down at each step, then stands."""
    times = np.linspace(0.0, 6.0, 145)
    path = np.stack([20.0 * np.minimum(times, 3.0), 0.1 * np.sin(20.0 * times), -10.0 * np.minimum(times, 3.0)], axis=1)
    scene = make_scene([-1], meshes=[triangle_mesh()], mesh=[0], channels=[make_channel(0, "translation", times, path)])
    orbit = OrbitCamera(scene, size=(16, 9))
    low, high = projected(scene, orbit, (16, 9), orbit.times)
    assert max(np.abs(low[:2]).max(), high[:2].max()) == pytest.approx(0.95, abs=1e-9)
    poser = Poser(scene)
    views = [orbit.view_at(poser.sample(t)) for t in np.arange(0.0, 6.0, 1 / 24)]
    seen = [poser.sample(t).world[0][:3, 3] - view.position for t, view in zip(np.arange(0.0, 6.0, 1 / 24), views)]
    assert max(np.linalg.norm(seen, axis=1)) < 30.0  # the whole path is 67 long
    steps = np.diff([view.position for view in views], axis=0)
    assert np.abs(np.diff(steps[2:-2, 1])).max() < 0.02  # the steps of the subject do not shake the camera


def box_scene(inwards: bool, **fields):
    """A box of 8 x 3 x 6 whose faces look inwards or outwards."""
    corners = np.array(np.meshgrid((-4, 4), (0, 3), (-3, 3), indexing="ij"), dtype=np.float32).reshape(3, 8).T
    hull = ConvexHull(corners)
    triangles = hull.simplices.astype(np.uint32)
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) > 0
    triangles[outward == inwards] = triangles[outward == inwards][:, ::-1]
    return make_scene([-1], meshes=[Mesh("box", (Primitive(corners, triangles),))], mesh=[0], **fields)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("inwards", [False, True])
def test_orbit_stands_inside_a_room_and_outside_a_box(inwards, mirrored):
    scene = box_scene(inwards, scale=[(-2.0 if mirrored else 2.0, 2.0, 2.0)])
    orbit, poser = OrbitCamera(scene), Poser(scene)
    path = np.array([orbit.view_at(poser.sample(t)).position for t in np.linspace(0.0, orbit.period, 100)])
    inside = np.all((path > (-8, 0, -6)) & (path < (8, 6, 6)), axis=1)
    assert np.all(inside == inwards)
    if inwards:
        assert np.allclose(np.hypot(path[:, 0], path[:, 2]), 0.8 * 6.0, rtol=0.05)
        step = orbit.view_at(poser.sample(1 / 24)).position - path[0]
        assert np.linalg.norm(step) == pytest.approx(orbit.step)


@pytest.mark.parametrize("scale", [(1, 1, 1), (10, 1, 1), (1, 10, 1), (1, 0.1, 10)])
def test_orbit_moves_by_a_share_of_the_subject_per_frame(scale):
    scene = make_scene([-1], meshes=[triangle_mesh()], mesh=[0], scale=[scale])
    orbit, poser = OrbitCamera(scene), Poser(scene)
    corners = pose_vertices(scene, poser.sample(0), 0, scene.meshes[0].primitives[0])
    assert orbit.subject_size == pytest.approx(np.linalg.norm(np.ptp(corners, axis=0)))
    assert orbit.step == pytest.approx(0.02 * orbit.subject_size)
    path = np.array([orbit.view_at(poser.sample(i / 24)).position for i in range(49)])
    assert np.allclose(np.linalg.norm(np.diff(path, axis=0), axis=1), orbit.step, rtol=1e-9)


def test_orbit_is_periodic_about_the_vertical_axis_without_roll():
    scene = orbit_scene()
    orbit, poser = OrbitCamera(scene), Poser(scene)
    start, quarter, whole = (orbit.view_at(poser.sample(t)) for t in (0, orbit.period / 4, orbit.period))
    assert np.array_equal(start.position, whole.position)
    assert np.array_equal(start.world_from_view, whole.world_from_view)
    towards, later = start.position - orbit.center, quarter.position - orbit.center
    assert np.allclose(later, [towards[2], towards[1], -towards[0]])
    assert towards[2] > 0 and towards[1] > 0
    assert abs(start.world_from_view[1, 0]) < 1e-15  # no roll


def test_orbit_is_always_accepted():
    orbit = choose_camera(camera_scene(), "orbit")
    assert isinstance(orbit, OrbitCamera) and orbit.reason == views.REQUESTED
    assert isinstance(choose_camera(orbit_scene(), "orbit"), OrbitCamera)


MOVES = {
    "camera": make_channel(1, "translation", [0, 1], [[0, 0, 0], [2, 0, 0]]),
    "parent of the camera": make_channel(0, "rotation", [0, 1], [[0, 0, 0, 1], HALF_Y]),
    "field of view": make_channel(0, "yfov", [0, 1], [[0.6], [0.8]], target="camera"),
    "object": make_channel(4, "translation", [0, 1], [[0, 0, 0], [2, 0, 0]]),
    "visibility": make_channel(4, "visible", [0, 1], [[1], [0]], "STEP"),
    "tangents": make_channel(4, "scale", [0, 1], np.array([np.zeros((3, 3)), np.ones((3, 3))]), "CUBICSPLINE"),
}
NOTHING_MOVES = {
    "no animation": (),
    "equal keys": (make_channel(1, "translation", [0, 1], [[1, 0, 0], [1, 0, 0]]),),
    "one key": (make_channel(1, "translation", [0.5], [[1, 0, 0]]),),
    "a node without content": (make_channel(3, "translation", [0, 1], [[0, 0, 0], [2, 0, 0]]),),
    "another camera": (make_channel(2, "translation", [0, 1], [[0, 0, 0], [2, 0, 0]]),),
}


def scene_with_camera(*channels):
    return make_scene(
        [-1, 0, -1, -1, -1], cameras=[Camera("Main", yfov=0.6), Camera("other")], camera=[-1, 0, 1, -1, -1],
        meshes=[triangle_mesh()], mesh=[-1, -1, -1, -1, 0], channels=list(channels),
    )  # fmt: skip


@pytest.mark.parametrize("name", MOVES)
def test_an_animated_scene_keeps_the_camera_of_its_file(name):
    scene = scene_with_camera(MOVES[name])
    assert not is_still(scene, [1])
    assert camera_of_run(scene, SequenceSettings()).node == 1


@pytest.mark.parametrize("name", NOTHING_MOVES)
def test_a_still_scene_gets_an_orbit_unless_a_camera_is_requested(name):
    scene = scene_with_camera(*NOTHING_MOVES[name])
    orbit = camera_of_run(scene, SequenceSettings(width=300, height=400))
    assert isinstance(orbit, OrbitCamera) and orbit.reason == views.ALL_STILL and orbit.duration == 2.0
    assert np.array_equal(orbit.view_at(sample(scene, 0.3)).position,
                          OrbitCamera(scene, size=(300, 400)).view_at(sample(scene, 0.3)).position)  # fmt: skip
    assert camera_of_run(scene, SequenceSettings(camera="Main")).node == 1
    assert camera_of_run(scene, SequenceSettings(camera=0)).node == 1


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
