"""Demo 5: motion vectors in 16-bit floats."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import FRUSTUM
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens
from taubench_gl.demos.sheet import BLACK, BLUE, RED, Sheet, heat, note, rgb
from taubench_gl.demos.stage import Props, Stage, built, hall
from taubench_gl.scene.builder import IDENTITY, turn
from taubench_gl.selftest.bench import pixel_grid

YFOV = np.radians(60.0)
ROLL = 50.0
WRONG, RIGHT = rgb(RED), (52, 54, 58)
BLOCK = 8  # pixels along a side


@built
def scene(b: Props) -> None:
    """The hall and a rolling camera: motion grows from 0 at the center to hundreds of pixels in the corners."""
    hall(b)
    camera = b.camera(translation=(0.0, 0.0, 1.2), yfov=YFOV, znear=0.05)
    b.animate(camera, "rotation", [0.0, 1.0], [IDENTITY, turn((0, 0, 1), ROLL)])


def half_step(motion: Array, bits: int = 11) -> Array:
    """Spacing of floats with ``bits`` of precision at ``motion``; 11: 16-bit floats."""
    _, exponent = np.frexp(np.abs(np.asarray(motion, dtype=np.float64)))
    return np.exp2(np.maximum(exponent - 1, -14) - (bits - 1.0))


def in_half(motion: Array, bits: int = 11) -> Array:
    """``motion`` rounded to ``bits`` of precision, half to even."""
    step = half_step(motion, bits)
    return (np.round(motion / step) * step).astype(np.float32)


def texels(motion: Array) -> Array:
    """The pixels (x, row) that nearest sampling reads along ``motion`` (h, w, 2).  (h, w, 2) int."""
    size = motion.shape[1::-1]
    return np.floor(pixel_grid(size) + motion.astype(np.float64) + 0.5).astype(int)


def law(motion: Array, bits: int = 11) -> float:
    """Percent of pixels that read another pixel.  ``motion`` (n, 2), pixels.

    Up to a spacing of half a pixel the midpoint of two pixels is a float: motion up to half a spacing below it rounds
    to it, a probability of spacing / 2 per axis.  A spacing of 1 has no midpoints; of 2 and more, only one pixel in
    ``spacing`` can be read.
    """
    step = half_step(motion, bits)
    wrong = np.where(step <= 0.5, step / 2.0, np.where(step == 1.0, 0.0, 1.0 - 1.0 / step))
    return 100.0 * float(1.0 - np.mean(np.prod(1.0 - wrong, axis=-1)))


def largest_in_blocks(values: Array) -> Array:
    """The largest value, NaN aside, of the block of BLOCK x BLOCK pixels around each pixel.  (h, w) -> (h, w)."""
    for axis, length in enumerate(values.shape):
        most = np.fmax.reduceat(values, np.arange(0, length, BLOCK), axis=axis)
        values = np.repeat(most, BLOCK, axis=axis).take(np.arange(length), axis=axis)
    return values


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The errors of motion vectors that are rounded to 16-bit floats."""
    pair, sheet = lesson.pair, lesson.sheet
    reusable = ~pair.has(FRUSTUM)
    half = in_half(pair.motion)
    error = np.where(reusable[..., None], np.abs(half - pair.motion), np.nan)
    other = reusable & (texels(half) != texels(pair.motion)).any(axis=-1)
    steps = half_step(pair.motion)
    worst = largest_in_blocks(np.max(error, axis=-1))
    low, high = -11.0, -4.0  # exponents of the color scale
    axes = sheet.panel(
        0, 0, heat(np.log2(np.maximum(worst, 2.0**low)) - low, high - low),
        f"largest error in blocks of {BLOCK} x {BLOCK} pixels",
    )  # fmt: skip
    most = float(np.abs(pair.motion[reusable]).max())
    note(axes, f"the camera rolls by {ROLL:g}°: motion up to {most:.0f} px along an axis")
    _staircase(sheet, np.abs(pair.motion[reusable]).ravel(), error[reusable].ravel())
    share = 100.0 * float(other.sum() / reusable.sum())
    expected = law(pair.motion[reusable])
    numbers = {
        "other_pixel": (share, Expected.near(expected, _chance(expected, reusable))),
        "largest_error": (float(np.nanmax(error / (0.5 * steps))), Expected.between(0.9, 1.0, 3)),
    }

    def at(bits: float) -> tuple[Array, float, float, float]:
        """With ``bits`` of precision: the share of the pixels that read another pixel."""
        other = reusable & (texels(in_half(pair.motion, int(bits))) != texels(pair.motion)).any(axis=-1)
        image = np.where(other[..., None], WRONG, np.where(reusable[..., None], RIGHT, 219)).astype(np.uint8)
        expected = law(pair.motion[reusable], int(bits))
        return image, 100.0 * float(other.sum() / reusable.sum()), expected, _chance(expected, reusable)

    parameter = lesson.swept(at)
    return Measured(numbers, parameter, Screens(parameter.picture(parameter.start)))


def _chance(percent: float, reusable: Array) -> float:
    """Five standard deviations of a small share, ``percent``, of the ``reusable`` pixels (h, w), percentage points."""
    return 500.0 * float(np.sqrt(percent / 100.0 / reusable.sum()))


def _staircase(sheet: Sheet, motion: Array, error: Array) -> None:
    """Plot errors against motion, both (n,) pixels, with the largest possible error."""
    left, top, width, height = sheet.place(1, 0)
    axes = sheet.plot("error", (left + 66, top, width - 66, height))
    pick = np.linspace(0, len(motion) - 1, min(len(motion), 12000)).astype(int)
    axes.scatter(motion[pick], error[pick], s=2, color=BLUE, alpha=0.35, linewidths=0, rasterized=True)
    axes.scatter([], [], s=30, color=BLUE, linewidths=0, label="measured")  # for the key
    line = np.linspace(1.0, motion.max(), 3000)
    axes.plot(line, 0.5 * half_step(line), color=BLACK, linewidth=2, label="theory: half a spacing")
    axes.set_xlim(0, 1.02 * motion.max())
