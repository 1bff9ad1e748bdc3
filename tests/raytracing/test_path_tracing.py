"""Path-traced light against the float64 path tracer, sample by sample with the same numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fixed import fixed_settings
from references.path_tracing import LightSegments, PathLight, TraceScene, trace
from references.punctual import incident
from repeated import few

from taubench_gl.animation import FrameState, Poser, View, choose_camera
from taubench_gl.frame.passes.pathtracing import CANDIDATES, CELL_ENTRIES, MOST_CELLS, subpath_choice
from taubench_gl.frame.raytracing import emitters
from taubench_gl.frame.raytracing.emitters import group_size
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.frame.tuning import Tuning
from taubench_gl.metrics.environment import direction_choice
from taubench_gl.metrics.lighting import SurfaceMaterial
from taubench_gl.metrics.stochastic import LightCells, cell_choice, light_choice
from taubench_gl.scene.builder import SceneBuilder, box, quad, turn_x, turn_y
from taubench_gl.scene.model import Material, Scene
from taubench_gl.selftest.scenes import sky_file
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray
SIZE = (24, 16)
LOBES = ("direct_diffuse", "direct_glossy", "indirect_diffuse", "indirect_glossy")


def room(
    *,
    lights: int = 0,
    emitter: float = 0.0,
    cells: tuple[int, int] = (1, 1),
    closed: bool = True,
    on: range | None = None,
    spots: bool = False,
    close: bool = False,
) -> Scene:
    """A room or an open stage with a glossy box, a metal board and lights.

    ``cells``: of the emitter, two triangles each, and as many of a lamp near the floor.  ``on``: of the lights; None:
    all.  ``spots``: every second light is one.  ``close``: a lamp 2 cm from a wall and a
    spot 3 cm above the box.
    """
    b = SceneBuilder()
    matte = b.material(base_color=(0.8, 0.6, 0.4, 1.0), metallic=0.0, specular=0.0, double_sided=True)
    glossy = b.material(base_color=(0.3, 0.5, 0.9, 1.0), metallic=0.0, roughness=0.5, double_sided=True)
    metal = b.material(base_color=(0.9, 0.8, 0.5, 1.0), metallic=1.0, roughness=0.4, double_sided=True)
    if closed:
        b.node(mesh=b.mesh(box((3.0, 2.0, 3.0), inside=True, material=matte)))
    else:
        b.node(mesh=b.mesh(quad(4.0, 4.0, material=matte)), rotation=turn_x(-90.0), translation=(0.0, -2.0, 0.0))
    b.node(mesh=b.mesh(box((0.6, 0.8, 0.5), material=glossy)), translation=(-0.9, -1.2, -1.0), rotation=turn_y(30.0))
    b.node(mesh=b.mesh(quad(0.9, 0.9, material=metal)), translation=(1.2, -0.9, -1.6), rotation=turn_y(-25.0))
    if emitter:
        lamp = b.material(base_color=(0.2, 0.2, 0.2, 1.0), metallic=0.0, specular=0.0, emissive=(emitter,) * 3)
        mesh = b.mesh(quad(0.7, 0.4, cells=cells, material=lamp))
        b.node(mesh=mesh, translation=(0.3, 1.6, -0.5), rotation=turn_x(80.0))
        if cells != (1, 1):
            b.node(mesh=mesh, translation=(-1.9, -1.5, 0.4), scale=(0.3, 0.3, 0.3))
    for i in range(lights):
        at = -2.0 + 4.0 * ((i * 0.37) % 1.0), 0.4 + ((i * 0.61) % 1.0), -2.0 + 3.0 * ((i * 0.23) % 1.0)
        intensity, spot = 3.0 + i if on is None or i in on else 0.0, {}
        if spots and i % 2:
            spot = {"kind": "spot", "inner_cone": 0.3, "outer_cone": 1.1}
        b.light(translation=at, color=(1.0, 0.7 + 0.02 * i, 0.5), intensity=intensity, **spot)
    if close:
        b.light(translation=(-2.98, 0.3, -1.0), intensity=3.0)
        down = {"kind": "spot", "rotation": turn_x(-90.0), "inner_cone": 0.2, "outer_cone": 1.0}
        b.light(translation=(-0.9, -0.37, -1.0), intensity=9.0, **down)
    b.camera(translation=(0.1, 0.2, 2.6), rotation=turn_x(-8.0), yfov=np.radians(60.0))
    return b.build()


def render(gpu, scene: Scene, one_light: bool = False, **given) -> dict[str, Array]:
    """Channels of the first frame; rows from the top."""
    options = {"light": "path-traced", "columns": ("direct", "indirect"), **given}
    settings = fixed_settings(width=SIZE[0], height=SIZE[1], **options)
    extra = (*LOBES, "path_info", "geometric_normal", "base_color", "material")
    shading = Shading(one_light=one_light)
    with RasterSource(gpu, AnimatedScene(scene), settings, extra=extra, shading=shading) as source:
        source.advance(0)
        return {name: source.read(name) for name in ("position", "normal", "direct", "indirect", *extra)}


def reference(scene: Scene, frame: dict[str, Array], **options) -> tuple[PathLight, Array]:
    """Sums of the float64 path tracer at the surface pixels of ``frame``, and which pixels those are."""
    state = Poser(scene).sample(0.0)
    view = choose_camera(scene).view_at(state)
    triangles, rows = _triangles(scene, state, view)
    emission = np.array([m.emissive for m in rows])
    shining = np.flatnonzero(emission.any(axis=1))
    area = 0.5 * np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    emitted = (area * (emission @ LUMINANCE))[shining]
    positions = state.world[scene.light_nodes, :3, 3] - view.position
    lights = [_arriving(light, at) for light, at in zip(_lights(scene), positions, strict=True)]
    power = np.array([max(light.color) * light.intensity for light in _lights(scene)])
    groups = np.arange(0, len(shining), group_size(len(shining)))
    most = max(len(power), len(groups), 1)
    grid = LightCells.of_box(*AnimatedScene(scene).box, min(MOST_CELLS, CELL_ENTRIES // most))
    grid = replace(grid, low=grid.low - view.position)
    if most <= CANDIDATES:
        grid = LightCells(np.zeros(3), 1.0, (0, 0, 0))
    on, everywhere = np.flatnonzero(power), np.full(len(power), True)
    first, entries = cell_choice(grid.importance(positions[on], power[on], np.zeros(len(on)), everywhere[on]))
    entries[:, 1] = on[entries[:, 1].astype(int)]
    sources = {"sky": np.asarray(options.pop("sky", (0.0, 0.0, 0.0)))}
    if options.pop("bidirectional", False):
        least = np.array([np.cos(light.outer_cone) if light.kind == "spot" else -1.0 for light in _lights(scene)])
        axes = np.broadcast_to([0.0, 0.0, -1.0], positions.shape)
        sources |= {"segments": LightSegments(positions, axes, least, light_choice(power * (1.0 - least)))}
    if (image := options.pop("image", None)) is not None:
        sources |= {"environment": image, "choice": direction_choice(image)}
    traced = TraceScene(
        triangles,
        np.array([m.base_color[:3] for m in rows]),
        np.array([m.metallic for m in rows]),
        np.array([m.roughness for m in rows]),
        np.array([m.specular for m in rows]),
        emission,
        tuple(lights),
        grid,
        (first, entries),
        CANDIDATES,
        shining,
        np.cumsum(emitted) / emitted.sum() if len(emitted) else np.zeros(0),
        _emitter_cells(grid, groups, triangles[shining].mean(axis=1), emitted, area[shining]),
        group_size(len(shining)),
        **sources,
    )
    shown = frame["position"][..., 3] > 0
    points = frame["position"][shown][:, :3].astype(np.float64)
    normals = frame["normal"][shown][:, :3].astype(np.float64)
    m = frame["material"][shown].astype(np.float64)
    material = SurfaceMaterial(frame["base_color"][shown][:, :3].astype(np.float64), m[:, 0], m[:, 1], m[:, 3])
    to_viewer = -points / np.linalg.norm(points, axis=1, keepdims=True)
    return trace(traced, points, normals, to_viewer, material, **options), shown


def _triangles(scene: Scene, state: FrameState, view: View) -> tuple[Array, list[Material]]:
    """Corners relative to the camera (T, 3, 3), and the material of each triangle."""
    corners, rows = [], []
    for node in scene.mesh_nodes.tolist():
        for primitive in scene.meshes[scene.nodes.mesh[node]].primitives:
            points = primitive.positions.astype(np.float64) @ state.world[node, :3, :3].T
            points += state.world[node, :3, 3] - view.position
            corners.append(points[primitive.triangles])
            rows += [scene.materials[primitive.material]] * len(primitive.triangles)
    return np.concatenate(corners), rows


def _emitter_cells(grid: LightCells, groups: Array, centers: Array, power: Array, areas: Array) -> tuple[Array, Array]:
    """``cell_choice`` of emitters (E,): at the mean place of a group by power, spread over its area."""
    of_group = np.add.reduceat(power, groups)
    at = np.add.reduceat(power[:, None] * centers, groups) / of_group[:, None]
    everywhere = np.zeros(len(groups)), np.full(len(groups), True)
    return cell_choice(grid.importance(at, of_group, *everywhere, np.add.reduceat(areas, groups)))


def _lights(scene: Scene):
    return [scene.lights[scene.nodes.light[node]] for node in scene.light_nodes.tolist()]


def _arriving(light, position):
    def arriving(points: Array) -> tuple[Array, Array, Array]:
        direction, irradiance = incident(light, position, np.array([0.0, 0.0, -1.0]), points)
        return direction, irradiance, np.linalg.norm(position - points, axis=1)

    return arriving


def assert_same(frame: dict[str, Array], traced: PathLight, shown: Array, samples: int, exact: bool = False) -> None:
    """Every lobe equals the reference's in all but the few pixels where a ray passes an edge on the other side."""
    for name in LOBES:
        if exact and name.startswith("direct"):
            continue
        expected = getattr(traced, name) / samples
        measured = frame[name][shown][:, :3]
        scale = max(expected.max(), 1e-6)
        off = np.abs(measured - expected).max(axis=1) / scale
        assert np.mean(off > 1e-3) <= 0.02, (name, np.mean(off > 1e-3), float(np.median(off)))
        assert abs(measured.mean() - expected.mean()) <= 5e-3 * max(expected.mean(), 1e-6), name
    for name in ("direct", "indirect"):
        lobes = frame[f"{name}_diffuse"] + frame[f"{name}_glossy"]
        np.testing.assert_allclose(frame[name][..., :3], lobes[..., :3], atol=1e-5, rtol=1e-5)


SAMPLES, BOUNCES = 4, 5
IMAGE = np.random.default_rng(3).random((16, 32, 3)).astype(np.float32)
IMAGE[3, 22] = 100.0
"""A sky of colored patches with a small sun; its directions are drawn by luminance."""


@pytest.mark.parametrize(
    ("made", "environment", "one_light"),
    [
        ({"lights": 3}, "none", False),
        ({"lights": 40}, "none", False),
        ({"lights": 3}, "none", True),
        ({"emitter": 8.0}, "none", False),
        ({"emitter": 8.0, "cells": (3, 2)}, "none", False),
        ({"emitter": 8.0, "cells": (3, 2), "lights": 2}, "none", False),
        ({"closed": False}, (0.5, 0.7, 1.0), False),
        ({"closed": False}, "image", False),
        ({"closed": False, "lights": 2}, "image", False),
    ],
    ids=[
        "few lights",
        "lights by power",
        "one light of few",
        "emitter",
        "lamps",
        "lamps and lights",
        "sky",
        "image",
        "image and lights",
    ],
)
def test_light_is_that_of_the_reference(gpu, made, environment, one_light):
    """With the numbers and weights of the float64 path tracer; few punctual lights have no noise and are left out."""
    scene, options = room(**made), {"samples": SAMPLES, "bounces": BOUNCES}
    exact = 0 < made.get("lights", 0) <= 4 * SAMPLES and not one_light
    with sky_file(IMAGE) as path:
        seen = path if environment == "image" else environment
        frame = render(gpu, scene, one_light=one_light, spp=SAMPLES, bounces=BOUNCES, environment=seen)
    if environment == "image":
        options["image"] = IMAGE.astype(np.float64)
    elif environment != "none":
        options["sky"] = environment
    traced, shown = reference(scene, frame, first_source=int(exact), **options)
    assert_same(frame, traced, shown, SAMPLES, exact=exact)
    if "sky" in options:
        assert np.allclose(frame["path_info"][shown][:, 1], SAMPLES)
        distance = traced.hit_distance / np.maximum(traced.hits, 1)
        assert np.allclose(frame["path_info"][shown][:, 0], distance, rtol=1e-3, atol=1e-3)


def test_many_emitters_are_chosen_in_groups(gpu, monkeypatch):
    """Groups of three triangles, across both lamps, with the numbers and weights of the float64 path tracer."""
    monkeypatch.setattr(emitters, "MOST_GROUPS", 9)
    scene = room(emitter=8.0, cells=(3, 2))
    frame = render(gpu, scene, spp=SAMPLES, bounces=BOUNCES)
    traced, shown = reference(scene, frame, samples=SAMPLES, bounces=BOUNCES)
    assert_same(frame, traced, shown, SAMPLES)


@pytest.mark.parametrize("lights", few([40, 3]))
def test_bidirectional_paths(gpu, lights):
    scene = room(lights=lights, spots=True)
    frame = render(gpu, scene, spp=SAMPLES, bounces=BOUNCES, bidirectional=True)
    exact = lights <= 4 * SAMPLES
    options = {"samples": SAMPLES, "bounces": BOUNCES, "first_source": int(exact)}
    traced, shown = reference(scene, frame, bidirectional=True, **options)
    assert_same(frame, traced, shown, SAMPLES, exact=exact)
    alone, _ = reference(scene, frame, **options)
    assert abs(alone.indirect_diffuse.mean() / traced.indirect_diffuse.mean() - 1.0) > 0.01, "other paths"


def blocks(
    gpu, scene: Scene, samples: int, count: int, *, name: str = "indirect", one_light: bool = False, **given
) -> Array:
    """Means (count, h, w, 3) of light ``name`` over ``samples`` independent samples each."""
    chosen = {"light": "path-traced", "columns": ("direct", "indirect"), "pattern": "independent"}
    settings = fixed_settings(width=SIZE[0], height=SIZE[1], spp=samples, **(chosen | given))
    out = []
    with RasterSource(gpu, AnimatedScene(scene), settings, shading=Shading(one_light=one_light)) as source:
        source.draw(0)
        for number in range(count):
            source.trace(number, 0, samples)
            out.append(source.read(name)[..., :3].astype(np.float64))
    return np.stack(out)


def test_variance_of_bidirectional_paths_falls_with_the_samples(gpu):
    """As 1 / N or, because samples are stratified, faster: near lamps too, where that of BRDF sampling does not."""

    def variance(samples: int, on: bool) -> float:
        found = blocks(gpu, room(close=True), samples, 12, bounces=3, bidirectional=on)
        return float(found.var(axis=0, ddof=1).mean())

    few, many = variance(4, True), variance(16, True)
    assert many < few / 4 * 1.25
    assert many < variance(16, False) / 10


def test_lights_of_subpaths_are_chosen_by_what_they_send():
    """A point light, a spot of a sixteenth of the sphere, a directional light."""
    spots = np.array([[0.0, 0.0, 0.0, 0.0], [2.0, -2.0 * 0.875, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    choice = subpath_choice(np.array([3.0, 3.0, 1000.0]), np.array([0.0, 1.0, 2.0]), spots)
    expected = light_choice(np.array([16.0, 1.0, 0.0]))
    np.testing.assert_allclose(choice, expected, rtol=1e-6)
    assert choice[2, 1] == 0.0


def test_exact_light_is_the_sum_over_its_lights(gpu):
    """Four lights a sample are exact: the sum of images with some of them on, whatever the samples."""

    def direct(samples, on=None):
        return render(gpu, room(lights=24, on=on), spp=samples, bounces=1)["direct"][..., :3]

    every = direct(6)
    np.testing.assert_allclose(every, direct(6, range(16)) + direct(6, range(16, 24)), rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(every, direct(7))
    assert np.mean(np.abs(direct(5) - every)) > 0.01 * every.mean()


@pytest.mark.parametrize("lights", [1, 3, 24])
def test_one_light_is_all_lights_in_the_mean(gpu, lights):
    """Sample means of 64 frames against the light of every light; with a single light each sample has all of it."""
    scene, frames = room(lights=lights), 64
    exact = render(gpu, scene, spp=max(1, lights // 4), bounces=1)["direct"][..., :3].astype(np.float64)
    images = blocks(gpu, scene, 1, frames, name="direct", one_light=True, bounces=1)
    mean, spread = np.mean(images, axis=0), np.std(images, axis=0, ddof=1)
    if lights == 1:
        np.testing.assert_allclose(images, np.broadcast_to(exact, np.shape(images)), rtol=1e-5, atol=1e-6)
        return
    varies = spread > 1e-4 * exact.max()
    assert varies.mean() > 0.2
    np.testing.assert_allclose(mean[~varies], exact[~varies], rtol=1e-3, atol=1e-4)
    # Pixels are independent, so the mean of the image has a standard error.  E|z| of a pixel is 0.8.
    error = (mean - exact)[..., 1]
    assert abs(error.mean()) < 4 * np.sqrt(np.sum(spread[..., 1] ** 2 / frames)) / error.size
    assert np.abs(error[varies[..., 1]] / (spread[..., 1] / np.sqrt(frames))[varies[..., 1]]).mean() < 1.2


def test_patterns(gpu):
    """`fixed` repeats itself whatever the frame; `independent` is another estimate of the same mean with each seed."""
    scene = room(emitter=8.0)
    first, second = (render(gpu, scene, spp=4, bounces=3) for _ in range(2))
    assert np.array_equal(first["direct"], second["direct"]) and np.array_equal(first["indirect"], second["indirect"])
    seeds = [render(gpu, scene, spp=16, bounces=3, pattern="independent", seed=s)["direct"][..., :3] for s in (1, 2)]
    assert not np.array_equal(*seeds)
    assert abs(seeds[0].mean() / seeds[1].mean() - 1.0) < 0.05
    # Neighbors share the numbers of `fixed`: between edges its image is smooth.
    noisy, smooth = (np.median(np.abs(np.diff(i[..., :3], axis=1))) for i in (seeds[0], first["direct"]))
    assert noisy > smooth


def test_variance_is_that_of_one_sample_over_their_number(gpu):
    """Stratified samples vary less together, so it is an upper bound of the variance of their mean."""
    scene, luminance = room(emitter=8.0), LUMINANCE
    many = render(gpu, scene, spp=64, bounces=3, pattern="independent")
    single = [render(gpu, scene, spp=1, bounces=3, pattern="independent", seed=s) for s in range(1, 17)]
    for component, name in ((2, "direct"), (3, "indirect")):
        spread = np.var([run[name][..., :3] @ luminance for run in single], axis=0, ddof=1).mean()
        assert 64 * many["path_info"][..., component].mean() == pytest.approx(spread, rel=0.2)
        assert not single[0]["path_info"][..., component].any()


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "environment"),
    [(room(lights=13), "none"), (room(emitter=8.0), "none"), (room(closed=False), (0.5, 0.7, 1.0))],
    ids=["lights", "emitter", "sky"],
)
def test_error_of_fixed_falls_with_the_samples(gpu, scene, environment):
    """RMS error of `fixed` against `independent` with four times as many samples: slope of -0.45 or steeper."""
    options, counts = {"bounces": 6, "environment": environment}, (16, 64, 256, 1024)
    converged = render(gpu, scene, spp=4 * counts[-1], pattern="independent", seed=9, **options)
    frames = [render(gpu, scene, spp=n, **options) for n in counts]
    for name in ("direct", "indirect"):
        errors = [float(np.sqrt(np.mean((f[name] - converged[name]) ** 2))) for f in frames]
        if max(errors) > 1e-6:  # direct light of few punctual lights is exact
            assert np.polyfit(np.log(counts), np.log(errors), 1)[0] <= -0.45, (name, errors)


def test_tiles_of_any_shape_give_the_bits_of_one(gpu, monkeypatch):
    scene = room(lights=2, emitter=4.0)
    whole = render(gpu, scene, spp=2, bounces=3)
    for tile in ((7, 5), (5, 7), (24, 3)):
        monkeypatch.setattr(Tuning, "path_tile", tile)
        parts = render(gpu, scene, spp=2, bounces=3)
        for name in ("direct", "indirect"):
            assert whole[name].any() and np.array_equal(whole[name], parts[name]), (tile, name)
