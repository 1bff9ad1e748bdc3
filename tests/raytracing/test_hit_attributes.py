"""Surfaces at hits against the channels of the rasterizer, for the same points.

The rasterizer samples textures at the finest level.  What is left between the two: llvmpipe filters 8-bit texels with
weights of 8 bits (1/256 of the contrast of neighbors), channels of colors are stored with 11 bits (``channels``), and
pixels at edges, where the rasterizer has snapped a corner to 1/256 pixel and the ray meets the neighbor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frame_tools import find_scene, picture
from hit_tools import Seen, look, opened

from taubench_gl.animation import choose_camera
from taubench_gl.frame.raytracing.hit_tables import HitOptions
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, box, morphed, quad, skinned, sphere, turn
from taubench_gl.scene.model import Primitive, Sampler, Scene, Texture

Array = np.ndarray
SIZE = (96, 54)
FILTER = 0.02
"""Base color and emission: 8-bit filter weights, and the mean over 64 of all numbers u."""

STORED = 2.0**-10
"""Relative error of a stored color."""


def agree(seen: Seen, *, edges: float = 0.01, texture: float = FILTER, normal: float = 1e-4) -> None:
    """All channels at all pixels but a share ``edges`` of them."""
    hits, channels, count = seen.hits, seen.channels, len(seen.draws)
    scale = np.linalg.norm(channels["position"][:, :3], axis=-1)
    side = np.abs(np.sum(hits.geometric_normal * channels["geometric_normal"][:, :3], axis=-1) - 1.0)
    clear = side < 2e-3  # another triangle at a crease
    assert count >= 100 and np.mean(~clear) <= edges
    limits = {
        "position": (hits.position, 1e-5 * scale[:, None], channels["position"][:, :3]),
        "geometric_normal": (hits.geometric_normal, 1e-2, channels["geometric_normal"][:, :3]),
        "normal": (hits.normal, normal, channels["normal"][:, :3]),
        "base_color": (hits.base_color, texture + STORED, channels["base_color"][:, :3]),
        "metallic": (hits.material[:, :2], 0.01, channels["material"][:, :2]),
        "specular": (hits.material[:, 2:], 1e-3, channels["material"][:, 3:]),
        "emission": (hits.emission, texture * max(channels["emission"].max(), 1.0), channels["emission"][:, :3]),
    }
    for name, (got, limit, expected) in limits.items():
        lit = ~hits.unlit if name in ("emission", "specular") else np.ones(count, bool)
        off = (np.abs(got - expected) > limit).any(axis=-1) & clear & lit
        assert np.mean(off) <= edges, (
            f"{name}: {np.mean(off):.3%} of {count} pixels, {np.abs(got - expected)[off].max()}"
        )
    for name in ("geometric_normal", "normal"):
        assert np.allclose(np.linalg.norm(getattr(hits, name), axis=-1), 1.0, atol=1e-5)
    toward = np.sum(hits.geometric_normal * hits.position, axis=-1)
    assert np.all(toward <= 1e-6 * scale)
    assert np.array_equal(hits.unlit, channels["material"][:, 3] < 0)
    assert hits.alpha_passes.mean() >= 1.0 - edges


@pytest.mark.parametrize(
    ("name", "time"),
    [
        ("CesiumMan.glb", 0.7),  # skinned
        ("AnimatedMorphCube.glb", 1.1),
        ("MorphStressTest.glb", 0.4),  # flat and morphed
        ("BoxAnimated.glb", 0.5),
        ("NegativeScaleTest.glb", 0.0),
        ("TextureTransformTest.gltf", 0.0),
        ("MultiUVTest.glb", 0.0),
        ("BoxVertexColors.glb", 0.0),
        ("UnlitTest.glb", 0.0),
        ("EmissiveStrengthTest.glb", 0.0),
    ],
)
def test_files_give_the_channels_of_the_rasterizer(gpu, data, name: str, time: float) -> None:
    scene = load_scene(find_scene(data, name))
    with opened(gpu, scene, choose_camera(scene), SIZE) as hits:
        agree(look(hits, time), edges=0.025)  # pixels at creases: their share is that of the view of the default camera


# ------------------------------------------------------------------------------------------------- scenes made in code
def smooth_pixels(width: int, height: int, seed: int = 0, alpha: bool = False) -> Array:
    """Texels that differ little from their neighbors, so that where a texture is sampled shows, and how it is filtered
    does not."""
    x, y = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    rng = np.random.default_rng(seed)
    waves = [np.sin(2 * np.pi * (a * x + b * y) + c) for a, b, c in zip(*rng.integers(0, 3, (3, 4)), strict=True)]
    out = 128 + 100 * np.stack(waves, axis=-1)
    if not alpha:
        out[..., 3] = 255
    return out


def with_uv(p: Primitive, first: Array | None = None, second: Array | None = None, **fields) -> Primitive:
    own = p.positions[:, :2] if first is None else first
    sets = (np.float32(own), None if second is None else np.float32(second))
    return replace(p, texcoords=sets, **fields)


def scene_of(b: SceneBuilder, *images: Array) -> Scene:
    return replace(b.build(), images=tuple(picture(i) for i in images))


def seen_from(z: float = 4.0) -> SceneBuilder:
    """A scene with a camera at ``z``, which looks along -z."""
    b = SceneBuilder()
    b.camera(translation=(0.0, 0.0, z), znear=0.01, yfov=0.8)
    return b


def seen(gpu, scene: Scene, time: float = 0.0, options: HitOptions | None = None) -> Seen:
    with opened(gpu, scene, choose_camera(scene), SIZE, options) as hits:
        return look(hits, time)


def test_both_uv_sets_transforms_and_all_slots(gpu) -> None:
    b = seen_from()
    turned = np.array([[0.8, -0.3, 0.2], [0.4, 1.1, -0.1]])
    m = b.material(
        base_color_texture=Texture(0, uv_transform=turned), metallic_roughness_texture=Texture(1, texcoord=1),
        normal_texture=Texture(2, Sampler(wrap_s=33648), texcoord=1, uv_transform=turned), normal_scale=0.6,
        emissive=(2.0, 0.5, 1.0), emissive_strength=2.0, emissive_texture=Texture(0, texcoord=1),
        base_color=(0.9, 0.8, 0.7, 1.0),
    )  # fmt: skip
    p = sphere(1.2, 12)
    first = np.stack([p.positions[:, 0] * 0.4, p.positions[:, 1] * 0.4], axis=-1)
    second = np.stack([p.positions[:, 1] * 0.3, p.positions[:, 0] * 0.3], axis=-1)
    colors = np.float32(np.abs(np.concatenate([p.normals, np.ones((len(p.normals), 1))], axis=-1)))
    shape = with_uv(replace(p, material=m, colors=colors), first, second)
    b.node(mesh=b.mesh(shape), scale=(1.0, 0.7, 1.3), rotation=turn((1, 1, 0), 30.0))
    b.node(mesh=b.mesh(shape), scale=(-0.5, 0.7, 0.6), translation=(1.6, 0.9, 0.0))
    maps = [smooth_pixels(32, 32, k) for k in range(3)]
    maps[2][..., 2] = 230.0
    scene = scene_of(b, *maps)
    result = seen(gpu, scene)
    agree(result, normal=0.02, edges=0.03)
    assert set(result.draws) == {0, 1}
    flat, bent = seen(gpu, scene, options=HitOptions(normal_maps=False)).hits, result.hits
    assert np.sum(bent.normal * flat.normal, axis=-1).min() < 0.999  # the map bends normals


def test_the_mapped_normal_turns_with_the_pose(gpu) -> None:
    """Skinned and morphed surfaces with a normal map: tangents come from the deform pass."""
    b = seen_from()
    m = b.material(normal_texture=Texture(0), base_color=(0.5, 0.5, 0.5, 1.0), double_sided=True)
    p = quad(1.0, 1.0, cells=(4, 4))
    joint = b.node(rotation=turn((0, 0, 1), 40.0), scale=(1.0, 1.0, -1.0))
    count = len(p.positions)
    bones = skinned(p, np.zeros((count, 4)), np.tile([1.0, 0, 0, 0], (count, 1)))
    b.node(mesh=b.mesh(with_uv(bones, material=m)), skin=b.skin([joint]))
    lifted = morphed(p, np.stack([np.zeros(count), np.zeros(count), p.positions[:, 0] ** 2], axis=-1))
    b.node(mesh=b.mesh(with_uv(lifted, material=m), weights=(0.7,)), translation=(0.9, 0.0, -0.5))
    maps = smooth_pixels(32, 32, 2)
    maps[..., 2] = 220.0
    result = seen(gpu, scene_of(b, maps))
    agree(result, normal=0.02, edges=0.03)
    assert set(result.draws) == {0, 1}


def test_instances_mirrors_and_uneven_scales(gpu) -> None:
    b = seen_from(9.0)
    rng = np.random.default_rng(4)
    places = np.tile(np.eye(4), (30, 1, 1))
    for place in places:
        place[:3, :3] = rng.normal(size=(3, 3)) * 0.6  # mirrored half of the time, sheared
        place[:3, 3] = rng.uniform(-3, 3, 3)
    flat = replace(box(), normals=None)
    for shape in (flat, sphere(0.8, 8)):
        b.node(mesh=b.mesh(replace(shape, material=b.material(double_sided=True))), instances=places)
    result = seen(gpu, b.build())
    agree(result, edges=0.05)
    assert len(set(result.draws)) > 20


def test_masks_and_blended_surfaces_are_there_where_the_rasterizer_draws(gpu) -> None:
    """Rays hit where the rasterizer draws; test_masked_coverage has the rays that pass where it does not."""
    b = seen_from()
    for i, mode in enumerate(({"alpha_mode": "MASK", "alpha_cutoff": 0.35}, {"alpha_mode": "BLEND"})):
        m = b.material(base_color_texture=Texture(0), base_color=(1.0, 1.0, 1.0, 0.9), double_sided=True, **mode)
        colors = np.ones((4, 4), np.float32)
        colors[0, 3] = 0.5
        shape = with_uv(quad(0.9, 1.5, material=m), colors=colors)
        b.node(mesh=b.mesh(shape), translation=(-1.0 + 2.0 * i, 0.0, 0.0))
    scene = scene_of(b, smooth_pixels(64, 64, 1, alpha=True))
    agree(seen(gpu, scene), edges=0.02)
    assert seen(gpu, scene, options=HitOptions(alpha_test=False)).hits.alpha_passes.all()


def test_many_instances_and_materials(gpu) -> None:
    """10,000 copies of a primitive, 2,000 materials."""
    b = seen_from(80.0)
    side = np.arange(100) - 49.5
    places = np.tile(np.eye(4), (10_000, 1, 1))
    places[:, :3, 3] = np.stack([*np.meshgrid(side, side), np.zeros((100, 100))], axis=-1).reshape(-1, 3)
    b.node(mesh=b.mesh(box((0.3, 0.3, 0.3), material=b.material(base_color=(0.2, 0.4, 0.6, 1.0)))), instances=places)
    rng = np.random.default_rng(2)
    colors = rng.random((2_000, 4))
    for i, color in enumerate(colors):
        m = b.material(base_color=(*color[:3], 1.0), roughness=color[3])
        place = (0.9 * (i % 50) - 22.0, 0.9 * (i // 50) - 18.0, 2.0)
        b.node(mesh=b.mesh(quad(0.4, 0.4, material=m)), translation=place)
    scene = b.build()
    with opened(gpu, scene, choose_camera(scene), (16, 9)) as hits:
        hits.at(0.0)
        draws = np.concatenate([np.arange(0, 10_000, 97), 10_000 + np.arange(2_000)])
        third = np.full((len(draws), 2), 1.0 / 3.0)
        found = hits.surfaces(draws, np.zeros(len(draws)), third, np.tile([0.0, 0.0, -1.0], (len(draws), 1)))
        assert np.allclose(found.base_color[-2_000:], colors[:, :3], atol=1e-6)
        assert np.allclose(found.material[-2_000:, 1], colors[:, 3], atol=1e-6)
        copies = places[::97, :3, 3]
        away = found.position[: len(copies)] + hits.renderer.view(0.0)[1].position - copies
        assert np.abs(away).max() < 0.31


def test_far_vertices_keep_their_digits(gpu) -> None:
    """Vertices 10^6 m from the origin of their node, which lies as far on the other side; some are in no triangle."""
    b = seen_from()
    rng = np.random.default_rng(8)
    far = np.array([1e6, -2e6, 5e5])
    # Corners that float32 holds there: multiples of 1/4 m.
    corners = (far + np.round(rng.uniform(-8, 8, (30, 3)) * 4) / 4).astype(np.float32)
    unused = np.repeat(corners[:1], 60, axis=0)  # so that the pool has fewer indices than vertices
    upwards = np.tile(np.float32([0, 1, 0]), (90, 1))
    p = Primitive(np.concatenate([corners, unused]), np.arange(30, dtype=np.uint32).reshape(-1, 3), normals=upwards)
    b.node(mesh=b.mesh(p), translation=-far)
    with opened(gpu, b.build(), choose_camera(b.build()), (16, 9)) as hits:
        hits.at(0.0)
        weights = rng.dirichlet((1, 1, 1), 10)
        found = hits.surfaces(np.zeros(10), np.arange(10), weights[:, 1:], np.tile([0.0, 0.0, -1.0], (10, 1)))
        eye = hits.renderer.view(0.0)[1].position
    expected = np.einsum("nk,nkc->nc", weights, (corners - far).reshape(-1, 3, 3)) - eye
    assert np.abs(found.position - expected).max() < 4e-6


def test_degenerate_triangles_and_zero_normals_give_finite_surfaces(gpu) -> None:
    b = seen_from()
    line = np.float32([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    b.node(mesh=b.mesh(Primitive(line, np.uint32([[0, 1, 2]]), normals=np.zeros((3, 3), np.float32))))
    b.node(mesh=b.mesh(Primitive(line, np.uint32([[0, 1, 2]]))))
    b.node(mesh=b.mesh(quad()), scale=(0.0, 0.0, 0.0))
    b.node(mesh=b.mesh(quad()), scale=(1e-9, 1e-9, -1e-9))
    with opened(gpu, b.build(), choose_camera(b.build()), (16, 9)) as hits:
        hits.at(0.0)
        at = np.arange(4), np.zeros(4), np.full((4, 2), 0.3), np.tile([0.0, 0.6, -0.8], (4, 1))
        found = hits.surfaces(*at)
    for values in (found.position, found.normal, found.geometric_normal, found.area):
        assert np.isfinite(values).all()
    assert np.allclose(np.linalg.norm(found.normal, axis=-1), 1.0, atol=1e-5)
    assert np.all(np.sum(found.geometric_normal * (0.0, 0.6, -0.8), axis=-1) <= 0.0)
