"""Foliage keeps its coverage at every distance, in the image, in shadow maps and for rays.

The reference is the share of a texture's area whose bilinear alpha, times the material's, is above the cutoff.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from light_tools import FLAT, facing, floor, lambert, look_down, picture
from ray_tools import traced
from repeated import few
from shadow_tools import on_plane, visibility

from taubench_gl.scene.builder import SceneBuilder, quad
from taubench_gl.scene.model import Image, Sampler, Scene, Texture

TEXELS, PIXELS, HEIGHT, HALF = 128, 160, 1.0, 1.0
TOLERANCE, EXACT = 0.03, 0.005
TILES = (1, 3, 7, 17, 37, 91, 203)
"""Textures across the image, from 0.8 to 162 texels in a pixel.

Each has no factor in common with ``PIXELS``: pixel centers are 160x160 evenly spaced points of the texture.
"""

REPEAT, MIRRORED = 10497, 33648


def leaves() -> np.ndarray:
    """Thin soft-edged leaves on the left, blades of grass on the right.  (TEXELS, TEXELS) uint8."""
    rng = np.random.default_rng(4)
    y, x = np.mgrid[:TEXELS, :TEXELS] + 0.5
    alpha = np.zeros((TEXELS, TEXELS))
    for _ in range(50):
        center, turn = rng.random(2) * (TEXELS / 2, TEXELS), rng.random() * np.pi
        dx, dy = x - center[0], (y - center[1] + TEXELS / 2) % TEXELS - TEXELS / 2
        along, across = dx * np.cos(turn) + dy * np.sin(turn), dy * np.cos(turn) - dx * np.sin(turn)
        alpha = np.maximum(alpha, np.clip(1.5 - (along / 9.0) ** 2 - (across / 2.5) ** 2, 0.0, 1.0) * (x < TEXELS / 2))
    for stem in TEXELS / 2 + rng.random(14) * (TEXELS / 2):
        alpha = np.maximum(alpha, np.clip(1.6 - np.abs(x - stem), 0.0, 1.0) * (x > TEXELS / 2))
    return np.round(255 * alpha).astype(np.uint8)


ALPHA = leaves()
MATERIALS = {
    "plain": {},
    "low cutoff": {"alpha_cutoff": 0.2},
    "factors": {  # of the material and of vertices
        "alpha_cutoff": 0.4,
        "base_color": (0.5, 0.5, 0.5, 0.75),
        "vertex": 0.8,
    },
    "blended": {"alpha_mode": "BLEND"},
}


def coverage(material: dict, first: float = 0.0, last: float = 1.0, points: int = PIXELS) -> float:
    """Share of ``points`` squared, evenly spaced from u = ``first`` to ``last`` and v = 0 to 1, above the cutoff."""
    v = (np.arange(points) + 0.5) / points
    alpha = ALPHA / 255.0
    for at in (v, first + (last - first) * v):
        low = np.floor(at * TEXELS - 0.5).astype(int)
        f = (at * TEXELS - 0.5 - low)[:, None]
        alpha = (alpha[low % TEXELS] * (1 - f) + alpha[(low + 1) % TEXELS] * f).T
    alpha = alpha * material.get("base_color", (1.0,))[-1] * material.get("vertex", 1.0)
    return float((alpha >= material.get("alpha_cutoff", 0.5)).mean())


def sheet(tiles: float, *materials: dict, below: bool = False, wrap: int = REPEAT, turn: float = 0.0) -> Scene:
    """A sheet of foliage above a floor, in strips along x of one material each.

    The camera looks down on ``tiles`` textures, turned by ``turn`` radians, from above the sheet or ``below`` it.
    """
    pixels = np.full((TEXELS, TEXELS, 4), 90, dtype=np.uint8)
    pixels[..., 3] = ALPHA
    b = SceneBuilder()
    floor(b, 4.0, material=lambert(b))
    texture = Texture(0, Sampler(wrap_s=wrap, wrap_t=wrap))
    for i, fields in enumerate(materials):
        given = {"alpha_mode": "MASK", "double_sided": True, "metallic": 0.0, "base_color_texture": texture} | fields
        vertex = given.pop("vertex", 1.0)
        card = quad(2.0 / len(materials), 2.0, material=b.material(**given))
        turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        uv = (tiles * card.positions[:, :2] @ turned / (2 * HALF)).astype(np.float32)
        colors = np.tile(np.float32([1, 1, 1, vertex]), (len(uv), 1))
        card = dataclasses.replace(card, texcoords=(uv, None), colors=colors)
        x = -2.0 + (2 * i + 1) * 2.0 / len(materials)
        b.node(mesh=b.mesh(card), translation=(x, HEIGHT, 0), rotation=FLAT)
    b.light(rotation=facing((0.0, -1.0, 0.0)), kind="directional", intensity=3.0)
    look_down(b, HALF, height=0.5 * HEIGHT if below else 8.0)
    return dataclasses.replace(b.build(), images=(Image("leaves", (TEXELS, TEXELS), lambda: pixels),))


def drawn(gpu, scene: Scene, **settings) -> np.ndarray:
    """(h, w) bool: pixels that show the sheet."""
    shot = picture(gpu, scene, width=PIXELS, height=PIXELS, **settings)
    return shot.surface & ~on_plane(shot)


@pytest.mark.parametrize("name", MATERIALS)
def test_the_image_keeps_it(gpu, name):
    expected = coverage(MATERIALS[name])
    for tiles in TILES:
        found = drawn(gpu, sheet(tiles, MATERIALS[name]), columns=("position",)).mean()
        assert found == pytest.approx(expected, rel=EXACT), tiles


def test_materials_that_share_a_texture_keep_their_own(gpu):
    low, factor = MATERIALS["low cutoff"], MATERIALS["factors"]
    found = drawn(gpu, sheet(71.3, low, factor, turn=0.4), columns=("position",))
    for half, fields in zip(np.split(found, 2, axis=1), (low, factor), strict=True):
        assert half.mean() == pytest.approx(coverage(fields, points=8 * TEXELS), rel=TOLERANCE)


@pytest.mark.parametrize("wrap", [REPEAT, MIRRORED])
@pytest.mark.parametrize("columns", [("position",), ("position", "normal", "direct", "color")])
def test_it_does_not_depend_on_mipmaps(gpu, wrap, columns):
    scene = sheet(17, {}, wrap=wrap)
    images = [drawn(gpu, scene, columns=columns, textures=t) for t in ("mipmapped", "finest")]
    np.testing.assert_array_equal(*images)


def test_the_parts_of_an_atlas_keep_theirs(gpu):
    """Only the right half of the texture, grass."""
    for tiles in TILES:
        scene = sheet(tiles, {})
        card = scene.meshes[1].primitives[0]
        uv = card.texcoords[0] * (0.0, 1.0) + np.where(card.positions[:, :1] > 0, (0.99, 0.0), (0.51, 0.0))
        card = dataclasses.replace(card, texcoords=(uv.astype(np.float32), None))
        meshes = (scene.meshes[0], dataclasses.replace(scene.meshes[1], primitives=(card,)))
        found = drawn(gpu, dataclasses.replace(scene, meshes=meshes), columns=("position",)).mean()
        # The image shows the middle of the card, u = 0.63 to 0.87.
        assert found == pytest.approx(coverage({}, 0.63, 0.87), rel=EXACT), tiles


@pytest.mark.parametrize("name", ["plain", "factors"])
@pytest.mark.parametrize("map_size", few([256, 1024]))
def test_shadow_maps_keep_it(gpu, name, map_size):
    """The mean over distances: a map's texels are not evenly spaced points of the texture."""
    shares = []
    for tiles in (11.9, 17.3, 23.3, 31.7, 47.9, 71.3, 93.7, 131.1):
        scene = sheet(tiles, MATERIALS[name], below=True, turn=0.3 + tiles)
        shot, lit = visibility(gpu, scene, shadow_size=map_size, shadow_filter="hard")
        assert on_plane(shot).all()
        shares.append(np.mean(1.0 - lit))
    assert np.mean(shares) == pytest.approx(coverage(MATERIALS[name], points=8 * TEXELS), rel=TOLERANCE)


@pytest.mark.parametrize("name", ["plain", "factors"])
def test_rays_keep_it_and_meet_what_the_image_shows(gpu, name):
    expected = coverage(MATERIALS[name])
    at = (np.arange(PIXELS) + 0.5) / PIXELS * 2 * HALF - HALF
    x, z = (v.ravel() for v in np.meshgrid(at, at))
    for tiles in (3, 37):
        scene = sheet(tiles, MATERIALS[name])
        with traced(gpu, scene, alpha_test=True) as t:
            origins = np.column_stack([x, np.full_like(x, 8.0), z]).astype(np.float32)
            hits = t.query(origins, np.tile(np.float32([0, -1, 0]), (len(x), 1)))
            met = hits.t < 7.5
        assert met.mean() == pytest.approx(expected, rel=EXACT), tiles
        # The rest is texture filtering in 8 bits at the edges of leaves.
        assert np.mean(met.reshape(PIXELS, PIXELS) != drawn(gpu, scene, columns=("position",))) < 0.01
