"""The motion that the frames of a scene file have: what vectors of another program are compared with."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from taubench_gl.conventions import ABSENT, NO_HISTORY
from taubench_gl.effects.lighting import as_rendered
from taubench_gl.evaluation.owner import opened_gpu
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.pathtraced.cameras import SceneCamera, project
from taubench_gl.pathtraced.check_files import SceneTruth
from taubench_gl.settings import Settings

Array = np.ndarray

OUTLINE = 0.02
"""Difference of depth, relative, from the mean of two opposite neighbors from which on a pixel lies at an outline."""


def render_truth(camera: SceneCamera, settings: Settings, numbers: Collection[int]) -> dict[int, SceneTruth]:
    """Rasterize the scene at the times of files ``numbers``, from its camera.  Raises GraphicsError.

    Pixels at outlines have no truth (the sample of another program may show the other surface), and neither have
    surfaces that are not there in the frame before.
    """
    settings = as_rendered(settings).replace(columns=("frustum",), reprojection="motion", textures="finest")
    size, truth = (settings.sequence.width, settings.sequence.height), {}
    with opened_gpu(settings) as owner:
        animated = AnimatedScene(camera.scene, camera.track, fps=settings.sequence.fps)
        source = owner.open_source(animated, settings, extra=("position", "prev_position", "ids"))
        source.renderer.marks_absent = True
        for number in sorted(numbers):
            frame = number + camera.offset
            view, before = source.advance(frame), animated.view_at((frame - 1) / settings.sequence.fps)
            planes = source.read("position").astype(np.float64)
            shown = (planes[..., 3] > 0) & ~_outline(planes[..., 3])
            position = np.where(shown[..., None], planes[..., :3], np.nan)
            still = position + (view.position - before.position)
            previous = source.read("prev_position") if "prev_position" in source.channels else still
            absent = source.read("ids")[..., 1].astype(np.uint32) & np.uint32(NO_HISTORY | ABSENT) != 0
            previous = np.where(absent[..., None], np.nan, previous[..., :3])
            now = project(view, position.reshape(-1, 3), size, relative=True)
            motion, still = ((project(before, there.reshape(-1, 3), size, relative=True) - now).reshape(*shown.shape, 2)
                             for there in (previous, still))  # fmt: skip
            truth[number] = SceneTruth(position, motion, still, planes[..., 3] <= 0)
    return truth


def _outline(depth: Array) -> Array:
    """Pixels beside which depth, (h, w) with 0 for none, bends by more than OUTLINE or ends: (h, w) bool."""
    depth = np.pad(np.where(depth > 0, depth, np.inf), 1, mode="reflect")
    middle, out = depth[1:-1, 1:-1], False
    for step in ((1, 0), (0, 1), (1, 1), (1, -1)):
        one, other = (np.roll(depth, (sign * step[0], sign * step[1]), (0, 1))[1:-1, 1:-1] for sign in (1, -1))
        with np.errstate(invalid="ignore"):
            out |= ~(np.abs(0.5 * (one + other) - middle) <= OUTLINE * middle)
    return out
