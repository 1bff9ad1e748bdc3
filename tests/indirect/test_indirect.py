"""Indirect light against closed forms: a lit floor seen by a ceiling, a wall between, and a closed white box."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.scene.builder import SceneBuilder, box, quad
from taubench_gl.scene.model import Scene

SIZE = (64, 48)
ALBEDO = 0.6
LOOK_UP = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))  # turns -Z to +Y, +Z to -Y
LOOK_DOWN = (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))


def lambert(scene: SceneBuilder, albedo: float = ALBEDO) -> int:
    return scene.material(
        base_color=(albedo, albedo, albedo, 1.0), metallic=0.0, roughness=1.0, specular=0.0, double_sided=True
    )


def floor_and_ceiling_builder(*, wall: bool = False) -> SceneBuilder:
    """A spot just under the ceiling (y = 2) lights the floor (y = 0)."""
    s = SceneBuilder()
    s.node(mesh=s.mesh(quad(3.0, 3.0, material=lambert(s))), rotation=LOOK_DOWN)
    s.node(mesh=s.mesh(quad(3.0, 3.0, material=lambert(s))), translation=(0, 2, 0), rotation=LOOK_UP)
    if wall:  # a screen beside the lit spot, from floor to almost the ceiling
        s.node(mesh=s.mesh(quad(3.0, 0.9, material=lambert(s, 0.0))), translation=(-0.8, 0.9, 0), rotation=turn_y(90))
    s.light(
        translation=(0.0, 1.9, 0.0), rotation=LOOK_DOWN, kind="spot", intensity=50.0, inner_cone=0.3, outer_cone=0.35
    )
    return s


def floor_and_ceiling(*, wall: bool = False) -> Scene:
    """A floor and a ceiling, seen by a camera on the floor that looks at the ceiling."""
    s = floor_and_ceiling_builder(wall=wall)
    s.camera(translation=(-1.5, 0.1, 0.0), rotation=LOOK_UP, yfov=0.8, znear=0.05)
    return s.build()


def turn_y(degrees: float):
    half = 0.5 * np.radians(degrees)
    return (0.0, np.sin(half), 0.0, np.cos(half))


@contextmanager
def opened(scene: Scene, shading: Shading | None = None, **overrides) -> Iterator[RasterSource]:
    """The source of an evaluation, of 64x48 pixels; GL has no error afterwards."""
    settings = fixed_settings(width=SIZE[0], height=SIZE[1], **overrides)
    with open_gpu() as gpu:
        with RasterSource(gpu, AnimatedScene(scene), settings, shading=shading or Shading()) as source:
            yield source
        gpu.collect()
        gpu.check("the test")


def draw(scene: Scene, shading: Shading | None = None, **overrides) -> dict[str, np.ndarray]:
    """Channels of the scene's first frame."""
    with opened(scene, shading, **overrides) as source:
        view = source.advance(0)
        out = {name: source.read(name) for name in source.channels}
        return out | {"points": out["position"][..., :3] + view.position}


def vpls(scene: Scene, frame: int = 0, **overrides) -> np.ndarray:
    """Virtual point lights of a frame, records VPL."""
    with opened(scene, **overrides) as source:
        source.advance(frame)
        return source.light.vpls()


def ceiling_irradiance(points: np.ndarray, *, wall: bool = False) -> np.ndarray:
    """Irradiance from the lit disk of the floor, by quadrature in float64.  (n, 3) -> (n,)."""
    n = 401
    reach = 1.9 * np.tan(0.35)
    x, z = np.meshgrid(np.linspace(-reach, reach, n), np.linspace(-reach, reach, n))
    cell = (2 * reach / (n - 1)) ** 2
    d2 = x**2 + z**2 + 1.9**2
    cosine = 1.9 / np.sqrt(d2)
    scale = 1.0 / (np.cos(0.3) - np.cos(0.35))
    cone = np.clip((cosine - np.cos(0.35)) * scale, 0, 1) ** 2
    radiosity = ALBEDO * 50.0 * cone * cosine / d2
    floor = np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3)
    out = []
    for p in points:
        r = p - floor
        r2 = np.sum(r**2, axis=-1)
        gain = (r[:, 1] ** 2) / (np.pi * r2**2)
        if wall:
            crosses = (floor[:, 0] + 0.8) * (p[0] + 0.8) < 0
            t = (-0.8 - floor[:, 0]) / np.where(r[:, 0] == 0, 1.0, r[:, 0])
            gain = np.where(crosses & (t * p[1] < 1.8), 0.0, gain)
        out.append(np.sum(radiosity.ravel() * gain) * cell)
    return np.array(out)


@pytest.mark.parametrize("light", [{}, {"shadow_lights": 0}], ids=["with maps", "by patches"])
@pytest.mark.parametrize(("method", "tolerance"), [("rsm", 0.03), ("probes", 0.12)])
def test_ceiling_sees_the_lit_floor(method, tolerance, light):
    got = draw(floor_and_ceiling(), indirect=method, indirect_samples=2048, probes=1728, **light)
    points = got["points"][::8, ::8].reshape(-1, 3)
    expected = ceiling_irradiance(points) * ALBEDO / np.pi
    measured = got["indirect"][::8, ::8, 0].reshape(-1)
    error = np.abs(measured - expected) / expected.max()
    assert np.allclose(points[:, 1], 2.0, atol=1e-5)
    assert error.mean() < tolerance, f"mean {error.mean():.4f}, max {error.max():.4f}"


def test_irradiance_is_not_upsampled_across_a_step():
    """A plate 1.2 m below the ceiling, parallel to it: beside its edge pixels have the light of their own plane."""
    s = floor_and_ceiling_builder()
    s.node(mesh=s.mesh(quad(0.25, 0.25, material=lambert(s))), translation=(-0.8, 0.8, 0.0), rotation=LOOK_UP)
    s.camera(translation=(-0.8, 0.1, 0.0), rotation=LOOK_UP, yfov=0.8, znear=0.05)
    scene, method = s.build(), {"indirect": "rsm", "indirect_samples": 2048}
    upsampled, gathered = (draw(scene, Shading(gather_each=each), **method) for each in (False, True))
    plate = upsampled["points"][..., 1] < 1.6
    edge = np.logical_or.reduce([np.roll(plate, step, axis) != plate for axis in (0, 1) for step in (-1, 1)])
    assert np.count_nonzero(edge) > 100
    error = np.abs(upsampled["indirect"][edge][:, 0] / gathered["indirect"][edge][:, 0] - 1.0)
    assert error.max() < 0.3, "within a plane the spot's falloff alone costs 0.2; across the step it is 1.9"


@pytest.mark.parametrize("light", [{}, {"shadow_lights": 0}], ids=["with maps", "by patches"])
def test_only_probes_see_the_wall_between(light):
    scene = floor_and_ceiling(wall=True)
    rsm, probes = (
        draw(scene, indirect=method, indirect_samples=2048, probes=1728, **light) for method in ("rsm", "probes")
    )
    behind = probes["points"][..., 0] < -1.4
    points = probes["points"][behind][::40]
    expected = ceiling_irradiance(points, wall=True).mean() * ALBEDO / np.pi
    open_air = ceiling_irradiance(points).mean() * ALBEDO / np.pi
    assert expected < 0.5 * open_air, "the case is not hard: the wall hides too little"
    assert rsm["indirect"][behind][..., 0].mean() > 0.8 * open_air
    assert probes["indirect"][behind][..., 0].mean() < expected + 0.25 * (open_air - expected)


def closed_box(lights: int, spread: float = 0.0, off: int = 0) -> SceneBuilder:
    """A closed box, 2 m along a side, whose ``lights`` share one candela near its middle, beside ``off`` dark ones."""
    s = SceneBuilder()
    s.node(mesh=s.mesh(box((1.0, 1.0, 1.0), inside=True, material=lambert(s))))
    for i in range(lights):
        at = (spread * np.sin(i), spread * np.cos(i), 0.0)
        s.light(kind="point", intensity=1.0 / lights, translation=at)
    for i in range(off):
        s.light(kind="point", intensity=0.0, translation=(0.2, 0.2 * i, 0.0))
    return s


def wall_irradiance(got: dict[str, np.ndarray]) -> float:
    """Mean indirect irradiance of the wall before the camera: each of its pixels shows the same area."""
    wall = np.abs(got["position"][..., 3] - 1.0) < 1e-4
    return got["indirect"][..., 0][wall].mean() * np.pi / ALBEDO


def conserved(bounces: int) -> float:
    """Mean irradiance after k bounces in a closed box of albedo a: flux (a + .. + a^k) / area."""
    return 4 * np.pi * sum(ALBEDO**k for k in range(1, bounces + 1)) / 24.0


@pytest.mark.parametrize(("lit", "off"), [(4, 0), (1, 3)])
def test_bounces_count_a_wall_once_however_many_lights_see_it(lit, off):
    """The closed box again, its lamp split into parts or beside others that are off: the same flux, the same light."""
    s = closed_box(lit, spread=0.01, off=off)
    s.camera(yfov=np.radians(90), znear=0.01)
    measured = wall_irradiance(draw(s.build(), indirect="probes", indirect_samples=4800, probes=512))
    assert measured == pytest.approx(conserved(4), rel=0.1)


def test_indirect_stays_where_it_is_when_only_the_camera_moves():
    """World-anchored: a moving camera over a still scene changes no surface's indirect light."""
    s = floor_and_ceiling_builder()
    node = s.camera(rotation=LOOK_UP, yfov=0.8, znear=0.05)
    s.animate(node, "translation", [0.0, 1.0], [[-1.5, 0.1, 0.0], [-1.0, 0.1, 0.2]])
    scene = s.build()
    by_place = []
    with opened(scene, indirect_samples=512, probes=216) as source:
        for frame in (0, 24):
            view = source.advance(frame)
            points = source.read("position")[..., :3] + view.position
            by_place.append((points.reshape(-1, 3), source.read("indirect")[..., 0].reshape(-1)))
    (a, ia), (b, ib) = by_place
    distance = np.linalg.norm(a[:, None, [0, 2]] - b[None, :, [0, 2]], axis=-1)
    nearest = distance.argmin(axis=1)
    close = distance[np.arange(len(a)), nearest] < 0.01
    assert close.sum() > 100
    assert np.abs(ia[close] - ib[nearest[close]]).max() < 0.02 * ia.max()


@pytest.mark.parametrize("x", [1.0, 1.93])
def test_a_light_inside_a_bulb_stays_inside(x):
    """A closed bulb far smaller than a voxel, beside a wall or not: no shadow map and no VPL lets light out."""
    s = SceneBuilder()
    s.node(mesh=s.mesh(box((2.0, 2.0, 2.0), inside=True, material=lambert(s))))
    s.node(mesh=s.mesh(box((0.02, 0.02, 0.02), material=lambert(s))), translation=(x, 0.3, 0.2))
    s.light(translation=(x, 0.3, 0.2), kind="point", intensity=10.0)
    s.camera(translation=(-1.0, 0.0, 1.0), yfov=np.radians(90), znear=0.01)
    got = draw(s.build(), indirect_samples=600, probes=512)
    open_light = ALBEDO * 10.0 * 4 * np.pi / 96.0 * ALBEDO / np.pi  # what the room would show without the bulb
    assert got["direct"][..., :3].max() == 0.0
    assert got["indirect"][..., :3].max() < 0.02 * open_light


@pytest.mark.parametrize(("kind", "solid_angle"), [("point", 4 * np.pi), ("spot", 2 * np.pi)])
def test_every_face_of_a_light_away_from_the_camera_counts(kind, solid_angle):
    """VPLs do not depend on the camera's position: total flux is the light's times the albedo.  The spot
    lights half a sphere."""
    s = SceneBuilder()
    s.node(mesh=s.mesh(box((1.0, 1.0, 1.0), inside=True, material=lambert(s))))
    cone = {"inner_cone": np.pi / 2 - 1e-6, "outer_cone": np.pi / 2}
    s.light(translation=(0.3, -0.2, 0.1), rotation=turn_y(20), kind=kind, intensity=1.0, **cone)
    s.camera(translation=(-0.9, 0.9, 0.9), rotation=turn_y(-45), yfov=1.0, znear=0.01)
    flux = vpls(s.build(), indirect="rsm", indirect_samples=2400)["flux"][:, 0].sum()
    assert flux == pytest.approx(solid_angle * ALBEDO, rel=0.01)
