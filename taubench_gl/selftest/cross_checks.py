"""Cases: one scene with many kinds of surfaces by two ways, or changed so that the result follows from the other."""

from __future__ import annotations

import dataclasses
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from taubench_gl.animation import FrameState, choose_camera, pose_vertices
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Reason, Visibility
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.evaluation.exposure import exposure_of
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.features import FEATURE_BIT, FEATURES
from taubench_gl.frame.passes.pathtracing import pixel_footprint
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.math3d import mat3_from_quat
from taubench_gl.metrics.environment import directions
from taubench_gl.metrics.visibility import PreviousSurfaces, visibility
from taubench_gl.scene.model import Camera, Image, Primitive, Sampler, Scene, Texture
from taubench_gl.selftest.bench import Bench, rays
from taubench_gl.selftest.case import Outcome, case, field, worst
from taubench_gl.selftest.direct import lambert
from taubench_gl.selftest.scenes import (
    SceneBuilder,
    box,
    morphed,
    quad,
    skinned,
    sky_file,
    sphere,
    turn,
    turn_x,
    turn_y,
)
from taubench_gl.srgb import srgb_decode, srgb_encode

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


def sampler_board(b: SceneBuilder, root: int) -> None:
    """18 surfaces of 0.7 m, 1 m apart in 3 rows of 6, which face +Z of ``root``: a kind of material or mesh each."""

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
    surfaces = [
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
        plate(
            b.material(
                metallic=0.8,
                roughness=0.5,
                base_color=(0.9, 0.6, 0.2, 1.0),
                occlusion_texture=texture(3),
                occlusion_strength=0.7,
            )
        ),
        plate(matte(emissive=(0.5, 0.9, 0.2), emissive_texture=texture(2))),
        plate(matte(double_sided=True)),
        box((0.25, 0.3, 0.1), material=red),
        morphed(bent, bump),
        skinned(bent, np.tile([0, 1], (len(sides), 1)), np.concatenate([1 - sides, sides], axis=1)),
        quad(0.15, 0.2, material=green),
    ]
    for i, surface in enumerate(surfaces):
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
    description="18 kinds of surfaces seen in a mirror, path-traced, against the rasterized image by the mirrored "
    "camera: largest difference of the mean colors of a surface, relative",
    elsewhere="rays find other texels, normals, sides, instances or poses than the rasterizer draws",
    here="materials and vertices are read by the same rules at hits and at pixels",
    tolerance=0.06,
    source="relative; texels at borders, sampled once per pixel, and the width of the narrowest lobe",
)
def board_in_a_mirror(bench: Bench) -> Outcome:
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


def _rolled_case(what: str, tolerance: float, source: str, radiance) -> None:
    """``radiance(bench, scene, sky)``: images or means (..., 3) by name."""

    @case(
        f"exchanged-colors-by-{what}",
        description="a room with textures, vertex colors, emission, three colored lights and a sky, its red, green "
        f"and blue exchanged: radiance by {what} against the exchanged radiance, mean difference over mean",
        elsewhere="one of many products takes another channel, which white light and gray walls do not show",
        here="no channel is special",
        tolerance=tolerance,
        source=source,
    )
    def exchanged(bench: Bench) -> Outcome:
        scene = _room_with_board()
        here, there = radiance(bench, scene, SKY), radiance(bench, _rolled(scene), (SKY[2], SKY[0], SKY[1]))
        errors = [np.abs(there[n] - here[n][..., [2, 0, 1]]).mean() / here[n].mean() for n in here]
        means = [image.reshape(-1, 3).mean(axis=0) for image in here.values()]
        errors += [1.0 for mean in means if not np.ptp(mean) > 0.05 * mean.mean()]  # gray proves nothing
        return field("no difference", errors)


def _shaded(method: str):
    def radiance(bench: Bench, scene: Scene, sky) -> dict[str, Array]:
        own = {"columns": ("direct", "indirect", "color"), "indirect": method, "shadow_size": 64, "probes": 200,
               "indirect_samples": 400, "width": 64, "height": 36}  # fmt: skip
        shot = bench.shots(scene, extra=("emission",), environment=sky, **own)[0]
        return {name: shot[name][..., :3] for name in (*own["columns"], "emission")}

    return radiance


def _traced(bench: Bench, scene: Scene, sky) -> dict[str, Array]:
    own = {"width": 32, "height": 18, "spp": 32, "bounces": 4, "pattern": "independent"}
    images = bench.traced(scene, environment=sky, **own)
    return {name: image[..., :3].mean(axis=(0, 1)) for name, image in images.items()}


_rolled_case("rsm", 1e-5, "float32: sums of products in the same order", _shaded("rsm"))
_rolled_case("probes", 1e-5, "float32: sums of products in the same order", _shaded("probes"))
_rolled_case("paths", 0.05, "means of 18,432 paths, whose lights are chosen by luminance", _traced)


def _sliding_room() -> Scene:
    """The board on its wall with a box that slides 1.5 m to the right before it, and a camera that walks and turns."""
    b = SceneBuilder()
    sampler_board(b, b.node())
    b.node(mesh=b.mesh(quad(3.4, 9.0, material=lambert(b, 0.5))), translation=(0.0, 0.0, -0.6))
    slide = b.node(mesh=b.mesh(box((0.4, 0.6, 0.3))))
    b.animate(slide, "translation", [0.0, 1.0], [(-1.0, 0.0, 1.5), (0.5, 0.0, 1.5)])
    lamp = b.light(translation=(-1.0, 1.5, 3.0), intensity=9.0, color=(1.0, 0.7, 0.4))
    b.animate(lamp, "translation", [0.0, 1.0], [(-1.0, 1.5, 3.0), (-0.5, 1.5, 3.0)])
    eye = b.camera(yfov=0.9, znear=0.1)
    b.animate(eye, "translation", [0.0, 1.0], [(0.0, 0.4, 6.0), (0.4, 0.3, 5.5)])
    b.animate(eye, "rotation", [0.0, 1.0], [turn_y(-2.0), turn_y(4.0)])
    return dataclasses.replace(b.build(), images=_texels())


def _explained(reprojection: str, sampling: str) -> None:
    @case(
        f"explained-pixels-{reprojection}-{sampling}",
        description=f"pixels of a moving room explained, {reprojection} reprojection, {sampling} history: differences "
        "of words, distances, history positions, values and reasons from the masks and channels",
        elsewhere="an explanation of another pixel, in rows from the bottom, or of the frame before",
        here="distances by the float64 reference of the masks, from the texels of both frames",
        tolerance=1e-3,
        source="float32; a count of pixels is at least 1",
    )
    def explained(bench: Bench) -> Outcome:
        errors: list[float] = []

        def look(pair) -> None:
            images = {name: pair.read(name) for name in ("position", "normal", "direct")}
            for y in range(1, 36, 4):
                for x in range(1, 64, 3):
                    errors.extend(_of_pixel(pair, pair.explain(x, y), images, x, y))

        settings = bench._settings({
            "width": 64, "height": 36, "fps": 1.0, "reprojection": reprojection, "sampling": sampling, "exposure": 1.0,
            "columns": ("frustum", "position", "normal", "direct", "color"), "shadow_lights": 0,
        })  # fmt: skip
        scene = _sliding_room()
        evaluate_scene(scene, settings, Observers(on_pair=look, distances=True), camera=choose_camera(scene))
        moved = [e for e in errors if e == _MOVED]
        errors = [e for e in errors if e != _MOVED]
        return field("as in the masks", [*errors, float(reprojection == "camera" and len(moved) < 5)])


_MOVED = -1e-9
"""Counts pixels that were found to have moved themselves."""


def _of_pixel(pair, explanation, images, x: int, y: int) -> list[float]:
    word = int(pair.mask[y, x])
    motion = pair.motion[y, x]
    compared = not word & (Reason.FIRST | Reason.CUT | Reason.INVALID | Reason.BEHIND | Reason.OUTSIDE)
    errors = [
        float(explanation.word != word), float(explanation.pixel != (x, y)),
        worst(np.subtract(explanation.motion_px, motion)),
        float("frustum" in str(explanation)) - bool(word & (Reason.BEHIND | Reason.OUTSIDE)),
    ]  # fmt: skip
    if not word:
        errors.append(float(str(explanation) != "reusable"))
    if explanation.at is not None:
        errors.append(worst(np.subtract(explanation.at, (x + motion[0], y + motion[1]))))
    for name in FEATURES:
        if name not in explanation.features:
            continue
        values = explanation.features[name]
        errors.append(float(values.discarded != bool(word & FEATURE_BIT[name])))
        if name in images:
            errors.append(worst(values.current - images[name][y, x, :3]))
        if (values.distance is None) != (not compared):
            errors.append(float(compared and not word & (Reason.SKY | Reason.HISTORY_SKY)))
        elif compared and np.isfinite(values.distance):
            errors.append(values.distance - float(pair.distances.features[name][y, x]))
    if explanation.object_motion_m is not None and explanation.object_motion_m > 1.0:  # of the box
        errors += [explanation.object_motion_m - 1.5, _MOVED]
    return errors


for _reprojection in ("camera", "motion"):
    for _sampling in ("nearest", "bilinear"):
        _explained(_reprojection, _sampling)


@case(
    "room-by-two-renderers",
    description="a room with a lamp, a spot and the sun, rasterized with shadow maps and path-traced: share of pixels "
    "whose direct radiance differs by more than 4 % of the mean",
    elsewhere="a map, a cone or a lamp that only one of the two renderers places right",
    here="both read one table of lights; maps and rays hit the same surfaces",
    tolerance=0.04,
    source="edges of shadows, and textures at their borders",
)
def room_by_two_renderers(bench: Bench) -> Outcome:
    scene, size = _room_with_board(), {"width": 96, "height": 54}
    dark = tuple(dataclasses.replace(m, emissive=(0.0, 0.0, 0.0)) for m in scene.materials)  # only paths see its light
    scene = dataclasses.replace(scene, materials=dark)
    direct = bench.shots(scene, shadow_size=512, **size)[0].direct
    traced = bench.traced(scene, spp=16, bounces=1, **size)["direct"][..., :3]
    off = (np.abs(direct - traced) > 0.04 * direct.mean()).any(axis=-1)
    return field("one picture", [off.mean(), float(not traced.mean() > 0.05)])


@case(
    "part-of-a-picture",
    description="the middle of a room by a camera of half the extents and pixels: largest difference of position, "
    "normal and direct light from the middle of the whole picture",
    elsewhere="an object whose box is outside the view, or that seems to be, is left out or darkens what it shadows",
    here="what is not drawn is outside of every pixel; shadow maps do not depend on the camera",
    tolerance=1e-4,
    source="meters and radiance; float32",
)
def part_of_a_picture(bench: Bench) -> Outcome:
    scene, frames = _room_with_board(), []
    for part in (1.0, 0.5, 0.125):
        lens = {"kind": "orthographic", "xmag": 3.2 * part, "ymag": 1.6 * part, "znear": 0.5, "zfar": 30.0, "yfov": 0.0}
        closer = tuple(dataclasses.replace(c, **lens) for c in scene.cameras)
        size = {"width": round(128 * part), "height": round(64 * part)}
        own = {"columns": ("direct",), "shadow_size": 256} | size
        frames.append(bench.shots(dataclasses.replace(scene, cameras=closer), extra=("normal",), **own)[0])
    errors = []
    for shot in frames[1:]:
        height, width = shot["position"].shape[:2]
        rows, columns = slice(32 - height // 2, 32 + height // 2), slice(64 - width // 2, 64 + width // 2)
        errors += [
            np.abs(shot[name] - frames[0][name][rows, columns]).mean() for name in ("position", "normal", "direct")
        ]
    return field("the middle of the picture", errors)


@case(
    "share-of-stochastic-alpha",
    description="a plate whose alpha rises from 0 to 1, drawn with a probability of alpha, still and posed: largest "
    "difference of the share of pixels from alpha, in 16 columns of 256 pixels",
    elsewhere="mixed hashes are not uniform: too few pixels at low alpha, too many at high",
    here="Wyman and McGuire's distribution of the mix of two levels",
    tolerance=0.09,
    source="three standard deviations of 256 pixels, and of the mean",
)
def share_of_stochastic_alpha(bench: Bench) -> Outcome:
    errors = []
    for posed, distance in ((False, 8.0), (False, 11.0), (True, 8.0)):
        b = SceneBuilder()
        material = b.material(alpha_mode="BLEND", stochastic=True, base_color=(1.0, 1.0, 1.0, 1.0), metallic=0.0)
        plate = quad(4.0, 0.5, cells=(16, 1), material=material)
        colors = np.ones((len(plate.positions), 4), np.float32)
        colors[:, 3] = 0.5 + plate.positions[:, 0] / 8.0
        plate = dataclasses.replace(plate, colors=colors)
        weights = (0.0,) if posed else ()
        plate = morphed(plate, np.ones_like(plate.positions)) if posed else plate
        plate = dataclasses.replace(plate, colors=colors)
        b.node(mesh=b.mesh(plate, weights=weights), translation=(0.0, 0.0, -distance))
        b.camera(kind="orthographic", xmag=4.0, ymag=0.25, znear=0.5, zfar=30.0)
        frame, _ = bench.frame(b.build(), size=(256, 16))
        drawn = (frame["position"][..., 3] > 0).reshape(16, 16, 16).mean(axis=(0, 2))
        off = drawn - (np.arange(16) + 0.5) / 16
        errors += [*off, 4.0 * off.mean()]
    return field("alpha", errors)


@case(
    "twelve-hundred-instances",
    description="1,200 boxes as instances of one node, still and moving, and as one mesh: pixels with another "
    "position, normal, light by a lamp and its shadows, rasterized and path-traced",
    elsewhere="tables of instances that end after the first row, or matrices of the instance before",
    here="what one mesh gives, many instances give",
    tolerance=0.003,
    source="share of pixels; coordinates that round differently at edges",
)
def twelve_hundred_instances(bench: Bench) -> Outcome:
    rng, small = np.random.default_rng(9), box((0.09, 0.16, 0.06))
    matrices = np.tile(np.eye(4), (1200, 1, 1))
    matrices[:, :3, 3] = np.stack(np.meshgrid(np.arange(40) - 19.5, np.arange(30) - 14.5, [0.0]), -1).reshape(-1, 3) / 4
    for i, q in enumerate(rng.normal(size=(1200, 4))):
        matrices[i, :3, :3] = mat3_from_quat(q)
    posed = [small.positions @ m[:3, :3].T + m[:3, 3] for m in matrices]
    merged = Primitive(
        np.concatenate(posed).astype(np.float32), np.concatenate([small.triangles + 24 * i for i in range(1200)]),
        normals=np.concatenate([small.normals @ m[:3, :3].T for m in matrices]).astype(np.float32),
    )  # fmt: skip
    images = []
    for instanced, moves in ((False, False), (True, False), (True, True)):
        b = SceneBuilder()
        material = lambert(b, 0.6)
        fields = {"instances": matrices} if instanced else {}
        node = b.node(mesh=b.mesh(dataclasses.replace(small if instanced else merged, material=material)), **fields)
        if moves:  # later: each instance is a tree's own
            b.animate(node, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
        b.node(mesh=b.mesh(quad(9.0, 9.0, material=material)), translation=(0.0, 0.0, -1.0))
        b.light(translation=(2.0, 3.0, 6.0), intensity=60.0)
        b.camera(translation=(0.0, 0.0, 9.0), yfov=0.85, znear=0.5)
        scene, size = b.build(), {"width": 96, "height": 72}
        shot = bench.shots(scene, extra=("normal",), columns=("direct",), shadow_size=256, **size)[0]
        traced = bench.traced(scene, spp=1, bounces=1, **size)
        images.append({name: shot[name] for name in ("position", "normal", "direct")} | {"traced": traced["direct"]})
    errors = [
        (np.abs(there[name] - images[0][name]).max(axis=-1) > 1e-3).mean() for there in images[1:] for name in there
    ]
    return field("one mesh", [*errors, 1.0 - float(images[0]["traced"].mean() > 0.1)])


@case(
    "sight-of-a-moving-room",
    description="a room with 18 kinds of surfaces, a box that slides and a camera that walks: share of pixels whose "
    "exact visibility differs from that of the posed triangles in float64",
    elsewhere="rays to where the point is now, triangles of the pose of now, a surface that hides itself",
    here="a ray from the previous camera to the point's previous place through the previous pose",
    tolerance=0.01,
    source="points within the rounding of an edge",
)
def sight_of_a_moving_room(bench: Bench) -> Outcome:
    scene = _sliding_room()
    opaque = tuple(dataclasses.replace(m, alpha_mode="OPAQUE") for m in scene.materials)
    scene = dataclasses.replace(scene, materials=opaque)
    own = {"width": 64, "height": 36, "fps": 1.0, "columns": ("position",), "reprojection": "motion"}
    settings, extra = bench._settings(own), ("prev_visibility", "prev_position")
    with GpuOwner(bench.gpu) as owner:
        source = owner.open_source(AnimatedScene(scene), settings, extra=extra)
        source.advance(0)
        source.advance(1)
        bits = source.read("prev_visibility")[..., 0]
        position, prev_position = source.read("position"), source.read("prev_position")
        now, (before, then, _) = source.renderer.frame.view, source.renderer.frame.before
    corners, one_sided = _posed_triangles(scene, before)
    expected = visibility(
        reprojection(now, then, 64, 36), position, prev_position,
        PreviousSurfaces(corners - then.position, one_sided), footprint=pixel_footprint(then, (64, 36)),
        threshold=settings.metrics.threshold("position"), slack=1e-4,
    )  # fmt: skip
    kinds = np.unique(expected & ~np.uint32(Visibility.MOVED)).size
    return field("the same bits", [(bits != expected).mean(), float(kinds < 3)])


def _posed_triangles(scene: Scene, state: FrameState) -> tuple[Array, Array]:
    """Corners (T, 3, 3), counter-clockwise from outside, and whether the back is not drawn (T,)."""
    corners, one_sided = [], []
    for node in map(int, scene.mesh_nodes):
        copies = scene.nodes.instances.get(node)
        for primitive in scene.meshes[scene.nodes.mesh[node]].primitives:
            for i in [None] if copies is None else range(len(copies)):
                posed = pose_vertices(scene, state, node, primitive, i)[primitive.triangles]
                mirrored = scene.nodes.skin[node] < 0 and np.linalg.det(state.world[node][:3, :3]) < 0
                corners.append(posed[:, ::-1] if mirrored else posed)
                double = primitive.material >= 0 and scene.materials[primitive.material].double_sided
                one_sided.append(np.full(len(posed), not double))
    return np.concatenate(corners), np.concatenate(one_sided)


@case(
    "light-that-moves",
    description="a room in which only the lamp moves, exact visibility: visible points that became brighter and darker "
    "against the pixels whose direct light changed, and the counts of black, lit and clipped pixels",
    elsewhere="the light before is taken at another point, or with the lamp of now",
    here="nothing else moves, so the light before is that of the pixel before",
    tolerance=0.01,
    source="share of pixels whose change is within rounding of the threshold",
)
def light_that_moves(bench: Bench) -> Outcome:
    scene = _sliding_room()
    lamp = int(scene.light_nodes[0])
    still = [dataclasses.replace(c, values=np.repeat(c.values[:1], 2, axis=0)) for c in scene.channels]
    channels = tuple(a if a.index == lamp else b for a, b in zip(scene.channels, still, strict=True))
    scene = dataclasses.replace(scene, channels=channels)
    images: list[dict[str, Array]] = []

    def look(pair) -> None:
        names = ("direct", "position", "color")
        images.append({n: pair.read(n).astype(np.float64) for n in names} | {"mask": pair.mask})
        images.append({n: pair.read(n, previous=True).astype(np.float64) for n in names})

    own = {"width": 64, "height": 36, "fps": 1.0, "reprojection": "motion", "exact": True, "shadow_size": 128,
           "exposure": 2.0, "thresholds": {"direct": 0.02},
           "columns": ("frustum", "position", "normal", "direct", "color")}  # fmt: skip
    settings = bench._settings(own)
    run = evaluate_scene(scene, settings, Observers(on_pair=look, channels=("color",)), camera=choose_camera(scene))
    now, then = images
    change = 2.0 * (now["direct"] - then["direct"])[..., :3]
    discarded, rise = np.linalg.norm(change, axis=-1) > 0.02, change @ [0.2126, 0.7152, 0.0722]
    (row,), pixels = run.frames, 64 * 36
    counts = {"direct": discarded, "brightened": discarded & (rise > 0), "darkened": discarded & (rise < 0)}
    errors = [(row[name] - there.sum()) / pixels for name, there in counts.items()]
    errors += [float(not 100 < there.sum() < pixels) for there in counts.values()]
    seen = run.summary["brightness"]
    top, surface = now["color"][..., :3].max(axis=-1), now["position"][..., 3] > 0
    dark = top < 0.5 / 255
    there = {"pixels": dark.size, "black": dark.sum(), "lit": (surface & ~dark).sum(), "noisy": 0, "behind": 0}
    there["clipped"] = (surface & (top >= 1 - 1e-4)).sum()
    errors += [(seen[name] - value) / pixels for name, value in there.items()]
    errors += [float(seen["frames"] != 1), *(float(not there[name]) for name in ("black", "clipped"))]
    return field("as the pixels", errors)


@case(
    "sky-behind-a-room",
    description="a sky image that is linear in the direction, seen by turned cameras, wide, narrow and parallel: "
    "color of its pixels, rasterized and path-traced, against 1 + a . d",
    elsewhere="rows from the bottom, a column half a turn away, the direction at the corner of a pixel",
    here="the direction through each pixel's center",
    tolerance=0.01,
    source="bilinear texels of 5.6 degrees, half floats",
)
def sky_behind_a_room(bench: Bench) -> Outcome:
    slope, errors = np.array([[0.3, 0.1, -0.2], [0.2, -0.4, 0.1], [-0.1, 0.2, 0.3]]), []
    radiance = 0.4 * (1.0 + directions(32) @ slope)
    with sky_file(radiance) as path:
        for rotation, lens in (
            (turn((1.0, 2.0, 0.3), 100.0), {"yfov": 1.4}), (turn((0.2, 1.0, -0.5), -140.0), {"yfov": 0.3}),
            (turn_x(40.0), {"kind": "orthographic", "xmag": 3.0, "ymag": 2.0, "zfar": 30.0}),
        ):  # fmt: skip
            b = SceneBuilder()
            eye = b.node(rotation=rotation)
            tiny = quad(0.01, 0.01, material=lambert(b))
            b.node(eye, mesh=b.mesh(tiny), translation=(0.0, 0.0, -2.0))
            b.camera(eye, znear=0.1, **lens)
            own = {"environment": path, "width": 30, "height": 20, "columns": ("direct", "color")}
            scene = b.build()
            shot = bench.shots(scene, **own)[0]
            traced = bench.shots(scene, light="path-traced", indirect="auto", spp=1, bounces=1, **own)[0]
            parallel = "kind" in lens
            local = rays((30, 20), Camera(yfov=1.0 if parallel else lens["yfov"]))
            local = np.broadcast_to([0.0, 0.0, -1.0], local.shape) if parallel else local
            d = local @ shot.view.world_from_view.T
            seen = 0.4 * (1.0 + d / np.linalg.norm(d, axis=-1, keepdims=True) @ slope)
            sky = ~shot.surface
            for frame in (shot, traced):
                errors.append(worst(frame["color"][..., :3][sky] - srgb_encode(np.clip(seen, 0.0, 1.0))[sky]))
    return field("1 + a . d", errors)


@case(
    "light-of-a-textured-emitter",
    description="two plates with 15 luminous texels, turned and scaled, above a wall: path-traced radiance at five "
    "points against the sum over their texels",
    elsewhere="texels chosen by number and not by power, an area before its scale, the light of the back",
    here="triangles by power, texels by emission, areas after the transform",
    tolerance=0.03,
    source="relative; 1,024 samples",
)
def light_of_a_textured_emitter(bench: Bench) -> Outcome:
    rng = np.random.default_rng(12)
    codes = rng.integers(30, 256, (3, 5, 3), dtype=np.uint8)
    texels = np.concatenate([codes, np.full((3, 5, 1), 255, np.uint8)], axis=-1)
    emission = srgb_decode(codes / 255.0) * (8.0, 6.0, 4.0)
    places = (
        ((-1.0, 0.4, 2.0), turn_y(160.0), (0.8, 0.5, 1.0)),
        ((1.2, -0.3, 3.0), turn((1, 0, 0.2), 200.0), (1.1, 0.9, 1.0)),
    )
    points = np.array([(0.0, 0.0), (1.0, 0.5), (-1.0, 0.7), (0.4, -1.0), (-1.4, -0.6)])
    u, v = np.meshgrid((np.arange(50) + 0.5) / 50, (np.arange(30) + 0.5) / 30)
    radiance = emission[(3 * v).astype(int), (5 * u).astype(int)].reshape(-1, 3)
    expected = np.zeros((5, 3))
    for place, rotation, scale in places:
        matrix = mat3_from_quat(np.array(rotation))
        on_it = np.stack([(2 * u - 1) * scale[0], (1 - 2 * v) * scale[1], 0 * u], -1).reshape(-1, 3) @ matrix.T + place
        way = on_it - np.concatenate([points, np.zeros((5, 1))], axis=1)[:, None]
        d2 = (way**2).sum(axis=-1)
        gain = np.maximum(way[..., 2], 0) * np.maximum(-way @ matrix[:, 2], 0) / d2**2
        expected += 0.5 / np.pi * gain @ radiance * 4 * scale[0] * scale[1] / len(on_it)
    errors = []
    for point, radiance in zip(points, expected, strict=True):
        b = SceneBuilder()
        glow = b.material(base_color=(0, 0, 0, 1), metallic=0.0, specular=0.0, emissive=(8.0, 6.0, 4.0),
                          emissive_texture=Texture(0, NEAREST))  # fmt: skip
        plate = b.mesh(_mapped(quad(1.0, 1.0, material=glow)))
        for place, rotation, scale in places:
            b.node(mesh=plate, translation=place, rotation=rotation, scale=scale)
        b.node(mesh=b.mesh(quad(20.0, 20.0, material=lambert(b, 0.5))))
        b.camera(translation=(*point, 0.5), kind="orthographic", xmag=0.01, ymag=0.01, znear=0.1, zfar=5.0)
        image = Image("texels", (5, 3), lambda: texels)
        scene = dataclasses.replace(b.build(), images=(image,))
        traced = bench.traced(scene, spp=256, bounces=1, width=4, height=4, pattern="independent")
        errors += [*(traced["direct"][..., :3].mean(axis=(0, 1)) / radiance - 1.0)]
    return field("the sum over texels", errors)


@case(
    "occlusion-and-metered-exposure",
    description="an occlusion texture of strength 0.7 and 1, a texel per pixel: its channel; a wall in the sun: the "
    "metered exposure",
    elsewhere="the strength multiplies the texel, or the exposure is of another size or unit",
    here="1 + strength (texel - 1); 0.18 over the radiance, four digits",
    tolerance=1e-3,
    source="half floats, and four digits",
)
def occlusion_and_metered_exposure(bench: Bench) -> Outcome:
    images, errors = _texels(), []
    for strength in (1.0, 0.7):
        b = SceneBuilder()
        wall = b.material(occlusion_texture=Texture(3, NEAREST), occlusion_strength=strength, metallic=0.0,
                          specular=0.0, base_color=(0.5, 0.5, 0.5, 1.0))  # fmt: skip
        b.node(mesh=b.mesh(_mapped(quad(2.5, 1.5, material=wall))), translation=(0.0, 0.0, -3.0))
        b.light(kind="directional", intensity=2.0, rotation=turn_y(30.0))
        b.camera(kind="orthographic", xmag=2.5, ymag=1.5, znear=0.5, zfar=9.0)
        scene = dataclasses.replace(b.build(), images=images)
        frame, _ = bench.frame(scene, extra=("material",), size=(5, 3))
        expected = 1.0 + strength * (images[3].decode()[..., 0] / 255.0 - 1.0)
        errors.append(worst(frame["material"][..., 2] - expected))
    settings = bench._settings({"light_unit": "candela", "environment": "none", "exposure": "auto"})
    with tempfile.TemporaryDirectory() as folder, _cache_in(folder):
        exposure, _ = exposure_of(scene, settings)
    radiance = 0.5 / np.pi * 2.0 * np.cos(np.radians(30.0))
    return field("closed forms", [*errors, exposure * radiance / 0.18 - 1.0])


@contextmanager
def _cache_in(folder: str) -> Iterator[None]:
    """Nothing is read from the user's cache, nothing written into it."""
    before = os.environ.get("TAUBENCH_CACHE")
    os.environ["TAUBENCH_CACHE"] = folder
    try:
        yield
    finally:
        if before is None:
            del os.environ["TAUBENCH_CACHE"]
        else:
            os.environ["TAUBENCH_CACHE"] = before
