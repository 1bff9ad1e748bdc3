"""Cases: punctual lights and the BRDF against closed forms, without shadows."""

from __future__ import annotations

import dataclasses

import numpy as np

from taubench_gl import math3d
from taubench_gl.metrics.lighting import SurfaceMaterial, evaluate_brdf
from taubench_gl.scene.builder import SceneBuilder, quad, turn, turn_x
from taubench_gl.selftest.bench import Bench, Shot
from taubench_gl.selftest.case import Outcome, case, field, scalar, worst
from taubench_gl.selftest.geometry import one_metre_per_pixel

Array = np.ndarray
ALBEDO = 0.75
WALL_Z = -8.0
RADIANCE = "of the peak; float32: 80 ulps"
TILTED = turn((0.0, 1.0, 0.0), 25.0)
"""A light turned by this shines along -Z, turned towards -X."""


def lambert(b: SceneBuilder, albedo: float = ALBEDO, **fields) -> int:
    """A material that only scatters diffusely."""
    return b.material(base_color=(albedo, albedo, albedo, 1.0), metallic=0.0, roughness=1.0, specular=0.0, **fields)


def lambert_wall(bench: Bench, albedo: float = ALBEDO, **fields) -> SceneBuilder:
    """A Lambert wall that fills the image, 1 m per pixel; ``fields`` of its material."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(*bench.size, material=lambert(b, albedo, **fields))), translation=(0.0, 0.0, WALL_Z))
    one_metre_per_pixel(b, bench)
    return b


def wall_shot(bench: Bench, *, settings: dict | None = None, height: float = 6.0, **light) -> tuple[Shot, Array]:
    """A Lambert wall, lit by one light ``height`` in front of it; and where the light is, (3,)."""
    b = lambert_wall(bench)
    place = np.array([2.25, -1.75, WALL_Z + height])
    b.light(translation=place, **light)
    return bench.shots(b.build(), shadow_lights=0, **(settings or {}))[0], place


def reflected(shot: Shot, place: Array) -> tuple[Array, Array, Array]:
    """Distance (h, w), unit vector to the light (h, w, 3), and radiance (h, w) of the wall by a lamp of 1 cd."""
    to_light = place - shot.points
    d = np.linalg.norm(to_light, axis=-1)
    return d, to_light / d[..., None], ALBEDO / np.pi * to_light[..., 2] / d**3


def off_peak(got: Array, expected: Array) -> Array:
    """Differences over the largest expected value."""
    return (got - expected) / expected.max()


@case("inverse-square", tolerance=1e-5, source=RADIANCE)
def inverse_square(bench: Bench) -> Outcome:
    """A wall 6 m from a lamp of 40 cd: radiance of every pixel against albedo I cos / (pi d^2).

    A factor pi or 4 pi too much, or a smoothed distance.
    """
    shot, place = wall_shot(bench, intensity=40.0)
    _, _, unit = reflected(shot, place)
    return field("albedo I cos / (pi d^2)", off_peak(shot.direct[..., 0], 40.0 * unit))


@case("range-window", tolerance=1e-5, source=RADIANCE)
def range_window(bench: Bench) -> Outcome:
    """A lamp with a range of 9 m, 6 m from a wall: radiance against 1 - (d / range)^4 over d^2.

    A hard cut at the range, or the window of another engine (squared, or of d^2).
    """
    shot, place = wall_shot(bench, intensity=40.0, range=9.0)
    d, _, unit = reflected(shot, place)
    window = np.clip(1.0 - (d / 9.0) ** 4, 0.0, 1.0)
    expected = 40.0 * unit * window
    return field("window^1", off_peak(shot.direct[..., 0], expected))


@case("spot-cone", tolerance=1e-5, source=RADIANCE)
def spot_cone(bench: Bench) -> Outcome:
    """A tilted spot, 15 to 35 degrees: radiance of every pixel against the squared linear falloff of the cosine.

    Falloff in the angle, a full cone angle where glTF has the half angle, or smoothstep.
    """
    inner, outer = np.radians(15.0), np.radians(35.0)
    spot = {"kind": "spot", "inner_cone": inner, "outer_cone": outer, "rotation": TILTED}
    shot, place = wall_shot(bench, intensity=40.0, **spot)
    _, to_light, unit = reflected(shot, place)
    cosine = -to_light @ _axis()
    share = np.clip((cosine - np.cos(outer)) / (np.cos(inner) - np.cos(outer)), 0.0, 1.0)
    expected = 40.0 * unit * share**2
    return field("share^2", off_peak(shot.direct[..., 0], expected))


@case("spot-cone-of-cycles", tolerance=1e-5, source=RADIANCE)
def spot_cone_of_cycles(bench: Bench) -> Outcome:
    """A tilted spot in watts: radiance against Cycles' cone, a smoothstep over the blend, and 683 lm/W.

    Blender's spots with glTF's falloff, and its watts taken for candela.
    """
    inner, outer = np.radians(14.0), np.radians(35.0)
    spot = {"kind": "spot", "inner_cone": inner, "outer_cone": outer, "rotation": TILTED}
    shot, place = wall_shot(bench, intensity=40.0 * 683.0, settings={"light_unit": "watt"}, **spot)
    _, to_light, unit = reflected(shot, place)
    cosine, blend = -to_light @ _axis(), 1.0 - 14.0 / 35.0
    share = np.clip((cosine - np.cos(outer)) / (blend * (1.0 - np.cos(outer))), 0.0, 1.0)
    return field("smoothstep", off_peak(shot.direct[..., 0], 40.0 * unit * share**2 * (3.0 - 2.0 * share)))


def _axis() -> Array:
    """Where a light turned by TILTED shines, (3,) unit."""
    return -math3d.mat3_from_quat(TILTED)[:, 2]


@case("directional-light", tolerance=1e-5, source=RADIANCE)
def directional_light(bench: Bench) -> Outcome:
    """A colored directional light, tilted by 25 degrees, on a wall: radiance against albedo E cos / pi per channel.

    The light's position or +Z instead of its -Z, or candela where KHR_lights_punctual has lux.
    """
    color = np.array([1.0, 0.5, 0.25])
    shot, _ = wall_shot(bench, kind="directional", intensity=3.0, color=tuple(color), rotation=TILTED)
    expected = ALBEDO / np.pi * 3.0 * np.cos(np.radians(25.0)) * color
    return field("albedo E cos / pi", (shot.direct - expected) / expected.max())


@case("light-nearer-than-1-mm", tolerance=1e-4, source="relative; float32 position of the foot")
def light_nearer_than_1_mm(bench: Bench) -> Outcome:
    """A lamp 1/4096 m in front of a wall: radiance at its foot against that of 1 mm.

    No lower limit: one pixel of 1.7e7 times the lamp's intensity flickers as the lamp moves.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(*bench.size, material=lambert(b))))
    one_metre_per_pixel(b, bench, translation=(0.0, 0.0, 1.0))
    foot = [0.5 if size % 2 == 0 else 0.0 for size in bench.size]
    b.light(translation=(*foot, 1 / 4096), intensity=1.0)
    shot = bench.shots(b.build(), shadow_lights=0)[0]
    return scalar(1e6 * ALBEDO / np.pi, shot.direct[..., 0].max(), relative=True)


@case("light-behind-the-triangle", source="exact: the light is multiplied by 0")
def light_behind_the_triangle(bench: Bench) -> Outcome:
    """A lamp behind a wall whose vertex normals lean towards it: largest radiance of its front.

    The factor n.l of the shading normal alone lights surfaces from behind.
    """
    b = SceneBuilder()
    wall = quad(*bench.size, material=lambert(b))
    leaning = np.tile(np.float32(math3d.normalize(np.array([0.9, 0.0, 0.1]))), (len(wall.positions), 1))
    b.node(mesh=b.mesh(dataclasses.replace(wall, normals=leaning)), translation=(0.0, 0.0, WALL_Z))
    one_metre_per_pixel(b, bench)
    b.light(translation=(60.0, 0.0, WALL_Z - 0.5), intensity=1e3)
    shot = bench.shots(b.build(), shadow_lights=0)[0]
    return field("0", shot.direct)


STRIPS = (
    {"metallic": 0.0, "roughness": 0.375},
    {"metallic": 1.0, "roughness": 0.625},
    {"metallic": 0.5, "roughness": 0.3125, "specular": 0.5},
    {"metallic": 0.0, "roughness": 0.1875, "specular": 1.0},
)
"""Materials of the strips of a floor, from left to right: exact in half floats."""


def _floor(bench: Bench, elevation: float, **light) -> tuple[Shot, list[tuple[Array, SurfaceMaterial]]]:
    """A floor of four strips seen at grazing angles against a sun ``elevation`` degrees high; pixels of each strip."""
    b = SceneBuilder()
    base = np.array([0.75, 0.5, 0.125])
    for i, fields in enumerate(STRIPS):
        strip = b.mesh(quad(2.0, 200.0, material=b.material(base_color=(*base, 1.0), **fields)))
        b.node(mesh=strip, translation=(4.0 * i - 6.0, 0.0, 0.0), rotation=turn_x(-90.0))
    b.light(kind="directional", rotation=_sun(elevation), **light)
    b.camera(translation=(0.0, 1.0, 0.0), yfov=np.radians(80.0), znear=0.05)
    shot = bench.shots(b.build(), shadow_lights=0, extra=("direct_diffuse", "direct_glossy"))[0]
    strip = (shot.points[..., 0] + 8.0) / 4.0
    index = np.where(np.abs(strip - np.round(strip)) > 0.01, np.floor(strip), -1)  # not the pixels of two strips
    out = []
    for i, fields in enumerate(STRIPS):
        material = SurfaceMaterial(base, fields["metallic"], fields["roughness"], fields.get("specular", 1.0))
        out.append((shot.surface & (index == i) & (np.abs(shot.points[..., 2]) < 60.0), material))
    return shot, out


def _sun(elevation: float) -> Array:
    """Turns -Z to where a sun in front of the camera shines: towards +Z and down."""
    return math3d.quat_multiply(turn((0.0, 1.0, 0.0), 180.0), turn_x(-elevation))


@case(
    "brdf-at-grazing-angles",
    tolerance=2e-4,
    source="relative to the peak of each strip and lobe; float32 in GGX's denominator near grazing angles",
)
def brdf_at_grazing_angles(bench: Bench) -> Outcome:
    """Floor strips (dielectric, metal, mixed, mirror) against a low sun: each lobe against the float64 BRDF.

    A Fresnel term that does not reach F90 = 1, a visibility term without height correlation, roughness^4.
    """
    errors = []
    for elevation in (4.0, 35.0):
        shot, strips = _floor(bench, elevation, intensity=2.0)
        v = math3d.normalize(-shot["position"][..., :3])
        n = np.broadcast_to([0.0, 1.0, 0.0], v.shape)
        sun = np.array([0.0, np.sin(np.radians(elevation)), -np.cos(np.radians(elevation))])
        for seen, material in strips:
            lobes = evaluate_brdf(material, n[seen], v[seen], np.broadcast_to(sun, v[seen].shape))
            for name, lobe in zip(("direct_diffuse", "direct_glossy"), lobes, strict=True):
                if lobe.max() > 0.0:
                    errors.append(worst(off_peak(shot[name][..., :3][seen], 2.0 * lobe)) if seen.any() else np.nan)
    return field("evaluate_brdf", errors)


@case("lobes-add-up", source="exact: one addition in float32")
def lobes_add_up(bench: Bench) -> Outcome:
    """A floor of four materials in low sunlight: direct radiance minus the sum of its diffuse and glossy lobes.

    Lobes of separate passes differ from their sum by rounding or by what only one of them has.
    """
    shot, _ = _floor(bench, 20.0, intensity=2.0)
    lobes = [shot[name][..., :3].astype(np.float32) for name in ("direct_diffuse", "direct_glossy")]
    off = shot.direct - (lobes[0] + lobes[1])
    return field("0", off if shot.direct.max() > 0.0 else np.nan)


@case("sky-on-white", tolerance=1e-6, source="relative; float32: 8 ulps")
def sky_on_white(bench: Bench) -> Outcome:
    """A white Lambert wall under a uniform sky of radiance 2: its radiance.

    Irradiance pi L that is not divided by pi, or a sky that is sampled with noise.
    """
    shot = bench.shots(lambert_wall(bench, 1.0).build(), environment=(2.0, 2.0, 2.0))[0]
    return field("2", 0.5 * shot.direct[shot.surface] - 1.0)


@case("forty-lights", tolerance=1e-5, source=RADIANCE)
def forty_lights(bench: Bench) -> Outcome:
    """40 lamps with ranges on a wall, culled by tiles with light error 0: radiance against the sum of all.

    A fixed number of lights per tile, or a sphere test that loses lights at tile corners.
    """
    b = lambert_wall(bench)
    places = [np.array([11.0 * (i % 8) - 38.5, 12.0 * (i // 8) - 24.0, WALL_Z + 2.0 + 0.1 * i]) for i in range(40)]
    for i, place in enumerate(places):
        b.light(translation=place, intensity=5.0 + i, range=14.0)
    shot = bench.shots(b.build(), shadow_lights=0, light_error=0.0)[0]
    expected = np.zeros(shot.surface.shape)
    for i, place in enumerate(places):
        d, _, unit = reflected(shot, place)
        expected += (5.0 + i) * unit * np.clip(1.0 - (d / 14.0) ** 4, 0.0, 1.0)
    return field("the sum of all", off_peak(shot.direct[..., 0], expected))
