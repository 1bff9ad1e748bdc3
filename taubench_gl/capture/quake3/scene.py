"""A part of a demo as a glTF scene, and a demo as a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from taubench_gl.capture.parts import Motion, SceneFile
from taubench_gl.capture.quake3 import things
from taubench_gl.capture.quake3.bsp import Bsp
from taubench_gl.capture.quake3.demo import ENTITY, MAX_PLAYERS, Demo
from taubench_gl.capture.quake3.paks import Paks
from taubench_gl.capture.quake3.players import add_players
from taubench_gl.capture.quake3.surfaces import Surfaces
from taubench_gl.capture.quake3.timeline import FIRE, IMPACTS, MISSILE_KIND, UNIT, Timeline
from taubench_gl.capture.recording import EXACT_RATE, Choice, Eye, Recording, eye_times, key_times

NEAR = 4.0
"""Units from the eye to the near plane, as in the engine."""
LICENSE = "derived from the game's maps, models and images; those of OpenArena: GPL-2.0, by the OpenArena team"


def as_recording(demo: Demo, player: int | None = None, seconds: float = 0.0) -> Recording:
    """The demo for ``info`` and the search for windows; ``player``, ``seconds``: of Cube 2 only, whose recordings have
    all players.

    Raises SceneError for one of more than an hour.
    """
    timeline = Timeline(demo, eye_times(demo.seconds, demo.name))
    first = demo.snapshots[0].time
    missiles = {
        key: timeline.ms[np.argmax(track.present)]
        for key, track in timeline.tracks(MISSILE_KIND, ("weapon", "time")).items()
    }
    impacts = [event for event in timeline.events if event.kind in IMPACTS and event.number >= 0]
    lit = [event.time for event in impacts if int(event.state[ENTITY["weapon"]]) in things.EXPLOSIONS]
    lit += [time for (_, weapon, _), time in missiles.items() if weapon in things.GLOWING]
    times = {
        "shots": [event.time for event in timeline.events if event.kind == FIRE],
        "missiles": list(missiles.values()),
        "explosions": [event.time for event in impacts],
    }
    times["lights"] = times["shots"] + lit  # each shot has a flash
    counts = {kind: (np.array(sorted(found), dtype=float) - first) / 1000 for kind, found in times.items()}
    clients = {number for snapshot in demo.snapshots for number in snapshot.entities if number < MAX_PLAYERS}
    names = (demo.player_info(client).get("n", "") for client in sorted(clients))
    players = tuple(filter(None, names))
    notes = {
        "the file ends inside a message; what comes before is used": demo.truncated,
        f"{demo.starts} maps were started; the last is used": demo.starts > 1,
        f"{demo.invalid} snapshots count from one that was not received, and are left out": demo.invalid,
    }
    said = tuple(note for note, holds in notes.items() if holds)
    return Recording("Quake 3", demo.map_name, demo.seconds, UNIT, timeline.eye(), players, counts, said)


def build_scene(demo: Demo, paks: Paks, choice: Choice, path: Path) -> SceneFile:
    """Write the scene to ``path`` (.glb).  Raises SceneError for damaged files, SettingsError for an empty part."""
    times = key_times(choice, demo.seconds, demo.name)
    timeline = Timeline(demo, choice.start + times)
    file = SceneFile(times, UNIT, LICENSE)
    surfaces = Surfaces(file, paks)
    bsp = read_map(demo, paks)
    world = surfaces.brush_mesh(bsp, 0, demo.map_name)
    file.writer.node("world", **({} if world is None else {"mesh": world}))
    if choice.lights:
        surfaces.add_lights(bsp)
    eye = timeline.eye(choice.roll)
    file.camera(Motion(eye.places, eye.axes, jumps=eye.jumps), NEAR * UNIT)
    things.add_movers(timeline, surfaces, bsp)
    things.add_items(timeline, surfaces)
    things.add_missiles(timeline, surfaces, choice.lights)
    things.add_flashes(timeline, surfaces, eye, choice.lights)
    if choice.view_weapon:
        things.add_view_weapon(timeline, surfaces, eye)
    add_players(timeline, surfaces)
    name = f"{demo.map_name} {choice.start:g} to {choice.start + choice.seconds:g} s"
    file.save(path, name, _note(choice, eye))
    return file


def read_map(demo: Demo, paks: Paks) -> Bsp:
    """The map of a demo.  Raises SceneError if no archive holds it, or it is damaged."""
    _, name = paks.map_file(demo.map_name)
    return Bsp(paks.read(name) or b"", paks.where(name))


def _note(choice: Choice, eye: Eye) -> str:
    """The note that every evaluation of the scene prints."""
    weapon = "with the view weapon, which camera reprojection rejects" if choice.view_weapon else "no view weapon"
    jumps = f"{int(eye.jumps.sum())} jumps of the camera, " if eye.jumps.any() else ""
    return (
        f"recorded game: {weapon}, {jumps}{1 / UNIT:g} units are 1 m, keys at {choice.fps:g} and {EXACT_RATE:g} fps; "
        "no fog, no marks on walls; the game has no normal maps: the normal column is not comparable with the paper's"
    )
