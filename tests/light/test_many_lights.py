"""690 lights: what culling leaves out is bounded, small, and the same as in float64."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lamp_field import lamp_field
from light_tools import DIRECT_ONLY, lambert, opened, shoot
from references.light_culling import kept_lights, largest_brdf, light_bounds, tile_boxes

from taubench_gl.errors import GraphicsError
from taubench_gl.frame import light_stage
from taubench_gl.frame.passes.lighting import TILE
from taubench_gl.metrics.lighting import SurfaceMaterial, evaluate_brdf
from taubench_gl.scene.builder import SceneBuilder, quad

SIZE = {"width": 192, "height": 108, "shadow_lights": 0, "columns": DIRECT_ONLY}


@pytest.fixture(scope="module")
def field():
    return lamp_field(reach=4.0)


def left_out_of(gpu, scene, light_error: float) -> tuple[np.ndarray, ...]:
    """All lights against the culled ones, per pixel and channel: the light of all, and how many each tile keeps."""
    images, counts = [], []
    for error in (0.0, light_error):
        with opened(gpu, scene, light_error=error, **SIZE) as source:
            images.append(shoot(source, 3).direct)
            counts.append(source.light.tile_counts())
    left_out, rounding = images[0] - images[1], 1e-5 * max(images[0].max(), 1.0)
    assert left_out.min() >= -rounding and left_out.max() <= light_error + rounding
    return images[0], *counts


@pytest.mark.parametrize("light_error", [1e-4, 1e-3, 1e-2, 0.1])
def test_what_is_left_out_stays_below_the_given_error(gpu, field, light_error):
    """Culling is worth it."""
    every, most, kept = left_out_of(gpu, field, light_error)
    assert every.max() > 0.5, "the scene is too dark to tell"
    assert kept.mean() < 0.1 * 690 and kept.sum() < most.sum()


def test_lights_without_attenuation_or_range_are_bounded_too(gpu, field):
    """The bound does not fall with the distance, or hundreds of faint lights add up: few can go."""
    constant = replace(field, lights=tuple(replace(x, constant=True, intensity=0.02) for x in field.lights))
    for scene, light_error in ((constant, 1e-2), (lamp_field(intensity=0.01), 2e-2)):
        _, most, kept = left_out_of(gpu, scene, light_error)
        assert 0 < kept.sum() < most.sum()


@pytest.mark.parametrize("light_error", [0.0, 1e-3, 1e-2])
def test_kept_lists_are_those_of_the_twin(gpu, field, light_error):
    with opened(gpu, field, light_error=light_error, **SIZE) as source:
        shot = shoot(source, 3)
        lists = source.light.tile_lists()
        rows = source.light.table.rows
    channels = (shot[name][::-1] for name in ("position", "normal", "base_color", "material"))
    low, high, brdf = tile_boxes(shot["position"][::-1], largest_brdf(*channels), TILE)
    peak = rows["color"][:, :3].max(axis=1).astype(np.float64)
    reach = np.where(rows["position"][:, 3] > 0, rows["position"][:, 3], np.inf).astype(np.float64)
    bounds = light_bounds(low, high, brdf, rows["position"][:, :3].astype(np.float64), peak, reach)
    expected = kept_lights(bounds, light_error)
    got = np.zeros_like(expected)
    for tile, kept in enumerate(lists):
        assert np.all(np.diff(kept) > 0), "a light is listed twice, or out of order"
        got[tile, kept] = True
    # A bound within float32's rounding of a power of two may fall into the bin beside.
    octave = np.log2(np.maximum(bounds, 1e-30))
    edge = (np.abs(octave - np.round(octave)) < 1e-4) | (bounds < 1e-6)
    assert np.array_equal(got | edge, expected | edge)
    assert edge[bounds > 0].mean() < 0.01 and expected.sum() > 1000


@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("roughness", [0.05, 0.3, 0.7, 1.0])
def test_no_direction_of_light_exceeds_the_largest_brdf(roughness, metallic):
    """The bound against the lobes themselves, over half a million directions; and not idly above them."""
    base = np.array([0.2, 0.9, 0.5])
    tightest = np.inf
    for degrees in (0.0, 30.0, 60.0, 80.0, 89.0):
        n, v = np.array([0.0, 0.0, 1.0]), np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
        theta, phi = np.meshgrid(np.linspace(0, np.pi / 2, 700)[:-1], np.linspace(-0.3, 0.3, 151) ** 3, indexing="ij")
        l = np.stack([-np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)  # noqa: E741
        full = np.ones(l.shape[:-1])
        material = SurfaceMaterial(np.broadcast_to(base, l.shape), full * metallic, full * roughness, 0.8)
        diffuse, glossy = evaluate_brdf(material, n, v, l)
        bound = float(largest_brdf(-v, n, base, np.array([metallic, roughness, 1.0, 0.8])))
        assert (diffuse + glossy).max() <= bound
        tightest = min(tightest, bound / (diffuse + glossy).max())
    assert tightest < 5.0


def test_culling_keeps_suns_and_spots(gpu):
    """Lights of all kinds through the lists give what they give without lists."""
    images = []
    for effects in ("auto", "all"):
        b = SceneBuilder()
        b.node(mesh=b.mesh(quad(4.0, 4.0, material=lambert(b))))
        b.light(kind="directional", intensity=0.5)
        for i in range(9):
            b.light(translation=(i - 4.0, 0.3, 1.0), kind="spot", intensity=1.0, outer_cone=0.5)
        for i in range(5):
            b.light(translation=(0.4, i - 2.0, 0.5), kind="point", intensity=0.3)
        b.camera(translation=(0.0, 0.0, 4.0))
        with opened(gpu, b.build(), effects=effects, light_error=0.0, **SIZE) as source:
            assert source.effects["light_culling"].enabled == (effects == "all")
            images.append(shoot(source).direct)
    assert images[0].max() > 0.1 and np.allclose(images[0], images[1], rtol=1e-5, atol=1e-7)


def test_a_black_or_hidden_light_is_in_no_list(gpu):
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=lambert(b))))
    for i in range(20):
        b.light(translation=(0.1 * i, 0.0, 1.0), kind="point", intensity=0.0 if i else 1.0)
    b.camera(translation=(0.0, 0.0, 4.0))
    with opened(gpu, b.build(), light_error=0.0, **SIZE) as source:
        shoot(source)
        assert source.light.tile_counts().max() == 1


def test_more_lights_than_a_loop_can_count_are_refused(gpu, monkeypatch):
    monkeypatch.setattr(light_stage, "MAX_LIGHTS", 1)
    with pytest.raises(GraphicsError), opened(gpu, lamp_field(2, 2, cells=2), **SIZE):
        pass
