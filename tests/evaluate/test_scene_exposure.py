"""The exposure of a scene: one number for every size, slice, rate, column, method, seed and command, cached or not."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from click.testing import CliRunner
from fixed import fixed_settings
from repeated import few

from taubench_gl.animation import OrbitCamera, View, camera_of_run, choose_camera
from taubench_gl.apps.cli import cli
from taubench_gl.datasets.camera_path import PRESETS
from taubench_gl.datasets.stress import Moves, stress
from taubench_gl.evaluation import resolve_lighting
from taubench_gl.evaluation.exposure import FOLDER, _cache_file, _metering
from taubench_gl.paths import ASSETS, CACHE_VARIABLE
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera
from taubench_gl.selftest.bench import MovingCamera
from taubench_gl.settings import FIXED_LIGHTING

DEMO = ASSETS / "demo.glb"
AUTO = dict.fromkeys(FIXED_LIGHTING, "auto") | {"environment": "none"}  # whose frames are metered by rays, at length
CHANGES = [
    {"size": "64x36", "frames": (0, 2), "columns": ("color",), "seed": 7, "pairs": "every:5"},
    {"size": "37x91", "frames": (40, 60), "fps": 60, "reprojection": "motion", "samples_per_pixel": 4},
    {"size": "1920x1080", "light_error": 0.5, "indirect": "none", "shadow_size": 64, "storage": "half"},
]


pytestmark = pytest.mark.usefixtures("coarse_metering")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture(scope="module")
def expected(coarse_metering: None) -> float:
    """The exposure of the demo, metered without a cache."""
    return exposure(dataclasses.replace(load_scene(DEMO), sha256=None))


def exposure(scene, **settings) -> float:
    return resolve_lighting(scene, fixed_settings(**AUTO | settings)).settings.lighting.exposure


@pytest.mark.parametrize("change", CHANGES, ids=str)
def test_nothing_of_a_run_changes_the_exposure(change, cache, expected):
    scene = load_scene(DEMO)
    assert exposure(scene, **change) == expected != 1.0


@pytest.mark.parametrize("camera", few(["orbit", None]))
def test_with_and_without_the_cache(camera, cache):
    scene = load_scene(DEMO)
    first = exposure(scene, camera=camera)
    files = list((cache / FOLDER).iterdir())
    assert len(files) == 1 and json.loads(files[0].read_text()) == first
    assert exposure(scene, camera=camera) == first
    assert exposure(dataclasses.replace(scene, sha256=None), camera=camera) == first
    files[0].write_text("{")
    assert exposure(scene, camera=camera) == first
    assert json.loads(files[0].read_text()) == first


def test_the_cache_is_read(cache, expected):
    scene = load_scene(DEMO)
    exposure(scene)
    next((cache / FOLDER).iterdir()).write_text("0.125")
    assert exposure(scene) == 0.125
    assert exposure(scene, light_unit="watt") != 0.125  # another light, another exposure
    brighter = tuple(dataclasses.replace(light, intensity=2.0 * light.intensity) for light in scene.lights)
    changed = dataclasses.replace(scene, lights=brighter)
    assert exposure(changed) == pytest.approx(0.5 * expected, rel=2e-3)


def test_files_of_the_cache(cache):
    """Other defaults of the metering have one of their own; none: a scene made in memory, a camera of the caller."""
    scene = load_scene(DEMO)
    metering = _metering(fixed_settings(light_unit="candela", environment="none"))
    camera = camera_of_run(scene, metering.sequence)
    own = MovingCamera(lambda time: View(np.zeros(3), np.eye(3), Camera()))
    changed = (metering, metering.replace(shadow_size=128), metering.replace(spp=2))
    assert len({_cache_file(scene, m, camera) for m in changed} - {None}) == 3
    assert _cache_file(dataclasses.replace(scene, sha256=None), metering, camera) is None
    assert _cache_file(scene, metering, own) is None


def test_an_orbit_for_another_image_gives_the_same_exposure(cache, expected):
    scene = load_scene(DEMO)
    tall = OrbitCamera(scene, size=(10, 90))
    found = {resolve_lighting(scene, fixed_settings(**AUTO, light="raster"), tall).settings.lighting.exposure}
    assert found == {exposure(scene, camera="orbit")}
    assert (
        resolve_lighting(scene, fixed_settings(**AUTO, light="raster"), choose_camera(scene)).settings.lighting.exposure
        == expected
    )


@pytest.mark.long
def test_added_motion_does_not_change_the_exposure(cache, tmp_path):
    spec = dataclasses.replace(PRESETS["fps"], frames=60)
    stress(DEMO, tmp_path / "hard.glb", spec, Moves(lights=1))
    hard = load_scene(tmp_path / "hard.glb")
    assert hard.exposure == exposure(hard) == exposure(load_scene(DEMO), environment="auto")


@pytest.mark.parametrize("light", ["raster", "path-traced", "auto"])
def test_an_environment_is_metered_path_traced_whatever_the_method(light, cache):
    """A white floor under the default environment: radiance 2, so 0.09."""
    from taubench_gl.scene.builder import SceneBuilder, quad, turn_x

    b = SceneBuilder()
    white = b.material(base_color=(1.0, 1.0, 1.0, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=white)), rotation=turn_x(-90.0))
    b.camera(translation=(0.0, 2.0, 0.0), rotation=turn_x(-90.0))
    found = exposure(b.build(), light=light, environment="auto", camera=0, spp=1)
    assert found == pytest.approx(0.09, rel=0.02)


def test_inspect_prints_the_exposure(cache):
    expected = exposure(dataclasses.replace(load_scene(DEMO), sha256=None), environment="auto")
    done = CliRunner().invoke(cli, ["inspect", str(DEMO), "--json"])
    assert done.exit_code == 0, done.output
    facts = json.loads(done.stdout)["exposure"]
    assert facts["value"] == expected and facts["reason"]
