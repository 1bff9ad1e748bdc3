"""What recordings of all games have in common: the player's eye over time, events, and the windows worth capturing.

World axes are right-handed with +Z up, in units of the game; a reader of a left-handed game converts.  Times are
seconds from the first state of the recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.math3d import normalize

Array = np.ndarray

RATE = 60.0
"""Samples per second of ``Recording``: the rate of the paper's captures."""
EXACT_RATE = 24.0
"""Rate whose frames always lie on keys, beside the rate asked: that of the paper's images."""
RULE = "the window with the most rotation in which the player lives"
MAX_SECONDS = 3600.0
STEP = 1.0
"""Seconds from the start of one window to that of the next."""


@dataclass(frozen=True)
class Eye:
    """The recording player's eye at n times.

    ``axes``: rows forward, left, up; ``jumps``: the step to this sample is a teleport or a change of player, not
    motion; ``alive``: the player is in the game and alive.
    """

    times: Array  # (n,) seconds
    places: Array  # (n, 3) units
    axes: Array  # (n, 3, 3)
    jumps: Array  # (n,) bool
    alive: Array  # (n,) bool


@dataclass(frozen=True)
class Recording:
    """A recording as ``info`` and the search for windows see it; ``eye`` at RATE.

    ``counts``: kind of event, such as shots -> (m,) seconds; ``unit``: meters per unit; ``player``: whose eye it is,
    where the recording has all players'.
    """

    game: str
    map_name: str
    seconds: float
    unit: float
    eye: Eye
    players: tuple[str, ...]
    counts: dict[str, Array]
    notes: tuple[str, ...] = field(default=())
    player: int | None = None


@dataclass(frozen=True)
class Window:
    """A part of a recording.  ``rotation``: degrees per second; ``moved``: meters per second; both without jumps."""

    start: float
    rotation: float
    moved: float
    alive: bool
    jumps: int
    counts: dict[str, int]


@dataclass(frozen=True)
class Choice:
    """What of a recording becomes a scene, and how.  ``start``, ``seconds``: from its first state.

    Of Cube 2 only: ``player``: its number; ``unit``: of the file, cube or meters.
    """

    start: float
    seconds: float = 6.0
    fps: float = 60.0
    view_weapon: bool = True
    roll: bool = True
    lights: bool = True
    player: int | None = None
    unit: str = "cube"


def axes(angles: Array) -> Array:
    """(..., 3) pitch (down positive), yaw, roll in degrees -> (..., 3, 3) rows forward, left, up."""
    p, y, r = np.moveaxis(np.radians(angles), -1, 0)
    cp, sp, cy, sy, cr, sr = np.cos(p), np.sin(p), np.cos(y), np.sin(y), np.cos(r), np.sin(r)
    rows = (cp * cy, cp * sy, -sp, sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp,
            cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp)  # fmt: skip
    return np.stack(rows, -1).reshape(*p.shape, 3, 3)


def rows_along(forward: Array) -> Array:
    """(n, 3) unit directions -> (n, 3, 3) rows forward, left, up, level where they are not upright."""
    upright = np.abs(forward[:, 2:]) < 0.99
    left = normalize(np.cross(np.where(upright, [0.0, 0, 1], [1.0, 0, 0]), forward))
    return np.stack([forward, left, np.cross(forward, left)], 1)


def changes(values: Array) -> Array:
    """(n,) bool: where a value differs from the one before; never the first."""
    return np.diff(values, prepend=values[:1]) != 0


def eye_times(seconds: float, name: str) -> Array:
    """(n,) times of ``Recording.eye``.  Raises SceneError for a recording ``name`` of more than MAX_SECONDS."""
    if seconds > MAX_SECONDS:
        raise SceneError(f"lasts {seconds:.0f} s", where=name, hint=f"at most {MAX_SECONDS:.0f} s are read")
    return np.arange(int(seconds * RATE + 1e-6) + 1) / RATE


def key_times(choice: Choice, seconds: float, name: str) -> Array:
    """Times of keys, (n,) seconds from ``choice.start``: the frames at its rate and those at EXACT_RATE.

    Raises SettingsError for a part that is not inside of a recording ``name`` of ``seconds``.
    """
    end = choice.start + choice.seconds
    if not 0 <= choice.start < seconds or end > seconds + 1e-6:
        what = f"{choice.start:g} to {end:g} s is not inside the recording"
        raise SettingsError(what, where=name, hint=f"it lasts {seconds:g} s")
    frames = [np.arange(int(np.floor(choice.seconds * rate + 1e-6)) + 1) / rate for rate in (choice.fps, EXACT_RATE)]
    times = np.concatenate(frames)
    _, first = np.unique(np.round(times * 1e9), return_index=True)
    return times[first]


def windows(recording: Recording, seconds: float) -> list[Window]:
    """Every window that starts on a multiple of STEP, in the order of time."""
    eye = recording.eye
    turned = np.clip((np.einsum("nij,nij->n", eye.axes[1:], eye.axes[:-1]) - 1) / 2, -1, 1)
    rotation = np.where(eye.jumps[1:], 0.0, np.degrees(np.arccos(turned)))
    moved = np.where(eye.jumps[1:], 0.0, np.linalg.norm(np.diff(eye.places, axis=0), axis=1) * recording.unit)
    out = []
    for k in range(int(np.floor((recording.seconds - seconds) / STEP + 1e-6)) + 1):
        start, end = k * STEP, k * STEP + seconds
        first, last = np.searchsorted(eye.times, [start - 1e-6, end - 1e-6])
        counts = {kind: int(((t >= start) & (t < end)).sum()) for kind, t in recording.counts.items()}
        alive, jumps = bool(eye.alive[first : last + 1].all()), int(eye.jumps[first + 1 : last + 1].sum())
        rates = (float(values[first:last].sum() / seconds) for values in (rotation, moved))
        out.append(Window(start, *rates, alive, jumps, counts))
    return out


def best_window(recording: Recording, seconds: float) -> Window:
    """The window of RULE.  Raises SettingsError where the player dies in every one."""
    alive = [window for window in windows(recording, seconds) if window.alive]
    if not alive:
        lives = stretches(recording.eye.times, recording.eye.alive)
        hint = "the player never lives: record for longer"
        if lives:
            first, last = max(lives, key=lambda life: life[1] - life[0])
            within = f"the longest life is {first:.2f} to {last:.2f}: give --start and --seconds within it"
            hint = f"{within}, or record for longer"
        raise SettingsError(f"no {seconds:g} s of the recording in which the player lives", hint=hint)
    return max(alive, key=lambda window: window.rotation)


def stretches(times: Array, flags: Array) -> Sequence[tuple[float, float]]:
    """(first, last) time of each run of true ``flags``."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, int), [0]])))
    return [(float(times[a]), float(times[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
