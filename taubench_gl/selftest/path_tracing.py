"""Cases: path-traced light with closed forms, and rays between surfaces that are near, far, thin or scaled."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from taubench_gl.metrics.lighting import albedo_table
from taubench_gl.scene.builder import SceneBuilder, box, quad, sphere, turn_x, turn_y
from taubench_gl.scene.model import MorphTarget, Primitive, Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, count, field, scalar
from taubench_gl.selftest.direct import lambert
from taubench_gl.selftest.geometry import one_metre_per_pixel
from taubench_gl.selftest.scenes import busy_room

Array = np.ndarray
RANDOM = "relative; noise of this many samples"
FLOAT = "relative; float32: 64 ulps"


def _matte(b: SceneBuilder, albedo: float = 0.5, emission: float = 0.0) -> int:
    """A Lambert surface that emits on both sides."""
    return lambert(b, albedo, emissive=(emission,) * 3, double_sided=True)


def _middle(image: Array, half: int = 4) -> Array:
    """The pixels around the center of an image (h, w, n), first channel."""
    h, w = image.shape[:2]
    return image[h // 2 - half : h // 2 + half, w // 2 - half : w // 2 + half, 0]


def _floor(b: SceneBuilder, bench: Bench, *, albedo: float = 0.5, half: float = 1000.0, cells=(1, 1), z=-10.0) -> None:
    """A wide wall in the plane ``z``, facing a camera that looks along -Z, 1 m a pixel."""
    b.node(mesh=b.mesh(quad(half, half, cells=cells, material=_matte(b, albedo))), translation=(0.0, 0.0, z))
    one_metre_per_pixel(b, bench)


@case("furnace-diffuse", tolerance=1e-5, source=FLOAT)
def furnace_diffuse(bench: Bench) -> Outcome:
    """A diffuse sphere of albedo 0.75 in a uniform sky of radiance 1: direct radiance, largest error.

    A factor of pi, or a pdf without its cosine, makes the sphere brighter or darker than the sky allows.
    """
    b = SceneBuilder()
    primitive = sphere(20.0)
    b.node(mesh=b.mesh(_with(primitive, _matte(b, 0.75))), translation=(0.0, 0.0, -100.0))
    one_metre_per_pixel(b, bench)
    frame = bench.traced(b.build(), extra=("position",), environment=(1.0, 1.0, 1.0), spp=4, bounces=1)
    shown = frame["direct"][frame["position"][..., 3] > 0][:, 0]
    return Outcome(0.75, float(shown.mean()), float(np.abs(shown - 0.75).max()))


@case("furnace-glossy", tolerance=5e-3, source=RANDOM)
def furnace_glossy(bench: Bench) -> Outcome:
    """A white metal sphere of roughness 0.5 in a uniform sky: mean direct radiance against its directional albedo.

    The Jacobian of the half vector is left out, or the masking term of one direction only is used.
    """
    b = SceneBuilder()
    metal = b.material(metallic=1.0, roughness=0.5)
    b.node(mesh=b.mesh(_with(quad(40, 40), metal)), translation=(0.0, 0.0, -10.0), rotation=turn_y(60.0))
    one_metre_per_pixel(b, bench)
    frame = bench.traced(b.build(), environment=(1.0, 1.0, 1.0), spp=1024, bounces=1)
    expected = _albedo(0.5, 0.5)
    return scalar(expected, float(_middle(frame["direct"]).mean()), relative=True)


def _albedo(roughness: float, n_v: float) -> float:
    """Directional albedo of a white metal."""
    table = albedo_table().astype(np.float64)
    at = np.linspace(0.0, 1.0, len(table))
    return float(RegularGridInterpolator((at, at), table[..., 0] + table[..., 1])((roughness, n_v)))


@case("closed-box", tolerance=2e-2, source=RANDOM)
def closed_box(bench: Bench) -> Outcome:
    """Inside a closed box of albedo 0.5 whose walls emit 1: direct and indirect radiance after 6 bounces.

    Emission that both the light sample and the ray find is counted twice, or not at all.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(_with(box((4, 4, 4), inside=True), _matte(b, 0.5, 1.0))))
    b.camera(yfov=np.radians(60.0))
    frame = bench.traced(b.build(), spp=64, bounces=6)
    expected = [0.5, sum(0.5**k for k in range(2, 7))]
    return _means(frame, expected)


@case("mirror-box", tolerance=2e-2, source=RANDOM)
def mirror_box(bench: Bench) -> Outcome:
    """Inside a closed box of perfect mirrors that emit 1: direct radiance, and indirect after 5 bounces.

    Narrow lobes lose the reflected emitter to a clamped pdf, or to roulette without its weight.
    """
    b = SceneBuilder()
    mirror = b.material(metallic=1.0, roughness=0.0, emissive=(1.0, 1.0, 1.0))
    b.node(mesh=b.mesh(_with(box((4, 4, 4), inside=True), mirror)), rotation=turn_y(17.0))
    b.camera(yfov=np.radians(50.0))
    frame = bench.traced(b.build(), spp=16, bounces=5)
    return _means(frame, [1.0, 4.0])


@case("parallel-planes", tolerance=1e-2, source=RANDOM)
def parallel_planes(bench: Bench) -> Outcome:
    """Two planes of 2 km, 1 m apart, albedo 0.5, one emits 1: radiance of the other, direct and indirect.

    A light sample on a huge emitter is far away and black: the picture is noise.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(1000, 1000, material=_matte(b, 0.5))), translation=(0.0, 0.0, -0.5))
    emitter = _with(quad(1000, 1000), _matte(b, 0.5, 1.0))
    b.node(mesh=b.mesh(emitter), translation=(0.0, 0.0, 0.5), rotation=turn_y(180.0))
    b.camera(yfov=np.radians(30.0))
    frame = bench.traced(b.build(), spp=64, bounces=7)
    return _means(frame, [0.5, 0.5**3 + 0.5**5 + 0.5**7])


def form_factor(a: float, b: float, h: float) -> float:
    """Form factor from a small surface to a parallel rectangle a x b, at distance ``h`` above one of its corners.

    Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-3.
    """
    x, y = a / h, b / h
    p, q = np.hypot(1.0, x), np.hypot(1.0, y)
    return float((x / p * np.arctan(y / p) + y / q * np.arctan(x / q)) / (2.0 * np.pi))


@case("form-factor", tolerance=1e-2, source=RANDOM)
def form_factor_of_a_square(bench: Bench) -> Outcome:
    """A square emitter of 4 m, 3 m above a diffuse wall: radiance below its center against the form factor.

    The cosine at the emitter, or its square distance, is left out of the pdf.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(50, 50, material=_matte(b, 0.8))), translation=(0.0, 0.0, -10.0))
    b.node(mesh=b.mesh(quad(2, 2, material=_matte(b, 0.0, 5.0))), translation=(0.0, 0.0, -7.0))
    frame = _below(b, bench, 8.0, spp=256, bounces=1)
    expected = 0.8 * 5.0 * 4.0 * form_factor(2.0, 2.0, 3.0)
    return scalar(expected, float(frame["direct"][..., 0].mean()), relative=True)


@case(
    "sphere-light",
    tolerance=1e-2,
    source="relative; the sphere's triangles have 0.4 % less than its cross-section, and sampling noise",
)
def sphere_light(bench: Bench) -> Outcome:
    """A luminous sphere of radius 1 m, 5 m above a wall: radiance below it against 1/25 of its own, albedo 0.5.

    An emitter's triangles are sampled by number: small ones at the poles get too much of the light.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(50, 50, material=_matte(b, 0.5))), translation=(0.0, 0.0, -10.0))
    b.node(mesh=b.mesh(_with(sphere(1.0, 24), _matte(b, 0.0, 10.0))), translation=(0.0, 0.0, -5.0))
    frame = _below(b, bench, 6.5, spp=512, bounces=1)
    return scalar(0.5 * 10.0 / 25.0, float(frame["direct"][..., 0].mean()), relative=True)


def between_boards(h: float, gap: float, half: float) -> float:
    """Irradiance below the center of a white square board, over the intensity of a lamp ``h`` from it, ``gap`` above.

    The lamp shines on the board alone.  Gauss-Legendre in the inverse hyperbolic sine of each coordinate.
    """
    nodes, weights = np.polynomial.legendre.leggauss(128)
    end = np.arcsinh(half / h)
    x, w = h * np.sinh(end * nodes), weights * end * h * np.cosh(end * nodes)
    r2 = x[:, None] ** 2 + x**2
    return float(w @ (h / (r2 + h * h) ** 1.5 * gap**2 / (r2 + gap**2) ** 2) @ w / np.pi)


@case("lamp-at-a-board", tolerance=1e-2, source=RANDOM)
def lamp_at_a_board(bench: Bench) -> Outcome:
    """A lamp 1 cm below a board 3 m above a wall: indirect radiance below it, bidirectional, against an integral.

    Paths from the camera find the bright spot behind the lamp once in 100,000 samples.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(50, 50, material=_matte(b, 0.5))), translation=(0.0, 0.0, -10.0))
    b.node(mesh=b.mesh(quad(2, 2, material=_matte(b, 0.8))), translation=(0.0, 0.0, -7.0))
    b.light(translation=(0.0, 0.0, -7.01), intensity=5.0)
    b.camera(kind="orthographic", xmag=0.01, ymag=0.01, znear=8.0, zfar=50.0)
    both = bench.traced(b.build(), spp=128, bounces=2, bidirectional=True)["indirect"]
    expected = 5.0 * 0.5 / np.pi * 0.8 * between_boards(0.01, 3.0, 2.0)
    return scalar(expected, float(both[..., 0].mean()), relative=True)


@case(
    "masked-leaf{0}",
    source="exact: edges of the shadow lie on pixel borders",
    each=(("", "rigid", False), ("-with-a-morph", "morphed", True)),
)
def masked(bench: Bench, name: str, kind: str, posed: bool) -> Outcome:
    """A {1} leaf above a wall, its left half cut out by alpha, below a distant light: shadowed pixels.

    Rays do not test alpha, or a posed mesh loses its flag of alpha, and the whole leaf casts a shadow.
    """
    b = SceneBuilder()
    _floor(b, bench)
    leaf = quad(8, 8, cells=(2, 1), material=b.material(alpha_mode="MASK", metallic=0.0, double_sided=True))
    # The alpha of a vertex is interpolated: the columns of the middle are doubled, so that it jumps there.
    positions = leaf.positions[leaf.triangles.reshape(-1)]
    left = positions.reshape(-1, 3, 3)[:, :, 0].mean(axis=1) < 0
    colors = np.ones((len(positions), 4), np.float32)
    colors[np.repeat(left, 3), 3] = 0.0
    triangles = np.arange(len(positions), dtype=np.uint32).reshape(-1, 3)
    targets = (MorphTarget(np.ones_like(positions)),) if posed else ()
    whole = Primitive(positions, triangles, leaf.material, colors=colors, targets=targets)
    b.node(mesh=b.mesh(whole, weights=(0.0,) if posed else ()), translation=(0.0, 0.0, 5.0))
    b.light(kind="directional", intensity=1.0)
    return count(8 * 16, _shadowed(bench, b))


@case("traced-far-from-origin", source="exact: dyadic numbers, so float64 holds every difference")
def traced_far_from_origin(bench: Bench) -> Outcome:
    """A room with lamps at 1e6 m: largest difference of direct and indirect radiance from the room at the origin.

    Float32 world positions are 6 cm apart there, so rays start inside walls.
    """
    near, far = (bench.traced(busy_room((o, -o, o), lamps=2), spp=2, bounces=3) for o in (0.0, 2.0**20))
    off = [far[name] - near[name] for name in ("direct", "indirect")]
    return field("no difference", np.concatenate(off))


@case(
    "traced-at-{0}",
    tolerance=1e-3,
    source="relative, mean over the image; few rays change sides of an edge",
    each=(("1e-3", 2.0**-10), ("1e4", 2.0**13)),
)
def scaled_room(bench: Bench, name: str, scale: float) -> Outcome:
    """A room at scale {1:g} with lamps that are {1:g}^2 as strong: radiance, relative to scale 1.

    A fixed distance of rays from their surface is larger than the room, or smaller than its rounding.
    """
    sums = []
    for s in (1.0, scale):
        frame = bench.traced(_lamp_in_a_box(s), spp=2, bounces=3)
        sums.append([float(frame[n][..., :3].mean(dtype=np.float64)) for n in ("direct", "indirect")])
    off = max(abs(b / a - 1.0) for a, b in zip(*sums, strict=True))
    return Outcome(_text(sums[0]), _text(sums[1]), off)


@case("edge-without-leak", source="exact: a count")
def edge_without_leak(bench: Bench) -> Outcome:
    """A closed box of 12 triangles in a bright sky, seen from inside: pixels with any light.

    A ray to the common edge of two triangles passes between them.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(_with(box((3, 2, 4), inside=True), _matte(b, 0.9))), rotation=turn_y(33.0))
    b.camera(yfov=np.radians(80.0), rotation=turn_x(-20.0))
    frame = bench.traced(b.build(), environment=(1e6, 1e6, 1e6), spp=16, bounces=3)
    return count(0, int((frame["direct"][..., 0] + frame["indirect"][..., 0] > 0).sum()))


@case("grazing-light", source="exact count; values within 1e-4 of the closed form are equal")
def grazing_light(bench: Bench) -> Outcome:
    """A wall of 5,000 triangles under a sun 0.1 degrees above it: pixels that are not lit as the cosine says.

    Shadow rays start below the surface that they leave: the wall shadows itself in spots.
    """
    b = SceneBuilder()
    _floor(b, bench, half=max(60.0, 0.625 * max(bench.size)), cells=(50, 50))
    b.light(kind="directional", intensity=1.0, rotation=turn_y(89.9))
    direct = bench.traced(b.build(), spp=1, bounces=1)["direct"][..., 0]
    expected = 0.5 / np.pi * np.cos(np.radians(89.9))
    return count(0, int((np.abs(direct / expected - 1.0) > 1e-4).sum()))


@case("narrow-gap", source="exact: edges of the shadow lie on pixel borders")
def narrow_gap(bench: Bench) -> Outcome:
    """A board 1e-4 of the camera's distance above a wall, seen through its culled back: shadowed pixels.

    The distance that keeps rays off their own surface jumps over the gap.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(5, 5, material=_matte(b))), translation=(0.0, 0.0, -10.0))
    # Its face is turned away from the camera, which therefore does not draw it; rays meet both sides.
    board = quad(8 / 128, 8 / 128, material=b.material(metallic=0.0))
    b.node(mesh=b.mesh(board), translation=(0.0, 0.0, -10.0 + 1e-3), rotation=turn_y(180.0))
    b.camera(kind="orthographic", xmag=bench.size[0] / 256, ymag=bench.size[1] / 256, zfar=1000.0)
    b.light(kind="directional", intensity=1.0)
    return count(256, _shadowed(bench, b))


@case(
    "traced-{0}",
    source="exact: edges of the shadow lie on pixel borders",
    each=(("mirrored", -1.0, 256), ("zero-scale", 0.0, 0)),
)
def mirrored(bench: Bench, name: str, factor: float, shadowed: int) -> Outcome:
    """A moving board with scale ({1:g}, 1, 1) before a distant light: shadowed pixels of a wall.

    The inverse of the instance's matrix is singular or NaN, or its handedness turns hits into misses.
    """
    scale = (factor, 1.0, 1.0)
    b = SceneBuilder()
    _floor(b, bench)
    board = b.node(mesh=b.mesh(quad(8, 8, material=_matte(b))), scale=scale)
    b.animate(board, "translation", [0.0, 1.0], [(0.0, 0.0, 5.0), (8.0, 0.0, 5.0)])
    b.light(kind="directional", intensity=1.0)
    return count(shadowed, _shadowed(bench, b))


@case("traced-light-on-surface", source="exact: a count")
def traced_light_on_surface(bench: Bench) -> Outcome:
    """A point light exactly on a wall: pixels of radiance that are NaN or Inf, or of a facing wall that are dark.

    The shadow ray has length 0, or ends behind the surface that the light lies on.
    """
    b = SceneBuilder()
    wall = quad(40, 40, material=_matte(b))
    b.node(mesh=b.mesh(wall), translation=(0.0, 0.0, -10.0))
    b.node(mesh=b.mesh(wall), translation=(0.0, 0.0, 10.0), rotation=turn_y(180.0))
    b.light(translation=(0.5, 0.5, 10.0), intensity=1e4)
    one_metre_per_pixel(b, bench)
    frame = bench.traced(b.build(), spp=2, bounces=3)
    total = frame["direct"][..., 0] + frame["indirect"][..., 0]
    wrong = ~np.isfinite(total) | (_centered(frame["direct"][..., 0], 20) <= 0).any()
    return count(0, int(wrong.sum()))


@case("slivers", source="exact count; values within 1e-4 of the closed form are equal")
def slivers(bench: Bench) -> Outcome:
    """A wall of triangles 20,000 times as long as wide, in sunlight: pixels that are not lit as the cosine says.

    The determinant of a sliver underflows: rays pass, or hits are NaN.
    """
    b = SceneBuilder()
    _floor(b, bench, half=100.0, cells=(20000, 1))
    b.light(kind="directional", intensity=1.0, rotation=turn_y(60.0))
    frame = bench.traced(b.build(), spp=2, bounces=2)
    expected = 0.5 / np.pi * 0.5
    wrong = np.abs(frame["direct"][..., 0] / expected - 1.0) > 1e-4
    return count(0, int((wrong | (frame["indirect"][..., 0] != 0)).sum()))


@case("still-traced-light", source="exact: the same arithmetic is done twice")
def still_traced_light(bench: Bench) -> Outcome:
    """A still camera and room, lamps and a luminous ceiling, path-traced: pixels with a reason bit.

    Numbers that differ from frame to frame flicker, and noise is counted as change.
    """
    columns = ("direct", "indirect", "color", "position", "normal")
    options = {"light": "path-traced", "indirect": "auto", "spp": 2, "bounces": 3, "fps": 2.0, "camera": 0}
    run = bench.evaluate(busy_room(still=True, lamps=2), columns=columns, **options)
    marked = sum(row[name] for row in run.frames for name in (*columns, "lit", "shadowed", "invalid"))
    return count(0, marked if len(run.frames) == 2 else -1)


def _with(primitive: Primitive, material: int) -> Primitive:
    return Primitive(primitive.positions, primitive.triangles, material, normals=primitive.normals)


def _lamp_in_a_box(scale: float) -> Scene:
    """A room with a moving box and a lamp, all of it times ``scale``; the lamp scale^2 as strong."""
    b = SceneBuilder()
    root = b.node(scale=(scale,) * 3)
    b.node(root, mesh=b.mesh(_with(box((4, 3, 4), inside=True), _matte(b))))
    moving = b.node(root, mesh=b.mesh(_with(box((1, 1, 1)), _matte(b))))
    b.animate(moving, "translation", [0.0, 1.0], [(-1.5, -2.0, -1.0), (1.5, -2.0, -1.0)])
    b.light(root, translation=(1.0, 1.5, 0.5), intensity=30.0 * scale**2)
    b.camera(root, translation=(0.0, 0.0, 3.0), yfov=np.radians(70.0), znear=0.0625 * scale)
    return b.build()


def _centered(image: Array, half: int) -> Array:
    h, w = image.shape
    return image[h // 2 - half : h // 2 + half, w // 2 - half : w // 2 + half]


def _text(values: list[float]) -> str:
    return ", ".join(f"{v:.6g}" for v in values)


def _means(frame: dict[str, Array], expected: list[float]) -> Outcome:
    """The outcome of mean direct and indirect radiance, relative."""
    measured = [float(frame[name][..., 0].mean()) for name in ("direct", "indirect")]
    off = max(abs(m / e - 1.0) for m, e in zip(measured, expected, strict=True))
    return Outcome(_text(expected), _text(measured), off)


def _shadowed(bench: Bench, b: SceneBuilder) -> int:
    """Pixels without direct light."""
    return int((bench.traced(b.build(), spp=1, bounces=1)["direct"][..., 0] == 0).sum())


def _below(b: SceneBuilder, bench: Bench, znear: float, **settings: Any) -> dict[str, Array]:
    """Radiance of a point of a wall 10 m away, by name; what is nearer than ``znear`` meters is not seen."""
    b.camera(kind="orthographic", xmag=0.01, ymag=0.01, znear=znear, zfar=50.0)
    return bench.traced(b.build(), **settings)
