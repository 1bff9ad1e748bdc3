"""Light units, metered exposure and brightness of whole runs."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from fixed import fixed_settings
from lamp_scenes import lamp_over_floor
from repeated import few

from taubench_gl.batch.spec import read_spec
from taubench_gl.batch.study import run_batch
from taubench_gl.evaluation import evaluate_scene, resolve_lighting
from taubench_gl.evaluation.brightness import Brightness
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.paths import PACKAGE
from taubench_gl.run import load_run
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, quad, turn_x
from taubench_gl.selftest.scenes import busy_room
from taubench_gl.settings import FIXED_LIGHTING, Settings

pytestmark = pytest.mark.usefixtures("coarse_metering")

AUTO = dict.fromkeys(FIXED_LIGHTING, "auto")
BLENDER = "Khronos glTF Blender I/O v4.5.51"
SIZE = {"width": 64, "height": 48}
DEMO = PACKAGE.parent / "assets" / "demo.glb"
LIGHT = ("frustum", "direct", "color")
CHEAP = {"shadow_size": 64, "probes": 32, "indirect_samples": 256}


def two_floors(albedos=(0.8, 0.2), illuminance: float = 1000.0):
    """Two Lambert half planes seen from above, under a sun at 60 degrees: radiance albedo E cos(60) / pi."""
    b = SceneBuilder()
    for side, albedo in zip((-1.0, 1.0), albedos, strict=True):
        material = b.material(base_color=(albedo,) * 3 + (1.0,), metallic=0.0, roughness=1.0, specular=0.0)
        b.node(mesh=b.mesh(quad(2.0, 4.0, material=material)), translation=(2.0 * side, 0, 0), rotation=turn_x(-90.0))
    b.light(kind="directional", intensity=illuminance, rotation=turn_x(-30.0))
    lens = {"kind": "orthographic", "xmag": 1.0, "ymag": 1.0, "znear": 0.01, "zfar": 20.0}
    b.camera(translation=(0.0, 8.0, 0.0), rotation=turn_x(-90.0), **lens)
    return b.build()


def scaled(scene, factor: float = 1.0, divisor: float = 1.0):
    """``scene`` with all intensities times ``factor``, and over ``divisor``: the bits of a quotient are its own."""
    lights = tuple(dataclasses.replace(one, intensity=one.intensity * factor / divisor) for one in scene.lights)
    return dataclasses.replace(scene, lights=lights)


def resolved(scene, **settings):
    return resolve_lighting(scene, fixed_settings(**SIZE | AUTO | {"camera": 0} | settings))


# ---------------------------------------------------------------------------------------------------------- exposure
@pytest.fixture
def whole_metering(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("taubench_gl.evaluation.exposure.METERED_PIXELS", 16384)


def test_metered_exposure_of_two_lambert_floors(whole_metering):
    scene = two_floors()
    radiance = [albedo * 1000.0 * math.cos(math.radians(60.0)) / math.pi for albedo in (0.8, 0.2)]
    expected = 0.18 / math.sqrt(radiance[0] * radiance[1])
    found = resolved(scene).settings.lighting.exposure
    assert found == pytest.approx(expected, rel=6e-4) and found == float(f"{found:.3e}")


@pytest.mark.parametrize("lamps", [3, 40])
def test_what_is_metered_is_what_every_pixel_shows_with_all_lights(lamps, gpu, whole_metering):
    """The exposure again, in float64, from whole frames of raster light, which the test draws."""
    scene = busy_room(lamps=lamps)
    settings = fixed_settings(size=(128, 72), fps=8.0 / scene.duration, columns=("direct",))
    source = RasterSource(gpu, AnimatedScene(scene), settings.replace(light_error=0.0, shadow_lights=lamps))
    values = []
    for frame in range(9):
        source.advance(frame)
        direct, surface = source.read("direct").astype(np.float64), source.read("position")[..., 3] > 0
        values.append(direct[surface][:, :3])
    source.release()
    light = np.concatenate(values)
    luminance = light @ (0.2126, 0.7152, 0.0722)
    lit = np.sort(luminance[luminance > 0])
    used = lit[(lit >= np.percentile(lit, 10)) & (lit <= np.percentile(lit, 90))]
    unclipped = 0.18 / np.exp(np.log(used).mean())
    brightest = np.sort(light[luminance > 0].max(axis=-1))[::-1]
    expected = min(unclipped, 1.0 / brightest[len(lit) // 20])
    found = resolved(scene).settings.lighting.exposure
    assert found == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("factor", few([683.0, 1.0 / 50.0]))
@pytest.mark.parametrize("lamps", few([3, 20]))
def test_metered_columns_do_not_depend_on_the_scale_of_the_lights(factor, lamps):
    settings = fixed_settings(**SIZE | AUTO | CHEAP, frames=(0, 3))
    runs = [evaluate_scene(one, settings) for one in (busy_room(lamps=lamps), scaled(busy_room(lamps=lamps), factor))]
    exposures = [run.summary["settings"]["exposure"] for run in runs]
    assert exposures[1] * factor == pytest.approx(exposures[0], rel=1e-3)
    for column, entry in runs[0].summary["discard"].items():
        other = runs[1].summary["discard"][column]["mean_percent"]
        assert other == pytest.approx(entry["mean_percent"], abs=0.1), column


@pytest.mark.parametrize(
    ("change", "exposure"),
    [
        ({"columns": ("frustum", "position")}, 1.0),
        ({"light_unit": "watt"}, 1.0),
        ({"exposure": 0.25}, 0.25),
        ({"light_unit": "candela", "exposure": 3}, 3.0),
    ],
)
def test_exposures_that_are_not_metered(change, exposure, monkeypatch):
    monkeypatch.setattr("taubench_gl.evaluation.exposure.meter", None)
    assert resolved(two_floors(), **change).settings.lighting.exposure == exposure


def test_a_scene_whose_surfaces_are_black_has_exposure_1():
    assert resolved(two_floors((0.0, 0.0))).settings.lighting.exposure == 1.0
    assert resolved(two_floors(illuminance=0.0)).settings.lighting.exposure == 1.0


def without_lights(generator=""):
    scene = two_floors()
    nodes = dataclasses.replace(scene.nodes, light=np.full_like(scene.nodes.light, -1))
    return dataclasses.replace(scene, lights=(), nodes=nodes, generator=generator)


def test_files_without_light_are_metered_whatever_wrote_them():
    found = [resolved(without_lights(generator)) for generator in ("", BLENDER)]
    assert {one.settings.lighting.environment for one in found} == {"default"}
    assert [one.settings.lighting.light_unit for one in found] == ["candela", "watt"]
    exposures = {one.settings.lighting.exposure for one in found}
    assert len(exposures) == 1 and exposures != {1.0}
    assert resolved(without_lights(), environment="none").settings.lighting.exposure == 1.0


# -------------------------------------------------------------------------------------------------------------- unit
def test_watt_is_the_file_with_intensities_over_683_bit_for_bit():
    """Emission is not divided: a luminous box moves through the image."""
    scene = lamp_over_floor(emits=2.0, lights=3)
    frames = {"frames": (0, 3), **CHEAP}
    watt = evaluate_scene(dataclasses.replace(scene, generator=BLENDER), fixed_settings(**SIZE | AUTO | frames))
    candela = evaluate_scene(scaled(scene, divisor=683.0), fixed_settings(**SIZE | frames))
    assert watt.summary["settings"]["light_unit"] == "watt" and watt.summary["settings"]["exposure"] == 1.0
    assert watt.frames == candela.frames
    assert watt.summary["curves"] == candela.summary["curves"]
    undivided = evaluate_scene(scene, fixed_settings(**SIZE | frames))
    assert undivided.summary["curves"] != candela.summary["curves"]


@pytest.mark.parametrize("factor", [683.0, 1.0 / 50.0])
def test_light_error_is_in_exposed_units(gpu, factor):
    scene = busy_room(lamps=24)
    counts = []
    for one, exposure in ((scene, 1.0), (scaled(scene, factor), 1.0 / factor)):
        settings = fixed_settings(**SIZE | CHEAP | {"exposure": exposure}, columns=("direct",), light_error=0.05)
        source = RasterSource(gpu, AnimatedScene(one), settings)
        source.advance(0)
        counts.append(source.light.tile_counts().astype(int))
        source.release()
    assert counts[0].max() > 0 and np.array_equal(*counts)


# -------------------------------------------------------------------------------------------------------- brightness


def still_pair(scene):
    """``scene`` with an animation of one second that moves nothing."""
    from taubench_gl.scene.model import Channel

    times = np.array([0.0, 1.0])
    still = Channel("node", 0, "scale", "LINEAR", times, np.ones((2, 3)))
    return dataclasses.replace(scene, channels=(still,))


@pytest.mark.parametrize(
    ("clipped", "black", "notes"), [(20, 900, 0), (21, 900, 1), (0, 901, 1), (21, 901, 2), (0, 0, 0)]
)
def test_notes_begin_above_the_documented_shares(clipped, black, notes):
    brightness = Brightness(frames=3, pixels=1000, black=black, lit=100, clipped=clipped)
    assert len(brightness.notes(fixed_settings())) == notes


def test_a_black_image_in_watt_names_candela():
    settings = fixed_settings(**SIZE | AUTO, frames=(0, 2), columns=LIGHT, camera=0)
    dim = dataclasses.replace(still_pair(two_floors(illuminance=0.05)), generator=BLENDER)
    notes = evaluate_scene(dim, settings).summary["notes"]
    assert any("--light-unit candela" in note for note in notes)
    bright = evaluate_scene(dim, settings.replace(light_unit="candela")).summary
    assert not any("--light-unit candela" in note for note in bright["notes"])
    assert bright["brightness"]["black"] == bright["brightness"]["clipped"] == 0


# ------------------------------------------------------------------------------------------------------ entry points
CONCRETE = {"light_unit": "candela", "environment": list(load_scene(DEMO).environment)}


def test_a_run_records_its_lighting(tmp_path):
    run = evaluate_scene(DEMO, fixed_settings(**SIZE | AUTO | CHEAP, frames=(0, 3), columns=LIGHT), out=tmp_path)
    stored = load_run(tmp_path).summary
    assert CONCRETE.items() <= stored["settings"].items() and 0 < stored["settings"]["exposure"] != 1.0
    assert all(stored["lighting"][name] for name in FIXED_LIGHTING)
    again = evaluate_scene(DEMO, Settings.from_dict({n: stored["settings"][n] for n in FIXED_LIGHTING}).replace(
        **SIZE | CHEAP, frames=(0, 3), columns=LIGHT))  # fmt: skip
    assert again.frames == run.frames


def test_a_batch_meters_once_and_equals_evaluate(tmp_path):
    text = f'scenes = ["{DEMO}"]\nsize = "64x48"\nframes = "0:6"\nshadow_size = 64\nlight = "raster"\n'
    text += 'columns = ["frustum", "direct", "color"]\nprobes = 32\nindirect_samples = 256\n'
    (tmp_path / "spec.toml").write_text(text)
    spec = read_spec(tmp_path / "spec.toml")
    run_batch(spec, tmp_path / "out", chunk=2)
    batch = load_run(tmp_path / "out" / "jobs" / spec.jobs[0].id).summary
    alone = evaluate_scene(DEMO, fixed_settings(**SIZE | AUTO | CHEAP, frames=(0, 6), columns=LIGHT)).summary
    for block in ("settings", "lighting", "discard", "brightness", "scale", "notes"):
        assert batch[block] == json.loads(json.dumps(alone[block])), block
    assert batch["brightness"]["frames"] == 3


def test_users_get_automatic_lighting_from_the_command_line(taubench, tmp_path):
    options = ["--columns", "frustum,direct", "--light", "preview", "--shadow-size", "64", "--out", tmp_path]
    code, out, err = taubench("evaluate", DEMO, "--size", "64x48", "--frames", "0:2", *options)
    assert code == 0, err
    settings = load_run(tmp_path).summary["settings"]
    assert CONCRETE.items() <= settings.items() and settings["exposure"] != 1.0
    assert out.count(f"exposure {settings['exposure']:.4g}") == 1
    assert (tmp_path / "tables.txt").read_text().count(f"exposure {settings['exposure']:.4g}") == 1


def test_generator_and_image_based_light_are_read_from_gltf(tmp_path):
    document = {"asset": {"version": "2.0", "generator": BLENDER}, "extensionsUsed": ["EXT_lights_image_based"]}
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    scene = load_scene(tmp_path / "a.gltf")
    assert scene.generator == BLENDER and scene.image_based_light
