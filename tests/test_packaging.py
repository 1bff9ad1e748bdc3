"""The wheel is complete: it has shaders and assets and works outside the checkout."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DATA_FOLDERS = ("shaders", "assets")
ASSET_OF_WHEEL = "lib/python{}/site-packages/taubench_gl/_data/assets/demo.glb"


def _run(*command: str | Path, cwd: Path, **environment: str) -> str:
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def _data_files() -> set[str]:
    files = (path for folder in DATA_FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file())
    return {str(path.relative_to(ROOT)) for path in files}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, so that the checkout gets no build folder and an old build folder has no effect."""
    source, dist = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("dist")
    for folder in ("taubench_gl", *DATA_FOLDERS):
        shutil.copytree(ROOT / folder, source / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    stale = source / "build" / "lib" / "taubench_gl" / "_data" / "shaders" / "deleted.glsl"
    stale.parent.mkdir(parents=True)
    stale.write_text("// from an earlier build")
    _run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", dist, source, cwd=dist)
    (built,) = dist.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the unpacked wheel; this environment has its dependencies."""
    target = tmp_path_factory.mktemp("target")
    zipfile.ZipFile(wheel).extractall(target)
    return target


def test_wheel_contains_code_and_data_only(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    data = {name.removeprefix("taubench_gl/_data/") for name in names if name.startswith("taubench_gl/_data/")}
    assert data == _data_files()
    modules = {str(path.relative_to(ROOT)) for path in (ROOT / "taubench_gl").rglob("*.py")}
    assert modules <= names
    report = {path for path in (ROOT / "taubench_gl" / "report").rglob("*") if path.is_file()}
    assert {str(p.relative_to(ROOT)) for p in report if "__pycache__" not in p.parts} <= names
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"taubench_gl"}


def test_installed_package_finds_its_shaders_and_assets(installed, tmp_path):
    code = "import json, taubench_gl.paths as p; print(json.dumps([p.__file__, str(p.SHADERS), str(p.ASSETS)]))"
    module, *folders = json.loads(_run(sys.executable, "-c", code, cwd=tmp_path, PYTHONPATH=str(installed)))
    assert Path(module).is_relative_to(installed), "the checkout was imported, not the wheel"
    for name, folder in zip(DATA_FOLDERS, map(Path, folders), strict=True):
        assert folder.is_relative_to(installed)
        expected = {path.relative_to(ROOT / name) for path in (ROOT / name).rglob("*") if path.is_file()}
        assert {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()} == expected


def test_installed_package_evaluates_its_demo(installed, tmp_path):
    code = "import sys, taubench_gl.apps.cli as c; from taubench_gl.paths import ASSETS; "
    code += "c.main(['evaluate', str(ASSETS / 'demo.glb'), *sys.argv[1:]])"
    light = ("--light", "preview", "--shadow-size", "64", "--light-unit", "candela", "--exposure", "1")
    light += ("--environment", "none")
    options = ("--size", "32x18", "--frames", "0:3", *light, "--out", tmp_path / "out")
    _run(sys.executable, "-c", code, *options, cwd=tmp_path, PYTHONPATH=str(installed))
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["pairs"] == 2
    assert summary["discard"]["frustum"]["mean_percent"] is not None


def _interpreters() -> dict[str, Path]:
    """Pythons of this machine besides the tests' own, by version: on the path, or kept by pyenv."""
    versions = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    places = {
        minor: [*versions.glob(f"{minor}.*/bin/python"), *filter(None, [shutil.which(f"python{minor}")])]
        for minor in ("3.11", "3.12", "3.13")
    }
    return {minor: Path(paths[0]) for minor, paths in places.items() if paths}


@pytest.mark.long
def test_the_wheel_alone_gives_the_same_digits_in_every_python(wheel, tmp_path):
    """Installed from the package index into empty environments: the same rows, and the same summary but for times."""
    interpreters = _interpreters()
    if len(interpreters) < 2:
        pytest.skip(f"of Python 3.11 to 3.13 this machine has {', '.join(interpreters) or 'none'}")
    results = {}
    for minor, python in interpreters.items():
        home, out = tmp_path / minor, tmp_path / f"out-{minor}"
        _run(python, "-m", "venv", home, cwd=tmp_path)
        command = home / "bin" / "taubench-gl"
        _run(home / "bin" / "python", "-m", "pip", "install", "--quiet", wheel, cwd=tmp_path, PYTHONPATH="")
        options = ("--size", "96x54", "--frames", "0:5", "--out", out)
        _run(command, "evaluate", home / ASSET_OF_WHEEL.format(minor), *options, cwd=tmp_path, PYTHONPATH="")
        summary = json.loads((out / "summary.json").read_text())
        for block in ("provenance", "timing", "stored"):
            summary.pop(block, None)
        summary["scene"] = None  # its place
        results[minor] = ((out / "frames.csv").read_bytes(), summary)
    first = next(iter(results.values()))
    for minor, result in results.items():
        assert result == first, minor


def test_constraints_pin_every_dependency_by_name_and_version_alone():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if line and line[0] != "#"]
    pinned = {}
    for line in lines:
        name, version = re.fullmatch(r"([A-Za-z0-9._-]+)==([A-Za-z0-9.]+)", line).groups()
        pinned[_normal(name)] = version
    required = project["dependencies"] + [r for extra in project["optional-dependencies"].values() for r in extra]
    missing = {_normal(re.match(r"[A-Za-z0-9._-]+", requirement)[0]) for requirement in required} - pinned.keys()
    assert not missing - {"taubench-gl"}  # the test extra names the others


def test_version_is_the_same_everywhere():
    import taubench_gl

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == taubench_gl.__version__
    assert f"[{taubench_gl.__version__}]" in (ROOT / "CHANGELOG.md").read_text()


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
