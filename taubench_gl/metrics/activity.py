"""Camera activity: Eqs. (1) and (2) of section 3.1, by the conventions of conventions.py.  Float64 throughout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taubench_gl import math3d

Array = np.ndarray

GIMBAL_ZONE = np.radians(1.0)
"""Radians from straight up or down within which yaw and roll can no longer be told apart (the pair is flagged)."""

PASSING = np.radians(45.0)
"""A camera that turns by less than this between two frames, over the pole, has passed through the gimbal zone even if
neither frame lies in it.  A larger turn has no definite way, so it is taken as the two frames' angles say."""

QUANTITIES = ("position", "yaw", "pitch", "roll", "angle")


@dataclass(frozen=True, slots=True)
class Activity:
    """Change of a camera per pair (i-1, i).  All arrays are (P,) with P = N - 1 pairs of N frames, or 0."""

    position: Array  # Eq. (1), in the unit of the positions
    yaw: Array  # Eq. (2) about world +Y, degrees in [0, 180]
    pitch: Array  # Eq. (2) about local X, degrees in [0, 180]
    roll: Array  # Eq. (2) about local Z, degrees in [0, 180]
    angle: Array  # geodesic, degrees in [0, 180]
    gimbal: Array  # bool: yaw and roll of this pair rest on the gimbal rule

    def __len__(self) -> int:
        return len(self.position)

    def in_metres(self, unit_scale: float) -> Activity:
        """The same with ``position`` in metres; ``unit_scale``: units of the positions per metre."""
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
    scale = np.where(peak > 0, peak, 1.0)  # a step of 1e-170 m must not square to 0
    return scale[:, 0] * np.linalg.norm(step / scale, axis=-1)


def wrap_degrees(difference: Array) -> Array:
    """Differences of angles to (-180, 180].  Small ones come back bit for bit: no precision is spent on them."""
    difference = np.asarray(difference, dtype=np.float64)
    wrapped = difference - 360.0 * np.round(difference / 360.0)
    return np.where(wrapped <= -180.0, wrapped + 360.0, wrapped)


def euler_yxz(rotation: Array) -> Array:
    """Intrinsic Y-X-Z angles of R = Ry(yaw) Rx(pitch) Rz(roll), pitch in [-90, 90].  (..., 3, 3) -> (..., 3) radians.

    Straight up or down, where only one of yaw and roll is defined, roll is 0.
    """
    r = rotation
    level = np.hypot(r[..., 0, 2], r[..., 2, 2])  # cos(pitch); atan2 keeps digits where asin would lose them
    pitch = np.arctan2(-r[..., 1, 2], level)
    locked = level < 1e-9
    yaw = np.where(locked, np.arctan2(-r[..., 2, 0], r[..., 0, 0]), np.arctan2(r[..., 0, 2], r[..., 2, 2]))
    roll = np.where(locked, 0.0, np.arctan2(r[..., 1, 0], r[..., 1, 1]))
    return np.stack([yaw, pitch, roll], axis=-1)


def euler_changes(rotation: Array) -> tuple[Array, Array]:
    """Eq. (2) before the absolute value.  (N, 3, 3) -> signed degrees (N-1, 3) in yaw, pitch, roll; flags (N-1,).

    One orientation has two triples of angles: (yaw, pitch, roll) and (yaw + 180, 180 - pitch, roll + 180).  Away from
    the poles the first of both frames is compared.  A pair with a frame in the gimbal zone, or that passes over a
    pole, is flagged and follows the previous frame: in the zone roll is held and yaw and pitch are what the rest of
    the rotation says (pitch runs on past 90); outside it, the triple nearer to the previous frame's is taken.
    """
    angles = euler_yxz(rotation)
    change = wrap_degrees(np.degrees(np.diff(angles, axis=0)))
    zone = np.abs(angles[:, 1]) > 0.5 * np.pi - GIMBAL_ZONE
    gimbal = zone[:-1] | zone[1:] | _passes_pole(rotation)
    follow, frame = angles[0], -1  # the triple the previous flagged pair arrived at, and its frame
    for pair in np.flatnonzero(gimbal):
        before = angles[pair]
        if frame == pair:
            before = follow
        elif zone[pair]:  # the same formula on both sides, so that its rounding cancels
            before = _held(rotation[pair], before[2])
        if np.array_equal(rotation[pair], rotation[pair + 1]):
            follow = before  # a still camera turns by exactly 0, at the pole too
        elif zone[pair + 1]:
            follow = _held(rotation[pair + 1], before[2])
        else:
            follow = _nearest(angles[pair + 1], before)
        change[pair] = wrap_degrees(np.degrees(follow - before))
        frame = pair + 1
    return change, gimbal


def _held(rotation: Array, roll: float) -> Array:
    """Yaw and pitch in (-180, 180] of a rotation whose roll is known.  (3, 3) -> (3,) radians."""
    c, s = np.cos(roll), np.sin(roll)
    x = c * rotation[:, 0] - s * rotation[:, 1]  # the columns of R Rz(roll)^-1 = Ry(yaw) Rx(pitch)
    y = s * rotation[:, 0] + c * rotation[:, 1]
    return np.array([np.arctan2(-x[2], x[0]), np.arctan2(-rotation[1, 2], y[1]), roll])


def _nearest(angles: Array, before: Array) -> Array:
    """Of the two triples of one orientation the one with the smaller total change.  (3,), (3,) -> (3,) radians."""
    other = np.array([angles[0] + np.pi, np.pi - angles[1], angles[2] + np.pi])
    costs = [np.abs(wrap_degrees(np.degrees(triple - before))).sum() for triple in (angles, other)]
    return other if costs[1] < costs[0] else angles


def _passes_pole(rotation: Array) -> Array:
    """Does the view direction's short arc between frames pass the gimbal zone?  (N, 3, 3) -> (N-1,) bool."""
    forward = -rotation[:, :, 2]
    a, b = forward[:-1], forward[1:]
    normal = np.cross(a, b)
    sine = np.linalg.norm(normal, axis=-1)
    turns_back = a[:, 0] * b[:, 0] + a[:, 2] * b[:, 2] < 0  # the pole lies between them, not beyond either
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

    ``cuts`` (P,) bool per pair, as ``metrics.cuts.detect_cuts`` gives; None: no pair is a cut.  ``first_frame`` is the
    number of the path's first frame.  ``cuts`` and ``gimbal_pairs`` of the result name a pair by its second frame.
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
