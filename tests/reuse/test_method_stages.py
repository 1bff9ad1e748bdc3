"""Stages of papers: what a method declares, what ``reuse show`` prints, and names of incomplete methods."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner
from reuse_tools import PLAIN_GLSL, PLAIN_TOML, write_method

from taubench_gl.apps.cli import cli
from taubench_gl.errors import MethodError
from taubench_gl.reuse.declaration import method_from_class
from taubench_gl.reuse.loading import BUILTIN, load_method

DONE = '[stages.blend]\ndoc = "mean"\npaper = "Eq. (1)"\nshader = "a.glsl"\n'
MISSING = '[stages.clip]\ndoc = "clip"\npaper = "section 2"\nmissing = "no color box"\n'


def test_stages_are_loaded_and_shown(tmp_path):
    folder = write_method(tmp_path / "plain_without_clip", PLAIN_TOML + DONE + MISSING, a=PLAIN_GLSL)
    blend, clip = load_method(folder).stages
    assert (blend.name, blend.paper, blend.shader, blend.done) == ("blend", "Eq. (1)", "a.glsl", True)
    assert (clip.missing, clip.shader, clip.done) == ("no color box", None, False)
    shown = CliRunner().invoke(cli, ["reuse", "show", str(folder)])
    assert shown.exit_code == 0 and "MISSING (no color box)" in shown.output and "done, a.glsl" in shown.output
    shown = CliRunner().invoke(cli, ["reuse", "show", str(folder), "--json"])
    assert [s["missing"] for s in json.loads(shown.output)["stages"]] == [None, "no color box"]


def test_stages_of_a_class():
    class Plain:
        reads = ("radiance",)
        stages = {"mean": {"doc": "mean", "paper": "Eq. (1)"}}  # noqa: RUF012

        def step(self, frame):
            return frame["radiance"]

    assert [stage.name for stage in method_from_class(Plain).stages] == ["mean"]
    Plain.stages = {"mean": {"doc": "mean", "paper": "Eq. (1)", "shader": "a.glsl"}}
    with pytest.raises(MethodError, match=r"stages\.mean\.shader"):
        method_from_class(Plain)


def test_shaders_that_a_folder_lacks_are_those_of_its_base(tmp_path):
    toml = 'base = "taa_variance"\n' + (BUILTIN / "taa_variance" / "method.toml").read_text()
    method = load_method(write_method(tmp_path / "mine", toml))
    assert method.shader_folders == (tmp_path / "mine", BUILTIN / "taa_variance")
    write_method(tmp_path / "mine", toml, variance="void other() {}")
    with pytest.raises(MethodError, match=r"variance\.glsl has no function"):
        load_method(tmp_path / "mine")
