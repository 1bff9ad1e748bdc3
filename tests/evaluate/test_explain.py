"""Explanations of pixels of surfaces that move by themselves."""

from __future__ import annotations

import numpy as np
import pytest

import taubench_gl as tb
from taubench_gl.animation import Poser, pose_vertices
from taubench_gl.animation.surface import previous_point
from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.evaluation.explain import in_words
from taubench_gl.glossary import label_of
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, box, quad
from taubench_gl.selftest.scenes import busy_room

pytestmark = pytest.mark.usefixtures("coarse_light")

STEP_M = 0.17
GEOMETRY = {"size": "96x54", "columns": "position,normal"}
COMPARED = FRUSTUM | Reason.POSITION | Reason.NORMAL | Reason.DISOCCLUDED | Reason.OCCLUDING


def receding_box(meters_per_frame: float):
    """A box in front of a wall; its front face, in the middle of the image, moves away from a still camera."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(40.0, 40.0)), translation=(0.0, 0.0, -9.0))
    cube = b.node(mesh=b.mesh(box((2.0, 2.0, 2.0))))
    b.animate(cube, "translation", (0.0, 1.0), [(0.0, 0.0, 0.0), (0.0, 0.0, -24.0 * meters_per_frame)])
    b.camera(translation=(0.0, 0.0, 5.0), znear=0.1)
    return b.build()


@pytest.mark.parametrize("unit_scale", [1.0, 4.0])
def test_own_previous_position_is_no_occluder(unit_scale):
    scene = receding_box(STEP_M * unit_scale)
    for pair in tb.pairs(scene, frames="0:2", unit_scale=unit_scale, **GEOMETRY):
        found = pair.explain(48, 27)
        assert found.word & Reason.DISOCCLUDED  # as counted: the history surface is nearer to the camera
        assert found.object_motion_m == pytest.approx(STEP_M, rel=1e-5)
        assert found.motion_word == 0
        assert label_of(Reason.DISOCCLUDED) not in str(found)


def test_wall_that_a_box_uncovers_is_disoccluded_and_did_not_move():
    for pair in tb.pairs(receding_box(STEP_M), frames="0:2", **GEOMETRY):
        wall = pair.read("position")[..., 3] > 12.0
        y, x = np.argwhere((pair.mask & np.uint32(Reason.DISOCCLUDED) != 0) & wall)[0]
        found = pair.explain(x, y)
        assert found.object_motion_m == 0.0 and found.motion_word & Reason.DISOCCLUDED
        assert label_of(Reason.DISOCCLUDED) in str(found)


@pytest.mark.parametrize("scene", ["demo", "room"])
def test_motion_word_is_the_word_of_motion_reprojection(scene):
    loaded = load_scene(ASSETS / "demo.glb") if scene == "demo" else busy_room()
    (expected,) = [p.mask for p in tb.pairs(loaded, frames="10:12", reprojection="motion", **GEOMETRY)]
    for pair in tb.pairs(loaded, frames="10:12", **GEOMETRY):
        discarded = np.argwhere(pair.mask & np.uint32(Reason.POSITION | Reason.NORMAL))
        chosen = np.random.default_rng(3).permutation(discarded)[:40]
        found = [(pair.explain(x, y).motion_word, int(expected[y, x]) & COMPARED) for y, x in chosen]
        words = [(int(word) & COMPARED, other) for word, other in found if word is not None]
        assert len(words) > 10
        assert sum(a != b for a, b in words) <= 1  # an edge may be rounded to another pixel


def test_words_name_the_motion_where_it_matters():
    """Where motion vectors would help, or where the motion is longer than the threshold."""
    seen = []
    limit = tb.Settings().metrics.thresholds["position"]
    for pair in tb.pairs(ASSETS / "demo.glb", frames="30:32", **GEOMETRY):
        for y, x in np.argwhere(pair.mask & np.uint32(Reason.POSITION | Reason.NORMAL))[::3]:
            found = pair.explain(x, y)
            if found.object_motion_m is not None:
                helps = not found.motion_word & (FRUSTUM | Reason.POSITION | Reason.NORMAL)
                expected = found.object_motion_m > 1e-3 * limit and (helps or found.object_motion_m > limit)
                assert (found.reason != in_words(found.word)) == expected
                seen.append((helps, expected, found.object_motion_m > limit))
    assert len(set(seen)) >= 4


def test_previous_point_follows_deformed_and_rigid_surfaces():
    scene = busy_room()
    now, before = (Poser(scene).sample(t) for t in (0.5, 0.25))
    for node in scene.mesh_nodes.tolist():
        for primitive in scene.meshes[scene.nodes.mesh[node]].primitives:
            a, b = (pose_vertices(scene, s, node, primitive) for s in (now, before))
            for triangle in primitive.triangles[:3]:
                weights = np.array([0.2, 0.3, 0.5])
                found = previous_point(scene, now, before, weights @ a[triangle])
                assert np.allclose(found, weights @ b[triangle], atol=1e-9)
