"""What is off costs nothing, and forcing everything on changes no count."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings
from light_tools import FLAT, lambert, opened, shoot
from repeated import few

from taubench_gl.errors import TaubenchError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, box, quad
from taubench_gl.scene.model import Image, Scene, Texture
from taubench_gl.selftest.scenes import busy_room

TINY = {"width": 32, "height": 24, "frames": (0, 3), "shadow_size": 64, "indirect_samples": 64, "probes": 16}


def differences(scene: Scene, **settings) -> list[str]:
    """Counts that differ between ``auto`` and ``all``, in every column that both measure."""
    auto, forced = (
        evaluate_scene(scene, fixed_settings(effects=effects, **(TINY | settings))).frames
        for effects in ("auto", "all")
    )
    assert len(auto) == len(forced)
    return [
        f"frame {a['frame']}: {name} is {a[name]} on demand, {b[name]} with everything on"
        for a, b in zip(auto, forced, strict=True)
        for name in a
        if a[name] is not None and b.get(name) is not None and a[name] != b[name]
    ]


@pytest.mark.parametrize("step", [11, pytest.param(1, marks=pytest.mark.long)])
def test_over_all_real_scenes_nothing_changes(data: Path, step: int):
    files = [p for p in sorted(data.rglob("*")) if p.suffix in (".gltf", ".glb")]
    files = [p for p in files if not p.relative_to(data).parts[0].startswith("bad_")][::step]
    faults, evaluated = [], 0
    for number, path in enumerate(files):
        try:
            scene = load_scene(path)
            # Half of them each: motion reprojection is what asks for previous poses.  A third of them each: no
            # environment, the default environment, and that of ``auto``, which is the default one without own light.
            settings = {"reprojection": ("camera", "motion")[number % 2]}
            settings["environment"] = ("none", "default", "auto")[number % 3]
            faults += [f"{path.name}: {d}" for d in differences(scene, **settings)]
        except TaubenchError:
            continue  # files without triangles, or whose images are missing: refused elsewhere
        evaluated += 1
    assert evaluated > 100 // step, f"only {evaluated} of {len(files)} scenes could be evaluated"
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    "settings",
    few([
        {}, {"indirect": "rsm", "environment": "default", "reprojection": "motion"}, {"environment": (0.2, 0.3, 0.4)},
        {"environment": "default"}, {"reprojection": "motion"}, {"indirect": "rsm"},
    ], 2),
)  # fmt: skip
def test_in_a_lit_room_nothing_changes(settings):
    assert not differences(busy_room(lamps=3), **settings)
    assert not differences(busy_room(lamps=20), light_error=0.0, **settings)


@pytest.mark.parametrize("shadow_lights", few([1, 0]))
def test_under_the_default_environment_alone_nothing_changes(shadow_lights):
    scene = everything()
    dark = dataclasses.replace(scene, nodes=dataclasses.replace(scene.nodes, light=np.full(len(scene.nodes), -1)))
    assert not differences(dark, environment="default", shadow_lights=shadow_lights, exposure=0.2)
    assert not differences(dark, environment="auto", exposure="auto", shadow_lights=shadow_lights)


def everything() -> Scene:
    """One of everything that can be switched off."""
    pixels = np.full((4, 4, 4), 255, dtype=np.uint8)
    b = SceneBuilder()
    mapped = b.material(base_color=(0.5, 0.5, 0.5, 1.0), roughness=0.5, normal_texture=Texture(0))
    uv = (quad().positions[:, :2] * 0.5 + 0.5).astype(np.float32)
    b.node(mesh=b.mesh(dataclasses.replace(quad(3, 3, material=mapped), texcoords=(uv, None))), rotation=FLAT)
    b.node(mesh=b.mesh(box((0.3, 0.3, 0.3), material=b.material(emissive=(1.0, 0.5, 0.0)))), translation=(0, 0.3, 0))
    b.light(translation=(1.0, 1.5, 0.0), kind="point", intensity=10.0)
    b.camera(translation=(0.0, 1.0, 3.0))
    return dataclasses.replace(b.build(), images=(Image("flat", (4, 4), lambda: pixels),))


class Census:
    """What a source of one frame has: channels, ``variants`` of shaders compiled and their names, bytes on the GPU."""

    def __init__(self, gpu, scene: Scene, **settings):
        with opened(gpu, scene, **settings) as source:
            shoot(source, 0)
            self.channels = source.channels
            self.variants = source.context.shaders.names
            self.shaders = sorted(name.split(" [")[0] for name in self.variants)
            self.bytes = source.describe()["memory"]["gpu_bytes"]


GBUFFER = "gbuffer/gbuffer.vert.glsl + gbuffer/gbuffer.frag.glsl"
SHADOW = "gbuffer/gbuffer.vert.glsl + shadow/shadow.frag.glsl"
LIGHTING, COLOR = "lighting/lighting.comp.glsl", "color/color.comp.glsl"


def test_columns_without_light_need_no_light(gpu):
    c = Census(gpu, everything(), columns=("frustum", "position"))
    assert c.channels == ("position", "normal")
    assert c.shaders == [GBUFFER] and "NORMAL_MAP" in c.variants[0]


def test_the_normal_map_is_sampled_once_a_column_shows_it(gpu):
    off, on = (Census(gpu, everything(), columns=columns) for columns in (("position",), ("position", "normal")))
    assert on.bytes > off.bytes
    assert on.shaders == [GBUFFER, GBUFFER]  # the mapped floor and the plain box differ now


def test_direct_alone_needs_neither_color_nor_emission(gpu):
    c = Census(gpu, everything(), columns=("direct",), shadow_lights=0)
    assert set(c.shaders) == {GBUFFER, LIGHTING}
    assert not {"emission", "color", "indirect"} & set(c.channels)


@pytest.mark.parametrize(("light", "written"), [("raster", ()), ("path-traced", ("direct", "indirect", "path_info"))])
def test_only_light_of_random_numbers_can_be_computed_again(gpu, light, written):
    """What ``LightStage.relight`` writes, for reuse methods that shade surfaces of the frame before."""
    with opened(gpu, busy_room(lamps=2), light=light, shadow_size=64, probes=32) as source:
        assert source.light.written == written


def test_shadows_add_one_atlas_and_their_shaders(gpu):
    off, on = (Census(gpu, everything(), columns=("direct",), shadow_lights=n, shadow_size=64) for n in (0, 1))
    assert set(on.shaders) - set(off.shaders) == {SHADOW}
    assert on.bytes - off.bytes == 4 * (64 * 4096)  # one shelf of the atlas


def test_a_dark_scene_that_glows_computes_no_direct_light(gpu):
    scene = everything()
    dark = dataclasses.replace(scene, nodes=dataclasses.replace(scene.nodes, light=np.full(len(scene.nodes), -1)))
    c = Census(gpu, dark, columns=("direct", "color"))
    assert set(c.shaders) == {GBUFFER, COLOR}
    assert "direct" not in c.channels and "material" not in c.channels and "emission" in c.channels


def test_a_dark_scene_has_no_color_either(gpu):
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad()))
    b.camera(translation=(0, 0, 3))
    c = Census(gpu, b.build(), columns=("direct", "indirect", "color"))
    assert c.channels == ("position", "normal") and c.shaders == [GBUFFER]


@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
def test_only_the_light_kinds_of_the_scene_are_compiled(gpu, kind):
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(material=lambert(b))))
    b.light(translation=(0, 0, 2), kind=kind)
    b.camera(translation=(0, 0, 3))
    with opened(gpu, b.build(), columns=("direct",)) as source:
        on = {name for name, effect in source.effects.items() if effect.enabled}
    assert on == {f"{kind}_lights", "direct", "shadows"}  # Lambert: not even a glossy lobe


def test_everything_can_be_forced_on(gpu):
    c = Census(gpu, everything(), columns=("frustum", "position"), effects="all", shadow_size=64)
    assert {"direct", "color", "emission", "base_color"} <= set(c.channels)
    assert {LIGHTING, COLOR, SHADOW} & set(c.shaders) >= {LIGHTING, COLOR}
