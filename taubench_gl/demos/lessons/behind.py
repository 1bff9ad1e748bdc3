"""Demo 3: division by a negative w projects points behind the camera into the image."""

from __future__ import annotations

import dataclasses

import numpy as np

from taubench_gl import math3d
from taubench_gl.conventions import Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens, percent
from taubench_gl.demos.sheet import checkerboard
from taubench_gl.demos.stage import BRICK, LEAF, SEA, Props, Stage, built, hall
from taubench_gl.metrics.reprojection import Reprojected, reproject
from taubench_gl.scene.builder import IDENTITY, turn_y
from taubench_gl.selftest.bench import PairImages, pixel_grid

YFOV = np.radians(60.0)


@built
def scene(b: Props) -> None:
    """The hall with objects in front of and behind the camera, which turns by 180 degrees in one second."""
    hall(b)
    for z, colors in ((-3.4, (LEAF, SEA)), (4.4, (BRICK, SEA))):
        b.block((0.35, 0.9, 0.35), colors[0], translation=(-1.0, -0.6, z))
        b.ball(0.4, colors[1], translation=(1.0, -1.1, z))
    camera = b.camera(yfov=YFOV, znear=0.05)
    b.animate(camera, "rotation", [0.0, 1.0], [IDENTITY, turn_y(180.0)])


def reprojected(image: Array, motion: Array, reused: Array) -> Array:
    """The previous ``image`` (h, w, 3) sampled along ``motion``, nearest pixel; NaN outside ``reused``.

    ``motion`` (h, w, 2): previous - current, pixels, +y down; ``reused`` (h, w) bool -> (h, w, 3).
    """
    height, width = reused.shape
    target = pixel_grid((width, height)) + np.where(reused[..., None], motion, 0.0)  # NaN where w is 0
    at = np.floor(target + 0.5).astype(int)
    column, row = np.clip(at[..., 0], 0, width - 1), np.clip(at[..., 1], 0, height - 1)
    return np.where(reused[..., None], image[row, column], np.nan)


def without_the_test(images: PairImages) -> Reprojected:
    """The pair by the float64 reference, with a near plane at minus infinity: no w is rejected."""
    pair = dataclasses.replace(images.pair, prev_near=-np.inf)
    return reproject(pair, images.current["position"].astype(np.float64))


def run(stage: Stage, lesson: Lesson) -> Measured:
    """History of a turn by 180 degrees, with and without the test of w."""
    lit, sheet = lesson.pair, lesson.sheet
    naive = without_the_test(stage.bench.pair(scene()))
    reused_naive, reused = ~(naive.behind | naive.outside), ~lit.has(Reason.BEHIND | Reason.OUTSIDE)
    last = lit.before["color"][..., :3]
    sheet.panel(0, 0, last, "previous frame")
    sheet.panel(1, 0, lit.now["color"][..., :3], "current frame: the camera turned by 180°")
    false = reprojected(last, naive.motion_px, reused_naive)
    text = f"{100 * reused_naive.mean():.1f} % reused, all wrong"
    untested = checkerboard(np.nan_to_num(false), ~reused_naive, stage.cell)
    sheet.panel(0, 1, untested, "history without the test of w", text)
    real = reprojected(last, lit.motion, reused)
    text = f"{100 * reused.mean():.1f} % reused, {lit.percent(Reason.BEHIND):.1f} % behind camera"
    sheet.panel(1, 1, checkerboard(np.nan_to_num(real), ~reused, stage.cell), "history with the test of w: none", text)
    mirror = pixel_grid(stage.size)[::-1]  # row r reads row h - 1 - r of its own column
    error = np.abs(pixel_grid(stage.size) + naive.motion_px - mirror)[reused_naive].max()
    numbers = {
        "wrongly_reused": (percent(reused_naive), Expected.near(100.0, 0.0)),
        "reused": (percent(reused), Expected.near(0.0, 0.0)),
        "mirror_error": (float(error), Expected.between(0.0, 0.01, 3)),
    }

    def at(angle: float) -> tuple[Array, float, float, float]:
        """After a turn by ``angle`` degrees: history without the test."""
        pair = stage.bench.pair(scene(), (0.0, angle / 180.0))
        naive = without_the_test(pair)
        reused = ~(naive.behind | naive.outside)
        false = reused & reproject(pair.pair, pair.current["position"].astype(np.float64)).behind
        history = np.nan_to_num(reprojected(last, naive.motion_px, reused))
        # The directions d whose opposite -d the previous camera saw.
        outside, slack = theory.frustum_share(-math3d.mat3_from_quat(turn_y(angle)), YFOV, stage.size)
        return checkerboard(history, ~reused, stage.cell), percent(false), 100.0 - outside, 2.0 * slack

    return Measured(numbers, lesson.swept(at), Screens(untested))
