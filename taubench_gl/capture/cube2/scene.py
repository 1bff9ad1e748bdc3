"""A part of a recording of Cube 2 as a glTF scene, and a recording as ``capture.recording`` has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from taubench_gl.capture.cube2.demo import Demo
from taubench_gl.capture.cube2.level import read_level
from taubench_gl.capture.cube2.timeline import GRENADE, ROCKET, Shot, Timeline
from taubench_gl.capture.cube2.world import Files, add_lights, add_point, add_world
from taubench_gl.capture.parts import Motion, SceneFile, view_rotations, y_up
from taubench_gl.capture.recording import EXACT_RATE, Choice, Recording, axes, eye_times, key_times, rows_along, windows
from taubench_gl.math3d import mat3_from_quat, normalize
from taubench_gl.metrics.activity import camera_activity
from taubench_gl.scene.builder import box

Array = np.ndarray

METERS = 1 / 8
"""Meters of a cube: a player of 15 cubes is 1.9 m tall."""
UNITS = {"cube": 1.0, "meters": METERS}
"""Unit of the written file -> how many of it are a cube."""
WIDTH = 100.0
"""Field of view across the image in degrees, the game's default."""
NEAR = 0.5
"""Distance from the eye to the near plane, cubes."""
LICENSE = (
    "CC BY 3.0: maps and textures of Debian's cube2-data, by Mozilla (BananaBread), Gregor Koch, John 'geartrooper' "
    "Siar, the Apricot project, Alon Zakai; others: the license of the map and its textures"
)
_WARM, _ROCKET_LIGHT = (0.5, 0.375, 0.25), (1, 0.75, 0.5)
FLASHES = {1: (30, 100, 100), 2: (30, 50, 50), 6: (15, 100, 100), 4: (25, 75, 75), GRENADE: (20, 100, 100)}
"""Weapon -> radius in cubes of its muzzle's light, milliseconds at full and while it fades."""
_STRIDE, _SWING, _FULL_SPEED = 22.0, 35.0, 60.0  # cubes of two steps, degrees of a leg, cubes a second of a full stride
_BODY = {
    "head": ("look", (0, 0, -2), (-2, -2, -1), (2.4, 2, 3)),
    "trunk": ("turn", (0, 0, -8), (-1.6, -2.6, 0), (1.6, 2.6, 5)),
    "arms": ("look", (0, 0, -4.2), (-1, -4, -1.2), (5, 4, 0)),
    "weapon": ("look", (0, -2.6, -4), (2, -0.6, -0.8), (9, 0.6, 0.8)),
    "left leg": ("step", (0, 1.3, -8), (-1.2, -1.1, -6), (1.2, 1.1, 0)),
    "right leg": ("counter step", (0, -1.3, -8), (-1.2, -1.1, -6), (1.2, 1.1, 0)),
}
"""Parts of a player: how it turns, joint from the eye in cubes (forward, left, up), box around the joint."""


def as_recording(demo: Demo, player: int | None = None, seconds: float = Choice.seconds) -> Recording:
    """The recording as one player saw it; None: the one with the window of most rotation.  Raises SceneError,
    SettingsError."""
    grid, timeline = eye_times(demo.seconds, demo.name), Timeline(demo)
    shots = timeline.shots
    times = {
        "shots": [shot.time for shot in shots],
        "rockets": [shot.time for shot in shots if shot.gun == ROCKET],
        "explosions": timeline.times("EXPLODEFX"),
        "deaths": timeline.times("DIED"),
        "lights": [keys[0] for shot in shots for _, _, _, keys, _ in _lights(shot)],
    }
    counts = {kind: np.sort(np.asarray(found, dtype=float)) for kind, found in times.items()}
    names = tuple(f"{number} {demo.names.get(number, '')}".strip() for number in timeline.paths)
    notes = ("the file ends inside a packet; what comes before is used",) if demo.truncated else ()

    def seen(number: int) -> Recording:
        eye = timeline.eye(number, grid)
        return Recording("Cube 2", demo.map_name, demo.seconds, METERS, eye, names, counts, notes, number)

    def rotation(recording: Recording) -> float:
        return max((w.rotation for w in windows(recording, seconds) if w.alive), default=-1.0)

    return max(map(seen, timeline.paths if player is None else [player]), key=rotation)


def build_scene(demo: Demo, files: Files, choice: Choice, path: Path) -> SceneFile:
    """Write the scene to ``path`` (.glb).  Raises SceneError for damaged files, SettingsError for an empty part."""
    times = key_times(choice, demo.seconds, demo.name)
    timeline, now = Timeline(demo), choice.start + times
    eye = timeline.eye(choice.player, now)
    file = SceneFile(times, UNITS[choice.unit], LICENSE)
    map_path, name = files.map_file(demo.map_name)
    level = read_level(files.read(name) or b"", str(map_path))
    add_world(file, level, files, demo.map_name)
    if choice.lights:
        add_lights(file, level)
    file.camera(
        Motion(eye.places, eye.axes, jumps=eye.jumps), NEAR * file.unit, 2 * level.cubes.size * file.unit, WIDTH
    )
    _add_players(file, timeline, now, choice.player)
    _add_shots(file, timeline, now, choice.lights)
    name = f"{demo.map_name} player {choice.player} {choice.start:g} to {choice.start + choice.seconds:g} s"
    file.save(path, name, f"{_note(choice, timeline)}; map of version {level.version}, whole from 29 on")
    return file


def _box(file: SceneFile, name: str, low: tuple, high: tuple, color: tuple) -> int:
    """A mesh of a box between two corners, in units of the game."""
    corners = np.array([low, high])
    shape = box(np.ptp(corners, axis=0) / 2)
    positions, uv = shape.positions + corners.mean(axis=0), np.zeros((len(shape.positions), 2))
    material = file.writer.material(name, color, roughness=0.7)
    return file.writer.mesh(name, file.primitive(positions, shape.normals, uv, shape.triangles, material))


def _add_players(file: SceneFile, timeline: Timeline, now: Array, camera: int | None) -> None:
    """Add the other players: six boxes with joints that follow the view, and legs that step as far as they walk."""
    meshes = {part: _box(file, part, *corners, (0.45, 0.3, 0.22)) for part, (_, _, *corners) in _BODY.items()}
    for player in timeline.paths:
        eye = timeline.eye(player, now)
        if player == camera or not eye.alive.any():
            continue
        yaw = np.degrees(np.arctan2(eye.axes[:, 0, 1], eye.axes[:, 0, 0]))
        moved = np.linalg.norm(np.diff(eye.places[:, :2], axis=0, prepend=eye.places[:1, :2]), axis=1) * ~eye.jumps
        speed = moved / np.diff(now, prepend=now[0] - 1)
        swing = _SWING * np.minimum(speed / _FULL_SPEED, 1) * np.sin(2 * np.pi * np.cumsum(moved) / _STRIDE)
        pitches = {"turn": 0 * swing, "step": swing, "counter step": -swing}
        turns = {move: axes(np.stack([pitch, yaw, 0 * yaw], 1)) for move, pitch in pitches.items()} | {"look": eye.axes}
        for part, (move, joint, *_) in _BODY.items():
            places = eye.places + np.einsum("j,njk->nk", np.array(joint, float), turns["turn"])
            motion = Motion(places, turns[move], eye.alive, jumps=eye.jumps)
            file.place(f"player {player} {part}", "", meshes[part], motion)
        file.counts["players"] += 1


def _lights(shot: Shot) -> list[tuple[str, float, tuple, Array, list[float]]]:
    """Lights of a shot: name, radius in cubes, color, and seconds at which each brightness is reached."""
    out = []
    if shot.gun in FLASHES:
        radius, hold, fade = FLASHES[shot.gun]
        out.append(("muzzle", radius, _WARM, shot.time + np.array([0, hold, hold + fade]) / 1000, [1, 1, 0]))
    if shot.gun == ROCKET:
        out.append(("rocket light", 20, _ROCKET_LIGHT, np.array([shot.time, shot.end - 1e-6]), [1, 1]))
        if shot.exploded:
            out.append(("explosion", 46, (2, 1.5, 1), shot.end + np.array([0, 0.1, 0.8]), [0, 1, 0]))
    return out


def _add_shots(file: SceneFile, timeline: Timeline, now: Array, lights: bool) -> None:
    """Add rockets, and the lights of shots, rockets and explosions, one each."""
    rocket = _box(file, "rocket", (-1.5, -0.5, -0.5), (1.5, 0.5, 0.5), (0.3, 0.3, 0.3))
    for number, shot in enumerate(timeline.shots):
        flies, places = (now >= shot.time) & (now < shot.end), shot.at(now)
        if shot.gun == GRENADE and flies.any():
            file.lost["grenades and their explosions, whose places a recording has not"] += 1
        if shot.gun == ROCKET and flies.any():
            rows = rows_along(normalize(shot.goal - shot.start)[None]).repeat(len(now), 0)
            file.place(f"rocket {number}", "rockets", rocket, Motion(places, rows, flies))
        for name, radius, color, keys, levels in _lights(shot) if lights else ():
            brightness = np.interp(now, keys, levels, 0, 0)
            where = shot.start[None].repeat(len(now), 0) if name == "muzzle" else places
            add_point(file, f"{name} {number}", "dynamic lights", where, np.array(color), radius, brightness)


def _note(choice: Choice, timeline: Timeline) -> str:
    """The note that every evaluation of the scene prints."""
    frames = timeline.eye(choice.player, choice.start + np.arange(choice.seconds * EXACT_RATE + 1e-6) / EXACT_RATE)
    steps = camera_activity(y_up(frames.places), mat3_from_quat(view_rotations(frames.axes)))
    means = (float(np.mean(values[~frames.jumps[1:]])) for values in (steps.yaw, steps.pitch, 16 * steps.position))
    yaw, pitch, move = (f"{100 / mean:.0f} %" if mean > 0.01 else "all" for mean in means)
    unit = "1 unit is a cube" if choice.unit == "cube" else f"{1 / METERS:g} cubes are 1 m"
    jumps = f"{int(frames.jumps.sum())} jumps of the camera, " if frames.jumps.any() else ""
    return (
        f"recorded game: {unit}, {jumps}no view weapon, no roll; keys at {choice.fps:g} and {EXACT_RATE:g} fps; "
        f"angles are stored in whole degrees, {yaw} of the mean turn in yaw and {pitch} in pitch per frame at "
        f"{EXACT_RATE:g} fps, places in 1/16 cube, {move} of the mean move: the path is the smoothest inside of these"
    )
