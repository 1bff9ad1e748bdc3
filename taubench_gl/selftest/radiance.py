"""Cases: radiance that is huge, tiny, not a number, or exactly on its threshold, fed straight to the mask pass."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import FEATURES, FRUSTUM, HISTOGRAM_BINS, NOT_COMPARABLE, Reason
from taubench_gl.metrics.counts import bin_of
from taubench_gl.selftest.bench import Bench, shifted_pair
from taubench_gl.selftest.case import Naive, Outcome, case, count

Array = np.ndarray
COUNT = "exact: an unsigned count on the GPU"
DIRECT = FEATURES.index("direct")


def _picture(bench: Bench, value: object) -> Array:
    """The same radiance everywhere.  (h, w, 3) float64."""
    return np.zeros((bench.size[1], bench.size[0], 3)) + np.asarray(value, dtype=np.float64)


@case(
    "radiance-range",
    what="radiance of 1e-8, 1e-7 .. 1e8 that doubles from one frame to the next: pixels past the threshold",
    elsewhere="half-float buffers make 1e-8 zero and 1e8 Inf, whose difference is NaN and counts as unchanged",
    here="float32 radiance; a difference is compared, not a quotient",
    source="closed form: sqrt(3) times the value against 32/255; " + COUNT,
)
def radiance_range(bench: Bench) -> Outcome:
    powers = 10.0 ** np.linspace(-8, 8, bench.size[0]).round()
    before = _picture(bench, powers[None, :, None])
    images = bench.compare({"direct": 2 * before}, {"direct": before})
    expected = int((np.sqrt(3) * before[..., 0] > 32 / 255).sum())
    with np.errstate(over="ignore", invalid="ignore"):
        change = (2 * before).astype(np.float16) - before.astype(np.float16)
        naive = int((np.sqrt(np.sum(change.astype(float) ** 2, axis=-1)) > 32 / 255).sum())
    return count(expected, images.counts["direct"], Naive("half floats", naive, abs(naive - expected)))


@case(
    "radiance-histogram",
    what="the same radiance in the histogram of distances: pixels in a bin that is not the closed form's",
    elsewhere="log2 on the GPU differs in its last bits from driver to driver, and values on a bin's edge move",
    here="bins are cut from the bits of the float, the same on every machine",
    source=COUNT + "; distances off every bin's edge by more than 1e-5 of themselves",
)
def radiance_histogram(bench: Bench) -> Outcome:
    powers = 10.0 ** np.linspace(-8, 8, bench.size[0]).round()
    before = _picture(bench, powers[None, :, None])
    images = bench.compare({"direct": 2 * before}, {"direct": before})
    bins = np.bincount(bin_of(np.sqrt(3) * before[..., 0]).ravel(), minlength=HISTOGRAM_BINS)
    got = images.counted.histograms[DIRECT].astype(np.int64)
    return count(0, int(np.abs(got - bins)[1:].sum()))  # the GPU leaves bin 0 out: it is what remains


def _poisoned(name: str, value: float, frame: str) -> None:
    @case(
        name,
        what=f"{value} in 100 texels of the {frame} frame's radiance: pixels that are a counted class of their own",
        elsewhere="a NaN compares false with every threshold: the worst pixels of all count as reusable",
        here="tests on the bits of the float, which no fast-math removes: reason INVALID",
        source=COUNT,
    )
    def poisoned(bench: Bench) -> Outcome:
        bad = _picture(bench, 0.5)
        bad.reshape(-1, 3)[7 : 7 + 100 * 11 : 11, 1] = value
        good = _picture(bench, 0.5)
        now, then = (bad, good) if frame == "current" else (good, bad)
        images = bench.compare({"direct": now}, {"direct": then})
        with np.errstate(invalid="ignore"):
            naive = int((np.linalg.norm(now - then, axis=-1) > 32 / 255).sum()) if np.isnan(value) else 100
        measured = int((images.mask == Reason.INVALID).sum())
        missing = Naive("NaN > threshold", naive, 100 - naive) if np.isnan(value) else None
        return count(100, measured, missing)


_poisoned("nan-current", np.nan, "current")
_poisoned("nan-history", np.nan, "previous")
_poisoned("inf-current", np.inf, "current")
_poisoned("inf-history", -np.inf, "previous")


@case(
    "nan-beside-bilinear",
    what="bilinear history half a pixel away, every second column NaN: pixels that are invalid",
    elsewhere="one NaN tap makes the blend NaN: it spreads by a pixel every frame",
    here="taps that are not finite are left out of the blend and the weights renormalised",
    source=COUNT + "; the last column's only other tap is beyond the screen",
)
def nan_beside_bilinear(bench: Bench) -> Outcome:
    history = _picture(bench, 0.5)
    history[:, ::2] = np.nan
    pair = shifted_pair(bench.size, 0.5)
    images = bench.compare({"direct": _picture(bench, 0.5)}, {"direct": history}, pair, sampling="bilinear")
    alive = int((~images.has(FRUSTUM)).sum())
    return count(0, images.counts["invalid"], Naive("plain blend", alive, alive))


@case(
    "invalid-position",
    what="NaN in the stored position of 64 pixels: INVALID, and the classes still add up to w h",
    elsewhere="NaN < 0 and NaN > w are both false: the pixel is 'on screen'",
    here="checked before the reprojection; classes are exclusive",
    source=COUNT,
)
def invalid_position(bench: Bench) -> Outcome:
    wall = bench.wall(bench.size)
    wall["position"].reshape(-1, 4)[100:164, 0] = np.nan
    c = bench.compare(wall, bench.wall(bench.size)).counts
    lost = abs(c["pixels"] - sum(c[n] for n in ("first", "cut", "invalid", "frustum", "comparable")))
    return count(64, c["invalid"] + lost)


def _threshold_images(bench: Bench, feature: str, change: float):
    """Every pixel's ``feature`` changes by ``change`` along one axis; the threshold is 1/8."""
    now, then = {}, {}
    if feature == "position":
        then = bench.wall(bench.size)
        now = {**then, "position": then["position"].copy()}
        then["position"] = then["position"].copy()
        now["position"][..., :2] = then["position"][..., :2] = 0.0
        now["position"][..., 2] -= change
        # Both on the optical axis, so that the difference of two float32 numbers near 1 is exact.
    elif feature == "normal":
        then = {**bench.wall(bench.size), "normal": _picture(bench, (0.0, 0.0, 1.0))}
        now = {**then, "normal": _picture(bench, (change, 0.0, 1.0))}
    else:
        then, now = {feature: _picture(bench, 0.0)}, {feature: _picture(bench, (0.0, change, 0.0))}
    return bench.compare(now, then, thresholds={feature: 0.125})


def _on_threshold(feature: str) -> None:
    @case(
        f"on-threshold-{feature}",
        what=f"{feature} changes by exactly its threshold of 1/8, then by one float more: discards minus expected",
        elsewhere="'>=' discards what has not passed its limit: with 8-bit data a whole grey level",
        here="strictly greater, in the float32 of the channel",
        source="exact: 1/8 and its neighbour are floats, and their squares' roots are exact or on the right side",
    )
    def on_threshold(bench: Bench) -> Outcome:
        # Positions near 1 m have steps of 2^-23 m, so that is the next distance there can be.
        above = 0.125 + 2.0**-23 if feature == "position" else 0.125 + 2.0**-22
        exactly = _threshold_images(bench, feature, 0.125).counts[feature]
        more = _threshold_images(bench, feature, above).counts[feature]
        pixels = bench.size[0] * bench.size[1]
        naive = Naive("distance >= threshold", pixels, pixels)
        return Outcome(f"0, {pixels}", f"{exactly}, {more}", float(exactly + pixels - more), naive)


for _feature in ("position", "normal", "direct", "indirect", "color"):
    _on_threshold(_feature)


@case(
    "lit-and-shadowed",
    what="a third of the picture gets lighter, a third darker, a third keeps its luminance but changes colour",
    elsewhere="only |change| is kept: a shadow that comes and one that goes look the same",
    here="LIT where luminance rose, SHADOWED where it fell, neither where it did not change",
    source=COUNT,
)
def lit_and_shadowed(bench: Bench) -> Outcome:
    third = bench.size[0] // 3
    before, now = _picture(bench, 1.0), _picture(bench, 1.0)
    now[:, :third] = 2.0
    now[:, third : 2 * third] = 0.25
    c = bench.compare({"direct": now}, {"direct": before}).counts
    expected = third * bench.size[1]
    return Outcome(
        f"{expected} lit, {expected} shadowed", f"{c['lit']} lit, {c['shadowed']} shadowed",
        float(abs(c["lit"] - expected) + abs(c["shadowed"] - expected)),
    )  # fmt: skip


@case(
    "not-compared-not-counted",
    what="everything differs, but the frame is declared a cut: pixels with any feature bit",
    elsewhere="discards for one reason are counted again for the others, and percentages pass 100",
    here="FIRST, CUT, INVALID and frustum pixels take no part in the features",
    source=COUNT,
)
def not_compared(bench: Bench) -> Outcome:
    history = {**bench.wall(bench.size), "direct": _picture(bench, 9.0)}
    history["position"][..., :3] += 5.0
    images = bench.compare({"direct": _picture(bench, 1.0)}, history, declared=int(Reason.CUT))
    features = Reason.POSITION | Reason.NORMAL | Reason.DIRECT | Reason.DISOCCLUDED | Reason.OCCLUDING
    wrong = int((images.mask & np.uint32(features)).astype(bool).sum())
    wrong += int(((images.mask & np.uint32(NOT_COMPARABLE)) != Reason.CUT).sum())
    return count(0, wrong)
