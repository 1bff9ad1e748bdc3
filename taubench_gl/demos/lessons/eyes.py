"""Demo 18: the other eye of the same frame as history."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured
from taubench_gl.demos.sheet import overlay
from taubench_gl.demos.stage import BRICK, CHALK, GOLD, SAND, Props, Stage, built, focal_px

YFOV = np.radians(50.0)
NEAR, FAR, STEP = 0.8, 3.0, 0.1
BOARD = (0.17, 0.2)  # half width and height
SHOWN = (Reason.DISOCCLUDED, Reason.OCCLUDING, Reason.OUTSIDE)
COLUMNS = ("frustum", "position", "color")
SLACK = 1.5  # counted at pixel centers, ± 1 px, with the nearest pixel of the history, ± 0.5 px


@built
def scene(b: Props) -> None:
    """A board in front of a wall, which moves to the left by STEP in one second, and a still camera."""
    b.checkered(8.0, 5.0, (64, 40), (CHALK, SAND), translation=(0, 0, -FAR))
    board = b.checkered(*BOARD, (6, 6), (BRICK, GOLD), translation=(0, 0, -NEAR))
    b.light(translation=(0.6, 1.4, 0.0), intensity=30.0)
    b.camera(yfov=YFOV, znear=0.05)
    start = np.array([(0.5 * STEP, 0.0, -NEAR)])
    b.animate(board, "translation", [0.0, 1.0], np.concatenate([start, start - [STEP, 0, 0]]))


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The masks of the left eye with the history of the other eye, of the last frame, and of both."""
    eyes = lesson.text.opening.settings["eyes"]
    eye, frame, both = (stage.pair(scene(), columns=COLUMNS, history=h, eyes=eyes) for h in ("eye", "frame", "both"))
    converged = stage.pair(scene(), columns=COLUMNS, history="eye", eyes=eyes, convergence=FAR)
    focal = focal_px(YFOV, stage.size[1])
    parallax, sheet = focal * eyes * (1 / NEAR - 1 / FAR), lesson.sheet
    images = (eye.now, "the left eye"), (eye.before, "the right eye"), (frame.before, "the left eye, one frame before")
    for place, (channels, title) in enumerate(images):
        sheet.panel(place, 0, channels["color"][..., :3], title)
    masks = (eye, "the right eye"), (frame, "the last frame"), (both, "the better of both")
    for place, (pair, title) in enumerate(masks):
        text = f"{100.0 - pair.percent(Reason.POSITION | Reason.OUTSIDE):.1f} % of the pixels can be reused"
        sheet.panel(place, 1, overlay(pair.mask, pair.now["color"], *SHOWN), f"history: {title}", text)
    board = (eye.now["position"][..., 3] < 0.5 * (NEAR + FAR)) & ~eye.has(Reason.OUTSIDE)
    numbers = {
        "hidden": (eye.row_width(Reason.DISOCCLUDED), Expected.near(parallax, SLACK)),
        "disparity": (float(-eye.motion[board][:, 0].mean()), Expected.near(focal * eyes / NEAR, 0.01)),
        "outside": (eye.row_width(Reason.OUTSIDE), Expected.near(focal * eyes / FAR, 1.0)),
        "outside_converged": (converged.row_width(Reason.OUTSIDE), Expected.near(0.0, 0.0, 0)),
        "hidden_before": (frame.row_width(Reason.DISOCCLUDED), Expected.near(focal * STEP / NEAR, SLACK)),
        "without_history": (
            both.row_width(Reason.DISOCCLUDED | Reason.OCCLUDING | Reason.OUTSIDE),
            Expected.between(0.0, 2.0, 0),
        ),
    }

    def at(eyes: float) -> tuple[Array, float, float, float]:
        """With ``eyes`` meters between the eyes: the width of the strip that one of them sees alone."""
        pair = stage.pair(scene(), columns=COLUMNS, history="eye", eyes=eyes)
        parallax = focal * eyes * (1 / NEAR - 1 / FAR)
        return overlay(pair.mask, pair.now["color"], *SHOWN), pair.row_width(Reason.DISOCCLUDED), parallax, SLACK

    return Measured(numbers, lesson.swept(at))
