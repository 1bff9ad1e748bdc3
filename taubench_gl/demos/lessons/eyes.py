"""Demo 18: the other eye of the same frame as history."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos.demo import Expected, Measured, Opening, Parameter, swept
from taubench_gl.demos.sheet import Sheet, overlay, reason_entries
from taubench_gl.demos.stage import BRICK, CHALK, GOLD, SAND, Props, Stage, focal_px
from taubench_gl.scene.model import Scene

Array = np.ndarray
YFOV = np.radians(50.0)
NEAR, FAR, STEP = 0.8, 3.0, 0.1
BOARD = (0.17, 0.2)  # half width and height
EYES = 0.064
SHOWN = (Reason.DISOCCLUDED, Reason.OCCLUDING, Reason.OUTSIDE)
COLUMNS = ("frustum", "position", "color")
SLACK = 1.5  # counted at pixel centers, ± 1 px, with the nearest pixel of the history, ± 0.5 px
DISTANCES = (0.016, 0.032, 0.048, 0.064, 0.08, 0.096)  # of the eyes, meters


def scene() -> Scene:
    """A board in front of a wall, which moves to the left by STEP in one second, and a still camera."""
    b = Props()
    b.checkered(8.0, 5.0, (64, 40), (CHALK, SAND), translation=(0, 0, -FAR))
    board = b.checkered(*BOARD, (6, 6), (BRICK, GOLD), translation=(0, 0, -NEAR))
    b.light(translation=(0.6, 1.4, 0.0), intensity=30.0)
    b.camera(yfov=YFOV, znear=0.05)
    start = np.array([(0.5 * STEP, 0.0, -NEAR)])
    b.animate(board, "translation", [0.0, 1.0], np.concatenate([start, start - [STEP, 0, 0]]))
    return b.build()


OPENING = Opening((Reason.DISOCCLUDED, Reason.OUTSIDE), settings={"history": "eye", "eyes": EYES})


def run(stage: Stage) -> Measured:
    """The masks of the left eye with the history of the other eye, of the last frame, and of both."""
    eye, frame, both = (stage.pair(scene(), columns=COLUMNS, history=h, eyes=EYES) for h in ("eye", "frame", "both"))
    converged = stage.pair(scene(), columns=COLUMNS, history="eye", eyes=EYES, convergence=FAR)
    focal = focal_px(YFOV, stage.size[1])
    parallax = focal * EYES * (1 / NEAR - 1 / FAR)
    sheet = Sheet(3, 2, stage.size[0] / stage.size[1])
    images = (eye.now, "the left eye"), (eye.before, "the right eye"), (frame.before, "the left eye, one frame before")
    for place, (channels, title) in enumerate(images):
        sheet.panel(place, 0, channels["color"][..., :3], title)
    masks = (eye, "the right eye"), (frame, "the last frame"), (both, "the better of both")
    for place, (pair, title) in enumerate(masks):
        text = f"{100.0 - pair.percent(Reason.POSITION | Reason.OUTSIDE):.1f} % of the pixels can be reused"
        sheet.panel(place, 1, overlay(pair.mask, pair.now["color"], *SHOWN), f"history: {title}", text)
    sheet.legend(reason_entries(*SHOWN))
    board = (eye.now["position"][..., 3] < 0.5 * (NEAR + FAR)) & ~eye.has(Reason.OUTSIDE)
    numbers = {
        "hidden": (eye.row_width(Reason.DISOCCLUDED), Expected.near(parallax, SLACK)),
        "disparity": (float(-eye.motion[board][:, 0].mean()), Expected.near(focal * EYES / NEAR, 0.01)),
        "outside": (eye.row_width(Reason.OUTSIDE), Expected.near(focal * EYES / FAR, 1.0)),
        "outside_converged": (converged.row_width(Reason.OUTSIDE), Expected.near(0.0, 0.0, 0)),
        "hidden_before": (frame.row_width(Reason.DISOCCLUDED), Expected.near(focal * STEP / NEAR, SLACK)),
        "without_history": (
            both.row_width(Reason.DISOCCLUDED | Reason.OCCLUDING | Reason.OUTSIDE),
            Expected.between(0.0, 2.0, 0),
        ),
    }
    return Measured(numbers, sheet, _distance(stage))


def _distance(stage: Stage) -> Parameter:
    """The distance of the eyes: the width of the strip that one of them sees alone."""

    def at(eyes: float) -> tuple[Array, float, float, float]:
        pair = stage.pair(scene(), columns=COLUMNS, history="eye", eyes=eyes)
        parallax = focal_px(YFOV, stage.size[1]) * eyes * (1 / NEAR - 1 / FAR)
        return overlay(pair.mask, pair.now["color"], *SHOWN), pair.row_width(Reason.DISOCCLUDED), parallax, SLACK

    return swept(DISTANCES, at, start=EYES)
