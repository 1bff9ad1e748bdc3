"""Redrawing part of a shadow map: the texels a sphere covers, and maps kept over frames against maps drawn afresh."""

from __future__ import annotations

import numpy as np
import pytest
from light_tools import opened, shoot
from test_shadow_cache import SIZE, street

from taubench_gl.frame.lights import UnrolledLights, unrolled_lights
from taubench_gl.frame.passes import shadows
from taubench_gl.frame.shadow_faces import FaceTable, light_faces
from taubench_gl.frame.tuning import MAX_UNROLLED
from taubench_gl.scene.model import Light


@pytest.mark.parametrize("kind", ["point", "spot", "wide spot", "directional"])
def test_no_point_of_a_sphere_falls_outside_what_it_covers(kind):
    """Ten thousand points on spheres before, beside and around the light, projected in float64."""
    rng = np.random.default_rng(7)
    wide = kind == "wide spot"
    light = Light(kind=kind.removeprefix("wide "), outer_cone=np.radians(85.0 if wide else 40.0))
    where, direction = np.array([0.3, 2.0, -0.4]), np.array([0.6, -0.8, 0.0])
    centers, radii = rng.uniform(-4.0, 4.0, (200, 3)), rng.uniform(0.01, 1.5, 200)
    on_sphere = rng.normal(size=(200, 50, 3))
    on_sphere /= np.linalg.norm(on_sphere, axis=-1, keepdims=True)
    points = centers[:, None] + radii[:, None, None] * on_sphere
    tried = 0
    for face in light_faces(0, light, where, direction, (np.zeros(3), 8.0), 128, cube=wide):
        table, only = FaceTable([face]), np.zeros(len(radii), dtype=int)
        low, high = table.cover(only, centers, radii)
        assert low.min() >= 0 and high.max() <= 128
        clip = points @ face.clip_from_relative(np.zeros(3))[:, :3].T + face.clip_from_relative(np.zeros(3))[:, 3]
        ahead = clip[..., 3] > 0
        texel = np.floor((clip[..., :2] / np.where(ahead, clip[..., 3], 1.0)[..., None] * 0.5 + 0.5) * 128)
        inside = ahead & np.all((texel >= 0) & (texel < 128), axis=-1)
        covered = np.all((texel >= low[:, None]) & (texel < high[:, None]), axis=-1)
        assert covered[inside].all()
        tried += inside.sum()
        small = (radii < 0.1) & table.sees(centers, radii)[0] & (np.linalg.norm(centers - where, axis=1) > 2.0)
        assert ((high - low)[small] < 40).all(), "a small thing far away must not cost the whole map"
    assert tried > 500


@pytest.mark.parametrize("copied", [False, True], ids=["drawn", "copied"])
@pytest.mark.parametrize("move_light", [False, True])
def test_maps_kept_over_frames_are_those_drawn_now(gpu, monkeypatch, move_light, copied):
    """Bit by bit, while a box moves through them: what is not redrawn must have been true.  ``copied``: the kept maps
    are copies of those of what stands still, with the box over them."""
    scene = street(move_box=True, move_light=move_light)
    if copied:
        monkeypatch.setattr(shadows, "FIXED_TRIANGLES", 0)
    with opened(gpu, scene, **SIZE) as kept:
        monkeypatch.undo()
        for frame in range(5):
            shoot(kept, frame)
            with opened(gpu, scene, **SIZE) as fresh:
                shoot(fresh, frame)
                expected = fresh.light.shadow.depths().copy()
            assert np.array_equal(kept.light.shadow.depths(), expected)
            assert kept.light.shadow.redrawn == (8 if move_light or frame == 0 else 3)


def test_all_of_a_few_lights_are_unrolled_of_many_those_with_shadow_maps():
    assert unrolled_lights((0, 2), {1: 0}) == UnrolledLights((0, 1), (0, 2), (-1, 0))
    many = (0,) * (MAX_UNROLLED + 1)
    assert unrolled_lights(many, {5: 6, 2: 0}) == UnrolledLights((2, 5), (0, 0), (0, 6))
    assert unrolled_lights(many, {i: 6 * i for i in range(len(many))}) == UnrolledLights()
    assert unrolled_lights(many, {}) == UnrolledLights()
