"""Cases: indirect light against the energy of a closed box and the light of a wall, and its exposure."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from taubench_gl.scene.builder import IDENTITY, SceneBuilder, box, quad, turn, turn_x, turn_y
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, field, scalar
from taubench_gl.selftest.direct import lambert

Array = np.ndarray
ALBEDO = 0.5
FLUX = 4.0 * np.pi
"""Lumens of a lamp of 1 cd."""

SCREEN, SCREEN_ALBEDO = 3.0, 0.05
"""Where ``lamp_beside_a_wall`` has the screen that the wall lights, along x, and how little it reflects."""


LOOKS = [turn_y(90.0 * i) for i in range(4)] + [turn_x(90.0 * i) for i in (1, -1)]
"""Rotations of a camera towards each wall of a box."""


def _bounced(bench: Bench, lamps: int = 1, cone: float = 0.0, **settings) -> float:
    """Mean indirect irradiance of the walls of a closed box, 2 m along a side, around lamps of 1 cd together.

    ``cone``: half angle of spots instead of lamps, radians, with 2 pi (1 - cos) lumens.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((1.0, 1.0, 1.0), inside=True, material=lambert(b, ALBEDO))))
    lens = {"kind": "spot", "inner_cone": cone - 1e-3, "outer_cone": cone} if cone else {}
    for i in range(lamps):
        b.light(intensity=1.0 / lamps, translation=(0.01 * i, 0.0, 0.0), rotation=turn((1.0, 0.5, 0.2), 40.0), **lens)
    eye = b.camera(yfov=np.radians(90.0), znear=0.01)
    b.animate(eye, "rotation", np.arange(6.0), LOOKS, "STEP")
    options = {
        "columns": ("direct", "indirect"),
        "indirect_samples": 1500,
        "probes": 400,
        "indirect": "probes",
        "shadow_size": 32,
    } | settings
    means = []
    for shot in bench.shots(b.build(), range(6), **options):
        wall = np.abs(shot["position"][..., 3] - 1.0) < 1e-4
        means.append(shot["indirect"][..., 0][wall].mean() * np.pi / ALBEDO if wall.any() else np.nan)
    return float(np.mean(means))


@case(
    "box-{0}",
    tolerance=0.06,
    source="relative; probes between which irradiance is interpolated, a finite number of virtual point lights",
    each=(
        ("by-probes", "a lamp, method probes,", 4, {"indirect": "probes"}),
        ("by-rsm", "a lamp, method rsm,", 1, {"indirect": "rsm"}),
        ("by-rsm-of-a-spot", "a spot of 34 degrees, method rsm,", 1, {"cone": 0.6, "indirect": "rsm"}),
        ("without-shadow-maps", "three lamps without shadow maps,", 4, {"lamps": 3, "shadow_lights": 0}),
        ("with-some-shadow-maps", "three lamps, one with a shadow map,", 4, {"lamps": 3, "shadow_lights": 1}),
    ),
)
def closed_box(bench: Bench, name: str, lights: str, bounces: int, options: dict[str, Any]) -> Outcome:
    """Indirect light of {1} in a closed box of albedo 0.5: mean irradiance of its walls.

    A factor pi, a lost cosine, bounces counted twice, or lights without shadow maps that bounce nothing.
    """
    flux = 2.0 * np.pi * (1.0 - np.cos(options["cone"])) if "cone" in options else FLUX
    expected = flux * sum(ALBEDO**k for k in range(1, bounces + 1)) / 24.0
    return scalar(expected, _bounced(bench, **options), relative=True)


@case("indirect-of-a-still-box", source="exact: the same texels")
def indirect_of_a_still_box(bench: Bench) -> Outcome:
    """The box in two frames with two cameras that look the same way: largest difference of indirect radiance.

    Random rays, or probes that follow the camera, change a still image.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((1.0, 1.0, 1.0), inside=True, material=lambert(b, ALBEDO))))
    for i in range(2):
        b.light(intensity=1.0, translation=(0.3 * i, 0.1, 0.0))
    eye = b.camera(yfov=np.radians(90.0), znear=0.01)
    b.animate(eye, "rotation", [0.0, 1.0, 2.0], [turn_y(0.0), turn_y(90.0), turn_y(0.0)], "STEP")
    options = {
        "columns": ("indirect",),
        "indirect": "probes",
        "indirect_samples": 300,
        "probes": 100,
        "shadow_lights": 1,
    }
    first, _, last = bench.shots(b.build(), range(3), **options)
    off = last["indirect"] - first["indirect"]
    return field("0", off if first["indirect"].max() > 0.0 else np.nan)


def lamp_beside_a_wall(x: float, places: np.ndarray, fps: float) -> Scene:
    """A lamp of 1 cd at one of ``places`` (F, 3) a frame lights a wall at ``x``; the camera sees a dark screen.

    A voxel of indirect light is 0.109 m.
    """
    b = SceneBuilder()
    floor = b.mesh(quad(5.0, 5.0, material=lambert(b, 0.0)))
    b.node(mesh=floor, rotation=(-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    for at, degrees, albedo in ((x, 90.0, ALBEDO), (SCREEN, -90.0, SCREEN_ALBEDO)):
        wall = b.mesh(quad(5.0, 1.5, material=lambert(b, albedo)))
        b.node(mesh=wall, translation=(at, 1.5, 0.0), rotation=turn_y(degrees))
    lamp = b.light(intensity=1.0)
    b.animate(lamp, "translation", np.arange(len(places)) / fps, places)
    b.camera(translation=(0.5, 1.5, 0.0), rotation=turn_y(-90.0), yfov=0.8, znear=0.05)
    return b.build()


def light_of_the_wall(x: float, lamp: np.ndarray, points: np.ndarray) -> float:
    """Mean irradiance of points (N, 3) of the screen by one bounce, by quadrature over the rays of the lamp (3,)."""
    n = 200
    cosine, angle = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) * 2 * np.pi / n)
    sine = np.sqrt(1.0 - cosine**2)
    rays = np.stack([-cosine, sine * np.cos(angle), sine * np.sin(angle)], axis=-1).reshape(-1, 3)
    hits = lamp + rays * ((x - lamp[0]) / rays[:, :1])
    hits = hits[(hits[:, 1] > 0.0) & (hits[:, 1] < 3.0) & (np.abs(hits[:, 2]) < 5.0)]
    way = points[:, None] - hits
    gain = np.sum(way[..., 0] ** 2 / np.sum(way**2, axis=-1) ** 2, axis=1) / np.pi
    return float(gain.mean() * ALBEDO * 2 * np.pi / n**2)


@case(
    "lamp-beside-a-wall",
    tolerance=0.07,
    source="relative; probes between which irradiance is interpolated, a finite number of virtual point lights",
)
def lamp_beside_a_wall_case(bench: Bench) -> Outcome:
    """A lamp 1 m, 0.1 m and 0.05 m from a wall: irradiance of a screen 7 m away, method probes, over its integral.

    Points just above the lit wall are inside its voxels or not: its light goes on and off between frames.
    """
    x = -3.89
    places = np.array([[x + distance, 1.3, 0.1] for distance in (1.0, 0.1, 0.05)])
    options = {"columns": ("indirect",), "indirect": "probes", "indirect_samples": 2400, "probes": 1000}
    ratios = []
    for place, shot in zip(
        places, bench.shots(lamp_beside_a_wall(x, places, 1.0), range(len(places)), **options), strict=True
    ):
        points = (shot["position"][..., :3] + shot.view.position).reshape(-1, 3)[::37]
        measured = shot["indirect"][..., 0].mean() * np.pi / SCREEN_ALBEDO
        ratios.append(measured / light_of_the_wall(x, place, points))
    return field("1", np.array(ratios) - 1.0)


def _furnished_room(
    rotation: tuple[float, float, float, float] = IDENTITY, scale: float = 1.0, beside: bool = False
) -> Scene:
    """A room of three sides with a metal and a red box, a lamp and a spot, all turned and scaled with their camera.

    ``beside``: another lamp, 2 cm from a wall at scale 1.  The lights are scale^2 as strong, so radiance is the same.
    """
    b = SceneBuilder()
    root = b.node(rotation=rotation, scale=(scale, scale, scale))
    wall, red = lambert(b, 0.6), b.material(base_color=(0.9, 0.1, 0.2, 1.0), metallic=0.0, roughness=0.7)
    metal = b.material(base_color=(0.2, 0.8, 0.4, 1.0), metallic=1.0, roughness=0.4)
    b.node(root, mesh=b.mesh(box((4.0, 2.0, 3.0), inside=True, material=wall)))
    b.node(root, mesh=b.mesh(box((0.5, 0.7, 0.3), material=red)), translation=(-1.0, -1.3, -1.0),
           rotation=turn((0.2, 1.0, 0.1), 30.0))  # fmt: skip
    b.node(root, mesh=b.mesh(box((0.6, 0.4, 0.5), material=metal)), translation=(1.2, -0.8, -1.5),
           rotation=turn((1.0, 0.3, 0.1), 50.0))  # fmt: skip
    b.light(root, translation=(-2.0, 1.2, 0.5), intensity=20.0 * scale**2, color=(1.0, 0.8, 0.6))
    b.light(root, kind="spot", translation=(2.0, 1.5, 1.0), intensity=60.0 * scale**2, inner_cone=0.3, outer_cone=0.9,
            rotation=turn((1.0, 0.3, 0.0), -70.0))  # fmt: skip
    if beside:
        b.light(root, translation=(3.98, 0.5, -1.0), intensity=4.0 * scale**2)
    b.camera(root, translation=(0.3, 0.4, 2.6), rotation=turn((0.3, 1.0, 0.0), 8.0), yfov=1.2, znear=0.1 * scale)
    return b.build()


PERMUTED = (0.5, 0.5, 0.5, 0.5)
"""The rotation that takes +X to +Y, +Y to +Z and +Z to +X."""


def _rastered(bench: Bench, method: str, scene: Scene) -> dict[str, Array]:
    options = {"columns": ("direct", "indirect"), "indirect": method, "shadow_size": 64, "width": 64, "height": 36}
    shot = bench.shots(scene, **options)[0]
    return {name: shot[name][..., :3] for name in options["columns"]}


def _turned(radiance: Callable[[Scene], dict[str, Array]]) -> Outcome:
    there, here = (radiance(_furnished_room(rotation)) for rotation in (PERMUTED, IDENTITY))
    errors = [np.abs(there[name] - here[name]).mean() / here[name].mean() for name in here]
    dark = [name for name in here if not here[name].mean() > 0.01]
    return field("no difference", [*errors, *[1.0 for _ in dark]])


@case(
    "turned-room-by-{0}",
    tolerance=1e-4,
    source="float32: 1e-6 for the same sums in another order; a pixel at a shadow's edge may change",
    each=(("rsm",), ("probes",)),
)
def turned_room(bench: Bench, method: str) -> Outcome:
    """A room with its axes exchanged, X to Y to Z, with its camera: radiance by {0} against that before.

    A component of a vector is mixed up in one of many formulas, which a symmetric scene does not show.
    """
    return _turned(functools.partial(_rastered, bench, method))


@case("turned-room-by-paths", tolerance=0.04, source="means of 9,216 paths in other directions: 1 % of indirect light")
def turned_room_by_paths(bench: Bench) -> Outcome:
    """A room with its axes exchanged, X to Y to Z, with its camera: path-traced means against those before.

    A component of a vector is mixed up in one of many formulas, which a symmetric scene does not show.
    """

    def radiance(scene: Scene) -> dict[str, Array]:
        images = bench.traced(scene, width=32, height=18, spp=16, pattern="independent", bounces=4)
        return {name: image[..., :3].mean(axis=(0, 1)) for name, image in images.items()}

    return _turned(radiance)


@case(
    "scaled-room-by-{0}",
    tolerance=1e-4,
    source="float32: 1e-6; powers of two; a pixel at a shadow's edge may change",
    each=(("rsm",), ("probes",)),
)
def scaled(bench: Bench, method: str) -> Outcome:
    """A furnished room with a lamp beside a wall at scales 1/16 and 32: radiance by {0} against that at scale 1.

    A lift, a shortest distance or a cell has a length in meters, which suits one size of scenes.
    """
    here, *others = (_rastered(bench, method, _furnished_room(scale=s, beside=True)) for s in (1.0, 2.0**-4, 2.0**5))
    errors = [np.abs(other[name] - here[name]).mean() / here[name].mean() for other in others for name in here]
    return field("no difference", errors)
