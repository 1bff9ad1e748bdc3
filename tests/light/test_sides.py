"""Which side of a surface light falls on, and which stop it: two-sided, mirrored, normal-mapped and culled surfaces."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from fixed import fixed_settings
from light_tools import facing, floor, lambert, look, look_down, opened, picture, shoot, worst

from taubench_gl import math3d
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.scene.builder import SceneBuilder, quad, turn_x
from taubench_gl.scene.model import Channel, Scene

ALBEDO = 0.5
SUN = math3d.normalize(np.array([0.3, 0.4, 1.0]))
"""Towards the light."""


def wall(*, eye_side: float, sun: np.ndarray, scale=(1.0, 1.0, 1.0), double_sided: bool = True) -> Scene:
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(2.0, 2.0, material=lambert(b, ALBEDO, double_sided=double_sided))), scale=scale)
    b.light(rotation=facing(-sun), kind="directional", intensity=2.0)
    look(b, (0.5, 0.2, 3.0 * eye_side), (0.0, 0.0, 0.0), yfov=0.6)
    return b.build()


@pytest.mark.parametrize("shadow_lights", [0, 1])
@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (-1, -1, -1), (-2, 1, 0.5)])
@pytest.mark.parametrize("eye_side", [1.0, -1.0])
@pytest.mark.parametrize("sun_side", [1.0, -1.0])
def test_a_two_sided_wall_is_lit_on_the_side_of_the_light(gpu, eye_side, sun_side, scale, shadow_lights):
    sun = SUN * np.array([1.0, 1.0, sun_side])
    shot = picture(gpu, wall(eye_side=eye_side, sun=sun, scale=scale), shadow_lights=shadow_lights, shadow_size=256)
    assert shot.surface.all()
    cosine = max(0.0, float(sun @ np.array([0.0, 0.0, eye_side])))
    expected = np.full(shot.direct.shape, ALBEDO / np.pi * 2.0 * cosine)
    if eye_side == sun_side:
        assert expected.max() > 0.2 and worst(shot.direct, expected, shot.surface) < 5e-3
    else:
        assert np.all(shot.direct == 0)


# ------------------------------------------------------------------------------------------------------- culled backs
def roofed(side: float, *, double_sided: bool = False, eye: str = "below") -> Scene:
    """A floor, a sheet of 2 x 2 m 1 m above it whose front is up (1) or down (-1), and a sun right above both."""
    b = SceneBuilder()
    floor(b, material=lambert(b, ALBEDO))
    sheet = b.mesh(quad(1.0, 1.0, material=lambert(b, ALBEDO, double_sided=double_sided)))
    b.node(mesh=sheet, translation=(0.0, 1.0, 0.0), rotation=turn_x(-90.0 * side))
    b.light(rotation=turn_x(-90.0), kind="directional", intensity=2.0)
    look_down(b, 2.0, height=0.5 if eye == "below" else 8.0)
    return b.build()


METHODS = {"raster": {"shadow_size": 512}, "path-traced": {"spp": 4, "bounces": 1}}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("side", "double_sided", "eye"), [
    (1.0, False, "below"), (-1.0, False, "below"), (1.0, True, "below"), (-1.0, False, "above"),
])  # fmt: skip
def test_both_sides_of_a_face_stop_light(gpu, method, side, double_sided, eye):
    """Culling is the camera's alone: whichever side is towards the light or the camera, the shadow is the same."""
    scene = roofed(side, double_sided=double_sided, eye=eye)
    shot = picture(gpu, scene, light=method, exposure=1.0, environment="none", **METHODS[method])
    x, z = shot.points[..., 0], shot.points[..., 2]
    under = np.maximum(np.abs(x), np.abs(z)) < 0.95
    free = np.maximum(np.abs(x), np.abs(z)) > 1.05
    assert shot.surface.all() and np.abs(shot.points[..., 1]).max() < 1e-4, "only the floor is seen"
    assert under.sum() > 300 and np.all(shot.direct[under] == 0.0)
    np.testing.assert_allclose(shot.direct[free], ALBEDO / np.pi * 2.0, rtol=5e-3)


@pytest.mark.parametrize(("side", "double_sided", "eye", "pixels"), [
    (-1.0, False, "above", 24 * 24), (1.0, False, "above", 0), (-1.0, True, "above", 0), (-1.0, False, "below", 0),
])  # fmt: skip
def test_pixels_seen_through_culled_backs_are_counted(gpu, side, double_sided, eye, pixels):
    """48 rows of pixels are 4 m.  Counting changes neither this frame nor the next."""
    with opened(gpu, roofed(side, double_sided=double_sided, eye=eye)) as source:
        before = shoot(source)
        assert source.hidden_backs() == pixels
        np.testing.assert_array_equal(source.read("direct")[..., :3], before.direct)
        np.testing.assert_array_equal(shoot(source).direct, before.direct)
    with opened(gpu, roofed(side, double_sided=double_sided, eye=eye), shadow_lights=0) as source:
        shoot(source)
        assert source.hidden_backs() == 0, "nothing casts shadows"


def test_a_run_notes_pixels_seen_through_culled_backs():
    still = Channel("node", 0, "scale", "LINEAR", np.array([0.0, 1.0]), np.ones((2, 3)))
    scene = dataclasses.replace(roofed(-1.0, eye="above"), channels=(still,))
    settings = fixed_settings(width=64, height=48, columns=("direct",), frames=(0, 2), camera=0)
    found = {culling: evaluate_scene(scene, settings.replace(culling=culling)).summary for culling in ("gltf", "none")}
    assert [run["brightness"]["behind"] for run in found.values()] == [24 * 24, 0]
    assert [sum("--culling none" in note for note in run["notes"]) for run in found.values()] == [1, 0]
