"""Direct radiance against closed forms in float64 on the position channel, and against the shader's reference."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from light_tools import facing, floor, integrate_hemisphere, lambert, look, picture, worst
from references.punctual import incident
from repeated import few

from taubench_gl import math3d
from taubench_gl.metrics.lighting import SurfaceMaterial, evaluate_brdf
from taubench_gl.scene.builder import SceneBuilder, sphere
from taubench_gl.scene.model import Light, Scene

ALBEDO = 0.6
UP = np.array([0.0, 1.0, 0.0])
AIM = math3d.normalize(np.array([0.3, -1.0, 0.2]))
PLACE = np.array([0.4, 1.7, -0.3])
LIGHTS = {
    "point": Light(kind="point", intensity=20.0, color=(1.0, 0.5, 0.25)),
    "point with a range": Light(kind="point", intensity=20.0, range=2.4),
    "spot": Light(kind="spot", intensity=50.0, inner_cone=0.2, outer_cone=0.6),
    "spot with a range and a hard rim": Light(kind="spot", intensity=5.0, inner_cone=0.5, outer_cone=0.5, range=3.0),
    "directional": Light(kind="directional", intensity=3.0, color=(0.2, 1.0, 0.7)),
    "constant point": Light(kind="point", intensity=3.0, color=(0.2, 1.0, 0.7), constant=True),
    "constant spot": Light(kind="spot", intensity=3.0, inner_cone=0.2, outer_cone=0.6, constant=True),
}


def lit_floor(light: Light, *, place=PLACE, aim=AIM, **material) -> Scene:
    b = SceneBuilder()
    floor(b, material=lambert(b, ALBEDO, **material))
    b.light(translation=place, rotation=facing(aim), **{f.name: getattr(light, f.name) for f in fields(Light)})
    look(b, (0.0, 2.5, 3.0), (0.0, 0.0, 0.0), yfov=0.7)
    return b.build()


def closed_form(light: Light, points: np.ndarray) -> np.ndarray:
    """albedo / pi times irradiance of the plane y = 0, written out from KHR_lights_punctual, not from the reference."""
    cosine = np.full(points.shape[:-1], -AIM[1])
    gain = np.ones(points.shape[:-1])
    if light.kind != "directional":
        offset = PLACE - points
        d = np.sqrt(np.sum(offset**2, axis=-1))
        cosine = offset[..., 1] / d
        gain = np.ones_like(d) if light.constant else 1.0 / d**2
        if np.isfinite(light.range):
            gain = gain * np.clip(1.0 - (d / light.range) ** 4, 0.0, 1.0)
        if light.kind == "spot":
            toward = np.sum(-offset * AIM, axis=-1) / d
            inner, outer = np.cos(light.inner_cone), np.cos(light.outer_cone)
            gain = gain * np.clip((toward - outer) / max(inner - outer, 1e-3), 0.0, 1.0) ** 2
    return ALBEDO / np.pi * (light.intensity * cosine * gain)[..., None] * np.array(light.color)


@pytest.mark.parametrize("name", LIGHTS)
def test_a_lambert_plane_is_the_closed_form(gpu, name):
    light = LIGHTS[name]
    shot = picture(gpu, lit_floor(light), shadow_lights=0)
    expected = closed_form(light, shot.points)
    assert shot.surface.mean() > 0.9 and expected.max() > 0.05
    # A rim 1e-3 wide in cosine turns float32's rounding of the direction into more than 0.5 % of a dim pixel.
    lit = shot.surface & (expected.max(axis=-1) > 1e-2 * expected.max())
    assert worst(shot.direct, expected, lit) < 5e-3
    dark = shot.surface & (expected.max(axis=-1) == 0)
    assert np.all(shot.direct[dark] <= 1e-6 * expected.max())
    if np.isfinite(light.range) or light.kind == "spot":
        assert dark.sum() > 50, "the case does not reach beyond the light"


@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 0.15, 0.5, 1.0])
def test_metallic_roughness_pixels_equal_the_twin(gpu, metallic, roughness):
    """A sphere shows every angle; both lobes, each against metrics.lighting at the pixel's own position and normal."""
    b = SceneBuilder()
    color = (0.9, 0.5, 0.1, 1.0)
    material = b.material(base_color=color, metallic=metallic, roughness=roughness, specular=0.7)
    ball = sphere(1.0, 48)
    b.node(mesh=b.mesh(type(ball)(ball.positions, ball.triangles, material, normals=ball.normals)))
    b.light(translation=(2.0, 2.5, 2.0), kind="point", intensity=30.0)
    look(b, (0.0, 0.5, 3.0), (0.0, 0.0, 0.0), yfov=0.75)
    shot = picture(gpu, b.build(), shadow_lights=0, extra=("direct_diffuse", "direct_glossy"))
    n, g = shot["normal"][..., :3], shot["geometric_normal"][..., :3]
    v = math3d.normalize(-shot["position"][..., :3])
    light = Light(kind="point", intensity=30.0)
    to_light, irradiance = incident(light, np.array([2.0, 2.5, 2.0]), UP, shot.points)
    full = np.full(n.shape[:-1], 1.0)
    base = np.broadcast_to(np.array(color[:3]), n.shape)
    # Channels hold half floats: the reference gets the inputs of the shader.
    r = np.float64(np.float16(roughness))
    material = SurfaceMaterial(np.float64(np.float16(base)), full * metallic, full * r, float(np.float16(0.7)))
    diffuse, glossy = evaluate_brdf(material, n, v, to_light)
    # Where the triangle turns away nothing arrives; the rim itself is a matter of rounding.
    facing_light = np.sum(g * to_light, axis=-1)
    sure = shot.surface & (np.abs(facing_light) > 2e-3)
    lit = (facing_light > 0)[..., None]
    for name, lobe in (("direct_diffuse", diffuse), ("direct_glossy", glossy)):
        expected = np.where(lit, lobe * irradiance, 0.0)
        # alpha at its least gives a highlight 1e-3 wide: float32's half vector is good to some 1e-7, its square root
        # of the distance from the peak to 3e-4, so the lobe itself is compared by its floor.
        tolerance = 5e-3 if roughness > 0.1 else 0.08
        if expected.max() > 0:
            assert worst(shot[name][..., :3], expected, sure) < tolerance, name
        else:
            assert np.all(shot[name][..., :3] == 0)
    total = shot["direct_diffuse"][..., :3] + shot["direct_glossy"][..., :3]
    assert np.allclose(shot.direct, total, rtol=1e-6)


@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("degrees", few([45.0, 0.0, 75.0]))
def test_the_glossy_lobe_gives_back_no_more_than_it_gets(roughness, degrees):
    """Directional albedo of the reference, as a hemisphere integral; equal to an independent one over microfacets."""
    v = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
    n = np.array([0.0, 0.0, 1.0])

    def lobe(to_light):
        ones = np.ones(len(to_light))
        white = np.ones((len(to_light), 3))
        return evaluate_brdf(SurfaceMaterial(white, ones, ones * roughness), n, v, to_light)[1][:, 0]

    def microfacets(h):
        """Smith G of the masked-and-shadowed facets: the same integral over half vectors, weighted by D."""
        a2 = roughness**4
        h_z, v_h = h[:, 2], h @ v
        d = a2 / (np.pi * (h_z**2 * (a2 - 1) + 1) ** 2)
        to_light = 2 * v_h[:, None] * h - v
        l_z = to_light[:, 2]
        ok = (v_h > 0) & (l_z > 0)
        l_z = np.where(ok, l_z, 1.0)

        def smith_lambda(z):
            return 0.5 * (np.sqrt(1 + a2 * (1 / z**2 - 1)) - 1)

        g = 1.0 / (1.0 + smith_lambda(l_z) + smith_lambda(v[2]))
        return np.where(ok, d * g * v_h / v[2], 0.0)

    albedo, independent = (float(integrate_hemisphere(f, 300)) for f in (lobe, microfacets))
    assert albedo == pytest.approx(independent, rel=5e-3)
    assert 0.3 < albedo <= 1.0 + 1e-3


def uniform_sky_ball(base: float, *, roughness: float, metallic: float, specular: float) -> Scene:
    b = SceneBuilder()
    material = b.material(base_color=(base,) * 3 + (1.0,), metallic=metallic, roughness=roughness, specular=specular)
    ball = sphere(1.0, 32)
    b.node(mesh=b.mesh(type(ball)(ball.positions, ball.triangles, material, normals=ball.normals)))
    look(b, (0.0, 0.0, 3.0), (0.0, 0.0, 0.0), yfov=0.8)
    return b.build()


@pytest.mark.parametrize("roughness", few([0.3, 1.0, 0.6]))
@pytest.mark.parametrize(("metallic", "specular"), [(1.0, 1.0), (0.0, 1.0)])
def test_sky_light_is_the_lobes_hemisphere_integral(gpu, roughness, metallic, specular):
    """The sky's light comes from a table of each lobe's directional albedo: within 0.01 of the integral itself."""
    scene = uniform_sky_ball(0.8, roughness=roughness, metallic=metallic, specular=specular)
    shot = picture(gpu, scene, environment=(1.0, 1.0, 1.0), extra=("direct_glossy",))
    n, v = shot["normal"][..., :3], math3d.normalize(-shot["position"][..., :3])
    cosines = np.sum(n * v, axis=-1)
    for wanted in (0.95, 0.7, 0.4, 0.25):
        y, x = np.unravel_index(np.argmin(np.where(shot.surface, np.abs(cosines - wanted), np.inf)), cosines.shape)
        c = cosines[y, x]
        view = np.array([np.sqrt(1 - c * c), 0.0, c])

        def lobe(to_light, view=view):
            ones = np.ones(len(to_light))
            base = np.full((len(to_light), 3), 0.8)
            up = np.array([0.0, 0.0, 1.0])
            material = SurfaceMaterial(base, ones * metallic, ones * roughness, specular)
            lobes = evaluate_brdf(material, up, view, to_light)
            return np.stack([part[:, 0] for part in lobes], axis=-1)

        diffuse, glossy = integrate_hemisphere(lobe, 250)
        assert shot["direct_glossy"][y, x, 0] == pytest.approx(float(glossy), abs=0.01)
        assert shot["direct_diffuse"][y, x, 0] == pytest.approx(float(diffuse), abs=0.005)


@pytest.mark.parametrize("intensity", [1e-8, 1.0, 1e8])
def test_radiance_keeps_its_precision_over_sixteen_decades(gpu, intensity):
    light = Light(kind="directional", intensity=intensity)
    shot = picture(gpu, lit_floor(light), shadow_lights=0)
    # The base color is a half float, which llvmpipe rounds towards 0: all that is lost.
    stored = shot["base_color"][..., :1]
    assert np.all(np.abs(stored - ALBEDO) < 1e-3 * ALBEDO)
    assert worst(shot.direct, closed_form(light, shot.points) * stored / ALBEDO, shot.surface) < 1e-5
