"""Stochastic light: random numbers bit for bit, estimates against their references, means against exact light."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from references.punctual import incident
from references.shading_rate import shaded
from references.stochastic import choose, estimate_direct, estimate_indirect, random4

from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.metrics.lighting import SurfaceMaterial, evaluate_brdf
from taubench_gl.metrics.shading_rate import RATES
from taubench_gl.metrics.stochastic import light_choice
from taubench_gl.scene.builder import SceneBuilder, box, quad, turn_x

SIZE = (48, 32)
COLUMNS = ("frustum", "position", "normal", "direct", "indirect")
LIGHTS = (
    ((1.5, 2.0, 0.5), (1.0, 0.8, 0.6), 30.0),
    ((-1.5, 1.5, 1.0), (0.4, 0.6, 1.0), 12.0),
    ((0.0, 2.5, -1.0), (1.0, 1.0, 1.0), 2.0),
    ((0.0, 2.0, 0.0), (1.0, 1.0, 1.0), 0.0),  # off
)


def lit_scene():
    b = SceneBuilder()
    gray = b.material(base_color=(0.7, 0.5, 0.4, 1.0), metallic=0.0, roughness=0.6)
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=gray)), rotation=turn_x(-90.0))
    b.node(mesh=b.mesh(box((1.0, 1.0, 1.0), material=gray)), translation=(0.0, 0.5, -0.4))
    for place, color, intensity in LIGHTS:
        b.light(translation=place, color=color, intensity=intensity)
    b.camera(translation=(0.0, 2.0, 4.0), rotation=turn_x(-22.0), yfov=np.radians(50.0), znear=0.1)
    return b.build()


def source_of(gpu, **shading):
    settings = fixed_settings(
        width=SIZE[0], height=SIZE[1], columns=COLUMNS, indirect="rsm", indirect_samples=96, shadow_size=128,
        light_error=0.0, shadow_lights=shading.pop("shadow_lights", 8), environment=shading.pop("environment", "none"),
    )  # fmt: skip
    scene = lit_scene()
    return RasterSource(gpu, AnimatedScene(scene), settings, shading=Shading(**shading))


@pytest.fixture
def opened(gpu):
    made = []

    def make(**shading):
        made.append(source_of(gpu, **shading))
        return made[-1]

    yield make
    for source in made:
        source.release()
    gpu.collect()


def light(source, frame=0):
    """direct and indirect (h, w, 3) float64 of one frame."""
    source.advance(frame)
    return [source.read(name)[..., :3].astype(np.float64) for name in ("direct", "indirect")]


def test_frequencies_of_chosen_lights():
    choice = light_choice(np.array([3.0, 0.0, 1.0, 0.0]))
    np.testing.assert_allclose(choice[:, 1], [0.5 * 0.75 + 0.25, 0, 0.5 * 0.25 + 0.25, 0], atol=1e-7)
    u = random4((256, 256), 0, 0, 0)[..., 0].ravel()
    share = np.bincount(choose(u, choice), minlength=4) / u.size
    np.testing.assert_allclose(share, choice[:, 1], atol=5 * 0.5 / 256)
    assert share[1] == share[3] == 0
    assert not light_choice(np.zeros(3)).any() and light_choice(np.zeros(0)).shape == (0, 2)


def per_light_direct(source):
    """Radiance of each light alone, without shadows, (N, h, w, 3) float64."""
    view = source.renderer.frame.view
    channel = {n: source.read(n).astype(np.float64) for n in ("position", "normal", "geometric_normal", "material")}
    base = source.read("base_color").astype(np.float64)[..., :3]
    p, n = channel["position"], channel["normal"][..., :3]
    surface = p[..., 3] > 0
    points = p[..., :3] + view.position
    to_eye = -p[..., :3] / np.maximum(np.linalg.norm(p[..., :3], axis=-1, keepdims=True), 1e-9)
    scene, out = source.renderer.scene, []
    for (place, _, _), lamp in zip(LIGHTS, scene.lights, strict=True):
        to_light, radiance = incident(lamp, np.array(place), np.array([0.0, 0.0, -1.0]), points)
        material = SurfaceMaterial(base, channel["material"][..., 0], channel["material"][..., 1])
        lobes = evaluate_brdf(material, n, to_eye, to_light)
        facing = np.sum(channel["geometric_normal"][..., :3] * to_light, axis=-1) > 0
        out.append(np.where((surface & facing)[..., None], (lobes[0] + lobes[1]) * radiance, 0.0))
    return np.array(out)


def test_direct_estimate_against_its_reference(opened):
    source = opened(light_samples=3, indirect_samples=1, seed=11, shadow_lights=0)
    source.advance(5)
    got = source.read("direct")[..., :3].astype(np.float64)
    choice = light_choice(np.array([max(c) * i for _, c, i in LIGHTS]))
    expected = estimate_direct(per_light_direct(source), choice, SIZE, 5, 11, 3)
    off = np.abs(got - expected).max(axis=-1) > 1e-3 * np.maximum(expected.max(axis=-1), 1e-3)
    assert off.mean() < 2e-3  # a highlight's edge, or facing within rounding
    assert expected.max() > 0.5


def test_indirect_estimate_against_its_reference(opened):
    source = opened(light_samples=1, indirect_samples=5, seed=2)
    _, got = light(source, 3)
    view = source.renderer.frame.view
    lamps = source.light.vpls()
    position = source.read("position").astype(np.float64)
    normal, material = (source.read(n).astype(np.float64) for n in ("normal", "material"))
    base = source.read("base_color").astype(np.float64)[..., :3]
    record = source.light.indirect.record(source.renderer.frame)
    x = position[..., :3] + record["scene_from_relative"][:3].astype(np.float64)
    d = lamps["position"][:, None, None, :3].astype(np.float64) - x
    d2 = np.sum(d**2, axis=-1)
    to = d / np.sqrt(np.maximum(d2, 1e-30))[..., None]
    cosines = np.maximum(np.sum(normal[..., :3] * to, axis=-1), 0.0)
    cosines *= np.maximum(-np.sum(lamps["normal"][:, None, None, :3] * to, axis=-1), 0.0)
    weight = cosines / (np.pi * d2 + lamps["position"][:, None, None, 3])
    irradiance = lamps["flux"][:, None, None, :3].astype(np.float64) * weight[..., None]
    fresnel = 0.04 * material[..., 3:4]
    albedo = (
        (1 - material[..., :1]) * (1 - fresnel) * base + (1 - material[..., :1]) * fresnel + material[..., :1] * base
    )
    surface = (position[..., 3] > 0)[..., None]
    expected = np.where(surface, estimate_indirect(irradiance, SIZE, 3, 2, 5) * albedo / np.pi, 0.0)
    np.testing.assert_allclose(got, expected, atol=2e-4 * expected.max())
    assert view is not None and expected.max() > 1e-3


def test_mean_of_many_frames_is_exact_light(opened):
    """Lights, shadows, indirect and sky: within 5 standard errors except for a few pixels, with errors decreasing as
    1/sqrt(n)."""
    sky = (0.3, 0.4, 0.5)
    exact = light(opened(gather_each=True, environment=sky))
    # One indirect sample alone has too heavy a tail for 5 sigma.
    noisy = opened(light_samples=1, indirect_samples=32, seed=1, environment=sky)
    counts, totals, squares, error = (9, 144), [0.0, 0.0], [0.0, 0.0], {}
    for frame in range(max(counts)):
        for k, value in enumerate(light(noisy, frame)):
            totals[k] = totals[k] + value
            squares[k] = squares[k] + value**2
        if frame + 1 in counts:
            error[frame + 1] = [np.sqrt(np.mean((t / (frame + 1) - e) ** 2)) for t, e in zip(totals, exact)]
    n = max(counts)
    for k in range(2):
        mean = totals[k] / n
        spread = np.sqrt(np.maximum(squares[k] / n - mean**2, 0.0) / (n - 1))
        beyond = np.abs(mean - exact[k]) > 5 * spread + 1e-4 * exact[k].max()
        assert beyond.mean() < 0.01, f"{100 * beyond.mean():.2f} % beyond 5 standard errors"
        assert abs((mean - exact[k]).mean()) < 4 * np.sqrt(np.mean(spread**2) / mean.size) + 1e-4 * exact[k].mean()
        fell = error[counts[0]][k] / error[counts[1]][k]
        assert 3.0 < fell < 5.3, f"error fell by {fell:.2f}, expected sqrt(16) = 4"


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("kind", ["exact", "random"])
def test_shaded_pixels_of_each_rate(opened, rate, kind):
    samples = {"light_samples": 1, "indirect_samples": 2} if kind == "random" else {}
    whole, part = opened(**samples), opened(rate=rate, **samples)
    for frame in range(5):
        for full, some in zip(light(whole, frame), light(part, frame)):
            done = shaded(rate, SIZE, frame)
            np.testing.assert_array_equal(some[done], full[done])
    union = np.any([shaded(rate, SIZE, f) for f in range(4)], axis=0)
    assert union.all()


@pytest.mark.parametrize("filtering", ["bilinear", "hard"])
def test_mean_with_all_light_types_and_tile_lists(gpu, filtering):
    """Spots, a directional light, more lights than are unrolled: within 4 standard errors of exact light."""
    b = SceneBuilder()
    gray = b.material(base_color=(0.6, 0.6, 0.6, 1.0), metallic=0.0, roughness=0.8)
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=gray)), rotation=turn_x(-90.0))
    b.node(mesh=b.mesh(box((0.5, 0.5, 0.5), material=gray)), translation=(0.0, 0.5, 0.0))
    b.light(kind="directional", intensity=1.5, rotation=turn_x(-60.0))
    for k in range(18):
        angle = 2.0 * np.pi * k / 18
        place = (2.5 * np.cos(angle), 1.2, 2.5 * np.sin(angle))
        kind = {"kind": "spot", "outer_cone": 0.9, "rotation": turn_x(-90.0)} if k % 2 else {"range": 6.0}
        b.light(translation=place, intensity=2.0 + k, color=(1.0, 0.5 + 0.02 * k, 0.5), **kind)
    b.camera(translation=(0.0, 2.5, 5.0), rotation=turn_x(-25.0), yfov=np.radians(50.0), znear=0.1)
    scene = b.build()
    settings = fixed_settings(
        width=SIZE[0], height=SIZE[1], columns=COLUMNS, indirect="none", shadow_size=64, light_error=0.0,
        shadow_filter=filtering,
    )  # fmt: skip
    exact = RasterSource(gpu, AnimatedScene(scene), settings)
    noisy = RasterSource(
        gpu,
        AnimatedScene(scene),
        settings,
        shading=Shading(light_samples=4, indirect_samples=1, seed=9),
    )
    exact.advance(0)
    assert exact.light.tile_counts() is not None
    expected = exact.read("direct")[..., :3].astype(np.float64)
    frames = []
    for frame in range(64):
        noisy.advance(frame)
        frames.append(noisy.read("direct")[..., :3].astype(np.float64))
    means = np.array([f.mean(axis=(0, 1)) for f in frames])
    error = means.std(axis=0, ddof=1) / np.sqrt(len(frames))
    assert (np.abs(means.mean(axis=0) - expected.mean(axis=(0, 1))) < 4 * error).all()
    assert (error < 0.02 * expected.mean(axis=(0, 1))).all()  # or the test could not fail
    for source in (exact, noisy):
        source.release()
    gpu.collect()
