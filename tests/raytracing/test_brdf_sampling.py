"""Directions drawn for the BRDF: density, distribution, albedo, and the shader against the float64 reference."""

from __future__ import annotations

import numpy as np
import pytest
from references.brdf_sampling import basis_around, brdf_pdf, glossy_share, sample_brdf
from references.lobes import table_lookup
from repeated import few
from scipy import stats
from shader_tools import map_rows, rows_glsl, with_main

from taubench_gl.math3d import normalize
from taubench_gl.metrics.lighting import MIN_ALPHA, SurfaceMaterial, albedo_table, evaluate_brdf

Array = np.ndarray
UP = np.array([0.0, 0.0, 1.0])
KINDS = {"metal": (1.0, 1.0), "dielectric": (0.0, 1.0), "mixed": (0.4, 0.7), "lambert": (0.0, 0.0)}
"""Metallic and specular factor."""


def material(kind: str, roughness: float, color=(0.7, 0.5, 0.2)) -> SurfaceMaterial:
    metallic, specular = KINDS[kind]
    return SurfaceMaterial(np.array(color), np.float64(metallic), np.float64(roughness), specular)


def view(n_v: float) -> Array:
    return np.array([np.sqrt(1.0 - n_v**2), 0.0, n_v])


def numbers(count: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).random((count, 3))


def sphere_grid(rows: int, columns: int, lowest: float = -1.0) -> Array:
    """Midpoints of equal solid angles with z from ``lowest`` to 1: (rows, columns, 3) unit."""
    z = lowest + (np.arange(rows) + 0.5) / rows * (1.0 - lowest)
    z, phi = np.meshgrid(z, 2.0 * np.pi * (np.arange(columns) + 0.5) / columns, indexing="ij")
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)


def cells(rows: int, columns: int, inside: int) -> tuple[Array, float]:
    """Midpoints in equal solid angles: (rows, columns, inside^2, 3) unit, and the solid angle of each."""
    d = sphere_grid(rows * inside, columns * inside, 0.0).reshape(rows, inside, columns, inside, 3).swapaxes(1, 2)
    return d.reshape(rows, columns, inside * inside, 3), 2.0 * np.pi / (rows * columns * inside * inside)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("roughness", "n_v"), [(1.0, 0.9), (1.0, 0.05), (0.7, 0.5), (0.5, 0.2)])
def test_samples_are_distributed_as_the_density_says(kind: str, roughness: float, n_v: float) -> None:
    """Chi-square over 16 x 24 cells of the hemisphere and all directions below it, at 1e-3 for each of 16 cases."""
    count, m, v = 200_000, material(kind, roughness), view(n_v)
    directions, pdf = sample_brdf(m, UP, v, numbers(count))
    grid, angle = cells(16, 24, 12)
    expected = (brdf_pdf(m, UP, v, grid).sum(axis=-1) * angle).ravel() * count
    above = pdf > 0
    assert np.array_equal(above, directions[:, 2] > 0)
    row = np.clip((directions[above, 2] * 16).astype(int), 0, 15)
    column = (np.arctan2(directions[above, 1], directions[above, 0]) / (2.0 * np.pi) % 1.0 * 24).astype(int)
    found = np.bincount(row * 24 + np.clip(column, 0, 23), minlength=16 * 24)
    # What is above and what is lost below add up to 1: the density integrates to 1 over all directions.
    found, expected = np.append(found, count - above.sum()), np.append(expected, max(count - expected.sum(), 0.0))
    few = expected < 10
    found, expected = np.append(found[~few], found[few].sum()), np.append(expected[~few], expected[few].sum())
    kept = expected > 1
    statistic = np.sum((found - expected)[kept] ** 2 / expected[kept])
    assert stats.chi2.sf(statistic, kept.sum() - 1) > 1e-3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("roughness", few([0.0, 0.6, 0.25, 1.0], 2))
@pytest.mark.parametrize("n_v", [1.0, 0.5, 0.03])
def test_the_estimate_of_the_albedo_is_that_of_quadrature(kind: str, roughness: float, n_v: float) -> None:
    """Within five standard errors, plus the error of the table between its rows."""
    m, v = material(kind, roughness), view(n_v)
    count = 100_000
    to_light, pdf = sample_brdf(m, UP, v, numbers(count, 7))
    diffuse, glossy = evaluate_brdf(m, UP, v, to_light)
    weight = np.where(pdf > 0, 1.0 / np.where(pdf > 0, pdf, 1.0), 0.0)[:, None]
    assert np.isfinite(weight).all() and np.max((diffuse + glossy) * weight) < 4.0  # no sample of a large weight
    fresnel_low, fresnel_high, taken = table_lookup(albedo_table(), np.array(roughness), np.array(n_v))
    metallic, specular = KINDS[kind]
    base = np.array(m.base_color)
    dielectric = specular * (0.04 * fresnel_low + fresnel_high)
    expected_glossy = (1 - metallic) * dielectric + metallic * (base * fresnel_low + fresnel_high)
    expected_diffuse = (1 - metallic) * base * (1.0 - specular * (0.04 + 0.96 * taken))
    for got, expected in ((diffuse * weight, expected_diffuse), (glossy * weight, expected_glossy)):
        error = 5.0 * got.std(axis=0) / np.sqrt(count) + 0.012
        assert np.all(np.abs(got.mean(axis=0) - expected) <= error)


MAIN = rows_glsl("""void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec4 base = rows[5u * i], n = rows[5u * i + 1u], v = rows[5u * i + 2u];
    vec4 u = rows[5u * i + 3u], l = rows[5u * i + 4u];
    Surface s = Surface(base.rgb, base.a, n.w, v.w, n.xyz, v.xyz);
    BrdfSample drawn = sample_brdf(s, u.xyz);
    Lobes lobes = evaluate_brdf(s, drawn.l);
    results[3u * i] = vec4(drawn.l, drawn.pdf);
    results[3u * i + 1u] = vec4(lobes.diffuse + lobes.glossy, brdf_pdf(s, l.xyz));
    results[3u * i + 2u] = vec4(brdf_pdf(s, drawn.l), glossy_share(s), 0.0, 0.0);
}
""")


def random_rows(count: int, roughness: Array, seed: int = 5) -> Array:
    """(count, 5, 4) float32: base color and metallic; normal, alpha; view, specular; u; another direction."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((count, 5, 4), np.float32)
    rows[:, 0] = rng.random((count, 4))
    rows[: count // 4, 0, 3] = 1.0
    rows[count // 4 : count // 2, 0, 3] = 0.0
    n = normalize(rng.normal(size=(count, 3)))
    v = normalize(rng.normal(size=(count, 3)))
    v = np.where(np.sum(n * v, axis=-1, keepdims=True) < 0, -v, v)
    graze = slice(0, count, 5)
    x, _ = basis_around(n[graze])
    v[graze] = normalize(x + n[graze] * rng.uniform(-0.2, 1e-3, (len(x), 1)))  # also views below the surface
    rows[:, 1, :3], rows[:, 2, :3] = n, v
    rows[:, 1, 3] = np.maximum(roughness**2, MIN_ALPHA)
    rows[:, 2, 3] = np.where(rng.random(count) < 0.3, 0.0, rng.random(count))
    rows[:, 3, :3] = np.floor(rng.random((count, 3)) * 2**24) / 2**24
    rows[:50, 3, :3] = rng.integers(0, 2, (50, 3)) * (1.0 - 2.0**-24)  # the ends of [0, 1)
    rows[:, 4, :3] = normalize(rng.normal(size=(count, 3)))
    return rows


def reference(rows: Array) -> tuple[SurfaceMaterial, Array, Array, Array, Array]:
    r = rows.astype(np.float64)
    m = SurfaceMaterial(r[:, 0, :3], r[:, 0, 3], np.sqrt(r[:, 1, 3]), r[:, 2, 3])
    return m, normalize(r[:, 1, :3]), normalize(r[:, 2, :3]), r[:, 3, :3], normalize(r[:, 4, :3])


def test_the_shader_is_the_reference(gpu) -> None:
    count = 20_000
    rows = random_rows(count, np.random.default_rng(9).uniform(0.2, 1.0, count))
    got = map_rows(gpu, with_main(gpu, "common/brdf_sampling.glsl", MAIN), rows, 12).astype(np.float64)
    m, n, v, u, other = reference(rows)
    to_light, pdf = sample_brdf(m, n, v, u)
    share = glossy_share(m, n, v)
    same = np.abs(u[:, 2] - share) > 1e-6  # a number at the boundary may choose either lobe
    assert np.allclose(got[:, 9], share, atol=2e-6) and same.mean() > 0.99
    assert np.max(np.abs(got[:, :3] - to_light)[same]) < 2e-4
    near_horizon = np.abs(np.sum(n * to_light, axis=-1)) < 1e-3
    # The direction moves by float32 rounding, which the density of a lobe of alpha 0.04 turns into 1 %.
    assert np.all(np.isclose(got[:, 3], pdf, rtol=0.02, atol=1e-4)[same & ~near_horizon])
    expected = brdf_pdf(m, n, v, other)
    clear = np.abs(np.sum(n * other, axis=-1)) > 1e-5
    assert np.all(np.abs(got[:, 7] - expected)[clear] <= 1e-5 + 2e-4 * expected[clear])
    assert np.array_equal(got[:, 3], got[:, 8])  # the density of a sample is brdf_pdf there


def test_narrow_lobes_keep_their_weight(gpu) -> None:
    """At roughness 0 (MIN_ALPHA) in float32: the mean weight is the albedo, nothing is NaN or large."""
    count = 50_000
    rows = random_rows(count, np.zeros(count))
    got = map_rows(gpu, with_main(gpu, "common/brdf_sampling.glsl", MAIN), rows, 12).astype(np.float64)
    assert np.isfinite(got).all()
    assert np.allclose(np.linalg.norm(got[:, :3], axis=-1), 1.0, atol=1e-5)
    m, n, v, u, _ = reference(rows)
    used = got[:, 3] > 0
    weight = got[:, 4:7] / np.where(used, got[:, 3], np.inf)[:, None]
    # A view below the surface (a smooth normal at a silhouette) has another lobe than the one that is drawn.
    above = np.sum(n * v, axis=-1) > 1e-3
    assert weight[above].max() < 4.0 and weight.max() < 40.0
    _, pdf = sample_brdf(m, n, v, u)
    facing = np.sum(n * v, axis=-1) > 0.05
    peak = (pdf > 1e3) & facing & used
    ratio = got[peak, 3] / pdf[peak]
    assert peak.sum() > 5_000 and abs(np.median(ratio) - 1.0) < 1e-3 and np.mean(np.abs(ratio - 1.0) < 0.02) > 0.95


def test_without_glossy_lobes_the_density_is_the_cosine(gpu) -> None:
    rows = random_rows(2_000, np.ones(2_000))
    rows[:, 0, 3] = rows[:, 2, 3] = 0.0
    program = with_main(gpu, "common/brdf_sampling.glsl", MAIN, {"GLOSSY": False})
    got = map_rows(gpu, program, rows, 12).astype(np.float64)
    cosine = np.sum(got[:, :3] * rows[:, 1, :3], axis=-1)
    assert np.allclose(got[:, 3], np.maximum(cosine, 0) / np.pi, atol=1e-6) and cosine.min() >= -1e-6
