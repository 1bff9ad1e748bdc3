from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The stand-ins on disk, by name; each is made when it is first asked for."""
    from taubench_gl.datasets.stand_ins import make_stand_in

    folder = tmp_path_factory.mktemp("stand-ins")

    class Made(dict[str, Path]):
        def __missing__(self, name: str) -> Path:
            self[name] = folder / f"{name}.glb"
            make_stand_in(name, self[name])
            return self[name]

    return Made()
