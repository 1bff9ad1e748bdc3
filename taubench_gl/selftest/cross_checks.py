"""Cases: one scene with many kinds of surfaces by two ways, or changed so that the result follows from the other."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from taubench_gl.scene.builder import SceneBuilder, box, morphed, quad, skinned, sphere, turn, turn_x, turn_y
from taubench_gl.scene.model import Image, Primitive, Sampler, Scene, Texture
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, field

Array = np.ndarray
NEAREST = Sampler(mag_filter=9728, min_filter=9728)
COLUMNS, ROWS = 6, 3
CELL = 16
"""Pixels of each surface of ``sampler_board``, along both sides."""


def _texels() -> tuple[Image, ...]:
    """Colors with an alpha of 0.2 or 0.9, normals, 5 x 3 colors for odd sizes, and the same as data."""
    rng = np.random.default_rng(3)
    colors = rng.integers(40, 256, (8, 8, 4), dtype=np.uint8)
    colors[..., 3] = np.where(np.arange(8) % 4 < 2, 51, 230)
    leaning = rng.normal([0.0, 0.0, 2.0], 0.5, (4, 4, 3))
    leaning /= np.linalg.norm(leaning, axis=-1, keepdims=True)
    normals = np.concatenate([np.rint(127.5 + 127.5 * leaning), np.full((4, 4, 1), 255)], axis=-1).astype(np.uint8)
    odd = rng.integers(60, 256, (3, 5, 4), dtype=np.uint8)
    return tuple(
        Image(name, texels.shape[1::-1], lambda texels=texels: texels)
        for name, texels in (("colors", colors), ("normals", normals), ("odd", odd), ("data", odd))
    )


def _mapped(primitive: Primitive, **attributes) -> Primitive:
    """A flat primitive with both sets of texture coordinates: over its extent, and twice that, beyond 0 and 1."""
    low, high = primitive.positions[:, :2].min(axis=0), primitive.positions[:, :2].max(axis=0)
    uv = ((primitive.positions[:, :2] - low) / (high - low) * (1, -1) + (0, 1)).astype(np.float32)
    return dataclasses.replace(primitive, texcoords=(uv, (3.0 * uv - 0.7).astype(np.float32)), **attributes)


def _surfaces(b: SceneBuilder) -> list[Primitive]:
    """18 surfaces of 0.7 m around the origin that face +Z: a kind of material or mesh each."""

    def matte(**fields) -> int:
        return b.material(**({"metallic": 0.0, "roughness": 0.9, "base_color": (0.8, 0.5, 0.3, 1.0)} | fields))

    def texture(image: int, wrap: int = 10497, texcoord: int = 0, transform=None, **sampler) -> Texture:
        wrapped = dataclasses.replace(NEAREST, **({"wrap_s": wrap, "wrap_t": wrap} | sampler))
        return Texture(image, wrapped, texcoord, np.eye(2, 3) if transform is None else np.array(transform))

    def plate(material: int, cells=(1, 1)) -> Primitive:
        return _mapped(quad(0.35, 0.35, cells=cells, material=material))

    turned = [[0.6, -0.9, 0.1], [1.1, 0.4, 0.3]]
    colors = np.float32([[1, 0.2, 0.1, 1], [0.1, 1, 0.3, 1], [0.2, 0.1, 1, 1], [0.9, 0.8, 0.1, 1]])
    bent = quad(0.35, 0.35, cells=(2, 2), material=matte(double_sided=True))
    sides = np.clip(0.5 + 1.4 * bent.positions[:, :1], 0.0, 1.0)
    red, green = matte(base_color=(0.9, 0.1, 0.05, 1.0)), matte(base_color=(0.1, 0.7, 0.2, 1.0), specular=0.3)
    bump = np.where(np.abs(bent.positions[:, :1]) < 0.1, 0.3, 0.0) * [0.3, 0.0, 1.0]
    return [
        plate(matte(base_color_texture=texture(0))),
        plate(matte(base_color_texture=texture(0, 33648, 1))),
        plate(matte(base_color_texture=texture(2, 33071, 1))),
        plate(matte(base_color_texture=texture(2, 10497, 0, turned))),
        plate(matte(base_color_texture=texture(0, wrap=33648, wrap_t=33071, texcoord=1))),
        plate(b.material(metallic_roughness_texture=texture(3), base_color=(0.9, 0.7, 0.5, 1.0))),
        plate(matte(normal_texture=texture(1), normal_scale=0.7)),
        plate(matte(base_color_texture=texture(0), alpha_mode="MASK", alpha_cutoff=0.5)),
        _mapped(quad(0.35, 0.35, material=matte()), colors=colors),
        dataclasses.replace(box((0.3, 0.3, 0.15), material=red), normals=None),
        dataclasses.replace(sphere(0.35, 12), material=green),
        plate(b.material(metallic=0.8, roughness=0.5, base_color=(0.9, 0.6, 0.2, 1.0), occlusion_texture=texture(3),
                         occlusion_strength=0.7)),
        plate(matte(emissive=(0.5, 0.9, 0.2), emissive_texture=texture(2))),
        plate(matte(double_sided=True)),
        box((0.25, 0.3, 0.1), material=red),
        morphed(bent, bump),
        skinned(bent, np.tile([0, 1], (len(sides), 1)), np.concatenate([1 - sides, sides], axis=1)),
        quad(0.15, 0.2, material=green),
    ]  # fmt: skip


def sampler_board(b: SceneBuilder, root: int) -> None:
    """The surfaces of ``_surfaces``, 1 m apart in 3 rows of 6, below ``root``."""
    for i, surface in enumerate(_surfaces(b)):
        at = (i % COLUMNS - 0.5 * (COLUMNS - 1), 0.5 * (ROWS - 1) - i // COLUMNS, 0.0)
        fields = {"translation": at, "rotation": turn((1.0, 0.5, 0.2), 25.0)}
        if i == 13:  # its back
            fields["rotation"] = turn_y(160.0)
        elif i == 14:  # mirrored
            fields["scale"] = (-1.0, 1.0, 1.5)
        elif i == 15:
            fields["weights"] = np.array([0.8])
        elif i == 16:
            joints = [b.node(root, translation=at), b.node(root, translation=at, rotation=turn_x(40.0))]
            b.animate(joints[1], "rotation", [0.0, 1.0], [turn_x(40.0), turn_x(25.0)])
            fields = {"skin": b.skin(joints)}
        elif i == 17:
            matrices = np.tile(np.eye(4), (4, 1, 1))
            matrices[:, :2, 3] = [(-0.2, -0.25), (0.2, -0.25), (-0.2, 0.25), (0.2, 0.25)]
            matrices[2, :3, :3] *= 0.5
            fields["instances"] = matrices
        node = b.node(root, mesh=b.mesh(surface), **fields)
        if i == 15:
            b.animate(node, "weights", [0.0, 1.0], [[0.8], [0.5]])


def _with_board(mirrored: bool, front: float = 3.0) -> Scene:
    """The board facing -Z, and a camera behind it that sees the mirror in the plane z = -``front``, or its image.

    The near plane cuts the board out of what the camera sees directly.  No surface shadows another one.
    """
    b = SceneBuilder()
    sampler_board(b, b.node(rotation=turn_y(180.0)))
    if mirrored:
        b.node(mesh=b.mesh(quad(9.0, 9.0, material=b.material(roughness=0.0))), translation=(0.0, 0.0, -front))
    b.light(translation=(0.4, 0.3, 0.2 - front), intensity=30.0, color=(1.0, 0.8, 0.6), range=40.0)
    lens = {"kind": "orthographic", "xmag": 0.5 * COLUMNS, "ymag": 0.5 * ROWS, "zfar": 30.0}
    if mirrored:
        b.camera(translation=(0.0, 0.0, 2.0), znear=2.7, **lens)
    else:
        b.camera(translation=(0.0, 0.0, -2.0 * front - 2.0), rotation=turn_y(180.0), znear=0.5, **lens)
    return dataclasses.replace(b.build(), images=_texels())


def _cells(image: Array) -> Array:
    """Mean colors of the surfaces of the board.  (h, w, n) -> (ROWS, COLUMNS, 3)."""
    return image[..., :3].astype(np.float64).reshape(ROWS, CELL, COLUMNS, CELL, 3).mean(axis=(1, 3))


@case(
    "board-in-a-mirror",
    tolerance=0.06,
    source="relative; texels at borders, sampled once per pixel, and the width of the narrowest lobe",
)
def board_in_a_mirror(bench: Bench) -> Outcome:
    """18 kinds of surfaces in a mirror, path-traced: mean colors against the rasterized ones by the mirrored camera.

    Rays find other texels, normals, sides, instances or poses than the rasterizer draws.
    """
    size = {"width": COLUMNS * CELL, "height": ROWS * CELL}
    seen = bench.traced(_with_board(True), spp=16, bounces=2, **size)
    shot = bench.shots(_with_board(False), columns=("direct",), extra=("emission",), shadow_lights=0, **size)[0]
    expected = _cells(shot["direct"]) + _cells(shot["emission"])
    measured = _cells(seen["indirect"][:, ::-1])
    measured[2, 0] += _cells(seen["direct"][:, ::-1])[2, 0]  # emission; the lamp itself shines on the mirror too
    return field("the mirrored camera", measured / expected - 1.0)


def _rolled(scene: Scene) -> Scene:
    """``scene`` with red as green, green as blue and blue as red: materials, color images, vertices and lights."""

    def roll(color) -> tuple[float, ...]:
        return (color[2], color[0], color[1], *color[3:])

    def roll_image(image: Image) -> Image:
        if image.name not in ("colors", "odd"):
            return image
        return Image(image.name, image.size, lambda: np.ascontiguousarray(image.decode()[..., [2, 0, 1, 3]]))

    def roll_colors(primitive: Primitive) -> Primitive:
        colors = primitive.colors
        return primitive if colors is None else dataclasses.replace(primitive, colors=colors[:, [2, 0, 1, 3]])

    return dataclasses.replace(
        scene, images=tuple(map(roll_image, scene.images)),
        materials=tuple(
            dataclasses.replace(m, base_color=roll(m.base_color), emissive=roll(m.emissive)) for m in scene.materials
        ),
        lights=tuple(dataclasses.replace(light, color=roll(light.color)) for light in scene.lights),
        meshes=tuple(dataclasses.replace(m, primitives=tuple(map(roll_colors, m.primitives))) for m in scene.meshes),
    )  # fmt: skip


def _room_with_board() -> Scene:
    """The board on a wall of a room with colored sides and a window, under a lamp, a spot, the sun and the sky."""
    b = SceneBuilder()
    sampler_board(b, b.node())
    for place, turned, color in (
        ((0.0, 0.0, -0.6), turn_y(0.0), (0.7, 0.6, 0.2)), ((-3.5, 0.0, 2.0), turn_y(90.0), (0.8, 0.2, 0.1)),
        ((0.0, -2.0, 2.0), turn_x(-90.0), (0.2, 0.5, 0.9)),
    ):  # fmt: skip
        side = b.material(base_color=(*color, 1.0), metallic=0.0, roughness=1.0, double_sided=True)
        b.node(mesh=b.mesh(quad(4.0, 4.0, material=side)), translation=place, rotation=turned)
    b.light(translation=(-1.0, 1.5, 3.0), intensity=9.0, color=(1.0, 0.7, 0.4))
    b.light(kind="spot", translation=(2.0, 1.0, 4.0), intensity=20.0, color=(0.0, 0.0, 1.0), inner_cone=0.2,
            outer_cone=0.6, rotation=turn_y(10.0))  # fmt: skip
    b.light(kind="directional", intensity=0.8, color=(0.9, 1.0, 0.5), rotation=turn((1.0, 0.4, 0.0), -40.0))
    b.camera(translation=(0.3, 0.4, 6.0), rotation=turn_x(-3.0), yfov=0.9, znear=0.1)
    return dataclasses.replace(b.build(), images=_texels())


SKY = (0.1, 0.25, 0.4)


def _exchanged(radiance: Callable[[Scene, Sequence[float]], dict[str, Array]]) -> Outcome:
    """``radiance`` of a scene under a sky: images or means (..., 3) by name, of which no channel is special."""
    scene = _room_with_board()
    here, there = radiance(scene, SKY), radiance(_rolled(scene), (SKY[2], SKY[0], SKY[1]))
    errors = [np.abs(there[n] - here[n][..., [2, 0, 1]]).mean() / here[n].mean() for n in here]
    means = [image.reshape(-1, 3).mean(axis=0) for image in here.values()]
    errors += [1.0 for mean in means if not np.ptp(mean) > 0.05 * mean.mean()]  # gray proves nothing
    return field("no difference", errors)


@case(
    "exchanged-colors-by-{0}",
    tolerance=1e-5,
    source="float32: sums of products in the same order",
    each=(("rsm",), ("probes",)),
)
def exchanged_colors(bench: Bench, method: str) -> Outcome:
    """A colorful room under three lights and a sky, its red, green and blue exchanged: radiance by {0} over its mean.

    One of many products takes another channel, which white light and gray walls do not show.
    """

    def radiance(scene: Scene, sky: Sequence[float]) -> dict[str, Array]:
        options = {"columns": ("direct", "indirect", "color"), "indirect": method, "shadow_size": 64, "probes": 200,
               "indirect_samples": 400, "width": 64, "height": 36}  # fmt: skip
        shot = bench.shots(scene, extra=("emission",), environment=tuple(sky), **options)[0]
        return {name: shot[name][..., :3] for name in (*options["columns"], "emission")}

    return _exchanged(radiance)


@case("exchanged-colors-by-paths", tolerance=0.05, source="means of 18,432 paths, whose lights are chosen by luminance")
def exchanged_colors_by_paths(bench: Bench) -> Outcome:
    """A colorful room under three lights and a sky, its red, green and blue exchanged: means of path-traced light.

    One of many products takes another channel, which white light and gray walls do not show.
    """

    def radiance(scene: Scene, sky: Sequence[float]) -> dict[str, Array]:
        options = {"width": 32, "height": 18, "spp": 32, "bounces": 4, "pattern": "independent"}
        images = bench.traced(scene, environment=tuple(sky), **options)
        return {name: image[..., :3].mean(axis=(0, 1)) for name, image in images.items()}

    return _exchanged(radiance)


@case(
    "room-by-two-renderers",
    tolerance=0.04,
    source="pixels off by more than 4 % of the mean: edges of shadows, and textures at their borders",
)
def room_by_two_renderers(bench: Bench) -> Outcome:
    """A room with a lamp, a spot and the sun, rasterized and path-traced: share of pixels with another direct radiance.

    A map, a cone or a lamp that only one of the two renderers places right.
    """
    scene, size = _room_with_board(), {"width": 96, "height": 54}
    dark = tuple(dataclasses.replace(m, emissive=(0.0, 0.0, 0.0)) for m in scene.materials)  # only paths see its light
    scene = dataclasses.replace(scene, materials=dark)
    direct = bench.shots(scene, shadow_size=512, **size)[0].direct
    traced = bench.traced(scene, spp=16, bounces=1, **size)["direct"][..., :3]
    off = (np.abs(direct - traced) > 0.04 * direct.mean()).any(axis=-1)
    return field("one picture", [off.mean(), float(not traced.mean() > 0.05)])
