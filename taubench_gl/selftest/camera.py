"""Cases: rotation and translation of the camera (Eqs. 1 and 2), cuts, and scaled camera nodes."""

from __future__ import annotations

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import Poser, choose_camera
from taubench_gl.metrics import activity as act
from taubench_gl.scene.builder import SceneBuilder, box, turn, turn_x, turn_y
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, count, difference, field, scalar, worst

Array = np.ndarray


def _rotations(*quaternions: Array) -> Array:
    return math3d.mat3_from_quat(np.array(quaternions))


def _activity(*quaternions: Array) -> act.Activity:
    return act.camera_activity(np.zeros((len(quaternions), 3)), _rotations(*quaternions))


@case("angle-wrap", tolerance=1e-12, source="float64: 32 ulps of an angle near 360 degrees")
def angle_wrap(bench: Bench) -> Outcome:
    """Yaw from 359 to 1 degree in one frame, and from 179 to 181: its change is 2 degrees.

    The difference of the angles is 358 degrees at the end of their range.
    """
    turns = [_activity(turn_y(a), turn_y(a + 2.0)).yaw[0] for a in (359.0, 179.0)]
    furthest = max(turns, key=lambda turned: abs(turned - 2.0))
    return scalar(2.0, furthest)


@case("pitch-through-90", tolerance=1e-9, source="float64: atan2 of a cosine of 0.017 to 1e-16, ten times")
def pitch_through_90(bench: Bench) -> Outcome:
    """A camera that pitches through 90 degrees, without and with yaw and roll: total change of yaw and roll.

    Yaw and roll each jump by 180 degrees at the pole.
    """
    rotations = _rotations(*(turn_x(p) for p in np.arange(85.0, 96.0)))
    measured = act.camera_activity(np.zeros((11, 3)), rotations)
    rolled = (math3d.quat_multiply(turn_x(p), turn((0, 0, 1), 20.0)) for p in np.arange(75.0, 106.0, 5.0))
    steep = _activity(*(math3d.quat_multiply(turn_y(31.0), q) for q in rolled))
    moved = float(np.sum(measured.yaw + measured.roll) + np.sum(steep.yaw + steep.roll))
    off = max(worst(measured.pitch - 1.0), worst(steep.pitch - 5.0))
    outcome = scalar(0.0, moved)
    return outcome if off < 1e-9 else Outcome(1.0, f"pitch is off by {off:.3g}", off)


@case(
    "tiny-rotation", tolerance=1e-8, source="float64: an angle of 1.7e-7 rad from unit quaternions rounded to 1.1e-16"
)
def tiny_rotation(bench: Bench) -> Outcome:
    """A camera that turns by 1e-5 degrees a frame: relative error of the geodesic angle.

    2 acos(q1 . q2): the dot product rounds to 1, so the angle is 0 or wrong by 10 %.
    """
    step = 1e-5
    quaternions = [turn_y(33.0 + i * step) for i in range(8)]
    measured = _activity(*quaternions).angle
    off = max(difference(step, a, relative=True) for a in measured)
    return Outcome(step, float(measured[0]), off)


@case("tiny-step-far-away", source="exact: dyadic numbers within 53 bits")
def tiny_step(bench: Bench) -> Outcome:
    """A camera 1e6 m from the origin that moves by 2^-20 m a frame: its translation per frame (Eq. 1).

    Float32 positions have a step of 6 cm there: the camera is still, then jumps.
    """
    step = 2.0**-20
    positions = np.array([(1e6 + i * step, 1e6, -1e6) for i in range(5)])
    measured = act.translation(positions)
    return Outcome(step, float(measured[0]), worst(measured - step))


@case("running-is-not-a-cut", source="exact: the number of pairs")
def running(bench: Bench) -> Outcome:
    """A game camera with the paper's largest steps (mean 1.9 m, maximum 5.5 m per frame): cuts detected.

    Every step above a fixed limit of 1 or 2 m is a cut.
    """
    t = np.arange(1, 200)
    steps = np.clip(1.9 + 1.2 * np.sin(0.37 * t) + 0.9 * np.sin(1.7 * t), 0.1, None)
    steps[100] = 5.475
    positions = np.zeros((200, 3))
    positions[1:, 0] = np.cumsum(steps)
    cuts = act.detect_cuts(act.camera_activity(positions, np.tile(np.eye(3), (200, 1, 1))))
    return count(0, int(cuts.sum()))


@case("scaled-camera-node", tolerance=1e-14, source="float64: 64 ulps of 1 in R R^T and det R")
def scaled_camera_node(bench: Bench) -> Outcome:
    """A camera below nodes with scale (3, 0.5, -2): deviation of its view from a rotation.

    The inverse of the node's matrix stretches or mirrors the image.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(box()))
    parent = b.node(rotation=turn((1.0, 1.0, 0.0), 40.0), scale=(3.0, 0.5, -2.0))
    b.camera(parent, rotation=turn_y(25.0), scale=(1.0, 4.0, 1.0))
    scene = b.build()
    state = Poser(scene).sample(0.0)
    rotation = choose_camera(scene).view_at(state).world_from_view

    def deviation(r: Array) -> Array:
        return np.append((r @ r.T - np.eye(3)).ravel(), np.linalg.det(r) - 1.0)

    return field("a proper rotation", deviation(rotation))
