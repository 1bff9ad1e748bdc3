"""Records demos of matches between bots with ioquake3 and OpenArena, without a screen and faster than real time."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from taubench_gl.capture.play import play, recorded
from taubench_gl.capture.quake3.demo import Demo
from taubench_gl.errors import SettingsError
from taubench_gl.outputs import write_atomically

INSTALL = "apt-get install ioquake3 openarena"
FOLDERS = (Path("/usr/lib/openarena"), Path("/usr/share/games/openarena"))
"""Where Debian's packages put the game."""
BOTS = (
    "angelyss", "arachna", "ayumi", "beret", "gargoyle", "grism", "grunt", "jenna", "kyonshi", "liz", "major", "merman",
    "murielle", "neko", "penguin", "rai", "sarge", "sergei", "skelebot", "smarine",
)  # fmt: skip
STEP = 16
"""Milliseconds of the game per frame, and from snapshot to snapshot."""
TRIES = 4
_SETTINGS = {
    "com_basegame": "baseoa", "com_homepath": ".openarena", "com_legacyprotocol": 71, "com_protocol": 71, "vm_game": 0,
    "vm_cgame": 0, "vm_ui": 0, "r_mode": -1, "r_customwidth": 64, "r_customheight": 48, "r_fullscreen": 0,
    "s_initsound": 0, "sv_fps": 60, "snaps": 60, "rate": 90000, "sv_maxclients": 24, "g_gametype": 0, "fraglimit": 0,
    "timelimit": 0, "com_maxfps": 1000, "sv_pure": 0, "com_hunkmegs": 512,
}  # fmt: skip


def record(map_name: str, bots: int, seconds: float, out: Path, *, rockets: bool = False, limit: float = 300.0) -> Demo:
    """Record at least ``seconds`` of a match between bots, seen by the first, to ``out``, and return it decoded.

    ``rockets``: rocket launchers only; ``limit``: seconds after which an attempt is killed.  One start of the engine in
    about ten hangs: it is tried TRIES times.  Raises SettingsError without the game, SceneError if nothing is recorded.
    """
    engine = shutil.which("ioquake3", path=f"{os.environ.get('PATH', '')}:/usr/lib/ioquake3")  # Debian's
    folder = next((folder for folder in FOLDERS if (folder / "baseoa").is_dir()), None)
    if engine is None or folder is None:
        raise SettingsError("ioquake3 and OpenArena are not installed", hint=INSTALL)
    settings = _SETTINGS | {"fs_basepath": folder, "g_rockets": int(rockets)}
    command = [engine, *(word for name, value in settings.items() for word in ("+set", name, str(value)))]
    command += ["+devmap", map_name, "+set", "r_norefresh", "1", "+set", "fixedtime", str(STEP), "+exec", "record.cfg"]
    return recorded(lambda home: _play(command, home, bots, seconds, limit), map_name, seconds, out, TRIES)


def _play(command: list[str], home: Path, bots: int, seconds: float, limit: float) -> Path | None:
    """Run the engine; the demo that it wrote, None if it did not come up or was killed at the limit."""
    data = home / ".openarena" / "baseoa"
    data.mkdir(parents=True)
    lines = ["wait 600", *(f"addbot {BOTS[i % len(BOTS)]} 5" for i in range(bots)), "wait 60", "team s", "wait 1200"]
    waits = round(2 * seconds * 1000 / STEP)  # the engine counts a wait twice per frame
    lines += ["follow 1", "wait 60", "record made", f"wait {waits}", "stoprecord", "wait 10", "quit"]
    write_atomically(data / "record.cfg", "\n".join(lines) + "\n")
    return next(data.glob("demos/made.dm_*"), None) if play(command, home, limit) else None
