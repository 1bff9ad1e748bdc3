"""``taubench-gl capture``: recorded games -> glTF, what is in them, and new recordings."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import AS_JSON, Commands, command
from taubench_gl.apps.screen import note, show_json, show_notes, show_pairs
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.fields import REQUIRED, above_zero, at_least, one_of, setting

DATA = setting(
    None, "Folder of the game's data: OpenArena's .pk3 files, or that with Cube 2's packages", flag="--data",
    metavar="DIR", shown="where Debian's packages put it",
)  # fmt: skip
PLAYER = setting("best", "Cube 2: whose view; best: the player with the window of most rotation", metavar="NUMBER|best")
SECONDS = setting(6.0, "Length of a window", above_zero("seconds above 0"), unit="s")
BEST = "best"


@click.group(cls=Commands, default="run")
def capture() -> None:
    """Make scenes of recorded games, as the paper captures its scenes: 'capture GAME.dm_71 --out OUT.glb'.

    GAME is a demo of the Quake 3 family (Quake 3, OpenArena: .dm_68, .dm_70, .dm_71) or of Cube 2 (Sauerbraten: .dmo),
    the engine of the paper's scenes.  Maps, models and images come from the game's data files.  A scene made of them is
    a derived work: OpenArena's are GPL 2, those of Debian's cube2-data CC BY 3.0.

    Examples:
      taubench-gl capture info game.dm_71
      taubench-gl capture game.dm_71 --start best --out scene.glb
      taubench-gl capture game.dmo --player best --unit meters --out scene.glb
      taubench-gl capture record --map oa_shouse --bots 14 --out game.dm_71
    """


@command()
@click.argument("game", type=click.Path(path_type=Path), metavar="GAME")
def run(
    game: Path,
    *,
    data: Path | None = DATA,
    player: str = PLAYER,
    start: str = setting(
        BEST, "Second of the recording, or best: the window with the most rotation in which the player lives",
        metavar="SECOND|best",
    ),
    seconds: float = SECONDS,
    fps: float = setting(60.0, "Rate of the keys; frames at 24 fps have keys too", at_least(1, most=1000)),
    unit: str = setting("cube", "Cube 2: unit of the file; meters: 8 cubes are one", one_of(("cube", "meters"))),
    view_weapon: bool = setting(
        True, "Quake 3: the weapon in the player's hands", flag="--view-weapon/--no-view-weapon"
    ),
    roll: bool = setting(True, "Quake 3: lean of the view by walking and running", flag="--roll/--no-roll"),
    lights: str = setting("game", "Suns, light entities, shots and explosions, or none", one_of(("game", "none"))),
    out: Path = setting(REQUIRED, "File of the scene", metavar="OUT.glb"),
) -> None:  # fmt: skip
    """Write a part of a recorded game as a glTF scene.

    World, doors, items, missiles, players and their lights move as the game moves them, and the camera is the player's
    eye.  32 units of Quake 3 are a meter.  What the game draws and the file has not is listed.

    Examples:
      taubench-gl capture run game.dm_71 --start 12 --out scene.glb
      taubench-gl capture run game.dm_71 --start best --no-view-weapon --out scene.glb

    An object fixed to the camera, as the view weapon, is rejected by camera reprojection: it adds 0.5 to 3.5 points of
    frustum, and 4 to 10 of position and of normal.  docs/capture.md says what is in a scene.
    """
    from taubench_gl.capture.games import read_recording
    from taubench_gl.capture.recording import Choice, best_window

    reader, demo = read_recording(game)
    files = reader.files(data or reader.folder)
    recording, first = (
        reader.as_recording(demo, _number(player, int, "player"), seconds),
        _number(start, float, "start"),
    )
    first = best_window(recording, seconds).start if first is None else first
    choice = Choice(first, seconds, fps, view_weapon, roll, lights == "game", recording.player, unit)
    file = reader.build_scene(demo, files, choice, out)
    show_notes(recording.notes)
    made, lost = (", ".join(f"{n:,} {kind}" for kind, n in c.items() if n) for c in (file.counts, file.lost))
    player_text = "" if recording.player is None else f", player {recording.player}"
    click.echo(f"{demo.map_name}{player_text}, {first:g} to {first + seconds:g} s: {made}")
    click.echo(f"not in the file: {lost}, fog and marks")
    click.echo(f"{out}: {out.stat().st_size:,} bytes; {file.writer.gltf.asset.copyright}")
    click.echo(f"Tables 1 to 4: taubench-gl evaluate {out} --fps {fps:g}")


def _number(text: str, kind: type, setting: str) -> Any:
    """``text`` as a number of type ``kind``, None for ``best``.  Raises SettingsError that names ``setting``."""
    try:
        return None if text == BEST else kind(text)
    except ValueError:
        hint = "give a number, or best: 'capture info' lists them"
        raise SettingsError(f"is {text!r:.60}", setting=setting, hint=hint) from None


@command()
@click.argument("game", type=click.Path(path_type=Path), metavar="GAME")
def info(
    game: Path,
    *,
    data: Path | None = DATA,
    player: str = PLAYER,
    seconds: float = SECONDS,
    as_json: bool = AS_JSON,
) -> None:
    """Show map, players, when the recording player lives, and the windows of a recording by rotation.

    Needs only the recording; --data says which archives hold the map.

    Examples:
      taubench-gl capture info game.dm_71
      taubench-gl capture info game.dm_71 --json
    """
    from taubench_gl.capture.games import read_recording
    from taubench_gl.capture.recording import RULE, STEP, stretches, windows

    reader, demo = read_recording(game)
    recording = reader.as_recording(demo, _number(player, int, "player"), seconds)
    ranked = sorted(windows(recording, seconds), key=lambda window: (not window.alive, -window.rotation))
    alive = stretches(recording.eye.times, recording.eye.alive)
    facts = {
        "game": recording.game,
        "map": recording.map_name,
        "map in": _holder(recording.map_name, reader, data),
        "seconds": round(recording.seconds, 3),
        "players": ", ".join(recording.players),
        **({} if recording.player is None else {"player": recording.player}),
        "lives (s)": ", ".join(f"{a:.2f} to {b:.2f}" for a, b in alive) or "never",
        **{kind: len(times) for kind, times in recording.counts.items()},
    }
    if as_json:
        show_json({**facts, "windows": [asdict(window) for window in ranked], "notes": recording.notes})
        return
    show_pairs(f"Recording {game.name}", facts)
    show_notes(recording.notes)
    click.echo(f"Windows of {seconds:g} s, one every {STEP:g} s, by rotation; 'best' is {RULE}:")
    for window in ranked:
        events = ", ".join(f"{number} {kind}" for kind, number in window.counts.items())
        lives = "lives" if window.alive else "dies or watches"
        rates = f"{window.rotation:6.1f} deg/s  {window.moved:5.2f} m/s  {lives}"
        click.echo(f"  --start {window.start:<5g} {rates}, {window.jumps} jumps, {events}")


def _holder(map_name: str, reader: Any, data: Path | None) -> str:
    """The file whose map is used, or what to install."""
    try:
        return reader.files(data or reader.folder).map_file(map_name)[0].name
    except SceneError as error:
        return str(error)


@command()
def record(
    *,
    map_name: str = setting(REQUIRED, "Map", flag="--map", metavar="NAME"),
    bots: int = setting(8, "Players, all of them bots", at_least(1, most=31)),
    seconds: float = setting(24.0, "Length of the recording at least", above_zero("seconds above 0"), unit="s"),
    rockets: bool = setting(False, "OpenArena: rocket launchers only"),
    limit: float = setting(300.0, "The game is killed after this time, and tried again", above_zero(), unit="s"),
    out: Path = setting(REQUIRED, "File of the recording", metavar="OUT.dm_71|OUT.dmo"),
) -> None:
    """Record a match between bots: of OpenArena, seen by one of them, at a snapshot every 16 ms; with OUT.dmo of
    Cube 2, which has all players, at a quarter of its speed, so that each is stored about 100 times a second.

    Examples:
      taubench-gl capture record --map oa_shouse --bots 14 --seconds 24 --out game.dm_71
      taubench-gl capture record --map two_towers --bots 31 --seconds 8 --out game.dmo

    Needs ioquake3 and OpenArena (apt-get install ioquake3 openarena), or for OUT.dmo Cube 2 (apt-get install cube2
    cube2-data); no screen and no GPU.  Two recordings differ: the file, not the command, is the source of a scene.
    """
    if out.suffix == ".dmo":
        if rockets:
            raise SettingsError("is for OpenArena", setting="rockets", hint="give OUT.dm_71")
        from taubench_gl.capture.cube2.record import record as record_game
    else:
        from taubench_gl.capture.quake3.record import record as record_game

    options = {"rockets": True} if rockets else {}
    demo = record_game(map_name, bots, seconds, out, limit=limit, **options)
    click.echo(f"{out}: {demo.map_name}, {demo.seconds:.1f} s")
    note(f"its windows: taubench-gl capture info {out}")


for member in (run, info, record):
    capture.add_command(member)
