"""Demo 16: jitter that stays in motion vectors blurs, shakes or shifts what is accumulated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens
from taubench_gl.demos.sheet import BLACK, BLUE, RED, VIOLET, Sheet, displayed, enlarged, enlarged_frames
from taubench_gl.demos.stage import Props, Stage, built
from taubench_gl.frame.targets import write_channel
from taubench_gl.reuse.frame import read_result
from taubench_gl.scene.builder import quad, turn

YFOV, DEPTH = np.radians(42.0), 4.0
SLOPE = 1.0 / 7.3  # pixels to the right per pixel upwards: rows meet the edge at all sub-pixel positions
DARK, BRIGHT = 0.05, 0.8
FRAMES, ALPHA = 40, 0.1
REACH = 20  # pixels to either side of the edge in which its spread is measured

Error = Callable[[Array, Array], Array]
CASES: Mapping[str, tuple[Error, str]] = {
    "jitter removed: correct": (lambda now, before: np.zeros(2), BLACK),
    "jitter left in the motion": (lambda now, before: now - before, RED),
    "removed with the wrong sign": (lambda now, before: 2.0 * (before - now), BLUE),
    "only removed from one frame": (lambda now, before: now, VIOLET),
}
"""Name -> error of the motion vectors (2,), pixels, +y up, from the offsets of both frames; color in the plot."""


def slanted(b: Props, dark: float, bright: float, half: float, aside: float = 0.0) -> None:
    """Add a dark wall and before it a bright rectangle, 2 ``half`` meters wide, along a line of SLOPE; both emissive.

    ``aside``: meters from the center of the image to the middle line of the rectangle.
    """
    lean = np.arctan(SLOPE)
    middle = aside * np.array([np.cos(lean), -np.sin(lean), 0.0]) + [0, 0, -DEPTH]
    b.thing(quad(12.0, 8.0, material=b.glow(dark)), translation=(0, 0, -DEPTH - 0.01))
    slant = turn((0, 0, 1), -np.degrees(lean))
    b.thing(quad(half, 12.0, material=b.glow(bright)), translation=middle, rotation=slant)


@built
def scene(b: Props) -> None:
    """A bright half-plane on a dark one; the edge goes through the center.  Nothing moves."""
    slanted(b, DARK, BRIGHT, 6.0, 6.0)
    b.still_camera(YFOV, FRAMES - 1.0)


@dataclass(frozen=True, slots=True)
class Spread:
    """Where an edge is: pixels to the right of the true edge, and its standard deviation in pixels."""

    shift: float
    sigma: float


def predicted(error: Error, alpha: float, frames: int = FRAMES) -> Spread:
    """The spread of an edge under an exponential average with bilinear history, by its first two moments.

    A frame shows the edge at -u, u = j_x - SLOPE j_y for the offset j of its samples, rounded to pixel centers: a
    variance of 1/12 over the rows.  Bilinear history at an error e shifts by -(e_x - SLOPE e_y) and adds the variance
    f (1 - f) of its two weights along each axis, f the fraction of e.
    """
    mean = second = 0.0
    for frame in range(frames):
        offset, before = halton_jitter(frame), halton_jitter(max(frame - 1, 0))
        u = offset[0] - SLOPE * offset[1]
        if frame == 0:
            mean, second = -u, u * u + 1.0 / 12.0
            continue
        e = error(offset, before)
        fraction = e - np.floor(e)
        blur = fraction * (1.0 - fraction)
        step = -(e[0] - SLOPE * e[1])
        moved = second + 2.0 * mean * step + step * step + blur[0] + SLOPE**2 * blur[1]
        second = alpha * (u * u + 1.0 / 12.0) + (1.0 - alpha) * moved
        mean = alpha * -u + (1.0 - alpha) * (mean + step)
    return Spread(mean, float(np.sqrt(second - mean * mean)))


def from_edge(shape: tuple[int, ...]) -> Array:
    """Distance of each pixel of an image of ``shape`` (h, w) to the right of the true edge.  (h, w) pixels."""
    height, width = shape
    row = np.arange(height)[:, None]
    return np.arange(width) - (0.5 * (width - 1) + SLOPE * (0.5 * (height - 1) - row))


def measured(image: Array) -> Spread:
    """The spread of the edge in an image (h, w), over the rows in which it is REACH pixels inside."""
    height, width = image.shape
    row = np.arange(height)
    rows = row[(np.abs(row - 0.5 * (height - 1)) < 0.5 * min(height, width // 2) - 4)]
    place = from_edge(image.shape)[rows, :-1] + 0.5
    weight = np.diff(image[rows], axis=1) * (np.abs(place) < REACH)
    total = weight.sum()
    mean = float((weight * place).sum() / total)
    return Spread(mean, float(np.sqrt((weight * place**2).sum() / total - mean * mean)))


def accumulated(stage: Stage, runs: Mapping[str, tuple[Error, float]]) -> dict[str, Array]:
    """The last image (h, w, 3) of every run: an error of the motion vectors, and a weight of the new frame."""
    texts = {
        name: f"taa_clamp@alpha={alpha}@clamping=false@weighting=false@dilate=false@filtering=bilinear"
        for name, (_, alpha) in runs.items()
    }
    still, images = np.ones((*stage.size[::-1], 2), dtype=np.float32), {}
    with stage.reuse(scene(), texts, "jittered") as (inputs, runners):
        for frame in range(FRAMES):
            channels = inputs.advance(frame)
            for name, runner in runners.items():
                error = runs[name][0](channels.jitter_px, channels.prev_jitter_px) * [1.0, -1.0]  # rows go down
                write_channel(channels.textures["motion"], "motion", still * np.float32(error))
                result = runner.step(channels)
                if frame == FRAMES - 1:
                    images[name] = read_result(result)[..., :3].astype(np.float64)
    return images


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The spread and the shift of an edge, with right and with wrong motion vectors."""
    weights = {f"{alpha:g}": (CASES["jitter left in the motion"][0], alpha) for alpha in lesson.text.parameter.values}
    cases = {name: (error, ALPHA) for name, (error, _) in CASES.items()}
    images = accumulated(stage, cases | weights)
    spreads = {name: measured(profile_image(image)) for name, image in images.items()}
    theory = {name: predicted(*settings) for name, settings in (cases | weights).items()}
    width, height = stage.size
    side = (32, 18)
    part = (width // 2 - side[0] // 2, height // 2 - side[1] // 2, *side)
    details = {name: enlarged(displayed(image), *part) for name, image in images.items()}
    for place, name in enumerate(CASES):
        text = f"spread {spreads[name].sigma:.2f} px, shift {spreads[name].shift:+.2f} px"
        lesson.sheet.panel(place, 0, details[name], name, text)
    _plot(lesson.sheet, {name: images[name] for name in CASES}, spreads)
    right, left_in, sign, forgotten = CASES
    numbers = {
        "left_in": (spreads[left_in].sigma, _near(theory[left_in].sigma)),
        "removed": (spreads[right].sigma, _near(theory[right].sigma)),
        "wrong_sign": (spreads[sign].sigma, _near(theory[sign].sigma)),
        "shift_one_frame": (spreads[forgotten].shift, Expected.near(theory[forgotten].shift, 0.03)),
        "shift_removed": (spreads[right].shift, Expected.near(theory[right].shift, 0.03)),
    }

    def at(alpha: float) -> tuple[Array, float, float, float]:
        """With a weight ``alpha`` of the new frame: the spread of the edge with jitter in the motion vectors."""
        name = f"{alpha:g}"
        return details[name], spreads[name].sigma, theory[name].sigma, 0.03 * theory[name].sigma

    return Measured(numbers, lesson.swept(at), Screens(details[left_in], enlarged_frames(lesson.pair, *part)))


def _near(value: float) -> Expected:
    """The range ``value`` ± 3 %."""
    return Expected.near(value, 0.03 * value)


def profile_image(image: Array) -> Array:
    """Radiance (h, w, 3) as 0 on the dark and 1 on the bright side.  (h, w)."""
    return (image[..., 0] - DARK) / (BRIGHT - DARK)


def _plot(sheet: Sheet, images: Mapping[str, Array], spreads: Mapping[str, Spread]) -> None:
    """Plot the profile across the edge of each image: all rows, by their distance from the true edge."""
    axes = sheet.plot("profile")
    for name, image in images.items():
        rows, bins = slice(len(image) // 4, 3 * len(image) // 4), np.arange(-5.0, 5.01, 0.125)
        value = profile_image(image)[rows].ravel()
        which = np.digitize(from_edge(image.shape[:2])[rows].ravel(), bins)
        middle = [value[which == i].mean() for i in range(1, len(bins))]
        axes.plot(bins[:-1] + 0.0625, middle, color=CASES[name][1], linewidth=2.2, label=name)
