"""Matrices that reproject one view to another."""

from __future__ import annotations

import numpy as np

from taubench_gl.animation.state import View
from taubench_gl.metrics.reprojection import Reprojection


def sky_directions(view: View, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """View direction of pixel (0, 0) of ``view``, and its steps per pixel to the right and up: world axes, (3,) each.

    Not normalized; includes the jitter.  Parallel projections look the same way in every pixel.
    """
    if view.camera.kind != "perspective":
        return -view.world_from_view[:, 2], np.zeros(3), np.zeros(3)
    pair = reprojection(view, view, width, height)
    return pair.sky_origin[:3], pair.sky_dx[:3], pair.sky_dy[:3]


def reprojection(view: View, previous: View, width: int, height: int, *, jitter: bool = True) -> Reprojection:
    """Matrices of the pair (previous, view), float64, relative to the two cameras (docs/conventions.md).

    Sky rays include the jitter of the current view.  ``jitter``: whether the clip matrices include it too, so that
    pixel i reprojects to the sample positions of the previous frame.  Without it motion is that of the surface, and a
    still surface has exactly zero motion for any jitter.
    """
    clip_from_view = view.clip_from_view(width, height)
    perspective = view.camera.kind == "perspective"
    # The view ray of pixel (x, y) meets the plane z = -1 (for parallel projections the far plane) at ndc * extent.
    half_x, half_y = 1.0 / clip_from_view[0, 0], 1.0 / clip_from_view[1, 1]
    step_x, step_y = 2.0 * half_x / width, 2.0 * half_y / height
    depth = 1.0 if perspective else view.camera.zfar
    first_x, first_y = view.offset_px
    corner = np.array([view.shift - half_x + (0.5 + first_x) * step_x, -half_y + (0.5 + first_y) * step_y, -depth])
    now, then = (view, previous) if jitter else (view.centered(), previous.centered())
    w = 0.0 if perspective else 1.0
    rotate = view.world_from_view
    return Reprojection(
        width=width,
        height=height,
        clip_from_current=now.clip_from_relative(width, height),
        prev_clip_from_prev=then.clip_from_relative(width, height),
        prev_forward=-previous.world_from_view[:, 2],
        prev_near=previous.camera.znear,
        camera_delta=view.position - previous.position,
        sky_origin=np.append(rotate @ corner, w),
        sky_dx=np.append(rotate[:, 0] * step_x, 0.0),
        sky_dy=np.append(rotate[:, 1] * step_y, 0.0),
        near=view.camera.znear,
    )
