"""Light of lights without reflective shadow maps: surface patches against closed forms, and where they lie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_indirect import closed_box, lambert, vpls

from taubench_gl.animation import Poser, View
from taubench_gl.frame.geometry import build_geometry
from taubench_gl.frame.patches import Patches, lamps_of
from taubench_gl.frame.records import RecordTable
from taubench_gl.scene.builder import SceneBuilder, box, morphed, quad, skinned
from taubench_gl.scene.model import Camera, Image, Scene, Texture


def patches_of(scene: Scene, count: int = 256) -> tuple[Patches, Poser]:
    poser = Poser(scene)
    rows = list(range(len(scene.light_nodes)))
    return Patches(poser, build_geometry(scene).draws, lamps_of(poser, rows, np.zeros(1)), count), poser


def records(patches: Patches, poser: Poser, scene: Scene, t: float) -> np.ndarray:
    state, draws = poser.sample(t), build_geometry(scene).draws
    placement = RecordTable(draws).place(state, View(np.zeros(3), np.eye(3), Camera()), np.zeros(len(draws), bool))
    return patches.records(state, placement, np.zeros(3))


def room_of_lamps() -> Scene:
    s = closed_box(40, spread=0.1)
    s.camera(yfov=np.radians(90), znear=0.01)
    return s.build()


def test_a_surface_that_a_mapped_light_sees_reflects_its_later_bounces_once():
    """Patches keep out of later bounces where VPLs of maps are: the share of either is 0 or 1."""
    found = vpls(room_of_lamps(), indirect="probes", indirect_samples=1024, shadow_lights=1, shadow_size=32)
    drawn = found[found["position"][:, 3] > 0.0]
    mapped, patches = drawn[: len(drawn) - 1024], drawn[-1024:]
    assert np.all(mapped["albedo"][:, 3] == 1.0)
    inside = np.einsum("ki,ki->k", patches["normal"][:, :3], patches["position"][:, :3]) < 0.0
    assert inside.sum() == 512
    assert np.mean(patches["albedo"][inside, 3]) < 0.02, "the mapped light sees every wall from inside"
    assert np.all(patches["albedo"][~inside, 3] == 1.0) and not np.any(patches["flux"][~inside, :3])


def test_areas_add_up_and_follow_their_surface():
    """Patches stand for all area, at rest and where an animation doubles it; each stays on its triangle."""
    s = SceneBuilder()
    s.node(mesh=s.mesh(quad(2.0, 1.0, material=lambert(s))))
    moving = s.node(mesh=s.mesh(quad(1.0, 1.0, material=lambert(s))), translation=(0.0, 0.0, 3.0))
    s.animate(moving, "translation", [0.0, 1.0], [(0, 0, 3), (5, 0, 3)])
    s.animate(moving, "scale", [0.0, 1.0], [(1, 1, 1), (2, 1, 1)])
    s.light(translation=(0.0, 0.0, 1.5))
    scene = s.build()
    patches, poser = patches_of(scene, 512)
    for t, area in ((0.0, 8.0 + 4.0), (1.0, 8.0 + 8.0)):
        found = records(patches, poser, scene, t)
        assert found["position"][:, 3].sum() == pytest.approx(area, rel=0.02)
        on_moving = found["position"][:, 2] > 1.0
        x = found["position"][on_moving, 0]
        assert np.all(np.abs(x - (5.0 if t else 0.0)) <= (2.0 if t else 1.0)) and on_moving.sum() > 100
        assert np.allclose(np.abs(found["normal"][:, 2]), 1.0)


def test_patches_follow_skins_morphs_and_instances():
    """Every patch lies on the plane to which the surface has moved."""
    s = SceneBuilder()
    wall = quad(1.0, 1.0, material=lambert(s))
    count = len(wall.positions)
    joint = s.node()
    bones = skinned(wall, np.zeros((count, 1)), np.ones((count, 1)))
    s.node(mesh=s.mesh(bones), skin=s.skin([joint]))
    s.animate(joint, "translation", [0.0, 1.0], [(0, 0, 0), (0, 0, -7)])
    target = s.node(mesh=s.mesh(morphed(wall, np.tile([0.0, 0.0, 4.0], (count, 1))), weights=[0.0]))
    s.animate(target, "weights", [0.0, 1.0], [[0.0], [1.0]])
    copies = np.tile(np.eye(4), (2, 1, 1))
    copies[:, 2, 3] = 20.0, 30.0
    s.node(mesh=s.mesh(wall), instances=copies)
    s.light(translation=(0.0, 0.0, 1.5))
    scene = s.build()
    patches, poser = patches_of(scene)
    for t, planes in ((0.0, {0.0, 20.0, 30.0}), (1.0, {-7.0, 4.0, 20.0, 30.0})):
        found = np.round(records(patches, poser, scene, t)["position"][:, 2].astype(np.float64), 4)
        assert set(found.tolist()) == planes


def test_hidden_and_masked_surfaces_have_no_patches():
    texels = np.zeros((1, 2, 4), np.uint8)
    texels[0, 0] = 188, 0, 0, 255  # left half red and drawn, right half cut out
    s = SceneBuilder()
    leaf = s.material(alpha_mode="MASK", base_color_texture=Texture(0), metallic=0.0, specular=0.0)
    uv = np.float32([[0, 0], [1, 0], [0, 1], [1, 1]])
    s.node(mesh=s.mesh(replace(quad(1.0, 1.0, material=leaf), texcoords=(uv, None))))
    hidden = s.node(mesh=s.mesh(quad(1.0, 1.0, material=lambert(s))), translation=(0.0, 0.0, 9.0))
    s.animate(hidden, "visible", [0.0], [[0.0]], "STEP")
    s.light(translation=(0.0, 0.0, 1.5))
    scene = replace(s.build(), images=(Image("leaf", (2, 1), lambda: texels),))
    patches, poser = patches_of(scene)
    found = records(patches, poser, scene, 0.0)
    drawn = found[found["position"][:, 3] > 0.0]
    assert len(drawn) and np.all(drawn["position"][:, 0] <= 1e-6) and np.all(drawn["position"][:, 2] == 0.0)
    assert np.allclose(drawn["albedo"][:, :3], [((188 / 255 + 0.055) / 1.055) ** 2.4, 0.0, 0.0], atol=1e-6)
    assert found["position"][:, 3].sum() == pytest.approx(2.0, rel=0.05), "half of the leaf's 4 square meters"


def test_more_patches_lie_where_lamps_are():
    s = SceneBuilder()
    s.node(mesh=s.mesh(quad(50.0, 50.0, material=lambert(s))))
    s.light(translation=(30.0, 30.0, 1.0), range=5.0)
    scene = s.build()
    patches, poser = patches_of(scene)
    found = records(patches, poser, scene, 0.0)
    near = np.linalg.norm(found["position"][:, :2] - 30.0, axis=1) < 5.0
    assert near.mean() > 0.5, "0.8 % of the area"
    assert found["position"][:, 3].sum() == pytest.approx(1e4, rel=0.05)


def test_light_without_maps_is_the_same_bits_wherever_the_camera_is():
    s = SceneBuilder()
    s.node(mesh=s.mesh(box((1.0, 1.0, 1.0), inside=True, material=lambert(s))))
    for i in range(3):
        s.light(kind="point", intensity=1.0, translation=(0.3 * i, 0.2, 0.1))
    node = s.camera(yfov=np.radians(90), znear=0.01)
    s.animate(node, "translation", [0.0, 1.0], [(0, 0, 0), (0.37, 0.21, 0.11)])
    scene = s.build()
    found = [vpls(scene, frame, shadow_lights=0, indirect_samples=256) for frame in (0, 24)]
    assert found[0].tobytes() == found[1].tobytes()
