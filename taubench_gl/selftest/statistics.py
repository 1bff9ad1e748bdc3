"""Cases: sums of many, large or nearly equal numbers, and the counts of whole sequences."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.features import MASK_WORDS
from taubench_gl.metrics.counts import CLASSES, counts_of
from taubench_gl.metrics.streaming import Welford
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, count, scalar
from taubench_gl.selftest.scenes import busy_room

Array = np.ndarray
SAMPLES = 1_000_000
CONDITION = "relative; float64: 1e-11 for inputs of 1000 rounded to 1.1e-13 around 0.01, times 100 for 1e6 sums"


def _nearly_equal(count: int) -> tuple[Array, float]:
    """1000 +- 0.01 alternating, and the exact population variance of these floats."""
    values = np.where(np.arange(count) % 2 == 0, 1000.01, 999.99)
    high, low = 1000.01, 999.99
    half = (high - low) / 2  # Sterbenz: exact
    return values, half * half


@case("variance-stream", tolerance=1e-9, source=CONDITION)
def variance_stream(bench: Bench) -> Outcome:
    """Population variance of 1e5 values 1000 +- 0.01, added one by one.

    E[x^2] - E[x]^2 subtracts two numbers near 1e6 that agree in ten digits; in float32 it is negative.
    """
    values, exact = _nearly_equal(SAMPLES // 10)
    w = Welford()
    for value in values.tolist():
        w.add(value)
    return scalar(exact, w.variance, relative=True)


@case("more-than-2^24-pixels", source="exact: an unsigned count on the GPU")
def many_pixels(bench: Bench) -> Outcome:
    """4096 x 4097 pixels of sky counted on the GPU: 16,781,312.

    A float32 counter stops at 2^24 = 16,777,216, where adding 1 has no effect.
    """
    width, height = 4096, 4097
    sky = bench.sky_counts((width, height))
    pixels = width * height
    wrong = abs(sky["sky"] - pixels)
    return Outcome(pixels, sky["pixels"], float(abs(sky["pixels"] - pixels) + wrong))


@case("counts-past-32-bits", source="exact: integers")
def past_32_bits(bench: Bench) -> Outcome:
    """The sum of 2^32 - 1 pixels of each of two reason words (a long sequence).

    32-bit sums wrap around.
    """
    mask_histogram = np.zeros(MASK_WORDS, dtype=np.uint32)
    mask_histogram[int(Reason.SKY)] = mask_histogram[int(Reason.SKY | Reason.BEHIND)] = 2**32 - 1
    exact = 2 * (2**32 - 1)
    return count(exact, counts_of(mask_histogram)["pixels"])


@case("classes-add-up", source="exact: integers")
def classes_add_up(bench: Bench) -> Outcome:
    """The busy room, both reprojections, three pairs: pixels in no class or in two.

    Invalid pixels are silently replaced by 0, and the total is still 100 %.
    """
    lost = 0
    for mode in ("camera", "motion"):
        for now in (0.25, 0.5, 1.0):
            c = bench.pair(busy_room(), (now - 0.25, now), reprojection=mode).counts
            lost += abs(c["pixels"] - sum(c[n] for n in CLASSES)) + abs(c["pixels"] - bench.size[0] * bench.size[1])
    return count(0, lost)


@case("discards-are-surfaces", source="exact: integers")
def discards_are_surfaces(bench: Bench) -> Outcome:
    """The busy room: pixels that are DISOCCLUDED or OCCLUDING but not POSITION.

    Disocclusion is a separate test with another tolerance, which contradicts the first.
    """
    images = bench.pair(busy_room(), (0.0, 1.0), reprojection="motion")
    occlusion = images.has(Reason.DISOCCLUDED | Reason.OCCLUDING)
    return count(0, int((occlusion & ~images.has(Reason.POSITION)).sum()) if occlusion.any() else -1)


@case("frames-and-pairs", source="exact: integers")
def frames_and_pairs(bench: Bench) -> Outcome:
    """A scene of exactly 1 s at 24 frames per second: number of pairs.

    Frame 0 is paired with itself, which lowers every mean.
    """
    run = bench.evaluate(busy_room(), width=16, height=9, columns=("frustum", "position", "normal"))
    return count(24, run.summary["pairs"])


@case("still-scene", source="exact: integers")
def still_scene(bench: Bench) -> Outcome:
    """A still camera in a still room, both reprojections, both history filters: pixels with a reason bit or motion.

    0.1 % of a still image is discarded at its border, more with bilinear history.
    """
    marked = 0
    for mode in ("camera", "motion"):
        for sampling in ("nearest", "bilinear"):
            images = bench.pair(busy_room(), (0.3, 0.3), reprojection=mode, sampling=sampling)
            marked += int((images.mask != 0).sum()) + int((images.motion != 0).sum())
    return count(0, marked)
