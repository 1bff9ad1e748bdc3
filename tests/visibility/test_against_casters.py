"""Exact visibility of real scenes against the float64 caster, and the same segments answered by Embree."""

from __future__ import annotations

import numpy as np
import pytest
from frame_tools import find_scene
from references.visibility import SNAP
from sight_tools import look, reference, surely, surfaces_before

from taubench_gl.animation import choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Visibility
from taubench_gl.scene import load_scene

SCENES = {"AnimatedMorphCube.glb": 30, "BoxAnimated.glb": 20}
"""Frames at 12 fps."""

DIFFER = 2e-3
"""Share of the pixels outside the band that may differ: where three surfaces meet within a pixel's snapping."""


@pytest.mark.parametrize(
    "name",
    [
        "BoxAnimated.glb",
        *(pytest.param(n, marks=pytest.mark.long) for n in ("AnimatedMorphCube.glb", "CesiumMilkTruck.glb")),
    ],
)
def test_as_the_float64_caster(gpu, data, name):
    scene = load_scene(find_scene(data, name))
    sight = look(gpu, scene, choose_camera(scene), (56, 32), SCENES.get(name, 8), fps=12.0)
    own = sight.bits & ~np.uint32(Visibility.MOVED)
    assert np.mean(own == (reference(sight) & ~np.uint32(Visibility.MOVED))) > 0.98
    expected, sure = surely(sight)
    assert sure.mean() > 0.75 and np.mean((own != expected)[sure]) <= DIFFER
    assert len(np.unique(own)) >= 3


@pytest.mark.parametrize(("name", "frame"), [("CesiumMan.glb", 4), ("CesiumMilkTruck.glb", 3)])
def test_as_embree(gpu, data, name, frame):
    """Surface points inside the previous image: Embree's nearest hit from the previous camera is the point, or not."""
    embree = pytest.importorskip("embreex.rtcore_scene")
    meshes = pytest.importorskip("embreex.mesh_construction")
    scene = load_scene(find_scene(data, name))
    sight = look(gpu, scene, choose_camera(scene), (160, 90), frame, fps=4.0, culling="none")
    before = sight.source.renderer.frame.before[1]
    pair = reprojection(sight.source.renderer.frame.view, before, 160, 90)
    compared = np.isin(sight.kind, (Visibility.VISIBLE, Visibility.OCCLUDED))
    compared &= sight.channels["position"][..., 3] > 0
    q = sight.channels["prev_position"][..., :3][compared].astype(np.float64)
    other = embree.EmbreeScene(robust=True)
    corners = surfaces_before(sight).corners.astype(np.float32)
    meshes.TriangleMesh(other, np.ascontiguousarray(corners))
    start = (pair.prev_near / (q @ pair.prev_forward))[:, None] * q
    rest = q - start
    answer = other.run(start.astype(np.float32), rest.astype(np.float32), output=1)
    t = np.where(answer["primID"] >= 0, answer["tfar"], np.inf)
    pixel = 2.0 / (before.clip_from_relative(160, 90)[1, :3] @ before.world_from_view[:, 1] * 90)
    reach = SNAP * pixel * (q @ pair.prev_forward) / np.linalg.norm(rest, axis=1)
    hidden = t < 1.0 - reach
    found = sight.kind[compared] == Visibility.OCCLUDED
    # Band: Embree's hit is within a pixel before the point, most often its own surface at a grazing angle, which the
    # pass knows by its plane.
    differs = hidden != found
    band = hidden & (t > 1.0 - reach / SNAP)
    assert np.mean(differs[~band]) <= DIFFER and np.mean(differs) <= 0.01
    assert 10 < found.sum() < 0.7 * len(found) and band.mean() < 0.05
