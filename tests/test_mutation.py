"""tools/mutate: mutants are drawn from code alone, and one that a case must notice is noticed."""

from __future__ import annotations

import ast
import importlib.machinery
import importlib.util
import itertools
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tools"))
from mutations import Mutant, draw, sites  # noqa: E402

GLSL = """\
// 1 + 2
#define N 3
layout(binding = 4) buffer B { float b[]; };
vec3 f(vec3 a) {
    for (int i = 0; i < 5; ++i) a += 6.0;
    return -a.xyz * (a.x + 7.0) > vec3(min(a.y, 8.0)) && !c ? a : b;
}
"""
PYTHON = '''\
"""1 + 2"""
X: "3 + 4" = 5
def f(a, b: int = 6) -> "7":
    """8 < 9"""
    raise ValueError("10 + 11" + a)
    return f"{a + 12}" or (a < 13 and -b) + min(a, 14)
'''


@pytest.fixture(scope="module")
def mutate():
    loader = importlib.machinery.SourceFileLoader("mutate_tool", str(ROOT / "tools" / "mutate"))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("mutate_tool", loader))
    sys.modules["mutate_tool"] = module
    loader.exec_module(module)
    return module


def changed(file: str, text: str) -> list[str]:
    return [text[start:end] for start, end, _ in sites(file, text)]


def test_sites_of_glsl_are_code():
    found = changed("a.glsl", GLSL)
    assert {"6.0", "7.0", "8.0", "+=", "+", "-", ".xyz", ".x", ".y", "*", ">", "&&", "!", "min"} <= set(found)
    assert not {"1", "2", "3", "4", "5", "i"} & set(found)
    for start, end, replacements in sites("a.glsl", GLSL):
        assert replacements and GLSL[start:end] not in replacements


def test_sites_of_python_are_code():
    found = changed("a.py", PYTHON)
    assert {"5", "6", "13", "14", "<", "and", "or", "min", "+", "-"} <= set(found)
    assert not {"1", "2", "3", "4", "7", "8", "9", "10", "11", "12"} & set(found)
    for start, end, replacements in sites("a.py", PYTHON):
        for replacement in replacements:
            mutant = Mutant("a.py", start, end, replacement, 1, PYTHON[start:end]).apply(PYTHON)
            assert ast.dump(ast.parse(mutant)) != ast.dump(ast.parse(PYTHON))


def test_every_shader_and_numeric_module_has_sites_and_every_seed_its_own_mutants(mutate):
    files = mutate.files_of(list(mutate.AREAS))
    shaders = {p.relative_to(ROOT).as_posix() for p in (ROOT / "shaders").rglob("*.glsl")}
    assert shaders <= set(files) and len(files) > len(shaders) + 100
    for patterns, tests in ((area.files, area.tests) for area in mutate.AREAS.values()):
        assert all((ROOT / test).exists() for test in tests) and all(list(ROOT.glob(p)) for p in patterns)
    first, again, other = (list(itertools.islice(draw(ROOT, list(files), seed), 50)) for seed in (1, 1, 2))
    assert first == again != other and len(set(first)) == 50


def test_tests_that_import_a_module_cover_it(mutate):
    mutant = Mutant("taubench_gl/metrics/streaming.py", 0, 0, "", 1, "")
    assert "tests/metrics/test_streaming.py" in mutate.tests_of(mutant)[:3]


def test_a_mutant_is_noticed_and_its_file_is_as_before(mutate, tmp_path):
    """The window of a light's range, by the case of that name; a comment's change by none."""
    mutate.copy_project(tmp_path)
    path = tmp_path / "shaders/common/lights.glsl"
    before = path.read_text()
    start = before.index("1.0 - x * x") + len("1.0 - x ")
    reach = mutate.Reach([("range-window", 1.0, [], ["common/lights.glsl"]), ("screen-edge", 2.0, [], [])])
    for mutant, verdict in (
        (Mutant("shaders/common/lights.glsl", start, start + 1, "+", 1, "*"), "killed"),
        (Mutant("shaders/common/lights.glsl", 0, 0, "// ", 1, ""), "survived"),
        (Mutant("shaders/common/lights.glsl", start, start + 1, "(", 1, "*"), "invalid"),
    ):
        row = mutate.evaluated(mutant, "light", tmp_path, reach, False)
        assert row["verdict"] == verdict, row
        assert path.read_text() == before
