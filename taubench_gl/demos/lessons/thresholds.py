"""Demo 9: a threshold is a point on a curve."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import DEFAULT_THRESHOLD, Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, beyond
from taubench_gl.demos.sheet import BLACK, Sheet, gray_image, overlay
from taubench_gl.demos.stage import BRICK, CHALK, GOLD, LEAF, SAND, Props, Stage, built
from taubench_gl.report.palette import hex_of
from taubench_gl.report.run_plots import discard_curve
from taubench_gl.scene.model import Camera
from taubench_gl.selftest.bench import to_pixels

Size = tuple[int, int]
YFOV = np.radians(45.0)
WALL, KEYS = -6.0, -4.8
STEPS_CM = (1, 2, 4, 8, 16, 32, 64, 128)
HALF = 0.36
SHOWN = {"cm_3": 0.03, "paper": DEFAULT_THRESHOLD, "cm_50": 0.5}


def places() -> Array:
    """Centers of the keys in the previous frame, four per row.  (8, 3) meters."""
    x = (np.arange(8) % 4 - 1.5) * 1.02
    y = np.where(np.arange(8) < 4, 0.85, -0.85)
    return np.stack([x, y, np.full(8, KEYS)], axis=-1)


@built
def scene(b: Props) -> None:
    """Eight square keys in front of a wall; in one second each approaches by its own step, 1 cm to 128 cm."""
    b.wall(9.0, 6.0, CHALK, translation=(0, 0, WALL))
    colors = (SAND, BRICK, GOLD, LEAF)
    for i, (place, step) in enumerate(zip(places(), STEPS_CM)):
        key = b.wall(HALF, HALF, colors[(i + i // 4) % 4], translation=place)
        b.animate(key, "translation", [0.0, 1.0], [place, place + [0, 0, step / 100]])
    b.light(translation=(1.0, 2.5, 0.0), intensity=60.0)
    b.camera(yfov=YFOV, znear=0.05)


def distances(size: Size) -> Array:
    """Distance between the surface points of the two frames at every pixel, by ray-square intersection.  (h, w) m."""
    rays = theory.pixel_rays(size, YFOV)
    depths = []
    for moved in (0.0, 1.0):
        depth = np.full(rays.shape[:2], -WALL)
        for place, step in zip(places(), STEPS_CM):
            z = -(place[2] + moved * step / 100)
            inside = (np.abs(rays[..., :2] * z - place[:2]) <= HALF).all(axis=-1)
            depth = np.where(inside, np.minimum(depth, z), depth)
        depths.append(depth)
    return np.linalg.norm(rays, axis=-1) * np.abs(depths[1] - depths[0])


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The masks of three thresholds, and the curve of all."""
    columns, runs, masks = ("frustum", "position", "color"), {}, {}
    for name, threshold in SHOWN.items():
        settings = {"columns": columns, "thresholds": {"position": threshold}, "shadow_lights": 0}
        runs[name], (masks[threshold],) = stage.evaluate(scene(), **settings)
    edges, percent = discard_curve(runs["paper"].summary["curves"]["position"], stage.pixels)
    expected, sheet = distances(stage.size), lesson.sheet
    for place, (threshold, pair) in enumerate(masks.items()):
        marked = overlay(pair.mask, pair.now["color"], Reason.POSITION)
        whose = ", the paper's 32/255 m" if threshold == DEFAULT_THRESHOLD else ""
        text = f"{pair.percent(Reason.POSITION):.2f} % discarded"
        axes = sheet.panel(place, 0, marked, f"threshold {100 * threshold:.3g} cm{whose}", text)
        _name_keys(axes, stage.size)
    _staircase(sheet, edges, percent, expected, masks)
    numbers = {}
    for name in ("paper", "cm_3", "cm_50"):
        numbers[name] = masks[SHOWN[name]].percent(Reason.POSITION), Expected.share(expected > SHOWN[name])
    # At a bin edge the curve and a mask with that threshold count the same pixels.
    at = int(np.argmin(np.abs(edges - 0.25)))
    # A mask discards greater distances, a bin holds distances from its edge on.
    below = float(np.nextafter(np.float32(edges[at]), np.float32(0)))
    exact = stage.pair(scene(), columns=("frustum", "position"), thresholds={"position": below})
    off = abs(round(percent[at] / 100 * stage.pixels) - int(exact.has(Reason.POSITION).sum()))
    numbers["curve"] = float(off), Expected.near(0.0, 0.0, 0)
    moved, gray = lesson.pair.change("position"), gray_image(lesson.pair)
    return Measured(numbers, lesson.threshold(moved, gray, beyond(expected), Reason.POSITION))


def _name_keys(axes: object, size: Size) -> None:
    """Write on each key of a panel by how many centimeters it moves."""
    for place, step in zip(places(), STEPS_CM):
        at = to_pixels(place + [0, 0, step / 100], size, Camera(yfov=YFOV))
        axes.text(*at, str(step), color="white", fontsize=12, fontweight="bold", ha="center", va="center")


def _staircase(sheet: Sheet, edges: Array, percent: Array, expected: Array, masks: dict) -> None:
    """Plot the recorded discard rate against the threshold, with its theory and the counts of the masks."""
    axes = sheet.plot("rate")
    axes.set_ylim(0, 1.08 * percent.max())
    axes.plot(edges, percent, color=hex_of("position"), linewidth=2.6, label="recorded by the run")
    line = np.logspace(-2.4, 0.5, 1200)
    share = theory.shares_above(expected, line)
    axes.plot(line, share, color=BLACK, linewidth=1.4, linestyle="--", label="theory: ray-square intersection")
    for threshold, pair in masks.items():
        value = pair.percent(Reason.POSITION)
        axes.plot([threshold], [value], "o", color=hex_of("position"), markeredgecolor="black", markersize=9, zorder=5)
        name = "32/255" if threshold == DEFAULT_THRESHOLD else f"{threshold:g}"
        axes.annotate(f"{name} m: {value:.1f} %", (threshold, value), (8, 9), textcoords="offset points", fontsize=12)
