"""States between snapshots: where the recording player's eye and every entity are at given times, by the game's rules.

Interpolation, trajectories, and the eye's height, bob, landing and roll: ioquake3 (``code/cgame/cg_view.c``,
``cg_ents.c``, ``code/game/bg_misc.c``).  All times are computed together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.capture.quake3.demo import ENTITY, MAX_PLAYERS, PLAYER, SPECTATOR, TELEPORT, Demo, Snapshot, State
from taubench_gl.capture.recording import Eye, axes, changes
from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import require

Array = np.ndarray

UNIT = 1 / 32
"""Meters per unit: a player of 56 units is 1.75 m tall."""
GRAVITY = 800.0
STILL, INTERPOLATED, LINEAR, LINEAR_STOP, SINE, FALLING = range(6)
FIRST_EVENT = 13
"""Kind of an entity from which on it is an event, of the number that is added."""
EVENT_MS = 300
"""Milliseconds for which an entity keeps an event, also while it is out of sight."""
PLAYER_KIND, ITEM_KIND, MISSILE_KIND, MOVER_KIND = 1, 2, 3, 4
STEP_EVENTS, LAND_EVENTS, FIRE, IMPACTS = range(6, 10), range(10, 13), 23, range(50, 53)
_BEFORE = 40
"""Snapshots before the first time whose events still act."""
_PLACE, _ANGLES = ("x", "y", "z"), ("pitch", "yaw", "roll")
_PATHS = {
    "path": (_PLACE, ("vx", "vy", "vz"), "time", "duration"),
    "turn_path": (_ANGLES, ("turn_pitch", "turn_yaw", "turn_roll"), "turn_time", "turn_duration"),
}


def mix_angles(a: Array, b: Array, share: Array) -> Array:
    """Angles between ``a`` (``share`` 0) and ``b`` (1), degrees, by the shorter arc."""
    return a + share * ((b - a + 180) % 360 - 180)


def columns(states: Array, names: tuple[str, ...], table: dict[str, int] = ENTITY) -> Array:
    return states[..., [table[name] for name in names]]


def trajectory(states: Array, times: Array, which: str = "path") -> Array:
    """(n, 3) places, or with ``turn_path`` angles, of (n, fields) states of entities at (n,) milliseconds."""
    base, delta, start, duration = _PATHS[which]
    kind = states[:, ENTITY[which]][:, None]
    first, delta = columns(states, base), columns(states, delta)
    lasts = states[:, ENTITY[duration]]
    seconds = (times - states[:, ENTITY[start]]) / 1000
    seconds = np.where(kind[:, 0] == LINEAR_STOP, np.clip(seconds, 0, lasts / 1000), seconds)[:, None]
    sine = np.sin(2 * np.pi * seconds * 1000 / np.where(lasts == 0, 1, lasts)[:, None])
    out = first + np.where(kind <= INTERPOLATED, 0, delta * np.where(kind == SINE, sine, seconds))
    out[:, 2] -= np.where(kind[:, 0] == FALLING, GRAVITY / 2 * seconds[:, 0] ** 2, 0)
    return out


@dataclass(frozen=True)
class Track:
    """An entity at the n times of a timeline.

    ``states``: of the snapshot at or before each time, held where there is none; ``jumps``: the step to this time is
    a teleport.
    """

    states: Array  # (n, fields)
    present: Array  # (n,) bool
    places: Array  # (n, 3)
    angles: Array  # (n, 3) degrees
    jumps: Array  # (n,) bool

    def column(self, name: str) -> Array:
        return self.states[:, ENTITY[name]]

    def flag(self, bit: int) -> Array:
        """Whether a bit of ``flags`` is set, (n,)."""
        return self.column("flags").astype(int) & bit != 0


@dataclass(frozen=True)
class Event:
    """Something that happened once.  ``number``: of its entity, -1 for the recording player, whose state is there."""

    time: int
    number: int
    kind: int
    state: State


class Timeline:
    """A demo at ``times``, (n,) increasing seconds from its first snapshot.  Raises SceneError."""

    def __init__(self, demo: Demo, times: Array):
        self.demo, self.times = demo, times
        self.ms = demo.snapshots[0].time + times * 1000
        all_times = np.array([s.time for s in demo.snapshots], dtype=float)
        first = max(int(np.searchsorted(all_times, self.ms[0] + 1e-6, "right")) - 1, 0)
        last = min(int(np.searchsorted(all_times, self.ms[-1])) + 2, len(all_times))
        self.snapshots = demo.snapshots[first:last]
        self._earlier = demo.snapshots[max(first - _BEFORE, 0) : first]
        self.snapshot_times = all_times[first:last]
        require(len(times) * 4000, "its frames", SceneError, demo.name)
        # Times are rounded to a microsecond: 16 ms snapshots and keys meet.
        self.index = np.searchsorted(self.snapshot_times, self.ms + 1e-3, "right") - 1
        self.index = self.index.clip(0, len(self.snapshots) - 1)
        self.next = (self.index + 1).clip(max=len(self.snapshots) - 1)
        step = self.snapshot_times[self.next] - self.snapshot_times[self.index]
        self.share = ((self.ms - self.snapshot_times[self.index]) / np.where(step == 0, 1, step)).clip(0, 1)
        self.players = np.array([s.player for s in self.snapshots], dtype=float)
        if not np.isfinite(self.players).all():
            raise SceneError("the player's state has values that are no numbers", where=demo.name)
        self.events = find_events([*self._earlier, *self.snapshots])
        self._entities: dict[int, tuple[list[int], list[State]]] | None = None

    # ----------------------------------------------------------------------------------------------- recording player
    def player_field(self, name: str) -> Array:
        """A field of the recording player at each time, of the snapshot at or before it."""
        return self.players[self.index, PLAYER[name]]

    def blend(self, *names: str) -> Array:
        """Fields of the recording player, interpolated between snapshots, (n, k); across a jump those of the snapshot
        before.
        """
        table = columns(self.players, names, PLAYER)
        return table[self.index] + self._share()[:, None] * (table[self.next] - table[self.index])

    def _share(self) -> Array:
        flags, client = (self.players[:, PLAYER[name]].astype(int) for name in ("flags", "client"))
        jump = ((flags[self.index] ^ flags[self.next]) & TELEPORT) | (client[self.index] ^ client[self.next])
        return np.where(jump != 0, 0.0, self.share)

    def walk(self) -> tuple[Array, Array, Array]:
        """Speed along the ground in units per second; height, 0 to 1, and side, -1 or 1, of the bob of the walk."""
        cycle = self.players[:, PLAYER["bob"]]
        bob = np.floor(cycle[self.index] + self._share() * ((cycle[self.next] - cycle[self.index]) % 256))
        sine, side = np.abs(np.sin((bob % 128) / 127 * np.pi)), np.where(bob >= 128, -1, 1)
        return np.hypot(*self.blend("vx", "vy").T), sine, side

    def alive(self) -> Array:
        health, mode, team = (self.player_field(name) for name in ("health", "mode", "team"))
        return (health > 0) & (mode == 0) & (team != SPECTATOR)

    def eye(self, roll: bool = True) -> Eye:
        """The recording player's eye; ``roll``: with the lean of the view by bob and running."""
        places, velocity = self.blend(*_PLACE), self.blend("vx", "vy", "vz")
        look = columns(self.players, _ANGLES, PLAYER)
        angles = mix_angles(look[self.index], look[self.next], self._share()[:, None])
        alive = self.player_field("health") > 0
        speed, sine, side = self.walk()
        forward, left = np.moveaxis(axes(angles), 1, 0)[:2]
        if roll:
            lean = np.where(alive, sine * 0.002 * np.maximum(speed, 200), 0)
            angles[:, 0] += lean + np.where(alive, (velocity * forward).sum(1) * 0.002, 0)
            angles[:, 2] += lean * side - np.where(alive, (velocity * left).sum(1) * 0.005, 0)
            dead = np.broadcast_arrays(-15.0, self.players[self.index, self.demo.death_yaw], 40.0)
            angles = np.where((alive | (self.player_field("mode") == 2))[:, None], angles, np.stack(dead, 1))
        places[:, 2] += self.player_field("view_height")
        places[:, 2] += np.where(alive, np.minimum(sine * speed * 0.005, 6) + self._springs(), 0)
        jumps = changes(self.player_field("flags").astype(int) & TELEPORT) | changes(self.player_field("client"))
        return Eye(self.times, places, axes(angles), jumps, self.alive())

    def _springs(self) -> Array:
        """Height of the eye, in units, by ducking, landing and steps, which it follows late."""
        out, steps = np.zeros(len(self.ms)), np.zeros(len(self.ms))
        near = [*self._earlier[-8:], *self.snapshots]
        heights = np.array([s.player[PLAYER["view_height"]] for s in near])
        for i in np.flatnonzero(np.diff(heights)):
            late = self.ms - near[i + 1].time
            out -= np.where((late >= 0) & (late < 100), (heights[i + 1] - heights[i]) * (100 - late) / 100, 0)
        for event in self.events:
            late = self.ms - event.time
            if event.number < 0 and event.kind in STEP_EVENTS:
                steps += np.where((late >= 0) & (late < 200), 4 * (event.kind - 5) * (200 - late) / 200, 0)
            elif event.number < 0 and event.kind in LAND_EVENTS:
                out -= 8 * (event.kind - 9) * np.interp(late, [0, 150, 450], [0, 1, 0], 0, 0)
        return out - np.minimum(steps, 32)

    # ------------------------------------------------------------------------------------------------------- entities
    def tracks(self, kind: int, keys: tuple[str, ...] = ()) -> dict[tuple[int, ...], Track]:
        """(number, values of the fields ``keys``) -> each entity of a kind; other values make another track."""
        if self._entities is None:
            self._entities = {}
            for i, snapshot in enumerate(self.snapshots):
                for number, state in snapshot.entities.items():
                    rows = self._entities.setdefault(number, ([], []))
                    rows[0].append(i)
                    rows[1].append(state)
        out = {}
        for number, (rows, values) in self._entities.items():
            states = np.array(values, dtype=float)
            wanted = states[:, ENTITY["kind"]] == kind
            if not wanted.any():
                continue
            if not np.isfinite(states).all():
                raise SceneError(f"entity {number} has values that are no numbers", where=self.demo.name)
            found = columns(states, keys)[wanted]
            for key in np.unique(found, axis=0) if keys else [()]:
                chosen = wanted & (columns(states, keys) == np.asarray(key)).all(1)
                track = self._track(number, np.asarray(rows)[chosen], states[chosen])
                if track is not None:
                    out[(number, *(int(value) for value in key))] = track
        return out

    def _track(self, number: int, rows: Array, states: Array) -> Track | None:
        """The entity that is in the snapshots ``rows``; None if it is there at no time."""
        table = np.full(len(self.snapshots), -1)
        table[rows] = np.arange(len(rows))
        now, then = table[self.index], table[self.next]
        present = now >= 0
        if not present.any():
            return None
        held = np.maximum.accumulate(np.where(present, np.arange(len(now)), np.argmax(present)))
        a, b = states[now[held]], states[np.where(then >= 0, then, now)[held]]
        same = (a[:, ENTITY["flags"]].astype(int) ^ b[:, ENTITY["flags"]].astype(int)) & TELEPORT == 0
        path = a[:, ENTITY["path"]]
        moves = (path == INTERPOLATED) | ((path == LINEAR_STOP) & (number < MAX_PLAYERS))
        blended = (same & moves & present & (then >= 0))[:, None]
        times = np.where(present, self.ms, self.ms[held])
        ends = self.snapshot_times[self.index], self.snapshot_times[self.next]
        p, q = trajectory(a, ends[0]), trajectory(b, ends[1])
        places = np.where(blended, p + self.share[:, None] * (q - p), trajectory(a, times))
        p, q = (trajectory(x, t, "turn_path") for x, t in zip((a, b), ends, strict=True))
        angles = np.where(blended, mix_angles(p, q, self.share[:, None]), trajectory(a, times, "turn_path"))
        jumps = changes(a[:, ENTITY["flags"]].astype(int) & TELEPORT)
        jumps[1:] |= ~present[:-1]
        return Track(a, present, places, angles, jumps)


def find_events(snapshots: list[Snapshot]) -> list[Event]:
    """Events in order, each once: an entity keeps one for EVENT_MS, and two bits of its number change with each.

    The recording player's are numbered, and a snapshot has the last two.  After a change of player they are another's.
    """
    out: list[Event] = []
    last: dict[int, tuple[tuple[int, int], int]] = {}  # number of an entity -> its event, and when it was seen
    client = count = None
    kind_at, event_at = ENTITY["kind"], ENTITY["event"]
    ring = PLAYER["event0"], PLAYER["event1"]
    for s in snapshots:
        total = int(s.player[PLAYER["events"]])
        if client == s.player[PLAYER["client"]]:
            numbers = range(max(count, total - 2), total)
            out += [Event(s.time, -1, int(s.player[ring[i & 1]]) & 255, s.player) for i in numbers]
        client, count = s.player[PLAYER["client"]], total
        for number, state in s.entities.items():
            kind = int(state[kind_at])
            key = (kind, 0 if kind >= FIRST_EVENT else int(state[event_at]))
            known, seen = last.get(number, (None, s.time))
            last[number] = key, s.time
            if known != key or s.time - seen > EVENT_MS:
                event = kind - FIRST_EVENT if kind >= FIRST_EVENT else key[1]
                if event & 255:
                    out.append(Event(s.time, number, event & 255, state))
    return out
