"""Camera activity, Eqs. (1) and (2) of section 3.1, and the cut rule (docs/conventions.md).  Float64.

**Cut rule.**  A pair (i-1, i) is a cut when the camera moves or turns by more than an absolute floor and by more than a
multiple of its usual change:

    d_i > max(MIN_STEP, STEP_RATIO * r_i)    or    angle_i > max(MIN_TURN, TURN_RATIO * r_i).

r_i, for translation and angle separately, is the largest of

- the median of the ``WINDOW`` pairs before it,
- the median of the ``WINDOW`` pairs after it, so that the first step of a camera that starts to move is not a cut,
- the upper quartile of all other pairs, so that a short lull in jittery motion does not make the next step a cut.

Medians and quartiles are robust: a cut next to this pair does not hide it, and up to a quarter of all pairs may be
cuts.  The pair itself does not enter its own r_i.  With fewer than ``MIN_PAIRS`` pairs no pair is a cut.

**Constants.**  The paper's fast game camera (Table 2: mean 1.892, variance 0.826, max 5.475 a frame) has an upper
quartile near 2.5, so its largest step is about twice the quartile; a factor of 6 leaves a margin.  The teleport of the
VR camera (max 7.163, mean 0.041) exceeds its neighbors by a factor of more than 100.  The VR head turns by 8.222
degrees a frame with variance 72.563 (Table 3), which is close to an exponential distribution; its tail reaches 4 times
the quartile in 360 pairs, and heavier tails reach 8 times, hence 12.  A turn alone is therefore no cut for a camera
that turns by more than 15 degrees in a quarter of its pairs: such a jump cannot be separated from its motion.  The
floors exclude small movements of a still camera: 0.25 m is 6 m/s at the paper's 24 fps, and a person's head turns by
less than 30 degrees in a frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taubench_gl import math3d

Array = np.ndarray

GIMBAL_ZONE = np.radians(1.0)
"""Radians from straight up or down within which yaw and roll cannot be separated (the pair is flagged)."""

PASSING = np.radians(45.0)
"""A camera that turns over the pole by less than this between two frames passes the gimbal zone, even if neither frame
lies in it.  For a larger turn the path is ambiguous, and the angles of the two frames are compared directly."""

QUANTITIES = ("position", "yaw", "pitch", "roll", "angle")


@dataclass(frozen=True, slots=True)
class Activity:
    """Change of a camera per pair (i-1, i).  All arrays are (P,) with P = N - 1 pairs of N frames, or 0."""

    position: Array  # Eq. (1), in the unit of the positions
    yaw: Array  # Eq. (2) about world +Y, degrees in [0, 180]
    pitch: Array  # Eq. (2) about local X, degrees in [0, 180]
    roll: Array  # Eq. (2) about local Z, degrees in [0, 180]
    angle: Array  # geodesic, degrees in [0, 180]
    gimbal: Array  # bool: yaw and roll of this pair follow the gimbal rule

    def __len__(self) -> int:
        return len(self.position)

    def in_meters(self, unit_scale: float) -> Activity:
        """A copy with ``position`` in meters.  ``unit_scale``: scene units per meter."""
        return replace(self, position=self.position / unit_scale)


def camera_activity(position: Array, world_from_view: Array) -> Activity:
    """Eqs. (1) and (2) over a camera path.

    ``position`` (N, 3) scene units and ``world_from_view`` (N, 3, 3) proper rotations, world space.  Angles are
    intrinsic Y-X-Z; differences are wrapped to (-180, 180] before their absolute value is taken.  N < 2 gives empty
    arrays.
    """
    position = np.asarray(position, dtype=np.float64).reshape(-1, 3)
    rotation = np.asarray(world_from_view, dtype=np.float64).reshape(-1, 3, 3)
    if len(position) != len(rotation):
        raise ValueError(f"{len(position)} positions and {len(rotation)} rotations")
    if len(position) < 2:
        empty = np.zeros(0)
        return Activity(empty, empty, empty, empty, empty, np.zeros(0, dtype=bool))
    change, gimbal = euler_changes(rotation)
    yaw, pitch, roll = np.abs(change).T
    q = math3d.quat_from_mat3(rotation)
    return Activity(translation(position), yaw, pitch, roll, np.degrees(math3d.quat_angle(q[:-1], q[1:])), gimbal)


def translation(position: Array) -> Array:
    """Eq. (1): d_p = |p_i - p_(i-1)|.  (N, 3) -> (N-1,)."""
    step = np.diff(np.asarray(position, dtype=np.float64), axis=0)
    peak = np.max(np.abs(step), axis=-1, keepdims=True, initial=0.0)
    scale = np.where(peak > 0, peak, 1.0)  # a step of 1e-170 m does not square to 0
    return scale[:, 0] * np.linalg.norm(step / scale, axis=-1)


def wrap_degrees(difference: Array) -> Array:
    """Angle differences wrapped to (-180, 180].  Values already in range are returned bit for bit."""
    difference = np.asarray(difference, dtype=np.float64)
    wrapped = difference - 360.0 * np.round(difference / 360.0)
    return np.where(wrapped <= -180.0, wrapped + 360.0, wrapped)


def euler_yxz(rotation: Array) -> Array:
    """Intrinsic Y-X-Z angles of R = Ry(yaw) Rx(pitch) Rz(roll), pitch in [-90, 90].  (..., 3, 3) -> (..., 3) radians.

    Straight up or down, where only one of yaw and roll is defined, roll is 0.
    """
    r = rotation
    level = np.hypot(r[..., 0, 2], r[..., 2, 2])  # cos(pitch); atan2 is accurate near the poles, asin is not
    pitch = np.arctan2(-r[..., 1, 2], level)
    locked = level < 1e-9
    yaw = np.where(locked, np.arctan2(-r[..., 2, 0], r[..., 0, 0]), np.arctan2(r[..., 0, 2], r[..., 2, 2]))
    roll = np.where(locked, 0.0, np.arctan2(r[..., 1, 0], r[..., 1, 1]))
    return np.stack([yaw, pitch, roll], axis=-1)


def euler_changes(rotation: Array) -> tuple[Array, Array]:
    """Eq. (2) before the absolute value.  (N, 3, 3) -> signed degrees (N-1, 3) in yaw, pitch, roll; flags (N-1,).

    One orientation has two angle triples: (yaw, pitch, roll) and (yaw + 180, 180 - pitch, roll + 180).  Away from the
    poles the first triple of both frames is compared.  A pair with a frame in the gimbal zone, or that passes over a
    pole, is flagged and continues the previous frame's triple: inside the zone roll is held constant and yaw and pitch
    are solved for (pitch continues past 90); outside it, the triple nearest to the previous frame's is used.
    """
    angles = euler_yxz(rotation)
    change = wrap_degrees(np.degrees(np.diff(angles, axis=0)))
    zone = np.abs(angles[:, 1]) > 0.5 * np.pi - GIMBAL_ZONE
    gimbal = zone[:-1] | zone[1:] | _passes_pole(rotation)
    follow, frame = angles[0], -1  # second triple of the previous flagged pair, and its frame
    for pair in np.flatnonzero(gimbal):
        before = angles[pair]
        if frame == pair:
            before = follow
        elif zone[pair]:  # the same formula for both frames, so that rounding cancels
            before = _fixed_roll(rotation[pair], before[2])
        if np.array_equal(rotation[pair], rotation[pair + 1]):
            follow = before  # a still camera turns by exactly 0, also at the pole
        elif zone[pair + 1]:
            follow = _fixed_roll(rotation[pair + 1], before[2])
        else:
            follow = _nearest(angles[pair + 1], before)
        change[pair] = wrap_degrees(np.degrees(follow - before))
        frame = pair + 1
    return change, gimbal


def _fixed_roll(rotation: Array, roll: float) -> Array:
    """Yaw and pitch in (-180, 180] of a rotation with known roll.  (3, 3) -> (3,) radians."""
    c, s = np.cos(roll), np.sin(roll)
    x = c * rotation[:, 0] - s * rotation[:, 1]  # the columns of R Rz(roll)^-1 = Ry(yaw) Rx(pitch)
    y = s * rotation[:, 0] + c * rotation[:, 1]
    return np.array([np.arctan2(-x[2], x[0]), np.arctan2(-rotation[1, 2], y[1]), roll])


def _nearest(angles: Array, before: Array) -> Array:
    """The one of an orientation's two triples with the smaller total change.  (3,), (3,) -> (3,) radians."""
    other = np.array([angles[0] + np.pi, np.pi - angles[1], angles[2] + np.pi])
    costs = [np.abs(wrap_degrees(np.degrees(triple - before))).sum() for triple in (angles, other)]
    return other if costs[1] < costs[0] else angles


def _passes_pole(rotation: Array) -> Array:
    """Whether the short arc of the view direction between frames passes the gimbal zone.  (N, 3, 3) -> (N-1,) bool."""
    forward = -rotation[:, :, 2]
    a, b = forward[:-1], forward[1:]
    normal = np.cross(a, b)
    sine = np.linalg.norm(normal, axis=-1)
    turns_back = a[:, 0] * b[:, 0] + a[:, 2] * b[:, 2] < 0  # the pole lies between both directions
    near = np.abs(normal[:, 1]) < np.sin(GIMBAL_ZONE) * sine
    same_side = a[:, 1] * b[:, 1] > 0
    return turns_back & near & same_side & (sine < np.sin(PASSING)) & (np.sum(a * b, axis=-1) > 0)


def describe(values: Array) -> dict[str, float | None]:
    """Mean, population variance (two-pass), max, median, 95th percentile (linear).  (P,) -> dict; P = 0: all None."""
    values = np.asarray(values, dtype=np.float64)
    if not len(values):
        return dict.fromkeys(("mean", "variance", "max", "median", "p95"))
    return {
        "mean": float(np.mean(values)),
        "variance": float(np.var(values)),
        "max": float(np.max(values)),
        "median": float(np.median(values)),
        "p95": float(np.percentile(values, 95.0)),
    }


def summarize(
    activity: Activity, cuts: Array | Sequence[bool] | None, fps: float, first_frame: int = 0
) -> dict[str, Any]:
    """The ``camera`` block of summary.json.

    ``cuts`` (P,) bool per pair, from ``detect_cuts``; None: no pair is a cut.  ``first_frame`` is the number of the
    path's first frame.  ``cuts`` and ``gimbal_pairs`` of the result identify a pair by its second frame.
    """
    cut = np.zeros(len(activity), dtype=bool) if cuts is None else np.asarray(cuts, dtype=bool)
    if cut.shape != (len(activity),):
        raise ValueError(f"cuts have shape {cut.shape}, expected ({len(activity)},)")
    block: dict[str, Any] = {}
    for name in QUANTITIES:
        values = getattr(activity, name)
        block[name] = {**describe(values), "without_cuts": describe(values[~cut])}
    block["fps"] = float(fps)
    block["samples"] = len(activity)
    block["cuts"] = (np.flatnonzero(cut) + first_frame + 1).tolist()
    block["gimbal_pairs"] = (np.flatnonzero(activity.gimbal) + first_frame + 1).tolist()
    return block


WINDOW = 5
"""Pairs before and after a pair whose medians enter the cut rule."""
MIN_PAIRS = 3
MIN_STEP = 0.25  # meters
MIN_TURN = 30.0  # degrees
STEP_RATIO = 6.0
TURN_RATIO = 12.0


def detect_cuts(activity: Activity, unit_scale: float = 1.0) -> Array:
    """Which pairs of a camera path are cuts, by the cut rule of docs/conventions.md.  -> (P,) bool.

    ``activity`` in scene units, P pairs; ``unit_scale``: scene units per meter.
    """
    step, turn = activity.position, activity.angle
    if len(activity) < MIN_PAIRS:
        return np.zeros(len(activity), dtype=bool)
    return (step > np.maximum(MIN_STEP * unit_scale, STEP_RATIO * typical_change(step))) | (
        turn > np.maximum(MIN_TURN, TURN_RATIO * typical_change(turn))
    )


def typical_change(values: Array) -> Array:
    """r_i of the cut rule: the usual change around each pair, without the pair.  (P,), P >= 2 -> (P,) float64."""
    values = np.asarray(values, dtype=np.float64)
    count = len(values)
    padded = np.concatenate([np.full(WINDOW, np.nan), values, np.full(WINDOW, np.nan)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)
    before, after = windows[:count], windows[WINDOW + 1 :]
    medians = np.zeros((2, count))
    medians[0, 1:] = np.nanmedian(before[1:], axis=1)
    medians[1, :-1] = np.nanmedian(after[:-1], axis=1)
    return np.maximum(medians.max(axis=0), _quartile_of_others(values))


def _quartile_of_others(values: Array) -> Array:
    """Upper quartile (linear) of all values except each one.  (P,) -> (P,).  Sorts once instead of P times."""
    order = np.argsort(values, kind="stable")
    ranked = values[order]
    rank = np.empty_like(order)
    rank[order] = np.arange(len(values))
    place = 0.75 * (len(values) - 2)
    low = int(np.floor(place))
    high = min(low + 1, len(values) - 2)
    # Without the value of rank k, place p holds ranked[p] below k and ranked[p + 1] from k on.
    at_low, at_high = ranked[low + (rank <= low)], ranked[high + (rank <= high)]
    return at_low + (place - low) * (at_high - at_low)
