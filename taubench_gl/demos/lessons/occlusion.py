"""Demo 7: disoccluded pixels have no history; occluding pixels have history elsewhere."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured
from taubench_gl.demos.sheet import arrow, overlay
from taubench_gl.demos.stage import BRICK, CHALK, GOLD, SAND, Props, Stage, built, focal_px

YFOV = np.radians(50.0)
NEAR, FAR, STEP = 2.5, 6.0, 0.32
BOARD = (0.55, 0.6)  # half width and height
SHOWN = (Reason.DISOCCLUDED, Reason.OCCLUDING)
COLUMNS = ("frustum", "position", "color")


@built
def scene(b: Props, moves: str = "camera", step: float = STEP) -> None:
    """A board in front of a wall.  In one second the ``camera`` or the ``board`` moves right by ``step`` meters."""
    b.checkered(12.0, 8.0, (48, 32), (CHALK, SAND), translation=(0, 0, -FAR))
    board = b.checkered(*BOARD, (6, 6), (BRICK, GOLD), translation=(0, 0, -NEAR))
    b.light(translation=(0.6, 1.4, 0.0), intensity=35.0)
    camera = b.camera(yfov=YFOV, znear=0.05)
    start = np.array([(0.0, 0.0, -NEAR)] if moves == "board" else [(0.0, 0.0, 0.0)])
    node = board if moves == "board" else camera
    b.animate(node, "translation", [0.0, 1.0], np.concatenate([start, start + [step, 0, 0]]))


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The masks of a moving camera and of a moving board, and the widths of the strips in them."""
    walked = stage.pair(scene("camera"), columns=COLUMNS)
    camera = stage.pair(scene("board"), columns=COLUMNS)
    motion = stage.pair(scene("board"), columns=COLUMNS, reprojection="motion")
    (width, height), focal = stage.size, focal_px(YFOV, stage.size[1])
    parallax, moved = focal * STEP * (1 / NEAR - 1 / FAR), focal * STEP / NEAR
    sheet = lesson.sheet
    for place, (pair, mover, direction, reprojection) in enumerate((
        (walked, "camera", -1, "camera"), (camera, "board", 1, "camera"), (motion, "board", 1, "motion"),
    )):  # fmt: skip
        axes = sheet.panel(place, 0, pair.now["color"][..., :3], f"the {mover} moves to the right")
        middle = 0.5 * width + 0.5 * moved * direction
        half = 0.5 * moved * direction
        arrow(axes, (middle - half, 0.5 * height), (middle + half, 0.5 * height))
        text = f"{pair.row_width(SHOWN[0]):.0f} px disoccluded, {pair.row_width(SHOWN[1]):.0f} px occluding"
        image = overlay(pair.mask, pair.now["color"], *SHOWN)
        sheet.panel(place, 1, image, f"mask: {reprojection} reprojection", text)
    by_motion = Expected.near(moved, 1.0)
    numbers = {
        "camera_disoccluded": (walked.row_width(Reason.DISOCCLUDED), Expected.near(parallax, 1.0)),
        "camera_occluding": (walked.row_width(Reason.OCCLUDING), Expected.between(0.0, 1.0, 0)),
        "board_disoccluded": (camera.row_width(Reason.DISOCCLUDED), by_motion),
        "board_occluding": (camera.row_width(Reason.OCCLUDING), by_motion),
        "motion_occluding": (motion.row_width(Reason.OCCLUDING), Expected.between(0.0, 1.0, 0)),
        "motion_disoccluded": (motion.row_width(Reason.DISOCCLUDED), by_motion),
    }

    def at(step: float) -> tuple[Array, float, float, float]:
        """After the camera moved by ``step`` meters: the width of the strip that it disoccludes."""
        pair = stage.pair(scene("camera", step), columns=COLUMNS)
        parallax = focal * step * (1 / NEAR - 1 / FAR)
        return overlay(pair.mask, pair.now["color"], *SHOWN), pair.row_width(Reason.DISOCCLUDED), parallax, 1.0

    return Measured(numbers, lesson.swept(at))
