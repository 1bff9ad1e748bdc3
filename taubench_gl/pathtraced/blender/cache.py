"""Files that Blender reads, converted once and kept in the cache by their content."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from taubench_gl.data_files import hashed
from taubench_gl.errors import SceneError
from taubench_gl.paths import cache_folder
from taubench_gl.pathtraced.blender.convert import VERSION, WITH_TAKES, convert
from taubench_gl.scene import CONVERTIBLE

FOLDER = "converted"
"""Folder of the cache that holds the converted files."""


def is_convertible(path: str | Path) -> bool:
    """Whether ``path`` has a suffix of a file that Blender converts."""
    return Path(path).suffix.lower() in CONVERTIBLE


def converted(
    source: str | Path,
    animation: Sequence[str | int] | None = None,
    announce: Callable[[Path], None] | None = None,
) -> Path:
    """The .glb file of ``source``, from the cache or converted now.

    ``animation``: its first name is the take to play of files that have takes.  The key is the SHA-256 of the file, the
    take and the version of the conversion; files that the source links are not part of it.  ``announce`` is called with
    the source before a conversion.  Raises SceneError, PathTracedError, OutputError.
    """
    source = Path(source)
    named = [name for name in animation or () if isinstance(name, str)]
    take = named[0] if named and source.suffix.lower() in WITH_TAKES else None
    digest = hashed(source, SceneError)
    digest.update(f" {source.suffix.lower()} {take} {VERSION}".encode())
    target = cache_folder() / FOLDER / digest.hexdigest()[:24] / f"{source.stem}.glb"
    if not target.is_file():
        if announce is not None:
            announce(source)
        convert(source, target, take=take)
    return target
