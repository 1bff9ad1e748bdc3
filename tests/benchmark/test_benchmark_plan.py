"""The built-in suites: their scenes, and what ``benchmark plan`` prints of them."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from taubench_gl.apps.cli import cli
from taubench_gl.benchmark.scenes import LIGHT_SCENES, SceneRecipe, scene_file
from taubench_gl.benchmark.suite import read_suite
from taubench_gl.effects.path_tracing import traced_sources
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings


@pytest.fixture(autouse=True, scope="module")
def cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TAUBENCH_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


def traced_cases(suite):
    return [c for c in read_suite(suite).cases if c.track == "path-traced" and c.scene.source in LIGHT_SCENES]


@pytest.mark.parametrize(("suite", "count"), [("quick", 6), ("full", 14)])
def test_path_traced_track_has_scenes_of_different_kinds(suite, count):
    cases = traced_cases(suite)
    assert len({case.scene.source for case in cases}) == len(cases) == count
    for case in cases:
        assert case.settings.lighting.light_unit == "watt"
        assert case.kind.path_samples == 1 and case.request.reference.startswith("path-traced@")


@pytest.mark.parametrize("name", LIGHT_SCENES)
def test_scenes_of_the_suites_are_lit_and_last_as_long_as_their_cases(name):
    scene = load_scene(scene_file(SceneRecipe(name)))
    (case,) = (case for case in traced_cases("full") if case.scene.source == name)
    settings = Settings(light="path-traced", environment=case.settings.lighting.environment)
    assert traced_sources(scene, settings)
    assert scene.duration * 24.0 >= 11.0  # frames 0 to 11


def test_the_six_kinds_of_the_quick_suite():
    """Interior, sun, emitters, many lights, glossy, foliage: what each has that the others have not."""
    scenes = {n: load_scene(scene_file(SceneRecipe(n))) for n in ("emitters", "many_lights", "glossy_metal", "foliage")}
    assert len(scenes["many_lights"].light_nodes) > 30 and not len(scenes["emitters"].light_nodes)
    assert any(material.alpha_mode == "MASK" for material in scenes["foliage"].materials)
    assert any(m.metallic == 1.0 and m.roughness < 0.2 for m in scenes["glossy_metal"].materials)


def test_plan_lists_units(tmp_path):
    done = CliRunner().invoke(cli, ["benchmark", "plan", "none", "--cases", "emitters/*", "--cases", "interior/*"])
    assert done.exit_code == 0, done.output
    lines = [line for line in done.output.splitlines() if "/path-traced@1:" in line]
    assert [line.split()[1] for line in lines] == ["interior/path-traced@1:", "emitters/path-traced@1:"]
    assert all("8 frames, 1 seeds, reference path-traced@64" in line for line in lines)
