"""The house rules that a machine can check: imports run one way, OpenGL stays in its room, files stay small."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "taubench_gl"

LEAF = {"conventions", "channels", "errors", "glossary", "outputs", "paths", "math3d", "settings"}

LAYERS: tuple[set[str], ...] = (
    LEAF,
    {"scene", "gpu", "metrics"},
    {"animation"},
    {"effects"},
    {"frame"},
    {"report"},
    {"run", "provenance"},
    {"evaluation"},
    {"pathtraced"},
    {"api"},
    {"reuse", "selftest", "datasets", "export", "batch"},
    {"cost"},
    {"demos"},
    {"viewer"},
    {"apps"},
    {"__main__"},
)
"""Rooms from the bottom to the top.  A room imports from rooms below it and from itself, never sideways or upwards;
leaf modules may use each other.  A new room takes its place here first."""

NO_GL = {"scene", "animation", "effects", "metrics", "report", "run", *LEAF}
"""Rooms that work where there is no OpenGL at all."""

NO_GL_MODULES = tuple(f"pathtraced.{name}" for name in ("exr", "sequence", "cameras", "check", "cycles.render"))
"""Modules that work without OpenGL, in packages of which other parts need it."""

MAY_IMPORT_MODERNGL = {"gpu", "frame", "pathtraced", "reuse", "viewer"}

LEVEL = {room: level for level, rooms in enumerate(LAYERS) for room in rooms}
MAX_LINES = 700


def modules() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def room_of(path: Path) -> str:
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


def imports_of(path: Path) -> list[tuple[int, str]]:
    """Line and absolute dotted name of every import, those inside functions and TYPE_CHECKING blocks too."""
    return imports_in(path.read_text(encoding="utf-8"), path)


def imports_in(text: str, path: Path) -> list[tuple[int, str]]:
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = ("taubench_gl", *path.relative_to(PACKAGE).parent.parts)
                base = ".".join([*package[: len(package) - node.level + 1], *([base] if base else [])])
            # "from taubench_gl import math3d" names a room only in its last part.
            found += [(node.lineno, f"{base}.{alias.name}") for alias in node.names]
    return found


def faults_in(text: str, path: Path) -> list[str]:
    room, faults = room_of(path), []
    where = path.relative_to(ROOT)
    for line, name in imports_in(text, path):
        parts = name.split(".")
        if parts[0] == "moderngl" and room not in MAY_IMPORT_MODERNGL:
            faults.append(f"{where}:{line}: moderngl belongs to {', '.join(sorted(MAY_IMPORT_MODERNGL))}")
        if parts[0] != "taubench_gl" or len(parts) < 2 or parts[1].startswith("__") or parts[1] == room:
            continue
        other = parts[1]
        if other not in LEVEL:
            if other[0].islower() and ((PACKAGE / other).is_dir() or (PACKAGE / f"{other}.py").is_file()):
                faults.append(f"{where}:{line}: room {other} has no place in LAYERS")
            continue  # a name of taubench_gl/__init__.py, such as Run
        if LEVEL[other] >= LEVEL[room] and not (other in LEAF and room in LEAF):
            faults.append(f"{where}:{line}: {room} imports {other}, which is not below it")
        if room in NO_GL and other not in NO_GL:
            faults.append(f"{where}:{line}: {room} works without OpenGL, {other} does not")
    return faults


def test_every_room_has_its_place():
    rooms = {room_of(path) for path in modules()} - {"__init__"}
    assert rooms <= LEVEL.keys(), f"give {sorted(rooms - LEVEL.keys())} a place in LAYERS"


def test_imports_run_one_way():
    faults = [
        fault
        for path in modules()
        if path != PACKAGE / "__init__.py"
        for fault in faults_in(path.read_text(encoding="utf-8"), path)
    ]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("file", "text", "complaint"),
    [
        ("metrics/x.py", "import moderngl", "moderngl belongs to"),
        ("metrics/x.py", "def f():\n    from moderngl import Context", "moderngl belongs to"),
        ("scene/x.py", "from taubench_gl.animation import sample", "not below it"),
        ("scene/x.py", "from taubench_gl import metrics", "not below it"),
        ("scene/x.py", "from ..evaluation import evaluate_scene", "not below it"),
        ("scene/gltf/x.py", "from ...gpu import context", "not below it"),
        ("gpu/x.py", "import taubench_gl.scene.model", "not below it"),
        ("report/x.py", "from taubench_gl.frame import graph", "works without OpenGL"),
        ("errors.py", "from taubench_gl.run import Run", "not below it"),
    ],
)
def test_the_walk_finds_what_is_forbidden(file, text, complaint):
    assert any(complaint in fault for fault in faults_in(text, PACKAGE / file))


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("frame/x.py", "import moderngl"),
        ("scene/gltf/x.py", "from ..model import Scene"),
        ("scene/x.py", "from taubench_gl import math3d, __version__"),
        ("apps/x.py", "from taubench_gl.evaluation import evaluate"),
        ("evaluation/x.py", "from taubench_gl.run import Run"),
    ],
)
def test_the_walk_allows_what_is_allowed(file, text):
    assert faults_in(text, PACKAGE / file) == []


def test_no_gl_rooms_leave_moderngl_unloaded():
    rooms = sorted(f"taubench_gl.{room}" for room in NO_GL if (PACKAGE / room).is_dir() or room == "run")
    rooms += [f"taubench_gl.{name}" for name in NO_GL_MODULES]
    code = f"import sys, {', '.join(rooms)}; assert not {{'moderngl', 'glcontext'}} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def tracked_files() -> list[Path]:
    """Files of the repository, those not yet added included; a source archive without git is searched whole."""
    command = ["git", "-C", str(ROOT), "ls-files", "-co", "--exclude-standard", "-z"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    if done.returncode == 0:
        return [ROOT / name for name in done.stdout.split("\0") if name and (ROOT / name).is_file()]
    folders = ("taubench_gl", "shaders", "assets", "tools", "tests", "docs", ".ci")
    return [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]


# Put together here, so that this file does not find itself.
_SLASH = "/"
MACHINE = re.compile("|".join([rf"(?<![\w.]){_SLASH}{top}{_SLASH}" for top in ("work", "root", "home", "Users")]))
REGISTRY = re.compile("|".join(re.escape(".".join(host)) for host in (
    ("pypi", "org"), ("files", "pythonhosted", "org"), ("registry", "npmjs", "org"), ("deb", "debian", "org"),
    ("archive", "ubuntu", "com"), ("proxy", "golang", "org"),
)) + "|--(extra-)?index-" + "url")  # fmt: skip


def test_no_file_names_a_machine_or_a_registry():
    faults = []
    for path in tracked_files():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        for number, line in enumerate(text.splitlines(), start=1):
            if MACHINE.search(line) or REGISTRY.search(line):
                faults.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}")
    assert not faults, "\n".join(faults)


def test_the_search_finds_paths_and_hosts():
    assert MACHINE.search("open('" + "/".join(["", "home", "me", "x.glb"]) + "')")
    assert not MACHINE.search("shared/root/x") and not MACHINE.search("homework / root")
    assert REGISTRY.search("https://" + "pypi" + ".org/simple")


def test_files_stay_small():
    long = {}
    for path in tracked_files():
        if path.suffix in (".py", ".glsl"):
            lines = path.read_text(encoding="utf-8").count("\n") + 1
            if lines >= MAX_LINES:
                long[str(path.relative_to(ROOT))] = lines
    assert not long, f"split these (fewer than {MAX_LINES} lines each): {long}"
