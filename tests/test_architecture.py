"""Rules of the architecture: imports run one way and without cycles, OpenGL stays in its packages, no machine paths."""

from __future__ import annotations

import ast
import contextlib
import graphlib
import importlib
import json
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "taubench_gl"

LEAF = {
    "camera_path_settings", "checksums", "conventions", "channels", "data_files", "errors", "features", "fields",
    "folder_lock", "glossary", "lobes", "math3d", "memory_budget", "outputs", "paths", "option_groups", "preset",
    "run_schema", "setting_values", "settings", "srgb", "stage_log",
}  # fmt: skip

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
    {"study"},
    {"reuse", "reject", "datasets"},
    {"capture"},
    {"export", "conformance"},
    {"api"},
    {"selftest"},
    {"cost"},
    {"batch", "benchmark"},
    {"demos"},
    {"paper"},
    {"viewer"},
    {"apps"},
    {"__main__"},
)
"""Packages and top-level modules, lowest first.  Each imports only from lower layers and from itself; leaf modules may
import each other."""

NO_GL = {"scene", "animation", "effects", "metrics", "report", "run", *LEAF}
"""Packages that must import without OpenGL."""

NO_GL_MODULES = (
    *(f"pathtraced.{name}" for name in ("check", "compare", "blender.convert", "blender.render")),
    "conformance.output",
    "conformance.suite",
)
"""Modules that must import without OpenGL although their package needs it elsewhere."""

MAY_IMPORT_MODERNGL = {"gpu", "frame", "pathtraced", "reuse", "viewer"}

LEVEL = {package: level for level, packages in enumerate(LAYERS) for package in packages}


def sources() -> dict[Path, str]:
    return {path: path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py"))}


def package_of(path: Path) -> str:
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


Calls = tuple[tuple[int, str, tuple[str, ...]], ...]


@cache
def parsed(text: str) -> tuple[tuple[ast.Import | ast.ImportFrom, ...], Calls]:
    """Imports of a module with the source ``text``, and (line, called, arguments) of its calls by a name of CALLED."""
    imports, calls = [], []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            imports.append(node)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in CALLED:
            arguments = tuple(map(ast.unparse, (*node.args, *node.keywords)))
            calls.append((node.lineno, ast.unparse(node.func), arguments))
    return tuple(imports), tuple(calls)


def imports_in(text: str, path: Path) -> Iterator[tuple[int, str]]:
    """Line and absolute dotted name of every import, also inside functions and TYPE_CHECKING blocks."""
    for node in parsed(text)[0]:
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = ("taubench_gl", *path.relative_to(PACKAGE).parent.parts)
                base = ".".join([*package[: len(package) - node.level + 1], *([base] if base else [])])
            # "from taubench_gl import math3d" names the module only in its last part.
            yield from ((node.lineno, f"{base}.{alias.name}") for alias in node.names)


def layer_faults(text: str, path: Path) -> list[tuple[int, str, str]]:
    """(line, imported name, rule) of each import that breaks a rule: "moderngl", "unknown", "order" or "no-gl"."""
    package, faults = package_of(path), []
    for line, name in imports_in(text, path):
        parts = name.split(".")
        if parts[0] == "moderngl" and package not in MAY_IMPORT_MODERNGL:
            faults.append((line, name, "moderngl"))
        if parts[0] != "taubench_gl" or len(parts) < 2 or parts[1].startswith("__") or parts[1] == package:
            continue
        other = parts[1]
        if other not in LEVEL:
            if other[0].islower() and ((PACKAGE / other).is_dir() or (PACKAGE / f"{other}.py").is_file()):
                faults.append((line, name, "unknown"))
            continue  # a name of taubench_gl/__init__.py, such as Run
        if LEVEL[other] >= LEVEL[package] and not (other in LEAF and package in LEAF):
            faults.append((line, name, "order"))
        if package in NO_GL and other not in NO_GL:
            faults.append((line, name, "no-gl"))
    return faults


def import_graph(texts: dict[Path, str]) -> dict[str, set[str]]:
    """Module -> modules of the package that it imports.  The package itself resolves its names on first use: left out.

    "from package import module" counts as an import of the module, not of the package's ``__init__``.
    """
    modules = {}
    for path in texts:
        parts = ("taubench_gl", *path.relative_to(PACKAGE).with_suffix("").parts)
        modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    graph = {}
    for module, path in modules.items():
        graph[module] = set()
        for _, name in imports_in(texts[path], path):
            while name and name not in modules:
                name = name.rpartition(".")[0]
            if name not in ("", "taubench_gl", module):
                graph[module].add(name)
    return graph


def cycle_in(graph: dict[str, set[str]]) -> list[str]:
    """The modules of one import cycle, in order; empty if there is none."""
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def test_every_package_has_a_layer():
    packages = {package_of(path) for path in sources()} - {"__init__"}
    assert packages <= LEVEL.keys(), f"add to LAYERS: {sorted(packages - LEVEL.keys())}"


def test_imports_follow_the_layers():
    faults = [
        f"{path.relative_to(ROOT)}:{line}: {name} ({rule})"
        for path, text in sources().items()
        if path != PACKAGE / "__init__.py"
        for line, name, rule in layer_faults(text, path)
    ]
    assert not faults, "\n".join(faults)


def missing_names(text: str) -> list[str]:
    """Names that ``text`` imports from this package and that the package does not have."""
    missing = []
    for name in {name for _, name in imports_in(text, PACKAGE) if name.startswith("taubench_gl.")}:
        module, _, attribute = name.rpartition(".")
        try:
            if not hasattr(importlib.import_module(module), attribute):
                importlib.import_module(name)
        except ModuleNotFoundError as error:
            if not (error.name or "").startswith("taubench_gl"):
                continue  # a package of somebody else, which is optional here
            missing.append(name)
    return sorted(missing)


def test_tools_and_notebooks_import_what_exists():
    """Nothing else runs all of them, and ruff's cache does not see that a module moved."""
    paths = [path for path in (ROOT / "tools").iterdir() if path.is_file()]
    texts = {path: path.read_text(encoding="utf-8") for path in paths}
    texts = {path: text for path, text in texts.items() if path.suffix == ".py" or "python" in text.split("\n", 1)[0]}
    for path in (ROOT / "docs").rglob("*.ipynb"):
        cells = [c["source"] for c in json.loads(path.read_text(encoding="utf-8"))["cells"] if c["cell_type"] == "code"]
        texts[path] = "\n".join("".join(source) for source in cells if not source[0].startswith("%%"))
    assert len(texts) > 20
    assert {path.name: names for path, text in texts.items() if (names := missing_names(text))} == {}
    assert missing_names("from taubench_gl.datasets.light_scenes import SCENES") == [
        "taubench_gl.datasets.light_scenes.SCENES"
    ]


def test_no_import_cycle():
    assert not cycle_in(import_graph(sources()))


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("from taubench_gl.gpu.b import f", "from taubench_gl.gpu.a import g"),
        ("def f():\n    from taubench_gl.gpu.b import f", "from .a import g"),
        ("if TYPE_CHECKING:\n    from taubench_gl.gpu import b", "import taubench_gl.gpu.a"),
    ],
    ids=["module", "function", "TYPE_CHECKING"],
)
def test_a_cycle_is_found(a, b):
    texts = {PACKAGE / "gpu" / "a.py": a, PACKAGE / "gpu" / "b.py": b}
    assert set(cycle_in(import_graph(texts))) == {"taubench_gl.gpu.a", "taubench_gl.gpu.b"}
    assert not cycle_in(import_graph(texts | {PACKAGE / "gpu" / "b.py": "import numpy"}))


@pytest.mark.parametrize(
    ("file", "text", "rule"),
    [
        ("metrics/x.py", "import moderngl", "moderngl"),
        ("metrics/x.py", "def f():\n    from moderngl import Context", "moderngl"),
        ("scene/x.py", "from taubench_gl.animation import sample", "order"),
        ("scene/x.py", "from taubench_gl import metrics", "order"),
        ("scene/x.py", "from ..evaluation import evaluate_scene", "order"),
        ("scene/gltf/x.py", "from ...gpu import context", "order"),
        ("gpu/x.py", "import taubench_gl.scene.model", "order"),
        ("report/x.py", "from taubench_gl.frame import graph", "no-gl"),
        ("errors.py", "from taubench_gl.run import Run", "order"),
    ],
)
def test_forbidden_imports_are_found(file, text, rule):
    assert rule in [found for _, _, found in layer_faults(text, PACKAGE / file)]


FILE_FUNCTIONS = {
    "open", "io.open", "io.FileIO", "os.open", "os.fdopen", "os.replace", "os.rename", "os.link", "os.symlink",
    "np.load", "np.loadtxt", "np.genfromtxt", "np.fromfile", "np.memmap", "np.save", "np.savez", "np.savez_compressed",
    "np.savetxt", "shutil.copy", "shutil.copy2", "shutil.copyfile", "shutil.move", "json.load", "tomllib.load",
    "tarfile.open", "zipfile.ZipFile", "Image.open", "PIL.Image.open", "OpenEXR.File", "oiio.ImageInput.open",
    "parquet.read_table",
}  # fmt: skip
FILE_METHODS = {"read_bytes", "read_text", "write_bytes", "write_text", "touch", "symlink_to", "hardlink_to", "rename"}
"""Calls that open, create or rename a file.  ``data_files`` is the gate in and ``outputs`` the gate out."""

OWNED = ("RasterSource", "PairEvaluator")
"""Classes that only ``evaluation/owner.py`` makes."""

CALLED = {name.rpartition(".")[2] for name in FILE_FUNCTIONS} | FILE_METHODS | {*OWNED}

GATES = {"data_files.py", "outputs.py"}
HANDED = ("by_descriptor(", "io.BytesIO(", "fileobj=", "file", "data", "header", "partial")
"""Beginnings of the first argument of calls that get an open file, bytes or a partial file of a gate."""

MAY_OPEN = {
    "apps/cli.py": "the null device, in place of a closed output",
    "memory_budget.py": "limits of the system, read by the gates themselves",
    "pathtraced/blender/convert_read.py": "runs in Blender's Python, without this package",
    "pathtraced/blender/script_shared.py": "runs in Blender's Python, without this package",
    "pathtraced/blender/render_script.py": "runs in Blender's Python, without this package",
}


def stray_openings(text: str) -> list[tuple[int, str]]:
    """(line, call) of every call in FILE_FUNCTIONS or FILE_METHODS by a file's name, and of ``path.open(mode)``."""
    found = []
    for line, called, arguments in parsed(text)[1]:
        method = called.rpartition(".")[2] if "." in called else ""
        mode = method == "open" and (not arguments or arguments[0][0] in "'\"" or arguments[0].startswith("mode="))
        # files of the package itself, from a wheel or an archive
        packaged = called.startswith("resources.")
        handed = bool(arguments) and any(
            arguments[0] == one if one.isalpha() else arguments[0].startswith(one) for one in HANDED
        )
        if (
            (called in FILE_FUNCTIONS and not (handed and called not in ("open", "os.open")))
            or mode
            or (method in FILE_METHODS and not packaged)
        ):
            found.append((line, called))
    return found


def test_every_file_is_opened_and_created_by_a_gate():
    faults = [
        f"{path.relative_to(PACKAGE)}:{line}: {call}"
        for path, text in sources().items()
        if path.relative_to(PACKAGE).as_posix() not in GATES | MAY_OPEN.keys()
        for line, call in stray_openings(text)
    ]
    assert not faults, "open files with data_files, create them with outputs: " + "; ".join(faults)
    assert all(stray_openings((PACKAGE / name).read_text(encoding="utf-8")) for name in MAY_OPEN)


@pytest.mark.parametrize(
    "text",
    ["open(path)", "with path.open('rb') as f: pass", "path.open()", "path.read_bytes()",
     "(folder / 'x').write_text('')", "np.load(path)", "OpenEXR.File(str(path))", "Image.open(path)",
     "shutil.copyfile(a, b)", "os.open(file, 0)",
     "open(file)", "partial.touch()"],
)  # fmt: skip
def test_stray_openings_are_found(text):
    assert stray_openings(text)


def test_packages_without_gl_do_not_load_moderngl():
    packages = sorted(f"taubench_gl.{package}" for package in NO_GL if (PACKAGE / package).is_dir() or package == "run")
    packages += [f"taubench_gl.{name}" for name in NO_GL_MODULES]
    code = f"import sys, {', '.join(packages)}; assert not {{'moderngl', 'glcontext'}} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def tracked_files() -> list[Path]:
    """Files of the repository, untracked ones included; without git (a source archive) all files."""
    command = ["git", "-C", str(ROOT), "ls-files", "-co", "--exclude-standard", "-z"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    if done.returncode == 0:
        return [ROOT / name for name in done.stdout.split("\0") if name and (ROOT / name).is_file()]
    folders = ("taubench_gl", "shaders", "assets", "tools", "tests", "docs", ".ci")
    return [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]


# Assembled from parts, so that this file does not match itself.
_SLASH = "/"
MACHINE = re.compile(rf"{_SLASH}(?<![\w.]{_SLASH})(?:work|root|home|Users){_SLASH}")
REGISTRY = [".".join(host) for host in (
    ("pypi", "org"), ("files", "pythonhosted", "org"), ("registry", "npmjs", "org"), ("deb", "debian", "org"),
    ("archive", "ubuntu", "com"), ("proxy", "golang", "org"),
)] + ["-index-" + "url"]  # fmt: skip


def texts() -> Iterator[tuple[str, str]]:
    """Name and contents of each text file of the repository."""
    for path in tracked_files():
        with contextlib.suppress(UnicodeDecodeError):
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def lines_with(pattern: re.Pattern[str], of: Iterable[tuple[str, str]]) -> list[str]:
    """File, number, match and beginning of each line with ``pattern`` in the texts ``of``."""
    found = []
    for name, text in of:
        for match in pattern.finditer(text):
            line = text[text.rfind("\n", 0, match.start()) + 1 :].partition("\n")[0].strip()
            number = text.count("\n", 0, match.start()) + 1
            found.append(f"{name}:{number}: {match.group()}: {line[:80]}")
    return found


def test_no_file_names_a_machine_or_a_registry():
    every = list(texts())
    faults = lines_with(MACHINE, every)
    faults += [f"{name}: {host}" for name, text in every for host in REGISTRY if host in text]
    assert not faults, "\n".join(faults)


def test_the_patterns_match_paths_and_hosts():
    assert MACHINE.search("open('" + "/".join(["", "home", "me", "x.glb"]) + "')")
    assert not MACHINE.search("shared/root/x") and not MACHINE.search("homework / root")
    assert any(host in "https://" + "pypi" + ".org/simple" for host in REGISTRY)


@pytest.mark.parametrize("made", OWNED)
def test_one_module_opens_sources_and_evaluators(made):
    """All others ask an owner, which also frees them."""
    makes = [
        str(path.relative_to(PACKAGE))
        for path, text in sources().items()
        for _, called, _ in parsed(text)[1]
        if called.rpartition(".")[2] == made
    ]
    assert makes == ["evaluation/owner.py"]
