"""Names of the scene registry as scene paths: every command that takes a path resolves it here."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import given_options


def resolve(text: str, animation: Sequence[str | int] | None = None) -> tuple[str, dict[str, Any]]:
    """(what ``load_scene`` takes, settings of the scene's registry row); a path is returned unchanged with none.

    A file that Blender reads is converted on first use, with the take that ``animation`` names, and a recorded game is
    captured.  Raises DatasetError, SceneError, and what ``convert`` raises.
    """
    from taubench_gl.datasets.scene_cache import find_named, scene_text

    store = find_named(text)
    if store is not None and store.entry.recording is not None:
        from taubench_gl.capture.arena import arena_file

        return str(arena_file(store.name)), store.settings()
    source = text if store is None else scene_text(store)
    return _readable(source, animation), {} if store is None else store.settings()


def row_settings(row: dict[str, Any]) -> dict[str, Any]:
    """``row`` without the options that the user gave; ``--fps`` also overrides the row's frames, which count at its
    rate."""
    by_user = given_options(row)
    if "fps" in by_user:
        by_user |= {"frames"}
    return {name: value for name, value in row.items() if name not in by_user}


def _readable(text: str, animation: Sequence[str | int] | None) -> str:
    """A path that can be read: ``text`` itself, or the cached glTF file of one that only Blender reads."""
    from taubench_gl.pathtraced.blender.cache import converted, is_convertible

    if not is_convertible(text):
        return text

    def announce(path: Path) -> None:
        click.echo(f"converting {path.name} with Blender (once)", err=True)

    return str(converted(text, animation, announce=announce))
