"""Demo 3: a point behind the camera divides by a negative w and comes back as a ghost."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos.demo import Expected, Figure, Finding, Result, demo
from taubench_gl.demos.props import BRICK, LEAF, SEA, Props, hall
from taubench_gl.demos.sheet import Sheet, checkerboard, note
from taubench_gl.demos.stage import Stage
from taubench_gl.metrics.reprojection import Reprojected, reproject
from taubench_gl.scene.model import Scene
from taubench_gl.selftest.bench import pixel_grid
from taubench_gl.selftest.scenes import IDENTITY, turn_y

Array = np.ndarray
YFOV = np.radians(60.0)
CHECKER = (237, 237, 237)


def scene() -> Scene:
    """The hall; the camera turns round by 180 degrees in one second.  A still life before it, another behind it."""
    b = Props()
    hall(b)
    for z, colors in ((-3.4, (LEAF, SEA)), (4.4, (BRICK, SEA))):
        b.block((0.35, 0.9, 0.35), colors[0], translation=(-1.0, -0.6, z))
        b.ball(0.4, colors[1], translation=(1.0, -1.1, z))
    camera = b.camera(yfov=YFOV, znear=0.05)
    b.animate(camera, "rotation", [0.0, 1.0], [IDENTITY, turn_y(180.0)])
    return b.build()


def fetched(picture: Array, motion: Array, kept: Array) -> Array:
    """What reuse would show: the last picture read where ``motion`` says, nearest pixel.  NaN where not ``kept``.

    (h, w, 3), (h, w, 2) pixels, previous - current, +y down, and (h, w) bool -> (h, w, 3).
    """
    height, width = kept.shape
    at = np.floor(pixel_grid((width, height)) + motion + 0.5).astype(int)
    column, row = np.clip(at[..., 0], 0, width - 1), np.clip(at[..., 1], 0, height - 1)
    return np.where(kept[..., None], picture[row, column], np.nan)


def without_the_test(stage: Stage) -> Reprojected:
    """The same pair by the float64 reference, with a near plane at minus infinity: no w is rejected."""
    images = stage.bench.pair(scene())
    pair = dataclasses.replace(images.pair, prev_near=-np.inf)
    return reproject(pair, images.current["position"].astype(np.float64))


@demo(
    3,
    "behind",
    "Why w <= 0 must be tested before dividing",
    idea="Reprojection ends with a division by w, the distance along the camera's view. A point behind the last "
    "camera has a negative w, and the division turns it into a point in front: upside down and mirrored, and "
    "well inside the screen. Nothing afterwards can tell it from a real one, so w has to be tested first.",
    look_for=(
        "Bottom left: the untested formula finds history for every pixel, although the camera turned right round.",
        "The ghost hangs upside down: the last picture, turned by half a turn.",
        "Bottom right: tested, not one pixel is kept.",
    ),
    scene=scene,
    see_also=(("the self-test's cases turn-180 and w-exactly-zero", "hard-cases.md"),),
)
def run(stage: Stage, out: Path) -> Result:
    lit = stage.pair(scene(), columns=("frustum", "color"))
    naive = without_the_test(stage)
    kept_naive, kept = ~(naive.behind | naive.outside), ~lit.has(Reason.BEHIND | Reason.OUTSIDE)
    cell = max(stage.size[0] // 60, 1)
    last = lit.before["color"][..., :3]
    sheet = Sheet(2, 2, stage.size[0] / stage.size[1])
    sheet.panel(0, 0, last, "the last frame")
    sheet.panel(1, 0, lit.now["color"][..., :3], "this frame: the camera has turned round")
    ghost = fetched(last, naive.motion_px, kept_naive)
    axes = sheet.panel(0, 1, checkerboard(np.nan_to_num(ghost), ~kept_naive, cell), "history, w not tested: a ghost")
    note(axes, f"{100 * kept_naive.mean():.1f} % wrongly kept")
    real = fetched(last, lit.motion, kept)
    axes = sheet.panel(1, 1, checkerboard(np.nan_to_num(real), ~kept, cell), "history, w tested: there is none")
    note(axes, f"{100 * kept.mean():.1f} % kept, {lit.percent(Reason.BEHIND):.1f} % behind")
    sheet.legend([("checkerboard: no history", CHECKER)])
    path = sheet.save(out / "03-behind.png")
    mirror = pixel_grid(stage.size)[::-1]  # row r reads row h - 1 - r of its own column
    error = np.abs(pixel_grid(stage.size) + naive.motion_px - mirror)[kept_naive].max()
    turn = "(x, y, -1) turned by 180° is (-x, y, 1); divided by w = -1 it is (x, -y): always on screen"
    findings = (
        Finding(100.0 * float(kept_naive.mean()), "%", "of the picture is reused by mistake where w is not tested",
                Expected.near(100.0, 0.0, turn)),
        Finding(100.0 * float(kept.mean()), "%", "is reused where w is tested",
                Expected.near(0.0, 0.0, "no point in view was in front of the last camera")),
        Finding(float(error), "px", "the ghost is from the last picture upside down, at most",
                Expected.between(0.0, 0.01, "(x, -y) again, in float32 at coordinates of some hundreds", 3), 4),
    )  # fmt: skip
    caption = (
        "Top: two frames, half a turn apart. Bottom: what the last frame gives each pixel, without and with the test."
    )
    return Result(findings, (Figure(path, caption, {"checkerboard": CHECKER}),))
