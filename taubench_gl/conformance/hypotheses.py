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
from taubench_gl.conformance import poses
from taubench_gl.conformance.cases import FRAMES
from taubench_gl.conformance.truth import Frame, Hits, Pose, Truth
from taubench_gl.math3d import normalize
from taubench_gl.scene.model import Scene

Array = np.ndarray
EXPLAINED_PX, EXPLAINED_SHARE = 0.02, 0.01
SINGLE_STEPS = 8.0
"""Steps of single precision of a world position that matrices which are not relative to the camera are off by."""


class Pair:
    """One frame of a case and its previous one, for hypotheses.  Vectors and points are (h * w, ...), row by row."""

    def __init__(self, truth: Truth, frame: Frame):
        self.truth, self.frame, self.number = truth, frame, frame.number
        self.right = frame.motion.reshape(-1, 2)
        self.unknown = np.full_like(self.right, np.nan)

    def points(self, number: int, pose: Pose = pose_vertices, hits: Hits | None = None) -> Array:
        """The surface points of the pixels in frame ``number``, (N, 3) world."""
        return self.truth.at(hits or self.frame.hits, self.truth.vertices(number, pose))

    def vectors(
        self, *, previous: View | None = None, now: Array | None = None, before: Array | None = None,
        hits: Hits | None = None,
    ) -> Array:  # fmt: skip
        """Vectors by matrices, with something else in place of what is right.

        ``previous``: the view of the previous frame; ``now``, ``before``: surface points (N, 3); ``hits``: what is
        seen.  Vectors of the sky are by the two views.
        """
        view, previous, hits = self.frame.view, previous or self.frame.previous, hits or self.frame.hits
        now = self.points(self.number, hits=hits) if now is None else now
        before = self.points(self.number - 1, hits=hits) if before is None else before
        moved = self.truth.motion(now, before, view, previous)
        return np.where(hits.triangle[:, None] < 0, self.truth.sky_motion(view, previous), moved)

    def posed(self, then: Pose, now: Pose = pose_vertices) -> Array:
        """Vectors if vertices were posed by ``then`` in the previous frame and by ``now`` in this one."""
        return self.vectors(now=self.points(self.number, now), before=self.points(self.number - 1, then))

    def since(self, frame: int) -> Array:
        """Vectors if ``frame`` were the previous one."""
        return self.vectors(previous=self.truth.view(frame), before=self.points(frame))

    def projected(self, previous: bool, points: Array) -> Array:
        """Places (..., 2) of world points by the matrices of one of the two frames, also behind the camera."""
        view = (self.frame.previous if previous else self.frame.view).centered()
        return self.truth.project(view, points - view.position)

    def of_sky(self, vectors: Array) -> Array:
        """``vectors`` in the sky, else NaN."""
        return np.where(self.frame.hits.triangle[:, None] < 0, vectors, np.nan)


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A mistake.

    ``predict``: the vectors (N, 2) that it writes, NaN where it says nothing; ``slack_px``: more tolerance, (N,).
    """

    key: str
    text: str
    predict: Callable[[Pair], Array]
    slack_px: Callable[[Pair], Array] | None = None

    def explains(self, pair: Pair, at: Array, vectors: Array, step: Array) -> Array:
        """Which of the pixels ``at`` (n,) with ``vectors`` (n, 2) have the predicted one, within ``step`` (n, 2)."""
        predicted = self.predict(pair)[at]
        with np.errstate(invalid="ignore"):
            tolerance = EXPLAINED_PX + EXPLAINED_SHARE * np.linalg.norm(predicted, axis=-1)
            tolerance += np.linalg.norm(step, axis=-1)
            if self.slack_px is not None:
                tolerance += self.slack_px(pair)[at]
            return np.linalg.norm(vectors - predicted, axis=-1) <= tolerance


def _one_projection(pair: Pair) -> Array:
    return pair.vectors(previous=replace(pair.frame.previous, camera=pair.frame.view.camera))


def _current_shape(pair: Pair) -> Array:
    weights = pair.truth.state(pair.number).weights

    def pose(scene: Scene, state: FrameState, *part) -> Array:
        return pose_vertices(scene, replace(state, weights=weights), *part)

    return pair.posed(pose)


def _late(pair: Pair) -> Array:
    return pair.truth.frame(pair.number - 1).motion.reshape(-1, 2) if pair.number > 0 else pair.unknown


def _jittered(sign: float, flip: float) -> Callable[[Pair], Array]:
    def predict(pair: Pair) -> Array:
        offset = pair.truth.jitter_motion(pair.number)
        return pair.right + sign * offset * [1.0, flip] if np.any(offset) else pair.unknown

    return predict


def _rows(flip: float) -> Callable[[Pair], Array]:
    return lambda pair: (pair.frame.motion[::-1] * [1.0, flip]).reshape(-1, 2)


def _half_precision(pair: Pair) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        now, before = (pair.points(n).astype(np.float16).astype(float) for n in (pair.number, pair.number - 1))
        return pair.vectors(now=now, before=before)


def _single_slack(pair: Pair) -> Array:
    """Pixels that ``SINGLE_STEPS`` steps of single precision of the world position are long on the screen, (N,)."""
    frame = pair.frame
    step = np.spacing(np.abs(np.nan_to_num(pair.points(pair.number))).max(axis=-1).astype(np.float32))
    depth = np.maximum(frame.depth.reshape(-1), frame.view.camera.znear)
    focal = 0.5 * pair.truth.size[1] * frame.view.clip_from_view(*pair.truth.size)[1, 1]
    slack = SINGLE_STEPS * step.astype(np.float64) * focal / depth
    return np.where(slack > EXPLAINED_PX, slack, 0.0)


def _without_near_plane(pair: Pair) -> Array:
    return pair.projected(True, pair.points(pair.number - 1)) - pair.projected(False, pair.points(pair.number))


def _divided_at_vertices(pair: Pair) -> Array:
    """Previous places on the screen, divided at the vertices, are interpolated."""
    before = pair.truth.at(pair.frame.hits, pair.projected(True, pair.truth.vertices(pair.number - 1)))
    moved = before - pair.projected(False, pair.points(pair.number))
    return np.where(pair.frame.hits.triangle[:, None] < 0, pair.right, moved)


def _sky_undivided(pair: Pair) -> Array:
    """The previous clip coordinates of the sky, whose current depth is 1, are not divided by their depth."""
    truth, ray = pair.truth, pair.truth.directions(pair.frame.view)
    before = truth.project(pair.frame.previous.centered(), ray, 0.0, divide=False)
    return pair.of_sky(before - truth.project(pair.frame.view.centered(), ray, 0.0))


def _sky_raster_undivided(pair: Pair) -> Array:
    """Unit directions of the sky by matrices to raster coordinates, without a division, as in Cycles 5.2."""
    size, ends = pair.truth.size, []
    for view in (pair.frame.previous, pair.frame.view):
        clip = pair.truth.clip(view.centered(), normalize(pair.truth.directions(pair.frame.view)), 0.0)
        ends.append((clip[:, :2] + clip[:, 2:]) * [0.5 * size[0], -0.5 * size[1]])  # rows count from the bottom
    return pair.of_sky(ends[0] - ends[1])


def _posed(key: str, text: str, then: Pose, now: Pose = pose_vertices) -> Hypothesis:
    return Hypothesis(key, text, lambda pair: pair.posed(then, now))


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
    Hypothesis("camera only", "moving pixels have the camera's motion only",
               lambda pair: pair.vectors(before=pair.points(pair.number))),
    Hypothesis("zero", "no vector is written: zero", lambda pair: np.zeros_like(pair.right)),
    Hypothesis("object only", "the motion of the camera is missing",
               lambda pair: pair.vectors(previous=pair.frame.view)),
    Hypothesis("one projection", "the previous place is made with the current projection matrix", _one_projection),
    *_conventions(),
    _posed("previous bind pose", "the previous pose is the bind pose", poses.skeleton_bind_pose),
    _posed("previous without skin", "the previous position is not skinned", poses.bind_pose),
    _posed("without skin", "vectors are those of the bind pose: neither position is skinned",
           poses.bind_pose, poses.bind_pose),
    _posed("previous base shape", "the previous shape is the base shape", poses.base_shape),
    _posed("without morph", "vectors are those of the base shape in both frames", poses.base_shape, poses.base_shape),
    Hypothesis("current shape", "the previous shape is the current shape: weights of the frame before are not kept",
               _current_shape),
    _posed("identity", "the previous world matrix is the identity", poses.unplaced),
    _posed("transposed skin", "rotations of the previous joint matrices are transposed", poses.transposed_skin),
    _posed("mirror lost", "the negative scale is missing in the previous matrix", poses.unmirrored),
    Hypothesis("late", "vectors are one frame late: the image of the frame before", _late),
    Hypothesis("two frames", "vectors lead two frames back", lambda pair: pair.since(max(pair.number - 2, 0))),
    Hypothesis("next", "vectors lead to the next frame, not to the previous one",
               lambda pair: pair.since(pair.number + 1)),
    Hypothesis("next negated", "vectors are current - next, of the following pair",
               lambda pair: -pair.since(pair.number + 1)),
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
    Hypothesis("alpha ignored", "alpha masks are ignored where vectors are drawn",
               lambda pair: pair.vectors(hits=pair.truth.drawn(pair.number, masked=False))),
    Hypothesis("wrapped time", "the frame before the first is taken from the end of the animation",
               lambda pair: pair.since(FRAMES - 1) if pair.number == 0 else pair.unknown),
    Hypothesis("single precision", "matrices are single precision without being relative to the camera",
               lambda pair: pair.right, _single_slack),
)  # fmt: skip
"""Tried in this order; of several that explain as much the first is named."""
