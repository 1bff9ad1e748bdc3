"""Cases: radiance that is large, small, not finite, or exactly on its threshold, as input of the mask pass."""

from __future__ import annotations

import math

import numpy as np

from taubench_gl.conventions import HISTOGRAM_BINS, NOT_COMPARABLE, Reason
from taubench_gl.features import BY_BIT, FEATURES
from taubench_gl.metrics.counts import bin_of
from taubench_gl.selftest.bench import Bench, limits, shifted_pair
from taubench_gl.selftest.case import Outcome, case, count

Array = np.ndarray
COUNT = "exact: an unsigned count on the GPU"
DIRECT = FEATURES.index("direct")


def _image(bench: Bench, value: object) -> Array:
    """Constant radiance.  (h, w, 3) float64."""
    return np.zeros((bench.size[1], bench.size[0], 3)) + np.asarray(value, dtype=np.float64)


@case("radiance-range", source="closed form: sqrt(3) times the value against 32/255; " + COUNT)
def radiance_range(bench: Bench) -> Outcome:
    """Radiance of 1e-8, 1e-7 .. 1e8 that doubles from one frame to the next: pixels above the threshold.

    In half floats 1e-8 is 0 and 1e8 is Inf, whose difference is NaN and counts as unchanged.
    """
    powers = 10.0 ** np.linspace(-8, 8, bench.size[0]).round()
    before = _image(bench, powers[None, :, None])
    images = bench.compare({"direct": 2 * before}, {"direct": before})
    expected = int((np.sqrt(3) * before[..., 0] > 32 / 255).sum())
    return count(expected, images.counts["direct"])


@case("radiance-histogram", source=COUNT + "; distances differ from every bin edge by more than 1e-5, relative")
def radiance_histogram(bench: Bench) -> Outcome:
    """Radiance of 1e-8, 1e-7 .. 1e8 that doubles, in the histogram of distances: pixels in a wrong bin.

    Log2 on the GPU depends on the driver in its last bits, and values near a bin edge change bins.
    """
    powers = 10.0 ** np.linspace(-8, 8, bench.size[0]).round()
    before = _image(bench, powers[None, :, None])
    images = bench.compare({"direct": 2 * before}, {"direct": before})
    bins = np.bincount(bin_of(np.sqrt(3) * before[..., 0]).ravel(), minlength=HISTOGRAM_BINS)
    got = images.counted.histograms[DIRECT].astype(np.int64)
    return count(0, int(np.abs(got - bins)[1:].sum()))  # the GPU does not count bin 0, which is the remainder


@case(
    "{0}",
    source=COUNT,
    each=(
        ("nan-current", np.nan, "current"),
        ("nan-history", np.nan, "previous"),
        ("inf-current", np.inf, "current"),
        ("inf-history", -np.inf, "previous"),
    ),
)
def not_finite(bench: Bench, name: str, value: float, frame: str) -> Outcome:
    """A value of {1} in 100 texels of the {2} frame's radiance: pixels of class INVALID.

    Comparisons with NaN are false, so these pixels count as reusable.
    """
    bad = _image(bench, 0.5)
    bad.reshape(-1, 3)[7 : 7 + 100 * 11 : 11, 1] = value
    good = _image(bench, 0.5)
    now, then = (bad, good) if frame == "current" else (good, bad)
    images = bench.compare({"direct": now}, {"direct": then})
    measured = int((images.mask == Reason.INVALID).sum())
    return count(100, measured)


@case("nan-beside-bilinear", source=COUNT + "; the other tap of the last column is outside the screen")
def nan_beside_bilinear(bench: Bench) -> Outcome:
    """Bilinear history half a pixel away, every second column NaN: pixels that are invalid.

    One NaN tap makes the blend NaN, which spreads by a pixel per frame.
    """
    history = _image(bench, 0.5)
    history[:, ::2] = np.nan
    pair = shifted_pair(bench.size, 0.5)
    images = bench.compare({"direct": _image(bench, 0.5)}, {"direct": history}, pair, sampling="bilinear")
    return count(0, images.counts["invalid"])


@case("invalid-position", source=COUNT)
def invalid_position(bench: Bench) -> Outcome:
    """NaN in the stored position of 64 pixels: number of INVALID pixels, and the classes add up to w h.

    NaN < 0 and NaN > w are both false, so the pixel is on screen.
    """
    wall = bench.wall(bench.size)
    wall["position"].reshape(-1, 4)[100:164, 0] = np.nan
    c = bench.compare(wall, bench.wall(bench.size)).counts
    lost = abs(c["pixels"] - sum(c[n] for n in ("first", "cut", "invalid", "frustum", "comparable")))
    return count(64, c["invalid"] + lost)


def _threshold_images(bench: Bench, feature: str, change: float):
    """``feature`` changes by ``change`` along one axis in every pixel; the threshold is 1/8."""
    now, then = {}, {}
    if feature == "position":
        then = bench.wall(bench.size)
        now = {**then, "position": then["position"].copy()}
        then["position"] = then["position"].copy()
        now["position"][..., :2] = then["position"][..., :2] = 0.0
        now["position"][..., 2] -= change
        # Both on the optical axis, so that the difference of two float32 numbers near 1 is exact.
    elif feature == "normal":
        then = {**bench.wall(bench.size), "normal": _image(bench, (0.0, 0.0, 1.0))}
        now = {**then, "normal": _image(bench, (change, 0.0, 1.0))}
    else:
        then, now = {feature: _image(bench, 0.0)}, {feature: _image(bench, (0.0, change, 0.0))}
    return bench.compare(now, then, thresholds={feature: 0.125})


@case(
    "on-threshold-{0}",
    source="exact: 1/8 and the next value are floats, the roots of their squares are exact or on the right side",
    each=tuple((feature.name,) for feature in BY_BIT),
)
def on_threshold(bench: Bench, feature: str) -> Outcome:
    """Feature {0} changes by exactly its threshold of 1/8, then by one float step more: wrong pixels.

    '>=' discards changes equal to the threshold: a whole gray level in 8-bit data.
    """
    # Positions near 1 m have steps of 2^-23 m, which is the next larger distance.
    above = 0.125 + 2.0**-23 if feature == "position" else 0.125 + 2.0**-22
    exactly = _threshold_images(bench, feature, 0.125).counts[feature]
    over = _threshold_images(bench, feature, above).counts[feature]
    pixels = bench.size[0] * bench.size[1]
    return Outcome(f"0, {pixels}", f"{exactly}, {over}", float(exactly + pixels - over))


@case("lit-and-shadowed", source=COUNT)
def lit_and_shadowed(bench: Bench) -> Outcome:
    """A third of the image gets brighter, a third gets darker, a third is unchanged: LIT and SHADOWED pixels.

    Only |change| is stored, so appearing and disappearing shadows cannot be distinguished.
    """
    third = bench.size[0] // 3
    before, now = _image(bench, 1.0), _image(bench, 1.0)
    now[:, :third] = 2.0
    now[:, third : 2 * third] = 0.25
    c = bench.compare({"direct": now}, {"direct": before}).counts
    expected = third * bench.size[1]
    return Outcome(
        f"{expected} lit, {expected} shadowed", f"{c['lit']} lit, {c['shadowed']} shadowed",
        float(abs(c["lit"] - expected) + abs(c["shadowed"] - expected)),
    )  # fmt: skip


@case("not-compared-not-counted", source=COUNT)
def not_compared(bench: Bench) -> Outcome:
    """All features differ, but the frame is declared a cut: pixels with a feature bit.

    Pixels discarded for one reason are counted again for others, and percentages exceed 100.
    """
    history = {**bench.wall(bench.size), "direct": _image(bench, 9.0)}
    history["position"][..., :3] += 5.0
    images = bench.compare({"direct": _image(bench, 1.0)}, history, declared=int(Reason.CUT))
    features = Reason.POSITION | Reason.NORMAL | Reason.DIRECT | Reason.DISOCCLUDED | Reason.OCCLUDING
    wrong = int((images.mask & np.uint32(features)).astype(bool).sum())
    wrong += int(((images.mask & np.uint32(NOT_COMPARABLE)) != Reason.CUT).sum())
    return count(0, wrong)


@case("each-color-channel", source=COUNT)
def each_color_channel(bench: Bench) -> Outcome:
    """Red, then green, then blue alone change by 0.25, threshold 0.125: pixels with reason COLOR.

    Luminance is compared, in which blue weighs 7 %.
    """
    pixels, counts = bench.size[0] * bench.size[1], []
    for channel in np.eye(3):
        now, then = {"color": _image(bench, 0.5 + 0.25 * channel)}, {"color": _image(bench, 0.5)}
        counts.append(int(bench.compare(now, then, thresholds={"color": 0.125}).counts["color"]))
    return Outcome(f"{pixels} each", ", ".join(map(str, counts)), float(sum(pixels - n for n in counts)))


@case("blended-normal", source="exact: the pixels between two columns")
def blended_normal(bench: Bench) -> Outcome:
    """Bilinear history halfway between normals of +60 and -60 degrees, now upright, threshold 0.25: NORMAL pixels.

    The blend has length 0.5, which differs by 0.5 from the unit normal it points along.
    """
    width, height = 32, 4
    current, history = np.zeros((height, width, 3)), np.zeros((height, width, 3))
    current[..., 2] = 1.0
    sign = np.where(np.arange(width) % 2 == 0, 1.0, -1.0)
    history[..., 0], history[..., 2] = math.sin(math.radians(60.0)) * sign, 0.5
    compared = bench.compare(
        {"normal": current}, {"normal": history}, shifted_pair((width, height), 0.5), sampling="bilinear",
        thresholds=limits({"normal": 0.25, "position": 10.0}),
    )  # fmt: skip
    inside = compared.has(Reason.NORMAL)[:, : width - 1]
    return count(0, int(inside.sum()))
