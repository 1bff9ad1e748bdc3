"""tools/mutate: mutants are drawn from code alone, and a test kills one only if it passes without it."""

from __future__ import annotations

import ast
import importlib.machinery
import importlib.util
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tools"))
from mutations import COST_ONLY, Mutant, sites, values_of  # noqa: E402

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


@pytest.mark.parametrize(
    ("file", "text", "expected", "not_code"),
    [("a.glsl", GLSL, "6.0 7.0 8.0 += + - .xyz .x .y * > && ! min", "1 2 3 4 5 i"),
     ("a.py", PYTHON, "5 6 13 14 < and or min + -", "1 2 3 4 7 8 9 10 11 12")],
)  # fmt: skip
def test_sites_are_code(file, text, expected, not_code):
    found = {text[start:end] for start, end, _ in sites(file, text)}
    assert set(expected.split()) <= found and not set(not_code.split()) & found
    for start, end, replacements in sites(file, text):
        assert replacements and text[start:end] not in replacements
        for replacement in replacements if file == "a.py" else ():
            mutant = Mutant(file, start, end, replacement, 1, text[start:end]).apply(text)
            assert ast.dump(ast.parse(mutant)) != ast.dump(ast.parse(text))


def test_every_area_has_files_and_tests(mutate):
    for area in mutate.AREAS.values():
        assert all((ROOT / test).exists() for test in area.tests) and all(list(ROOT.glob(p)) for p in area.files)
    for file, reasons in COST_ONLY.items():
        assert all(values_of((ROOT / file).read_text(), name) for name in reasons)


def test_tests_that_import_a_module_cover_it(mutate):
    tests = mutate.tests_of(Mutant("taubench_gl/metrics/streaming.py", 0, 0, "", 1, ""))
    assert "tests/metrics/test_streaming.py" in tests[:3] and tests[-1] == mutate.SELFTEST


def test_tests_that_fail_without_the_mutant_kill_nothing(mutate, tmp_path, monkeypatch):
    (tmp_path / "a.py").write_text("x = 1\n")
    monkeypatch.setattr(mutate, "tests_of", lambda _: ["broken.py", "fails.py"])
    runs, sound = [], {}

    def tested(test, folder, seconds):
        changed = (folder / "a.py").read_text() == "x = 2\n"
        runs.append((test, changed))
        return (1 if test == "broken.py" or changed else 0), f"FAILED {test}", ""

    monkeypatch.setattr(mutate, "_tested", tested)
    row = mutate.evaluated(Mutant("a.py", 4, 5, "2", 1, "1"), "numbers", tmp_path, sound)
    assert row["verdict"] == "killed" and "fails.py" in row["tests"] and (tmp_path / "a.py").read_text() == "x = 1\n"
    assert sound == {"broken.py": False, "fails.py": True}
    assert runs == [("broken.py", True), ("broken.py", False), ("fails.py", True), ("fails.py", False)]
