"""Light that overflows float32 is refused in one line; scenes of very many parts end in bounded time and memory."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.animation import choose_camera
from taubench_gl.effects.lighting import environment_of
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.evaluation.lighting import MAX_LIGHT, require_float32, resolve_lighting
from taubench_gl.paths import PACKAGE
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Channel, Material

pytestmark = pytest.mark.usefixtures("coarse_light")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
LIT = {"width": 32, "height": 18, "columns": ("direct",), "light_unit": "candela", "environment": "none"}


@pytest.fixture(scope="module")
def demo():
    return load_scene(DEMO)


def require(scene, settings):
    require_float32(scene, settings, environment_of(settings))


def lit(scene, **changes):
    """The scene with its first light changed."""
    return dataclasses.replace(scene, lights=(dataclasses.replace(scene.lights[0], **changes), *scene.lights[1:]))


@pytest.mark.parametrize("intensity", [1e39, 3e38, 2.0 * MAX_LIGHT])
def test_intensities_that_overflow_are_refused(demo, intensity):
    bright = lit(demo, intensity=intensity, color=(1.0, 1.0, 1.0))
    for exposure in (1.0, "auto"):
        with pytest.raises(SceneError) as caught:
            resolve_lighting(bright, fixed_settings(**LIT, exposure=exposure), choose_camera(bright))
        assert demo.lights[0].name in caught.value.what
    require(bright, fixed_settings(**LIT | {"columns": ("frustum", "position")}, exposure=1.0))


def test_animated_and_exposed_intensities_count(demo):
    settings = fixed_settings(**LIT, exposure=1.0)
    values = np.array([[1.0], [1e38]])
    channel = Channel("light", 0, "intensity", "LINEAR", np.array([0.0, 1.0]), values)
    with pytest.raises(SceneError):
        require(dataclasses.replace(demo, channels=(*demo.channels, channel)), settings)
    bright = lit(demo, intensity=1e25, color=(1.0, 1.0, 1.0))
    require(bright, settings)
    with pytest.raises(SceneError):
        require(bright, settings.replace(exposure=1e10))
    require(lit(bright, intensity=6e32), settings.replace(light_unit="watt"))


def test_emission_and_environment_count(demo):
    settings = fixed_settings(**LIT, exposure=1.0)
    glowing = dataclasses.replace(demo, materials=(*demo.materials, Material(emissive=(0.0, 1e39, 0.0))))
    with pytest.raises(SceneError):
        require(glowing, settings)
    sky = settings.replace(environment="1e29,0,0")
    require(demo, sky)
    for bright in (sky.replace(exposure=1e10), settings.replace(environment=1e31)):
        with pytest.raises(SettingsError) as caught:
            require(demo, bright)
        assert caught.value.setting == "environment"
