"""The shared scenes as parameters.

A test with the argument ``sampled_scene`` runs once per fifth scene, and once per scene in the long tests.
"""

from __future__ import annotations

from pathlib import Path

import pytest


def _scenes(config: pytest.Config) -> list[Path]:
    """Valid glTF 2.0 files of the shared data, whose folder the top conftest has; empty without it."""
    roots = [p.DATA for p in config.pluginmanager.get_plugins() if hasattr(p, "DATA")]
    if not roots or roots[0] is None:
        return []
    found = (p for p in sorted(roots[0].rglob("*")) if p.suffix in (".gltf", ".glb"))
    return [p for p in found if not p.relative_to(roots[0]).as_posix().startswith(("bad_", "reports4/sweep/"))]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "sampled_scene" in metafunc.fixturenames:
        scenes = [
            pytest.param(path, id=path.stem, marks=[pytest.mark.long] if number % 5 else [])
            for number, path in enumerate(_scenes(metafunc.config))
        ]
        metafunc.parametrize("sampled_scene", scenes)
