"""Demo 17: an upscaler loses features thinner than a pixel unless it locks them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos.demo import Expected, Measured, Opening, Screens, swept
from taubench_gl.demos.sheet import BLACK, BLUE, RED, Sheet, as_bytes, enlarged, enlarged_frames, note, rgb
from taubench_gl.demos.stage import Props, Stage
from taubench_gl.metrics.color import display_color
from taubench_gl.reuse.frame import read_result
from taubench_gl.scene.builder import quad, turn
from taubench_gl.scene.model import Scene

Array = np.ndarray
YFOV, DEPTH = np.radians(42.0), 4.0
SLOPE = 1.0 / 7.3  # pixels to the right per pixel upwards
DARK, BRIGHT = 0.1, 0.25
OUTPUT = (160, 90)  # pixels of the result; the input has half of them along each side
WIDTHS = (0.25, 0.5, 1.0, 2.0, 4.0)  # of the line, pixels of the result
WIDTH = 0.5
PERIOD = 32  # frames after which the jitter repeats
START = 2 * PERIOD  # first frame of the measured period
SIDE = 12  # pixels to either side of the line that are summed
METHODS = {"with locks": "fsr2-class", "without locks": "fsr2-class@thin_ratio=4"}
"""thin_ratio 4: no feature is thin, because the line is only 2.5 times as bright as the wall."""


def scene(width: float = WIDTH) -> Scene:
    """A dark wall and a brighter slanted line, ``width`` pixels of OUTPUT wide, both emissive.  Nothing moves."""
    b = Props()
    lean = float(np.arctan(SLOPE))
    leaning = turn((0, 0, 1), -np.degrees(lean))
    b.thing(quad(12.0, 8.0, material=b.glow(DARK)), translation=(0, 0, -DEPTH - 0.01))
    half = 0.5 * width * np.cos(lean) * DEPTH / (0.5 * OUTPUT[1] / np.tan(0.5 * YFOV))
    b.thing(
        quad(half, 12.0, material=b.glow(BRIGHT)),
        translation=(0, 0, -DEPTH),
        rotation=leaning,
    )
    b.still_camera(YFOV, START + PERIOD)
    return b.build()


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


OPENING = Opening((Reason.POSITION,), settings={"environment": "none"})


def run(stage: Stage) -> Measured:
    """The light and the flicker of a thin line in an upscaled image, with and without locks."""
    images = {width: upscaled(stage, width) for width in WIDTHS}
    light = {name: [light_left(images[width][name], width) for width in WIDTHS] for name in METHODS}
    locked, bare = METHODS
    at, most = WIDTHS.index(WIDTH), raw_flicker(WIDTH)
    sheet = Sheet(2, 1, OUTPUT[0] / OUTPUT[1], below=330, legend=False)
    for place, name in enumerate(METHODS):
        axes = sheet.panel(place, 0, detail(images[WIDTH][name][-1]), f"{name}: a line {WIDTH:g} px wide")
        note(axes, f"{light[name][at]:.1f} % of the light, flicker {flicker(images[WIDTH][name]):.0f} %")
    _plot(sheet, light)
    numbers = {
        "light_unlocked": (light[bare][at], Expected.between(0.0, 25.0, 0)),
        "light_locked": (light[locked][at], Expected.between(50.0, 110.0, 0)),
        "flicker_locked": (flicker(images[WIDTH][locked]), Expected.between(0.0, 0.1 * most, 0)),
        "flicker_unlocked": (flicker(images[WIDTH][bare]), Expected.between(0.5 * most, 1.5 * most, 0)),
    }
    lights = dict(zip(WIDTHS, light[bare]))
    parameter = swept(
        WIDTHS,
        lambda width: (detail(images[width][bare][-1]), lights[width], None if width < 2.0 else 100.0, 5.0),
        start=WIDTH,
    )
    colors = {"with": rgb(BLACK), "without": rgb(RED)}
    # What the upscaler gets: half of the pixels along each side, at the exposure of the figure.
    size = {"width": OUTPUT[0] // 2, "height": OUTPUT[1] // 2}
    pair = stage.pair(scene(), columns=("frustum", "color"), environment="none", exposure=2.0, **size)
    frames = enlarged_frames(pair, OUTPUT[0] // 4 - 16, OUTPUT[1] // 4 - 9, 32, 18)
    screens = Screens(parameter.picture(at), frames)
    return Measured(numbers, sheet, parameter, colors, screens)


def detail(image: Array) -> Array:
    """The middle of an image (h, w) of 0 to 1, as a display color."""
    height, width = image.shape
    part = enlarged(image, width // 2 - 32, height // 2 - 18, 64, 36)
    radiance = np.repeat(np.maximum(DARK + (BRIGHT - DARK) * part, 0.0)[..., None], 3, axis=-1)
    return as_bytes(display_color(radiance, 2.0))


def _plot(sheet: Sheet, light: Mapping[str, list[float]]) -> None:
    """Plot the light that is left, percent, against the width of the line, for each method."""
    axes = sheet.plot(
        88, sheet.grid_bottom + 40, 1150, 226, xscale="log", ylim=(0, 115),
        ylabel="light of the line, %", xlabel="width of the line, pixels of the result",
        title="Light that is left, mean of a period of the jitter",
    )  # fmt: skip
    axes.axhline(100.0, color=BLUE, linewidth=1.6, label="mean of the samples")
    for (name, values), color in zip(light.items(), (BLACK, RED)):
        axes.plot(WIDTHS, values, "o-", color=color, linewidth=2, markersize=8, label=name)
    axes.minorticks_off()
    axes.set_xticks(WIDTHS, [f"{width:g}" for width in WIDTHS])
    sheet.key(axes, "center right")
