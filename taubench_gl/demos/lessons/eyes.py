"""Demo 18: the other eye of the same frame as history."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos.demo import Expected, Finding, Opening, Parameter, Result, swept
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
SLACK, COUNTED = 1.5, "; counted at pixel centers, ± 1 px, with the nearest pixel of the history, ± 0.5 px"
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


def run(stage: Stage) -> Result:
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
    edge = "; up to one pixel at each edge, where the nearest history pixel shows another surface"
    board = (eye.now["position"][..., 3] < 0.5 * (NEAR + FAR)) & ~eye.has(Reason.OUTSIDE)
    findings = (
        Finding(eye.row_width(Reason.DISOCCLUDED), "px", "is the strip that the board hides from the right eye",
                Expected.near(parallax, SLACK, "parallax f b (1 / z_near - 1 / z_far)" + COUNTED), 0),
        Finding(float(-eye.motion[board][:, 0].mean()), "px", "is the board further left in the right eye",
                Expected.near(focal * EYES / NEAR, 0.01, "disparity f b / z_near")),
        Finding(eye.row_width(Reason.OUTSIDE), "px", "of the left edge are not in the right image",
                Expected.near(focal * EYES / FAR, 1.0, "disparity f b / z_far; counted at pixel centers"), 0),
        Finding(converged.row_width(Reason.OUTSIDE), "px", "of it remain with eyes that converge at the wall",
                Expected.near(0.0, 0.0, "f b (1 / z_far - 1 / c) is 0 at the distance c", 0), 0),
        Finding(frame.row_width(Reason.DISOCCLUDED), "px", "is the strip that the board hid in the last frame",
                Expected.near(focal * STEP / NEAR, SLACK, "motion f t / z_near" + COUNTED), 0),
        Finding(both.row_width(Reason.DISOCCLUDED | Reason.OCCLUDING | Reason.OUTSIDE), "px", "have neither history",
                Expected.between(0.0, 2.0, "the strips are on two sides of the board" + edge, 0), 0),
    )  # fmt: skip
    caption = "Top: both eyes, and the left one a frame earlier. Bottom: masks of the left eye with each history."
    return Result(findings, sheet, caption, _distance(stage))


def _distance(stage: Stage) -> Parameter:
    """The distance of the eyes: the width of the strip that one of them sees alone."""

    def at(eyes: float) -> tuple[Array, float, float, float]:
        pair = stage.pair(scene(), columns=COLUMNS, history="eye", eyes=eyes)
        parallax = focal_px(YFOV, stage.size[1]) * eyes * (1 / NEAR - 1 / FAR)
        return overlay(pair.mask, pair.now["color"], *SHOWN), pair.row_width(Reason.DISOCCLUDED), parallax, SLACK

    return swept(
        "distance of the eyes", "m", DISTANCES, at, start=EYES, number_unit="px", digits=0,
        meaning="is the strip that the board hides from the right eye",
        source="parallax f b (1 / z_near - 1 / z_far)" + COUNTED,
        note="Light blue: hidden from the right eye. Orange: not in its image.",
    )  # fmt: skip
