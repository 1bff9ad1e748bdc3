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

from dataclasses import dataclass, fields

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
class Pieces:
    """P cubics in order of time, without gaps: values and derivatives per second at their ends, each (P, n)."""

    t0: Array  # (P,) seconds
    t1: Array  # (P,) seconds
    value0: Array
    slope0: Array
    value1: Array
    slope1: Array


@dataclass(frozen=True, slots=True)
class Segments:
    """S segments of a rotation spline between keys: unit quaternions ``p`` and ``q`` (S, 4), logarithms (S, 3).

    ``log``: of p^-1 q; ``out`` and ``into``: tangents at p and q.  ``s0``, ``s1``: the part of [0, 1] that is used;
    ``t0``, ``t1``: its times in seconds.
    """

    p: Array
    q: Array
    log: Array
    out: Array
    into: Array
    s0: Array
    s1: Array
    t0: Array
    t1: Array

    def __getitem__(self, rows: Array) -> Segments:
        return Segments(*(getattr(self, f.name)[rows] for f in fields(self)))


Keys = tuple[Array, Array]
"""Times (K,) in order and values (K, 3, n): in-tangent, value, out-tangent, as CUBICSPLINE channels."""


def position_keys(times: Array, values: Array, tcb: Array, window: tuple[float, float]) -> Keys:
    """The spline through ``values`` (K, n) at ``times`` (K,), K >= 4, with tension, continuity, bias (K, 3).

    ``window``: time range (start, end) in seconds; the resulting keys have start as time 0.
    """
    i, t0, t1 = _spans(times, window)
    if not len(i):
        return _join(None, window[0], values[-2])
    out, into = _tangents(times, np.diff(values, axis=0), tcb, i)
    span = (times[i + 1] - times[i])[:, None]
    a, b = _hermite(values[i], out, into, values[i + 1], (t0 - times[i])[:, None] / span, span)
    c, d = _hermite(values[i], out, into, values[i + 1], (t1 - times[i])[:, None] / span, span)
    return _join(Pieces(t0, t1, a, b, c, d), window[0], values[-2])


def rotation_keys(times: Array, axes: Array, degrees: Array, tcb: Array, window: tuple[float, float]) -> Keys:
    """Keys as of ``position_keys``, quaternions xyzw, of rotations by ``degrees`` (K,) about ``axes`` (K, 3).

    Axes can have any length; a zero axis is no rotation.
    """
    axes, half = math3d.normalize(axes), 0.5 * np.radians(degrees)
    half = np.where(np.any(axes != 0.0, axis=1), half, 0.0)
    quaternions, logs = _unwind(axes, half)
    i, t0, t1 = _spans(times, window)
    if not len(i):
        return _join(None, window[0], quaternions[-2])
    out, into = _tangents(times, logs, tcb, i)
    span = times[i + 1] - times[i]
    s0, s1 = (t0 - times[i]) / span, (t1 - times[i]) / span
    segments = Segments(quaternions[i], quaternions[i + 1], logs[i], out, into, s0, s1, t0, t1)
    return _join(_resample(segments), window[0], quaternions[-2])


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
    """LINEAR keys clipped to the window, times relative to its start.  (K,) increasing, (K, n) -> (L,), (L, n)."""
    start, end = window
    inside = (times > start) & (times < end)

    def at(t: float) -> Array:
        return np.array([np.interp(t, times, column) for column in values.T])

    if not end > start:
        return np.zeros(1), at(start)[None]
    cut = np.concatenate([[start], times[inside], [end]])
    return cut - start, np.concatenate([at(start)[None], values[inside], at(end)[None]])


def key_window(times: Array) -> tuple[float, float]:
    """Start and end of a spline through keys at these times: the second and the second-to-last key."""
    return float(times[1]), float(max(times[-2], times[1]))


def _spans(times: Array, window: tuple[float, float]) -> tuple[Array, Array, Array]:
    """Segments inside the window, in order, without gaps: i of the segment from key i to i + 1, begin, end; (S,) each.

    Where the value is constant inside the window, one span of length 0.
    """
    keys = times.tolist()
    last, reached = keys[-2], keys[1]
    spans = []
    for i in range(1, len(keys) - 2):
        t1 = min(keys[i + 1], last)
        if t1 > reached and keys[i + 1] > keys[i]:
            spans.append((i, reached, t1))
            reached = t1
    low, high = window
    visible = [(i, max(t0, low), min(t1, high)) for i, t0, t1 in spans if t1 > low and (t0 < high or t0 == low)]
    if not visible and spans:
        (i, t0, _), (j, _, t1) = spans[0], spans[-1]
        visible = [(i, t0, t0)] if t0 >= high else [(j, t1, t1)]
    columns = np.array(visible, dtype=np.float64).reshape(-1, 3).T
    return columns[0].astype(np.int64), columns[1], columns[2]


def _tangents(times: Array, chords: Array, tcb: Array, i: Array) -> tuple[Array, Array]:
    """Outgoing tangents at keys i and incoming tangents at keys i + 1, per unit of the segments' parameters.

    ``chords`` (K - 1, n): differences of the keys; i (S,) -> (S, n), (S, n).
    """
    tension, continuity, bias = tcb[i].T[..., None]
    adjust = 2.0 * _ratio(times[i + 1] - times[i], times[i + 1] - times[i - 1])
    common = 0.5 * adjust * (1 - tension)
    out = common * ((1 + continuity) * (1 + bias) * chords[i - 1] + (1 - continuity) * (1 - bias) * chords[i])
    tension, continuity, bias = tcb[i + 1].T[..., None]
    adjust = 2.0 * _ratio(times[i + 1] - times[i], times[i + 2] - times[i])
    common = 0.5 * adjust * (1 - tension)
    into = common * ((1 - continuity) * (1 + bias) * chords[i] + (1 + continuity) * (1 - bias) * chords[i + 1])
    return out, into


def _ratio(part: Array, whole: Array) -> Array:
    """Ratio of two adjacent spans; 0.5 where the times do not increase.  (S,) -> (S, 1)."""
    usable = (part > 0) & (whole >= part)
    return np.where(usable, part / np.where(usable, whole, 1.0), 0.5)[:, None]


def _hermite(p: Array, out: Array, into: Array, q: Array, s: Array, span: Array) -> tuple[Array, Array]:
    """Value and derivative per second at ``s`` (S, 1) in [0, 1]; the ends return the keys bit for bit."""
    s2 = s * s
    s3 = s2 * s
    slope = 6 * (s - s2) * (q - p) + (3 * s2 - 4 * s + 1) * out + (3 * s2 - 2 * s) * into
    value = p + (3 * s2 - 2 * s3) * (q - p) + (s3 - 2 * s2 + s) * out + (s3 - s2) * into
    return np.where(s == 0.0, p, np.where(s == 1.0, q, value)), slope / span


def _unwind(axes: Array, half: Array) -> tuple[Array, Array]:
    """Unit quaternions (K, 4) of coherent sign, and log(q_i^-1 q_(i+1)) (K-1, 3) the way each step turns."""
    quaternions = math3d.quat_from_axis_angle(axes, 2.0 * half)
    far = np.diff(half)
    long = (np.linalg.norm(np.diff(axes, axis=0), axis=1) <= SAME_AXIS) & (np.abs(far) > np.pi / 2)
    dot = np.sum(quaternions[:-1] * quaternions[1:], axis=1)
    flips = np.where(np.where(long, np.cos(far) * dot, dot) < 0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(flips)[:, None]
    short = _log(math3d.quat_multiply(_inverse(quaternions[:-1]), quaternions[1:]), np.zeros((len(far), 3)))
    short[np.all(quaternions[:-1] == quaternions[1:], axis=1)] = 0.0
    return quaternions, np.where(long[:, None], far[:, None] * axes[:-1], short)


class _Squad:
    """The curves between keys: slerp(2 s (1 - s), slerp(s, p, q), slerp(s, a, b)).

    a = p exp((out - log) / 2), b = q exp((log - into) / 2).  About one axis this is the cubic through the angles; each
    logarithm takes the branch nearest to that case.
    """

    def __init__(self, segments: Segments):
        self.p, self.log = segments.p, segments.log
        self.bend0, self.bend1 = 0.5 * (segments.out - segments.log), 0.5 * (segments.log - segments.into)
        self.a = math3d.quat_multiply(segments.p, _exp(self.bend0))
        b = math3d.quat_multiply(segments.q, _exp(self.bend1))
        self.across = _log(math3d.quat_multiply(_inverse(self.a), b), segments.log - self.bend0 + self.bend1)

    def at(self, rows: Array, s: Array) -> Array:
        """Unit quaternions of segments ``rows`` (N,) at ``s`` (N,).  -> (N, 4)."""
        s = s[:, None]
        straight = math3d.quat_multiply(self.p[rows], _exp(s * self.log[rows]))
        bent = math3d.quat_multiply(self.a[rows], _exp(s * self.across[rows]))
        bend0 = self.bend0[rows]
        guess = bend0 + s * (self.bend1[rows] - bend0)
        between = _log(math3d.quat_multiply(_inverse(straight), bent), guess)
        return math3d.normalize(math3d.quat_multiply(straight, _exp(2.0 * s * (1.0 - s) * between)))


PAD = 2
"""Samples beyond each end of a segment, for the derivatives at its ends; the curve is smooth there."""


def _resample(segments: Segments) -> Pieces:
    """Cubic pieces of the curves within ``ROTATION_ERROR``; keys are matched bit for bit.

    Every segment starts with 4 pieces.  The error of a cubic falls with the fourth power of its length, which gives the
    next number of pieces of the segments that are not within the limit.
    """
    still = ~(np.any(segments.log, axis=1) | np.any(segments.out, axis=1) | np.any(segments.into, axis=1))
    still |= ~(segments.t1 > segments.t0)
    finished = [(np.flatnonzero(still), _constant(segments[still]))]
    left, count = np.flatnonzero(~still), np.full(np.count_nonzero(~still), 4)
    while len(left):
        rows, pieces, errors = _cut(segments[left], count)
        enough = (errors <= ROTATION_ERROR) | (count >= MAX_PIECES)
        finished.append((left[rows[enough[rows]]], _rows(pieces, enough[rows])))
        left, count, errors = left[~enough], count[~enough], errors[~enough]
        pieces_needed = np.ceil(1.05 * count * (errors / ROTATION_ERROR) ** 0.25).astype(np.int64)
        count = np.clip(pieces_needed, count + 1, MAX_PIECES)
    order = np.argsort(np.concatenate([rows for rows, _ in finished]), kind="stable")
    return Pieces(*(np.concatenate([getattr(p, f.name) for _, p in finished])[order] for f in fields(Pieces)))


def _rows(pieces: Pieces, rows: Array) -> Pieces:
    return Pieces(*(getattr(pieces, f.name)[rows] for f in fields(Pieces)))


def _constant(segments: Segments) -> Pieces:
    """One piece of slope 0 for each segment that turns nowhere or has length 0."""
    values, rest = segments.p.copy(), np.zeros_like(segments.p)
    turns = np.flatnonzero(np.any(segments.log, axis=1) | np.any(segments.out, axis=1) | np.any(segments.into, axis=1))
    values[turns] = _Squad(segments).at(turns, segments.s0[turns])
    return Pieces(segments.t0, segments.t1, values, rest, values, rest)


def _cut(segments: Segments, count: Array) -> tuple[Array, Pieces, Array]:
    """``count`` (S,) cubic pieces of equal length for each segment.  -> segment of each piece (P,), pieces, error (S,).

    The curve is sampled at the ends and the quarters of all pieces.  Derivatives by a five-point stencil over the
    samples; errors in radians at the quarters.
    """
    samples = 4 * count + 1 + 2 * PAD
    starts = np.concatenate([[0], np.cumsum(samples)])
    rows = np.repeat(np.arange(len(count)), samples)
    at = np.arange(starts[-1]) - starts[rows] - PAD
    step = (segments.s1 - segments.s0) / count
    curve = _Squad(segments).at(rows, segments.s0[rows] + at * (0.25 * step)[rows])
    curve[starts[:-1][segments.s0 == 0.0] + PAD] = segments.p[segments.s0 == 0.0]
    curve[starts[1:][segments.s1 == 1.0] - 1 - PAD] = segments.q[segments.s1 == 1.0]

    piece = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    first = starts[piece] + PAD + 4 * number  # the sample at the start of each piece
    seconds = ((segments.t1 - segments.t0) / count)[piece]

    def slope(k: Array) -> Array:
        return (8 * (curve[k + 1] - curve[k - 1]) - (curve[k + 2] - curve[k - 2])) / (3.0 * seconds[:, None])

    value0, slope0, value1, slope1 = curve[first], slope(first), curve[first + 4], slope(first + 4)
    errors = np.zeros(len(count))
    for quarter in (1, 2, 3):
        u = 0.25 * quarter
        bend = (u**3 - 2 * u * u + u) * slope0 + (u**3 - u * u) * slope1
        cubic = value0 + (3 * u * u - 2 * u**3) * (value1 - value0) + seconds[:, None] * bend
        away = math3d.quat_angle(math3d.normalize(cubic), curve[first + quarter])
        errors = np.maximum(errors, np.maximum.reduceat(away, np.cumsum(count) - count))
    t0 = segments.t0[piece] + number * seconds
    t1 = np.where(number + 1 == count[piece], segments.t1[piece], segments.t0[piece] + (number + 1) * seconds)
    return piece, Pieces(t0, t1, value0, slope0, value1, slope1), errors


def _join(pieces: Pieces | None, origin: float, held: Array) -> Keys:
    """Pieces as keys with times relative to ``origin``.

    A jump becomes two keys at one time.  ``held``: the value if there are no pieces.
    """
    if pieces is None or not pieces.t1[-1] > pieces.t0[0]:
        value = held if pieces is None else pieces.value0[0]
        return np.zeros(1), np.stack([np.zeros_like(value), value, np.zeros_like(value)])[None]
    jump = np.zeros(len(pieces.t0), dtype=bool)
    jump[1:] = np.any(np.abs(pieces.value0[1:] - pieces.value1[:-1]) > 1e-12, axis=1)
    start = np.arange(len(jump)) + np.cumsum(jump)  # key at the start of each piece
    times = np.empty(start[-1] + 2)
    values = np.zeros((len(times), 3, pieces.value0.shape[1]))
    times[0], values[0, 1] = pieces.t0[0], pieces.value0[0]
    times[start + 1], values[start + 1, 1] = pieces.t1, pieces.value1
    values[start, 2], values[start + 1, 0] = pieces.slope0, pieces.slope1
    times[start[jump]], values[start[jump], 1] = pieces.t1[np.flatnonzero(jump) - 1], pieces.value0[jump]
    return times - origin, values


def _inverse(q: Array) -> Array:
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def _exp(v: Array) -> Array:
    """Unit quaternions (..., 4) of half angles times axes, (..., 3)."""
    angle = np.sqrt(np.sum(v * v, axis=-1, keepdims=True))
    return np.concatenate([v * np.sinc(angle / np.pi), np.cos(angle)], axis=-1)


def _log(q: Array, guess: Array) -> Array:
    """Half angle times axis of unit quaternions, on the branch (turns of the same sign) nearest to ``guess``.

    (..., 4), (..., 3) -> (..., 3).
    """
    vector = q[..., :3]
    length = np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True))
    angle = np.arctan2(length, q[..., 3:])
    axis = np.where(length > 1e-12, vector / np.maximum(length, 1e-300), math3d.normalize(guess))
    turns = np.round((np.sum(axis * guess, axis=-1, keepdims=True) - angle) / (2 * np.pi))
    return (angle + 2 * np.pi * turns) * axis
