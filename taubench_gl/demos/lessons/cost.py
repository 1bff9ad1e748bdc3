"""Demo 11: accuracy costs time, each further digit more than the one before."""

from __future__ import annotations

import math
import statistics
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.conventions import DEFAULT_THRESHOLD, Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens
from taubench_gl.demos.lessons.features import BALL_AT, ball_distance, scene
from taubench_gl.demos.sheet import BLACK, BLUE, INK, RED, Sheet, enlarged, overlay, scaled_to
from taubench_gl.demos.stage import Stage
from taubench_gl.demos.texts import lesson_text
from taubench_gl.evaluation import open_session
from taubench_gl.report.plot import pareto_steps

Size = tuple[int, int]
FPS, REPEATS = lesson_text("cost").opening.settings["fps"], 3
CONFIGURATIONS = (*((scale, 1) for scale in (0.25, 0.5, 0.75, 1.0)), (1.0, 4), (1.0, 16))
"""Resolution, samples per pixel."""

DOT_PT = 17.0
FINER = 6  # rays per pixel and axis for the exact share
FACETS = 0.003  # pp: the rendered ball has 64 x 128 facets inside the sphere


@dataclass(frozen=True, slots=True)
class Point:
    """A measured configuration: its share of discarded pixels, percent, and the median milliseconds of a frame."""

    scale: float
    samples: int
    percent: float
    milliseconds: float


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
    exact = exact_percent(size)
    details, masks = {}, []
    for place, percent in enumerate(lesson.text.parameter.values):
        scale = percent / 100
        w, h = scaled(size, scale)
        pair = stage.evaluate(scene(), columns=("frustum", "position", "color"), fps=FPS, width=w, height=h)[1][1]
        drawn = overlay(pair.mask, pair.now["color"], Reason.POSITION)
        masks.append(drawn)
        part = enlarged(drawn, int(0.3 * w), int(0.25 * h), max(w // 3, 4), max(h // 3, 4))
        details[percent] = scaled_to(part, (size[1] // 3, size[0] // 3))
        text = f"error {error_at(points, scale, exact):.3f} pp"
        lesson.sheet.panel(place, 0, part, f"{percent:g} % resolution: {w} x {h}, detail", text)
    _front(lesson.sheet, points, exact)
    numbers = {}
    for name, scale, samples in (("quarter", 0.25, 1), ("full", 1.0, 1), ("sixteen", 1.0, 16)):
        bound = slack(scaled(size, scale), samples)
        numbers[name] = error_at(points, scale, exact, samples), Expected.between(-np.inf, bound, 3)

    def at(percent: float) -> tuple[Array, float, float, float]:
        """At ``percent`` of the resolution: the error of the share."""
        return details[percent], error_at(points, percent / 100, exact), 0.0, slack(scaled(size, percent / 100))

    return Measured(numbers, lesson.swept(at), Screens(masks[0]))


def measured(stage: Stage) -> list[Point]:
    """The mean percentage of every configuration, and the median time of a frame in REPEATS turns of all frames."""
    ball, points = scene(), []
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
        points.append(Point(scale, samples, percent, statistics.median(times[1:])))
    return points


def error_at(points: list[Point], scale: float, exact: float, samples: int = 1) -> float:
    """The error of a configuration, ``scale`` and ``samples`` per pixel, against the ``exact`` share, pp."""
    return abs(next(p.percent for p in points if (p.scale, p.samples) == (scale, samples)) - exact)


def _front(sheet: Sheet, points: list[Point], exact: float) -> None:
    """Plot error against time, with the Pareto front and a numbered list of the configurations beside it."""
    axes = sheet.plot("front")
    timed_points = [(p, p.milliseconds, max(abs(p.percent - exact), 1e-4)) for p in points]
    line = pareto_steps((time, error) for _, time, error in timed_points)
    axes.step(*zip(*line), where="post", color=BLACK, linewidth=1.4, label="Pareto front")
    top = sheet.grid_bottom + 48
    timed_points.sort(key=lambda f: f[1])
    for i, (point, ms, error) in enumerate(timed_points, start=1):
        color = RED if (ms, error) in line else BLUE
        axes.plot([ms], [error], "o", color=color, markeredgecolor="black", markersize=DOT_PT, zorder=4)
        text = f"{i}   {_name(point)}: {error:.3f} pp, {ms:.1f} ms"
        sheet.text(880, top + 31 * (i - 1), text, size=12, color=color)
    axes.margins(x=0.08, y=0.25)
    sheet.key(axes, "upper right")
    _number(axes, [(time, error) for _, time, error in timed_points])


def _number(axes: Any, dots: list[tuple[float, float]]) -> None:
    """Write the number of each dot on it, or beside it where dots overlap."""
    axes.get_xlim(), axes.get_ylim()  # fixes the limits, which the positions depend on
    places = 72.0 / axes.figure.dpi * axes.transData.transform(dots)
    for i, (dot, (dx, dy)) in enumerate(zip(dots, beside(places, DOT_PT)), start=1):
        color = "white" if (dx, dy) == (0.0, 0.0) else INK
        axes.annotate(
            str(i), dot, (dx, dy), textcoords="offset points", color=color, fontsize=11, fontweight="bold", ha="center",
            va="center", zorder=5,
        )  # fmt: skip


def beside(places: Array, diameter: float) -> list[tuple[float, float]]:
    """Offset of the label of each dot from its center: (0, 0), or away from the dots that it overlaps.

    ``places`` (n, 2) and ``diameter`` in the same unit.  Labels of dots at the same position go left and right.
    """
    out = []
    for i, place in enumerate(places):
        overlapping = np.linalg.norm(places - place, axis=1) < diameter
        if overlapping.sum() == 1:
            out.append((0.0, 0.0))
            continue
        away = place - places[overlapping].mean(axis=0)
        length = float(np.linalg.norm(away))
        first = i == int(np.argmax(overlapping))
        unit = away / length if length > 1e-6 * diameter else np.array([-1.0 if first else 1.0, 0.0])
        out.append((float(diameter * unit[0]), float(diameter * unit[1])))
    return out


def _name(point: Point) -> str:
    """A configuration in words, resolution and samples per pixel: ``50 %, 4 samples``."""
    return f"{100 * point.scale:g} %, {point.samples} sample{'s' if point.samples > 1 else ''}"
