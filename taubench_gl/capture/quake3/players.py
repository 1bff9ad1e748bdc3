"""Players: three models joined by tags, animated by morph targets that are the engine's own interpolation of frames.

Which frames are shown and how torso and legs follow the view: ioquake3 (``code/cgame/cg_players.c``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from taubench_gl.capture.parts import Motion
from taubench_gl.capture.quake3.demo import DEAD
from taubench_gl.capture.quake3.md3 import IDLE, Clip, Md3, read_clips, read_skin
from taubench_gl.capture.quake3.surfaces import Surfaces
from taubench_gl.capture.quake3.timeline import PLAYER_KIND, Timeline, Track, axes, columns
from taubench_gl.math3d import normalize

Array = np.ndarray

WEAPONS = (
    "", "gauntlet", "machinegun", "shotgun", "grenadel", "rocketl", "lightning", "railgun", "plasma", "bfg", "grapple",
)  # fmt: skip
STAND = (11, 12)
"""Animations in which a player stands: torso and legs then turn only when the view has turned far."""
_LEAN = np.array([0.0, 22, 45, -22, 0, 22, -45, -22])
"""Degrees by which legs turn for each direction of walking."""
DEFAULT_MODEL = "sarge"


def weapon_meshes(surfaces: Surfaces, held: Array) -> Iterator[tuple[int, int]]:
    """(number, mesh) of each weapon among ``held``, (n,) numbers, that has a model."""
    for weapon in np.unique(held[(held > 0) & (held < len(WEAPONS))]).tolist():
        mesh = surfaces.still_mesh(f"models/weapons2/{WEAPONS[weapon]}/{WEAPONS[weapon]}.md3")
        if mesh is not None:
            yield weapon, mesh


def swing(goal: Array, turning: Array, fresh: Array, steps: Array, slack: float, most: float, speed: float) -> Array:
    """Degrees of a part that follows ``goal`` late: once it is more than ``slack`` behind, it turns until it is there.

    ``turning``: it follows at once; ``fresh``: it starts at the goal; ``steps``: milliseconds to each time.
    """
    out, angle, moving = [], float(goal[0]), False
    for target, active, begins, step in zip(*(x.tolist() for x in (goal, turning, fresh, steps)), strict=True):
        if begins:
            angle, moving = target, False
        away = (target - angle + 180) % 360 - 180
        moving = moving or active or abs(away) > slack
        if moving:
            pace = 0.5 if abs(away) < slack / 2 else 1.0 if abs(away) < slack else 2.0
            move = step * speed * pace
            if move >= abs(away):
                angle, moving = target, False
            else:
                angle += move if away > 0 else -move
            away = (target - angle + 180) % 360 - 180
            if abs(away) > most:
                angle = target - (most - 1 if away > 0 else 1 - most)
        out.append(angle)
    return np.array(out)


def shown_frames(clips: dict[int, Clip], numbers: Array, ms: Array) -> Array:
    """(n, 3): older and newer frame of the animation of each number, and the weight of the older."""
    out: list[tuple[float, float, float]] = []
    number, frame, old = None, 0, 0
    time = old_time = start = 0.0
    for wanted, t in zip(numbers.astype(int).tolist(), ms.tolist(), strict=True):
        clip = clips.get(wanted & ~128, clips[IDLE])  # bit 7 says that an animation starts again
        length = 1000.0 / clip.fps
        if wanted != number:
            if number is None:
                frame, time, old_time = clip.first, t, t
            number, start = wanted, time + length
        if t >= time:
            old, old_time = frame, time
            time = start if t < start else old_time + length
            at = int((time - start) / length)
            if at >= clip.count:
                at -= clip.count
                if clip.loop:
                    at = at % clip.loop + clip.count - clip.loop
                else:
                    at, time = clip.count - 1, t
            frame = clip.first + (clip.count - 1 - at if clip.backward else at)
            time = max(time, t)
        time = t if time > t + 200 else time
        old_time = min(old_time, t)
        out.append((old, frame, 0.0 if time == old_time else 1 - (t - old_time) / (time - old_time)))
    return np.array(out)


@dataclass(frozen=True)
class _Body:
    """A player's model: its name, models and skins (surface -> shader) by part, and clips by number."""

    name: str
    models: dict[str, Md3 | None]
    skins: dict[str, dict[str, str]]
    clips: dict[int, Clip]


def add_players(timeline: Timeline, surfaces: Surfaces) -> None:
    """Add every other player and body, with the weapon in hand.  The recording player is in no snapshot."""
    for (number, client), track in timeline.tracks(PLAYER_KIND, ("client",)).items():
        info = timeline.demo.player_info(client)
        body = _body(surfaces, info)
        if body is not None:
            _add_player(timeline, surfaces, track, body, f"player {number} {info.get('n', '')}".strip())


def _body(surfaces: Surfaces, info: dict[str, str]) -> _Body | None:
    """The models of a player; those of DEFAULT_MODEL where the archives lack them, as in the game."""
    model, _, skin = info.get("model", DEFAULT_MODEL).lower().partition("/")
    head_model, _, head_skin = info.get("hmodel", info.get("model", DEFAULT_MODEL)).lower().partition("/")
    if surfaces.paks.read(f"models/players/{model}/lower.md3") is None:
        surfaces.file.lost[f"no player model {model}: {DEFAULT_MODEL} in its place"] += 1
        model, skin, head_model, head_skin = DEFAULT_MODEL, "", DEFAULT_MODEL, ""
    table = f"models/players/{model}/animation.cfg"
    config = surfaces.paks.read(table)
    models, skins = {}, {}
    for part, folder, name in (("lower", model, skin), ("upper", model, skin), ("head", head_model, head_skin)):
        path = f"models/players/{folder}/{part}"
        models[part] = surfaces.model(f"{path}.md3")
        files = (surfaces.paks.read(f"{path}_{which}.skin") for which in (name or "default", "default"))
        skins[part] = read_skin(next(filter(None, files), b"").decode("latin-1"))
    if models["lower"] is None or models["upper"] is None or config is None:
        return None
    return _Body(model, models, skins, read_clips(config.decode("latin-1"), surfaces.paks.where(table)))


def _tag(model: Md3, name: str, frames: Array) -> tuple[Array, Array]:
    """Place (n, 3) and unit rows (n, 3, 3) of a tag between frames."""
    places, rows = model.tags.get(name, (np.zeros((model.frames, 3)), np.tile(np.eye(3), (model.frames, 1, 1))))
    old, new = frames[:, 0].astype(int), frames[:, 1].astype(int)
    back = frames[:, 2, None]
    mixed = rows[old] * back[..., None] + rows[new] * (1 - back[..., None])
    return places[old] * back + places[new] * (1 - back), normalize(mixed)


def _add_player(timeline: Timeline, surfaces: Surfaces, track: Track, body: _Body, name: str) -> None:
    frames = {"head": np.zeros((len(timeline.ms), 3))}
    for part, field in (("lower", "legs"), ("upper", "torso")):
        frames[part] = shown_frames(body.clips, track.column(field), timeline.ms)
        frames[part][:, :2] = frames[part][:, :2].clip(0, body.models[part].frames - 1)
    legs, torso, head = _body_axes(timeline, track)
    place, turn = _tag(body.models["lower"], "tag_torso", frames["lower"])
    torso_place = track.places + np.einsum("ni,nij->nj", place, legs)
    # The torso's own turn is relative to the legs; then the tag, then the legs.
    torso_axes = torso @ np.swapaxes(legs, 1, 2) @ turn @ legs
    at = {"lower": (track.places, legs), "upper": (torso_place, torso_axes)}
    for part, own_turn in (("head", head @ np.swapaxes(torso, 1, 2)), ("weapon", np.eye(3))):
        place, turn = _tag(body.models["upper"], f"tag_{part}", frames["upper"])
        at[part] = torso_place + np.einsum("ni,nij->nj", place, torso_axes), own_turn @ turn @ torso_axes
    rows = np.arange(len(timeline.ms))
    for part, model in body.models.items():
        used = np.unique(frames[part][track.present, :2]).astype(int)
        primitives = [] if model is None else surfaces.model_primitives(model, body.skins[part], used.tolist())
        if not primitives:
            continue
        weights = np.zeros((len(rows), len(used)))
        for column, share in ((0, frames[part][:, 2]), (1, 1 - frames[part][:, 2])):
            np.add.at(weights, (rows, np.searchsorted(used, frames[part][:, column]).clip(max=len(used) - 1)), share)
        mesh = surfaces.file.writer.mesh(f"{body.name} {part}", *primitives, weights=[0.0] * (len(used) - 1))
        motion = Motion(*at[part], shown=track.present, jumps=track.jumps)
        surfaces.file.place(f"{name} {part}", "", mesh, motion, weights[:, 1:])
        surfaces.file.counts["morph targets"] += len(used) - 1
    weapons = np.where(track.present & ~track.flag(DEAD), track.column("weapon"), 0).astype(int)
    for weapon, mesh in weapon_meshes(surfaces, weapons):
        motion = Motion(*at["weapon"], shown=weapons == weapon, jumps=track.jumps)
        surfaces.file.place(f"{name} {WEAPONS[weapon]}", "", mesh, motion)
    surfaces.file.counts["players and bodies"] += 1


def _body_axes(timeline: Timeline, track: Track) -> tuple[Array, Array, Array]:
    """(n, 3, 3) rows of legs, torso and head, which looks where the player looks."""
    lean = _LEAN[np.where(track.flag(DEAD), 0, track.column("aim_yaw").astype(int) & 7)]
    pitch, yaw = track.angles[:, 0], track.angles[:, 1]
    fresh = np.concatenate([[True], ~track.present[:-1] | track.jumps[1:]])
    steps = np.diff(timeline.ms, prepend=timeline.ms[0])
    legs_number, torso_number = (track.column(part).astype(int) & ~128 for part in ("legs", "torso"))
    turning = (legs_number != IDLE) | ~np.isin(torso_number, STAND)
    torso_yaw = swing(yaw + lean / 4, turning, fresh, steps, 25, 90, 0.3)
    legs_yaw = swing(yaw + lean, turning, fresh, steps, 40, 90, 0.3)
    torso_pitch = swing(((pitch + 180) % 360 - 180) * 0.75, turning, fresh & False, steps, 15, 30, 0.1)
    zero = np.zeros(len(yaw))
    velocity = columns(track.states, ("vx", "vy", "vz"))
    flat = axes(np.stack([zero, legs_yaw, zero], 1))
    side, ahead = (np.einsum("ni,ni->n", velocity, flat[:, k]) * 0.05 for k in (1, 0))
    legs = axes(np.stack([ahead, legs_yaw, -side], 1))
    return legs, axes(np.stack([torso_pitch, torso_yaw, zero], 1)), axes(track.angles)
