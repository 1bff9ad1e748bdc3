"""Reprojection of one frame pair (Eq. 3) in float64: previous pixel coordinates of surface points and view rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.conventions import GUARD_PX

Array = np.ndarray

NEAR_GUARD = 1e-5
"""Relative guard of the near test: a still surface clipped at the near plane has depth near * (1 +- rounding)."""


@dataclass(frozen=True, slots=True)
class Reprojection:
    """Matrices of one pair, composed in float64 relative to the cameras (docs/conventions.md).  World axes throughout.

    ``p`` is a point relative to the current camera, ``q`` its previous position relative to the previous camera; for
    static surfaces q = p + ``camera_delta``.  The sky ray of pixel (x, y), y up, is ``sky_origin + x sky_dx +
    y sky_dy``: a direction (w = 0), or for parallel projections a point on the far plane (w = 1).
    """

    width: int
    height: int
    clip_from_current: Array  # (4, 4)
    prev_clip_from_prev: Array  # (4, 4)
    prev_forward: Array  # (3,) unit view direction of the previous camera: dot(q, prev_forward) is planar depth
    prev_near: float  # scene units
    camera_delta: Array  # (3,) current position - previous position, scene units
    sky_origin: Array  # (4,)
    sky_dx: Array  # (4,)
    sky_dy: Array  # (4,)
    near: float = 0.0  # of the current camera, scene units


@dataclass(frozen=True, slots=True)
class Reprojected:
    """Where every pixel (h, w), row 0 at the top, was in the previous frame."""

    motion_px: Array  # (h, w, 2) previous - current, +x right, +y DOWN; NaN where behind
    at_px: Array  # (h, w, 2) previous pixel-index coordinates (x, row)
    behind: Array  # (h, w) bool
    outside: Array  # (h, w) bool, False where behind
    q: Array  # (h, w, 3) previous position relative to the previous camera (a direction for sky)


def reproject(
    pair: Reprojection, position: Array, prev_position: Array | None = None, vectors: Array | None = None
) -> Reprojected:
    """Eq. (3) for every pixel.

    ``position`` (h, w, 4): xyz relative to the current camera, w planar depth, 0 = sky.  With ``prev_position``
    (h, w, >=3), relative to the previous camera: ``motion`` reprojection; without it ``camera`` reprojection.
    ``vectors`` (h, w, 2): stored motion in pixels, +y down, which ``motion`` then takes; NaN: none, the sky then
    follows the camera.
    """
    h, w = pair.height, pair.width
    surface = position[..., 3] > 0
    x, y = np.meshgrid(np.arange(w, dtype=np.float64), np.arange(h - 1, -1, -1, dtype=np.float64))
    sky = pair.sky_origin + x[..., None] * pair.sky_dx + y[..., None] * pair.sky_dy
    p = np.where(surface[..., None], position[..., :3], sky[..., :3])
    p_w = np.where(surface, 1.0, sky[..., 3])
    q = p + p_w[..., None] * pair.camera_delta
    if prev_position is not None:
        q = np.where(surface[..., None], prev_position[..., :3], q)
    # Interpolation over a large triangle can round by more than NEAR_GUARD and place a pixel in front of the current
    # near plane.  The previous near test allows the same distance.
    slack = np.maximum(pair.near - position[..., 3], 0.0)
    near = np.where(surface, pair.prev_near * (1.0 - NEAR_GUARD) - slack, 0.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        behind = q @ pair.prev_forward <= near  # before any division
        ndc = _ndc(pair.clip_from_current, p, p_w)
        prev_ndc = _ndc(pair.prev_clip_from_prev, q, p_w)
        motion_up = (prev_ndc - ndc) * 0.5 * np.array([w, h], dtype=np.float64)
    if vectors is not None and prev_position is not None:
        stored = surface | np.isfinite(vectors).all(axis=-1)
        motion_up = np.where(stored[..., None], vectors * np.array([1.0, -1.0]), motion_up)
    motion_up[behind] = np.nan
    at_x, at_y = x + motion_up[..., 0], y + motion_up[..., 1]
    with np.errstate(invalid="ignore"):
        outside = (at_x < -GUARD_PX) | (at_y < -GUARD_PX) | (at_x > w - 1 + GUARD_PX) | (at_y > h - 1 + GUARD_PX)
    motion = motion_up * np.array([1.0, -1.0])
    return Reprojected(motion, np.stack([at_x, (h - 1) - at_y], axis=-1), behind, outside & ~behind, q)


def _ndc(clip_from_relative: Array, p: Array, p_w: Array) -> Array:
    rows = clip_from_relative[[0, 1, 3]]
    clip = p @ rows[:, :3].T + p_w[..., None] * rows[:, 3]
    return clip[..., :2] / clip[..., 2:]
