"""The atlas: places, sizes within a budget, and one texel by chance against the bilinear value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hit_tools import HEAD, opened

from taubench_gl.animation import choose_camera
from taubench_gl.frame.raytracing.atlas import BAND, plan_atlas, reduced_pixels
from taubench_gl.scene.builder import SceneBuilder, quad
from taubench_gl.scene.model import Image, Sampler, Scene, Texture
from taubench_gl.srgb import srgb_decode, srgb_encode

Array = np.ndarray


def test_no_two_images_overlap() -> None:
    rng = np.random.default_rng(0)
    sizes = {i: tuple(rng.integers(1, 300, 2).tolist()) for i in range(150)}
    plan = plan_atlas(sizes, 16384)
    filled = np.zeros(plan.size[::-1], int)
    for image, (x, y) in plan.places.items():
        w, h = plan.sizes[image]
        filled[y : y + h, x : x + w] += 1
        assert filled[y : y + h, x : x + w].shape == (h, w)
    assert filled.max() == 1 and plan.sizes == sizes and not plan.reduced
    assert filled.mean() > 0.75


def test_what_does_not_fit_is_halved() -> None:
    sizes = {0: (2048, 2048), 1: (2048, 1024), 2: (16, 16), 3: (40_000, 2)}
    plan = plan_atlas(sizes, 16384, budget=4 * 1024 * 1024)
    assert plan.bytes <= 4 * 1024 * 1024 and max(plan.size) <= 16384
    assert plan.sizes[2] == (16, 16) and 3 in plan.reduced and 2 not in plan.reduced
    assert plan_atlas({}, 16384).size == (0, 0)
    for image in sizes:
        assert all(a <= b for a, b in zip(plan.sizes[image], sizes[image], strict=True))


@pytest.mark.parametrize("rows", [16, 2 * BAND + 6])
def test_smaller_images_keep_their_light(rows: int) -> None:
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, 256, (4 * rows, 48, 4)).astype(np.uint8)
    small = reduced_pixels(pixels, (12, rows), color=True)
    boxes = srgb_decode(pixels[..., :3] / 255.0).reshape(rows, 4, 12, 4, 3).mean(axis=(1, 3))
    assert np.abs(small[..., :3] - srgb_encode(boxes) * 255.0).max() <= 0.51
    plain = reduced_pixels(pixels, (12, rows), color=False)
    assert np.abs(plain - pixels.reshape(rows, 4, 12, 4, 4).mean(axis=(1, 3))).max() <= 0.51
    assert reduced_pixels(pixels, (48, 4 * rows), color=True) is pixels


TAPS = (
    HEAD
    + """
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    MapPoint p = map_point(hit_draw(0).words.z, SLOT_BASE_COLOR, vec4(rows[i].xy, 0.0, 0.0));
    results[3u * i] = one_texel(p, rows[i].z);
    results[3u * i + 1u] = bilinear(p);
    results[3u * i + 2u] = vec4(linear_of_srgb(rows[i].www), 0.0);
}
"""
)


def reference(pixels: Array, uv: Array, wrap: int) -> Array:
    """Bilinear values (N, 4) in 0..1 at ``uv`` (N, 2)."""
    h, w = pixels.shape[:2]
    if wrap == 33648:
        uv = 1.0 - np.abs(np.mod(uv, 2.0) - 1.0)
    at = uv * (w, h) - 0.5
    low = np.floor(at).astype(int)
    f = at - low
    out = 0.0
    for dx in (0, 1):
        for dy in (0, 1):
            x, y = low[:, 0] + dx, low[:, 1] + dy
            x, y = (x % w, y % h) if wrap == 10497 else (np.clip(x, 0, w - 1), np.clip(y, 0, h - 1))
            weight = (f[:, 0] if dx else 1 - f[:, 0]) * (f[:, 1] if dy else 1 - f[:, 1])
            out = out + weight[:, None] * pixels[y, x] / 255.0
    return out


def textured(images: list[Array], **textures: Texture) -> Scene:
    """A square of one material before a camera."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(material=b.material(**textures))))
    b.camera(translation=(0, 0, 5))
    return replace(b.build(), images=tuple(Image("x", x.shape[1::-1], lambda x=x: x) for x in images))


def sampled(gpu, sampler: Sampler, pixels: Array, points: Array, taps: int) -> Array:
    """One texel, the bilinear value and, in the first two, a color decoded: (points, taps, 3, 4)."""
    rng = np.random.default_rng(3)
    other = rng.integers(0, 256, (9, 3, 4)).astype(np.uint8)
    scene = textured([pixels, other], base_color_texture=Texture(0, sampler), metallic_roughness_texture=Texture(1))
    rows = np.zeros((len(points) * taps, 4))
    rows[:, :2] = np.repeat(points, taps, axis=0)
    rows[:, 2] = np.floor(rng.random(len(rows)) * 2**24) / 2**24
    rows[:, 3] = np.resize(np.arange(256) / 255.0, len(rows))
    with opened(gpu, scene, choose_camera(scene), (16, 9)) as hits:
        hits.at(0.0)
        got = hits.run("raytracing/surface.glsl", TAPS, rows, 3)
    return got.reshape(len(points), taps, 3, 4)


def noise(size: tuple[int, int] = (5, 7)) -> Array:
    return np.random.default_rng(4).integers(0, 256, (*size, 4)).astype(np.uint8)


@pytest.mark.parametrize("wrap", [10497, 33071, 33648])
def test_one_texel_is_the_bilinear_value_on_average(gpu, wrap: int) -> None:
    """Exact to float32 by ``bilinear``; within five standard errors by the mean of one texel."""
    pixels, points = noise(), np.random.default_rng(5).uniform(-2.3, 3.1, (120, 2))
    points[:8] = [0, 0], [1, 1], [-1, 2], [-1e-9, 0.5], [0.03, 0.97], [0.97, 0.03], [2.0, -3.0], [0.5, 0.5]
    got = sampled(gpu, Sampler(wrap_s=wrap, wrap_t=wrap), pixels, points, 1_500)
    expected = reference(pixels, np.float32(points).astype(float), wrap)
    assert np.abs(got[:, 0, 1] - expected).max() < 2e-5
    mean, error = got[:, :, 0].mean(axis=1), got[:, :, 0].std(axis=1) / np.sqrt(got.shape[1])
    assert np.all(np.abs(mean - expected) < 5.0 * error + 1e-4)
    known = {tuple(p) for p in pixels.reshape(-1, 4).tolist()}
    assert {tuple(p) for p in np.rint(255 * got[:, :50, 0]).astype(int).reshape(-1, 4).tolist()} <= known


def test_samplers_of_the_nearest_texel(gpu) -> None:
    pixels, points = noise(), np.random.default_rng(6).random((60, 2))
    got = sampled(gpu, Sampler(mag_filter=9728), pixels, points, 4)
    column, row = (np.float32(points) * (7, 5)).astype(int).T
    expected = pixels[row, column][:, None, None] / 255.0
    assert np.allclose(got[:, :, :2], expected, atol=1e-6)


def test_coordinates_that_are_not_finite_stay_within_the_texture(gpu) -> None:
    pixels = noise()
    got = sampled(gpu, Sampler(), pixels, np.array([[np.inf, -1e30], [1e20, 3.0], [-np.inf, 0.0]]), 64)
    known = {tuple(p) for p in pixels.reshape(-1, 4).tolist()}
    assert {tuple(p) for p in np.rint(255 * got[:, :, 0]).astype(int).reshape(-1, 4).tolist()} <= known


def test_colors_are_decoded_as_on_the_cpu(gpu) -> None:
    got = sampled(gpu, Sampler(), noise(), np.zeros((1, 2)), 256)[0, :, 2, :3]
    assert np.abs(got - srgb_decode(np.arange(256) / 255.0)[:, None]).max() < 2e-5


def test_a_small_budget_is_announced(gpu) -> None:
    scene = textured([np.full((64, 64, 4), 200, np.uint8)], base_color_texture=Texture(0))
    with opened(gpu, scene, choose_camera(scene), (16, 9), atlas_bytes=4096) as hits:
        assert len(hits.attributes.notes) == 1 and hits.attributes.atlas.reduced == (0,)
        assert hits.attributes.memory["textures of ray hits"] <= 4096
        hits.at(0.0)
        at = np.zeros(1), np.zeros(1), np.full((1, 2), 0.3), np.array([[0.0, 0.0, -1.0]])
        assert np.allclose(hits.surfaces(*at).base_color, srgb_decode(200 / 255), atol=1e-5)


def test_materials_that_nothing_drawn_has_need_no_image(gpu) -> None:
    scene = textured([noise(), noise((6, 8))], base_color_texture=Texture(0))
    unused = replace(scene.materials[-1], base_color_texture=Texture(1))
    scene = replace(scene, materials=(*scene.materials, unused))
    with opened(gpu, scene, choose_camera(scene), (16, 9)) as hits:
        assert set(hits.attributes.atlas.places) == {0}
