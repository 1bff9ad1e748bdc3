"""Exact visibility of real scenes against the float64 caster."""

from __future__ import annotations

import numpy as np
import pytest
from frame_tools import find_scene
from sight_tools import look, reference, surely

from taubench_gl.animation import choose_camera
from taubench_gl.conventions import Visibility
from taubench_gl.scene import load_scene

SCENES = {"AnimatedMorphCube.glb": 30, "BoxAnimated.glb": 20, "CesiumMilkTruck.glb": 3}
"""Frames at 12 fps."""

DIFFER = 2e-3
"""Share of the pixels outside the band that may differ: where three surfaces meet within a pixel's snapping."""


@pytest.mark.parametrize(
    "name",
    [
        "BoxAnimated.glb",
        "CesiumMan.glb",
        *(pytest.param(n, marks=pytest.mark.long) for n in ("AnimatedMorphCube.glb", "CesiumMilkTruck.glb")),
    ],
)
def test_as_the_float64_caster(gpu, data, name):
    scene = load_scene(find_scene(data, name))
    size = (28, 16) if name == "CesiumMan.glb" else (56, 32)  # every pixel meets 4,672 deformed triangles
    sight = look(gpu, scene, choose_camera(scene), size, SCENES.get(name, 8), fps=12.0)
    own = sight.bits & ~np.uint32(Visibility.MOVED)
    assert np.mean(own == (reference(sight) & ~np.uint32(Visibility.MOVED))) > 0.98
    expected, sure = surely(sight)
    assert sure.mean() > 0.75 and np.mean((own != expected)[sure]) <= DIFFER
    assert len(np.unique(own)) >= 3
