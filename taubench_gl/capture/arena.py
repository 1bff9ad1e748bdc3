"""Scenes of the registry that are recorded games: made from a recording and the game's data files on first use.

Which part of a recording: ``recording.RULE``, the same for all.
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

from taubench_gl.capture.games import CUBE2, QUAKE3, Game
from taubench_gl.capture.recording import Choice, best_window
from taubench_gl.data_files import code_hash, hashed, read_bytes
from taubench_gl.datasets.registry import Entry, load_registry
from taubench_gl.errors import SceneError
from taubench_gl.outputs import output_folder
from taubench_gl.paths import ASSETS, cache_folder
from taubench_gl.study.store import content_hash

RECORDINGS = ASSETS / "recordings"


@cache
def arena_scenes() -> dict[str, Entry]:
    """Scenes of the package's registry that are recorded games, by name."""
    return {name: entry for name, entry in load_registry().items() if entry.recording is not None}


def make_arena(name: str, path: Path, data: Path | None = None) -> str:
    """Write a scene of ``arena_scenes`` to ``path`` (.glb).  -> which part of the recording.  Raises SceneError."""
    game, demo, files = _opened(name, data)
    recording = game.as_recording(demo, None, Choice.seconds)
    window = best_window(recording, Choice.seconds)
    game.build_scene(demo, files, Choice(window.start, player=recording.player), path)
    return f"{demo.map_name}, {window.start:g} to {window.start + Choice.seconds:g} s of {Path(demo.name).name}"


def arena_file(name: str) -> Path:
    """The file of a scene of ``arena_scenes`` in the cache; other code, recordings or maps give another.

    Raises SceneError without the game's data files.
    """
    _, demo, files = _opened(name, None)
    level = hashlib.sha256(files.read(files.map_file(demo.map_name)[1]) or b"").hexdigest()
    key = content_hash([_code(), name, level, *(str(path) for path in sorted(files.folder.glob("*.pk3")))])
    path = output_folder(cache_folder() / "scenes-made" / key) / f"{name}.glb"
    if not path.is_file():
        make_arena(name, path)
    return path


def _opened(name: str, folder: Path | None) -> tuple[Game, Any, Any]:
    """The game, the recording, which is ours or one in the game's archives, and the game's data."""
    source = str(arena_scenes()[name].recording)
    game = CUBE2 if source.endswith(".dmo") else QUAKE3
    files = game.files(folder or game.folder)
    data = files.read(source) if "/" in source else read_bytes(RECORDINGS / source, SceneError)
    if data is None:
        hint = "apt-get install openarena-088-data"
        raise SceneError(f"holds no {source}", where=str(files.folder), hint=hint)
    return game, game.decode(data, source), files


@cache
def _code() -> str:
    """Hash of the code and of our recordings that scenes follow from."""
    recordings = [hashed(path, SceneError).hexdigest() for path in sorted(RECORDINGS.glob("*.dm*"))]
    return content_hash([code_hash(("capture", "datasets/gltf_writer.py"), shaders=()), recordings])
