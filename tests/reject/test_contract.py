"""Folders of rejection tests: the built-in ones, and every fault as one line."""

from __future__ import annotations

import pytest
from references.rejection import REFERENCES

from taubench_gl.errors import MethodError
from taubench_gl.reject.contract import BUILTIN, builtin_tests, load_test, load_tests

TOML = 'title = "t"\nkind = "geometry"\nunit = "m"\nthreshold = 0.5\n'
GLSL = "float difference(Point now, Point history, Pixel pixel) { return 0.0; }\n"


def folder(tmp_path, toml=TOML, glsl=GLSL, name="own"):
    path = tmp_path / name
    path.mkdir()
    (path / "test.toml").write_text(toml)
    if glsl is not None:
        (path / "test.glsl").write_text(glsl)
    return str(path)


def test_every_built_in_test_has_a_reference_and_is_short():
    assert set(builtin_tests()) == set(REFERENCES)
    for name in builtin_tests():
        test = load_test(name)
        assert test.name == name and test.threshold >= 0 and test.kind in ("geometry", "color")
        lines = [line for line in (BUILTIN / name / "test.glsl").read_text().splitlines() if line.strip()]
        assert len(lines) < 15


def test_thresholds_and_combinations():
    assert load_test("position=0.5").threshold == 0.5
    both = load_test("position=0.5+color_clamp")
    assert both.kind == "color" and both.threshold == 1.0 and both.parts[0].threshold == 0.5
    assert both.name == "position+color_clamp"


def test_an_own_folder(tmp_path):
    test = load_test(folder(tmp_path, TOML + "[settings]\nk = { default = 2.0, doc = 'd', min = 1.0 }\n"))
    assert test.name == "own" and dict(test.settings) == {"k": 2.0}


@pytest.mark.parametrize(
    ("toml", "glsl"),
    [
        (TOML.replace("geometry", "sound"), GLSL),
        (TOML.replace("0.5", "-1"), GLSL),
        (TOML + "more = 1\n", GLSL),
        (TOML + "[settings]\nk = { default = 9.0, doc = 'd', max = 1.0 }\n", GLSL),
        (TOML + "[settings]\nk = { default = 1e39, doc = 'd' }\n", GLSL),
        (TOML + "[settings]\npixel = { default = 9.0, doc = 'd' }\n", GLSL),
        (TOML, "float distance_of(Point a) { return 0.0; }"),
        (TOML, "// float difference(Point now, Point history, Pixel pixel)\n"),
        (TOML, '#include "../../secret"\n' + GLSL),
        (TOML, None),
        ("title = ", GLSL),
    ],
)
def test_faults(tmp_path, toml, glsl):
    with pytest.raises(MethodError):
        load_test(folder(tmp_path, toml, glsl))


@pytest.mark.parametrize("names", [["positoin"], ["position=far"], ["position=-1"], ["position", "position"], []])
def test_names(names):
    with pytest.raises(MethodError):
        load_tests(names)


def test_a_name_that_is_no_identifier(tmp_path):
    with pytest.raises(MethodError):
        load_test(folder(tmp_path, name="My-Test"))
