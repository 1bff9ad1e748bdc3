"""Which light is path-traced, and what that replaces in the raster method."""

from __future__ import annotations

import pytest
from fixed import fixed_settings

from taubench_gl.effects import path_tracing
from taubench_gl.effects.decide import decide, force, unmeasured
from taubench_gl.features import COLUMNS
from taubench_gl.frame.plan import frame_spec
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.settings import Settings

SKY = (0.2, 0.3, 0.4)


def scene(lamps: int = 0, *, strength: float = 1.0, unlit: bool = False, glowing: int = 1):
    b = SceneBuilder()
    glow = b.material(emissive=(strength, 0.0, 0.0), emissive_strength=strength, unlit=unlit)
    b.node(mesh=b.mesh(box(material=b.material())))
    for _ in range(glowing):
        b.node(mesh=b.mesh(box(material=glow)))
    for _ in range(lamps):
        b.light(kind="point", intensity=5.0)
    b.camera(translation=(0.0, 0.0, 5.0))
    return b.build()


@pytest.mark.parametrize(
    ("light", "given", "environment", "sources"),
    [
        ("raster", {"lamps": 2, "strength": 5.0}, SKY, ()),
        ("auto", {"lamps": 2}, "none", ()),
        ("auto", {"lamps": 2, "strength": 1.0}, "none", ()),
        ("auto", {"lamps": 2, "strength": 5.0}, "none", ("emitters",)),
        ("auto", {"strength": 5.0, "unlit": True}, "none", ()),
        ("auto", {"strength": 5.0}, SKY, ("emitters", "environment")),
        ("auto", {}, "default", ()),
        ("preview", {"lamps": 1}, SKY, ()),
        ("preview", {"glowing": 0}, SKY, ("environment",)),
        ("path-traced", {}, "none", ("emitters",)),
        ("path-traced", {"unlit": True}, "none", ()),
        ("path-traced", {"lamps": 2, "glowing": 0}, "none", ("punctual",)),
        ("path-traced", {"glowing": 0}, "default", ("punctual", "environment")),
        ("path-traced", {"lamps": 1}, SKY, ("punctual", "emitters", "environment")),
    ],
)
def test_sources(light, given, environment, sources):
    made, settings = scene(**given), Settings(light=light, environment=environment)
    assert path_tracing.traced_sources(made, settings) == set(sources)
    spec = frame_spec(AnimatedScene(made), settings)
    assert spec.path_traced_sources == set(sources)
    assert bool(spec.emitters) == ("emitters" in sources)


def test_path_tracing_replaces_the_raster_passes():
    settings = Settings(light="path-traced", spp=3, environment="default")
    spec = frame_spec(AnimatedScene(scene(20)), settings)
    effects = spec.effects
    assert effects["path_traced"].enabled and "3 fixed samples" in effects["path_traced"].reason
    for name in ("shadows", "light_culling", "sky", "emitter_light", "environment_light"):
        assert not effects[name].enabled, name
    assert not unmeasured(effects, settings)
    assert not spec.raster_direct and not spec.raster_indirect and spec.sun is not None
    assert (spec.spp, spec.bounces, spec.pattern, spec.seed) == (3, 12, "fixed", 0)


@pytest.mark.parametrize("light", ["auto", "path-traced"])
@pytest.mark.parametrize("environment", ["none", SKY, "default"])
@pytest.mark.parametrize("lamps", [0, 1, 20])
def test_forcing_everything_keeps_what_is_replaced_disabled(light, environment, lamps):
    made, settings = scene(lamps, strength=5.0), Settings(light=light, environment=environment)
    plain, forced = (decide(made, settings.replace(effects=effects)) for effects in ("auto", "all"))
    for by, replaced in path_tracing.REPLACED.items():
        assert forced[by].enabled == plain[by].enabled
        if plain[by].enabled:
            assert not any(forced[name].enabled for name in replaced)
            assert not any(force(forced, replaced)[name].enabled for name in replaced)


def test_emitters_alone_have_direct_and_indirect_columns():
    made = scene(strength=5.0)
    settings = Settings(light="auto", environment="none")
    effects = decide(made, settings)
    assert effects["emitter_light"].enabled and not effects["path_traced"].enabled
    assert not unmeasured(effects, settings)
    spec = frame_spec(AnimatedScene(made), settings)
    assert not spec.raster_direct and not spec.raster_indirect and "indirect" in spec.enabled
    raster = unmeasured(decide(made, settings.replace(light="raster")), settings)
    assert {"direct", "indirect"} <= raster.keys()


def test_one_bounce_has_no_indirect_column():
    for light in ("auto", "path-traced"):
        settings = fixed_settings(light=light, bounces=1)
        assert set(unmeasured(decide(scene(strength=5.0), settings), settings)) == {"indirect"}


def test_raster_light_and_emitters_together():
    scene_and_settings = AnimatedScene(scene(2, strength=5.0)), Settings(light="auto", environment="none")
    spec = frame_spec(*scene_and_settings)
    assert spec.raster_direct and spec.raster_indirect and spec.path_traced_sources == {"emitters"}
    spec = frame_spec(*scene_and_settings, without=["shadows"])
    assert spec.raster_indirect and not spec.shadowed, "lights without maps shine on patches"
    assert frame_spec(*scene_and_settings, without=["direct"]).path_traced_sources == frozenset()


def test_columns_without_light_trace_nothing():
    for light in ("auto", "path-traced"):
        settings = fixed_settings(light=light, columns=("frustum", "position"))
        assert not frame_spec(AnimatedScene(scene(1, strength=5.0)), settings).path_traced_sources


def test_what_is_left_out_is_noted():
    made = scene(1, strength=5.0, glowing=3)
    enabled = frozenset({"direct", "emitter_light"})
    (left_out,) = path_tracing.notes(made, Settings(light="raster"), enabled)
    assert left_out.startswith("3 emissive surfaces")
    (traced,) = path_tracing.notes(made, Settings(light="auto", spp=2, bounces=3), enabled)
    assert "3 emissive surfaces" in traced and "12 rays" in traced
    assert not path_tracing.notes(made, Settings(light="raster", columns=COLUMNS[:1]), frozenset())
