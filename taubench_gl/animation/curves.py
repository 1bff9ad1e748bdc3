"""Animation curves in float64: the formulas of glTF 2.0, appendix C (animation sampler interpolation).

``interpolate`` is the only function that blends keys.  It takes any number of channels at once, so the scalar reference
``sample_channel`` and the vectorized ``Timeline`` run the same arithmetic and agree bit for bit.

All formulas return equal keys exactly at every time between them: ``a + u (b - a)`` and not ``(1 - u) a + u b``.  A
camera that stands still between two keys then has exactly zero motion.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from taubench_gl.conventions import DEFAULT_FPS, KEY_TOLERANCE
from taubench_gl.math3d import unit_quaternions
from taubench_gl.scene.model import Channel

Array = np.ndarray

STEP, LINEAR, CUBICSPLINE = "STEP", "LINEAR", "CUBICSPLINE"

NLERP_BELOW = 1e-6
"""Angle in radians below which slerp becomes normalized lerp.  Both differ by about angle^3 / 16 there, less than
1e-16, and lerp does not divide by sin(angle)."""

LARGEST_KEY = float(np.finfo(np.float32).max)
"""Largest time of a key in seconds, because files hold keys as float32."""

HALF_TURN = 1e-12
"""Quaternions with a smaller absolute dot product are 180 degrees apart, and both arcs are equally short.  Such a pair
keeps the signs of the file, so that rounding does not select the arc."""


def slerp(a: Array, b: Array, u: Array) -> Array:
    """Spherical interpolation along the shorter arc.  (..., 4), (..., 4) unit xyzw, (...) in [0, 1] -> (..., 4) unit.

    q and -q are the same rotation: ``b`` is flipped to the hemisphere of ``a``.  ``u == 0`` returns ``a`` bit for bit,
    as does every ``u`` for equal or opposite keys.  Keys 180 degrees apart: see ``HALF_TURN``.
    """
    u = np.asarray(u, dtype=np.float64)[..., None]
    b = np.where(_dot(a, b) < -HALF_TURN, -b, b)
    difference, total = b - a, b + a
    # The angle from both chords is accurate everywhere; acos of the dot product has no precision below 1e-8 rad.
    angle = 2.0 * np.arctan2(np.sqrt(_dot(difference, difference)), np.sqrt(_dot(total, total)))
    small = angle < NLERP_BELOW
    sine = np.sin(np.where(small, 1.0, angle))
    arc = (np.sin((1.0 - u) * angle) / sine) * a + (np.sin(u * angle) / sine) * b
    line = a + u * difference
    line = line / np.sqrt(_dot(line, line))
    out = np.where(small, line, arc)
    # Rounding of sin/sin and of the normalization can change the last bit; keys are returned unchanged.
    return np.where((u == 0.0) | ~np.any(difference, axis=-1, keepdims=True), a, out)


def hermite(v0: Array, out0: Array, in1: Array, v1: Array, u: Array, dt: Array) -> Array:
    """glTF's cubic spline; tangents, per second, are scaled by ``dt``.  4 x (..., n), (...), (...) -> (...,
    n)."""
    u = np.asarray(u, dtype=np.float64)[..., None]
    dt = np.asarray(dt, dtype=np.float64)[..., None]
    u2 = u * u
    u3 = u2 * u
    # h00 = 1 - h01, written so that equal values with zero tangents stay exactly equal.
    return v0 + (3 * u2 - 2 * u3) * (v1 - v0) + dt * ((u3 - 2 * u2 + u) * out0 + (u3 - u2) * in1)


def key_tolerance(t: float, fps: float) -> float:
    """Seconds around ``t`` in which a key is taken for a key at ``t``: of KEY_TOLERANCE frames and a float32 step, the
    larger."""
    return max(KEY_TOLERANCE / fps, float(np.spacing(np.float32(min(abs(t), 0.5 * LARGEST_KEY)))))


def time_on_key(t: float, before: Array, after: Array, fps: float) -> Array:
    """Times at which curves are sampled where ``t`` is asked for: that of the nearer key within the tolerance, else t.

    ``before``, ``after`` (...): the key times around ``t``, ``before`` <= t < ``after``, infinite where there is none;
    ``fps``: rate of the run.  Files hold n / fps as float32, which lies beside the time of frame n.  Keys keep their
    order, however close they are: ``t`` never passes the middle between them.
    """
    finite = min(max(t, -LARGEST_KEY), LARGEST_KEY)
    early, late = finite - before, after - finite
    near = np.minimum(early, late) <= key_tolerance(t, fps)
    return np.where(near, np.where(late < early, after, before), t)


def segment(
    times: Array, t: float, fps: float = DEFAULT_FPS, resampled: Array | None = None
) -> tuple[int, int, float, float]:
    """The keys around ``t``: (i, j, u, dt) with u in [0, 1].  Outside the keys i == j, u == 0 and dt == 0.

    ``times`` (K,) float64, in order, K >= 1.  Of keys at one time, the last begins what follows and holds at that time,
    and the first ends what is before.  ``resampled``: as in ``Channel``; ``t`` does not move to such a key.
    """
    of_file = np.ones(len(times), dtype=bool) if resampled is None else ~resampled
    bounds = np.concatenate([[-np.inf], times, [np.inf]])
    key = int(np.searchsorted(times, t, side="right"))
    before = bounds[key] if key > 0 and of_file[key - 1] else -np.inf
    after = bounds[key + 1] if key < len(times) and of_file[key] else np.inf
    t = float(time_on_key(t, before, after, fps))
    i = int(np.searchsorted(times, t, side="right")) - 1
    if i < 0 or i >= len(times) - 1:
        i = min(max(i, 0), len(times) - 1)
        return i, i, 0.0, 0.0
    dt = float(times[i + 1] - times[i])
    return i, i + 1, float(t - times[i]) / dt, dt


def interpolate(interpolation: str, rotation: bool, first: Array, second: Array, u: Array, dt: Array) -> Array:
    """Blend key rows ``first`` and ``second`` of C channels.  -> (C, n) float64.

    Rows are (C, n), for CUBICSPLINE (C, 3, n) as in ``Channel.values``; ``u``, ``dt`` are (C,).  With ``rotation`` the
    rows are quaternions, of unit length for STEP and LINEAR (see ``prepare_keys``), and the result is a unit
    quaternion.
    """
    if interpolation == CUBICSPLINE:
        out = hermite(first[:, 1], first[:, 2], second[:, 0], second[:, 1], u, dt)
        return unit_quaternions(out) if rotation else out
    if interpolation == STEP:
        return first
    if rotation:
        return slerp(first, second, u)
    return first + u[:, None] * (second - first)


def prepare_keys(channel: Channel) -> Array:
    """The channel's key rows for ``interpolate``: (K, n), or (K, 3, n) for CUBICSPLINE; float64."""
    values = np.asarray(channel.values, dtype=np.float64)
    shape = (len(channel.times), 3, -1) if channel.interpolation == CUBICSPLINE else (len(channel.times), -1)
    values = values.reshape(shape)
    if is_rotation(channel) and channel.interpolation != CUBICSPLINE:
        return unit_quaternions(values)
    return values


def is_rotation(channel: Channel) -> bool:
    return channel.target == "node" and channel.path == "rotation"


def varies(channel: Channel) -> bool:
    """Whether the channel's value changes between any two times."""
    values = channel.values
    if len(values) < 2:
        return False
    if channel.interpolation == CUBICSPLINE:
        return bool(np.any(values[:, 1] != values[:1, 1]) or np.any(values[:, [0, 2]]))
    return bool(np.any(values != values[:1]))


def sample_channel(channel: Channel, t: float, fps: float = DEFAULT_FPS) -> Array:
    """Value of one channel at ``t`` seconds, clamped to the first and last key.  -> (n,) float64.

    ``fps``: rate of the run, for ``time_on_key``.  Rotations are unit quaternions xyzw.  Finite for all keys that fit a
    float32, at any distance in time.  Scalar reference for ``Timeline``.
    """
    times = np.asarray(channel.times, dtype=np.float64)
    keys = prepare_keys(channel)
    i, j, u, dt = segment(times, t, fps, channel.resampled)
    interpolation = STEP if channel.path == "visible" else channel.interpolation
    first, second = keys[i : i + 1], keys[j : j + 1]
    if channel.path == "visible" and keys.ndim == 3:
        first = second = keys[i : i + 1, 1]
    return interpolate(interpolation, is_rotation(channel), first, second, np.array([u]), np.array([dt]))[0]


def _dot(a: Array, b: Array) -> Array:
    """Dot product of quaternions, (..., 4) and (..., 4) -> (..., 1).  The order of the sum is independent of the number
    of rows.
    """
    p = a * b
    return (p[..., 0] + p[..., 1] + p[..., 2] + p[..., 3])[..., None]


@dataclass(frozen=True, slots=True)
class Track:
    """Channels with the same target, path, interpolation and width; keys are concatenated."""

    target: str  # node | camera | light
    path: str
    interpolation: str
    index: Array  # (C,) int64: index of the node, camera or light
    clock: Array  # (C,) int64: index of the distinct time array
    start: Array  # (C,) int64: first row of each channel in ``keys``
    keys: Array  # (sum K, n) or (sum K, 3, n) float64

    @property
    def rotation(self) -> bool:
        return self.target == "node" and self.path == "rotation"


class Timeline:
    """Channels of a scene, prepared for sampling without a loop over channels.

    A game capture has thousands of channels (32 armatures x 52 bones x 3 paths).  Sampling is a pure function of
    (channels, fps, t).  Of several channels on one property the last one applies.  ``visible`` is always STEP.
    """

    def __init__(self, channels: Iterable[Channel], fps: float = DEFAULT_FPS):
        """Prepare ``channels``.  ``fps``: frames a second of the run, by which times move to keys (``time_on_key``)."""
        self.fps = fps
        last = {(c.target, c.index, c.path): c for c in channels}
        clocks: dict[bytes, int] = {}
        times: list[Array] = []
        of_file: list[Array] = []
        groups: dict[tuple[str, str, str, int], list[tuple[Channel, Array, int]]] = {}
        for channel in last.values():
            key_times = np.ascontiguousarray(channel.times, dtype=np.float64)
            in_file = np.ones(len(key_times), bool) if channel.resampled is None else ~channel.resampled
            clock = clocks.setdefault(key_times.tobytes() + in_file.tobytes(), len(clocks))
            if clock == len(times):
                times.append(key_times)
                of_file.append(in_file)
            keys = prepare_keys(channel)
            interpolation = channel.interpolation
            if channel.path == "visible":
                interpolation, keys = STEP, keys[:, 1] if keys.ndim == 3 else keys
            name = (channel.target, channel.path, interpolation, keys.shape[-1])
            groups.setdefault(name, []).append((channel, keys, clock))
        self._times = np.concatenate(times) if times else np.zeros(0)
        self._count = np.array([len(t) for t in times], dtype=np.int64)
        self._start = np.cumsum(self._count) - self._count
        # Of keys at one time, the last: (sum K,) index within its time array.
        lasts = [np.searchsorted(t, t, side="right") - 1 for t in times]
        self._last = np.concatenate(lasts) if lasts else np.zeros(0, dtype=np.int64)
        self._of_file = np.concatenate(of_file) if of_file else np.zeros(0, dtype=bool)
        self.tracks = tuple(_track(name, members) for name, members in groups.items())

    def sample(self, t: float) -> list[tuple[Track, Array]]:
        """Each track with the values of its channels at ``t`` seconds, (C, n) float64; equal to ``sample_channel``."""
        if not self.tracks:
            return []
        first, second, u, dt = self._segments(t)
        out = []
        for track in self.tracks:
            c = track.clock
            a, b = track.keys[track.start + first[c]], track.keys[track.start + second[c]]
            out.append((track, interpolate(track.interpolation, track.rotation, a, b, u[c], dt[c])))
        return out

    def _segments(self, t: float) -> tuple[Array, Array, Array, Array]:
        """``segment`` for all clocks: (i, j, u, dt), each (clocks,).

        One binary search over all time arrays.  Invariant: ``times[low - 1] <= t < times[high]``.
        """
        low, high = np.zeros_like(self._count), self._count.copy()
        for _ in range(int(self._count.max()).bit_length()):
            middle = (low + high) >> 1
            open_ = low < high
            at_or_before = self._times[self._start + np.minimum(middle, self._count - 1)] <= t
            low = np.where(open_ & at_or_before, middle + 1, low)
            high = np.where(open_ & ~at_or_before, middle, high)
        key, last = low - 1, self._count - 1
        this_key, next_key = self._start + np.maximum(key, 0), self._start + np.minimum(low, last)
        before = np.where((key >= 0) & self._of_file[this_key], self._times[this_key], -np.inf)
        later = np.where((low <= last) & self._of_file[next_key], self._times[next_key], np.inf)
        at = time_on_key(t, before, later, self.fps)
        key = np.where(at == later, self._last[next_key], key)
        inside = (key >= 0) & (key < self._count - 1)
        first = np.clip(key, 0, self._count - 1)
        second = np.where(inside, first + 1, first)
        t0, t1 = self._times[self._start + first], self._times[self._start + second]
        dt = t1 - t0
        u = np.where(inside, (at - t0) / np.where(inside, dt, 1.0), 0.0)
        return first, second, u, dt


def _track(name: tuple[str, str, str, int], members: list[tuple[Channel, Array, int]]) -> Track:
    target, path, interpolation, _ = name
    rows = np.array([len(keys) for _, keys, _ in members], dtype=np.int64)
    return Track(
        target=target,
        path=path,
        interpolation=interpolation,
        index=np.array([channel.index for channel, _, _ in members], dtype=np.int64),
        clock=np.array([clock for _, _, clock in members], dtype=np.int64),
        start=np.cumsum(rows) - rows,
        keys=np.concatenate([keys for _, keys, _ in members]),
    )
