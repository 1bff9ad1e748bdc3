"""Reading scenes.  ``load_scene`` is the one way in; ``model`` is what comes out.  No GL."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from taubench_gl.errors import SceneError
from taubench_gl.scene.model import Scene
from taubench_gl.scene.obj.reader import is_sequence


def _read_gltf(path: Path, scene: str | int | None, animation: Sequence[str | int] | None) -> Scene:
    from taubench_gl.scene.gltf.reader import read_gltf

    return read_gltf(path, scene, animation)


def _read_aff(path: Path, scene: str | int | None, animation: Sequence[str | int] | None) -> Scene:
    from taubench_gl.scene.aff.reader import read_aff

    return read_aff(path, scene, animation)


def _read_obj(path: Path, scene: str | int | None, animation: Sequence[str | int] | None) -> Scene:
    from taubench_gl.scene.obj.reader import read_obj

    return read_obj(path, scene, animation)


READERS: dict[str, Callable[[Path, str | int | None, Sequence[str | int] | None], Scene]] = {
    ".gltf": _read_gltf,
    ".glb": _read_gltf,
    ".obj": _read_obj,
    ".aff": _read_aff,
    ".nff": _read_aff,
}
"""File suffix, lower case -> reader.  A reader is imported when the first file of its kind is read."""


def load_scene(path: str | Path, scene: str | int | None = None, animation: Sequence[str | int] | None = None) -> Scene:
    """Read and validate one scene: a file, or a numbered sequence of OBJ files.

    A sequence is a folder of name000.obj, name001.obj ... or a pattern (``name%04d.obj``, ``name*.obj``), with or
    without ``seq:`` before it, and with ``@FPS`` behind it where it does not run at 24 frames per second.

    ``scene`` is the name or index of the scene to show; None takes the file's default, else its first.  ``animation``
    lists names or indices of the animations to play; None plays all that do not fight over one target.  What the
    reader decided on its own is in ``Scene.notes``.

    Raises ``SceneError`` for anything missing, unreadable, invalid or not supported.
    """
    if not str(path):
        raise SceneError("no scene was named", hint="give a scene file, a folder of numbered .obj files, or exr:DIR")
    if is_sequence(str(path)):
        from taubench_gl.scene.obj.reader import read_obj_sequence

        return read_obj_sequence(str(path), scene, animation)
    path = Path(path)
    if os.path.isdir(path):  # which is False, and no error, for a name that is too long
        raise _no_scene_in(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        hint = f"known: {', '.join(sorted(READERS))}"
        if path.suffix.lower() in (".fbx", ".blend"):
            hint += f"; make it glTF first: taubench-gl convert {path.name} {path.stem}.glb"
        elif not path.suffix:
            hint += "; names of scenes: taubench-gl scenes list"
        raise SceneError(f"no reader for files ending in {path.suffix!r}", where=path.name, hint=hint)
    return reader(path, scene, animation)


def _no_scene_in(folder: Path) -> SceneError:
    """What to say of a folder that is no sequence: what lies in it, and what to do."""
    try:
        found = sorted(p for p in folder.iterdir() if not p.name.startswith("."))
    except OSError as error:
        return SceneError(f"cannot be read: {error.strerror}", where=str(folder))
    scenes = [p for p in found if p.suffix.lower() in READERS]
    if scenes:
        more = f" and {len(scenes) - 1} more" if len(scenes) > 1 else ""
        return SceneError(f"is a folder, with {scenes[0].name}{more} in it", where=str(folder), hint="name one file")
    if any(p.suffix.lower() == ".exr" for p in found):
        return SceneError("is a folder of EXR files", where=str(folder), hint=f"path-traced frames are exr:{folder}")
    what = "is a folder without a scene" if found else "is a folder with nothing in it"
    hint = f"give a file ({', '.join(sorted(READERS))}), or numbered .obj files"
    return SceneError(what, where=str(folder), hint=hint)


__all__ = ["READERS", "Scene", "load_scene"]
