"""Demo 10: ghosting, and methods that prevent it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens
from taubench_gl.demos.sheet import BLACK, BLUE, RED, VIOLET, Sheet, displayed
from taubench_gl.demos.stage import Props, Stage, built, checkered
from taubench_gl.demos.texts import lesson_text
from taubench_gl.frame.targets import read_channel
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.response import response_frames
from taubench_gl.scene.builder import sphere

FRAMES = lesson_text("ghosting").opening.frame + 1
ALPHA = 0.1
AGE = 5  # frames since a pixel was disoccluded, for the number
GLOW = (2.0, 0.75, 0.1)
TILE = (0.10, 0.30)


def untested(alpha: float) -> str:
    """The method that averages all history, as on the command line.  ``alpha``: weight of the new frame."""
    return f"taa_clamp@alpha={alpha}@clamping=false@weighting=false@dilate=false@filtering=nearest"


METHODS = {
    "history not tested": (untested(ALPHA), RED, "o"),
    "clamped to neighborhood colors": (f"taa_clamp@alpha={ALPHA}", VIOLET, "s"),
    "position and normal tested": ("bmfr_temporal", BLUE, "^"),
    "masks of the exact frames": ("ideal-masks", BLACK, "D"),
}
MARKER_PT = (6, 14, 9, 4)
"""Sizes in the order of METHODS: three curves coincide, so each marker is visible around the next."""


@built
def scene(b: Props) -> None:
    """An emissive ball crosses an emissive checkered wall: all radiances are known, there is no other light."""
    tiles = [b.glow(v, v, 1.15 * v) for v in TILE]
    b.thing(*checkered(6.0, 4.0, (24, 16), tiles), translation=(0, 0, -6))
    ball = b.thing(dataclasses.replace(sphere(0.55, 48), material=b.glow(*GLOW)))
    b.animate(ball, "translation", [0.0, float(FRAMES - 1)], [(-1.9, 0.25, -4.4), (1.5, -0.2, -4.4)])
    b.camera(yfov=np.radians(42.0), znear=0.05)


@dataclass(slots=True)
class Trail:
    """The last image of a method, and the weight of the ball that remains in it, by frames since the ball left."""

    image: Array
    weights: dict[int, float]


def run_methods(stage: Stage, texts: Mapping[str, str]) -> dict[str, Trail]:
    """The last image of every method and its remaining ball weight by age.  ``texts``: specification by name."""
    age = np.zeros(stage.size[::-1], dtype=int)
    with stage.reuse(scene(), texts, reads=("ids",)) as (inputs, runners):
        for frame in range(FRAMES):
            channels = inputs.advance(frame)
            images = {name: read_result(runner.step(channels))[..., :3] for name, runner in runners.items()}
            reference = read_channel(channels.textures["radiance"], "radiance")[..., :3].astype(np.float64)
            ball = reference[..., 0] > 0.5 * (GLOW[0] + TILE[1])
            age = np.where(ball, 1, np.where(age > 0, age + 1, 0))
    age = np.where(ball, 0, np.maximum(age - 1, 0))
    return {name: Trail(image, ghost_by_age(image, reference, age)) for name, image in images.items()}


def ghost_by_age(image: Array, reference: Array, age: Array) -> dict[int, float]:
    """Weight of the ball in ``image`` by age: (image - wall) / (ball - wall) of the red channel.

    Median over the pixels of an age, so that the mixed pixels at the ball's edge have no influence.
    """
    red = reference[..., 0]
    share = (image[..., 0] - red) / np.where(age > 0, GLOW[0] - red, 1.0)
    return {int(k): float(np.median(share[age == k])) for k in np.unique(age) if k > 0}


def response(trail: Trail) -> float:
    """Response time: frames until the squared weight of the ball is a tenth of that in the first frame without it."""
    return float(response_frames(np.array([trail.weights[age] ** 2 for age in sorted(trail.weights)]), 0.0))


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The ghost of the ball in four methods, and its decay."""
    texts = {name: text for name, (text, _, _) in METHODS.items()}
    blended = {f"{alpha:g}": untested(alpha) for alpha in lesson.text.parameter.values}
    images = run_methods(stage, texts | blended)
    trails = {name: images[name] for name in texts}
    for place, (name, trail) in enumerate(trails.items()):
        text = f"{100 * trail.weights.get(AGE, np.nan):.1f} % after {AGE} frames"
        lesson.sheet.panel(place, 0, displayed(trail.image), name, text)
    _plot(lesson.sheet, trails)
    first, clamped, tested, ideal = trails
    left, tenth = 100 * (1 - ALPHA) ** AGE, math.ceil(math.log(0.1) / (2 * math.log(1 - ALPHA)))
    numbers = {
        "untested": (100 * trails[first].weights[AGE], Expected.near(left, 0.01 * left)),
        "response": (response(trails[first]), Expected.near(tenth, 0, digits=0)),
        "clamped": (100 * trails[clamped].weights[AGE], Expected.between(-np.inf, 0.5 * left)),
        "tested": (100 * trails[tested].weights[AGE], Expected.near(0.0, 0.1)),
        "exact": (100 * trails[ideal].weights[AGE], Expected.near(0.0, 0.1)),
    }

    def at(alpha: float) -> tuple[Array, float, float, float]:
        """With a weight ``alpha`` of the new frame: what remains of the ball in history that is not tested."""
        trail, left = images[f"{alpha:g}"], 100.0 * (1.0 - alpha) ** AGE
        return displayed(trail.image), 100.0 * trail.weights[AGE], left, 0.01 * left + 1e-3

    parameter = lesson.swept(at)
    return Measured(numbers, parameter, Screens(parameter.picture(parameter.start)))


def _plot(sheet: Sheet, trails: dict[str, Trail]) -> None:
    """Plot what remains of the ball against the frames since it left."""
    axes = sheet.plot("decay")
    k = np.linspace(1, FRAMES, 200)
    axes.plot(k, 100 * (1 - ALPHA) ** k, color=BLACK, linewidth=1.4, linestyle="--", label=f"theory: (1 - {ALPHA})^k")
    for i, (name, trail) in enumerate(trails.items()):
        _, color, marker = METHODS[name]
        ages, size = sorted(trail.weights), MARKER_PT[i]
        values = [100 * trail.weights[a] for a in ages]
        axes.plot(ages, values, marker=marker, markersize=size, color=color, linewidth=size / 3, label=name)
