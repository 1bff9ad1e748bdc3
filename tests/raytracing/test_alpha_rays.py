"""Rays through alpha-tested surfaces, and the structure as GPUs read it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from frame_tools import make_scene, picture, quad, still_camera
from ray_tools import directions, traced

from taubench_gl.scene.model import Camera, Material, Sampler, Texture


def stripes(sheets: int):
    """Sheets before a wall, opaque where a bit of the column is set: 8 columns, x in [-1, 1]."""
    images, materials, primitives = [], [], []
    for k in range(sheets):
        opaque = (np.arange(8) >> k) & 1
        images.append(picture(np.tile(np.stack([opaque * 0 + 255] * 3 + [opaque * 255], -1), (4, 1, 1))))
        texture = Texture(k, Sampler(9728, 9728))
        mode = "BLEND" if k == 1 else "MASK"
        materials.append(Material(base_color_texture=texture, alpha_mode=mode, double_sided=True))
        primitives.append(quad((-1, -1, -2 - 0.1 * k), (2, 0, 0), (0, 2, 0), material=k))
    primitives.append(quad((-1, -1, -3), (2, 0, 0), (0, 2, 0)))
    return make_scene(*primitives, materials=tuple(materials), images=tuple(images))


def test_rays_pass_where_alpha_is_below_the_cutoff(gpu):
    """Column c is stopped by the sheet of its lowest set bit; column 0 reaches the wall."""
    with traced(gpu, stripes(3), alpha_test=True) as t:
        rng = np.random.default_rng(2)
        column = rng.integers(8, size=4000)
        x = -1 + (column + rng.uniform(0.2, 0.8, len(column))) / 4
        o = np.column_stack([x, rng.uniform(-0.9, 0.9, len(x)), 0 * x]).astype(np.float32)
        d = np.tile(np.float32([0, 0, -1]), (len(x), 1))
        expected = np.select([column & 1 > 0, column & 2 > 0, column & 4 > 0], [0, 1, 2], 3)
        hits = t.query(o, d)
        np.testing.assert_array_equal(hits.draw, expected)
        np.testing.assert_allclose(hits.t, np.where(expected == 3, 3.0, 2 + 0.1 * expected), rtol=1e-6)
        # Up to before the wall: only column 0 gets there.
        np.testing.assert_array_equal(t.query(o, d, 2.9, any_hit=True).draw >= 0, column > 0)
        np.testing.assert_array_equal(t.query(o, d, 2.05, any_hit=True).draw >= 0, column & 1 > 0)
        assert t.structure.unfinished_rays == 0
    with traced(gpu, stripes(3)) as t:  # without the effect all of them are opaque
        assert (t.query(o, d).draw == 0).all()


def test_samplers_give_the_same_answers_as_images(gpu):
    """GPUs have few image units: there the structure is read through samplers."""
    scene = make_scene(*[quad((-1 + 0.1 * k, -1, -2 - k), (2, 0, 0), (0, 2, 0)) for k in range(5)])
    d = directions(3000)
    answers = []
    for device in (gpu, replace(gpu, software=False)):
        with traced(device, scene, still_camera(Camera())) as t:
            answers.append(t.query(np.zeros_like(d), d))
    for name in ("t", "draw", "triangle", "weights"):
        np.testing.assert_array_equal(getattr(answers[0], name), getattr(answers[1], name))
