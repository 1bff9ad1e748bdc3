"""Cases: textures, their encoding and orientation, and color from radiance."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from taubench_gl.scene.builder import SceneBuilder, quad
from taubench_gl.scene.model import Image, Sampler, Scene, Texture
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, count, field, worst
from taubench_gl.selftest.direct import WALL_Z, lambert, lambert_wall
from taubench_gl.selftest.geometry import one_metre_per_pixel

Array = np.ndarray
NEAREST = Sampler(mag_filter=9728, min_filter=9728)
CLAMPED = dataclasses.replace(NEAREST, wrap_s=33071, wrap_t=33071)
MIRRORED = dataclasses.replace(NEAREST, wrap_s=33648, wrap_t=33648)


def decoded(code: Array) -> Array:
    """Linear values of 8-bit sRGB codes, from IEC 61966-2-1."""
    x = np.asarray(code, dtype=np.float64) / 255.0
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def _textured(bench: Bench, texels: Array, sampler: Sampler = CLAMPED, uv: Array | None = None, **material) -> Scene:
    """A 16 x 16 m wall, 1 m per pixel; ``texels`` (h, w, 4), the first row at v = 0, which is its upper edge."""
    b = SceneBuilder()
    fields = {"metallic": 1.0, "roughness": 1.0} | {name: Texture(0, sampler) for name in material.pop("slots")}
    corners = np.float32([[0, 1], [1, 1], [0, 0], [1, 0]]) if uv is None else np.float32(uv)
    wall = dataclasses.replace(quad(8, 8, material=b.material(**fields, **material)), texcoords=(corners, None))
    b.node(mesh=b.mesh(wall), translation=(0.0, 0.0, WALL_Z))
    one_metre_per_pixel(b, bench)
    image = Image("texels", texels.shape[1::-1], lambda: texels)
    return dataclasses.replace(b.build(), images=(image,))


def _ramp() -> Array:
    """Texels with the codes 0 .. 255 row by row, from the upper left, (16, 16, 4) uint8."""
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16)
    return np.stack([codes, codes[::-1], np.full_like(codes, 77), np.full_like(codes, 255)], axis=-1)


def _drawn(bench: Bench, scene_of: Callable[[Bench], Scene], name: str) -> Array:
    """A channel of the 16 x 16 pixels of the wall, (16, 16, n) float64."""
    with bench.even() as even:
        frame, _ = even.frame(scene_of(even), extra=(name,))
    rows, columns = np.nonzero(frame["position"][..., 3] > 0.0)
    assert len(rows), "the wall is not in the image"
    return frame[name][rows.min() : rows.min() + 16, columns.min() : columns.min() + 16].astype(np.float64)


@case(
    "srgb-texture",
    tolerance=1.0 / 255.0,
    source="drivers may decode sRGB with the precision of 8 bits near 1 (OpenGL 4.5, 8.24)",
)
def srgb_texture(bench: Bench) -> Outcome:
    """A base color texture with all 256 codes, a texel per pixel: linear base color against IEC 61966-2-1.

    A power of 2.2, no decoding, rows upside down.
    """
    got = _drawn(bench, lambda even: _textured(even, _ramp(), slots=("base_color_texture",)), "base_color")
    return field("IEC 61966-2-1", got[..., :3] - decoded(_ramp()[..., :3]))


@case("linear-texture", tolerance=5e-4, source="the material channel holds half floats: half a step of 2^-10")
def linear_texture(bench: Bench) -> Outcome:
    """A metallic-roughness texture with all 256 codes, a texel per pixel: metalness and roughness against code / 255.

    Data textures decoded as color, or the channels of another convention.
    """
    slots = ("metallic_roughness_texture",)
    got = _drawn(bench, lambda even: _textured(even, _ramp(), slots=slots), "material")
    expected = _ramp()[..., [2, 1]] / 255.0
    return field("code / 255", got[..., :2] - expected)


@case("mirrored-wrap", source="exact: nearest texels")
def mirrored_wrap(bench: Bench) -> Outcome:
    """A texture repeated with mirrored wrapping over four turns: texels that are wrong.

    Mirrored wrapping taken for repeat.
    """
    uv = [[-2, 2], [2, 2], [-2, -2], [2, -2]]
    texels = _ramp()[:4, :4].copy()
    texels[..., :3] = np.arange(48, dtype=np.uint8).reshape(4, 4, 3) * 5

    got = _drawn(bench, lambda even: _textured(even, texels, MIRRORED, uv, slots=("base_color_texture",)), "base_color")
    got = got[..., :3]
    at = np.arange(16)
    fold = np.where((at // 4) % 2 == 0, at % 4, 3 - at % 4)
    expected = decoded(texels[np.ix_(fold, fold)][..., :3])
    return count(0, int((np.abs(got - expected) > 2e-3).any(axis=-1).sum()))


SRGB = (
    (0.0, 0.0),
    (0.001, 0.01292),
    (0.0031308, 0.04045),
    (0.05, 0.24780),
    (0.18, 0.46136),
    (0.5, 0.73536),
    (1.0, 1.0),
)
"""Linear values and their sRGB encoding, five digits."""


@case("srgb-encoding", tolerance=1e-5, source="table with five digits")
def srgb_encoding(bench: Bench) -> Outcome:
    """Skies of seven radiances at exposure 1: color against tabulated sRGB values.

    A power of 1 / 2.2, or the linear toe left out.
    """
    off = []
    for i in range(0, len(SRGB) - 2, 2):
        linear, encoded = zip(*SRGB[i : i + 3], strict=True)
        off.append(worst(_sky_color(bench, linear) - encoded))
    return field("the table", off)


def _sky_color(bench: Bench, radiance: tuple[float, ...], **settings) -> Array:
    """Color of the background of a scene under a uniform sky, (3,)."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(1, 1, material=lambert(b))), translation=(0.0, 0.0, WALL_Z))
    one_metre_per_pixel(b, bench)
    shot = bench.shots(b.build(), columns=("color",), environment=radiance, **settings)[0]
    return shot["color"][0, 0, :3]


@case("tone-maps", tolerance=1e-5, source="float32: 80 ulps of 1")
def tone_maps(bench: Bench) -> Outcome:
    """A sky of radiance 0.25, 0.5 and 2 at exposure 4: color by each tone map against its formula.

    Exposure after the curve, or curves that are not clamped.
    """
    radiance = (0.25, 0.5, 2.0)
    x = 4.0 * np.array(radiance)
    curves = {
        "linear": np.minimum(x, 1.0),
        "reinhard": x / (1.0 + x),
        "aces": np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1.0),
    }
    off = []
    for name, mapped in curves.items():
        encoded = np.where(mapped <= 0.0031308, 12.92 * mapped, 1.055 * mapped ** (1 / 2.4) - 0.055)
        off.append(worst(_sky_color(bench, radiance, exposure=4.0, tone_map=name) - encoded))
    return field("the formulas", off)


@case("color-is-the-sum", tolerance=1e-5, source="float32: 80 ulps of 1")
def color_is_the_sum(bench: Bench) -> Outcome:
    """A wall that glows with 0.125 under a sun that adds 0.25, at exposure 2: its color against sRGB of 0.75.

    Emission replaces light, or is not exposed.
    """
    b = lambert_wall(bench, 0.5, emissive=(0.125, 0.125, 0.125))
    b.light(kind="directional", intensity=0.5 * np.pi)
    shot = bench.shots(b.build(), columns=("direct", "color"), exposure=2.0)[0]
    expected = 1.055 * 0.75 ** (1 / 2.4) - 0.055
    off = shot["color"][..., :3][shot.surface] - expected
    return field("0.8809", off if len(off) else np.nan)


@case("texture-transform", source="exact: nearest texels")
def texture_transform(bench: Bench) -> Outcome:
    """A texture turned by 90 degrees, scaled and shifted (KHR_texture_transform): texels that are wrong.

    The transform is ignored, or applied in the order offset, rotation, scale.
    """
    transform = np.array([[0.0, 0.5, 0.25], [-0.5, 0.0, 0.75]])  # u' = v / 2 + 1/4, v' = 3/4 - u / 2

    def scene_of(even: Bench) -> Scene:
        scene = _textured(even, _ramp(), slots=("base_color_texture",))
        texture = dataclasses.replace(scene.materials[-1].base_color_texture, uv_transform=transform)
        material = dataclasses.replace(scene.materials[-1], base_color_texture=texture)
        return dataclasses.replace(scene, materials=(*scene.materials[:-1], material))

    got = _drawn(bench, scene_of, "base_color")[..., :3]
    u, v = np.meshgrid((np.arange(16) + 0.5) / 16, (np.arange(16) + 0.5) / 16)
    column, row = (np.floor(16 * x).astype(int) for x in (0.5 * v + 0.25, 0.75 - 0.5 * u))
    expected = decoded(_ramp()[row, column][..., :3])
    wrong = int((np.abs(got - expected) > 2e-3).any(axis=-1).sum())
    return count(0, wrong)


@case("alpha-mask", source="exact: nearest texels, and no code is within 1/1000 of the cutoff")
def alpha_mask(bench: Bench) -> Outcome:
    """A wall with alpha from 0 to 1 and cutoff 0.25: pixels that are drawn.

    A fixed cutoff of 0.5, or masked surfaces drawn whole.
    """
    texels = _ramp().copy()
    texels[..., 3] = texels[..., 0]

    mask = {"slots": ("base_color_texture",), "alpha_mode": "MASK", "alpha_cutoff": 0.25}
    with bench.even() as even:
        frame, _ = even.frame(_textured(even, texels, **mask))
    expected = int((texels[..., 3] / 255.0 >= 0.25).sum())
    drawn = int((frame["position"][..., 3] > 0.0).sum())
    return count(expected, drawn)


@case("normal-scale", tolerance=1e-5, source="float32: 80 ulps of 1")
def normal_scale(bench: Bench) -> Outcome:
    """A normal map with scale 0.5: normals against those of the halved slope.

    The scale is ignored, or applied after the normal has unit length.
    """
    texels = np.full((2, 2, 4), 255, np.uint8)
    texels[..., :3] = 200, 90, 180
    x, y, z = texels[0, 0, :3] / 255.0 * 2.0 - 1.0
    scene = _textured(bench, texels, slots=("normal_texture",), normal_scale=0.5)
    frame, _ = bench.frame(scene)
    halved = np.array([0.5 * x, 0.5 * y, z])
    expected = halved / np.linalg.norm(halved)
    got = frame["normal"][..., :3][frame["position"][..., 3] > 0.0]
    return field("half the slope", got - expected if len(got) else np.nan)
