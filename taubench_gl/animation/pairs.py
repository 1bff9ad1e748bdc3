"""From two views to the matrices of their reprojection."""

from __future__ import annotations

import numpy as np

from taubench_gl.animation.state import View
from taubench_gl.metrics.reprojection import Reprojection


def reprojection(view: View, previous: View, width: int, height: int) -> Reprojection:
    """Matrices of the pair (previous, view), float64, relative to the two cameras (SPEC section 3)."""
    clip_from_view = view.clip_from_view(width, height)
    perspective = view.camera.kind == "perspective"
    # The view ray of pixel (x, y) crosses the plane z = -1 (or, parallel, the far plane) at ndc * extent.
    half_x, half_y = 1.0 / clip_from_view[0, 0], 1.0 / clip_from_view[1, 1]
    step_x, step_y = 2.0 * half_x / width, 2.0 * half_y / height
    depth = 1.0 if perspective else view.camera.zfar
    corner = np.array([-half_x + 0.5 * step_x, -half_y + 0.5 * step_y, -depth])
    w = 0.0 if perspective else 1.0
    rotate = view.world_from_view
    return Reprojection(
        width=width,
        height=height,
        clip_from_current=view.clip_from_relative(width, height),
        prev_clip_from_prev=previous.clip_from_relative(width, height),
        prev_forward=-previous.world_from_view[:, 2],
        prev_near=previous.camera.znear,
        camera_delta=view.position - previous.position,
        sky_origin=np.append(rotate @ corner, w),
        sky_dx=np.append(rotate[:, 0] * step_x, 0.0),
        sky_dy=np.append(rotate[:, 1] * step_y, 0.0),
        near=view.camera.znear,
    )
