"""Table 1 on scenes made in code, one cause of change at a time."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "animation"))
from made_scenes import make_channel, make_scene, triangle, triangle_mesh

from taubench_gl.effects.census import census
from taubench_gl.scene.model import Camera, Light, Mesh, MorphTarget, Primitive, Skin

TIMES = [0.0, 0.5, 1.0]
KEYS = {
    "dynamic_rigid_objects", "static_rigid_objects", "armatures", "bones", "morphs", "morphs_dynamic", "cameras",
    "cameras_dynamic", "drawn_meshes", "triangles", "vertices", "lights_per_frame",
    *(f"{change}_{kind}_lights" for change in ("static", "dynamic") for kind in ("point", "spot", "directional")),
}  # fmt: skip


def counts(found, *names):
    return [found[name] for name in names]


def rigid(found):
    return counts(found, "static_rigid_objects", "dynamic_rigid_objects")


def moving(node=0, interpolation="LINEAR"):
    return make_channel(node, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], interpolation)


def mesh_scene(parents, channels=(), **fields):
    return make_scene(parents, channels, meshes=[triangle_mesh()], **fields)


def light_scene(channels=(), kind="point", **fields):
    return make_scene([-1, 0], channels, lights=[Light("l", kind)], light=[-1, 0], **fields)


def test_an_empty_scene_has_every_key_and_nothing_in_it():
    found = census(make_scene([]), TIMES)
    assert set(found) == KEYS
    assert found.pop("lights_per_frame") == {"born": [0, 0], "moved": [0, 0], "killed": [0, 0]}
    assert set(found.values()) == {0}


# --- objects -------------------------------------------------------------------------------------------------------


def test_an_object_is_dynamic_when_it_or_an_ancestor_moves():
    scene = mesh_scene([-1, 0, 1, -1], [moving(0)], mesh=[-1, -1, 0, 0])
    assert rigid(census(scene, TIMES)) == [1, 1]


@pytest.mark.parametrize("path", ["rotation", "scale", "visible"])
def test_an_object_is_dynamic_when_it_turns_scales_or_appears(path):
    values = {"rotation": [[0, 0, 0, 1], [0, 1, 0, 0]], "scale": [[1] * 3, [0] * 3], "visible": [[1], [0]]}[path]
    scene = mesh_scene([-1, 0], [make_channel(0, path, [0, 1], values, "STEP")], mesh=[-1, 0])
    assert rigid(census(scene, TIMES)) == [0, 1]


def test_constant_keys_and_motion_outside_the_evaluated_times_are_static():
    tilted = np.array([0.1, 0.2, 0.3, 0.9]) / np.linalg.norm([0.1, 0.2, 0.3, 0.9])
    constant = [
        make_channel(0, "rotation", [0, 1], [tilted, -tilted]),
        make_channel(0, "translation", [0, 1], [[0.1, 0.7, 1 / 3]] * 2),
    ]
    assert rigid(census(mesh_scene([-1], constant, mesh=[0]), np.linspace(0, 1, 50))) == [1, 0]
    assert rigid(census(mesh_scene([-1], [moving()], mesh=[0]), [1.0, 2.0, 3.0])) == [1, 0]


def test_a_child_that_turns_back_what_its_parent_turns_is_static():
    rng = np.random.default_rng(0)
    q = rng.normal(size=(20, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    times = np.arange(20)
    channels = [make_channel(0, "rotation", times, q), make_channel(1, "rotation", times, q * [-1, -1, -1, 1])]
    assert rigid(census(mesh_scene([-1, 0], channels, mesh=[-1, 0]), times)) == [1, 0]


@pytest.mark.parametrize("step", [1e-6, 1e-8])
def test_slow_motion_is_motion_even_far_from_the_origin(step):
    channel = make_channel(0, "translation", [0, 1], [[1000, 0, 0], [1000 + step, 0, 0]])
    assert rigid(census(mesh_scene([-1], [channel], mesh=[0]), TIMES)) == [0, 1]


def test_every_instance_is_an_object():
    places = np.tile(np.eye(4), (5, 1, 1))
    found = census(mesh_scene([-1, -1], [moving(0)], mesh=[0, 0], instances={0: places}), TIMES)
    assert rigid(found) == [1, 5]
    assert counts(found, "drawn_meshes", "triangles", "vertices") == [2, 6, 18]


def test_only_what_the_scene_reaches_and_has_triangles_counts():
    empty = Mesh("empty", (Primitive(np.zeros((4, 3), np.float32), np.zeros((0, 3), np.uint32)),))
    scene = make_scene([-1] * 3, meshes=[triangle_mesh(), empty], mesh=[0, 0, 1], in_scene=[1, 0, 1])
    found = census(scene, TIMES)
    assert counts(found, "static_rigid_objects", "drawn_meshes", "triangles", "vertices") == [1, 1, 1, 3]


# --- skins and morphs ----------------------------------------------------------------------------------------------


def test_armatures_are_skins_in_use_and_bones_their_joints_once():
    primitive = triangle(joints=np.zeros((3, 4), np.uint32), weights=np.tile(np.float32([1, 0, 0, 0]), (3, 1)))
    bind = np.tile(np.eye(4), (2, 1, 1))
    skins = [Skin(name, np.array(joints), bind) for name, joints in (("a", [0, 1]), ("b", [1, 2]), ("unused", [3, 4]))]
    scene = make_scene(
        [-1] * 8, [moving(0)], meshes=[Mesh("m", (primitive,)), triangle_mesh()], skins=skins,
        mesh=[-1] * 4 + [0, 0, 0, 1], skin=[-1] * 4 + [0, 1, 1, 2],
    )  # fmt: skip
    found = census(scene, TIMES)
    assert counts(found, "armatures", "bones", "drawn_meshes") == [2, 3, 4]
    assert rigid(found) == [1, 0]  # the mesh without joints: its skin does nothing


def test_morphs():
    target = MorphTarget(positions=np.ones((3, 3), np.float32))
    mesh = Mesh("m", (triangle(targets=(target,)),))
    scene = make_scene([-1] * 3, [make_channel(1, "weights", [0, 1], [[0], [1]])], meshes=[mesh], mesh=[0, 0, -1])
    assert counts(census(scene, TIMES), "morphs", "morphs_dynamic") == [2, 1]


# --- cameras -------------------------------------------------------------------------------------------------------


def test_cameras():
    zoom = make_channel(1, "yfov", [0, 1], [[0.5], [0.6]], target="camera")
    scene = make_scene([-1] * 3, [moving(0), zoom], cameras=[Camera(), Camera()], camera=[0, 1, 0])
    assert counts(census(scene, TIMES), "cameras", "cameras_dynamic") == [3, 2]


# --- lights --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("channel", "born", "moved", "killed"),
    [
        (moving(0), [0, 0], [1, 1], [0, 0]),  # carried by its parent
        (moving(1, "STEP"), [0, 0], [0, 1], [0, 0]),  # teleports
        (make_channel(1, "scale", [0, 0.5, 1], [[0] * 3, [1] * 3, [0] * 3], "STEP"), [1, 0], [0, 0], [0, 1]),
        (make_channel(0, "visible", [0, 0.5, 1], [[1], [0], [1]], "STEP"), [0, 1], [0, 0], [1, 0]),
        (make_channel(0, "intensity", [0, 1], [[0], [5]], target="light"), [1, 0], [0, 0], [0, 0]),
        (make_channel(0, "intensity", [0, 1], [[4], [5]], target="light"), [0, 0], [0, 0], [0, 0]),
        (make_channel(0, "color", [0, 1], [[1, 1, 1], [1, 0, 0]], target="light"), [0, 0], [0, 0], [0, 0]),
        (make_channel(0, "range", [0, 1], [[4], [5]], target="light"), [0, 0], [0, 0], [0, 0]),
    ],
)
def test_every_way_a_point_light_can_change(channel, born, moved, killed):
    found = census(light_scene([channel]), TIMES)
    assert counts(found, "static_point_lights", "dynamic_point_lights") == [0, 1]
    assert found["lights_per_frame"] == {"born": born, "moved": moved, "killed": killed}


def test_a_point_light_shines_alike_in_all_directions():
    turn = make_channel(1, "rotation", [0, 1], [[0, 0, 0, 1], [0, 1, 0, 0]])
    grow = make_channel(1, "scale", [0, 1], [[1] * 3, [2] * 3])
    for channel in (turn, grow):
        assert census(light_scene([channel]), TIMES)["static_point_lights"] == 1


@pytest.mark.parametrize(
    ("kind", "path", "dynamic"),
    [
        ("spot", "translation", 1),
        ("spot", "rotation", 1),
        ("directional", "translation", 0),
        ("directional", "rotation", 1),
    ],
)
def test_spots_and_suns(kind, path, dynamic):
    values = {"translation": [[0, 0, 0], [1, 0, 0]], "rotation": [[0, 0, 0, 1], [0, 1, 0, 0]]}[path]
    found = census(light_scene([make_channel(1, path, [0, 1], values)], kind), TIMES)
    assert counts(found, f"static_{kind}_lights", f"dynamic_{kind}_lights") == [1 - dynamic, dynamic]
    assert found["static_point_lights"] == found["dynamic_point_lights"] == 0


def test_lights_that_share_a_definition_count_one_by_one():
    scene = make_scene([-1] * 3, [moving(1)], lights=[Light()], light=[0, 0, 0], in_scene=[1, 1, 0])
    assert counts(census(scene, TIMES), "static_point_lights", "dynamic_point_lights") == [1, 1]


@pytest.mark.parametrize("times", [[], [0.5]])
def test_without_pairs_nothing_changes(times):
    found = census(light_scene([moving(0)]), times)
    assert found["static_point_lights"] == 1
    assert found["lights_per_frame"] == {"born": [], "moved": [], "killed": []}


def test_times_may_be_a_generator():
    assert census(light_scene([moving(0)]), (i / 24 for i in range(25)))["dynamic_point_lights"] == 1
