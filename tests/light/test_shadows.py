"""Shadows of a box on a plane against exact ray casting, light swept from grazing to overhead.

The tolerance everywhere is the map's own resolution: a pixel counts where every ray within ``TEXELS`` texels of its
own gives one answer (``Case.band``), and there not one pixel may be wrong.  At 1 texel bilinear taps still reach over.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from light_tools import FLAT, facing, floor, lambert, look, look_down, opened, picture, shoot
from repeated import few
from shadow_tools import Case, on_plane, visibility

from taubench_gl.frame.shading import Shading
from taubench_gl.frame.shadow_faces import SMALLEST_MAP, faces_of, map_sizes, pack, wanted_sizes
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.frame.tuning import MAX_UNROLLED
from taubench_gl.scene.builder import SceneBuilder, box, morphed, quad, skinned, sphere
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import Shot

TEXELS = 1.5
SIZE = 256
KINDS = ("directional", "point", "spot")


def sure_pixels(case: Case, shot: Shot, lit: np.ndarray) -> tuple[np.ndarray, ...]:
    """Pixels of the plane that the light reaches, and those that are surely lit and surely dark, which they are."""
    plane = on_plane(shot) & np.isfinite(lit)
    sure_lit, sure_dark = (s & plane for s in case.band(shot.points, TEXELS, SIZE))
    assert np.mean((sure_lit | sure_dark)[plane]) > 0.9, "the band leaves too little to test"
    assert np.all(lit[sure_lit] > 0.999), f"{np.sum(lit[sure_lit] <= 0.999)} lit pixels are shadowed (acne)"
    assert np.all(lit[sure_dark] < 0.001), f"{np.sum(lit[sure_dark] >= 0.001)} dark pixels are lit (detached)"
    return plane, sure_lit, sure_dark


@pytest.mark.parametrize("shadow_filter", ["hard", "bilinear"])
@pytest.mark.parametrize("azimuth", few([30.0, 0.0]))
@pytest.mark.parametrize("elevation", few([1.0, 70.0, 20.0, 90.0, 5.0, 45.0], 2))
@pytest.mark.parametrize("kind", KINDS)
def test_a_box_on_a_plane(gpu, kind, elevation, azimuth, shadow_filter):
    case = Case(kind, elevation, azimuth)
    shot, lit = visibility(gpu, case.scene(), shadow_size=SIZE, shadow_filter=shadow_filter)
    plane, sure_lit, sure_dark = sure_pixels(case, shot, lit)
    # And the shadow's area, by pixels of equal area: all of the difference lies in the band.
    expected, got = np.mean(case.blocked(shot.points)[plane]), np.mean(1.0 - lit[plane])
    assert abs(expected - got) < 0.5 * np.mean(~(sure_lit | sure_dark)[plane]) + 1e-3


@pytest.mark.parametrize("shadow_filter", ["hard", "bilinear"])
@pytest.mark.parametrize("azimuth", [0.0, 115.0])
@pytest.mark.parametrize("elevation", [5.0, 20.0, 45.0, 70.0])
def test_a_box_at_the_rim_of_a_wide_spot(gpu, elevation, azimuth, shadow_filter):
    """Beyond 80 degrees from the axis, where one map would have to be many times as wide as at 45."""
    case = Case("wide spot", elevation, azimuth)
    shot, lit = visibility(gpu, case.scene(), shadow_size=SIZE, shadow_filter=shadow_filter)
    ray = shot.points - case.place
    off_axis = np.degrees(np.arccos(ray @ case.axis / np.linalg.norm(ray, axis=-1)))
    plane, _, sure_dark = sure_pixels(case, shot, lit)
    assert np.all(off_axis[plane] < 85.01) and np.any(off_axis[plane] > 84.9), "the cone lights what it should"
    assert np.sum(sure_dark & (off_axis > 80.0)) > 50, "no shadow to be seen at the rim"


def test_every_way_to_ask_finds_the_maps_of_a_wide_spot(gpu, monkeypatch):
    """A light that is compiled into the shader, more than are, and lights drawn at random."""
    monkeypatch.setattr("taubench_gl.frame.shadow_faces.FULL_SIZE_SHADOWS", MAX_UNROLLED + 1)
    case, found = Case("wide spot", 20.0, 115.0), []
    for parts, shading in (
        (1, Shading()),
        (MAX_UNROLLED + 1, Shading()),
        (1, Shading(light_samples=1, indirect_samples=1)),
    ):
        maps = {"shadow_size": SIZE, "shadow_lights": parts, "shadow_filter": "hard"}
        found.append(picture(gpu, case.scene(parts=parts), shading=shading, width=96, height=96, **maps).direct)
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=1e-5, atol=1e-7)
    dark = found[0][..., 0] == 0.0
    assert 0.1 < dark.mean() < 0.9


@pytest.mark.parametrize("shadow_filter", ["hard", "bilinear"])
@pytest.mark.parametrize("elevation", few([0.5, 60.0, 5.0, 90.0, 2.0, 10.0, 30.0], 2))
@pytest.mark.parametrize("kind", KINDS)
def test_no_acne_on_a_bare_plane(gpu, kind, elevation, shadow_filter):
    """Half a degree above the plane is 89.5 degrees from its normal."""
    for azimuth in (0.0, 17.0, 45.0):
        scene = Case(kind, elevation, azimuth).scene(with_box=False)
        shot, lit = visibility(gpu, scene, shadow_size=64, shadow_filter=shadow_filter)
        tested = on_plane(shot) & np.isfinite(lit)
        assert tested.mean() > 0.9
        assert np.all(lit[tested] > 0.999)


@pytest.mark.parametrize("kind", KINDS)
def test_no_acne_on_a_plane_of_any_slope(gpu, kind):
    """A slanted plane far from the world's origin, seen in perspective: no axis of anything is aligned."""
    b = SceneBuilder()
    offset = np.array([40.0, -25.0, 60.0])
    turn = facing((0.3, 0.5, -0.8))
    root = b.node(translation=offset, rotation=turn)
    b.node(root, mesh=b.mesh(quad(4.0, 4.0, material=lambert(b))), rotation=FLAT)
    towards = np.array([0.9, 0.12, 0.35])
    b.light(root, translation=5 * towards, rotation=facing(-towards), kind=kind, intensity=10.0, outer_cone=1.0)
    camera = b.camera(root, translation=(1.0, 2.0, 4.0), rotation=facing((-1.0, -2.0, -4.0)), znear=0.01)
    assert camera > 0
    shot, lit = visibility(gpu, b.build(), shadow_size=64)
    tested = shot.surface & np.isfinite(lit)
    assert tested.mean() > 0.4 and np.all(lit[tested] > 0.999)


def test_light_leaks_at_the_foot_of_a_thin_wall_within_half_a_texel(gpu):
    """A ray that meets the wall within the bias of the floor counts as open: along the light, half a texel.

    The wall is slanted against the texels, so that their phases even out along it.
    """
    b, case = SceneBuilder(), Case("directional", 45.0, 70.0)
    material = lambert(b, 0.5)
    floor(b, 1.0, material=material)
    b.node(mesh=b.mesh(quad(1.0, 0.5, material=material)), translation=(0.0, 0.5, 0.0))
    b.light(rotation=facing(-case.towards), kind="directional", intensity=10.0)
    look_down(b, 0.3, center=(0.0, -0.2))
    shot, lit = visibility(gpu, b.build(), shadow_size=16)
    behind = on_plane(shot) & (shot.points[..., 2] < 0.0)
    width = 0.6 / 160 * lit[behind].sum() / 160
    face = faces_of(b.build(), None, [0], AnimatedScene(b.build()).bounds, 16)[0]
    texel = 2.0 * face.half / face.resolution
    assert abs(width / (0.5 * texel * case.towards[2]) - 1.0) < 0.3, (width, texel)


@pytest.mark.parametrize("kind", ["directional", "point"])
def test_a_balls_terminator(gpu, kind):
    """Convex: whatever faces the light is lit.  Flat facets and texels may only blur the last degrees."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(dataclasses.replace(sphere(1.0, 48), material=lambert(b))))
    towards = np.array([1.0, 0.4, 0.3]) / np.linalg.norm([1.0, 0.4, 0.3])
    b.light(translation=6 * towards, rotation=facing(-towards), kind=kind, intensity=10.0)
    look(b, (0.0, 0.0, 3.2), (0.0, 0.0, 0.0), yfov=0.75)
    shot, lit = visibility(gpu, b.build(), shadow_size=SIZE)
    n = shot["geometric_normal"][..., :3]
    ray = np.broadcast_to(towards, n.shape) if kind == "directional" else 6 * towards - shot.points
    cosine = np.sum(n * ray, axis=-1) / np.linalg.norm(ray, axis=-1)
    away = np.degrees(np.arcsin(np.clip(cosine, -1, 1)))
    tested = shot.surface & np.isfinite(lit)
    assert np.all(lit[tested & (away > 3.0)] > 0.999)
    assert np.mean(1.0 - lit[tested]) < 0.002


def posed_box(how: str) -> Scene:
    """A half-meter box at (1, 0.5, 0.25), moved there by its node, its joint, or its morph target."""
    b = SceneBuilder()
    floor(b, material=lambert(b))
    to = np.array([1.0, 0.5, 0.25])
    shape = box((0.5, 0.5, 0.5), material=lambert(b))
    if how == "rigid":
        b.node(mesh=b.mesh(shape), translation=to)
    elif how == "skinned":
        joint = b.node()
        b.animate(joint, "translation", [0.0, 1.0], [(-1.0, 2.0, 0.0), to])
        count = len(shape.positions)
        b.node(mesh=b.mesh(skinned(shape, np.zeros((count, 1)), np.ones((count, 1)))), skin=b.skin([joint]))
    else:
        node = b.node(mesh=b.mesh(morphed(shape, np.tile(to, (len(shape.positions), 1))), weights=[0.0]))
        b.animate(node, "weights", [0.0, 1.0], [[0.0], [1.0]])
    b.light(translation=(4.0, 5.0, 1.0), kind="point", intensity=50.0)
    look_down(b, 4.0)
    return b.build()


@pytest.mark.parametrize("how", ["skinned", "morphed"])
def test_deformed_casters_cast_the_posed_shape(gpu, how):
    still = picture(gpu, posed_box("rigid"), shadow_size=SIZE, width=160, height=160)
    with opened(gpu, posed_box(how), shadow_size=SIZE, width=160, height=160, fps=24) as source:
        before = shoot(source, 0)
        posed = shoot(source, 24)
    differ = np.abs(posed.direct - still.direct).max(axis=-1) > 1e-3 * still.direct.max()
    moved = np.abs(before.direct - still.direct).max(axis=-1) > 1e-3 * still.direct.max()
    assert moved.sum() > 300, "the pose changes nothing, so nothing is shown"
    assert differ.sum() <= 3  # rounding of the pose at a texel's edge


@pytest.mark.parametrize("limit", [16384, 4096, 1024])
@pytest.mark.parametrize(("kind", "lights"), [("directional", 5), ("directional", 24), ("point", 300), ("spot", 1)])
def test_maps_shrink_until_the_atlas_fits(kind, lights, limit):
    """The most significant lights keep the larger maps, and no two maps overlap."""
    b = SceneBuilder()
    for _ in range(lights):
        b.light(kind=kind)
    scene, ranked = b.build(), list(range(lights))[::-1]
    sizes = map_sizes(scene, ranked, 1024, limit)
    faces = faces_of(scene, None, sorted(ranked), (np.zeros(3), 1.0), sizes)
    offsets, (width, height) = pack(faces, limit)
    assert max(width, height) <= limit
    assert [sizes[row] for row in ranked] == sorted(sizes.values(), reverse=True)
    assert all(size >= SMALLEST_MAP for size in sizes.values())
    if lights * (16 if kind == "directional" else 6) * 1024**2 <= limit**2 // 2 and lights <= 8:
        assert sizes == wanted_sizes(ranked, 1024), "there is room for the maps asked for"
    taken = np.zeros((height // 16, width // 16), dtype=np.int64)
    for (x, y), face in zip(offsets, faces, strict=True):
        taken[y // 16 : (y + face.resolution) // 16, x // 16 : (x + face.resolution) // 16] += 1
    assert taken.max() == 1 and taken.sum() == sum((f.resolution // 16) ** 2 for f in faces)


def test_a_run_notes_the_sizes_of_maps_that_do_not_fit(gpu, monkeypatch):
    """Five directional lights on a device with small textures: shadows stay where they were."""
    monkeypatch.setitem(gpu.ctx.info, "GL_MAX_TEXTURE_SIZE", 512)
    case, found = Case("directional", 40.0, 0.0), {}
    for parts in (1, 5):
        scene = case.scene(parts=parts)
        with opened(gpu, scene, width=96, height=96, shadow_size=64, shadow_lights=parts) as source:
            found[parts] = shoot(source).direct[..., 0], source.describe()["notes"]
    assert found[1][1] == [] and "3 lights 256x256, 2 lights 128x128" in found[5][1][0]
    assert np.mean(np.abs(found[1][0] - found[5][0]) > 0.02 * found[1][0].max()) < 0.05
