"""Depth pre-pass, and textures on plain coordinates: faster paths that change no bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frame_tools import FormulaCamera, make_scene, picture, primitive, quad, still_camera

from taubench_gl.channels import CHANNELS
from taubench_gl.frame.materials import has_plain_uv
from taubench_gl.frame.passes import gbuffer
from taubench_gl.frame.renderer import Renderer
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.scene.model import Camera, Material, Sampler, Texture

SIZE = (160, 96)
LENS = Camera(yfov=0.9, znear=0.05, zfar=200.0)
NAMES = tuple(name for name, info in CHANNELS.items() if info.attachment)
CHECKER = picture(np.random.default_rng(3).integers(0, 256, (16, 16, 4)))


def frames(gpu, scene, camera, *, per_triangle: int | None = None, times=(0.0,), monkeypatch=None):
    """Channels at ``times``; of the last frame: samples drawn, triangles shown, whether there was a pre-pass."""
    if per_triangle is not None:
        monkeypatch.setattr(gbuffer, "PIXELS_PER_TRIANGLE", per_triangle)
    renderer = Renderer(GpuContext(gpu), scene, camera, SIZE, NAMES)
    out = {}
    try:
        for time in times:
            query = gpu.ctx.query(samples=True)
            with query:
                renderer.draw(time, time - 1 / 24)
            out |= {(time, n): renderer.read(n) for n in renderer.channels}
        facts = query.samples, renderer.buffers.shown_triangles, len(renderer._gbuffer._prepass_context.shaders) > 0
        return out, facts
    finally:
        renderer.release()
        renderer.context.release()
        gpu.collect()


def both(gpu, scene, camera, monkeypatch, **chosen):
    """Frames with and without a depth pre-pass; the facts of both."""
    with_it, on = frames(gpu, scene, camera, per_triangle=0, monkeypatch=monkeypatch, **chosen)
    without, off = frames(gpu, scene, camera, per_triangle=10**9, monkeypatch=monkeypatch, **chosen)
    assert on[2] and not off[2]
    for key, values in without.items():
        assert np.array_equal(with_it[key].view(np.uint8), values.view(np.uint8)), key
    return without, on, off


def crossing(rng, count: int, size: float):
    """Triangles in all directions in front of the camera, many of them thin or edge-on, many through each other."""
    middle = rng.uniform((-4, -3, -9), (4, 3, -1), (count, 1, 3))
    arms = rng.normal(size=(count, 3, 3)) * size * 10 ** rng.uniform(-2, 0, (count, 1, 3))
    positions = (middle + arms).reshape(-1, 3)
    return primitive(positions, np.arange(3 * count).reshape(-1, 3), material=0)


@pytest.mark.parametrize("seed", range(4))
def test_no_bit_changes_among_crossing_triangles(gpu, monkeypatch, seed):
    rng = np.random.default_rng(seed)
    turns = [np.eye(4), np.diag([-1.0, 1, 1, 1]), np.diag([1.0, 1, 0.01, 1])]  # one mirrored, one nearly flat
    turns[2][2, 3] = -3.0
    parts = [crossing(rng, 60, size) for size in (2.0, 0.5, 4.0)]
    scene = make_scene(*parts, matrices=turns, materials=(Material(double_sided=True),))
    camera = FormulaCamera(LENS, lambda t: ((0.3 * t, 0.1 * t, 0.0), np.eye(3)))
    channels, _, _ = both(gpu, scene, camera, monkeypatch, times=(0.0, 0.7))
    assert (channels[0.7, "position"][..., 3] > 0).mean() > 0.1


@pytest.mark.parametrize("tilt", [0.0, 5.0, 500.0])
def test_of_coincident_surfaces_the_first_drawn_is_kept(gpu, monkeypatch, tilt):
    """Twice the same wall, one slanted until it is seen nearly along itself."""
    wall = quad((-3, -2, -3), (6, 0, -tilt), (0, 4, 0), material=0)
    paints = (Material(base_color=(1, 0, 0, 1)), Material(base_color=(0, 1, 0, 1)))
    scene = make_scene(wall, replace(wall, material=1), materials=paints)
    channels, _, _ = both(gpu, scene, still_camera(LENS), monkeypatch)
    seen = channels[0.0, "position"][..., 3] > 0
    assert seen.any() and (channels[0.0, "base_color"][seen][:, 0] == 1.0).all()


def test_holes_of_an_alpha_mask_show_the_surface_behind(gpu, monkeypatch):
    front = quad((-1, -1, -2), (2, 0, 0), (0, 2, 0), material=0)
    back = quad((-4, -4, -4), (8, 0, 0), (0, 8, 0), material=1)
    masked = Material(base_color_texture=Texture(0), alpha_mode="MASK")
    scene = make_scene(front, back, materials=(masked, Material()), images=(CHECKER,))
    channels, _, _ = both(gpu, scene, still_camera(LENS), monkeypatch)
    ids = channels[0.0, "ids"][..., 0]
    assert set(np.unique(ids)) == {1, 2}


def test_hidden_surfaces_cost_no_channels(gpu, monkeypatch):
    """Five walls that fill the image, the farthest drawn first: without a pre-pass all are shaded."""
    walls = [quad((-20, -20, -z), (40, 0, 0), (0, 40, 0), material=0) for z in (10, 8, 6, 4, 2)]
    scene = make_scene(*walls, materials=(Material(),))
    _, on, off = both(gpu, scene, still_camera(LENS), monkeypatch)
    pixels = SIZE[0] * SIZE[1]
    assert off[:2] == (5 * pixels, 10)
    assert on[0] == 6 * pixels  # five of depth alone, one of channels


def test_many_small_triangles_are_drawn_once(gpu):
    rng = np.random.default_rng(1)
    few, many = (make_scene(crossing(rng, n, 0.5), materials=(Material(),)) for n in (20, SIZE[0] * SIZE[1]))
    assert frames(gpu, few, still_camera(LENS))[1][2]
    assert not frames(gpu, many, still_camera(LENS))[1][2]


# -------------------------------------------------------------------------------------------------- plain coordinates


MIRRORED = Sampler(wrap_s=33648)
MOVED = np.array([[1.0, 0, 0.25], [0, 1, 0]])


@pytest.mark.parametrize(
    ("texture", "plain"),
    [
        (Texture(0), True),
        (Texture(0, texcoord=1), False),
        (Texture(0, sampler=MIRRORED), False),
        (Texture(0, sampler=Sampler(wrap_t=33648)), False),
        (Texture(0, sampler=Sampler(wrap_s=33071)), True),
        (Texture(0, uv_transform=MOVED), False),
    ],
)
def test_which_textures_lie_on_plain_coordinates(texture, plain):
    material = Material(base_color_texture=Texture(0), normal_texture=texture)
    assert has_plain_uv(material, ("base_color", "normal")) is plain
    assert has_plain_uv(material, ("base_color",))  # only what is sampled counts


def test_plain_coordinates_give_the_bits_of_general_ones(gpu):
    """The second set of coordinates takes the general path of the shader."""
    out = []
    for texcoord in (0, 1):
        floor = quad((-30, -1, 0), (60, 0, 0), (0, 0, -60), material=0)
        uv = 37.3 * floor.texcoords[0]
        floor = replace(floor, texcoords=(uv, uv))
        texture = Texture(0, texcoord=texcoord)
        material = Material(
            base_color_texture=texture, normal_texture=texture, metallic_roughness_texture=texture,
            occlusion_texture=texture, emissive_texture=texture, emissive=(2.0, 1.0, 3.0), double_sided=True,
        )  # fmt: skip
        scene = make_scene(floor, materials=(material,), images=(CHECKER,))
        out.append(frames(gpu, scene, still_camera(LENS))[0])
    assert np.unique(out[0][0.0, "base_color"]).size > 100
    for key, values in out[0].items():
        assert np.array_equal(out[1][key].view(np.uint8), values.view(np.uint8)), key
