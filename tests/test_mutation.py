"""tools/mutate: mutants are drawn from code alone, and one that a case must notice is noticed."""

from __future__ import annotations

import ast
import importlib.machinery
import importlib.util
import itertools
import re
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tools"))
from mutations import COST_ONLY, Mutant, draw, sites, values_of  # noqa: E402

IMAGES = """
import hashlib, sys
import numpy as np
from taubench_gl.animation import OrbitCamera, Poser
from taubench_gl.gpu.context import open_gpu
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.scenes import busy_room
scene, own = busy_room(lamps=20), {"width": 48, "height": 32}
with open_gpu() as gpu:
    bench = Bench(gpu)
    light = {"columns": ("direct", "indirect"), "indirect": "probes", "probes": 60, "shadow_lights": 9}
    shots = bench.shots(scene, (0, 1), **light, **own)
    images = [shot[name] for shot in shots for name in ("position", "direct", "indirect")]
    images += bench.traced(scene, spp=3, bounces=2, **own).values()
    run = bench.evaluate(scene, fps=4.0, **own)
poser = Poser(scene)
images.append(OrbitCamera(scene, poser).view_at(poser.sample(0.5)).position)
print(hashlib.sha256(b"".join(np.ascontiguousarray(i).tobytes() for i in images)).hexdigest(), run.frames)
"""

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


@pytest.mark.long
def test_every_shader_and_numeric_module_has_sites_and_every_seed_its_own_mutants(mutate):
    files = mutate.files_of(list(mutate.AREAS))
    shaders = {p.relative_to(ROOT).as_posix() for p in (ROOT / "shaders").rglob("*.glsl")}
    assert shaders <= set(files) and len(files) > len(shaders) + 100
    for patterns, tests in ((area.files, area.tests) for area in mutate.AREAS.values()):
        assert all((ROOT / test).exists() for test in tests) and all(list(ROOT.glob(p)) for p in patterns)
    first, again, other = (list(itertools.islice(draw(ROOT, list(files), seed), 50)) for seed in (1, 1, 2))
    assert first == again != other and len(set(first)) == 50


def doubled(text: str, names: Iterable[str]) -> str:
    """``text`` of a module with twice the numbers in the values of its constants ``names``."""
    for start, end in sorted({values_of(text, name) for name in names}, reverse=True):
        head, _, values = text[start:end].partition(" = ")
        text = f"{text[:start]}{head} = {re.sub(r'[0-9.]+', lambda m: f'2 * {m[0]}', values)}{text[end:]}"
    return text


@pytest.mark.long
def test_constants_that_are_not_mutated_change_no_bit(mutate, tmp_path):
    mutate.copy_project(tmp_path)
    command = [sys.executable, "-c", IMAGES]
    before = mutate._finished(command, tmp_path, 300.0)
    for file, reasons in COST_ONLY.items():
        text = (tmp_path / file).read_text()
        assert all(reasons.values()) and doubled(text, reasons) != text
        (tmp_path / file).write_text(doubled(text, reasons))
    after = mutate._finished(command, tmp_path, 300.0)
    assert before[0] == after[0] == 0, before[2] + after[2]
    assert before[1] == after[1] != ""


def test_tests_that_import_a_module_cover_it(mutate):
    mutant = Mutant("taubench_gl/metrics/streaming.py", 0, 0, "", 1, "")
    assert "tests/metrics/test_streaming.py" in mutate.tests_of(mutant)[:3]


@pytest.mark.long
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


def test_tests_that_fail_without_the_mutant_kill_nothing(mutate, tmp_path, monkeypatch):
    (tmp_path / "a.py").write_text("x = 1\n")
    mutant = Mutant("a.py", 4, 5, "2", 1, "1")
    monkeypatch.setattr(mutate, "by_selftest", lambda *_: ("survived", ""))
    monkeypatch.setattr(mutate, "tests_of", lambda _: ["broken.py", "fails.py"])
    runs = []

    def tested(test, folder, seconds):
        changed = (folder / "a.py").read_text() == "x = 2\n"
        runs.append((test, changed))
        return (1 if test == "broken.py" or changed else 0), f"FAILED {test}", ""

    monkeypatch.setattr(mutate, "_tested", tested)
    sound = {}
    row = mutate.evaluated(mutant, "numbers", tmp_path, mutate.Reach([]), True, sound)
    assert row["verdict"] == "killed" and "fails.py" in row["tests"] and (tmp_path / "a.py").read_text() == "x = 1\n"
    assert sound == {"broken.py": False, "fails.py": True}
    assert runs == [("broken.py", True), ("broken.py", False), ("fails.py", True), ("fails.py", False)]
