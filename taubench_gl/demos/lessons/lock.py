"""Demo 17: an upscaler loses features thinner than a pixel unless it locks them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens
from taubench_gl.demos.lessons.jitter import DEPTH, SLOPE, YFOV, slanted
from taubench_gl.demos.sheet import BLACK, BLUE, RED, Sheet, as_bytes, enlarged, enlarged_frames
from taubench_gl.demos.stage import Props, Stage, built, focal_px
from taubench_gl.metrics.color import display_color
from taubench_gl.reuse.frame import read_result

DARK, BRIGHT = 0.1, 0.25
OUTPUT = (160, 90)  # pixels of the result; the input has half of them along each side
WIDTH = 0.5  # of the line, pixels of the result
PERIOD = 32  # frames after which the jitter repeats
START = 2 * PERIOD  # first frame of the measured period
SIDE = 12  # pixels to either side of the line that are summed
METHODS = {"with locks": "fsr2-class", "without locks": "fsr2-class@thin_ratio=4"}
"""thin_ratio 4: no feature is thin, because the line is only 2.5 times as bright as the wall."""


@built
def scene(b: Props, width: float = WIDTH) -> None:
    """A dark wall and a brighter slanted line, ``width`` pixels of OUTPUT wide, both emissive.  Nothing moves."""
    half = 0.5 * width * np.cos(np.arctan(SLOPE)) * DEPTH / focal_px(YFOV, OUTPUT[1])
    slanted(b, DARK, BRIGHT, half)
    b.still_camera(YFOV, START + PERIOD)


def upscaled(stage: Stage, width: float) -> dict[str, Array]:
    """The results of a whole period of the jitter, 0 on the wall and 1 on the line, by name.  (PERIOD, h, w)."""
    images: dict[str, list[Array]] = {name: [] for name in METHODS}
    size = {"width": OUTPUT[0], "height": OUTPUT[1]}
    with stage.reuse(scene(width), METHODS, "jittered+upscale@2", **size) as (inputs, runners):
        for frame in range(START + PERIOD):
            channels = inputs.advance(frame)
            for name, runner in runners.items():
                result = runner.step(channels)
                if frame >= START:
                    images[name].append(read_result(result)[..., 0].astype(np.float64))
    return {name: (np.stack(each) - DARK) / (BRIGHT - DARK) for name, each in images.items()}


def band(images: Array) -> Array:
    """The part around the line that is inside the image.  (n, h, w) -> (n, rows, columns)."""
    height, width = images.shape[1:]
    return images[:, height // 6 : -(height // 6), width // 2 - SIDE : width // 2 + SIDE]


def light_left(images: Array, width: float) -> float:
    """Percent of the light of the line that is left in the mean of the images: its sum per row over its width."""
    return 100.0 * float(band(images).sum(axis=2).mean()) / width


def flicker(images: Array) -> float:
    """Standard deviation over time of the light of the line in a row, percent of its mean."""
    light = band(images).sum(axis=2)
    return 100.0 * float(light.std(axis=0).mean() / light.mean())


def raw_flicker(width: float) -> float:
    """``flicker`` of a line that is visible only in frames that sample it, percent.

    In a row of the input, half as many pixels, a sample meets it in width / 2 of all frames, p: sqrt((1 - p) / p).
    """
    share = min(0.5 * width, 1.0)
    return 100.0 * float(np.sqrt((1.0 - share) / share))


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The light and the flicker of a thin line in an upscaled image, with and without locks."""
    images = {width: upscaled(stage, width) for width in lesson.text.parameter.values}
    light = {name: {width: light_left(each[name], width) for width, each in images.items()} for name in METHODS}
    (locked, bare), most = METHODS, raw_flicker(WIDTH)
    for place, name in enumerate(METHODS):
        text = f"{light[name][WIDTH]:.1f} % of the light, flicker {flicker(images[WIDTH][name]):.0f} %"
        lesson.sheet.panel(place, 0, detail(images[WIDTH][name][-1]), f"{name}: a line {WIDTH:g} px wide", text)
    _plot(lesson.sheet, light)
    numbers = {
        "light_unlocked": (light[bare][WIDTH], Expected.between(0.0, 25.0, 0)),
        "light_locked": (light[locked][WIDTH], Expected.between(50.0, 110.0, 0)),
        "flicker_locked": (flicker(images[WIDTH][locked]), Expected.between(0.0, 0.1 * most, 0)),
        "flicker_unlocked": (flicker(images[WIDTH][bare]), Expected.between(0.5 * most, 1.5 * most, 0)),
    }

    def at(width: float) -> tuple[Array, float, float | None, float]:
        """With a line ``width`` pixels wide: the light that is left without locks."""
        return detail(images[width][bare][-1]), light[bare][width], None if width < 2.0 else 100.0, 5.0

    # What the upscaler gets: half of the pixels along each side, at the exposure of the figure.
    size = {"width": OUTPUT[0] // 2, "height": OUTPUT[1] // 2}
    pair = stage.pair(scene(), columns=("frustum", "color"), environment="none", exposure=2.0, **size)
    frames = enlarged_frames(pair, OUTPUT[0] // 4 - 16, OUTPUT[1] // 4 - 9, 32, 18)
    return Measured(numbers, lesson.swept(at), Screens(detail(images[WIDTH][bare][-1]), frames))


def detail(image: Array) -> Array:
    """The middle of an image (h, w) of 0 to 1, as a display color."""
    height, width = image.shape
    part = enlarged(image, width // 2 - 32, height // 2 - 18, 64, 36)
    radiance = np.repeat(np.maximum(DARK + (BRIGHT - DARK) * part, 0.0)[..., None], 3, axis=-1)
    return as_bytes(display_color(radiance, 2.0))


def _plot(sheet: Sheet, light: Mapping[str, Mapping[float, float]]) -> None:
    """Plot the light that is left, percent, against the width of the line, for each method."""
    axes = sheet.plot("light")
    axes.axhline(100.0, color=BLUE, linewidth=1.6, label="mean of the samples")
    for (name, left), color in zip(light.items(), (BLACK, RED)):
        axes.plot(list(left), list(left.values()), "o-", color=color, linewidth=2, markersize=8, label=name)
    axes.minorticks_off()
