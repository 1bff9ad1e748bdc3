"""Bounds of draws hold every posed vertex: an object outside its sphere or box would lose its shadow."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.animation import Poser, pose_vertices
from taubench_gl.frame.draw_bounds import DrawBounds, bounding_sphere_of
from taubench_gl.frame.geometry import build_geometry
from taubench_gl.scene import load_scene

FILES = (
    "khronos/CesiumMan/CesiumMan.glb",
    "khronos/Fox/Fox.gltf",
    "khronos/MorphStressTest/MorphStressTest.glb",
    "khronos/AnimatedMorphCube/AnimatedMorphCube.glb",
    "khronos/InterpolationTest/InterpolationTest.glb",
    "asset_generator/Animation_Skin/Animation_Skin_08.gltf",
)


@pytest.mark.parametrize("name", FILES, ids=lambda f: f.split("/")[-1])
def test_every_posed_vertex_is_inside(data, name):
    scene = load_scene(data / name)
    draws = build_geometry(scene).draws
    bounds, poser = DrawBounds(scene, draws), Poser(scene)
    for t in np.linspace(0.0, scene.duration, 7):
        state = poser.sample(float(t))
        world = state.world[[d.node for d in draws]]
        centers, radii = bounds.at(state, world)
        boxes = bounds.boxes(state, world)
        assert np.array_equal(boxes[0], centers)
        for draw, center, radius, half in zip(draws, centers, radii, boxes[1], strict=True):
            primitive = scene.meshes[draw.mesh].primitives[draw.primitive]
            points = pose_vertices(scene, state, draw.node, primitive)
            outside = np.linalg.norm(points - center, axis=1).max() - radius
            assert outside <= 1e-6 * max(radius, 1.0)
            assert (np.abs(points - center).max(axis=0) <= half + 1e-6 * max(radius, 1.0)).all()
            assert (half <= radius).all()


def test_a_skin_is_bounded_by_the_vertices_of_each_joint(data):
    """A bound is less than 1.5 times the sphere around the posed vertices."""
    scene = load_scene(data / "khronos/CesiumMan/CesiumMan.glb")
    draws = build_geometry(scene).draws
    bounds, poser = DrawBounds(scene, draws), Poser(scene)
    state = poser.sample(0.5)
    _, radii = bounds.at(state, state.world[[d.node for d in draws]])
    for draw, radius in zip(draws, radii, strict=True):
        points = pose_vertices(scene, state, draw.node, scene.meshes[draw.mesh].primitives[draw.primitive])
        assert radius < 1.5 * bounding_sphere_of(points)[1]
