"""Previous surface points of path-traced frames, from their motion pass or from a rasterized scene.

A motion pass has two of three coordinates: where in the previous image a surface point was, but not how far away.
"""

from __future__ import annotations

import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.pathtraced.cameras import project

Array = np.ndarray

STILL_PX = 0.1
"""Motion within this distance of the camera's counts as that of a still surface: passes are means over a pixel."""


def still_position(position: Array, view: View, previous: View) -> Array:
    """Points (h, w, >= 3) relative to the camera of ``view``, relative to the previous camera: nothing moves."""
    return position[..., :3].astype(np.float64) + (view.position - previous.position)


def position_from_motion(position: Array, motion: Array, view: View, previous: View) -> Array:
    """Where the surface points of a frame were in the previous frame, relative to its camera, (h, w, 3) float64.

    ``position`` (h, w, 4) relative to the camera of ``view``; ``motion`` (h, w, 2) pixels, previous - current, +y down.
    Where the motion is the camera's the surface is still.  Elsewhere the point is the one on the previous view ray at
    ``motion`` that is nearest to the current point: of all points with that motion, it moved the least.
    """
    height, width = position.shape[:2]
    still = still_position(position, view, previous)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        at = project(view, position[..., :3], (width, height), relative=True) + motion
        differs = np.linalg.norm(at - project(previous, still, (width, height), relative=True), axis=-1)
        pair = reprojection(previous, previous, width, height, jitter=False)
        x, y = at[..., :1], height - 1 - at[..., 1:]
        ray = pair.sky_origin + x * pair.sky_dx + y * pair.sky_dy
        if previous.camera.parallel:
            direction, start = -previous.world_from_view[:, 2], ray[..., :3]
        else:
            direction, start = ray[..., :3], np.zeros(3)
        along = ((still - start) * direction).sum(-1) / (direction * direction).sum(-1)
        moved = start + along[..., None] * direction
        return np.where((differs <= STILL_PX)[..., None], still, moved)


def position_from_scene(
    position: Array, rasterized: Array, rasterized_previous: Array, view: View, previous: View, tolerance: float
) -> Array:
    """Where the surface points of a frame were, as ``position_from_motion``, but by the motion of the rasterized scene.

    ``rasterized`` (h, w, 4) and ``rasterized_previous`` (h, w, >= 3): its positions and previous positions.  The
    surface's displacement is added to the point of the path-traced frame.  Where the two renderers see points that are
    more than ``tolerance`` apart (at edges), the surface counts as still.
    """
    offset = view.position - previous.position
    displacement = rasterized_previous[..., :3].astype(np.float64) - (rasterized[..., :3].astype(np.float64) + offset)
    with np.errstate(invalid="ignore"):
        distances = np.linalg.norm(position[..., :3].astype(np.float64) - rasterized[..., :3], axis=-1)
        same = (rasterized[..., 3] > 0) & (distances <= tolerance)
    return still_position(position, view, previous) + np.where(same[..., None], displacement, 0.0)
