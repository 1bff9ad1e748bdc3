"""Scenes of the registry that are recorded games: made from a recording and the game's data files on first use.

Which part of a recording: ``recording.RULE``, the same for all.
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from taubench_gl.capture.quake3.demo import Demo, decode
from taubench_gl.capture.quake3.paks import DEBIAN_DATA, Paks
from taubench_gl.capture.quake3.scene import as_recording, build_scene
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


def make_arena(name: str, path: Path, data: Path = DEBIAN_DATA) -> str:
    """Write a scene of ``arena_scenes`` to ``path`` (.glb).  -> which part of the recording.  Raises SceneError."""
    paks = Paks(data)
    demo = _demo(arena_scenes()[name], paks)
    window = best_window(as_recording(demo), Choice.seconds)
    build_scene(demo, paks, Choice(window.start), path)
    return f"{demo.map_name}, {window.start:g} to {window.start + Choice.seconds:g} s of {Path(demo.name).name}"


def arena_file(name: str, data: Path = DEBIAN_DATA) -> Path:
    """The file of a scene of ``arena_scenes`` in the cache; other code, recordings or maps give another.

    Raises SceneError without the game's data files.
    """
    paks = Paks(data)
    demo = _demo(arena_scenes()[name], paks)
    level = hashlib.sha256(paks.read(paks.map_file(demo.map_name)[1]) or b"").hexdigest()
    key = content_hash([_code(), name, level, *(str(path) for path in sorted(data.glob("*.pk3")))])
    path = output_folder(cache_folder() / "scenes-made" / key) / f"{name}.glb"
    if not path.is_file():
        make_arena(name, path, data)
    return path


def _demo(entry: Entry, paks: Paks) -> Demo:
    """The recording of a scene: ours, or one in the game's archives."""
    name = str(entry.recording)
    data = paks.read(name) if "/" in name else read_bytes(RECORDINGS / name, SceneError)
    if data is None:
        hint = "apt-get install openarena-088-data"
        raise SceneError(f"holds no {name}", where=str(paks.folder), hint=hint)
    return decode(data, name)


@cache
def _code() -> str:
    """Hash of the code and of our recordings that scenes follow from."""
    recordings = [hashed(path, SceneError).hexdigest() for path in sorted(RECORDINGS.glob("*.dm_*"))]
    return content_hash([code_hash(("capture", "datasets/gltf_writer.py"), shaders=()), recordings])
