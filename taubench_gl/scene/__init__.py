"""Scene files -> immutable ``Scene`` (see ``model``).  ``load_scene`` reads all formats.  No GL."""

from __future__ import annotations

import importlib
import logging
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from taubench_gl.errors import SceneError, printable
from taubench_gl.scene.memory import within_memory
from taubench_gl.scene.model import Scene
from taubench_gl.scene.obj.reader import is_sequence, read_obj_sequence
from taubench_gl.stage_log import lasting

log = logging.getLogger(__name__)

READERS = {".gltf": "gltf", ".glb": "gltf", ".vrm": "gltf", ".obj": "obj", ".aff": "aff", ".nff": "aff"}
"""File suffix, lower case -> format: its reader is imported when the first file is read."""


CONVERTIBLE = (".blend", ".fbx", ".usd", ".usda", ".usdc", ".usdz", ".abc", ".ply", ".stl", ".dae")
"""Suffixes of files that Blender converts to glTF (``pathtraced.blender.convert``); no reader here reads them."""


def load_scene(
    path: str | Path,
    scene: str | int | None = None,
    animation: Sequence[str | int] | None = None,
    strict: bool = False,
) -> Scene:
    """Read and validate one scene: a file, or a numbered sequence of OBJ files.

    A sequence is a folder of name000.obj, name001.obj ... or a pattern (``name%04d.obj``, ``name*.obj``), with an
    optional prefix ``seq:`` and an optional suffix ``@FPS`` (default: 24 frames per second).

    ``scene``: name or index of the scene; None: the file's default, else its first.  ``animation``: names or indices of
    the animations to play; None: all that have no target in common with an earlier one.  ``strict``: refuse what
    departs from the format and would otherwise be repaired (docs/formats.md).  ``Scene.notes`` lists the reader's
    decisions and repairs, one counted note for each kind.

    Raises ``SceneError`` for files that are missing, unreadable, invalid or not supported, and for a scene that takes
    more memory than ``memory_budget.limit``.
    """
    if not str(path):
        raise SceneError("the path is empty", hint="give a scene file, a folder of numbered .obj files, or exr:DIR")
    if str(path).startswith("exr:"):
        hint = "give the scene that they show; exr:DIR is for 'evaluate', 'view' and 'reuse evaluate --input'"
        raise SceneError("path-traced frames are not a scene to draw", where=str(path), hint=hint)
    if is_sequence(str(path)):
        reader, source = read_obj_sequence, str(path)
    else:
        source = Path(path)
        reader = _reader_of(source)
    with lasting(log, "reading %s", printable(Path(path).name)):
        return within_memory(reader(source, scene, animation, strict))


def _reader_of(path: Path) -> Callable[..., Scene]:
    """The reader of a file by its suffix.  Raises SceneError."""
    if os.path.isdir(path):  # False, not an error, for a name that is too long
        raise _no_scene_in(path)
    name = READERS.get(path.suffix.lower())
    if name is None:
        hint = f"known: {', '.join(sorted((*READERS, *CONVERTIBLE)))}"
        if path.suffix.lower() in CONVERTIBLE:
            hint += f"; convert it to glTF first: taubench-gl convert {path.name} {path.stem}.glb"
        elif not path.suffix:
            hint += "; names of scenes: taubench-gl scenes list"
        raise SceneError(f"no reader for files ending in {path.suffix!r}", where=path.name, hint=hint)
    return getattr(importlib.import_module(f"taubench_gl.scene.{name}.reader"), f"read_{name}")


def _no_scene_in(folder: Path) -> SceneError:
    """The error for a folder that is not a sequence: its contents and a hint."""
    try:
        entries = sorted(p for p in folder.iterdir() if not p.name.startswith("."))
    except OSError as error:
        return SceneError(f"cannot be read: {error.strerror}", where=str(folder))
    scenes = [p for p in entries if p.suffix.lower() in READERS]
    if scenes:
        also = f" and {len(scenes) - 1} more" if len(scenes) > 1 else ""
        return SceneError(f"is a folder that contains {scenes[0].name}{also}", where=str(folder), hint="give one file")
    if any(p.suffix.lower() == ".exr" for p in entries):
        return SceneError("is a folder of EXR files", where=str(folder), hint=f"path-traced frames are exr:{folder}")
    message = "is a folder without a scene" if entries else "is an empty folder"
    hint = f"give a file ({', '.join(sorted(READERS))}), or numbered .obj files"
    return SceneError(message, where=str(folder), hint=hint)


__all__ = ["CONVERTIBLE", "READERS", "Scene", "load_scene"]
