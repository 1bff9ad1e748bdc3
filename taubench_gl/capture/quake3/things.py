"""Items, doors and lifts, missiles, the view weapon, and the lights of shots, missiles and explosions.

Models, movements, lights: ioquake3 (``code/cgame/cg_ents.c``, ``cg_weapons.c``, ``code/game/bg_misc.c``).
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from taubench_gl.capture import light
from taubench_gl.capture.parts import Motion
from taubench_gl.capture.quake3 import timeline as tl
from taubench_gl.capture.quake3.bsp import Bsp
from taubench_gl.capture.quake3.demo import ENTITY, HIDDEN, PLAYER
from taubench_gl.capture.quake3.players import WEAPONS, weapon_meshes
from taubench_gl.capture.quake3.surfaces import Surfaces
from taubench_gl.capture.recording import Eye, rows_along
from taubench_gl.math3d import normalize

Array = np.ndarray
Color = tuple[float, float, float]

_LIGHTS = "dynamic lights"
_GRENADE, _ROCKET, _PLASMA, _BFG = 4, 5, 8, 9
_ITEMS = {
    "powerups/armor/{}": "shard armor_yel armor_red",
    "powerups/health/{}": "small_cross medium_cross large_cross mega_cross",
    "weapons2/{0}/{0}": "gauntlet shotgun machinegun grenadel rocketl lightning railgun plasma bfg grapple",
    "powerups/ammo/{}": "shotgunam machinegunam grenadeam plasmaam lightningam rocketam railgunam bfgam",
    "powerups/holdable/{}": "teleporter medkit",
    "powerups/instant/{}": "quad enviro haste invis regen flight",
}
ITEMS = ("", *(f"models/{path.format(name)}.md3" for path, names in _ITEMS.items() for name in names.split()))
"""Model of each number of an item."""
HEALTH, WEAPON_ITEMS = range(4, 8), range(8, 18)
_YELLOW, _ORANGE, _BLUE = (1, 1, 0), (1, 0.75, 0), (0.6, 0.6, 1)
_FLASHES: dict[int, Color] = {
    1: _BLUE, _GRENADE: (1, 0.7, 0), _ROCKET: _ORANGE, 6: _BLUE, 7: (1, 0.5, 0), _PLASMA: _BLUE, _BFG: (1, 0.7, 1)
}  # fmt: skip
FLASH_MS, FLASH_RADIUS = 20, 315
"""A muzzle flash: milliseconds, and the mean of the radius that the game draws at random (300 to 331)."""
GLOWING: dict[int, tuple[float, Color]] = {_ROCKET: (200, _ORANGE)}
"""Missile -> radius in units and color of its light; others have none."""
_BOLTS: dict[int, tuple[Color, float]] = {_PLASMA: (_BLUE, 8), _BFG: ((0.6, 1, 0.6), 12)}
_MISSILES = {_ROCKET: "models/ammo/rocket/rocket.md3", _GRENADE: "models/ammo/grenade1.md3"}
EXPLOSIONS: dict[int, tuple[float, Color, float]] = {_GRENADE: (300, _YELLOW, 600), _ROCKET: (300, _ORANGE, 1000)}
"""Weapon -> radius in units, color and milliseconds of the light of its explosion."""
_SPRITES = {2: "bullet marks", 3: "bullet marks", 6: "lightning bolts", 7: "rail trails"}


def add_movers(timeline: tl.Timeline, surfaces: Surfaces, bsp: Bsp) -> None:
    """Add doors, lifts and other moving parts of the map, which are there also while they are not sent."""
    for (number, model), track in timeline.tracks(tl.MOVER_KIND, ("model",)).items():
        mesh = surfaces.brush_mesh(bsp, model, f"*{model}") if 0 < model < len(bsp.models) else None
        places, angles = (tl.trajectory(track.states, timeline.ms, path) for path in ("path", "turn_path"))
        surfaces.file.place(f"mover {number}", "movers", mesh, Motion(places, tl.axes(angles), jumps=track.jumps))


def add_items(timeline: tl.Timeline, surfaces: Surfaces) -> None:
    """Add the items, which bob and turn; one that returns grows within a second."""
    for (number, item), track in timeline.tracks(tl.ITEM_KIND, ("model",)).items():
        shown = track.present & ~track.flag(HIDDEN)
        if not (0 < item < len(ITEMS) and shown.any()):
            continue
        carried = item in WEAPON_ITEMS
        places = track.places.copy()
        places[:, 2] += 4 + 4 * np.cos((timeline.ms + 1000) * (0.005 + number * 0.00001)) + (8 if carried else 0)
        period = 1024 if item in HEALTH else 2048
        angles = np.zeros_like(places)
        angles[:, 1] = timeline.ms % period * (360 / period)
        returns = np.concatenate([[False], shown[1:] & ~shown[:-1] & track.present[:-1]])
        since = np.maximum.accumulate(np.where(returns, timeline.ms, -np.inf))
        size = (1.5 if carried else 1.0) * np.clip((timeline.ms - since) / 1000, 0.02, 1)
        motion = Motion(places, tl.axes(angles), shown, size, track.jumps)
        mesh, name = surfaces.still_mesh(ITEMS[item]), ITEMS[item].split("/")[-1][:-4]
        surfaces.file.place(f"item {number} {name}", "items", mesh, motion)


def add_missiles(timeline: tl.Timeline, surfaces: Surfaces, lights: bool) -> None:
    """Add rockets, grenades and bolts; rockets have a light."""
    for (number, weapon, _), track in timeline.tracks(tl.MISSILE_KIND, ("weapon", "time")).items():
        if weapon in _BOLTS:
            mesh = surfaces.bolt(*_BOLTS[weapon])
        else:
            mesh = surfaces.still_mesh(_MISSILES.get(weapon, _MISSILES[_ROCKET]))
        velocity = tl.columns(track.states, ("vx", "vy", "vz"))
        forward = normalize(np.where(np.abs(velocity).max(1, keepdims=True) > 0, velocity, [0.0, 0, 1]))
        turn = np.radians(timeline.ms / 4)[:, None]
        _, left, up = np.moveaxis(rows_along(forward), 1, 0)
        left = np.cos(turn) * left + np.sin(turn) * up
        rows = np.stack([forward, left, np.cross(forward, left)], 1)
        motion = Motion(track.places, rows, track.present, jumps=track.jumps)
        surfaces.file.place(f"missile {number}", "missiles", mesh, motion)
        if lights and weapon in GLOWING:
            radius, color = GLOWING[weapon]
            candela = track.present * light.dynamic_candela(radius, surfaces.file.unit)
            surfaces.file.point_light(f"missile light {number}", _LIGHTS, track.places, color, candela, track.jumps)


def add_flashes(timeline: tl.Timeline, surfaces: Surfaces, eye: Eye, lights: bool) -> None:
    """Add the lights of shots and explosions; what the game draws beside them is counted."""
    shots: dict[int, list[tuple[int, int]]] = {}
    file, others = surfaces.file, timeline.tracks(tl.PLAYER_KIND)
    for event in timeline.events:
        inside = timeline.ms[0] - 1000 <= event.time <= timeline.ms[-1]
        if event.kind == tl.FIRE and inside:
            weapon = int(event.state[(PLAYER if event.number < 0 else ENTITY)["weapon"]])
            shots.setdefault(event.number, []).append((event.time, weapon))
            file.counts["shots"] += int(event.time >= timeline.ms[0])
            file.lost[_SPRITES.get(weapon, "sprites of shots")] += int(event.time >= timeline.ms[0])
        elif event.kind in tl.IMPACTS and event.number >= 0 and inside:
            _add_explosion(timeline, surfaces, event, lights)
    for number, fired in shots.items() if lights else ():
        if number >= 0 and (number,) not in others:
            continue
        times = np.array([-np.inf, *(time for time, _ in fired)])
        on = timeline.ms - times[np.searchsorted(times, timeline.ms, "right") - 1] <= FLASH_MS
        if number < 0:
            places, jumps = eye.places + eye.axes[:, 0] * 20 - [0, 0, 8], eye.jumps
        else:
            track = others[(number,)]
            on &= track.present
            places, jumps = track.places + tl.axes(track.angles)[:, 0] * 26 + [0, 0, 20], track.jumps
        color = _FLASHES.get(Counter(weapon for _, weapon in fired).most_common(1)[0][0], _YELLOW)
        candela = on * light.dynamic_candela(FLASH_RADIUS, file.unit)
        file.point_light(f"muzzle {number}", _LIGHTS, places, color, candela, jumps)


def _add_explosion(timeline: tl.Timeline, surfaces: Surfaces, event: tl.Event, lights: bool) -> None:
    weapon = int(event.state[ENTITY["weapon"]])
    surfaces.file.lost["explosion sprites and marks"] += int(event.time >= timeline.ms[0])
    if not lights or weapon not in EXPLOSIONS:
        return
    radius, color, length = EXPLOSIONS[weapon]
    late = (timeline.ms - event.time) / length
    level = np.where((late >= 0) & (late < 1), np.minimum(1, 2 - 2 * late), 0)
    states = np.array([event.state], dtype=float)
    places = np.repeat(tl.trajectory(states, np.array([float(event.time)])), len(late), axis=0)
    candela = light.dynamic_candela(radius * level, surfaces.file.unit)
    surfaces.file.point_light(f"explosion {event.number}", _LIGHTS, places, color, candela)


def add_view_weapon(timeline: tl.Timeline, surfaces: Surfaces, eye: Eye) -> None:
    """Add the weapon in the recording player's hands: at a tag of the model of the hands, with bob and drift."""
    held = np.where(eye.alive, timeline.player_field("weapon"), 0).astype(int)
    speed, sine, side = timeline.walk()
    drift = (speed + 40) * np.sin(timeline.ms * 0.001) * 0.01
    lean = np.stack([speed * sine * 0.005, side * speed * sine * 0.01, side * speed * sine * 0.005], 1) + drift[:, None]
    rows = tl.axes(lean) @ eye.axes  # small angles: those of the view and these add up to a hundredth of a degree
    for weapon, mesh in weapon_meshes(surfaces, held):
        names = (f"models/weapons2/{name}/{name}_hand.md3" for name in (WEAPONS[weapon], "shotgun"))
        hand = next((surfaces.model(name) for name in names if surfaces.paks.read(name)), None)
        if hand is None or "tag_weapon" not in hand.tags:
            continue
        place, turn = (values[0] for values in hand.tags["tag_weapon"])
        motion = Motion(eye.places + place @ rows, normalize(turn) @ rows, held == weapon, jumps=eye.jumps)
        surfaces.file.place(f"view weapon {WEAPONS[weapon]}", "view weapons", mesh, motion)
