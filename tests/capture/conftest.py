"""Data of the game that the machine may have: tests over it skip by name where it is missing."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

GAME = Path("/usr/share/games/openarena/baseoa")
HUMAN, OLD = "demos/demo088-test1.dm_71", "demos/boomtest.dm_68"


@pytest.fixture(scope="session")
def game_folder() -> Path:
    """Folder of OpenArena's data files, as Debian's packages install it."""
    if not (GAME / "pak1-maps.pk3").is_file():
        pytest.skip("OpenArena is not installed: apt-get install openarena")
    return GAME


@pytest.fixture(scope="session")
def game_demos(game_folder, tmp_path_factory) -> dict[str, Path]:
    """The demos of the packages by name inside them."""
    out, folder = {}, tmp_path_factory.mktemp("demos")
    for pak in sorted(game_folder.parent.glob("*/*.pk3")):
        with zipfile.ZipFile(pak) as archive:
            for name in archive.namelist():
                if name.startswith("demos/") and ".dm_" in name:
                    out[name] = Path(archive.extract(name, folder))
    if HUMAN not in out:
        pytest.skip("OpenArena's demos are not installed: apt-get install openarena-088-data")
    return out
