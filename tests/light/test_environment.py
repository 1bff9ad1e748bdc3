"""Environments, the default one and images, against closed forms and the float64 reference."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings
from light_tools import floor, lambert, look, look_down, opened, picture, shoot, worst
from references.environment import glossy_radiance
from repeated import few

from taubench_gl.animation.pairs import sky_directions
from taubench_gl.effects.census import census
from taubench_gl.effects.decide import decide
from taubench_gl.effects.lighting import DEFAULT_RADIANCE, DEFAULT_SUN
from taubench_gl.errors import SettingsError
from taubench_gl.frame.plan import frame_resources, frame_spec
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.math3d import normalize
from taubench_gl.metrics.environment import (
    direction_choice,
    directions,
    environment_maps,
    lookup,
    resized,
    solid_angles,
)
from taubench_gl.metrics.lighting import albedo_table
from taubench_gl.scene.builder import SceneBuilder, box, sphere
from taubench_gl.scene.environment import environment_bytes, read_environment
from taubench_gl.scene.model import Scene

ALBEDO = 0.6
SKY = np.array(DEFAULT_RADIANCE)
SUN = np.array(DEFAULT_SUN.irradiance)
UP = -np.array(DEFAULT_SUN.direction)[1]
"""Cosine of the sun's angle from the vertical."""


def table(*, block: bool = False) -> Scene:
    """A Lambert floor seen from above, with a black block on it if ``block``."""
    b = SceneBuilder()
    floor(b, material=lambert(b, ALBEDO))
    if block:
        mesh = b.mesh(box((0.5, 0.5, 0.5), material=lambert(b, 0.0)))
        b.node(mesh=mesh, translation=(0.0, 0.5, 0.0))
    look_down(b, 2.0)
    return b.build()


def test_a_horizontal_lambert_plane_has_the_irradiance_of_sky_and_sun(gpu):
    """Irradiance pi sky + 0.8 sun; a Lambert plane reflects albedo / pi of it."""
    shot = picture(gpu, table(), environment="default", columns=("frustum", "direct", "color"), shadow_size=256)
    irradiance = np.pi * SKY + UP * SUN
    expected = np.broadcast_to(ALBEDO / np.pi * irradiance, shot.direct.shape)
    assert shot.surface.mean() > 0.9
    assert worst(shot.direct, expected, shot.surface) < 1e-3


def test_light_unit_divides_neither_sky_nor_sun(gpu):
    shots = [picture(gpu, table(), environment="default", light_unit=u, shadow_size=256) for u in ("watt", "candela")]
    assert np.array_equal(shots[0].direct, shots[1].direct)


def test_the_sun_casts_shadows_in_which_the_sky_remains(gpu):
    shot = picture(gpu, table(block=True), environment="default", shadow_size=256)
    on_floor = shot.surface & (np.abs(shot.points[..., 1]) < 1e-3)
    levels = shot.direct[on_floor][:, 0]
    shadowed = np.isclose(levels, ALBEDO * SKY[0], rtol=1e-3)
    lit = np.isclose(levels, ALBEDO / np.pi * (np.pi * SKY + UP * SUN)[0], rtol=1e-3)
    assert shadowed.sum() > 50 and lit.sum() > 500
    assert (shadowed | lit).mean() > 0.85, "the rest is the filtered edge of the shadow"
    # The block is 1 m high: its shadow is as long as the sun's direction says.
    points = shot.points[on_floor][shadowed]
    length = 1.0 / UP * np.hypot(DEFAULT_SUN.direction[0], DEFAULT_SUN.direction[2])
    assert np.hypot(points[:, 0], points[:, 2]).max() < np.hypot(0.5, 0.5) + length
    toward = points[:, [0, 2]] @ np.array(DEFAULT_SUN.direction)[[0, 2]]
    assert toward.mean() > 0.2, "the shadow is not on the far side"


def test_a_file_with_lights_keeps_them_beside_the_sun(gpu):
    """Light adds up: file and environment together are each alone."""
    b = SceneBuilder()
    floor(b, material=lambert(b, ALBEDO))
    b.light(kind="point", intensity=20.0, translation=(0.3, 1.5, 0.2))
    look(b, (0.0, 2.5, 3.0), (0.0, 0.0, 0.0), yfov=0.7)
    scene = b.build()
    both, own, sky = (
        picture(gpu, s, environment=e, shadow_size=256)
        for s, e in ((scene, "default"), (scene, "none"), (unlit(scene), "default"))
    )
    assert worst(both.direct, own.direct + sky.direct, both.surface) < 1e-5


def unlit(scene: Scene) -> Scene:
    return replace(scene, nodes=replace(scene.nodes, light=np.full(len(scene.nodes), -1)))


@pytest.mark.parametrize("shadow_lights", [0, 1])
def test_the_sun_is_an_effect_and_no_light_of_the_scene(gpu, shadow_lights):
    """With indirect light, since the sun shines on surface patches where it has no map."""
    settings = {"environment": "default", "shadow_lights": shadow_lights, "shadow_size": 256}
    with opened(gpu, table(), columns=("direct", "indirect"), **settings) as source:
        shoot(source)
        on = {name: effect.reason for name, effect in source.effects.items() if effect.enabled}
        assert any("sky" in note for note in source.describe()["notes"])
    assert set(on) == {"sky", "sun", "direct", "indirect", *("shadows",) * shadow_lights} and all(on.values())
    counts = census(table(), [0.0, 1.0])
    assert counts["static_directional_lights"] == counts["dynamic_directional_lights"] == 0


def test_without_an_environment_nothing_of_it_is_simulated():
    effects = decide(table(), fixed_settings(environment="none"))
    assert not effects["sky"].enabled and not effects["sun"].enabled and not effects["direct"].enabled
    uniform = decide(table(), fixed_settings(environment=(1.0, 1.0, 1.0)))
    assert uniform["sky"].enabled and not uniform["sun"].enabled and not uniform["shadows"].enabled


def test_stochastic_light_of_the_default_environment_is_exact_without_indirect_light(gpu):
    """One light, unoccluded: each of its samples is the light itself."""
    shading = Shading(light_samples=1, indirect_samples=1)
    shot = picture(gpu, table(), shading=shading, columns=("direct",), environment="default", shadow_size=256)
    expected = np.broadcast_to(ALBEDO / np.pi * (np.pi * SKY + UP * SUN), shot.direct.shape)
    assert worst(shot.direct, expected, shot.surface) < 1e-3


# ---------------------------------------------------------------------------------------------------------- images
WIDE = 64
"""Columns of the images of these tests."""

BALL = 0.75
"""Base color of the balls, exact in half floats."""


def image_file(folder: Path, radiance: np.ndarray, name: str = "sky.exr") -> str:
    """Write (h, 2 h, 3) as an environment image."""
    import OpenImageIO as oiio

    path = str(folder / name)
    out = oiio.ImageOutput.create(path)
    assert out.open(path, oiio.ImageSpec(radiance.shape[1], radiance.shape[0], 3, "float"))
    assert out.write_image(np.ascontiguousarray(radiance, dtype=np.float32))
    out.close()
    return path


def ball(b: SceneBuilder, **material) -> None:
    b.node(mesh=b.mesh(replace(sphere(1.0, rings=96), material=lambert(b, BALL, **material))))


def ball_scene(**material) -> Scene:
    b = SceneBuilder()
    ball(b, **material)
    look(b, (1.5, 2.0, 3.0), (0.0, 0.0, 0.0), yfov=0.7)
    return b.build()


@pytest.mark.parametrize(
    "material", few([{"specular": 1.0, "roughness": 0.3}, {"metallic": 1.0, "roughness": 0.7}, {}])
)
def test_a_uniform_image_is_the_uniform_environment(gpu, tmp_path, material):
    sky = (0.5, 0.25, 1.0)
    path = image_file(tmp_path, np.broadcast_to(sky, (8, 16, 3)))
    columns = ("frustum", "direct", "color")
    image, uniform = (
        picture(gpu, ball_scene(**material), environment=e, columns=columns, storage="float") for e in (path, sky)
    )
    assert worst(image.direct, uniform.direct, image.surface) < 1e-5
    assert np.abs(image["color"] - uniform["color"]).max() < 1e-5, "surfaces and sky pixels"


@pytest.mark.parametrize(("metallic", "roughness"), few([(0.0, 0.3125), (1.0, 0.0625), (0.0, 0.0), (1.0, 1.0)], 1))
def test_light_of_an_image_equals_the_reference(gpu, tmp_path, metallic, roughness):
    """A mirror shows the image, rough surfaces its filtered maps; shader and float64 look up the same maps."""
    rng = np.random.default_rng(5)
    radiance = resized(rng.uniform(0.0, 2.0, (4, 8, 3)), WIDE // 2)
    path = image_file(tmp_path, radiance)
    scene = ball_scene(specular=1.0, metallic=metallic, roughness=roughness)
    shot = picture(gpu, scene, environment=path, extra=("direct_glossy",), storage="float")
    n, at = shot["normal"][..., :3], shot.surface
    v = normalize(-shot["position"][..., :3] + (~at)[..., None])
    mirror = normalize(2.0 * np.sum(n * v, axis=-1, keepdims=True) * n - v)
    maps = environment_maps(read_environment(path).radiance)
    glossy = glossy_radiance(maps, mirror, np.full(mirror.shape[:2], roughness))
    albedo = bilinear_albedo(roughness, np.maximum(np.sum(n * v, axis=-1), 1e-4))
    dielectric = 0.04 * albedo[..., 0] + albedo[..., 1]
    metal = BALL * albedo[..., 0] + albedo[..., 1]
    expected = ((1.0 - metallic) * dielectric + metallic * metal)[..., None] * glossy
    assert np.abs(shot["direct_glossy"][..., :3] - expected)[at].max() < 2e-4
    taken = 0.04 + 0.96 * albedo[..., 2]
    diffuse = (1.0 - metallic) * (1.0 - taken)[..., None] * BALL * lookup(maps.lobes[0], n)
    assert np.abs(shot.direct - expected - diffuse)[at].max() < 2e-4


def bilinear_albedo(roughness: float, n_v: np.ndarray) -> np.ndarray:
    table = albedo_table().astype(np.float64)
    last = len(table) - 1
    rows = roughness * last
    r = min(int(rows), last - 1)
    row = table[r] * (1.0 - (rows - r)) + table[r + 1] * (rows - r)
    return np.stack([np.interp(n_v * last, np.arange(last + 1), row[:, c]) for c in range(4)], axis=-1)


def test_sky_pixels_show_the_image_exposed(gpu, tmp_path):
    """Each pixel of the sky is the image in its view direction, times the exposure, sRGB-encoded."""
    radiance = resized(np.random.default_rng(3).uniform(0.0, 1.0, (4, 8, 3)), WIDE // 2)
    path = image_file(tmp_path, radiance)
    shot = picture(gpu, ball_scene(), environment=path, columns=("direct", "color"), exposure=0.5, tone_map="linear")
    h, w = shot.surface.shape
    origin, dx, dy = sky_directions(shot.view, w, h)
    x, y = np.meshgrid(np.arange(w), np.arange(h)[::-1])
    rays = normalize(origin + x[..., None] * dx + y[..., None] * dy)
    linear = 0.5 * lookup(radiance, rays)
    expected = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    sky = ~shot.surface
    assert sky.mean() > 0.3
    assert np.abs(shot["color"][..., :3] - expected)[sky].max() < 1e-3


def test_the_maps_are_predicted_and_allocated_once(gpu, tmp_path):
    path = image_file(tmp_path, np.full((8, 16, 3), 0.5))
    settings = fixed_settings(width=64, height=48, environment=path)
    predicted = frame_resources(frame_spec(AnimatedScene(ball_scene()), settings)).memory["environment"]
    assert predicted == 16 * (16 * 8 + 256 * 128 * 9)
    with opened(gpu, ball_scene(), environment=path, columns=("direct", "color")) as source:
        assert source.light.memory["environment"] == predicted


def test_sky_pixels_show_the_image_while_direct_light_is_switched_off(gpu, tmp_path):
    path = image_file(tmp_path, np.full((8, 16, 3), 0.5))
    options = {"without": ("direct",), "columns": ("direct", "color"), "environment": path, "exposure": 1.0}
    with opened(gpu, ball_scene(), **options) as source:
        shot = shoot(source)
    assert not source.effects["sky"].enabled
    assert np.allclose(shot["color"][~shot.surface][:, :3], 1.055 * 0.5 ** (1 / 2.4) - 0.055, atol=1e-3)
    assert np.all(shot["color"][shot.surface][:, :3] == 0.0)


def test_a_parallel_camera_sees_one_direction(gpu, tmp_path):
    b = SceneBuilder()
    floor(b, 0.5, material=lambert(b))
    look_down(b, 2.0)
    downwards = np.maximum(-directions(128)[..., 1:2], 0.0)
    path = image_file(tmp_path, np.repeat(downwards, 3, axis=-1))
    shot = picture(gpu, b.build(), environment=path, columns=("direct", "color"))
    sky = shot["color"][~shot.surface][:, :3]
    assert len(sky) and np.ptp(sky) == 0 and sky.max() > 0.99


def test_a_bright_small_sun_is_finite_and_keeps_its_energy(tmp_path):
    radiance = np.zeros((64, 128, 3))
    radiance[20, 30] = 1e5
    maps = environment_maps(read_environment(image_file(tmp_path, radiance)).radiance)
    solid = solid_angles(128)[:, None, None]
    assert np.all(np.isfinite(maps.lobes)) and maps.lobes.min() >= 0.0
    given = float((radiance * solid_angles(64)[:, None, None]).sum())
    diffuse = float((maps.lobes[0] * solid).sum())
    assert diffuse == pytest.approx(given, rel=1e-3), "mean irradiance / pi is the mean radiance"


@pytest.mark.parametrize(
    ("suffix", "mode"),
    [*product((".hdr", ".exr"), ("missing", "text", "cut", "not wide", "folder")), (".exr", "nan")],
)
def test_files_that_are_no_environment_answer_in_one_line(tmp_path, mode, suffix):
    path = tmp_path / f"bad{suffix}"
    good = np.random.default_rng(1).uniform(0.0, 1.0, (32, 64, 3))
    if mode == "text":
        path.write_text("hello\nworld\n")
    elif mode == "folder":
        path.mkdir()
    elif mode == "cut":
        image_file(tmp_path, good, path.name)
        path.write_bytes(path.read_bytes()[:-500])
    elif mode == "not wide":
        image_file(tmp_path, good[:, :40], path.name)
    elif mode == "nan":
        good[3, 4, 1] = np.nan
        image_file(tmp_path, good, path.name)
    with pytest.raises(SettingsError) as error:
        read_environment(path)
    assert error.value.setting == "environment" and error.value.where == str(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("height", [16, 300, 512])
def test_directions_beside_a_sun_of_one_pixel_are_likely_enough(height):
    """Bilinear values spread a sun over its neighbors: radiance over pdf is bounded."""
    image = np.full((height, 2 * height, 3), 0.5)
    image[height // 4, height // 3] = 1e7
    choice = direction_choice(image)
    cells = len(choice)
    rng = np.random.default_rng(2)
    column, row = (rng.uniform(-2.5, 3.5, (2, 4000)) + [[height // 3], [height // 4]]) / height
    theta, phi = row * np.pi, (0.5 * column - 0.5) * 2.0 * np.pi
    toward = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=-1)
    pdf = choice[(row * cells).astype(int), (column * cells).astype(int), 1]
    power = np.sum(image[..., 0] * solid_angles(height)[:, None])
    ratio = lookup(image, toward)[:, 0] / pdf / power
    # In a corner the value is a quarter of the sun's, and the cell's mean 1/64 of that pixel's share of the cell.
    assert ratio.max() < 16.0 * 1.1 * (height / cells) ** 2
    area = solid_angles(cells)[:, None]
    assert np.sum(choice[:, :-1, 1] * area) == pytest.approx(1.0, rel=1e-5)


def test_files_that_are_too_large_are_refused(tmp_path, monkeypatch):
    path = image_file(tmp_path, np.ones((32, 64, 3)))
    monkeypatch.setattr("taubench_gl.scene.environment.MAX_SIZE", (32, 16))
    with pytest.raises(SettingsError):
        read_environment(path)


@pytest.mark.long
def test_large_images_are_filtered_to_the_size_at_which_they_are_seen():
    radiance = np.random.default_rng(2).uniform(0.0, 1.0, (2048, 4096, 3)).astype(np.float32)
    maps = environment_maps(radiance)
    assert maps.seen.shape == (1024, 2048, 3)
    solid = solid_angles(1024)[:, None, None]
    given = (radiance.astype(np.float64) * solid_angles(2048)[:, None, None]).sum(axis=(0, 1))
    np.testing.assert_allclose((maps.seen * solid).sum(axis=(0, 1)), given, rtol=1e-9)


def test_negative_radiance_counts_as_black_and_is_noted(gpu, tmp_path):
    radiance = np.full((8, 16, 3), 0.5)
    radiance[0, 0] = -1.0
    path = image_file(tmp_path, radiance)
    assert read_environment(path).negative == 3 and read_environment(path).radiance.min() == 0.0
    with opened(gpu, ball_scene(), environment=path) as source:
        assert any("below 0" in note for note in source.describe()["notes"])


def test_bytes_of_an_image_are_known_before_it_is_read(tmp_path):
    path = image_file(tmp_path, np.ones((6, 12, 3)))
    assert environment_bytes(path) == read_environment(path).radiance.nbytes == 12 * 6 * 12


def test_an_image_that_changes_is_read_again(tmp_path):
    path = image_file(tmp_path, np.full((8, 16, 3), 0.5))
    first = read_environment(path)
    image_file(tmp_path, np.full((16, 32, 3), 0.25))
    second = read_environment(path)
    assert first.sha256 != second.sha256 and second.size == (32, 16)
