"""Demo 8: noise is counted as change."""

from __future__ import annotations

import math

import numpy as np

from taubench_gl.conventions import DEFAULT_THRESHOLD, Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, Screens, percent
from taubench_gl.demos.sheet import BLACK, Sheet, as_bytes, displayed, overlay
from taubench_gl.demos.stage import Props, Stage, built, corner
from taubench_gl.demos.theory import share_deviation
from taubench_gl.frame.shading import Shading
from taubench_gl.scene.model import Scene

LAMPS = ((-2.2, 0.9, -4.6), (-0.8, 0.9, -2.6), (0.8, 0.9, -5.4), (2.2, 0.9, -3.4))
SAMPLES = (1, 4, 16, 64)
SIGMA = 0.5 * DEFAULT_THRESHOLD


@built
def scene(b: Props, lamps: tuple[tuple[float, float, float], ...] = LAMPS) -> None:
    """A static corner of a room under lamps of one color and power."""
    corner(b)
    for place in lamps:
        b.light(translation=place, intensity=3.0)
    b.still_camera(np.radians(50.0), 1.0)


def direct_light(stage: Stage, room: Scene, frames: tuple[int, ...], samples: int) -> Array:
    """Direct radiance of frames, (frames, h, w, 3).  ``samples``: random light samples per pixel; 0: all lamps."""
    shading = Shading(light_samples=samples, indirect_samples=samples)
    return np.stack([shot.direct for shot in stage.bench.shots(room, frames, shading=shading)])


def expected_one_sample(per_lamp: Array, threshold: float = DEFAULT_THRESHOLD) -> float:
    """Percent of pixels discarded if each frame samples one of K lamps: all K^2 outcomes, each 1 / K^2.

    ``per_lamp`` (K, h, w, 3): radiance of each lamp alone.
    """
    count = len(per_lamp)
    over = [np.linalg.norm(count * (a - b), axis=-1) > threshold for a in per_lamp for b in per_lamp]
    return 100.0 * float(np.mean(over))


def expected_many_samples(per_lamp: Array, samples: int) -> float:
    """Percent of pixels discarded if each frame has the mean of many samples; counts every 23rd pixel.

    ``per_lamp`` (K, h, w, 3): radiance of each lamp alone; all lamps have one color, so changes have one direction.
    """
    sigma = (len(per_lamp) * np.linalg.norm(per_lamp, axis=-1)).std(axis=0)
    return theory.normal_change(DEFAULT_THRESHOLD, sigma.ravel()[::23], samples)


def run(stage: Stage, lesson: Lesson) -> Measured:
    """The masks of a static room whose light is estimated from random samples."""
    still = scene()
    per_lamp = np.stack([direct_light(stage, scene((place,)), (0,), 0)[0] for place in LAMPS])
    sheet = lesson.sheet
    shares, first, screens = {}, None, None
    for place, samples in enumerate(SAMPLES):
        before, now = direct_light(stage, still, (0, 1), samples)
        pair = stage.bench.compare({"direct": now}, {"direct": before})
        first = (before, now) if first is None else first
        shares[samples] = percent(pair.has(Reason.DIRECT))
        shown = displayed(now)
        sheet.panel(place, 0, shown, f"{samples} sample{'s' if samples > 1 else ''} per pixel")
        marked = overlay(pair.mask, shown, Reason.DIRECT)
        sheet.panel(place, 1, marked, "mask", f"{shares[samples]:.1f} % discarded")
        screens = screens or Screens(marked, (displayed(before), shown))
    exact = direct_light(stage, still, (0, 1), 0)
    none = percent(stage.bench.compare({"direct": exact[1]}, {"direct": exact[0]}).has(Reason.DIRECT))
    gaussian = _gaussian(stage)
    _plot(sheet, shares, per_lamp)
    one_sample = expected_one_sample(per_lamp)
    tail = 100.0 * theory.maxwell_tail(DEFAULT_THRESHOLD, math.sqrt(2.0) * SIGMA)
    numbers = {
        "one_sample": (shares[1], Expected.near(one_sample, _slack(one_sample, stage))),
        "normal_noise": (gaussian, Expected.near(tail, _slack(tail, stage))),
        "all_lamps": (none, Expected.near(0.0, 0.0)),
    }

    def theory_at(threshold: float) -> tuple[float, float]:
        """The share of a static room that a ``threshold`` of direct light discards at one sample per pixel."""
        share = expected_one_sample(per_lamp, threshold)
        return share, _slack(min(max(share, 0.1), 99.9), stage)

    before, now = first
    base = as_bytes(np.repeat(displayed(now).mean(axis=-1, keepdims=True), 3, axis=-1))
    parameter = lesson.threshold(np.linalg.norm(now - before, axis=-1), base, theory_at, Reason.DIRECT)
    return Measured(numbers, parameter, screens)


def _slack(percent_of_image: float, stage: Stage) -> float:
    """Five standard deviations of a share that is counted over all pixels, percentage points."""
    return 500.0 * share_deviation(percent_of_image / 100, stage.pixels)


def _gaussian(stage: Stage) -> float:
    """Discard rate of a gray image with normal noise of SIGMA in every channel of both frames, %."""
    rng = np.random.default_rng(8)
    width, height = stage.size
    frames = [{"direct": 1.0 + rng.normal(0.0, SIGMA, (height, width, 3))} for _ in range(2)]
    return percent(stage.bench.compare(*frames).has(Reason.DIRECT))


def _plot(sheet: Sheet, shares: dict[int, float], per_lamp: Array) -> None:
    """Plot the discard rate against the number of samples, with its theory."""
    axes = sheet.plot("rate")
    line = np.unique(np.round(np.logspace(np.log10(4), 3, 16)).astype(int))
    sheet.theory(axes, line, [expected_many_samples(per_lamp, int(n)) for n in line], "theory: central limit theorem")
    axes.plot([1], [expected_one_sample(per_lamp)], "D", color=BLACK, markersize=11, label="theory: all pairs of lamps")
    sheet.dots(axes, list(shares), list(shares.values()), zorder=5)
