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
from taubench_gl.pathtraced.blender.job import Quality
from taubench_gl.pathtraced.blender.render import render_reference
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.long
SIZE = (192, 108)


def rendered(scene, out, blender, *, camera=None, frames=range(1), size=(16, 9), lobes=(), samples=1, **quality):
    """``frames`` of ``scene`` by Cycles at pixel centers, read from the folder ``out``."""
    camera = camera or choose_camera(scene)
    quality = Quality(samples=samples, crisp=True, **quality)
    render_reference(scene, camera, frames, out, fps=24.0, size=size, quality=quality, python=blender)
    return [PathTracedSequence.open(out).read(frame, lobes) for frame in frames]


@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
def test_lights_have_gltf_units(tmp_path, blender, kind):
    """Diffuse radiance below a light: base color / pi x irradiance, which is I cos / d^2 or lux.

    Cycles' principled shader uses 4 % for its specular lobe, as glTF does: single-scatter GGX.
    """
    lamp = {"light": {"type": kind, "intensity": 5.0, "color": [1.0, 0.5, 1.0]},
            "node": {"translation": [0, 2, 0], "rotation": DOWN}}  # fmt: skip
    if kind == "spot":
        lamp["light"]["spot"] = {"innerConeAngle": 0.3, "outerConeAngle": 0.6}
    scene = load_scene(plane(tmp_path / "s.glb", [lamp]))
    (frame,) = rendered(scene, tmp_path / "out", blender, size=(33, 33), lobes=("diffuse",), samples=4)
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
    rendered(scene, out, blender, camera=camera, frames=range(*case.frames), size=SIZE)
    result = compare(scene, camera, out, case.frames)
    assert not list(faults(result)), result


@pytest.mark.parametrize("ground", [True, False], ids=["lights and ground", "lights only"])
def test_hidden_lights_are_off_and_hidden_meshes_are_not_rendered(tmp_path, blender, ground):
    scene = load_scene(blinking(tmp_path / "blink.glb", ground=ground))
    before, after = rendered(scene, tmp_path / "out", blender, frames=range(11, 13))
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
        (frame,) = rendered(load_scene(path), tmp_path / name, blender, camera=camera)
        assert frame.sky.all() == all_sky


def test_the_default_environment_has_the_irradiance_of_sky_and_sun(tmp_path, blender):
    """A horizontal plane without occluders: its diffuse lobe reflects 0.96 base color (sky + 0.8 sun / pi)."""
    scene, light = load_scene(plane(tmp_path / "s.glb")), {"sky": DEFAULT_RADIANCE, "sun": DEFAULT_SUN}
    (frame,) = rendered(scene, tmp_path / "out", blender, size=(17, 17), lobes=("diffuse",), samples=256, **light)
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
    scene = load_scene(plane(tmp_path / "s.glb", eye=normalize(np.array([0.3, -0.4, 0.2, 0.8])).tolist()))
    (frame,) = rendered(scene, tmp_path / "out", blender, samples=16, image=path, image_sha256="x")
    origin, dx, dy = sky_directions(choose_camera(scene).view_at(Poser(scene).sample(0.0)), 16, 9)
    x, y = np.meshgrid(np.arange(16), np.arange(9)[::-1])
    rays = normalize(origin + x[..., None] * dx + y[..., None] * dy)
    assert frame.sky.all()
    np.testing.assert_allclose(frame.environment, 0.5 + 0.5 * rays, atol=0.01)
