"""Demo 11: accuracy costs time, each further digit more than the one before."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Mapping

import numpy as np

from taubench_gl.conventions import DEFAULT_THRESHOLD, Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens
from taubench_gl.demos.lessons.features import BALL_AT, ball_distance, scene
from taubench_gl.demos.sheet import BLACK, BLUE, RED, Sheet, enlarged, overlay, scaled_to
from taubench_gl.demos.stage import Stage
from taubench_gl.demos.texts import lesson_text
from taubench_gl.evaluation import open_session
from taubench_gl.report.plot import pareto_steps

Size = tuple[int, int]
FPS, REPEATS = lesson_text("cost").opening.settings["fps"], 3
Configuration = tuple[float, int]
CONFIGURATIONS: tuple[Configuration, ...] = (*((scale, 1) for scale in (0.25, 0.5, 0.75, 1.0)), (1.0, 4), (1.0, 16))
"""Resolution, samples per pixel."""

FINER = 6  # rays per pixel and axis for the exact share
FACETS = 0.003  # pp: the rendered ball has 64 x 128 facets inside the sphere


def discarded(size: Size, pair: int) -> Array:
    """f_pos at every pixel of the pair (``pair``, ``pair`` + 1) of FPS frames a second: rays, float64.  (h, w) bool."""
    start, end = np.array(BALL_AT)
    before, now = (ball_distance(size, start + (end - start) * frame / FPS) for frame in (pair, pair + 1))
    return np.abs(now - before) > DEFAULT_THRESHOLD


def exact_percent(size: Size) -> float:
    """Mean share of the image that f_pos discards, percent, from FINER x FINER rays per pixel."""
    fine = (size[0] * FINER, size[1] * FINER)
    return 100.0 * float(np.mean([discarded(fine, pair).mean() for pair in range(int(FPS))]))


def scaled(size: Size, scale: float) -> Size:
    """``size`` (width, height) times ``scale``, in whole pixels, at least 1."""
    width, height = (max(1, round(side * scale)) for side in size)
    return width, height


def slack(size: Size, samples: int = 1) -> float:
    """Tolerance of the share counted with ``samples`` per pixel, pp: six standard deviations.

    Each of the E samples on the edges of a mask has a uniform error of ± half a sample, so the variance is E / 12.
    """
    finer = math.sqrt(samples)
    edges = [0.5 * finer * theory.edge_pixels(discarded(size, pair)) for pair in range(int(FPS))]
    deviation = math.sqrt(sum(edges) / 12.0) / len(edges)
    return 600.0 * deviation / (samples * size[0] * size[1]) + FACETS


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The error and the time of each configuration."""
    size, points = stage.size, measured(stage)
    details, masks = {}, []
    for place, percent in enumerate(lesson.text.parameter.values):
        w, h = scaled(size, percent / 100)
        pair = stage.evaluate(scene(), columns=("frustum", "position", "color"), fps=FPS, width=w, height=h)[1][1]
        drawn = overlay(pair.mask, pair.now["color"], Reason.POSITION)
        masks.append(drawn)
        part = enlarged(drawn, int(0.3 * w), int(0.25 * h), max(w // 3, 4), max(h // 3, 4))
        details[percent] = scaled_to(part, (size[1] // 3, size[0] // 3))
        text = f"error {points[percent / 100, 1][0]:.3f} pp"
        lesson.sheet.panel(place, 0, part, f"{percent:g} % resolution: {w} x {h}, detail", text)
    _front(lesson.sheet, points)
    numbers = {}
    for name, scale, samples in (("quarter", 0.25, 1), ("full", 1.0, 1), ("sixteen", 1.0, 16)):
        bound = slack(scaled(size, scale), samples)
        numbers[name] = points[scale, samples][0], Expected.between(-np.inf, bound, 3)

    def at(percent: float) -> tuple[Array, float, float, float]:
        """At ``percent`` of the resolution: the error of the share."""
        return details[percent], points[percent / 100, 1][0], 0.0, slack(scaled(size, percent / 100))

    return Measured(numbers, lesson.swept(at), Screens(masks[0]))


def measured(stage: Stage) -> dict[Configuration, tuple[float, float]]:
    """The error of the mean share, pp, and the median time of a frame in REPEATS turns of all frames, ms."""
    ball, exact, points = scene(), exact_percent(stage.size), {}
    for scale, samples in CONFIGURATIONS:
        w, h = scaled(stage.size, scale)
        settings = stage.settings(
            fps=FPS, columns=("frustum", "position"), width=w, height=h, samples_per_pixel=samples
        )
        times = []
        with open_session(ball, settings) as session:
            for _ in range(REPEATS + 1):  # the first turn compiles shaders
                started = time.perf_counter()
                frames = 1 + sum(1 for _ in session.pairs())
                times.append(1e3 * (time.perf_counter() - started) / frames)
            percent = session.summary()["discard"]["position"]["mean_percent"]
        points[scale, samples] = abs(percent - exact), statistics.median(times[1:])
    return points


def _front(sheet: Sheet, points: Mapping[Configuration, tuple[float, float]]) -> None:
    """Plot error against time, with the Pareto front and a numbered list of the configurations beside it."""
    axes = sheet.plot("front")
    by_time = sorted((ms, max(error, 1e-4), *configuration) for configuration, (error, ms) in points.items())
    line = pareto_steps(point[:2] for point in by_time)
    axes.step(*zip(*line), where="post", color=BLACK, linewidth=1.4, label="Pareto front")
    for i, (ms, error, scale, samples) in enumerate(by_time, start=1):
        color = RED if (ms, error) in line else BLUE
        axes.plot([ms], [error], "o", color=color, markeredgecolor="black", markersize=9, zorder=4)
        # The front comes from above and goes on to the right: two other sides, in turn for dots that are close.
        side = 1 if i % 2 else -1
        axes.annotate(str(i), (ms, error), (10 * side, 9 * side), textcoords="offset points", color=color, fontsize=11,
                      fontweight="bold", ha="center", va="center", zorder=5)  # fmt: skip
        name = f"{100 * scale:g} %, {samples} sample{'s' if samples > 1 else ''}"
        place = 880, sheet.grid_bottom + 48 + 31 * (i - 1)
        sheet.text(*place, f"{i}   {name}: {error:.3f} pp, {ms:.1f} ms", size=12, color=color)
    axes.margins(x=0.08, y=0.25)
