"""Emissive triangles: their probabilities, points drawn on them, and light estimated from those points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hit_tools import HEAD, Hits, opened
from scipy import stats

from taubench_gl.animation import choose_camera
from taubench_gl.frame.raytracing.emitters import EMITTER, pyramid, texture_means
from taubench_gl.frame.raytracing.hit_tables import HitOptions, emitter_cell_count, emitter_cells
from taubench_gl.scene.builder import SceneBuilder, quad, turn_x
from taubench_gl.scene.model import Image, Primitive, Sampler, Texture
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray
DRAW = (
    HEAD
    + """
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec4 u = rows[i];
    int row = emitter_chosen(u.x);
    EmitterSample e = NO_EMITTER;
    if (EMITTER_COUNT > 0) e = emitter_point(row, u.yz);
    results[3u * i] = vec4(e.position, emitter_probability(row) * e.pdf_area);
    results[3u * i + 1u] = vec4(e.normal, float(row));
    results[3u * i + 2u] = vec4(e.radiance, 0.0);
}
"""
)


def drawn(hits: Hits, count: int, time: float = 0.0, seed: int = 3) -> tuple[Array, Array]:
    """``count`` points: numbers (N, 3) and results (N, 3, 4), camera-relative."""
    hits.at(time)
    numbers = np.floor(np.random.default_rng(seed).random((count, 4)) * 2**24) / 2**24
    return numbers, hits.run("raytracing/emitters.glsl", DRAW, numbers, 3)


def lamp(b: SceneBuilder, radiance=(3.0, 2.0, 1.0), **fields) -> int:
    return b.material(emissive=radiance, emissive_strength=3.0, **fields)


def look_on(gpu, b: SceneBuilder, options: HitOptions | None = None, images: tuple[Image, ...] = ()):
    b.camera(translation=(0.0, 0.0, 6.0), znear=0.01)
    scene = replace(b.build(), images=images)
    return opened(gpu, scene, choose_camera(scene), (16, 9), options)


def look_on_picture(gpu, b: SceneBuilder, material: int, cells: int, pixels: Array):
    """A square of ``cells`` strips that shows the whole texture."""
    shape = quad(1.0, 1.0, cells=(cells, 1), material=material)
    uv = np.float32(0.5 * (shape.positions[:, :2] + 1.0))
    b.node(mesh=b.mesh(replace(shape, texcoords=(uv, None))))
    return look_on(gpu, b, images=(Image("lamp", pixels.shape[1::-1], lambda: pixels),))


def test_probabilities_are_shares_of_the_power(gpu) -> None:
    b = SceneBuilder()
    bright, dim = lamp(b), lamp(b, (0.5, 0.5, 0.5))
    b.node(mesh=b.mesh(quad(1.0, 1.0, material=bright)), scale=(2.0, 1.0, 1.0))  # 4 m2 become 8
    b.node(mesh=b.mesh(quad(0.5, 0.5, material=dim, cells=(2, 2))), rotation=turn_x(40.0))
    b.node(mesh=b.mesh(quad(3.0, 3.0)))
    b.node(mesh=b.mesh(quad(3.0, 3.0, material=b.material(emissive=(1.0, 1.0, 1.0), unlit=True))))
    with look_on(gpu, b) as hits:
        e = hits.attributes.emitters
        power = np.r_[np.full(2, 4.0 * np.dot((3, 2, 1), LUMINANCE)), np.full(8, 0.125 * 0.5)]
        assert np.array_equal(e["draw"], [0] * 2 + [1] * 8)
        assert np.array_equal(e["triangle"], [0, 1, *range(8)])
        assert np.allclose(e["probability"], power / power.sum(), atol=1e-6)
        numbers, got = drawn(hits, 20_000)
        rows = got[:, 1, 3].astype(int)
        assert np.array_equal(rows, np.searchsorted(e["cumulative"].astype(float), numbers[:, 0], side="right"))
        expected = e["probability"].astype(float) * len(rows)
        assert stats.chisquare(np.bincount(rows, minlength=10), expected / expected.sum() * len(rows)).pvalue > 1e-3
        area = power * 0 + np.r_[np.full(2, 4.0), np.full(8, 0.125)]
        assert np.allclose(got[:, 0, 3], (power / power.sum() / area)[rows], rtol=1e-4)  # float32 differences
        assert np.allclose(got[:, 2, :3], np.where((rows < 2)[:, None], (3, 2, 1), 0.5))
        assert np.allclose(np.abs(got[rows < 2, 1, :3]), (0, 0, 1), atol=1e-6)


def test_copies_in_one_place_are_one_light(gpu) -> None:
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(1.0, 1.0, material=lamp(b))))
    b.camera(translation=(0.0, 0.0, 6.0))
    one = b.build()
    there = np.stack([np.eye(4), np.eye(4), np.diag([2.0, 2.0, 2.0, 1.0])])
    scene = replace(one, nodes=replace(one.nodes, instances={0: there}))
    with opened(gpu, scene, choose_camera(scene), (16, 9)) as hits:
        assert np.array_equal(hits.attributes.emitters["draw"], [0, 0, 2, 2])


@pytest.mark.parametrize("kind", ["strong", "all", "none"])
def test_what_counts_as_light(gpu, kind: str) -> None:
    b = SceneBuilder()
    weak = b.material(emissive=(1.0, 1.0, 1.0))
    b.node(mesh=b.mesh(quad(1.0, 1.0, material=weak)))
    b.node(mesh=b.mesh(quad(1.0, 1.0, material=lamp(b))), translation=(0, 0, 1))
    with look_on(gpu, b, HitOptions(emission=kind)) as hits:
        assert set(hits.attributes.emitters["draw"]) == {"strong": {1}, "all": {0, 1}, "none": set()}[kind]
        _, got = drawn(hits, 64)
        assert np.all((got[:, 0, 3] > 0) == (kind != "none"))
        at = np.array([0, 1]), np.zeros(2), np.full((2, 2), 0.3), np.tile([0.0, 0.0, -1.0], (2, 1))
        found = hits.surfaces(*at)
        expected = {"strong": (0, 3), "all": (1, 3), "none": (0, 0)}[kind]
        assert np.allclose(found.emission[:, 0], expected)
        assert np.array_equal(found.emitter >= 0, np.array(expected) > 0)


def test_points_are_uniform_on_the_triangle(gpu) -> None:
    b = SceneBuilder()
    p = Primitive(np.float32([[0, 0, 0], [2, 0, 0], [0, 1, 0]]), np.uint32([[0, 1, 2]]), lamp(b))
    b.node(mesh=b.mesh(p), translation=(100.0, 0.0, 0.0))
    with look_on(gpu, b) as hits:
        _, got = drawn(hits, 30_000)
        points = got[:, 0, :3] + hits.renderer.view(0.0)[1].position - (100.0, 0.0, 0.0)
    x, y = points[:, 0] / 2.0, points[:, 1]
    assert np.abs(points[:, 2]).max() < 1e-5 and min(x.min(), y.min()) > -1e-4 and (x + y).max() < 1.0 + 1e-4
    # Folded to a square, a uniform triangle is uniform: 8 x 8 cells.
    folded = np.where(((x + y) > 1.0)[:, None], np.stack([1 - x, 1 - y], -1), np.stack([x, y], -1))
    v = 1.0 - folded[:, 0]
    square = np.stack([v**2, folded[:, 1] / v], axis=-1).clip(0, 0.999999)
    cell = (square * 8).astype(int)
    found = np.bincount(cell[:, 0] * 8 + cell[:, 1], minlength=64)
    assert stats.chisquare(found).pvalue > 1e-3


def test_lamps_are_sampled_where_they_are(gpu) -> None:
    """A lamp that moves, grows, mirrors and hides: probabilities stay, points and densities are of the frame."""
    b = SceneBuilder()
    node = b.node(mesh=b.mesh(quad(0.5, 0.5, material=lamp(b))))
    b.animate(node, "translation", (0.0, 1.0), ((0, 0, 0), (4, 0, 0)))
    b.animate(node, "scale", (0.0, 1.0), ((1, 1, 1), (-3, 2, 1)))
    other = b.node(mesh=b.mesh(quad(0.5, 0.5, material=lamp(b))), translation=(0, 3, 0))
    b.animate(other, "visible", (0.0, 0.5), ((1.0,), (0.0,)), "STEP")
    with look_on(gpu, b) as hits:
        eye = hits.renderer.view(0.0)[1].position
        assert hits.attributes.emitters["probability"][:2].sum() == pytest.approx(6.0 / 7.0, rel=1e-5)  # largest areas
        _, start = drawn(hits, 4_000)
        _, end = drawn(hits, 4_000, 1.0)
    first = start[:, 1, 3] < 2
    assert np.array_equal(first, end[:, 1, 3] < 2)
    points = start[first, 0, :3] + eye
    assert np.abs(points[:, :2]).max() <= 0.5 + 1e-5
    points = end[first, 0, :3] + eye - (4, 0, 0)
    assert 1.4 < points[:, 0].max() <= 1.5 + 1e-5 and 0.9 < points[:, 1].max() <= 1.0 + 1e-5
    assert np.allclose(start[first, 0, 3], 6 / 7 / 1.0, rtol=1e-4) and np.allclose(end[first, 0, 3], 1 / 7, rtol=1e-4)
    assert np.all(start[~first, 0, 3] > 0)
    assert np.all(end[~first, 0, 3] == 0) and np.all(end[~first, 2, :3] == 0)  # hidden


def test_textured_lamps(gpu) -> None:
    """Triangles are chosen by what they show of the texture; the estimate of a textured lamp has no bias."""
    b = SceneBuilder()
    pixels = np.zeros((32, 32, 4), np.uint8)
    pixels[:, :8] = 255  # a bright quarter
    pixels[:, 8:16, 0] = 120
    m = lamp(b, (2.0, 2.0, 2.0), emissive_texture=Texture(0, Sampler(wrap_s=33071, wrap_t=33071)))
    with look_on_picture(gpu, b, m, 8, pixels) as hits:
        e = hits.attributes.emitters
        cells = e["probability"].reshape(8, 2).sum(axis=1)
        assert cells[:2].sum() > 0.8 and np.all(cells[4:] < 0.02) and cells.sum() == pytest.approx(1.0)
        _, got = drawn(hits, 100_000)
        inverse = np.where(got[:, 0, 3] > 0, 1.0 / np.maximum(got[:, 0, 3], 1e-9), 0.0)
        flux = got[:, 2, :3] * inverse[:, None]
        linear = ((120 / 255 + 0.055) / 1.055) ** 2.4
        # Bilinear edges: where columns of texels meet, each gives half a texel to the other side.
        expected = 2.0 * 4.0 * np.array([0.25 + 0.25 * linear, 0.25, 0.25])
        error = flux.std(axis=0) / np.sqrt(len(flux))
        lost = 0.01 * expected  # edges of the lamp in triangles whose points all were dark
        assert np.all(np.abs(flux.mean(axis=0) - expected) < 5.0 * error + lost)


def test_the_color_of_a_lamp_weighs_its_texture(gpu) -> None:
    """A green lamp with a texture that is red on one side and green on the other shines on the green side only."""
    b = SceneBuilder()
    pixels = np.zeros((16, 16, 4), np.uint8)
    pixels[:, :8, 0] = pixels[:, 8:, 1] = 255
    m = lamp(b, (0.0, 2.0, 0.0), emissive_texture=Texture(0, Sampler(wrap_s=33071)))
    with look_on_picture(gpu, b, m, 4, pixels) as hits:
        assert np.allclose(hits.attributes.emitters["probability"].reshape(4, 2).sum(axis=1), (0, 0, 0.5, 0.5))


def test_means_of_textures() -> None:
    rng = np.random.default_rng(1)
    values = rng.random((37, 50))
    levels = pyramid(values)
    assert levels[-1].shape == (1, 1) and [level.shape for level in levels[:3]] == [(37, 50), (19, 25), (10, 13)]
    smooth = np.add.outer(np.linspace(0, 1, 64), np.linspace(0, 2, 64))
    uv = rng.uniform(0.05, 0.95, (40, 3, 2))
    uv[0] = [[0.1, 0.1], [0.1, 0.1], [0.1, 0.1]]
    uv[1, 0, 0] = np.nan
    got = texture_means(pyramid(smooth), uv, Texture(0))
    center = uv.mean(axis=1)
    expected = (center[:, 1] * 64 - 0.5) / 63 + 2 * (center[:, 0] * 64 - 0.5) / 63
    assert np.isfinite(got).all() and np.abs(got - expected)[2:].max() < 0.1


def test_every_number_finds_its_row_between_the_bounds_of_its_cell() -> None:
    rng = np.random.default_rng(2)
    for count in (1, 2, 7, 1000):
        power = rng.random(count) ** 8
        power[rng.random(count) < 0.3] = 0.0
        power[0] = 1.0
        e = np.zeros(count, EMITTER)
        cumulative = np.cumsum(power) / power.sum()
        cumulative[np.flatnonzero(power)[-1] :] = 1.0
        e["cumulative"] = cumulative
        cells, number = emitter_cells(e), emitter_cell_count(count)
        assert len(cells) == number
        u = np.floor(rng.random(5000) * 2**24) / 2**24
        row = np.searchsorted(e["cumulative"].astype(float), u, side="right")
        cell = (u * number).astype(int)
        assert np.all(cells[cell, 0] <= row) and np.all(row <= cells[cell, 1])


def test_degenerate_lamps_give_nothing(gpu) -> None:
    b = SceneBuilder()
    m = lamp(b)
    b.node(mesh=b.mesh(quad(0.5, 0.5, material=m)), scale=(0.0, 0.0, 0.0))
    line = Primitive(np.float32([[0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.uint32([[0, 1, 2]]), m)
    b.node(mesh=b.mesh(line))
    with look_on(gpu, b) as hits:
        assert np.all(hits.attributes.emitters["probability"] == 0)
        _, got = drawn(hits, 64)
        assert np.all(got[:, 0, 3] == 0) and np.isfinite(got).all()


def test_lamps_that_never_show_take_no_samples_and_flashes_do(gpu) -> None:
    """A flash between the times at which the animation is looked at, beside a lamp that is always hidden."""
    b = SceneBuilder()
    flash = b.node(mesh=b.mesh(quad(0.5, 0.5, material=lamp(b))))
    b.animate(flash, "visible", (0.0, 0.26, 0.27, 2.0), ((0.0,), (1.0,), (0.0,), (0.0,)), "STEP")
    b.node(mesh=b.mesh(quad(0.5, 0.5, material=lamp(b))), visible=False)
    with look_on(gpu, b) as hits:
        assert np.allclose(hits.attributes.emitters["probability"], (0.5, 0.5, 0.0, 0.0))
        assert np.all(drawn(hits, 64, 0.0)[1][:, 0, 3] == 0)
        assert np.allclose(drawn(hits, 64, 0.262)[1][:, 0, 3], 1.0)
