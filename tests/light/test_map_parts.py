"""What a shadow map must draw: the texels a box covers, what is hidden, maps kept over frames against fresh ones."""

from __future__ import annotations

import numpy as np
import pytest
from light_tools import floor, lambert, look, opened, shoot
from test_shadow_cache import SIZE, street

from taubench_gl.frame import occlusion
from taubench_gl.frame.lights import UnrolledLights, unrolled_lights
from taubench_gl.frame.occlusion import BEHIND, ROUNDING, SQUARES, Shown
from taubench_gl.frame.passes import shadows
from taubench_gl.frame.passes.shadows import FaceDrawer
from taubench_gl.frame.shadow_faces import FaceTable, light_faces
from taubench_gl.frame.tuning import MAX_UNROLLED
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.scene.model import Light, Scene


@pytest.mark.parametrize("texels", [9, 128])
@pytest.mark.parametrize("kind", ["point", "spot", "wide spot", "directional"])
def test_no_texel_in_which_a_box_can_be_seen_falls_outside_what_it_covers(kind, texels):
    """Points on the rays through the middles of texels, before, beside and around the light, in float64."""
    rng = np.random.default_rng(7)
    wide = kind == "wide spot"
    light = Light(kind=kind.removeprefix("wide "), outer_cone=np.radians(85.0 if wide else 40.0))
    where, direction = np.array([0.3, 2.0, -0.4]), np.array([0.6, -0.8, 0.0])
    centers, halves = rng.uniform(-4.0, 4.0, (200, 3)), rng.uniform(0.01, 1.0, (200, 3))
    tried = 0
    for face in light_faces(0, light, where, direction, (np.zeros(3), 8.0), texels, cube=wide):
        table = FaceTable([face])
        shown = table.shown(np.zeros(200, dtype=int), np.arange(200), centers, halves)
        low, high, nearest = shown.low, shown.high, shown.nearest
        assert low.min() >= 0 and high.max() <= texels
        depths = (0.0, face.near) if face.parallel else (face.near, 8.0)
        texel, z = rng.integers(0, texels, (4000, 2)), rng.uniform(*depths, 4000)
        across = ((texel + 0.5) / texels * 2.0 - 1.0) * face.half * (1.0 if face.parallel else z[:, None])
        points = face.origin + np.column_stack([across, z]) @ (face.right, face.up, face.forward)
        clip = np.column_stack([points, np.ones(4000)]) @ face.clip_from_relative(np.zeros(3)).T
        in_box = np.all(np.abs(points[:, None] - centers) <= halves, axis=-1)
        covered = np.all((texel[:, None] >= low) & (texel[:, None] < high), axis=-1)
        assert (table.sees(centers, halves)[0] & covered)[in_box].all()
        assert (nearest >= (clip[:, 2] / clip[:, 3])[:, None] - 1e-12)[in_box].all()
        tried += in_box.sum()
        far = np.linalg.norm(centers - where, axis=1) > 2.0
        small = (halves.max(axis=1) < 0.3) & table.sees(centers, halves)[0] & far
        assert ((high - low)[small] <= texels // 2).all(), "a small thing far away must not cost the whole map"
    assert tried > 100


def test_what_is_hidden_lies_behind_every_texel_that_it_covers():
    """By brute force, in maps whose sides are no powers of two."""
    rng = np.random.default_rng(5)
    for height, width in ((37, 53), (1, 9), (16, 16)):
        depths = rng.uniform(0.2, 1.0, (height, width)).astype(np.float32)
        low = np.column_stack([rng.integers(0, n, 500) for n in (width, height)])
        high = np.minimum(low + rng.integers(1, 30, (500, 2)), (width, height))
        nearest = rng.uniform(0.0, 0.8, 500)
        found = Shown(np.arange(500), low + 4, high + 4, nearest).hidden((4, 4, width, height), depths)
        farthest = np.array([depths[y:v, x:u].min() for (x, y), (u, v) in zip(low, high, strict=True)])
        assert found.any() and (farthest > nearest)[found].all()
        exact = np.all(high - low <= SQUARES, axis=1)
        assert np.array_equal(found[exact], (farthest > BEHIND * nearest + ROUNDING)[exact])


def columns() -> Scene:
    """Rows of columns between which a point light moves, and a second surface in the place of each."""
    b = SceneBuilder()
    floor(b, 12.0, material=lambert(b))
    colors = [b.mesh(box((0.4, 2.0, 0.4), material=lambert(b, albedo))) for albedo in (0.2, 0.5, 0.8)]
    for i in range(100):
        place = 2.0 * (i % 10) - 9.0, 2.0, 2.0 * (i // 10) - 9.0
        for k in (0, 1):
            b.node(mesh=colors[(i + k) % 3], translation=place)
    lamp = b.light(translation=(0.0, 1.5, 0.0), kind="point", intensity=20.0)
    b.animate(lamp, "translation", [0.0, 1.0], [(0.0, 1.5, 0.0), (1.8, 1.5, 0.4)])
    look(b, (0.0, 3.0, 8.0), (0.0, 0.0, 0.0))
    return b.build()


def test_maps_without_what_is_hidden_are_those_with_it(gpu, monkeypatch):
    """Shadow maps and virtual point lights bit by bit; of two surfaces in one place the same one is seen."""
    scene, drawn = columns(), []

    def maps(least: int) -> list[np.ndarray]:
        monkeypatch.setattr(occlusion, "LARGE", least)
        drawn.append(0)
        out = []
        with opened(gpu, scene, columns=("direct", "indirect"), **SIZE) as source:
            for frame in range(3):
                shoot(source, frame)
                out += [source.light.shadow.depths().copy(), source.light.indirect.vpls().copy()]
        return out

    draw = FaceDrawer.draw

    def counted(self, frame, stale, *args, **options):
        drawn[-1] += sum(len(draws) for *_, draws in stale)
        draw(self, frame, stale, *args, **options)

    monkeypatch.setattr(FaceDrawer, "draw", counted)
    expected, got = maps(1 << 30), maps(0)
    assert all(np.array_equal(a, b) for a, b in zip(expected, got, strict=True))
    assert drawn[1] < 0.8 * drawn[0]


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
