"""Demo 7: what comes into view has no history, what covers something has one, elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos.demo import Expected, Figure, Finding, Result, demo
from taubench_gl.demos.props import BRICK, CHALK, SAND, SEA, Props
from taubench_gl.demos.sheet import Sheet, arrow, note, overlay, reason_entries, rgb
from taubench_gl.demos.stage import LitPair, Stage
from taubench_gl.scene.model import Scene

YFOV = np.radians(50.0)
NEAR, FAR, STEP = 2.5, 6.0, 0.32
BOARD = (0.55, 0.6)  # half width and height
SHOWN = (Reason.DISOCCLUDED, Reason.OCCLUDING)


def scene(moves: str = "board") -> Scene:
    """A board before a wall.  In one second the ``board`` or the ``camera`` moves to the right by STEP metres."""
    b = Props()
    b.checkered(12.0, 8.0, (48, 32), (CHALK, SAND), translation=(0, 0, -FAR))
    board = b.checkered(*BOARD, (6, 6), (BRICK, SEA), translation=(0, 0, -NEAR))
    b.light(translation=(0.6, 1.4, 0.0), intensity=35.0)
    camera = b.camera(yfov=YFOV, znear=0.05)
    start = np.array([(0.0, 0.0, -NEAR)] if moves == "board" else [(0.0, 0.0, 0.0)])
    node = board if moves == "board" else camera
    b.animate(node, "translation", [0.0, 1.0], np.concatenate([start, start + [STEP, 0, 0]]))
    return b.build()


def focal(height: int) -> float:
    """Focal length in pixels."""
    return 0.5 * height / np.tan(0.5 * YFOV)


def width_of(pair: LitPair, reason: Reason) -> float:
    """Pixels with ``reason`` in the row across the board's middle."""
    return float(pair.has(reason)[pair.mask.shape[0] // 2].sum())


@demo(
    7,
    "occlusion",
    "Occlusion against disocclusion",
    idea="Where one thing moves before another, two strips change. On one side something comes into view that the "
    "last frame did not show: disoccluded, its history does not exist and has to start anew. On the other side "
    "the thing covers what was there: its own history exists, only at the place where it was, and motion "
    "vectors lead there.",
    look_for=(
        "Left: a moving camera uncovers a strip on one side only; what it covers is simply gone from the picture.",
        "Middle: for a moving board, reprojection by the camera alone discards both sides.",
        "Right: motion vectors give the board its history back. The uncovered strip stays lost whatever one does.",
    ),
    scene=scene,
    see_also=(("camera and motion reprojection", "conventions.md"),),
)
def run(stage: Stage, out: Path) -> Result:
    columns = ("frustum", "position", "color")
    walked = stage.pair(scene("camera"), columns=columns)
    camera = stage.pair(scene("board"), columns=columns)
    motion = stage.pair(scene("board"), columns=columns, reprojection="motion")
    height = stage.size[1]
    sheet = Sheet(3, 2, stage.size[0] / height)
    shown = (
        (walked, "the camera moves to the right", -1, "camera reprojection"),
        (camera, "the board moves to the right", 1, "camera reprojection"),
        (motion, "the board moves to the right", 1, "motion reprojection"),
    )
    for place, (pair, what, way, how) in enumerate(shown):
        axes = sheet.panel(place, 0, pair.now["color"][..., :3], f"this frame: {what}")
        middle = (0.5 * stage.size[0] + (0.5 * focal(height) * STEP / NEAR) * way, 0.5 * height)
        half = 0.5 * focal(height) * STEP / NEAR
        arrow(axes, (middle[0] - way * half, middle[1]), (middle[0] + way * half, middle[1]))
        axes = sheet.panel(place, 1, overlay(pair.mask, pair.now["color"], *SHOWN), f"its mask: {how}")
        note(axes, f"{width_of(pair, SHOWN[0]):.0f} px uncovered, {width_of(pair, SHOWN[1]):.0f} px covering")
    sheet.legend(reason_entries(*SHOWN))
    path = sheet.save(out / "07-occlusion.png")
    parallax = focal(height) * STEP * (1 / NEAR - 1 / FAR)
    moved = focal(height) * STEP / NEAR
    counted = "; counted by pixel centres, ± 1 px"
    rim = "; up to a pixel of its rim, where the nearest pixel of the last frame shows the wall"
    findings = (
        Finding(width_of(walked, Reason.DISOCCLUDED), "px", "is the strip that the moving camera uncovers",
                Expected.near(parallax, 1.0, "parallax f t (1 / z_near - 1 / z_far)" + counted), 0),
        Finding(width_of(walked, Reason.OCCLUDING), "px", "of the moving camera's picture cover something",
                Expected.between(0.0, 1.0, "what it covers is gone from the picture" + rim, 0), 0),
        Finding(width_of(camera, Reason.DISOCCLUDED), "px", "is the strip that the moving board uncovers",
                Expected.near(moved, 1.0, "motion f t / z_near" + counted), 0),
        Finding(width_of(camera, Reason.OCCLUDING), "px", "is the strip that it covers, without motion vectors",
                Expected.near(moved, 1.0, "motion f t / z_near" + counted), 0),
        Finding(width_of(motion, Reason.OCCLUDING), "px", "of it are left with motion vectors",
                Expected.between(0.0, 1.0, "each point of the board is found where it was" + rim, 0), 0),
        Finding(width_of(motion, Reason.DISOCCLUDED), "px", "is the uncovered strip with motion vectors: no cure",
                Expected.near(moved, 1.0, "motion f t / z_near" + counted), 0),
    )  # fmt: skip
    caption = "A board before a wall: who moved, and how the masks look for it."
    return Result(findings, (Figure(path, caption, {r.name.lower(): rgb(r) for r in SHOWN}),))
