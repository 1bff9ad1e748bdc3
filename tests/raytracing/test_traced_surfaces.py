"""Camera rays through both levels of the acceleration structure against the rasterizer, alpha tests included."""

from __future__ import annotations

import pytest
from hit_tools import look_by_tracing, opened
from test_hit_attributes import SIZE, agree

from taubench_gl.animation import choose_camera
from taubench_gl.scene import load_scene


@pytest.mark.parametrize(
    ("name", "time"),
    [
        ("AlphaBlendModeTest.glb", 0.0),
        ("CesiumMan.glb", 0.7),
        ("AnimatedMorphCube.glb", 1.1),
        ("NegativeScaleTest.glb", 0.0),
        ("CesiumMilkTruck.glb", 0.6),
        ("Sponza.gltf", 0.0),
    ],
)
def test_rays_find_what_the_rasterizer_draws(gpu, data, name: str, time: float) -> None:
    scene = load_scene(min(p for p in data.rglob(name)))
    with opened(gpu, scene, choose_camera(scene), SIZE, traced=True) as hits:
        seen = look_by_tracing(hits, time)
        # Draws differ at edges, where the rasterizer has snapped corners to 1/256 pixel, and at rims of masks.
        assert len(seen.draws) >= 0.97 * seen.covered
        agree(seen, edges=0.04, normal=0.02)
        assert hits.structure.unfinished_rays == 0
