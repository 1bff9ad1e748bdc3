"""Kochanek-Bartels splines of AFF as channels of the model.

Position and scale: cubic polynomials, converted exactly.  Rotation: the same construction on the logarithms of
quaternions (squad), resampled as cubic quaternion keys within ``ROTATION_ERROR`` of the curve.

Both follow BART's animation code: tangents are scaled for keys that are not evenly spaced, the first and the last key
only affect the tangents of their neighbors, and time is clamped to the keys between them.  Where key times do not
increase, that code evaluates the first segment that ends after ``t``: a segment that does not end after all earlier
ones is never evaluated, and the next one starts in its interior.  ``_spans`` expresses this rule as intervals.

Turns: consecutive keys with the same axis and angles more than 180 degrees apart turn by the full difference, which can
be several revolutions; all others take the shorter arc.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taubench_gl import math3d

Array = np.ndarray

ROTATION_ERROR = 1e-7
"""Limit in radians on the distance between spline and resampled curve, checked at the quarters of every resampled
interval: 0.0005 pixels for a 40 degree camera at 4K."""
MAX_PIECES = 512
"""Limit on resampled intervals per segment; ten revolutions between two keys need 128."""
SAME_AXIS = 1e-9


@dataclass(frozen=True, slots=True)
class Piece:
    """A cubic on [t0, t1]: values and derivatives per second at its ends, each (n,)."""

    t0: float
    t1: float
    value0: Array
    slope0: Array
    value1: Array
    slope1: Array


Keys = tuple[Array, Array]
"""Times (K,) strictly increasing and values (K, 3, n): in-tangent, value, out-tangent, as CUBICSPLINE channels."""


def position_keys(times: Array, values: Array, tcb: Array, window: tuple[float, float]) -> Keys:
    """The spline through ``values`` (K, n) at ``times`` (K,), K >= 4, with tension, continuity, bias (K, 3).

    ``window``: time range (start, end) in seconds; the resulting keys have start as time 0.
    """
    chords = np.diff(values, axis=0)
    pieces = []
    for i, t0, t1 in _spans(times, window):
        out, into = _tangents(times, chords, tcb, i)
        span = times[i + 1] - times[i]
        a, b = _hermite(values[i], out, into, values[i + 1], (t0 - times[i]) / span, span)
        c, d = _hermite(values[i], out, into, values[i + 1], (t1 - times[i]) / span, span)
        pieces.append(Piece(t0, t1, a, b, c, d))
    return _join(pieces, window[0], values[-2])


def rotation_keys(times: Array, axes: Array, degrees: Array, tcb: Array, window: tuple[float, float]) -> Keys:
    """As ``position_keys`` for rotations of ``degrees`` (K,) about ``axes`` (K, 3); values are quaternions xyzw.

    Axes can have any length; a zero axis is no rotation.
    """
    axes, half = math3d.normalize(axes), 0.5 * np.radians(degrees)
    half = np.where(np.any(axes != 0.0, axis=1), half, 0.0)
    quaternions, logs = _unwind(axes, half)
    pieces: list[Piece] = []
    for i, t0, t1 in _spans(times, window):
        out, into = _tangents(times, logs, tcb, i)
        span = times[i + 1] - times[i]
        curve = _squad(quaternions[i], quaternions[i + 1], logs[i], out, into)
        s0, s1 = (t0 - times[i]) / span, (t1 - times[i]) / span
        if not (np.any(logs[i]) or np.any(out) or np.any(into)):
            rest = np.zeros(4)
            pieces.append(Piece(t0, t1, quaternions[i], rest, quaternions[i], rest))
        else:
            ends = (quaternions[i] if s0 == 0.0 else None, quaternions[i + 1] if s1 == 1.0 else None)
            pieces += _resample(curve, s0, s1, t0, t1, ends)
    return _join(pieces, window[0], quaternions[-2])


def long_turns(axes: Array, degrees: Array) -> Array:
    """Indices of keys that are followed by a turn of more than 180 degrees about the same axis."""
    axes = math3d.normalize(axes)
    same = np.linalg.norm(np.diff(axes, axis=0), axis=1) <= SAME_AXIS
    return np.flatnonzero(same & (np.abs(np.diff(degrees)) > 180.0))


def visible_keys(times: Array, values: Array, window: tuple[float, float]) -> tuple[Array, Array]:
    """STEP keys: visible until the first key, then the value of each key.  -> (K,) seconds from the start, (K, 1)."""
    start, end = window
    out_times, out_values, state, reached = [0.0], [1.0], 1.0, -np.inf
    for t, value in zip(times.tolist(), values.tolist()):
        state, reached = float(value != 0), max(reached, t)
        if reached > end:
            break
        at = max(reached - start, 0.0)
        if at == out_times[-1]:
            out_values[-1] = state
        else:
            out_times.append(at)
            out_values.append(state)
    return np.array(out_times), np.array(out_values)[:, None]


def linear_keys(times: Array, values: Array, window: tuple[float, float]) -> tuple[Array, Array]:
    """LINEAR keys clipped to the window, times relative to its start.  (K,) strictly increasing, (K, n) -> the same."""
    start, end = window
    inside = (times > start) & (times < end)

    def at(t: float) -> Array:
        return np.array([np.interp(t, times, column) for column in values.T])

    if not end > start:
        return np.zeros(1), at(start)[None]
    cut = np.concatenate([[start], times[inside], [end]])
    return _increasing(cut - start), np.concatenate([at(start)[None], values[inside], at(end)[None]])


def key_window(times: Array) -> tuple[float, float]:
    """Start and end of a spline through keys at these times: the second and the second-to-last key."""
    return float(times[1]), float(max(times[-2], times[1]))


def _spans(times: Array, window: tuple[float, float]) -> list[tuple[int, float, float]]:
    """Segments inside the window: (i of the segment from key i to i + 1, begin, end), in order, without gaps.

    Where the value is constant inside the window, one span of length 0.
    """
    last, reached = float(times[-2]), float(times[1])
    spans = []
    for i in range(1, len(times) - 2):
        t1 = min(float(times[i + 1]), last)
        if t1 > reached and times[i + 1] > times[i]:
            spans.append((i, reached, t1))
            reached = t1
    low, high = window
    seen = [(i, max(t0, low), min(t1, high)) for i, t0, t1 in spans if t1 > low and (t0 < high or t0 == low)]
    if seen or not spans:
        return seen
    (i, t0, _), (j, _, t1) = spans[0], spans[-1]
    return [(i, t0, t0)] if t0 >= high else [(j, t1, t1)]


def _tangents(times: Array, chords: Array, tcb: Array, i: int) -> tuple[Array, Array]:
    """Outgoing tangent at key i and incoming tangent at key i + 1, per unit of the segment's parameter."""
    tension, continuity, bias = tcb[i]
    adjust = 2.0 * _ratio(times[i + 1] - times[i], times[i + 1] - times[i - 1])
    common = 0.5 * adjust * (1 - tension)
    out = common * ((1 + continuity) * (1 + bias) * chords[i - 1] + (1 - continuity) * (1 - bias) * chords[i])
    tension, continuity, bias = tcb[i + 1]
    adjust = 2.0 * _ratio(times[i + 1] - times[i], times[i + 2] - times[i])
    common = 0.5 * adjust * (1 - tension)
    into = common * ((1 - continuity) * (1 + bias) * chords[i] + (1 + continuity) * (1 - bias) * chords[i + 1])
    return out, into


def _ratio(part: float, whole: float) -> float:
    """Ratio of two adjacent spans; 0.5 where the times do not increase."""
    return float(part / whole) if part > 0 and whole >= part else 0.5


def _hermite(p: Array, out: Array, into: Array, q: Array, s: float, span: float) -> tuple[Array, Array]:
    """Value and derivative per second at ``s`` in [0, 1]; the ends return the keys bit for bit."""
    s2 = s * s
    slope = 6 * (s - s2) * (q - p) + (3 * s2 - 4 * s + 1) * out + (3 * s2 - 2 * s) * into
    if s in (0.0, 1.0):
        return (p if s == 0.0 else q), slope / span
    s3 = s2 * s
    value = p + (3 * s2 - 2 * s3) * (q - p) + (s3 - 2 * s2 + s) * out + (s3 - s2) * into
    return value, slope / span


def _unwind(axes: Array, half: Array) -> tuple[Array, Array]:
    """Unit quaternions (K, 4) of coherent sign, and log(q_i^-1 q_(i+1)) (K-1, 3) the way each step turns."""
    quaternions = math3d.quat_from_axis_angle(axes, 2.0 * half)
    logs = np.zeros((len(half) - 1, 3))
    for i in range(len(half) - 1):
        far = half[i + 1] - half[i]
        if np.linalg.norm(axes[i + 1] - axes[i]) <= SAME_AXIS and abs(far) > np.pi / 2:
            logs[i] = far * axes[i]
            if np.cos(far) * np.dot(quaternions[i], quaternions[i + 1]) < 0:
                quaternions[i + 1 :] *= -1.0
            continue
        if np.dot(quaternions[i], quaternions[i + 1]) < 0:
            quaternions[i + 1 :] *= -1.0
        step = math3d.quat_multiply(_inverse(quaternions[i]), quaternions[i + 1])
        if not np.array_equal(quaternions[i], quaternions[i + 1]):
            logs[i] = _log(step, np.zeros(3))
    return quaternions, logs


def _squad(p: Array, q: Array, log: Array, out: Array, into: Array) -> Callable[[Array], Array]:
    """The curve between two keys.  s (S,) -> (S, 4) unit quaternions.

    slerp(2 s (1 - s), slerp(s, p, q), slerp(s, a, b)) with a = p exp((out - log) / 2), b = q exp((log - into) / 2).
    About one axis this is the cubic through the angles; each logarithm takes the branch nearest to that case.
    """
    bend0, bend1 = 0.5 * (out - log), 0.5 * (log - into)
    a = math3d.quat_multiply(p, _exp(bend0))
    b = math3d.quat_multiply(q, _exp(bend1))
    across = _log(math3d.quat_multiply(_inverse(a), b), log - bend0 + bend1)

    def curve(s: Array) -> Array:
        s = np.asarray(s, dtype=np.float64)[:, None]
        straight = math3d.quat_multiply(np.broadcast_to(p, (len(s), 4)), _exp(s * log))
        bent = math3d.quat_multiply(np.broadcast_to(a, (len(s), 4)), _exp(s * across))
        step = math3d.quat_multiply(_inverse(straight), bent)
        between = np.array([_log(x, g) for x, g in zip(step, (1 - s) * bend0 + s * bend1)])
        return math3d.normalize(math3d.quat_multiply(straight, _exp(2.0 * s * (1.0 - s) * between)))

    return curve


def _resample(
    curve: Callable[[Array], Array],
    s0: float,
    s1: float,
    t0: float,
    t1: float,
    ends: tuple[Array | None, Array | None],
) -> list[Piece]:
    """Cubic pieces of the curve over [s0, s1] within ROTATION_ERROR; ``ends``: keys to match bit for bit, or None."""
    if not t1 > t0:
        value = curve(np.array([s0]))[0]
        return [Piece(t0, t1, value, np.zeros(4), value, np.zeros(4))]
    count = 4
    while True:
        s = np.linspace(s0, s1, count + 1)
        values, slopes = curve(s), _slopes(curve, s) * ((s1 - s0) / (t1 - t0))
        values[0] = values[0] if ends[0] is None else ends[0]
        values[-1] = values[-1] if ends[1] is None else ends[1]
        step = (t1 - t0) / count
        worst = 0.0
        for u in (0.25, 0.5, 0.75):
            u2, u3 = u * u, u**3
            h = (3 * u2 - 2 * u3) * (values[1:] - values[:-1]) + values[:-1]
            h = h + step * ((u3 - 2 * u2 + u) * slopes[:-1] + (u3 - u2) * slopes[1:])
            true = curve(s[:-1] + u * (s1 - s0) / count)
            worst = max(worst, float(np.max(math3d.quat_angle(math3d.normalize(h), true))))
        if worst <= ROTATION_ERROR or count >= MAX_PIECES:
            break
        count *= 2
    t = np.linspace(t0, t1, count + 1)
    return [
        Piece(float(t[i]), float(t[i + 1]), values[i], slopes[i], values[i + 1], slopes[i + 1]) for i in range(count)
    ]


def _slopes(curve: Callable[[Array], Array], s: Array) -> Array:
    """Derivatives by a five-point stencil; the curve is smooth slightly beyond its ends."""
    h = 1e-3
    return (8 * (curve(s + h) - curve(s - h)) - (curve(s + 2 * h) - curve(s - 2 * h))) / (12 * h)


def _join(pieces: list[Piece], origin: float, held: Array) -> Keys:
    """Pieces in order, without gaps, as keys with times relative to ``origin``.

    A jump becomes two keys at adjacent float64 times.  ``held``: the value if there are no pieces.
    """
    rest = np.zeros_like(held)
    if not pieces or pieces[0].t1 == pieces[-1].t0 == pieces[0].t0:
        return np.zeros(1), np.array([[rest, pieces[0].value0 if pieces else held, rest]])
    times, values = [pieces[0].t0 - origin], [[rest, pieces[0].value0, rest]]
    for piece in pieces:
        if not np.allclose(piece.value0, values[-1][1], rtol=0.0, atol=1e-12):
            times.append(times[-1])
            values.append([rest, piece.value0, rest])
        values[-1][2] = piece.slope0
        times.append(piece.t1 - origin)
        values.append([piece.slope1, piece.value1, rest])
    return _increasing(np.array(times)), np.array(values)


def _increasing(times: Array) -> Array:
    """Times that are equal, also by rounding, separated to adjacent float64 values."""
    for i in range(len(times) - 2, -1, -1):
        if times[i] >= times[i + 1]:
            times[i] = np.nextafter(times[i + 1], -np.inf)
    return times


def _inverse(q: Array) -> Array:
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def _exp(v: Array) -> Array:
    """(..., 3) half angle times axis -> (..., 4) unit quaternion."""
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([v * np.sinc(angle / np.pi), np.cos(angle)], axis=-1)


def _log(q: Array, guess: Array) -> Array:
    """Half angle times axis of a unit quaternion, on the branch (turns of the same sign) nearest to ``guess``."""
    length = float(np.linalg.norm(q[:3]))
    angle = float(np.arctan2(length, q[3]))
    if length > 1e-12:
        axis = q[:3] / length
    else:
        size = float(np.linalg.norm(guess))
        axis = guess / size if size > 0 else np.zeros(3)
    turns = np.round((float(np.dot(axis, guess)) - angle) / (2 * np.pi))
    return (angle + 2 * np.pi * turns) * axis
