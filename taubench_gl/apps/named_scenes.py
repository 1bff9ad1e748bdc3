"""Names of the scene registry as scene paths: every command that takes a path resolves it here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import given_options


def resolve(text: str) -> tuple[str, dict[str, Any]]:
    """(what ``load_scene`` takes, settings of the scene's registry row); a path is returned unchanged with none.

    A scene in FBX or .blend is converted on first use.  Raises DatasetError, and what ``convert`` raises.
    """
    from taubench_gl.datasets.scene_cache import find_named, scene_text

    store = find_named(text)
    if store is None:
        return text, {}
    source = scene_text(store)
    if store.entry.format in ("fbx", "blend"):
        source = str(_converted(store, Path(source)))
    return source, store.entry.settings()


def row_settings(row: dict[str, Any]) -> dict[str, Any]:
    """``row`` without the options that the user gave; ``--fps`` also overrides the row's frames, which count at its
    rate."""
    given = given_options(row)
    if "fps" in given:
        given |= {"frames"}
    return {name: value for name, value in row.items() if name not in given}


def _converted(store: Any, source: Path) -> Path:
    """The glTF file of an FBX or .blend scene, stored beside it in the cache and named after its hash."""
    from taubench_gl.pathtraced.blender.convert import convert

    record = store.record()
    target = store.folder / f"converted-{record.sha256[:12]}-{source.stem}.glb"
    if not target.is_file():
        click.echo(f"{store.name}: converting {source.name} with Blender (once)", err=True)
        convert(source, target)
    return target
