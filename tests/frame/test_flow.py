"""What passes say they read is what their shaders read; an order that cannot work is told before drawing."""

from __future__ import annotations

import dataclasses

import pytest
from frame_tools import THRESHOLDS, find_scene

from taubench_gl.animation import choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.channels import CHANNELS
from taubench_gl.conventions import COLUMNS
from taubench_gl.effects.decide import decide
from taubench_gl.frame.flow import LOBES, PassFlow, channels_of, faults_of, frame_flow, light_flow
from taubench_gl.frame.passes.masks import MaskPass
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.paths import PACKAGE
from taubench_gl.scene import load_scene
from taubench_gl.selftest.scenes import busy_room
from taubench_gl.settings import Settings

SMALL = Settings.of(width=16, height=12, shadow_size=16, probes=8, indirect_samples=32)
PASSES_OF = {
    "lighting/lighting.comp.glsl": ("direct",),
    "lighting/cull.comp.glsl": ("direct",),
    "lighting/stochastic.comp.glsl": ("direct", "indirect"),
    "indirect/apply.comp.glsl": ("indirect",),
    "indirect/gather.comp.glsl": ("indirect",),
    "color/color.comp.glsl": ("color",),
    "masks/masks.comp.glsl": ("masks",),
}
"""Entry point -> the passes that speak for it.  The other shaders work on textures of their own."""


def lit_scene():
    """Moving, lit, and with something that glows."""
    scene = busy_room(lamps=20)
    glow = dataclasses.replace(scene.materials[0], emissive=(0.2, 0.2, 0.2))
    return dataclasses.replace(scene, materials=(glow, *scene.materials[1:]))


def used(program) -> PassFlow:
    """What a compiled shader does with channels; uniforms that it does not use are not there."""
    found: dict[str, list[str]] = {"reads": [], "writes": [], "history": []}
    for name in CHANNELS:
        for kind, uniform in (("reads", name), ("writes", f"{name}_out"), ("history", f"history_{name}")):
            if uniform in program:
                found[kind].append(name)
    return PassFlow("compiled", **{kind: tuple(names) for kind, names in found.items()})


@pytest.mark.parametrize(
    ("settings", "shading"),
    [
        (SMALL, None),
        (SMALL.replace(reprojection="motion", indirect="rsm", sky=(0.1, 0.1, 0.1)), None),
        (SMALL.replace(columns=("direct",)), None),
        (SMALL.replace(columns=("direct", "indirect")), Shading(light_samples=1, indirect_samples=1)),
    ],
    ids=["all", "rsm, sky and motion", "direct alone", "at random"],
)
def test_shaders_read_what_their_pass_declares(gpu, settings, shading):
    scene = lit_scene()
    source = RasterSource(gpu, scene, choose_camera(scene), settings, shading=shading)
    shaders = ShaderCache(gpu.ctx)
    masks = MaskPass(
        gpu,
        shaders,
        source.size,
        reprojection=source.reprojection,
        radiance=source.radiance,
        cuts=source.cuts,
    )
    try:
        before, now = source.advance(0), source.advance(1)
        masks.run(reprojection(now, before, *source.size), THRESHOLDS, source.current, source.previous)
        declared = {p.name: p for p in frame_flow(source.effects)}
        seen = set()
        for cache in (source.renderer.shaders, shaders):
            for (entries, *_), program in cache._programs.items():
                found, names = used(program), PASSES_OF.get(entries[-1], ())
                seen.update(names)
                for kind in ("reads", "writes", "history") if names else ():
                    told = {channel for name in names for channel in getattr(declared[name], kind)}
                    assert set(getattr(found, kind)) <= told, (entries, kind)
        assert {"direct", "masks"} <= seen
        assert set(source.channels) == set(channels_of(declared.values()))
    finally:
        masks.release()
        shaders.release()
        source.release()
        gpu.collect()


def test_direct_light_with_all_it_can_do_reads_all_that_it_declares(gpu):
    scene = lit_scene()
    source = RasterSource(gpu, scene, choose_camera(scene), SMALL)
    try:
        source.advance(0)
        (program,) = (
            p for (e, *_), p in source.renderer.shaders._programs.items() if e == ("lighting/lighting.comp.glsl",)
        )
        (direct,) = (p for p in frame_flow(source.effects) if p.name == "direct")
        assert used(program) == dataclasses.replace(direct, name="compiled")
    finally:
        source.release()
        gpu.collect()


@pytest.mark.parametrize(
    "columns", [COLUMNS, ("frustum",), ("direct",), ("indirect",), ("color",), ("position", "normal")]
)
@pytest.mark.parametrize("effects", ["auto", "all"])
@pytest.mark.parametrize("mode", ["camera", "motion"])
def test_every_frame_can_run(columns, effects, mode, data):
    settings = SMALL.replace(columns=columns, effects=effects, reprojection=mode)
    paths = (PACKAGE.parent / "assets" / "demo.glb", find_scene(data, "CesiumMan.glb"))
    for scene in (lit_scene(), *map(load_scene, paths)):
        found = decide(scene, settings)
        flow = frame_flow(found, ("base_color",))
        assert faults_of(flow) == []
        assert [p.name for p in flow][:1] == ["gbuffer"] and flow[-1].name == "masks"
        assert {p.name for p in light_flow(found)} == {n for n in ("direct", "indirect", "color") if found[n].enabled}
        assert "base_color" in flow[0].writes


def test_a_lobe_makes_direct_light_write_both():
    effects = decide(lit_scene(), SMALL)
    assert not set(LOBES) & set(channels_of(frame_flow(effects)))
    assert set(LOBES) <= set(channels_of(frame_flow(effects, ("direct_glossy",))))


def test_every_fault_is_told_at_once():
    flow = [
        PassFlow("gbuffer", writes=("position",)),
        PassFlow("color", reads=("position", "direct", "nothing"), writes=("color",)),
        PassFlow("direct", reads=("position",), writes=("direct", "position")),
        PassFlow("masks", reads=("color",), history=("position", "indirect")),
    ]
    assert faults_of(flow) == [
        "color names nothing, which is no channel",
        "color reads direct, which no pass before it writes",
        "direct writes position, which gbuffer has written",
        "masks reads indirect of the frame before, which no pass writes",
    ]
    assert faults_of(flow[:1]) == []


def test_a_frame_that_cannot_run_is_refused_before_anything_is_drawn(monkeypatch):
    effects = decide(lit_scene(), SMALL)
    monkeypatch.setattr(
        "taubench_gl.frame.flow.light_flow",
        lambda effects, extra=(): (PassFlow("color", reads=("direct", "indirect"), writes=("color",)),),
    )
    with pytest.raises(ValueError, match=r"color reads direct.*; color reads indirect"):
        frame_flow(effects)
