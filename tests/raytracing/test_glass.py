"""Surfaces that light goes through: the shader's functions against float64, densities, energy, and closed forms."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from references.dielectric import Glass, fresnel, rough_slab, slab
from repeated import few
from scipy import stats
from shader_tools import map_rows, rows_glsl, with_main
from test_brdf_sampling import sphere_grid, view

from taubench_gl.lobes import SCENE_LOBES, lobe_channels, lobe_macros
from taubench_gl.math3d import normalize
from taubench_gl.metrics.bootstrap import holm_adjusted
from taubench_gl.metrics.lighting import MIN_ALPHA
from taubench_gl.scene.builder import SceneBuilder, quad, sphere, turn_y
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.geometry import one_metre_per_pixel
from taubench_gl.selftest.scenes import sky_file

Array = np.ndarray
ETAS = (1.5, 1.0 / 1.5, 1.1, 2.4)


@pytest.mark.parametrize("thick", [True, False])
@pytest.mark.parametrize("n_v", few([0.8, 0.3], 1))
@pytest.mark.parametrize("eta", few((1.5, 1.0 / 1.5, 2.4), 2))
def test_samples_are_distributed_as_the_lobes_say(thick: bool, n_v: float, eta: float) -> None:
    """Chi-square of weighted counts over 20 x 12 cells of the sphere, at a significance of 1e-3 for each case."""
    glass, count, v = Glass(0.6, eta, thick), 200_000, view(n_v)
    to_light, weight = glass.sample(np.broadcast_to(v, (count, 3)), np.random.default_rng(4).random((count, 3)))
    rows, columns, inside = 20, 12, 24
    grid = sphere_grid(rows * inside, columns * inside)
    value = np.sum(glass.evaluate(v, grid), axis=0).reshape(rows, inside, columns, inside).sum(axis=(1, 3))
    expected = value.ravel() * 4.0 * np.pi / (rows * columns * inside**2)
    used = weight > 0
    row = np.clip(((to_light[used, 2] + 1.0) / 2.0 * rows).astype(int), 0, rows - 1)
    column = (np.arctan2(to_light[used, 1], to_light[used, 0]) / (2.0 * np.pi) % 1.0 * columns).astype(int)
    cell = row * columns + np.clip(column, 0, columns - 1)
    mean = np.bincount(cell, weight[used], minlength=rows * columns) / count
    square = np.bincount(cell, weight[used] ** 2, minlength=rows * columns) / count
    many = np.bincount(cell, minlength=rows * columns) > 200
    z_score = (mean - expected)[many] / np.sqrt((square - mean**2)[many] / count + (2e-3 * expected[many]) ** 2)
    assert stats.chi2.sf(np.sum(z_score**2), many.sum()) > 1e-3
    assert mean.sum() == pytest.approx(expected.sum(), abs=5e-3) and mean.sum() <= 1.0


MAIN = rows_glsl("""void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec4 v = rows[5u * i], u = rows[5u * i + 1u], l = rows[5u * i + 2u], m = rows[5u * i + 3u], f = rows[5u * i + 4u];
    Surface s;
    s.base_color = vec3(1.0);
    s.metallic = 0.0;
    s.alpha = v.w;
    s.specular = u.w;
    s.n = vec3(0.0, 0.0, 1.0);
    s.v = v.xyz;
    s.f0 = vec3(f.x);
    s.transmission = m.x;
    s.eta = m.y;
    s.thick = m.z > 0.5;
    BrdfSample drawn = sample_brdf(s, u.xyz);
    Lobes at = evaluate_brdf(s, drawn.l), other = evaluate_brdf(s, l.xyz);
    results[4u * i] = vec4(drawn.l, drawn.pdf);
    results[4u * i + 1u] = vec4(at.diffuse.x, at.glossy.x, at.transmission.x, brdf_pdf(s, drawn.l));
    results[4u * i + 2u] = vec4(other.diffuse.x, other.glossy.x, other.transmission.x, brdf_pdf(s, l.xyz));
    results[4u * i + 3u] = vec4(glossy_share(s), dielectric_fresnel(s, clamp(dot(s.v, s.n), 0.0, 1.0)).x, 0.0, 0.0);
}
""")
GLASS = {"DIELECTRICS": True, "TRANSMISSION": True, **lobe_macros(SCENE_LOBES)}


def glass_rows(count: int, roughness: Array, seed: int = 5, etas: tuple[float, ...] = ETAS) -> tuple[Array, Glass]:
    """(count, 5, 4) float32 rows for MAIN and the same glass in float64."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((count, 5, 4), np.float32)
    v = normalize(rng.normal(size=(count, 3)))
    v[:, 2] = np.abs(v[:, 2])
    rows[:, 0, :3], rows[:, 0, 3] = v, np.maximum(roughness**2, MIN_ALPHA)
    rows[:, 1, :3] = np.floor(rng.random((count, 3)) * 2**24) / 2**24
    rows[:, 1, 3] = np.where(rng.random(count) < 0.5, 1.0, rng.random(count))
    rows[:, 2, :3] = normalize(rng.normal(size=(count, 3)))
    rows[:, 3, 0] = np.where(rng.random(count) < 0.5, 1.0, rng.uniform(0.2, 1.0, count))
    rows[:, 3, 1] = rng.choice(etas, count)
    rows[:, 3, 2] = 1.0
    r = rows.astype(np.float64)
    tint = rng.uniform(0.5, 1.5, count)
    glass = Glass(np.sqrt(r[:, 0, 3]), r[:, 3, 1], True, r[:, 3, 0], r[:, 1, 3], tint)
    rows[:, 4, 0] = np.minimum(fresnel(1.0, glass.eta) * tint, 1.0) * glass.specular
    return rows, glass


@pytest.mark.parametrize("thick", [True, False])
def test_the_shader_is_the_reference(gpu, thick: bool) -> None:
    """Values of all lobes in other directions, the density that they are drawn with, and the weights of samples."""
    count = 20_000
    rows, glass = glass_rows(count, np.random.default_rng(9).uniform(0.25, 1.0, count))
    rows[:, 3, 2] = thick
    glass = dataclasses.replace(glass, thick=thick)
    got = map_rows(gpu, with_main(gpu, "common/brdf_sampling.glsl", MAIN, GLASS), rows, 16).astype(np.float64)
    r = rows.astype(np.float64)
    v, other, u = normalize(r[:, 0, :3]), normalize(r[:, 2, :3]), r[:, 1, :3]
    np.testing.assert_allclose(got[:, 13], glass.reflectance(v[:, 2]), atol=2e-5)
    clear = (np.abs(other[:, 2]) > 1e-3) & (v[:, 2] > 1e-3)
    for expected, measured in zip(glass.evaluate(v, other), (got[:, 9], got[:, 10]), strict=True):
        assert np.mean(np.abs(measured - expected)[clear] <= 1e-5 + 2e-3 * expected[clear]) > 0.998
    # A sample is that of the reference where it is drawn from normals, and its density is brdf_pdf there.
    of_normals, share = u[:, 2] < got[:, 12] - 1e-6, got[:, 12]
    to_light, weight = glass.sample(v, np.stack([u[:, 0], u[:, 1], u[:, 2] / share], axis=-1))
    all_through = (
        of_normals & (glass.transmission == 1.0) & (weight > 0) & (v[:, 2] > 0.05) & (np.abs(to_light[:, 2]) > 0.02)
    )
    near = np.abs(got[:, :3] - to_light).max(axis=1) < 1e-3
    assert all_through.sum() > 2_000 and near[all_through].mean() > 0.995
    used = all_through & near
    ratio = (got[:, 5] + got[:, 6])[used] / got[used, 3] / weight[used]
    assert abs(np.median(ratio) - 1.0) < 1e-4 and np.mean(np.abs(ratio - 1.0) < 0.02) > 0.99
    np.testing.assert_array_equal(got[:, 3][got[:, 3] > 0], got[:, 7][got[:, 3] > 0])


def test_the_density_of_glass_integrates_to_one(gpu) -> None:
    """Densities over all directions, and samples on the wrong side: 1, of surfaces that are part diffuse too."""
    side, cases = 256, 6
    grid = sphere_grid(side, side).reshape(-1, 3)
    program = with_main(gpu, "common/brdf_sampling.glsl", MAIN, GLASS)
    rows, _ = glass_rows(len(grid) * cases, np.full(len(grid) * cases, 0.95), 11, (1.5, 1.0 / 1.5, 2.4))
    rows = rows.reshape(cases, len(grid), 5, 4)
    rows[:, :, [0, 3, 4]] = rows[:, :1, [0, 3, 4]]
    rows[:, :, 1, 3] = rows[:, :1, 1, 3]
    rows[:, :, 2, :3] = grid
    got = map_rows(gpu, program, rows.reshape(-1, 5, 4), 16).astype(np.float64).reshape(cases, len(grid), 16)
    integral = got[..., 11].mean(axis=1) * 4.0 * np.pi
    lost = np.mean(got[..., 3] == 0.0, axis=1)
    np.testing.assert_allclose(integral + lost, 1.0, atol=8e-3)


SIZE = (8, 8)
LOBES = lobe_channels(SCENE_LOBES)
IOR, SAMPLES = 1.5, 1024
ONE_SAMPLE = 1.0 / SAMPLES
"""A sample is reflected or goes through: shares of 1,024 stratified ones are off by about one."""


def glass_material(b: SceneBuilder, **fields) -> int:
    """Smooth clear glass that bounds a volume."""
    return b.material(**({"metallic": 0.0, "roughness": 0.0, "transmission": 1.0, "thick": True} | fields))


def pane(
    bench: Bench, angle: float, *, depths: tuple[float, ...] = (0.0,), glow: float | None = None, **fields
) -> Scene:
    """Wide glass faces, 1 m a pixel, turned by ``angle`` degrees; the first one's front looks at the camera.

    ``depths``: of the faces along the normal of the first; ``glow``: behind them shines a half plane, x above it.
    """
    b, half = SceneBuilder(), 50.0
    m = glass_material(b, **fields)
    n = np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])
    for k, depth in enumerate(depths):
        at = np.array([0.0, 0.0, -60.0]) - depth * n
        b.node(mesh=b.mesh(quad(half, 60.0, material=m)), translation=at, rotation=turn_y(angle + 180.0 * (k > 0)))
    if glow is not None:
        lamp = b.material(base_color=(0.0, 0.0, 0.0, 1.0), metallic=0.0, specular=0.0, emissive=(1.0, 1.0, 1.0))
        b.node(mesh=b.mesh(quad(1000.0, 1000.0, material=lamp)), translation=(1000.0 + glow, 0.0, -110.0))
    one_metre_per_pixel(b, bench)
    return b.build()


def middle(image: Array) -> float:
    return float(image[..., 0].mean())


def traced(bench: Bench, scene: Scene, **settings) -> dict[str, float]:
    frame = bench.traced(scene, extra=LOBES, **({"spp": SAMPLES} | settings))
    return {name: middle(image) for name, image in frame.items()}


@pytest.mark.long
@pytest.mark.parametrize(("angle", "eta"), [(0.0, IOR), (60.0, IOR), (80.0, IOR), (30.0, 1.0 / IOR), (50.0, 1.0 / IOR)])
def test_a_face_of_glass_reflects_as_fresnel_says(gpu, angle, eta):
    """In a uniform sky of radiance 1 the glossy lobe is Fresnel's factor, and the rest goes through, in one bounce.

    From inside the glass all light is reflected beyond the critical angle of 41.8 degrees.
    """
    inside = eta < 1.0
    with Bench(gpu, SIZE) as bench:
        scene = pane(bench, angle, depths=(0.0, 1.0) if inside else (0.0,), double_sided=inside)
        if inside:
            mesh = np.where(np.arange(len(scene.nodes)) == 0, -1, scene.nodes.mesh)
            scene = dataclasses.replace(scene, nodes=dataclasses.replace(scene.nodes, mesh=mesh))
        light = traced(bench, scene, environment=(1.0, 1.0, 1.0), bounces=1, culling="none" if inside else "gltf")
    f = fresnel(np.cos(np.radians(angle)), eta)
    assert light["direct_glossy"] == pytest.approx(f, abs=ONE_SAMPLE)
    assert light["direct_transmission"] == pytest.approx(1.0 - f, abs=ONE_SAMPLE)
    assert light["direct"] == pytest.approx(1.0, rel=1e-3) and light["indirect"] == 0.0


@pytest.mark.parametrize("angle", [60.0, *few([0.0], 0)])
def test_a_slab_absorbs_along_the_refracted_way(gpu, angle):
    """All orders of reflection between the faces: the closed forms of a slab, in each color of its own."""
    color, distance, depth = (0.9, 0.5, 0.1), 2.0, 3.0
    with Bench(gpu, SIZE) as bench:
        scene = pane(bench, angle, depths=(0.0, depth), attenuation_color=color, attenuation_distance=distance)
        frame = bench.traced(scene, extra=LOBES, environment=(1.0, 1.0, 1.0), spp=SAMPLES, bounces=12)
    f = fresnel(np.cos(np.radians(angle)), IOR)
    inside = np.sqrt(1.0 - (np.sin(np.radians(angle)) / IOR) ** 2)
    reflected, through = slab(f, np.array(color) ** (depth / inside / distance))
    means = {name: image[..., :3].mean(axis=(0, 1)) for name, image in frame.items()}
    np.testing.assert_allclose(means["direct_glossy"], f, atol=ONE_SAMPLE)
    np.testing.assert_allclose(means["indirect_transmission"], reflected - f + through, atol=3 * ONE_SAMPLE)
    assert not means["direct_transmission"].any() and not means["indirect_diffuse"].any()


@pytest.mark.parametrize("thick", [True, False])
def test_a_slab_shifts_what_is_behind_it_and_a_thin_wall_does_not(gpu, thick):
    """A plate of 10 m at 50 degrees moves an edge by d sin(a) (1 - cos(a) / (n cos(b))); no other pixel is wrong."""
    angle, depth = 50.0, 10.0
    with Bench(gpu, (32, 4)) as bench:
        scene = pane(bench, angle, depths=(0.0, depth) if thick else (0.0,), thick=thick, glow=0.25)
        frame = bench.traced(scene, extra=LOBES, spp=512, bounces=2)
    shown = frame["indirect_transmission" if thick else "direct_transmission"][..., 0]
    a = np.radians(angle)
    inside = np.sqrt(1.0 - (np.sin(a) / IOR) ** 2)
    shift = depth * np.sin(a) * (1.0 - np.cos(a) / (IOR * inside)) if thick else 0.0
    through = (1.0 - fresnel(np.cos(a), IOR)) ** (2 if thick else 1)
    behind = np.arange(32) - 15.5 - shift - 0.25  # the ray turns to the normal, which leans to +x, and so to -x
    clear = np.abs(behind) > 0.3
    assert np.array_equal(shown.mean(axis=0)[clear] > 0.5 * through, behind[clear] > 0.0)
    np.testing.assert_allclose(shown[:, clear & (behind > 0)].mean(), through, rtol=4e-3)
    assert np.abs(shown[:, clear & (behind < 0)]).max() < 0.02


def test_light_through_a_ball_turns_as_snell_says(gpu):
    """Under a sky of radiance 1 + y, two refractions turn a ray by 2 (a - b); absorbed along the chord."""
    color, radius = (0.8, 0.5, 0.3), 30.0
    rows = np.arange(32)[:, None] + 0.5
    sky = np.broadcast_to((1.0 + np.cos(np.pi * rows / 32))[..., None], (32, 64, 3))
    with Bench(gpu, (4, 64)) as bench, sky_file(sky) as path:  # the middle columns, half a meter beside the axis
        b = SceneBuilder()
        m = glass_material(b, attenuation_color=color, attenuation_distance=2.0 * radius)
        b.node(mesh=b.mesh(dataclasses.replace(sphere(radius, 192), material=m)), translation=(0.0, 0.0, -100.0))
        one_metre_per_pixel(b, bench)
        frame = bench.traced(b.build(), extra=(*LOBES, "position"), environment=path, spp=64, bounces=2)
    y = 31.5 - np.arange(64)
    near = np.abs(y) < 0.8 * radius
    a = np.arcsin(np.abs(y[near]) / radius)
    inside = np.arcsin(np.sin(a) / IOR)
    turned = np.sign(y[near]) * 2.0 * (a - inside)  # towards the axis
    left = np.array(color) ** np.cos(inside)[:, None]  # chord 2 r cos(b) over 2 r
    f = fresnel(np.cos(a), IOR)[:, None]
    expected = (1.0 - f) ** 2 * left * (1.0 - np.sin(turned))[:, None]
    measured = frame["indirect_transmission"][near, 1:3, :3].mean(axis=1)
    np.testing.assert_allclose(measured, expected, rtol=2e-2, atol=4e-3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("roughness", "angle", "thick"), [(0.5, 60.0, True), (0.3, 0.0, True), (0.8, 30.0, True), (0.6, 45.0, False)]
)
def test_rough_glass_is_that_of_random_walks(gpu, roughness, angle, thick):
    """z-tests of 32 seeds against 400,000 float64 walks: reflected, then through; Holm at 1e-3 for the two.

    A slab of two faces with all its bounces, and a thin wall, which loses no more than the masking of its one sample.
    """
    absorbs = {"attenuation_color": (0.5,) * 3, "attenuation_distance": 4.0} if thick else {"thick": False}
    own = {"environment": (1.0, 1.0, 1.0), "spp": 8, "bounces": 12 if thick else 1, "pattern": "independent"}
    with Bench(gpu, SIZE) as bench:
        scene = pane(bench, angle, depths=(0.0, 2.0) if thick else (0.0,), roughness=roughness, **absorbs)
        runs = [traced(bench, scene, seed=seed, **own) for seed in range(32)]
    through = "indirect_transmission" if thick else "direct_transmission"
    values = np.array([[run["direct_glossy"], run[through]] for run in runs])
    glass, n_v, count = Glass(roughness, IOR, thick), np.cos(np.radians(angle)), 400_000
    if thick:
        mean, error = rough_slab(glass, n_v, 0.5 * np.log(2.0), count, 3, most=11)
        mean, error = np.array([mean[0], mean[1] + mean[2]]), np.array([error[0], np.hypot(error[1], error[2])])
    else:
        to_light, weight = glass.sample(
            np.broadcast_to(view(n_v), (count, 3)), np.random.default_rng(2).random((count, 3))
        )
        walks = weight * np.stack([to_light[:, 2] > 0, to_light[:, 2] < 0])
        mean, error = walks.mean(axis=1), walks.std(axis=1) / np.sqrt(count)
    own_error = values.std(axis=0, ddof=1) / np.sqrt(len(values))
    z = (values.mean(axis=0) - mean) / np.hypot(own_error, error)
    adjusted = holm_adjusted(2.0 * stats.norm.sf(np.abs(z)))
    assert (adjusted > 1e-3).all(), (z, values.mean(axis=0), mean)
    assert own_error.max() < 0.01
