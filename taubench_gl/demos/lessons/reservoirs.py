"""Demo 19: what a reservoir of light samples remembers, and for how long."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens
from taubench_gl.demos.sheet import BLACK, BLUE, RED, Sheet, displayed, magnified, rgb
from taubench_gl.demos.stage import Props, Stage, built
from taubench_gl.demos.texts import lesson_text
from taubench_gl.demos.theory import share_deviation
from taubench_gl.frame.targets import read_channel
from taubench_gl.reuse.frame import FrameInputs, read_result
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.sample_rays import SampleRays
from taubench_gl.reuse.samples import history_counts

SIZE = (96, 54)  # path-traced input takes long on a CPU
BORN, AGE = lesson_text("reservoirs").opening.frame, 5
"""Frame in which the second lamp is switched on, and the frames after which it is looked at; then it is off again."""

LIMIT = 8
SHARE = 0.5  # of the light that the second lamp gives
SIGMAS = 4.0
"""Half width of the ranges, in standard deviations of a share of independent pixels."""

SETTINGS = {"fps": 1.0, "bounces": 1, "width": SIZE[0], "height": SIZE[1]}
METHOD = "restir-di@candidates=4@neighbors=0@visibility_reuse=false@combination=biased@history_limit="


@built
def scene(b: Props) -> None:
    """A wall that one lamp lights; from frame BORN on, for AGE frames, a second one as bright at the same place."""
    b.wall(9.0, 6.0, (0.7, 0.7, 0.7), translation=(0.0, 0.0, -4.0))
    for second in (False, True):
        lamp = b.light(translation=(0.6, 0.5, -2.0), intensity=4.0)
        if second:
            times = [0.0, BORN - 0.5, BORN + AGE - 0.5]
            b.animate(lamp, "scale", times, [(0.0,) * 3, (1.0,) * 3, (0.0,) * 3], "STEP")
    b.still_camera(np.radians(42.0), BORN + AGE)


def remembered(limit: int, frames: int) -> tuple[float, float]:
    """What is expected some ``frames`` after a lamp that gives SHARE of the light is switched on.

    Returns the share of reservoirs that hold it, and the light of the image as a share of the right one.

    History counts ``limit`` times as much as a frame: its light is an exponential moving average, and a reservoir
    holds each lamp in proportion to that lamp's part of it.
    """
    new = SHARE * (1.0 - (limit / (limit + 1.0)) ** frames)
    light = 1.0 - SHARE + new
    return new / light, light


@dataclass(slots=True)
class Memory:
    """What reservoirs with one limit remember of the second lamp.

    ``shares``: of the reservoirs that hold it, by frames since it was switched on; ``held`` (h, w) and ``light``, AGE
    frames after: the lamp that each pixel holds, and the light of the image as a share of the right one; ``wrong``: the
    share of kept history whose lamp is off, one frame later.
    """

    shares: list[float]
    held: Array
    light: float
    wrong: float


def run_limits(stage: Stage, limits: Sequence[int]) -> tuple[dict[int, Memory], tuple[Array, Array]]:
    """What reservoirs remember by limit, and images of the right light before and after the birth."""
    texts = {"right": "ris@candidates=4"} | {str(limit): f"{METHOD}{limit}" for limit in limits}
    shares: dict[str, list[float]] = {name: [] for name in texts}
    memories, images = {}, {}
    with stage.reuse(scene(), texts, "path-traced@1", ("motion", "mask"), **SETTINGS) as (inputs, runners):
        for number in range(BORN + AGE):
            frame = inputs.advance(number)
            results = {name: read_result(runner.step(frame))[..., :3] for name, runner in runners.items()}
            images[number] = results["right"]
            kept = {name: runner.reported(frame)["kept_sample"][..., 0] for name, runner in runners.items()}
            for name in texts if number >= BORN else ():
                shares[name].append(float(np.mean(kept[name] == 1)))
        light = {name: float(image.mean()) / float(results["right"].mean()) for name, image in results.items()}
        frame = inputs.advance(BORN + AGE)
        with SampleRays(stage.gpu, frame.light, inputs.size, 1.0) as rays:
            for limit in limits:
                runner = runners[str(limit)]
                runner.step(frame)
                memory = shares[str(limit)], kept[str(limit)], light[str(limit)], wrong_keeps(runner, frame, rays)
                memories[limit] = Memory(*memory)
    return memories, (images[BORN - 1], images[BORN])


def wrong_keeps(runner: MethodRunner, frame: FrameInputs, rays: SampleRays) -> float:
    """Share of the history reservoirs that the last step kept whose light no longer reaches the pixel."""
    facts = rays.of(runner.reported(frame), frame.textures["motion"], np.zeros(0))
    kept, wrong, *_ = history_counts(facts, read_channel(frame.textures["mask"], "mask")[..., 0]).sum(axis=0)
    return float(wrong / kept)


def tolerance(share: float) -> float:
    """SIGMAS standard deviations of the share of pixels, percent: each holds a lamp independently of the others."""
    return 100.0 * SIGMAS * share_deviation(share, SIZE[0] * SIZE[1])


def run(stage: Stage, lesson: Lesson) -> Measured:
    """Which lamp reservoirs hold, and the light of the image, some frames after a second lamp was switched on."""
    memories, images = run_limits(stage, [int(limit) for limit in lesson.text.parameter.values])
    memory, (share, light) = memories[LIMIT], remembered(LIMIT, AGE)
    numbers = {
        "pixels": (100 * memory.shares[-1], Expected.near(100 * share, tolerance(share))),
        "light": (100 * memory.light, Expected.near(100 * light, 0.1)),
        "wrong_history": (100 * memory.wrong, Expected.near(100 * share, tolerance(share))),
    }
    for place, (limit, one) in enumerate(memories.items()):
        lesson.sheet.panel(place, 0, lamps_held(one.held), f"limit {limit}", f"{100 * one.shares[-1]:.1f} %")
    _plot(lesson.sheet, memories)
    frames = tuple(magnified(displayed(image)) for image in images)

    def at(limit: float) -> tuple[Array, float, float, float]:
        """With history that stands for ``limit`` frames: the share of reservoirs that hold the new lamp."""
        one, expected = memories[int(limit)], remembered(int(limit), AGE)[0]
        return lamps_held(one.held), 100 * one.shares[-1], 100 * expected, tolerance(expected)

    return Measured(numbers, lesson.swept(at), Screens(lamps_held(memory.held), frames))


def lamps_held(held: Array) -> Array:
    """Pixels that hold the first lamp and the second one, enlarged, (4 h, 4 w, 3) uint8."""
    return magnified(np.where((held == 1)[..., None], np.uint8(rgb(RED)), np.uint8(rgb(BLACK))))


def _plot(sheet: Sheet, memories: Mapping[int, Memory]) -> None:
    """Plot the share of reservoirs that hold the new lamp against the frames with it, for each limit."""
    axes = sheet.plot("shares")
    frames = np.arange(1, AGE + 1)
    for i, (limit, memory) in enumerate(memories.items()):
        shares = [100 * remembered(limit, int(n))[0] for n in frames]
        axes.plot(frames, shares, color=BLACK, linewidth=1.4, linestyle="--", label="theory" if i == 0 else None)
        axes.plot(frames, 100 * np.array(memory.shares), "osD^v"[i], color=BLUE, markersize=8, label=f"limit {limit}")
