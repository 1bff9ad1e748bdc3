from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Both stand-ins on disk, by name."""
    from taubench_gl.datasets.stand_ins import STAND_INS, make_stand_in

    folder = tmp_path_factory.mktemp("stand-ins")
    for name in STAND_INS:
        make_stand_in(name, folder / f"{name}.glb")
    return {name: folder / f"{name}.glb" for name in STAND_INS}
