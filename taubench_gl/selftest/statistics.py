"""Cases: sums of many, large or nearly equal numbers, and the counts of whole sequences."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.features import MASK_WORDS
from taubench_gl.metrics.counts import CLASSES, counts_of
from taubench_gl.metrics.streaming import Welford
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Naive, Outcome, case, count, difference, scalar
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


def one_pass_variance(values: Array) -> float:
    """E[x^2] - E[x]^2, the one-pass formula."""
    total = float(np.cumsum(values)[-1])
    squares = float(np.cumsum(values * values)[-1])
    return squares / len(values) - (total / len(values)) ** 2


def _against_one_pass(values: Array, exact: float, variance: float) -> Outcome:
    plain = one_pass_variance(values)
    naive = Naive("E[x^2] - E[x]^2", plain, difference(exact, plain, relative=True))
    return scalar(exact, variance, naive, relative=True)


@case(
    "variance-stream",
    description="population variance of 1e5 values 1000 +- 0.01, added one by one",
    elsewhere="E[x^2] - E[x]^2 subtracts two numbers near 1e6 that agree in ten digits; in float32 it is negative",
    here="Welford (1962) in float64",
    tolerance=1e-9,
    source=CONDITION,
)
def variance_stream(bench: Bench) -> Outcome:
    values, exact = _nearly_equal(SAMPLES // 10)
    w = Welford()
    for value in values.tolist():
        w.add(value)
    return _against_one_pass(values, exact, w.variance)


@case(
    "variance-blocks",
    description="1e6 of these values in 1000 blocks of unequal size, merged",
    elsewhere="the variances of blocks are averaged",
    here="the update of Chan, Golub and LeVeque (1979) with two-pass blocks",
    tolerance=1e-9,
    source=CONDITION,
)
def variance_blocks(bench: Bench) -> Outcome:
    values, exact = _nearly_equal(SAMPLES)
    w = Welford()
    for block in np.split(values, np.sort(np.random.default_rng(1).integers(0, SAMPLES, 999))):
        w.add_many(block)
    return _against_one_pass(values, exact, w.variance)


@case(
    "mean-far-from-zero",
    description="mean of the 2^20 values 1e9 + i / 2^20",
    elsewhere="a float32 sum stops growing at 1.7e7 times the addend",
    here="running mean of differences in float64",
    tolerance=3e-7,
    source="float64: 2.5 ulps of 1e9; the values are rounded to 1 ulp",
)
def mean_far(bench: Bench) -> Outcome:
    values = 1e9 + np.arange(2**20) / 2**20
    w = Welford()
    for block in np.split(values, 64):
        w.add_many(block)
    exact = 1e9 + (2**20 - 1) / 2**21
    naive = float(np.mean(values.astype(np.float32)))
    return scalar(exact, w.mean, Naive("float32", naive, abs(naive - exact)))


@case(
    "more-than-2^24-pixels",
    description="4096 x 4097 pixels of sky counted on the GPU: 16,781,312",
    elsewhere="a float32 counter stops at 2^24 = 16,777,216, where adding 1 has no effect",
    here="unsigned integers on the GPU, summed in 64 bits",
    source="exact: an unsigned count on the GPU",
)
def many_pixels(bench: Bench) -> Outcome:
    width, height = 4096, 4097
    sky = bench.sky_counts((width, height))
    pixels = width * height
    ones = np.add(np.float32(2**24), np.float32(1))
    naive = Naive("float32 counter", int(ones), pixels - int(ones))
    wrong = abs(sky["sky"] - pixels)
    return Outcome(pixels, sky["pixels"], float(abs(sky["pixels"] - pixels) + wrong), naive)


@case(
    "counts-past-32-bits",
    description="the sum of 2^32 - 1 pixels of each of two reason words (a long sequence)",
    elsewhere="32-bit sums wrap around",
    here="counts are converted to 64 bits before they are added",
    source="exact: integers",
)
def past_32_bits(bench: Bench) -> Outcome:
    mask_histogram = np.zeros(MASK_WORDS, dtype=np.uint32)
    mask_histogram[int(Reason.SKY)] = mask_histogram[int(Reason.SKY | Reason.BEHIND)] = 2**32 - 1
    exact = 2 * (2**32 - 1)
    naive = int(np.uint32(exact & 0xFFFFFFFF))
    return count(exact, counts_of(mask_histogram)["pixels"], Naive("32-bit sum", naive, exact - naive))


@case(
    "classes-add-up",
    description="the busy room, both reprojections, three pairs: pixels in no class or in two",
    elsewhere="invalid pixels are silently replaced by 0, and the total is still 100 %",
    here="first, cut, invalid, frustum and comparable are exclusive and add up to w h",
    source="exact: integers",
)
def classes_add_up(bench: Bench) -> Outcome:
    lost = 0
    for mode in ("camera", "motion"):
        for now in (0.25, 0.5, 1.0):
            c = bench.pair(busy_room(), (now - 0.25, now), reprojection=mode).counts
            lost += abs(c["pixels"] - sum(c[n] for n in CLASSES)) + abs(c["pixels"] - bench.size[0] * bench.size[1])
    return count(0, lost)


@case(
    "discards-are-surfaces",
    description="the busy room: pixels that are DISOCCLUDED or OCCLUDING but not POSITION",
    elsewhere="disocclusion is a separate test with another tolerance, which contradicts the first",
    here="both are set for position discards only",
    source="exact: integers",
)
def discards_are_surfaces(bench: Bench) -> Outcome:
    images = bench.pair(busy_room(), (0.0, 1.0), reprojection="motion")
    occlusion = images.has(Reason.DISOCCLUDED | Reason.OCCLUDING)
    return count(0, int((occlusion & ~images.has(Reason.POSITION)).sum()) if occlusion.any() else -1)


@case(
    "frames-and-pairs",
    description="a scene of exactly 1 s at 24 frames per second: number of pairs",
    elsewhere="frame 0 is paired with itself, which lowers every mean",
    here="frames i = 0 .. floor(duration * fps * (1 + 2^-23) + 1e-6); N frames give N - 1 pairs; means are over pairs",
    source="exact: integers",
)
def frames_and_pairs(bench: Bench) -> Outcome:
    run = bench.evaluate(busy_room(), width=16, height=9, columns=("frustum", "position", "normal"))
    return count(24, run.summary["pairs"], Naive("a pair per frame", 25, 1.0))


@case(
    "still-scene",
    description="a still camera in a still room, both reprojections, both history filters: pixels with a reason bit "
    "or motion",
    elsewhere="0.1 % of a still image is discarded at its border, more with bilinear history",
    here="zero motion is exactly zero",
    source="exact: integers",
)
def still_scene(bench: Bench) -> Outcome:
    marked = 0
    for mode in ("camera", "motion"):
        for sampling in ("nearest", "bilinear"):
            images = bench.pair(busy_room(), (0.3, 0.3), reprojection=mode, sampling=sampling)
            marked += int((images.mask != 0).sum()) + int((images.motion != 0).sum())
    return count(0, marked)
