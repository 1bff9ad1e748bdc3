"""Demo 1, the paper's figure 1: history that remains after a camera rotation."""

from __future__ import annotations

import numpy as np

from taubench_gl import math3d
from taubench_gl.conventions import FRUSTUM
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Expected, Finding, Opening, Parameter, Result
from taubench_gl.demos.lessons.behind import reprojected
from taubench_gl.demos.sheet import Sheet, as_bytes, checkerboard
from taubench_gl.demos.stage import Props, Stage, hall
from taubench_gl.scene.builder import IDENTITY, turn
from taubench_gl.scene.model import Scene

YFOV = np.radians(55.0)
DEGREES = 25.0
TURNS = {"pitch": ("upwards", (1, 0, 0)), "yaw": ("to the left", (0, 1, 0)), "roll": ("sideways", (0, 0, 1))}
CHECKER = (237, 237, 237)


ANGLES = np.arange(5.0, 61.0, 5.0)


def scene(axis: str = "yaw", degrees: float = DEGREES) -> Scene:
    """The hall and a camera that rotates by ``degrees`` in one second."""
    b = Props()
    hall(b)
    camera = b.camera(translation=(0.0, 0.0, 1.2), yfov=YFOV, znear=0.05)
    b.animate(camera, "rotation", [0.0, 1.0], [IDENTITY, turn(TURNS[axis][1], degrees)])
    return b.build()


OPENING = Opening((FRUSTUM,))


def run(stage: Stage) -> Result:
    sheet = Sheet(2, 2, stage.size[0] / stage.size[1])
    findings, before = [], None
    for place, (axis, (direction, vector)) in enumerate(TURNS.items(), start=1):
        pair = stage.pair(scene(axis), columns=("frustum", "color"))
        if place == 1:
            before = pair.before["color"][..., :3]
            sheet.panel(0, 0, before, "previous frame")
        lost = pair.percent(FRUSTUM)
        prev_from_now = math3d.mat3_from_quat(turn(vector, DEGREES))
        share, slack = theory.frustum_share(prev_from_now, YFOV, stage.size)
        image = checkerboard(pair.now["color"], pair.has(FRUSTUM), max(stage.size[0] // 60, 1))
        sheet.panel(place % 2, place // 2, image, f"{axis}, 25° {direction}", f"{lost:.1f} % without history")
        source = "area of the polygon that both cameras see, float64; ± half of the pixels on its edge"
        findings.append(
            Finding(lost, "%", f"of the pixels have no history after {axis}", Expected.near(share, slack, source))
        )
    sheet.legend([("checkerboard: outside the previous image", CHECKER)])
    findings.sort(key=lambda f: "yaw" not in f.meaning)
    caption = "The hall before and after rotations by 25 degrees about three axes, as in the paper's figure 1."
    return Result(tuple(findings), sheet, caption, _angle(stage, before))


def _angle(stage: Stage, before: np.ndarray) -> Parameter:
    """The angle of yaw: the previous image (h, w, 3) seen from the new orientation."""
    turning, images, lost, theoretical = scene("yaw", ANGLES[-1]), [], [], []
    for angle in ANGLES:
        pair = stage.bench.pair(turning, (0.0, angle / ANGLES[-1]))
        gone = pair.has(FRUSTUM)
        history = reprojected(before, pair.motion, ~gone)
        images.append(as_bytes(checkerboard(np.nan_to_num(history), gone, max(stage.size[0] // 60, 1))))
        lost.append(100.0 * float(gone.mean()))
        theoretical.append(theory.frustum_share(math3d.mat3_from_quat(turn((0, 1, 0), angle)), YFOV, stage.size))
    shares, slacks = zip(*theoretical)
    return Parameter(
        "angle of yaw", "°", tuple(map(float, ANGLES)), "of the pixels have no history", "%", tuple(lost), shares,
        slacks, "area of the polygon that both cameras see; ± half of the pixels on its edge",
        start=int(np.argmin(np.abs(ANGLES - DEGREES))),
        images=tuple(images), note="The previous image, reprojected; checkerboard: no history.",
    )  # fmt: skip
