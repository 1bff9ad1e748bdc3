"""With Blender (long): light units in closed form, and the rasterizer against pixel-center renders of real scenes."""

from __future__ import annotations

import json
import math
import shutil

import numpy as np
import pytest
from cycles_scenes import BASE_COLOR, DOWN, blinking, plane
from reference_scenes import CASES, compare, faults, open_case

from taubench_gl.animation import Poser, choose_camera
from taubench_gl.animation.pairs import sky_directions
from taubench_gl.effects.lighting import DEFAULT_RADIANCE, DEFAULT_SUN
from taubench_gl.math3d import normalize
from taubench_gl.metrics.environment import directions
from taubench_gl.metrics.lighting import ALBEDO_TABLE, albedo_table
from taubench_gl.pathtraced.blender.job import Quality
from taubench_gl.pathtraced.blender.render import render_reference
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.long
SIZE = (192, 108)


@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
def test_lights_have_gltf_units(tmp_path, blender, kind):
    """Diffuse radiance below a light: base color / pi x irradiance, which is I cos / d^2 or lux.

    Cycles' principled shader uses 4 % for its specular lobe, as glTF does: single-scatter GGX.
    """
    lamp = {"light": {"type": kind, "intensity": 5.0, "color": [1.0, 0.5, 1.0]},
            "node": {"translation": [0, 2, 0], "rotation": DOWN}}  # fmt: skip
    if kind == "spot":
        lamp["light"]["spot"] = {"innerConeAngle": 0.3, "outerConeAngle": 0.6}
    scene = load_scene(plane(tmp_path / "s.gltf", [lamp]))
    out = tmp_path / "out"
    quality = Quality(samples=4, crisp=True)
    render_reference(
        scene, choose_camera(scene), range(1), out, fps=24.0, size=(33, 33), quality=quality, python=blender
    )
    frame = PathTracedSequence.open(out).read(0, ("diffuse",))
    ray = frame.position - np.array([0.0, 2.0, 0.0])
    distance = np.linalg.norm(ray, axis=-1)
    irradiance = np.full((33, 33), 5.0) if kind == "directional" else 5.0 * (2.0 / distance) / distance**2
    inside = np.degrees(np.arccos(2.0 / distance)) < math.degrees(0.2)
    expected = np.array(BASE_COLOR) / math.pi * irradiance[..., None] * [1.0, 0.5, 1.0]
    np.testing.assert_allclose(frame.lobes["diffuse_direct"][inside], 0.96 * expected[inside], rtol=0.005)
    assert frame.radiance["indirect"].max() == 0.0


@pytest.mark.parametrize("name", CASES)
def test_the_rasterizer_agrees_with_crisp_cycles(data, tmp_path, blender, name):
    case, out = CASES[name], tmp_path / "out"
    scene, camera = open_case(case, data)
    quality = Quality(samples=1, crisp=True)
    render_reference(scene, camera, range(*case.frames), out, fps=24.0, size=SIZE, quality=quality, python=blender)
    result = compare(scene, camera, out, case.frames)
    assert not list(faults(result)), result


def render_small(scene, out, frames, blender):
    quality = Quality(samples=1, crisp=True)
    render_reference(scene, choose_camera(scene), frames, out, fps=24.0, size=(16, 9), quality=quality, python=blender)
    sequence = PathTracedSequence.open(out)
    return [sequence.read(frame) for frame in frames]


@pytest.mark.parametrize("ground", [True, False], ids=["lights and ground", "lights only"])
def test_hidden_lights_are_off_and_hidden_meshes_are_not_rendered(tmp_path, blender, ground):
    scene = load_scene(blinking(tmp_path / "blink.gltf", ground=ground))
    before, after = render_small(scene, tmp_path / "out", range(11, 13), blender)
    surface = ~before.sky
    assert surface.any() and before.radiance["direct"][surface].min() > 0.01
    assert after.sky.all() if ground else (after.sky == before.sky).all()
    assert after.radiance["direct"].max() == 0.0


def test_a_hidden_skinned_mesh_is_not_rendered(data, tmp_path, blender):
    folder = tmp_path / "model"
    shutil.copytree(data / "blender_io" / "03_skinned_cylinder", folder)
    path = folder / "03_skinned_cylinder.gltf"
    root = json.loads(path.read_text())
    camera = choose_camera(load_scene(path))
    for node in root["nodes"]:
        if "mesh" in node:
            node["extensions"] = {"KHR_node_visibility": {"visible": False}}
    root["extensionsUsed"] = [*root.get("extensionsUsed", ()), "KHR_node_visibility"]
    for name, text, all_sky in (("shown", path.read_text(), False), ("hidden", json.dumps(root), True)):
        path.write_text(text)
        quality = Quality(samples=1, crisp=True)
        out = tmp_path / name
        render_reference(
            load_scene(path), camera, range(1), out, fps=24.0, size=(16, 9), quality=quality, python=blender
        )
        assert PathTracedSequence.open(out).read(0).sky.all() == all_sky


def test_the_default_environment_has_the_irradiance_of_sky_and_sun(tmp_path, blender):
    """A horizontal plane without occluders: its diffuse lobe reflects 0.96 base color (sky + 0.8 sun / pi)."""
    scene, out = load_scene(plane(tmp_path / "s.gltf")), tmp_path / "out"
    quality = Quality(samples=256, crisp=True, sky=DEFAULT_RADIANCE, sun=DEFAULT_SUN)
    render_reference(
        scene, choose_camera(scene), range(1), out, fps=24.0, size=(17, 17), quality=quality, python=blender
    )
    frame = PathTracedSequence.open(out).read(0, ("diffuse",))
    light = np.array(DEFAULT_RADIANCE) + 0.8 * np.array(DEFAULT_SUN.irradiance) / math.pi
    expected = 0.96 * np.array(BASE_COLOR) * light
    np.testing.assert_allclose(frame.lobes["diffuse_direct"][~frame.sky].mean(axis=0), expected, rtol=0.005)


def test_environment_images_are_oriented_as_in_the_rasterizer(tmp_path, blender):
    """The color of an image names its direction; Cycles' sky pixels show their own view directions."""
    import OpenImageIO as oiio

    path = str(tmp_path / "sky.exr")
    file = oiio.ImageOutput.create(path)
    file.open(path, oiio.ImageSpec(512, 256, 3, "float"))
    file.write_image(np.ascontiguousarray(0.5 + 0.5 * directions(256), dtype=np.float32))
    file.close()
    root = json.loads(plane(tmp_path / "s.gltf").read_text())
    root["nodes"][1] |= {"rotation": normalize(np.array([0.3, -0.4, 0.2, 0.8])).tolist()}
    (tmp_path / "s.gltf").write_text(json.dumps(root))
    scene, out = load_scene(tmp_path / "s.gltf"), tmp_path / "out"
    camera, quality = choose_camera(scene), Quality(samples=16, crisp=True, image=path, image_sha256="x")
    render_reference(scene, camera, range(1), out, fps=24.0, size=(16, 9), quality=quality, python=blender)
    frame = PathTracedSequence.open(out).read(0)
    origin, dx, dy = sky_directions(camera.view_at(Poser(scene).sample(0.0)), 16, 9)
    x, y = np.meshgrid(np.arange(16), np.arange(9)[::-1])
    rays = normalize(origin + x[..., None] * dx + y[..., None] * dy)
    assert frame.sky.all()
    np.testing.assert_allclose(frame.environment, 0.5 + 0.5 * rays, atol=0.01)


PRINCIPLED = {
    (0.1, 0): (0.960, 0.040), (0.1, 70): (0.830, 0.171), (0.3, 45): (0.948, 0.051), (0.3, 85): (0.610, 0.340),
    (0.6, 0): (0.959, 0.034), (0.6, 70): (0.902, 0.074), (1.0, 45): (0.955, 0.017), (1.0, 85): (0.920, 0.061),
}  # fmt: skip
"""Roughness, view angle (degrees) -> directional albedo of Principled BSDF's dielectric: diffuse lobe of a white base
color, glossy lobe.  docs/path-traced.md compares them with glTF's."""


@pytest.mark.parametrize("roughness, degrees", PRINCIPLED)
def test_a_principled_dielectric_has_another_albedo_than_gltf(tmp_path, blender, roughness, degrees):
    path = plane(tmp_path / "s.gltf")
    root = json.loads(path.read_text())
    angle = math.radians(degrees)
    half = 0.5 * (angle - 0.5 * math.pi)
    root["nodes"][1] |= {"translation": [0, 3 * math.cos(angle), 3 * math.sin(angle)],
                         "rotation": [math.sin(half), 0, 0, math.cos(half)]}  # fmt: skip
    root["cameras"][0]["perspective"]["yfov"] = 0.01
    root["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] = roughness
    path.write_text(json.dumps(root))
    scene, out, quality = load_scene(path), tmp_path / "out", Quality(samples=512, crisp=True, sky=(1.0, 1.0, 1.0))
    render_reference(scene, choose_camera(scene), range(1), out, fps=24.0, size=(8, 8), quality=quality, python=blender)
    frame = PathTracedSequence.open(out).read(0, ("diffuse", "glossy"))
    diffuse = (frame.lobes["diffuse_direct"] / BASE_COLOR).mean()
    glossy = frame.lobes["glossy_direct"].mean()
    np.testing.assert_allclose((diffuse, glossy), PRINCIPLED[roughness, degrees], atol=0.003)
    last = ALBEDO_TABLE - 1
    x, y, z, _ = albedo_table()[round(roughness * last), round(math.cos(angle) * last)]
    own = 1.0 - 0.04 - 0.96 * z, 0.04 * x + y
    assert abs(glossy - own[1]) < 0.06
    assert diffuse < own[0] + 0.003 if degrees <= 45 else diffuse < own[0]
