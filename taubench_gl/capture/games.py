"""The games whose recordings are read, each by the same functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl.capture.cube2 import demo as cube2_demo
from taubench_gl.capture.cube2 import scene as cube2_scene
from taubench_gl.capture.cube2 import textures
from taubench_gl.capture.quake3 import demo as quake3_demo
from taubench_gl.capture.quake3 import paks
from taubench_gl.capture.quake3 import scene as quake3_scene
from taubench_gl.capture.recording import Recording
from taubench_gl.data_files import read_bytes
from taubench_gl.errors import SceneError

MAX_BYTES = 256 << 20
"""Size limit of a recording."""


@dataclass(frozen=True)
class Game:
    """How a game is read.  ``decode``: (bytes, name) -> recording; ``as_recording``: (recording, player, seconds);
    ``files``: folder of the game's data, by default ``folder``, -> files; ``build_scene``: (recording, files, choice,
    path)."""

    decode: Callable[[bytes, str], Any]
    as_recording: Callable[[Any, int | None, float], Recording]
    files: Callable[[Path], Any]
    folder: Path
    build_scene: Callable[..., Any]


QUAKE3 = Game(quake3_demo.decode, quake3_scene.as_recording, paks.Paks, paks.DEBIAN_DATA, quake3_scene.build_scene)
CUBE2 = Game(cube2_demo.decode, cube2_scene.as_recording, textures.Files, textures.DEBIAN_DATA, cube2_scene.build_scene)


def read_recording(path: Path) -> tuple[Game, Any]:
    """The game of a recording, by its content, and the recording.  Raises SceneError."""
    data = read_bytes(path, SceneError, max_bytes=MAX_BYTES)
    game = CUBE2 if data[:2] == b"\x1f\x8b" else QUAKE3  # Cube 2's are gzip
    return game, game.decode(data, str(path))
