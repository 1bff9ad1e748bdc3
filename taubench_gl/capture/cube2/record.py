"""Records matches between bots with Cube 2, without a screen."""

from __future__ import annotations

from pathlib import Path

from taubench_gl.capture.cube2.demo import Demo
from taubench_gl.capture.cube2.world import DEBIAN_DATA, INSTALL
from taubench_gl.capture.play import play, recorded
from taubench_gl.errors import SettingsError
from taubench_gl.outputs import write_atomically

CLIENT = Path("/usr/lib/cube2/cube2_client")
"""Where Debian's package cube2 puts the engine."""
SPEED = 25
"""Percent of real time: places are sent every 33 ms of real time, so that a second of the game has 120."""
START = 5.5
"""Seconds of the game from the start of the match, until all bots play."""
_SETTINGS = (
    "vsync 0; maxfps 200; shaders 0; shadowmap 0; glare 0; maxdynlights 0; maxparticles 10; blobs 0; ragdoll 0; "
    "decals 0; hidehud 1; autorecorddemo 1; mode 5"
)


def record(map_name: str, bots: int, seconds: float, out: Path, *, limit: float = 300.0) -> Demo:
    """Record at least ``seconds`` of a match between bots to ``out``, and return it decoded.

    ``limit``: seconds after which the engine is killed.  Raises SettingsError without the game, SceneError if too
    little is recorded.
    """
    if not CLIENT.is_file() or not DEBIAN_DATA.is_dir():
        raise SettingsError("Cube 2 is not installed", hint=INSTALL)
    start, stop = round(1000 * START), round(1000 * (START + seconds + 1))
    script = f"""{_SETTINGS}; map {map_name}
sleep 1000 [ fog 16; spectator 1; loop i {bots} [ addbot 90 ] ]
sleep {start} [ gamespeed {SPEED} ]
sleep {stop} [ stopdemo; sleep 100 [ getdemo 1 made; sleep 300 [ quit ] ] ]
"""

    def attempt(home: Path) -> Path | None:
        write_atomically(home / "record.cfg", script)
        command = [CLIENT, f"-q{home}", f"-k{DEBIAN_DATA}", "-t0", "-w320", "-h240", "-xexec record.cfg"]
        made = home / "demo" / "made.dmo"
        return made if play(command, home, limit) and made.is_file() else None

    return recorded(attempt, map_name, seconds, out, 1)
