"""Scenes by the name they have in the registry, where a path could stand: ``scene:NAME``, or NAME alone."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from taubench_gl.datasets.registry import VARIABLE, Entry, known_name, load_registry
from taubench_gl.datasets.registry_store import Store
from taubench_gl.errors import DatasetError

PREFIX = "scene:"


def registry_entries(registries: Sequence[Path] = ()) -> dict[str, Entry]:
    """The package's scenes and the user's: of ``registries``, else of the files that TAUBENCH_SCENES names."""
    named = [Path(p) for p in os.environ.get(VARIABLE, "").split(os.pathsep) if p]
    return load_registry(list(registries) or named)


def find_named(text: str, cache: Path | None = None) -> Store | None:
    """The place in the cache of the scene that ``text`` names; None where it names a file or nothing known.

    ``scene:NAME`` is always a name; a bare NAME is one unless something of that name lies there.  Raises DatasetError.
    """
    name = text.removeprefix(PREFIX)
    if name == text and (not text or Path(text).suffix or os.sep in text or ":" in text or os.path.lexists(text)):
        return None
    entries = registry_entries()
    try:
        name = known_name(entries, name)
    except DatasetError:
        if text.startswith(PREFIX):
            raise
        return None
    return Store(name, entries[name], cache)


def scene_text(store: Store) -> str:
    """What ``load_scene`` is given: the scene's path, with its rate where it is a sequence.  Raises DatasetError."""
    if store.record() is None:
        raise DatasetError(
            f"{store.name} is a known scene, but not here yet",
            hint=f"taubench-gl scenes get {store.name}, with --from FILE for a file you have",
        )
    rate = f"@{store.entry.fps:g}" if store.entry.format == "obj sequence" and store.entry.fps is not None else ""
    return f"{store.scene()}{rate}"
