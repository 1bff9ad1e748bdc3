"""Rays through the acceleration structure against closed forms."""

from __future__ import annotations

import numpy as np
from frame_tools import make_scene, room, still_camera
from ray_query import RayQuery

from taubench_gl.frame.raytracing.structure import SceneStructure
from taubench_gl.frame.renderer import Renderer
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.scene.model import Camera


def test_rays_from_the_middle_of_a_room_meet_its_walls(gpu):
    context = GpuContext(gpu)
    renderer = Renderer(context, make_scene(room(5.0)), still_camera(Camera()), (8, 8), {"position"})
    structure = SceneStructure(renderer)
    query = RayQuery(context, structure)
    try:
        renderer.draw(0.0, 0.0)
        structure.update(renderer.frame)
        d = np.random.default_rng(3).normal(size=(1000, 3))
        d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
        hits = query(np.zeros_like(d), d)
        assert (hits.draw == 0).all()
        np.testing.assert_allclose(hits.t, 5.0 / np.abs(d).max(axis=1), rtol=1e-6)
        assert (query(np.zeros_like(d), d, 4.99, any_hit=True).draw == -1).all()
        assert (query(np.zeros_like(d), d, 8.7, any_hit=True).draw >= 0).all()
        assert structure.unfinished_rays == 0
    finally:
        for item in (query, structure, renderer, context):
            item.release()
