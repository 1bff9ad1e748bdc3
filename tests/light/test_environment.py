"""Environments against closed forms: the default one (a uniform sky and a sun)."""

from __future__ import annotations

import numpy as np
import pytest
from light_tools import floor, lambert, look, look_down, opened, picture, shoot, worst

from taubench_gl.effects.census import census
from taubench_gl.effects.decide import decide
from taubench_gl.effects.lighting import DEFAULT_RADIANCE, DEFAULT_SUN
from taubench_gl.frame.plan import FramePlan
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.scenes import SceneBuilder, box
from taubench_gl.settings import Settings

ALBEDO = 0.6
SKY = np.array(DEFAULT_RADIANCE)
SUN = np.array(DEFAULT_SUN.irradiance)
UP = -np.array(DEFAULT_SUN.direction)[1]
"""Cosine of the sun's angle from the vertical."""


def table(*, block: bool = False) -> Scene:
    """A Lambert floor seen from above, with a black block on it if ``block``."""
    b = SceneBuilder()
    floor(b, material=lambert(b, ALBEDO))
    if block:
        mesh = b.mesh(box((0.5, 0.5, 0.5), material=lambert(b, 0.0)))
        b.node(mesh=mesh, translation=(0.0, 0.5, 0.0))
    look_down(b, 2.0)
    return b.build()


def test_the_sun_is_a_unit_direction_above_the_horizon():
    assert np.linalg.norm(DEFAULT_SUN.direction) == pytest.approx(1.0, abs=1e-12)
    assert pytest.approx(0.8) == UP


def test_a_horizontal_lambert_plane_has_the_irradiance_of_sky_and_sun(gpu):
    """Irradiance pi sky + 0.8 sun; a Lambert plane reflects albedo / pi of it."""
    shot = picture(gpu, table(), environment="default", columns=("frustum", "direct", "color"), shadow_size=256)
    irradiance = np.pi * SKY + UP * SUN
    expected = np.broadcast_to(ALBEDO / np.pi * irradiance, shot.direct.shape)
    assert shot.surface.mean() > 0.9
    assert worst(shot.direct, expected, shot.surface) < 1e-3


def test_light_unit_divides_neither_sky_nor_sun(gpu):
    shots = [picture(gpu, table(), environment="default", light_unit=u, shadow_size=256) for u in ("watt", "candela")]
    assert np.array_equal(shots[0].direct, shots[1].direct)


def test_the_sun_casts_shadows_in_which_the_sky_remains(gpu):
    shot = picture(gpu, table(block=True), environment="default", shadow_size=256)
    on_floor = shot.surface & (np.abs(shot.points[..., 1]) < 1e-3)
    levels = shot.direct[on_floor][:, 0]
    shadowed = np.isclose(levels, ALBEDO * SKY[0], rtol=1e-3)
    lit = np.isclose(levels, ALBEDO / np.pi * (np.pi * SKY + UP * SUN)[0], rtol=1e-3)
    assert shadowed.sum() > 50 and lit.sum() > 500
    assert (shadowed | lit).mean() > 0.85, "the rest is the filtered edge of the shadow"
    # The block is 1 m high: its shadow is as long as the sun's direction says.
    points = shot.points[on_floor][shadowed]
    length = 1.0 / UP * np.hypot(DEFAULT_SUN.direction[0], DEFAULT_SUN.direction[2])
    assert np.hypot(points[:, 0], points[:, 2]).max() < np.hypot(0.5, 0.5) + length
    toward = points[:, [0, 2]] @ np.array(DEFAULT_SUN.direction)[[0, 2]]
    assert toward.mean() > 0.2, "the shadow is not on the far side"


def test_a_file_with_lights_keeps_them_beside_the_sun(gpu):
    """Light adds up: file and environment together are each alone."""
    b = SceneBuilder()
    floor(b, material=lambert(b, ALBEDO))
    b.light(kind="point", intensity=20.0, translation=(0.3, 1.5, 0.2))
    look(b, (0.0, 2.5, 3.0), (0.0, 0.0, 0.0), yfov=0.7)
    scene = b.build()
    both, own, sky = (
        picture(gpu, s, environment=e, shadow_size=256)
        for s, e in ((scene, "default"), (scene, "none"), (unlit(scene), "default"))
    )
    assert worst(both.direct, own.direct + sky.direct, both.surface) < 1e-5


def unlit(scene: Scene) -> Scene:
    import dataclasses

    return dataclasses.replace(scene, nodes=dataclasses.replace(scene.nodes, light=np.full(len(scene.nodes), -1)))


@pytest.mark.parametrize("shadow_lights", [0, 1])
def test_the_sun_is_an_effect_and_no_light_of_the_scene(gpu, shadow_lights):
    scene = table()
    settings = Settings(width=64, height=48, environment="default", shadow_lights=shadow_lights, shadow_size=256)
    effects = decide(scene, settings)
    assert effects["sky"].enabled and effects["sun"].enabled and effects["direct"].enabled
    assert effects["shadows"].enabled == bool(shadow_lights) == effects["indirect"].enabled
    assert not effects["directional_lights"].enabled
    counts = census(scene, [0.0, 1.0])
    assert counts["static_directional_lights"] == counts["dynamic_directional_lights"] == 0
    plan = FramePlan(scene, settings)
    assert ("shadows" in plan.resources().passes) == bool(shadow_lights)
    assert plan.costs()["sun"]["on"]
    with opened(gpu, scene, environment="default", shadow_lights=shadow_lights, shadow_size=256) as source:
        shoot(source)
        assert any("sky" in note for note in source.describe()["notes"])


def test_without_an_environment_nothing_of_it_is_simulated():
    effects = decide(table(), Settings(environment="none"))
    assert not effects["sky"].enabled and not effects["sun"].enabled and not effects["direct"].enabled
    uniform = decide(table(), Settings(environment=(1.0, 1.0, 1.0)))
    assert uniform["sky"].enabled and not uniform["sun"].enabled and not uniform["shadows"].enabled


def test_stochastic_light_of_the_default_environment_is_exact_without_indirect_light(gpu):
    """One light, unoccluded: each of its samples is the light itself."""
    from taubench_gl.animation import choose_camera
    from taubench_gl.frame.shading import Shading
    from taubench_gl.frame.sources import RasterSource, SourceOptions

    scene = table()
    settings = Settings(width=64, height=48, columns=("direct",), environment="default", shadow_size=256)
    source = RasterSource(
        gpu, scene, choose_camera(scene), settings, SourceOptions(shading=Shading(light_samples=1, indirect_samples=1))
    )
    try:
        shot = shoot(source)
    finally:
        source.release()
    expected = np.broadcast_to(ALBEDO / np.pi * (np.pi * SKY + UP * SUN), shot.direct.shape)
    assert worst(shot.direct, expected, shot.surface) < 1e-3
