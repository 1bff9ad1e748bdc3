"""Where a command takes a scene's path it takes a name of the registry too: this makes the one of the other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import given_options


def resolve(text: str) -> tuple[str, dict[str, Any]]:
    """-> what ``load_scene`` takes, and the settings that the scene's row in the registry calls for.

    A path comes back as it is, without settings.  A scene in FBX or .blend is converted the first time.  Raises
    DatasetError, and what ``convert`` raises.
    """
    from taubench_gl.datasets.named import find_named, scene_text

    store = find_named(text)
    if store is None:
        return text, {}
    source = scene_text(store)
    if store.entry.format in ("fbx", "blend"):
        source = str(_converted(store, Path(source)))
    return source, store.entry.settings()


def asked_for(row: dict[str, Any]) -> dict[str, Any]:
    """``row`` without what the user gave to the command that is running; frames go with the rate they count at."""
    given = given_options(row)
    if "fps" in given:
        given |= {"frames"}
    return {name: value for name, value in row.items() if name not in given}


def _converted(store: Any, source: Path) -> Path:
    """The glTF of an FBX or .blend scene, beside it in the cache; one per file it was made from."""
    from taubench_gl.pathtraced.blender.convert import convert

    record = store.record()
    target = store.folder / f"converted-{record.sha256[:12]}-{source.stem}.glb"
    if not target.is_file():
        click.echo(f"{store.name}: converting {source.name} with Blender, this once", err=True)
        convert(source, target)
    return target
