"""A study whose light columns are compared with the path-traced reference."""

from __future__ import annotations

import dataclasses

import pytest

from taubench_gl.cost import cost
from taubench_gl.cost.configurations import BASELINE, make_plan
from taubench_gl.cost.parameters import PARAMETERS, StudyContext, with_light
from taubench_gl.cost.reference import SUMS_FILE
from taubench_gl.effects.decide import decide
from taubench_gl.errors import SettingsError
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings


def context(path, **settings):
    scene, chosen = load_scene(path), Settings(**settings)
    ranked = tuple(AnimatedScene(scene).ranked_lights)
    return StudyContext(scene, decide(scene, chosen), chosen, 24, ranked)


def test_the_plan_has_sample_counts_after_the_raster_configurations(demo):
    plan = make_plan(context(demo))
    counts = [c.settings.lighting.spp for c in plan.configurations if c.traced]
    assert sorted(counts) == [1, 4, 16, 64], "each is measured once"
    assert plan.highest.lighting.light != "path-traced"
    roles = [c.role for c in plan.configurations]
    assert roles[0] == BASELINE and roles.index("path_traced") > roles.index("effect") > roles.index("single")
    assert roles.index("grid") > roles.index("path_traced"), "what takes long and has no mask error comes last"


def test_baseline_and_effects_are_in_the_plan(demo):
    plan = make_plan(context(demo, light="auto"))
    assert plan.configurations[0].label == "baseline"
    assert "without shadows" in {c.name for c in plan.configurations if c.role == "effect"}


def test_raster_parameters_do_not_apply_to_path_traced_light(demo):
    plan = make_plan(context(demo, light="path-traced", spp=4))
    assert {"indirect", "indirect_samples", "probes", "shadow_size", "light_error"} <= plan.inapplicable.keys()
    assert "raster" in {c.values.get("light") for c in plan.configurations}
    assert PARAMETERS["light"].value_in(plan.named(BASELINE).settings) == "path-traced@4"


def test_the_method_that_auto_stands_for_is_not_timed_again(demo):
    plan = make_plan(context(demo), ("indirect",))
    assert {c.values["indirect"] for c in plan.configurations if c.role == "single"} == {"none", "rsm"}


def test_nothing_lit_has_no_path_traced_reference(demo, tmp_path):
    columns = ("frustum", "position")
    assert make_plan(context(demo, columns=columns), ("storage", "light")).inapplicable.keys() == {"light"}
    with pytest.raises(SettingsError):
        cost(demo, out=tmp_path, reference="path-traced@4", columns=columns, width=8, height=8, frames=(0, 2))
    with pytest.raises(SettingsError):
        cost(demo, out=tmp_path, reference="path-traced@0")


def test_light_values():
    lighting = with_light(Settings(indirect="rsm"), "path-traced@16").lighting
    assert (lighting.light, lighting.spp, lighting.indirect) == ("path-traced", 16, "auto")
    assert lighting.bidirectional, "as the reference's: else more samples may be further from it"
    assert not with_light(Settings(light="path-traced"), "path-traced@4").lighting.bidirectional, "as the baseline"
    assert with_light(Settings(light="path-traced"), "raster").lighting.light == "raster"


@pytest.mark.long
def test_a_study_against_the_path_traced_reference(demo, tmp_path, monkeypatch):
    monkeypatch.setitem(PARAMETERS, "light", dataclasses.replace(PARAMETERS["light"], values=("path-traced@4",)))
    given = {"width": 16, "height": 9, "frames": (20, 22), "repeats": 1, "bounces": 2, "indirect": "none"}
    given |= {"shadow_size": 32, "shadow_lights": 1, "parameters": ("light",)}
    study = cost(demo, out=tmp_path, reference="path-traced@16", **given)
    assert study.about["reference"]["samples"] == 16 and study.about["pixels"]["count"] == 16 * 9
    floors = study.about["reference"]["floor"]
    assert floors["position"] == 0.0 and floors["overall"] is not None
    (traced,) = [p for p in study.points if p.role == "path_traced"]
    assert traced.error("indirect") is not None and traced.time is not None
    assert study.point(BASELINE).error("indirect") == pytest.approx(study.about["reference"]["percent"]["indirect"]), (
        "without indirect light every discard of the reference is missed"
    )
    study.save()
    assert (tmp_path / "front.png").is_file() and (tmp_path / "study.html").is_file()
    stored = (tmp_path / SUMS_FILE).read_bytes()
    again = cost(demo, out=tmp_path, reference="path-traced@16", **given)
    assert (tmp_path / SUMS_FILE).read_bytes() == stored, "the reference is not traced again"
    assert [p.error() for p in again.points] == [p.error() for p in study.points]


def test_a_short_limit_gives_the_least_reference(demo, tmp_path):
    """One sample in each half; parts are never longer than the time that is left."""
    given = {"width": 8, "height": 5, "frames": (20, 22), "bounces": 1, "indirect": "none", "shadow_lights": 1}
    study = cost(demo, out=tmp_path, time_limit=1e-6, parameters=("light",), **given)
    assert study.about["reference"]["samples"] == 2 and study.point(BASELINE).masks
    assert len(study.answer()) == 3
