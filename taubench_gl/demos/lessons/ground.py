"""Demo 13: a fixed distance rejects the history of distant ground that nothing has hidden."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import DEFAULT_THRESHOLD, FRUSTUM, Reason, Visibility
from taubench_gl.demos.demo import Expected, Lesson, Measured, beyond, percent
from taubench_gl.demos.sheet import gray_image, painted, rgb
from taubench_gl.demos.stage import CHALK, SAND, Props, Stage, built, focal_px
from taubench_gl.demos.theory import ground_distance
from taubench_gl.features import FEATURE_BIT
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.reject.evaluate import evaluate_tests
from taubench_gl.scene.builder import turn_x
from taubench_gl.selftest.bench import limits

YFOV = np.radians(50.0)
EYE, STEP = 1.6, 1.3  # height of the camera, meters; meters it moves forward in a second
DISCARDED, HIDDEN = rgb(Reason.POSITION), rgb(Reason.DISOCCLUDED)


@built
def scene(b: Props) -> None:
    """Level ground up to the horizon, and a camera that moves forward by STEP meters a second."""
    b.checkered(4000.0, 4000.0, (1, 2000), (CHALK, SAND), rotation=turn_x(-90))
    b.light(rotation=turn_x(-60), kind="directional", intensity=2.0)
    camera = b.camera(yfov=YFOV, znear=0.1)
    b.animate(camera, "translation", [0.0, 3.0], [(0.0, EYE, 0.0), (0.0, EYE, -3.0 * STEP)])


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The pixels of level ground that the distance of positions discards, and those that were hidden."""
    columns = ("frustum", "position", "color")
    pair = stage.evaluate(scene(), columns=columns, frames=(1, 3), extra=("prev_visibility",))[1][0]
    height = stage.size[1]
    position = pair.has(FEATURE_BIT["position"])
    occluded = (pair.now["prev_visibility"][..., 0] & Visibility.OCCLUDED) != 0
    hidden = occluded & (pair.now["position"][..., 3] > 0)
    settings = stage.settings(frames=(0, 3), columns=("frustum",))
    test = evaluate_tests(scene(), ("footprint_position",), settings).summary["tests"]["footprint_position"]
    by_width = 100.0 * test["scores"]["visibility"]["false_positive_rate"]
    image = pair.now["color"][..., :3]
    panels = ((position, DISCARDED, "discarded by the distance of positions"), (hidden, HIDDEN, "hidden"))
    for place, (region, color, title) in enumerate(panels):
        lesson.sheet.panel(place, 0, painted(image, (region, color)), title, f"{percent(region):.1f} % of the image")
    away = ground_distance(stage.size, EYE, focal_px(YFOV, height), STEP)
    column = ground_distance((1, height), EYE, focal_px(YFOV, height), STEP)
    expected = percent(column > DEFAULT_THRESHOLD)
    numbers = {
        "discarded": (percent(position), Expected.near(expected, 250.0 / height)),
        "hidden": (percent(hidden), Expected.between(0.0, 0.0)),
        "rejected_by_width": (by_width, Expected.between(0.0, 500.0 / height)),
    }
    bare = stage.bench.pair(scene(), (1.0, 2.0))
    distance = pair_masks(bare.current, bare.history, bare.pair, limits(None)).distances["position"]
    distance = np.where(bare.has(FRUSTUM), 0.0, np.nan_to_num(distance))
    return Measured(numbers, lesson.threshold(distance, gray_image(pair), beyond(away), Reason.POSITION))
