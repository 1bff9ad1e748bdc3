"""Demo 4: float32 world coordinates a thousand kilometers from the origin."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import FRUSTUM
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Parameter, Screens
from taubench_gl.demos.sheet import BLUE, RED, enlarged, frame_of, heat, note
from taubench_gl.demos.stage import Props, Stage, built, hall
from taubench_gl.scene.builder import turn_y
from taubench_gl.selftest.bench import PairImages

FAR = 1e6


@built
def scene(b: Props, meters: float = FAR) -> None:
    """The hall ``meters`` from the origin along each axis; the camera moves and turns slightly."""
    b.root = b.node(translation=(meters,) * 3)
    hall(b)
    camera = b.camera(yfov=np.radians(60.0), znear=0.0625)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 1.5), (0.125, 0.0, 1.25)])
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(0.0), turn_y(3.0)])


def step_at(meters: float) -> float:
    """Spacing of float32 numbers at ``meters``."""
    return float(np.spacing(np.float32(meters)))


def extends(pair: PairImages) -> Array:
    """Pixels and axes along which the surface extends, so that its coordinate varies.  (h, w, 3) bool."""
    return pair.surface[..., None] & (np.abs(pair.current["normal"][..., :3]) < 0.5)


def in_world_floats(pair: PairImages, eye: Array) -> Array:
    """The current positions rounded to float32 in world space.  (h, w, 4) float64."""
    position = pair.current["position"].astype(np.float64)
    rounded = (position[..., :3] + eye).astype(np.float32) - eye
    return np.concatenate([np.where(pair.surface[..., None], rounded, 0.0), position[..., 3:]], axis=-1)


def rms(values: Array) -> float:
    """The root of the mean square of all values, in their unit."""
    return float(np.sqrt(np.mean(np.square(values))))


def expected_motion_error(pair: PairImages, step: float) -> Array:
    """Standard deviation of the error of motion, to first order, where positions have a spacing ``step``.  (h, w) px.

    Each axis has a uniform error within ± step / 2, so this is the derivative of Eq. (3) with respect to the position
    times step / sqrt(12), over the axes that vary.
    """
    q = pair.current["position"][..., :3] + pair.pair.camera_delta
    rows = pair.pair.prev_clip_from_prev[:, :3]
    x, y, w = (q @ rows[i] for i in (0, 1, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = [
            0.5 * side * (rows[i] - (value / w)[..., None] * rows[3])
            / w[..., None] for i, value, side in ((0, x, pair.pair.width), (1, y, pair.pair.height))
        ]  # fmt: skip
    return step / np.sqrt(12) * np.sqrt(sum(np.sum(np.square(s) * extends(pair), axis=-1) for s in slopes))


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The errors of float32 world positions a million meters from the origin, and of motion from them."""
    at_origin, far_away = (stage.bench.pair(scene(meters)) for meters in (0.0, FAR))
    moved = in_world_floats(far_away, far_away.view.position)
    position = far_away.current["position"].astype(np.float64)
    shift = (moved - position)[..., :3]
    in_history = far_away.surface & ~far_away.has(FRUSTUM)
    false = motion_error(far_away, moved)
    ours = np.linalg.norm(far_away.motion - at_origin.motion, axis=-1)

    def at(meters: float) -> tuple[Array, float, float, float]:
        """At ``meters`` from the origin: the error of motion from float32 world positions."""
        error = motion_error(far_away, in_world_floats(far_away, far_away.view.position - FAR + meters))
        predicted = rms(expected_motion_error(far_away, step_at(meters))[in_history])
        image = heat(np.log10(np.maximum(error, 1e-4)) + 4.0, 6.0)
        return image, rms(error[in_history]), predicted, 0.1 * predicted

    parameter = lesson.swept(at)
    _figure(lesson, far_away, shift, parameter)
    step = step_at(FAR)
    predicted = rms(expected_motion_error(far_away, step)[in_history])
    numbers = {
        "stored_position": (
            1000.0 * rms(shift[extends(far_away)]),
            Expected.near(1000.0 * step / np.sqrt(12), 50.0 * step / np.sqrt(12), 1),
        ),
        "camera_relative": (
            float(np.count_nonzero(ours) + np.count_nonzero(far_away.mask != at_origin.mask)),
            Expected.near(0.0, 0.0, 0),
        ),
        "motion": (rms(false[in_history]), Expected.near(predicted, 0.05 * predicted)),
    }
    most = np.sqrt(0.75) * step  # half a spacing along each axis
    return Measured(numbers, parameter, Screens(heat(np.linalg.norm(shift, axis=-1), most)))


def previous_px(pair: PairImages, position: Array) -> Array:
    """Eq. (3) in float64: positions relative to the current camera -> previous image, (h, w, 4) -> (h, w, 2) pixels.

    ``metrics.reproject`` gives motion: a stored position moves both ends of it, and the error is that of one end.
    """
    q = position[..., :3] + pair.pair.camera_delta
    x, y, w = (q @ pair.pair.prev_clip_from_prev[i, :3] for i in (0, 1, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([x / w, y / w], axis=-1) * 0.5 * np.array([pair.pair.width, pair.pair.height])


def motion_error(pair: PairImages, position: Array) -> Array:
    """The error of motion from ``position`` (h, w, 4), pixels; 0 where there is no history.  (h, w)."""
    exact = pair.current["position"].astype(np.float64)
    in_history = pair.surface & ~pair.has(FRUSTUM)
    away = np.where(in_history[..., None], previous_px(pair, position) - previous_px(pair, exact), 0.0)
    return np.linalg.norm(away, axis=-1)


def _figure(lesson: Lesson, pair: PairImages, shift: Array, parameter: Parameter) -> None:
    """Draw the hall with a frame, the error of x inside the frame, a row of its pixels, and the error of motion."""
    height, width = pair.mask.shape
    part = column_front(pair, int(0.42 * height), width // 4)
    sheet = lesson.sheet
    axes = sheet.panel(0, 0, lesson.pair.now["color"][..., :3], "the hall, a million meters from the origin")
    axes.add_patch(frame_of(*part))
    half = 50.0 * step_at(FAR)  # cm
    detail = enlarged(100.0 * shift[..., 0], *part)
    axes = sheet.panel(1, 0, heat(detail + half, 2.0 * half, "RdBu"), "in the frame: error of the stored x")
    note(axes, f"{100 * rms(shift[extends(pair)]):.2f} cm (RMS)")
    row = part[1] + part[3] // 2
    columns = np.arange(part[0], part[0] + part[2])
    exact = pair.current["position"].astype(np.float64)[row, columns, 0]
    axes = sheet.plot("row")
    axes.plot(columns, exact, color=BLUE, linewidth=1.6, label="exact")
    axes.step(columns, exact + shift[row, columns, 0], where="mid", color=RED, linewidth=2, label="stored, float32")
    axes.margins(y=0.25)
    axes = sheet.plot("motion")
    sheet.theory(axes, parameter.values, parameter.expected)
    sheet.dots(axes, parameter.values, parameter.measured)


def column_front(pair: PairImages, row: int, before: int) -> tuple[int, int, int, int]:
    """Left, top, width and height of a part of the image around ``row``: the first front left of column ``before``."""
    facing = pair.surface[row, :before] & (pair.current["normal"][row, :before, 2] > 0.9)
    near = facing & (pair.current["position"][row, :before, 3] < 3.5)
    columns = np.nonzero(near)[0]
    left, wide = int(columns[0]), len(columns)
    high = max(wide * pair.mask.shape[0] // pair.mask.shape[1], 2)
    return left, row - high // 2, wide, high
