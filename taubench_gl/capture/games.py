"""The games whose recordings are read, each by the same functions."""

from __future__ import annotations

from collections import namedtuple
from pathlib import Path
from typing import Any

import taubench_gl.capture.cube2.demo as cube2_demo
import taubench_gl.capture.cube2.scene as cube2
import taubench_gl.capture.quake3.demo as quake3_demo
import taubench_gl.capture.quake3.scene as quake3
from taubench_gl.capture.cube2 import world
from taubench_gl.capture.quake3 import paks
from taubench_gl.data_files import read_bytes
from taubench_gl.errors import SceneError

MAX_BYTES = 256 << 20
"""Size limit of a recording."""


Game = namedtuple("Game", "decode as_recording build_scene files folder")
"""How a game is read.  ``decode``: (bytes, name) -> recording; ``as_recording``: (recording, player, seconds) ->
``Recording``; ``build_scene``: (recording, files, choice, path); ``files``: data of a folder, ``folder``: Debian's."""
QUAKE3 = Game(quake3_demo.decode, quake3.as_recording, quake3.build_scene, paks.Paks, paks.DEBIAN_DATA)
CUBE2 = Game(cube2_demo.decode, cube2.as_recording, cube2.build_scene, world.Files, world.DEBIAN_DATA)


def read_recording(path: Path) -> tuple[Game, Any]:
    """The game of a recording, by its content, and the recording.  Raises SceneError."""
    data = read_bytes(path, SceneError, max_bytes=MAX_BYTES)
    game = CUBE2 if data[:2] == b"\x1f\x8b" else QUAKE3  # Cube 2's are gzip
    return game, game.decode(data, str(path))
