"""Demo 7: disoccluded pixels have no history; occluding pixels have history elsewhere."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos.demo import Expected, Finding, Opening, Parameter, Result
from taubench_gl.demos.sheet import Sheet, arrow, overlay, reason_entries
from taubench_gl.demos.stage import BRICK, CHALK, GOLD, SAND, Props, Stage, focal_px
from taubench_gl.scene.model import Scene

YFOV = np.radians(50.0)
NEAR, FAR, STEP = 2.5, 6.0, 0.32
BOARD = (0.55, 0.6)  # half width and height
SHOWN = (Reason.DISOCCLUDED, Reason.OCCLUDING)
STEPS = (0.0, 0.08, 0.16, 0.24, 0.32, 0.4, 0.48)  # meters


def scene(moves: str = "camera", step: float = STEP) -> Scene:
    """A board in front of a wall.  In one second the ``camera`` or the ``board`` moves right by ``step`` meters."""
    b = Props()
    b.checkered(12.0, 8.0, (48, 32), (CHALK, SAND), translation=(0, 0, -FAR))
    board = b.checkered(*BOARD, (6, 6), (BRICK, GOLD), translation=(0, 0, -NEAR))
    b.light(translation=(0.6, 1.4, 0.0), intensity=35.0)
    camera = b.camera(yfov=YFOV, znear=0.05)
    start = np.array([(0.0, 0.0, -NEAR)] if moves == "board" else [(0.0, 0.0, 0.0)])
    node = board if moves == "board" else camera
    b.animate(node, "translation", [0.0, 1.0], np.concatenate([start, start + [step, 0, 0]]))
    return b.build()


OPENING = Opening(SHOWN, settings={"reprojection": "motion"})


def run(stage: Stage) -> Result:
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
    for place, (pair, title, direction, how) in enumerate(shown):
        axes = sheet.panel(place, 0, pair.now["color"][..., :3], title)
        middle = (0.5 * stage.size[0] + (0.5 * focal_px(YFOV, height) * STEP / NEAR) * direction, 0.5 * height)
        half = 0.5 * focal_px(YFOV, height) * STEP / NEAR
        arrow(axes, (middle[0] - direction * half, middle[1]), (middle[0] + direction * half, middle[1]))
        text = f"{pair.row_width(SHOWN[0]):.0f} px disoccluded, {pair.row_width(SHOWN[1]):.0f} px occluding"
        sheet.panel(place, 1, overlay(pair.mask, pair.now["color"], *SHOWN), f"mask: {how}", text)
    sheet.legend(reason_entries(*SHOWN))
    parallax = focal_px(YFOV, height) * STEP * (1 / NEAR - 1 / FAR)
    moved = focal_px(YFOV, height) * STEP / NEAR
    counted = "; counted at pixel centers, ± 1 px"
    edge = "; up to one pixel at its edge, where the nearest history pixel shows the wall"
    findings = (
        Finding(walked.row_width(Reason.DISOCCLUDED), "px", "is the strip that the moving camera disoccludes",
                Expected.near(parallax, 1.0, "parallax f t (1 / z_near - 1 / z_far)" + counted), 0),
        Finding(walked.row_width(Reason.OCCLUDING), "px", "are newly occluding with the moving camera",
                Expected.between(0.0, 1.0, "covered surfaces are not in the image" + edge, 0), 0),
        Finding(camera.row_width(Reason.DISOCCLUDED), "px", "is the strip that the moving board disoccludes",
                Expected.near(moved, 1.0, "motion f t / z_near" + counted), 0),
        Finding(camera.row_width(Reason.OCCLUDING), "px", "are newly occluding without motion vectors",
                Expected.near(moved, 1.0, "motion f t / z_near" + counted), 0),
        Finding(motion.row_width(Reason.OCCLUDING), "px", "are newly occluding with motion vectors",
                Expected.between(0.0, 1.0, "each point of the board finds its previous position" + edge, 0), 0),
        Finding(motion.row_width(Reason.DISOCCLUDED), "px", "is the disoccluded strip with motion vectors",
                Expected.near(moved, 1.0, "motion f t / z_near" + counted), 0),
    )  # fmt: skip
    caption = (
        "A board in front of a wall, in the current frame, and its mask. Arrows: how far the board moves in the image."
    )
    return Result(findings, sheet, caption, _distance(stage))


def _distance(stage: Stage) -> Parameter:
    """How far the camera moves."""
    images, widths = [], []
    for step in STEPS:
        pair = stage.pair(scene("camera", step), columns=("frustum", "position", "color"))
        images.append(overlay(pair.mask, pair.now["color"], *SHOWN))
        widths.append(pair.row_width(Reason.DISOCCLUDED))
    return Parameter(
        "motion of the camera", "m", STEPS, "is the strip that appears", "px", tuple(widths),
        tuple(focal_px(YFOV, stage.size[1]) * step * (1 / NEAR - 1 / FAR) for step in STEPS), (1.0,) * len(STEPS),
        "parallax f t (1 / z_near - 1 / z_far); counted at pixel centers", start=STEPS.index(STEP),
        images=tuple(images), digits=0, note="Light blue: disoccluded.",
    )  # fmt: skip
