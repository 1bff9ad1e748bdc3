"""Known mistakes of motion vectors: what each would write, so that wrong vectors get a cause in words.

A hypothesis predicts the vectors of one frame.  It explains a pixel whose vector is the predicted one, within
``EXPLAINED_PX`` and 1 % of its length, which is narrower than the tolerance of right vectors.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from taubench_gl.animation import FrameState, View, pose_vertices
from taubench_gl.conformance.poses import (
    base_shape,
    bind_pose,
    skeleton_bind_pose,
    transposed_skin,
    unmirrored,
    unplaced,
)
from taubench_gl.conformance.stage import FRAMES
from taubench_gl.conformance.truth import Frame, Hits, Pose, Truth
from taubench_gl.math3d import normalize
from taubench_gl.scene.model import Scene

Array = np.ndarray
EXPLAINED_PX, EXPLAINED_SHARE = 0.02, 0.01
SINGLE_STEPS = 8.0
"""Steps of single precision of a world position that matrices which are not relative to the camera are off by."""


@dataclass(frozen=True, slots=True)
class Pair:
    """One frame of a case and its previous one, for hypotheses.  Vectors and points are (h * w, ...), row by row."""

    truth: Truth
    frame: Frame

    @property
    def right(self) -> Array:
        """The right vectors, (N, 2)."""
        return self.frame.motion.reshape(-1, 2)

    @property
    def sky(self) -> Array:
        return self.frame.hits.triangle < 0

    def points(self, number: int, pose: Pose = pose_vertices, hits: Hits | None = None) -> Array:
        """The surface points of the pixels in frame ``number``, (N, 3) world."""
        return self.truth.at(hits or self.frame.hits, self.truth.vertices(number, pose))

    def between(self, view: View, previous: View, points: Array, before: Array) -> Array:
        """Vectors of surface points that were at ``before``; those of the sky by the two views."""
        out = self.truth.motion(points, before, view, previous)
        if view.camera.kind == "perspective":
            out[self.sky] = self.truth.sky_motion(view, previous)[self.sky]
        return out

    def posed(self, now: Pose, then: Pose) -> Array:
        """Vectors if vertices were posed by ``now`` in this frame and by ``then`` in the previous one."""
        k, frame = self.frame.number, self.frame
        moved = self.truth.motion(self.points(k, now), self.points(k - 1, then), frame.view, frame.previous)
        return np.where(self.sky[:, None], self.right, moved)

    def since(self, frame: int) -> Array:
        """Vectors if ``frame`` were the previous one."""
        k = self.frame.number
        return self.between(self.frame.view, self.truth.view(frame), self.points(k), self.points(frame))


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A mistake.

    ``predict``: the vectors (N, 2) that it writes, NaN where it says nothing; ``slack_px``: more tolerance, (N,).
    """

    key: str
    text: str
    predict: Callable[[Pair], Array]
    slack_px: Callable[[Pair], Array] | None = None

    def explains(self, pair: Pair, vectors: Array, step: Array | float) -> Array:
        """Pixels (N,) whose vector (N, 2) is the predicted one."""
        predicted = self.predict(pair)
        with np.errstate(invalid="ignore"):
            tolerance = EXPLAINED_PX + EXPLAINED_SHARE * np.linalg.norm(predicted, axis=-1)
            tolerance = tolerance + np.linalg.norm(np.broadcast_to(step, vectors.shape), axis=-1)
            if self.slack_px is not None:
                tolerance = tolerance + self.slack_px(pair)
            return np.linalg.norm(vectors - predicted, axis=-1) <= tolerance


def _camera_only(pair: Pair) -> Array:
    points = pair.points(pair.frame.number)
    return pair.between(pair.frame.view, pair.frame.previous, points, points)


def _object_only(pair: Pair) -> Array:
    now = pair.frame.view
    return pair.between(now, now, pair.points(pair.frame.number), pair.points(pair.frame.number - 1))


def _one_projection(pair: Pair) -> Array:
    now, k = pair.frame.view, pair.frame.number
    return pair.between(now, replace(pair.frame.previous, camera=now.camera), pair.points(k), pair.points(k - 1))


def _current_shape(pair: Pair) -> Array:
    k, truth = pair.frame.number, pair.truth
    weights = truth.state(k).weights

    def pose(scene: Scene, state: FrameState, *part) -> Array:
        return pose_vertices(scene, replace(state, weights=weights), *part)

    return pair.posed(pose_vertices, pose)


def _to_next(pair: Pair) -> Array:
    k = pair.frame.number
    return pair.between(pair.frame.view, pair.truth.view(k + 1), pair.points(k), pair.points(k + 1))


def _late(pair: Pair) -> Array:
    k = pair.frame.number
    return pair.truth.frame(k - 1).motion.reshape(-1, 2) if k > 0 else np.full_like(pair.right, np.nan)


def _wrapped(pair: Pair) -> Array:
    return pair.since(FRAMES - 1) if pair.frame.number == 0 else np.full_like(pair.right, np.nan)


def _jittered(sign: float, flip: float) -> Callable[[Pair], Array]:
    def predict(pair: Pair) -> Array:
        offset = pair.truth.jitter_motion(pair.frame.number)
        return pair.right + sign * offset * [1.0, flip] if np.any(offset) else np.full_like(pair.right, np.nan)

    return predict


def _rows(flip: float) -> Callable[[Pair], Array]:
    return lambda pair: (pair.frame.motion[::-1] * [1.0, flip]).reshape(-1, 2)


def _half_precision(pair: Pair) -> Array:
    k, frame = pair.frame.number, pair.frame
    with np.errstate(over="ignore", invalid="ignore"):
        now, then = (pair.points(number).astype(np.float16).astype(float) for number in (k, k - 1))
        return pair.between(frame.view, frame.previous, now, then)


def _single_slack(pair: Pair) -> Array:
    """Pixels that ``SINGLE_STEPS`` steps of single precision of the world position are long on the screen, (N,)."""
    frame = pair.frame
    points = np.nan_to_num(pair.points(frame.number))
    step = np.spacing(np.abs(points).max(axis=-1).astype(np.float32)).astype(np.float64)
    depth = np.maximum(frame.depth.reshape(-1), frame.view.camera.znear)
    focal = 0.5 * pair.truth.size[1] * frame.view.clip_from_view(*pair.truth.size)[1, 1]
    slack = SINGLE_STEPS * step * focal / depth
    return np.where(slack > EXPLAINED_PX, slack, 0.0)


def _without_near_plane(pair: Pair) -> Array:
    k, then = pair.frame.number, pair.frame.previous.centered()
    now = pair.frame.view.centered()
    points, before = pair.points(k), pair.points(k - 1)
    truth = pair.truth
    return truth.project(then, before - then.position) - truth.project(now, points - now.position)


def _divided_at_vertices(pair: Pair) -> Array:
    """Previous places on the screen, divided at the vertices, are interpolated."""
    k, truth, then = pair.frame.number, pair.truth, pair.frame.previous.centered()
    before = truth.at(pair.frame.hits, truth.project(then, truth.vertices(k - 1) - then.position))
    now = pair.frame.view.centered()
    out = before - truth.project(now, pair.points(k) - now.position)
    return np.where(pair.sky[:, None], pair.right, out)


def _sky_undivided(pair: Pair) -> Array:
    """The previous clip coordinates of the sky, whose current depth is 1, are not divided by their depth."""
    out = np.full_like(pair.right, np.nan)
    now, then = pair.frame.view.centered(), pair.frame.previous.centered()
    if now.camera.kind == "perspective":
        ray = pair.truth.directions(pair.frame.view)
        moved = pair.truth.project(then, ray, 0.0, divide=False) - pair.truth.project(now, ray, 0.0)
        out[pair.sky] = moved[pair.sky]
    return out


def _sky_raster_undivided(pair: Pair) -> Array:
    """Unit directions of the sky by matrices to raster coordinates, without a division, as in Cycles 5.2."""
    out = np.full_like(pair.right, np.nan)
    if pair.frame.view.camera.kind == "perspective":
        width, height = pair.truth.size
        ray = normalize(pair.truth.directions(pair.frame.view))
        ends = []
        for view in (pair.frame.previous, pair.frame.view):
            clip = ray @ view.centered().clip_from_relative(width, height)[[0, 1, 3], :3].T
            ends.append((clip[:, :2] + clip[:, 2:]) * [0.5 * width, -0.5 * height])  # rows count from the bottom
        out[pair.sky] = (ends[0] - ends[1])[pair.sky]
    return out


def _unmasked(pair: Pair) -> Array:
    hits = pair.truth.drawn(pair.frame.number, masked=False)
    points, before = (pair.points(n, hits=hits) for n in (pair.frame.number, pair.frame.number - 1))
    moved = pair.truth.motion(points, before, pair.frame.view, pair.frame.previous)
    return np.where((hits.triangle < 0)[:, None], pair.right, moved)


def _conventions() -> list[Hypothesis]:
    """Right vectors in another unit, with another sign or order of components."""
    scales = {
        "": ("", lambda size: 1.0),
        "twice": ("vectors are twice as long", lambda size: 2.0),
        "half": ("vectors are half as long, as of half the rate", lambda size: 0.5),
        "ndc": ("vectors are in normalized device coordinates, not pixels", lambda size: 2.0 / np.array(size)),
        "uv": ("vectors are in shares of the image, not pixels", lambda size: 1.0 / np.array(size)),
    }
    signs = {
        "": ("", (1, 1)), "negated": ("the sign of vectors is wrong", (-1, -1)),
        "y negated": ("the sign of y is wrong", (1, -1)), "x negated": ("the sign of x is wrong", (-1, 1)),
    }  # fmt: skip
    out = []
    for (scale, (text, factor)), (sign, (signed, by)) in itertools.product(scales.items(), signs.items()):
        if scale or sign:
            key, words = " ".join(filter(None, (scale, sign))), ", and ".join(filter(None, (text, signed)))
            out.append(Hypothesis(key, words, lambda pair, f=factor, s=by: pair.right * f(pair.truth.size) * s))
    out.append(Hypothesis("swapped", "x and y of the vectors are swapped", lambda pair: pair.right[:, ::-1]))
    return out


HYPOTHESES: tuple[Hypothesis, ...] = (
    Hypothesis("rounding", "what stands still has tiny vectors by rounding, not zero",
               lambda pair: np.where(pair.frame.exact.reshape(-1, 1), [0.0, 0.0], np.nan)),
    Hypothesis("camera only", "moving pixels have the camera's motion only", _camera_only),
    Hypothesis("zero", "no vector is written: zero", lambda pair: np.zeros_like(pair.right)),
    Hypothesis("object only", "the motion of the camera is missing", _object_only),
    Hypothesis("one projection", "the previous place is made with the current projection matrix", _one_projection),
    *_conventions(),
    Hypothesis("previous bind pose", "the previous pose is the bind pose",
               lambda pair: pair.posed(pose_vertices, skeleton_bind_pose)),
    Hypothesis("previous without skin", "the previous position is not skinned",
               lambda pair: pair.posed(pose_vertices, bind_pose)),
    Hypothesis("without skin", "vectors are those of the bind pose: neither position is skinned",
               lambda pair: pair.posed(bind_pose, bind_pose)),
    Hypothesis("previous base shape", "the previous shape is the base shape",
               lambda pair: pair.posed(pose_vertices, base_shape)),
    Hypothesis("without morph", "vectors are those of the base shape in both frames",
               lambda pair: pair.posed(base_shape, base_shape)),
    Hypothesis("current shape", "the previous shape is the current shape: weights of the frame before are not kept",
               _current_shape),
    Hypothesis("identity", "the previous world matrix is the identity",
               lambda pair: pair.posed(pose_vertices, unplaced)),
    Hypothesis("transposed skin", "rotations of the previous joint matrices are transposed",
               lambda pair: pair.posed(pose_vertices, transposed_skin)),
    Hypothesis("mirror lost", "the negative scale is missing in the previous matrix",
               lambda pair: pair.posed(pose_vertices, unmirrored)),
    Hypothesis("late", "vectors are one frame late: the image of the frame before", _late),
    Hypothesis("two frames", "vectors lead two frames back", lambda pair: pair.since(max(pair.frame.number - 2, 0))),
    Hypothesis("next", "vectors lead to the next frame, not to the previous one", _to_next),
    Hypothesis("next negated", "vectors are current - next, of the following pair", lambda pair: -_to_next(pair)),
    *(Hypothesis("jitter", "the jitter is left in", _jittered(1.0, flip)) for flip in (1.0, -1.0)),
    *(Hypothesis("no jitter", "vectors lack the jitter that the mapping takes out", _jittered(-1.0, flip))
      for flip in (1.0, -1.0)),
    Hypothesis("rows", "the first row of the vectors is the bottom one", _rows(1.0)),
    Hypothesis("rows and y", "the first row of the vectors is the bottom one, and y has the wrong sign", _rows(-1.0)),
    Hypothesis("half precision", "world positions are rounded to half precision", _half_precision),
    Hypothesis("near plane", "points behind the camera are divided by their depth", _without_near_plane),
    Hypothesis("divided at vertices", "previous places are divided at the vertices and then interpolated",
               _divided_at_vertices),
    Hypothesis("sky undivided", "the previous direction of the sky is not divided by its depth", _sky_undivided),
    Hypothesis("sky raster", "raster coordinates of the sky are not divided by the depth", _sky_raster_undivided),
    Hypothesis("alpha ignored", "alpha masks are ignored where vectors are drawn", _unmasked),
    Hypothesis("wrapped time", "the frame before the first is taken from the end of the animation", _wrapped),
    Hypothesis("single precision", "matrices are single precision without being relative to the camera",
               lambda pair: pair.right, _single_slack),
)  # fmt: skip
"""Tried in this order; of several that explain as much the first is named."""
