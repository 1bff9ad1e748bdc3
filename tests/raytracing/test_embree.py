"""Rays hit what Embree says: the primitive, or a distance within 1e-5, but for a band around edges."""

from __future__ import annotations

import numpy as np
import pytest
from frame_tools import find_scene
from ray_tools import compare, some_rays, traced, visible_triangles
from repeated import few

from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene

embree = pytest.importorskip("embreex.rtcore_scene")
meshes = pytest.importorskip("embreex.mesh_construction")

BAND = 4e-6
"""Distance from an edge, or of two surfaces, below which float32 cannot tell; a share of the largest coordinate."""

SCENES = {
    "demo": 0.7,
    "Sponza.gltf": 0.0,
    "CesiumMan.glb": 0.9,
    "MorphStressTest.glb": 1.3,
    "NegativeScaleTest.glb": 0.0,
    "CesiumMilkTruck.glb": 0.5,
}


SHORT = ("demo", "CesiumMan.glb", "CesiumMilkTruck.glb")


@pytest.mark.parametrize(("name", "count"), few([*((n, 100_000) for n in SHORT), *((n, 1_000_000) for n in SCENES)], 3))
def test_rays_as_embree(gpu, request, name, count):
    path = ASSETS / "demo.glb" if name == "demo" else find_scene(request.getfixturevalue("data"), name)
    scene, time = load_scene(path), SCENES[name]
    with traced(gpu, scene) as t:
        t.at(time)
        triangles = visible_triangles(t.renderer)
        o, d = some_rays(triangles, count)
        hits = t.query(o, d)
        anything = t.query(o, d, any_hit=True)
        assert t.structure.unfinished_rays == 0
    np.testing.assert_array_equal(anything.draw >= 0, hits.draw >= 0)
    other = embree.EmbreeScene(robust=True)
    meshes.TriangleMesh(other, np.ascontiguousarray(triangles.corners, dtype=np.float32))
    answer = other.run(o, d, output=1)
    mine = triangles.index(hits)
    low, high = triangles.box
    band = BAND * max(np.abs(low).max(), np.abs(high).max())
    found = compare(triangles, o, d, mine, hits.t, answer["primID"], answer["tfar"], band)
    assert not len(found.unexplained), found.unexplained[:10]
    assert len(found.rays) <= 3e-4 * count, len(found.rays)
    assert len(found.theirs) <= 1e-5 * count + 1, found.theirs[:10]
    assert np.mean(mine >= 0) > 0.01
