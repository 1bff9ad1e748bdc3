"""Demo 14: light units, exposure, and what a threshold on radiance depends on."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import DEFAULT_THRESHOLD, Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Parameter, Screens, beyond, percent
from taubench_gl.demos.sheet import Sheet, heat, overlay, painted, rgb
from taubench_gl.demos.stage import Props, Stage, built
from taubench_gl.evaluation import resolve_lighting
from taubench_gl.evaluation.exposure import METERED_FRAMES, METERED_SIZE
from taubench_gl.metrics.color import display_color
from taubench_gl.metrics.exposure import MIDDLE_GRAY

Size = tuple[int, int]
YFOV = np.radians(50.0)
WALL, LAMP = -4.0, -3.0  # z of the wall and of the lamp
PLACES = (-0.6, 0.6)  # x of the lamp in the two frames
CANDELA, ALBEDO = 100.0, 0.8
LUMENS_PER_WATT = 683.0
SHOWN = (Reason.LIT, Reason.SHADOWED)


@built
def scene(b: Props) -> None:
    """A gray wall and a lamp 1 m in front of it, which moves from left to right."""
    b.wall(12.0, 8.0, (ALBEDO,) * 3, translation=(0, 0, WALL))
    lamp = b.light(intensity=CANDELA, translation=(PLACES[0], 0, LAMP))
    b.animate(lamp, "translation", [0.0, 1.0], [(x, 0, LAMP) for x in PLACES])
    b.camera(yfov=YFOV, znear=0.05)


def wall_radiance(size: Size, lamp: float) -> Array:
    """Radiance of the wall in R, G and B, the lamp at x = ``lamp``: albedo intensity cos / (pi r^2).  (h, w) cd/m2."""
    point = theory.pixel_rays(size, YFOV) * -WALL
    height = LAMP - WALL
    distance = np.sqrt((point[..., 0] - lamp) ** 2 + point[..., 1] ** 2 + height**2)
    return ALBEDO * CANDELA * height / (np.pi * distance**3)


def expected_exposure() -> float:
    """Middle gray over the log-average between the 10th and the 90th percentile, lowered until 5 % clip."""
    luminance = np.stack([wall_radiance(METERED_SIZE, x) for x in np.linspace(*PLACES, METERED_FRAMES)])
    low, high = np.percentile(luminance, (10, 90))
    used = luminance[(luminance >= low) & (luminance <= high)]
    return min(MIDDLE_GRAY / float(np.exp(np.mean(np.log(used)))), 1.0 / float(np.percentile(luminance, 95)))


def change(size: Size) -> Array:
    """The change of direct light between the frames, the norm of R, G and B, with an exposure of 1.  (h, w) cd/m2."""
    return np.sqrt(3.0) * np.abs(wall_radiance(size, PLACES[1]) - wall_radiance(size, PLACES[0]))


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The luminance of a wall, the metered exposure, and the discard rate with and without it."""
    columns = ("frustum", "direct")
    automatic = stage.settings(columns=columns, frames=(0, 2), exposure="auto")
    metered = float(resolve_lighting(scene(), automatic).settings.lighting.exposure_factor)
    bright = stage.pair(scene(), columns=columns)
    gray = stage.pair(scene(), columns=columns, exposure=metered)
    watt = stage.pair(scene(), columns=columns, light_unit="watt")
    luminance = bright.now["direct"][..., 0].astype(np.float64)
    most, brightest = float(luminance.max()), float(wall_radiance(stage.size, PLACES[1]).max())
    now = bright.now["direct"][..., :3].astype(np.float64)
    moved, expected = np.linalg.norm(now - bright.before["direct"][..., :3], axis=-1), change(stage.size)

    def at(stop: float) -> tuple[Array, float, float, float]:
        """With an exposure of ``stop`` stops: the share that is discarded."""
        region = moved * 2.0**stop > DEFAULT_THRESHOLD
        image = painted(display_color(now, 2.0**stop), (region, rgb(Reason.DIRECT)), strength=0.45)
        return image, percent(region), *beyond(expected * 2.0**stop)(DEFAULT_THRESHOLD)

    parameter, sheet = lesson.swept(at), lesson.sheet
    for place, (pair, factor, name) in enumerate(((bright, 1.0, "exposure 1"), (gray, metered, "metered exposure"))):
        image = display_color(pair.now["direct"][..., :3].astype(np.float64), factor)
        text = f"exposure {factor:.4g}: {pair.percent(Reason.DIRECT):.1f} % discarded"
        sheet.panel(place, 0, overlay(pair.mask, image, *SHOWN), f"{name}: mask over the image", text)
    _plot(sheet, parameter, metered, stage.size)
    ratio = float(np.median(luminance / watt.now["direct"][..., 0]))
    numbers = {
        "luminance": (most, Expected.near(brightest, 0.005 * brightest)),
        "candela_per_watt": (ratio, Expected.near(LUMENS_PER_WATT, 0.01)),
        "metered_exposure": (metered, Expected.near(expected_exposure(), 0.005 * expected_exposure(), 4)),
        "discarded": (bright.percent(Reason.DIRECT), Expected.share(expected > DEFAULT_THRESHOLD)),
        "discarded_metered": (gray.percent(Reason.DIRECT), Expected.share(metered * expected > DEFAULT_THRESHOLD)),
    }
    return Measured(numbers, parameter, Screens(heat(luminance, most)))


def _plot(sheet: Sheet, parameter: Parameter, metered: float, size: Size) -> None:
    """Plot the discard rate against the exposure, with its closed form."""
    axes = sheet.plot("rate")
    line = np.linspace(parameter.values[0], parameter.values[-1], 300)
    shares = theory.shares_above(change(size), DEFAULT_THRESHOLD / 2.0**line)
    sheet.theory(axes, line, shares, "theory: closed form")
    sheet.dots(axes, parameter.values, parameter.measured, markersize=7)
    for stop, name in ((0.0, "exposure 1"), (float(np.log2(metered)), "metered")):
        axes.axvline(stop, color="#777777", linewidth=1, linestyle="--")
        axes.text(stop + 0.32, 30, name, fontsize=12, rotation=90, ha="right", va="center")
