"""Poses of Khronos' sample files against a second decoder and SciPy (``raw_gltf``)."""

from __future__ import annotations

import numpy as np
import pytest
from raw_gltf import RawGltf

from taubench_gl.animation import Poser, pose_vertices
from taubench_gl.scene import load_scene

FILES = [
    ("BoxAnimated/BoxAnimated.glb", [0]),
    ("AnimatedCube/AnimatedCube.gltf", [0]),
    ("InterpolationTest/InterpolationTest.glb", range(9)),
    ("CesiumMan/CesiumMan.glb", [0]),
    ("RiggedSimple/RiggedSimple.gltf", [0]),
    ("SimpleSkin/SimpleSkin.gltf", [0]),
    ("AnimatedMorphCube/AnimatedMorphCube.glb", [0]),
    ("Fox/Fox.gltf", range(3)),
]
CASES = [(name, animation) for name, animations in FILES for animation in animations]


@pytest.fixture(scope="module")
def raw(data):
    opened = {}

    def of(name):
        if name not in opened:
            opened[name] = RawGltf(data / "khronos" / name)
        return opened[name]

    return of


def times_of(raw, animation):
    """Times between keys, at keys, before the first key and after the last."""
    keys = np.concatenate([raw.accessor(s["input"])[:, 0] for s in animation["samplers"]])
    between = np.random.default_rng(0).uniform(keys.min(), keys.max(), 6)
    return [keys.min() - 1, 0.0, *np.random.default_rng(1).choice(keys, 3), *between, keys.max(), keys.max() + 1]


@pytest.mark.parametrize(("name", "animation"), CASES)
def test_world_matrices(data, raw, name, animation):
    file = raw(name)
    scene = load_scene(data / "khronos" / name, animation=[animation])
    poser = Poser(scene, fps=1e9)  # times beside keys do not move to them
    spec = file.json["animations"][animation]
    for t in times_of(file, spec):
        expected = np.array(file.world(spec, t))
        got = poser.sample(t).world
        scale = max(1.0, np.abs(expected).max())
        assert np.abs(got - expected).max() < 1e-12 * scale, f"t = {t}"


@pytest.mark.parametrize(("name", "animation"), CASES)
def test_vertices(data, raw, name, animation):
    file = raw(name)
    scene = load_scene(data / "khronos" / name, animation=[animation])
    poser = Poser(scene)
    spec = file.json["animations"][animation]
    for t in times_of(file, spec)[4:6]:
        state = poser.sample(t)
        for node in scene.mesh_nodes.tolist():
            for number, primitive in enumerate(scene.meshes[scene.nodes.mesh[node]].primitives):
                expected = file.vertices(spec, t, node, number)
                got = pose_vertices(scene, state, node, primitive)
                assert np.abs(got - expected).max() < 1e-6 * max(1.0, np.abs(expected).max())
