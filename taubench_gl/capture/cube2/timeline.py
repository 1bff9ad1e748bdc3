"""A recording between its packets: paths of players, rockets, and the lights of shots and explosions.

What is stored is cut off to whole degrees and sixteenths of a cube.  A path is the smoothest curve that lies inside of
every stored interval: of all such values at the packets it has the least sum of squared accelerations, and it is a
natural cubic spline between them.  It ends at a death and where a player is set elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.sparse import diags, identity
from scipy.sparse.linalg import splu

from taubench_gl.capture.cube2.demo import STEP, Demo, Event
from taubench_gl.capture.recording import Eye, axes
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.math3d import normalize

Array = np.ndarray

EYE = 14.0
"""Height of the eye above the feet, cubes."""
_GAP = 250
"""Milliseconds without a packet after which a player counts as gone."""
_ROUNDS = 400  # of the search for the smoothest path: its sum is then within 1e-6 of the least
ROCKET, GRENADE = 3, 5
SPEED = 320.0
"""Speed of a rocket, cubes per second."""


def smooth_path(times: Array, low: Array) -> Array:
    """(n, c) values in [low, low + 1) with the least sum of squared second derivatives over (n,) increasing ``times``.

    Alternating direction method of multipliers (Boyd et al. 2011) with over-relaxation 1.6.
    """
    step = np.diff(times) / np.median(np.diff(times))
    before, after = step[:-1], step[1:]
    rows = np.stack([1 / before, -1 / before - 1 / after, 1 / after]) * np.sqrt(2 / (before + after))
    second = diags(rows, [0, 1, 2], shape=(len(times) - 2, len(times)))
    solve = splu((second.T @ second + identity(len(times))).tocsc()).solve
    inside, late = low + 0.5, np.zeros_like(low, dtype=float)
    for _ in range(_ROUNDS):
        free = 1.6 * solve(inside - late) - 0.6 * inside
        inside = np.clip(free + late, low, low + (1 - 1e-6))
        late += free - inside
    return inside


@dataclass(frozen=True)
class Path:
    """A player from ``start`` until ``end``, seconds; after it the player stays there until ``until``.

    ``values``: time -> place of the eye (3), yaw to the left and pitch downward in degrees; right-handed axes.
    """

    start: float
    end: float
    until: float
    values: CubicSpline


class Timeline:
    """The players and shots of a recording.  Times are seconds from its first packet."""

    def __init__(self, demo: Demo):
        self.demo = demo

    @cached_property
    def paths(self) -> dict[int, list[Path]]:
        """Player -> its paths in the order of time."""
        rows = self.demo.rows
        found = {int(player): self._player(rows[rows[:, 1] == player]) for player in np.unique(rows[:, 1])}
        if not any(found.values()):
            raise SceneError("holds no player who lives for three packets", where=self.demo.name)
        return {player: paths for player, paths in found.items() if paths}

    def _player(self, rows: Array) -> list[Path]:
        rows = rows[np.append(np.diff(rows[:, 0]) > 0, True)]  # the later packet of the same time counts
        ms, player = rows[:, 0], int(rows[0, 1])
        gone = (
            self._between(ms, player, "DIED", "FORCEDEATH", "SPAWN") | (np.diff(rows[:, 2]) != 0) | (np.diff(ms) > _GAP)
        )
        starts = np.flatnonzero(gone | self._between(ms, player, "TELEPORT")) + 1
        parts = [part for part in np.split(np.arange(len(ms)), starts) if len(part) > 2]
        out = []
        for part, following in zip(parts, [*parts[1:], None], strict=False):
            seconds = (ms[part] - self.demo.ms[0]) / 1000
            stays = following is not None and following[0] == part[-1] + 1 and not gone[part[-1]]
            until = (ms[following[0]] - self.demo.ms[0]) / 1000 if following is not None and stays else seconds[-1]
            out.append(Path(seconds[0], seconds[-1], until, self._spline(seconds, rows[part])))
        return out

    def _between(self, ms: Array, player: int, *names: str) -> Array:
        """Whether a message about a player comes between its packets and those that follow."""
        found = (e for e in self.demo.events if e.name in names)
        of_player = [e.ms for e in found if player == (e.sender if e.name == "SPAWN" else e.values[0])]
        return np.diff(np.searchsorted(of_player, ms, "right")) > 0

    def _spline(self, seconds: Array, rows: Array) -> CubicSpline:
        x, y, z = rows[:, 3:6].T
        low = np.stack([x, y, z, np.unwrap(rows[:, 6].astype(float), period=360), rows[:, 7]], 1).astype(float)
        x, y, z, yaw, pitch = smooth_path(seconds, low).T
        places = np.stack([y, x, z], 1) * STEP + [0, 0, EYE]
        return CubicSpline(seconds, np.column_stack([places, -yaw, -pitch]), bc_type="natural")

    def eye(self, player: int, times: Array) -> Eye:
        """The eye of a player; while it is not in the game it stays where it was.  Its view has no roll.

        Raises SettingsError for a number that no player has.
        """
        paths = self.paths.get(player)
        if paths is None:
            known = ", ".join(map(str, self.paths)) or "none"
            raise SettingsError(f"no player {player} in the recording", where=self.demo.name, hint=f"players: {known}")
        which = np.searchsorted([path.start for path in paths], times + 1e-9, "right") - 1
        values, alive = np.zeros((len(times), 5)), np.zeros(len(times), bool)
        for number in np.unique(which):
            path, rows = paths[max(number, 0)], which == number
            values[rows] = path.values(np.clip(times[rows], path.start, path.end))
            alive[rows] = (times[rows] >= path.start - 1e-9) & (times[rows] <= path.until + 1e-9)
        angles = np.stack([values[:, 4].clip(-90, 90), values[:, 3], np.zeros(len(times))], 1)
        return Eye(times, values[:, :3], axes(angles), np.diff(which, prepend=which[:1]) != 0, alive)

    @cached_property
    def shots(self) -> list[Shot]:
        """Every shot, and when it exploded, if it did."""
        ends = {e.values: self._seconds(e) for e in self.demo.events if e.name == "EXPLODEFX"}
        out = []
        for event in self.demo.events:
            if event.name == "SHOTFX":
                player, gun, number, *six = event.values
                places = np.array(six, float).reshape(2, 3)[:, [1, 0, 2]] * STEP
                end = ends.get((player, gun, number))
                out.append(Shot(self._seconds(event), gun, *places, end or self.demo.seconds, end is not None))
        return out

    def times(self, *names: str) -> Array:
        """(m,) seconds of the messages of these names."""
        return np.array([self._seconds(event) for event in self.demo.events if event.name in names])

    def _seconds(self, event: Event) -> float:
        return (event.ms - self.demo.ms[0]) / 1000


@dataclass(frozen=True)
class Shot:
    """A shot from ``start`` toward ``goal``, (3,) cubes, right-handed.  ``end``: when it exploded, or the
    recording ended."""

    time: float
    gun: int
    start: Array
    goal: Array
    end: float
    exploded: bool

    def at(self, times: Array) -> Array:
        """Where the rocket is at ``times`` (n,), (n, 3) cubes: straight ahead, at most to its goal, until it
        explodes.
        """
        way = self.goal - self.start
        length = np.linalg.norm(way)
        along = np.clip((np.minimum(times, self.end) - self.time) * SPEED, 0, length)
        return self.start + along[:, None] * normalize(way)
