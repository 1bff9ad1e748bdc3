"""Demo 15: noise of path-traced light falls with the square root of the samples."""

from __future__ import annotations

import math

import numpy as np

from taubench_gl.conventions import DEFAULT_THRESHOLD, Reason
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens, percent
from taubench_gl.demos.sheet import RED, Sheet, as_bytes, displayed, magnified, overlay
from taubench_gl.demos.stage import Props, Stage, built, corner
from taubench_gl.demos.texts import lesson_text
from taubench_gl.demos.theory import normal_change
from taubench_gl.scene.builder import quad, turn_x

SIZE = (96, 54)  # path tracing takes long on a CPU
COUNTS = (1, 4, 16, 64)
SHOWN = (1, 64)
FRAMES = 2 * COUNTS[-1]
PATHS = lesson_text("samples").opening.settings


@built
def scene(b: Props) -> None:
    """A static corner of a room under a glowing panel."""
    corner(b)
    b.thing(quad(1.2, 0.5, material=b.glow(9.0)), translation=(0.4, 2.0, -4.2), rotation=turn_x(90))
    b.still_camera(np.radians(50.0), FRAMES - 1.0)


def light(stage: Stage, samples: int, frames: int) -> Array:
    """Direct light of ``frames`` frames with independent numbers.  (frames, h, w, 3)."""
    settings = PATHS | {"spp": samples, "width": SIZE[0], "height": SIZE[1]}
    return np.stack([shot.direct for shot in stage.bench.shots(scene(), range(frames), **settings)])


def means(frames: Array, count: int) -> Array:
    """Means of groups of ``count`` frames.  (n, h, w, 3) -> (n / count, h, w, 3)."""
    return frames.reshape(-1, count, *frames.shape[1:]).mean(axis=1)


def noise(images: Array) -> float:
    """RMS over the pixels of the standard deviation of images (n, h, w, 3), the norm of R, G and B."""
    return float(np.sqrt(np.mean(images.var(axis=0, ddof=1).sum(axis=-1))))


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The noise of means of path-traced frames, and what a threshold discards of them."""
    frames = light(stage, 1, FRAMES)
    noises = {count: noise(means(frames, count)) for count in COUNTS}
    stratified = {count: noise(light(stage, count, 2)) for count in COUNTS[1:]}
    sigma = np.sqrt(frames.var(axis=0, ddof=1).sum(axis=-1))
    pairs = {count: means(frames, count)[:2] for count in COUNTS}
    masks = {count: stage.bench.compare({"direct": b}, {"direct": a}).mask for count, (a, b) in pairs.items()}
    rejected = {count: percent((mask & Reason.DIRECT) != 0) for count, mask in masks.items()}
    for place, count in enumerate(SHOWN):
        image = overlay(masks[count], displayed(pairs[count][1]), Reason.DIRECT)
        text = f"{rejected[count]:.1f} % discarded, noise {noises[count]:.4f}"
        lesson.sheet.panel(
            place, 0, image, f"mean of {count} frame{'s' * (count > 1)}, one sample per pixel each", text
        )
    _plots(lesson.sheet, noises, stratified, rejected, sigma)
    slope = float(np.polyfit(np.log(COUNTS), np.log(list(noises.values())), 1)[0])
    share = normal_change(DEFAULT_THRESHOLD, sigma, 16)
    numbers = {
        "noise": (noises[64] / noises[4], Expected.near(0.25, 0.02, 3)),
        "slope": (slope, Expected.near(-0.5, 0.03, 3)),
        "discarded": (rejected[16], Expected.near(share, 0.1 * share + 0.5)),
    }

    def at(count: float) -> tuple[Array, float, float, float]:
        """With ``count`` frames in a mean: the mean and its noise."""
        law = noises[1] / math.sqrt(count)
        return mean_image(pairs[int(count)][1]), noises[int(count)], law, 0.08 * law

    screens = Screens(mean_image(pairs[64][1]), tuple(map(mean_image, pairs[4])))
    return Measured(numbers, lesson.swept(at), screens)


def mean_image(light: Array) -> Array:
    """Direct light (h, w, 3) as an enlarged image, uint8."""
    return as_bytes(magnified(displayed(light)))


def _plots(
    sheet: Sheet, noises: dict[int, float], stratified: dict[int, float], rejected: dict[int, float], sigma: Array
) -> None:
    """Plot noise and discard rate of a static room against the samples per pixel, with their theory."""
    line = np.geomspace(1, 256, 30)
    left, right = sheet.plot("noise"), sheet.plot("rate")
    sheet.theory(left, line, noises[1] / np.sqrt(line), "theory: N^(-1/2)")
    sheet.dots(left, list(noises), list(noises.values()), "N frames")
    left.plot(list(stratified), list(stratified.values()), "s", color=RED, markeredgecolor="black", markersize=7,
              label="one frame, N samples")  # fmt: skip
    right.set_ylim(0, 1.2 * max(rejected.values()))
    normal = line[line >= 4]
    sheet.theory(right, normal, [normal_change(DEFAULT_THRESHOLD, sigma, n) for n in normal], "theory: normal noise")
    sheet.dots(right, list(rejected), list(rejected.values()), "N frames")
