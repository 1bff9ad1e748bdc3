"""Demo 1, the paper's figure 1: history that remains after a camera rotation."""

from __future__ import annotations

import numpy as np

from taubench_gl import math3d
from taubench_gl.conventions import FRUSTUM
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, percent
from taubench_gl.demos.lessons.behind import reprojected
from taubench_gl.demos.sheet import checkerboard
from taubench_gl.demos.stage import Props, Stage, built, hall
from taubench_gl.scene.builder import IDENTITY, turn

YFOV = np.radians(55.0)
DEGREES = 25.0
TURNS = {"pitch": ("upwards", (1, 0, 0)), "yaw": ("to the left", (0, 1, 0)), "roll": ("sideways", (0, 0, 1))}
LARGEST = 60.0  # degrees of the parameter


@built
def scene(b: Props, axis: str = "yaw", degrees: float = DEGREES) -> None:
    """The hall and a camera that rotates by ``degrees`` in one second."""
    hall(b)
    camera = b.camera(translation=(0.0, 0.0, 1.2), yfov=YFOV, znear=0.05)
    b.animate(camera, "rotation", [0.0, 1.0], [IDENTITY, turn(TURNS[axis][1], degrees)])


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The hall after a rotation about each axis, and the share of each image without history."""
    numbers, before = {}, lesson.pair.before["color"][..., :3]
    lesson.sheet.panel(0, 0, before, "previous frame")
    for place, (axis, (direction, vector)) in enumerate(TURNS.items(), start=1):
        pair = stage.pair(scene(axis), columns=("frustum", "color"))
        lost, rotation = pair.percent(FRUSTUM), math3d.mat3_from_quat(turn(vector, DEGREES))
        image = checkerboard(pair.now["color"], pair.has(FRUSTUM), stage.cell)
        lesson.sheet.panel(place % 2, place // 2, image, f"{axis}, 25° {direction}", f"{lost:.1f} % without history")
        numbers[axis] = lost, Expected.near(*theory.frustum_share(rotation, YFOV, stage.size))
    turning = scene("yaw", LARGEST)

    def at(angle: float) -> tuple[Array, float, float, float]:
        """After ``angle`` degrees of yaw: the part of the previous image that the new orientation still sees."""
        pair = stage.bench.pair(turning, (0.0, angle / LARGEST))
        gone = pair.has(FRUSTUM)
        history = np.nan_to_num(reprojected(before, pair.motion, ~gone))
        image = checkerboard(history, gone, stage.cell)
        rotation = math3d.mat3_from_quat(turn((0, 1, 0), angle))
        return image, percent(gone), *theory.frustum_share(rotation, YFOV, stage.size)

    return Measured({axis: numbers[axis] for axis in lesson.text.numbers}, lesson.swept(at))
