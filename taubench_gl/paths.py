"""Where the package's own files lie, in a checkout and in an installed wheel alike."""

from __future__ import annotations

from pathlib import Path

PACKAGE = Path(__file__).resolve().parent


def _beside_or_inside(folder: str) -> Path:
    """``folder`` inside the installed package, else beside it in a checkout."""
    inside = PACKAGE / "_data" / folder
    return inside if inside.is_dir() else PACKAGE.parent / folder


SHADERS = _beside_or_inside("shaders")
ASSETS = _beside_or_inside("assets")
