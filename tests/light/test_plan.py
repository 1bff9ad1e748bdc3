"""What is declared before anything is drawn is what a frame then is: channels, shaders, textures, bytes."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from fixed import fixed_settings
from lamp_field import lamp_field
from light_tools import opened, shoot
from test_effects_on_demand import everything

from taubench_gl.apps.inspect_command import describe
from taubench_gl.features import COLUMNS
from taubench_gl.frame.materials import image_bytes
from taubench_gl.frame.passes.lighting import LOBES
from taubench_gl.frame.passes.pathtracing import hit_options, state_layers
from taubench_gl.frame.plan import effect_costs, frame_channels, frame_passes, frame_resources, frame_spec
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.scenes import busy_room

ASSETS = Path(__file__).resolve().parents[2] / "assets"
SIZE = {"width": 64, "height": 48, "shadow_size": 64}
CASES = {
    "everything, all columns": (everything, {}),
    "everything, no light": (everything, {"columns": ("frustum", "position")}),
    "everything, direct": (everything, {"columns": ("direct",)}),
    "everything, rsm and a sky": (everything, {"indirect": "rsm", "environment": (0.1, 0.1, 0.1)}),
    "everything, indirect alone": (everything, {"columns": ("indirect",)}),
    "a dark room in motion": (busy_room, {"reprojection": "motion"}),
    "a lit room in motion": (lambda: busy_room(lamps=3), {"reprojection": "motion"}),
    "many lights": (lambda: lamp_field(3, 20, cells=4), {"columns": ("direct", "color"), "indirect": "none"}),
}


def glass_room(**glass) -> Scene:
    """A lit room of which one material is absorbing glass with a colored lobe, or as ``glass`` says."""
    scene = busy_room(lamps=1)
    fields = {"transmission": 0.5, "thick": True, "attenuation_distance": 1.0, "attenuation_color": (0.5, 0.9, 0.9)}
    first = replace(scene.materials[0], **(fields | glass))
    return replace(scene, materials=(first, *scene.materials[1:]))


@pytest.mark.parametrize("case", CASES)
def test_the_plan_is_what_is_made(gpu, case):
    make, chosen = CASES[case]
    check(gpu, make(), SIZE | {"columns": COLUMNS} | chosen)


REAL = ("CesiumMan.glb", "LightsPunctualLamp.gltf", "AlphaBlendModeTest.glb", "04_lights.gltf")


@pytest.mark.parametrize("name", REAL)
def test_real_scenes_are_planned_right(gpu, data, name):
    (path,) = data.rglob(name)
    check(gpu, load_scene(path), SIZE | {"columns": COLUMNS})


def test_the_demo_is_planned_right(gpu):
    check(gpu, load_scene(ASSETS / "demo.glb"), SIZE | {"columns": COLUMNS})


def check(gpu, scene, chosen) -> None:
    settings = fixed_settings(**chosen)
    spec = frame_spec(AnimatedScene(scene), settings)
    resources = frame_resources(spec)
    with opened(gpu, scene, **chosen) as source:
        shoot(source, 0)
        assert source.effects == spec.effects
        assert source.channels == frame_channels(spec)
        made = Counter(name.split(" [")[0] for name in source.context.shaders.names)
        pools = source.renderer.buffers.bytes - resources.memory.get("previous vertices", 0)
        held = source.describe()["memory"]["gpu_bytes"]
    planned = Counter(name.split(" [")[0] for name in resources.shaders if not name.startswith("masks/"))
    assert made == planned
    assert sum(resources.memory.values()) + pools == held


@pytest.mark.parametrize(
    "columns", [COLUMNS, ("frustum",), ("direct",), ("indirect",), ("color",), ("position", "normal")]
)
@pytest.mark.parametrize("effects", ["auto", "all"])
@pytest.mark.parametrize("mode", ["camera", "motion"])
@pytest.mark.parametrize(
    "make", [partial(busy_room, lamps=20), lambda: load_scene(ASSETS / "demo.glb")], ids=["room", "demo"]
)
def test_every_frame_can_run(columns, effects, mode, make):
    settings = fixed_settings(**SIZE, columns=columns, effects=effects, reprojection=mode)
    scene = make()
    spec = frame_spec(AnimatedScene(scene), settings, extra=("base_color",))
    names = [p.name for p in frame_passes(spec)]  # raises where a pass reads what none has written
    assert names[-1] == "masks" and "base_color" in frame_channels(spec)
    assert {"direct", "indirect", "color"} & set(names) == {
        n for n in ("direct", "indirect", "color") if spec.effects[n].enabled
    }


def test_scenes_without_glass_have_nothing_of_it():
    """The macros, layers and tables of glass exist where a surface that is drawn needs them, and only there."""
    kinds = {
        (): {"transmission": 0.0, "thick": True},
        ("DIELECTRICS",): {"transmission": 0.0, "ior": 1.8},
        ("DIELECTRICS", "TRANSMISSION"): {"attenuation_color": (1.0, 1.0, 1.0)},
        ("DIELECTRICS", "TRANSMISSION", "VOLUME"): {},
    }
    memory = []
    for macros, fields in kinds.items():
        settings = fixed_settings(**SIZE, light="path-traced", spp=1)
        spec = frame_spec(AnimatedScene(glass_room(**fields)), settings)
        resources, options = frame_resources(spec), hit_options(spec)
        traced = [name for name in resources.shaders if name.startswith("pathtracing/")]
        assert traced
        for macro in ("DIELECTRICS", "TRANSMISSION", "VOLUME"):
            assert all((f"{macro} " in name or f"{macro}]" in name) == (macro in macros) for name in traced)
        assert (options.material_texels > 16) == options.dielectrics == ("DIELECTRICS" in macros)
        assert state_layers(spec) == 12 + ("DIELECTRICS" in macros) + 5 * ("TRANSMISSION" in macros)
        memory.append(sum(resources.memory.values()))
        plain = frame_spec(AnimatedScene(glass_room(**fields)), fixed_settings(**SIZE))
        assert not any(plain.glass.values()), "the preview has none of it"
    assert memory[0] < memory[1] < memory[2] == memory[3]


def test_one_lobe_makes_direct_light_write_both():
    spec = frame_spec(AnimatedScene(busy_room(lamps=2)), fixed_settings(**SIZE))
    assert not set(LOBES) & set(frame_channels(spec))
    assert set(LOBES) <= set(frame_channels(replace(spec, extra=("direct_glossy",))))


def test_a_channel_is_allocated_only_where_a_pass_reads_or_writes_it():
    spec = frame_spec(AnimatedScene(everything()), fixed_settings(**SIZE, columns=("frustum", "position")))
    assert frame_channels(spec) == ("position", "normal")
    assert frame_channels(replace(spec, extra=("ids",))) == ("position", "normal", "ids")


def test_inspect_needs_no_context(monkeypatch):
    monkeypatch.setattr("moderngl.create_context", None)
    assert describe(everything(), fixed_settings(**SIZE))["effects"]["direct"]["passes"]


def test_costs_are_what_a_frame_loses_without_the_effect():
    costs = effect_costs(AnimatedScene(everything()), fixed_settings(**SIZE))
    pixels = SIZE["width"] * SIZE["height"]
    assert costs["color"]["on"] and costs["color"]["passes"] == ["color"]
    # Without shadow maps every light shines on surface patches, which are fewer VPLs.
    assert costs["shadows"]["textures"] == ["indirect buffers", "shadow atlas"]
    assert costs["previous_pose"] == {
        "on": False,
        "reason": "no surface moves by itself",
        "passes": [],
        "textures": ["prev_position"],
        "shaders": costs["previous_pose"]["shaders"],
        "gpu_bytes": 2 * 16 * pixels,
    }
    assert costs["normal_maps"]["textures"] == ["image 0"] and costs["normal_maps"]["gpu_bytes"] == 4 * 4 * 4 * 4 // 3
    assert costs["spot_lights"]["on"] is False and costs["spot_lights"]["gpu_bytes"] == 0


@pytest.mark.parametrize("size", [(1, 1), (4, 4), (256, 64)])
def test_bytes_of_an_image_are_those_of_its_mipmaps(size):
    """Four bytes a texel; the levels of a square of a power of two add up to a third more, rounded down."""
    levels = 1 + max(size).bit_length() - 1
    texels = sum(max(size[0] >> k, 1) * max(size[1] >> k, 1) for k in range(levels))
    assert image_bytes(size) == pytest.approx(4 * texels, rel=0.02, abs=4)
