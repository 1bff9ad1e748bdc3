"""Where the package's own files lie, in a checkout and in an installed wheel alike, and where it caches others."""

from __future__ import annotations

import os
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent


def _beside_or_inside(folder: str) -> Path:
    """``folder`` inside the installed package, else beside it in a checkout."""
    inside = PACKAGE / "_data" / folder
    return inside if inside.is_dir() else PACKAGE.parent / folder


SHADERS = _beside_or_inside("shaders")
ASSETS = _beside_or_inside("assets")

CACHE_VARIABLE = "TAUBENCH_CACHE"


def cache_folder() -> Path:
    """The folder of downloaded scenes, stored references and converted files: TAUBENCH_CACHE, else in the user's cache
    folder.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path("~").expanduser() / ".cache")
    return Path(base) / "taubench-gl"
