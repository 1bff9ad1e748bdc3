"""Cases: the arithmetic between masks and tables, as closed forms: rates, shares, cuts, wraps, weights, exposure."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import OrbitCamera, Poser, View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.animation.views import ORBIT_FILL
from taubench_gl.conventions import HISTOGRAM_BINS, Reason
from taubench_gl.effects.census import census
from taubench_gl.features import COLUMNS, FEATURES, MASK_WORDS
from taubench_gl.metrics import activity
from taubench_gl.metrics.counts import Counts, bin_of, edges
from taubench_gl.metrics.exposure import metered_exposure, rounded
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.metrics.pair_sample import PairSample, estimate, expected_half_width
from taubench_gl.metrics.sequence_stats import SequenceStats
from taubench_gl.reuse import quality
from taubench_gl.scene.model import Camera, Scene
from taubench_gl.selftest.bench import Bench, limits, shifted_pair
from taubench_gl.selftest.case import Naive, Outcome, case, count, field, worst
from taubench_gl.selftest.scenes import SceneBuilder, box, quad, turn

Array = np.ndarray

WORDS = {
    0: 101, Reason.COLOR: 7, Reason.SKY | Reason.HISTORY_SKY: 59, Reason.SKY | Reason.OUTSIDE: 11,
    Reason.SKY | Reason.POSITION | Reason.NORMAL | Reason.DISOCCLUDED: 13, Reason.FIRST: 17, Reason.CUT: 19,
    Reason.INVALID: 23, Reason.BEHIND: 29, Reason.OUTSIDE: 31, Reason.POSITION | Reason.DISOCCLUDED: 37,
    Reason.NORMAL: 41, Reason.DIRECT | Reason.LIT: 43, Reason.INDIRECT: 47, Reason.INDIRECT | Reason.COLOR: 53,
}  # fmt: skip
"""Reason word -> pixels, different primes, so that no two sums of them are equal by accident."""

TOTAL = sum(WORDS.values())
T1 = 12.7062047
"""97.5th percentile of Student's t of one degree of freedom."""

NOT_COMPARED = (Reason.FIRST, Reason.CUT, Reason.INVALID, Reason.BEHIND, Reason.OUTSIDE)


def _histogram(words: dict[int, int]) -> Array:
    out = np.zeros(MASK_WORDS, dtype=np.uint32)
    for word, pixels in words.items():
        out[int(word)] = pixels
    return out


def _stats(*pairs: dict[int, int]) -> SequenceStats:
    stats = SequenceStats(COLUMNS, {})
    for words in pairs:
        stats.add(Counts(_histogram(words), np.zeros((len(FEATURES), HISTOGRAM_BINS), dtype=np.int64)))
    return stats


def _pixels(*bits: Reason, without: tuple[Reason, ...] = ()) -> int:
    """Pixels of WORDS with any of ``bits`` (all pixels without them) and none of ``without``."""
    return sum(
        pixels for word, pixels in WORDS.items()
        if (not bits or any(word & bit for bit in bits)) and not any(word & bit for bit in without)
    )  # fmt: skip


@case(
    "headline",
    description="surface and shading reuse rates, their disjoint reasons and the share of sky, every kind of pixel: "
    "largest difference from shares of surface pixels, percentage points",
    elsewhere="the rate forgets normals or indirect light, or counts sky, which has nothing to shade",
    here="surface pixels without FIRST, CUT, INVALID, BEHIND, OUTSIDE, POSITION, NORMAL; shading also without light",
    tolerance=1e-12,
    source="float64: 64 ulps of 100",
)
def headline(bench: Bench) -> Outcome:
    geometry = (*NOT_COMPARED, Reason.POSITION, Reason.NORMAL, Reason.SKY)
    light = (*geometry, Reason.DIRECT, Reason.INDIRECT)
    surface = _pixels(without=(Reason.SKY,))
    # A second pair, all sky but one valid pixel: a rate is a total over a total, not a mean of shares.
    whole = surface + 1
    kept = {"surface": _pixels(without=geometry) + 1, "shading": _pixels(without=light) + 1}
    stats = _stats(WORDS, {0: 1, Reason.SKY | Reason.HISTORY_SKY: TOTAL - 1})
    block = stats.reuse.block("camera", np.array([False, True]))
    errors = []
    for rate, pixels in kept.items():
        shares = block[rate]
        errors += [
            shares["mean_percent"] - 100.0 * pixels / whole,
            shares["of_picture_percent"] - 100.0 * pixels / (2 * TOTAL), shares["pixels"] - pixels,
            shares["min_percent"] - 100.0 * (pixels - 1) / surface,
            shares["max_percent"] - 100.0, shares["without_cuts_mean_percent"] - 100.0 * (pixels - 1) / surface,
        ]  # fmt: skip
    reasons = {name: share["pixels"] for name, share in block["reasons"].items()}
    expected = {
        "first": 17, "cut": 19, "invalid": 23, "behind": 29, "outside": 31, "disoccluded": 37, "normal": 41, "lit": 43,
        "indirect": 47 + 53,
    }  # fmt: skip
    errors += [reasons[name] - expected.get(name, 0) for name in reasons]
    errors += [sum(reasons.values()) + kept["shading"] - whole]
    errors += [block["sky_percent"] - 100.0 * (2 * TOTAL - whole) / (2 * TOTAL), block["color_only"]["pixels"] - 7]
    naive = 100.0 * (_pixels(without=light[:-2]) - kept["shading"] + 1) / whole
    return field("shares of surface pixels", errors, Naive("without DIRECT and INDIRECT", f"off by {naive:.3g}", naive))


@case(
    "eq4-of-all-pixels",
    description="counts of every kind of pixel in Table 4: the largest difference from 100 n / (w h), percentage "
    "points",
    elsewhere="the share is taken of the comparable pixels: off-screen pixels make every other column larger",
    here="Eq. 4 divides by w h; the share of comparable pixels stands beside it",
    tolerance=1e-12,
    source="float64: 64 ulps of 100",
)
def eq4_of_all_pixels(bench: Bench) -> Outcome:
    stats = _stats(WORDS)
    discard = stats.discard(np.zeros(1, dtype=bool))
    bits = {
        "frustum": (Reason.BEHIND, Reason.OUTSIDE), "color": (Reason.COLOR,), "position": (Reason.POSITION,),
        "normal": (Reason.NORMAL,), "direct": (Reason.DIRECT,), "indirect": (Reason.INDIRECT,),
    }  # fmt: skip
    comparable, errors, naive = _pixels(without=NOT_COMPARED), [], []
    for column, reasons in bits.items():
        pixels = _pixels(*reasons)
        base = comparable + (pixels if column == "frustum" else 0)
        errors.append(discard[column]["mean_percent"] - 100.0 * pixels / TOTAL)
        errors.append(discard[column]["comparable_mean_percent"] - 100.0 * pixels / base)
        naive.append(100.0 * pixels / base - 100.0 * pixels / TOTAL)
    errors += [sum(stats.classes().values()) - TOTAL, stats.classes()["comparable"] - comparable]
    return field("100 n / (w h)", errors, Naive("100 n / comparable", f"off by {worst(naive):.3g}", worst(naive)))


@case(
    "means-over-pairs",
    description="three pairs with 10, 20 and 90 % of direct discards, the last a cut: mean, maximum, mean without cuts",
    elsewhere="a cut counts as a hundred percent of discards, or the maximum is that of the mean",
    here="means are over pairs; those without cuts leave out the pairs of camera cuts",
    tolerance=1e-12,
    source="float64: 64 ulps of 100",
)
def means_over_pairs(bench: Bench) -> Outcome:
    stats = _stats(*({0: 100 - n, Reason.DIRECT: n} for n in (10, 20, 90)))
    discards = stats.discard(np.array([False, False, True]))["direct"]
    expected = {"mean_percent": 40.0, "comparable_mean_percent": 40.0, "max_percent": 90.0}
    expected["without_cuts_mean_percent"] = 15.0
    return field("40, 90 and 15 %", [discards[name] - value for name, value in expected.items()])


@case(
    "curve-in-closed-form",
    description="distances on, just below and just above the edges of the histogram: pixels in a wrong bin or tail",
    elsewhere="logarithms round, so a distance on an edge lands on either side",
    here="bins are read from the bits of float32; a distance on an edge is in the bin above it",
    source="exact: integers",
)
def curve_in_closed_form(bench: Bench) -> Outcome:
    at = edges().astype(np.float32)
    below = np.nextafter(at, np.float32(0))
    wrong = int((bin_of(at) != np.arange(1, len(at) + 1)).sum() + (bin_of(below) != np.arange(len(at))).sum())
    wrong += int(bin_of(np.float32([0.0, np.inf])).tolist() != [0, HISTOGRAM_BINS - 1])
    histograms = np.zeros((len(FEATURES), HISTOGRAM_BINS), dtype=np.int64)
    histograms[:, 5], histograms[:, 9] = 3, 4
    stats = SequenceStats(COLUMNS, {})
    stats.add(Counts(_histogram({0: 20, Reason.BEHIND: 5}), histograms))
    for curve in stats.curves().values():
        tails = [curve["at_or_above"][i] for i in (0, 4, 5, 8, 9)]
        wrong += tails != [7, 7, 4, 4, 0] or curve["counts"][0] != 13 or curve["comparable"] != 20
    return count(0, wrong)


@case(
    "cut-of-a-surface",
    description="a surface that replaces another one in half of the image: pixels without CUT there, or with a "
    "feature bit",
    elsewhere="the new surface is compared with the old one: the cut is a discard by position",
    here="surfaces of Scene.replacements are marked in the frame in which they appear",
    source="exact: the pixels of the surface",
)
def cut_of_a_surface(bench: Bench) -> Outcome:
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(4.0, 8.0)), translation=(-4.0, 0.0, -4.0))
    old = b.node(mesh=b.mesh(quad(4.0, 8.0)), translation=(4.0, 0.0, -4.0))
    new = b.node(mesh=b.mesh(quad(4.0, 8.0)), translation=(4.0, 0.0, -3.0))
    b.animate(old, "visible", [0.0, 1.0], [[1.0], [0.0]], "STEP")
    b.animate(new, "visible", [0.0, 1.0], [[0.0], [1.0]], "STEP")
    b.camera(yfov=1.0, znear=0.1)
    scene = dataclasses.replace(b.build(), replacements=frozenset({new}))
    images = bench.pair(scene, (0.0, 1.0))
    replaced = np.zeros_like(images.mask, dtype=bool)
    replaced[:, images.mask.shape[1] // 2 :] = True
    # The border between both halves is a pixel column wide and belongs to neither.
    inner = np.abs(np.arange(images.mask.shape[1]) - (images.mask.shape[1] - 1) / 2) > 1
    wrong = (images.mask == np.where(replaced, Reason.CUT, 0)) ^ True
    return count(0, int((wrong & inner).sum()))


@case(
    "cuts-of-the-camera",
    description="a camera that steps 0.1 m a frame and jumps by 8 m once: statistics with and without the cut",
    elsewhere="the jump is part of the mean: 0.358 m instead of 0.1 m",
    here="every figure is given with all pairs and without cuts",
    tolerance=1e-12,
    source="float64: sums of 40 numbers",
)
def cuts_of_the_camera(bench: Bench) -> Outcome:
    steps = np.full(40, 0.1)
    steps[25] = 8.0
    path = np.zeros((41, 3))
    path[1:, 2] = np.cumsum(steps)
    moved = activity.camera_activity(path, np.tile(np.eye(3), (41, 1, 1)))
    cuts = activity.detect_cuts(moved)
    summary = activity.summarize(moved, cuts, 24.0, 5)
    mean = (39 * 0.1 + 8.0) / 40
    errors = [
        summary["position"]["mean"] - mean, summary["position"]["max"] - 8.0, summary["position"]["median"] - 0.1,
        summary["position"]["variance"] - (39 * (0.1 - mean) ** 2 + (8.0 - mean) ** 2) / 40,
        summary["position"]["p95"] - 0.1, summary["position"]["without_cuts"]["mean"] - 0.1,
        summary["position"]["without_cuts"]["max"] - 0.1, float(summary["cuts"] != [31]), summary["yaw"]["max"],
    ]  # fmt: skip
    return field("0.1 m without the cut", errors, Naive("mean of all pairs", mean, mean - 0.1))


@case(
    "wrap-table",
    description="differences of -540, -359, -190, -180, -179, 180, 181, 350, 540 and 725 degrees, wrapped",
    elsewhere="the number of turns is truncated: -190 stays -190, which is 170",
    here="the nearest whole number of turns is subtracted, and -180 becomes 180",
    source="exact: whole degrees",
)
def wrap_table(bench: Bench) -> Outcome:
    degrees = np.array([-540.0, -359.0, -190.0, -180.0, -179.0, 180.0, 181.0, 350.0, 540.0, 725.0])
    expected = np.array([180.0, 1.0, 170.0, 180.0, -179.0, 180.0, -179.0, -10.0, 180.0, 5.0])
    naive = worst(degrees - 360.0 * np.trunc(degrees / 360.0) - expected)
    errors = activity.wrap_degrees(degrees) - expected
    return field("(-180, 180]", errors, Naive("d - 360 trunc(d / 360)", f"off by {naive:g}", naive))


@case(
    "every-axis",
    description="yaw, pitch and roll of 7, -5 and 3 degrees a frame from 27 orientations: largest error in degrees",
    elsewhere="angles are exchanged, or of another order of axes",
    here="intrinsic Y-X-Z: yaw about world +Y, pitch about local X, roll about local Z",
    tolerance=1e-11,
    source="float64: atan2 near 1 to 4 ulps, in degrees",
)
def every_axis(bench: Bench) -> Outcome:
    errors = []
    for start in np.ndindex(3, 3, 3):
        first = np.array(start) * (110.0, 35.0, 100.0) - (110.0, 35.0, 100.0)
        angles = [first, first + (7.0, -5.0, 3.0)]
        rotations = np.array([math3d.mat3_from_quat(_euler(*a)) for a in angles])
        moved = activity.camera_activity(np.zeros((2, 3)), rotations)
        geodesic = math.degrees(math.acos((np.trace(rotations[0].T @ rotations[1]) - 1.0) / 2.0))
        errors += [moved.yaw[0] - 7.0, moved.pitch[0] - 5.0, moved.roll[0] - 3.0, 1e-3 * (moved.angle[0] - geodesic)]
        back = math3d.mat3_from_quat(math3d.quat_from_mat3(rotations[1]))
        errors.append(worst(back - rotations[1]))
    return field("7, 5 and 3 degrees", errors)


def _euler(yaw: float, pitch: float, roll: float) -> Array:
    """Quaternion of Ry Rx Rz, degrees."""
    y, x, z = turn((0.0, 1.0, 0.0), yaw), turn((1.0, 0.0, 0.0), pitch), turn((0.0, 0.0, 1.0), roll)
    return math3d.quat_multiply(math3d.quat_multiply(np.array(y), np.array(x)), np.array(z))


@case(
    "blended-normal",
    description="bilinear history halfway between normals of +60 and -60 degrees, now upright, threshold 0.25: NORMAL "
    "pixels",
    elsewhere="the blend has length 0.5, which differs by 0.5 from the unit normal it points along",
    here="a blend of normals is normalized; the feature is the direction",
    source="exact: the pixels between two columns",
)
def blended_normal(bench: Bench) -> Outcome:
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
    return count(0, int(inside.sum()), Naive("without normalization", inside.size, inside.size))


def _synthetic(view: View, size: tuple[int, int], rng: np.random.Generator) -> dict[str, Array]:
    """Channels of surfaces at smooth depths along the pixels' own rays, a tenth of it sky, the others random."""
    width, height = size
    x, y = np.meshgrid(
        (np.arange(width) - (width - 1) / 2) * 2 / height, ((height - 1) / 2 - np.arange(height)) * 2 / height
    )
    tangent = np.tan(view.camera.yfov / 2)
    rays = np.stack([x * tangent, y * tangent, -np.ones_like(x)], axis=-1)
    depth = 3.0 + np.sin(3.0 * x) + np.cos(5.0 * y)
    depth[(x - 0.4) ** 2 + y**2 < 0.2] = 1.2
    depth[rng.random(depth.shape) < 0.1] = 0.0
    position = np.concatenate([(rays * depth[..., None]) @ view.world_from_view.T, depth[..., None]], axis=-1)
    leaning = rng.normal([0.0, 0.0, 2.0], 0.2, (height, width, 3))
    channels = {
        "position": position, "normal": leaning / np.linalg.norm(leaning, axis=-1, keepdims=True),
        "prev_position": position[..., :3] + rng.normal(0.0, 0.1, (height, width, 3)),
        "direct": rng.exponential(0.1, (height, width, 3)), "indirect": rng.exponential(0.1, (height, width, 3)),
        "color": rng.random((height, width, 3)) * 0.3,
    }  # fmt: skip
    channels["direct"][rng.random((height, width)) < 0.02] = np.nan
    return {name: values.astype(np.float32).astype(np.float64) for name, values in channels.items()}


def _masks(bench: Bench, reprojected: str, sampling: str) -> Outcome:
    """The mask pass against its float64 reference: shares of pixels, and pixels of motion."""
    size, rng = (131, 77), np.random.default_rng(5)
    lens = Camera(yfov=1.1, znear=0.5, zfar=50.0)
    then = View(np.array([10.0, 2.0, -3.0]), math3d.mat3_from_quat(_euler(30.0, 0.0, 0.0)), lens)
    now = View(then.position + (0.3, -0.1, 0.6), math3d.mat3_from_quat(_euler(37.0, 0.0, 3.0)), lens)
    current, history = _synthetic(now, size, rng), _synthetic(then, size, rng)
    pair = reprojection(now, then, *size)
    how = {"reprojection": reprojected, "sampling": sampling}
    images = bench.compare(current, history, pair, exposure=2.0, **how)
    expected = pair_masks(current, history, pair, limits(None), exposure=2.0, **how)
    off = [float((images.mask != expected.mask).mean())]
    for measured, feature in zip(images.counted.histograms.astype(np.int64), FEATURES, strict=True):
        tails = [np.cumsum(counts[:0:-1]) for counts in (measured, expected.histogram(feature))]
        off.append(worst(tails[0] - tails[1]) / images.mask.size)
    moved = np.abs(expected.motion_px).max(axis=-1)
    seen = (moved < 500.0) & ((expected.mask & Reason.INVALID) == 0)
    off.append(worst((images.motion - expected.motion_px)[seen]))
    return field("the reference", off)


def _masks_case(reprojected: str, sampling: str) -> None:
    @case(
        f"masks-{reprojected}-{sampling}",
        description=f"{sampling} history, {reprojected} reprojection, random channels of all features: share of "
        "pixels whose reason word or distance differs from the float64 reference, and largest error of motion in "
        "pixels",
        elsewhere="one term of one feature is wrong, which a scene with a known answer may not show",
        here="the shader and a NumPy implementation agree pixel by pixel",
        tolerance=1e-3,
        source="float32: pixels whose distance or position is within rounding of its limit",
    )
    def masks(bench: Bench) -> Outcome:
        return _masks(bench, reprojected, sampling)


for _names in itertools.product(("camera", "motion"), ("nearest", "bilinear")):
    _masks_case(*_names)


@case(
    "reuse-measures",
    description="PSNR, MSE, relMSE, trimmed relMSE, SSIM, flicker and warp error of constant and shifted images",
    elsewhere="PSNR of linear values, relMSE without its epsilon, history read at the wrong side of the motion",
    here="one function per measure (docs/reuse-evaluation.md)",
    tolerance=1e-9,
    source="float64; SSIM of constants: (2 a b + c) / (a^2 + b^2 + c), c = 0.01^2",
)
def reuse_measures(bench: Bench) -> Outcome:
    shape = (16, 20, 3)
    a, b = np.full(shape, 0.5), np.full(shape, 0.4)
    step = np.zeros(shape)
    step[:, 10:] = 1.0  # an edge that moves one pixel to the right: history is one pixel to the left
    before = np.roll(step, -1, axis=1)
    before[:, -1] = 1.0
    motion = np.zeros((*shape[:2], 2))
    motion[..., 0] = -1.0
    everywhere = np.ones(shape[:2], dtype=bool)
    left_out = everywhere.copy()
    left_out[:, 9] = False
    fireflies = a.copy()
    fireflies[0, 0] = 1e6
    words = np.array([0, Reason.SKY, Reason.DIRECT, Reason.CUT])
    ssim = (2 * 0.5 * 0.4 + 1e-4) / (0.25 + 0.16 + 1e-4)
    errors = [
        quality.psnr(quality.squared_error(a, b).mean()) - 20.0,
        float(quality.psnr(0.0) is not None),
        worst(quality.linear_squared_error(a, b) - 0.01),
        worst(quality.relative_squared_error(a, b) - 0.01 / (0.16 + 0.01)),
        quality.trimmed_relative_error(fireflies, a, 2.0),
        quality.trimmed_relative_error(a, b, 2.0) - 0.04 / (0.64 + 0.01),
        quality.ssim(a, b) - ssim,
        worst(quality.temporal_squared_error(a, b, b, b) - 0.01),
        worst(quality.history_of(before, motion) - step),
        quality.flicker(step, before, step, before, np.zeros_like(motion), everywhere),
        quality.flicker(a, b, b, b, motion, everywhere) - 0.1,
        quality.warp_error(step, before, motion, everywhere),
        quality.warp_error(step, before, np.zeros_like(motion), everywhere) - 1.0 / 20.0,
        quality.warp_error(step, before, np.zeros_like(motion), left_out),
        float(quality.warp_error(a, b, motion, ~everywhere) is not None),
        worst(quality.display(np.full((1, 1, 3), 0.0031308)) - 12.92 * 0.0031308),
        worst(quality.display(np.full((1, 1, 3), 0.5)) - (1.055 * 0.5 ** (1 / 2.4) - 0.055)),
        float(quality.reusable(words).tolist() != [True, True, False, False]),
    ]  # fmt: skip
    return field("closed forms", errors)


@case(
    "weights-of-pairs",
    description="two strata of 6 and 4 pairs, two sampled of each: weights, mean and 95 % interval",
    elsewhere="sampled pairs are averaged with equal weights",
    here="Cochran, Sampling Techniques, Eqs. 5.1, 5.13 and 5.16",
    tolerance=1e-6,
    source="Student's t of 1 degree of freedom, as only one stratum varies, has seven decimals; the rest is float64",
)
def weights_of_pairs(bench: Bench) -> Outcome:
    sample = PairSample(10, ((6, (1, 4)), (4, (6, 9))))
    all_pairs = estimate(sample, np.array([10.0, 14.0, 30.0, 30.0]))
    half = T1 * math.sqrt(0.6**2 * (1 - 2 / 6) * 8.0 / 2)
    one_stratum = estimate(PairSample(10, ((6, (1, 4)), (4, (6, 7, 8, 9)))), np.array([10.0, 14.0, 1.0, 2.0, 3.0, 4.0]))
    whole = estimate(PairSample(3, ((3, (0, 1, 2)),)), np.array([1.0, 2.0, 6.0]))
    planned = 1.9599640 * 0.6 * math.sqrt((1 - 2 / 6) * 0.3 / 2)  # S^2 = 0.3 in the first stratum, 0 in the second
    errors = [
        worst(sample.weights - [0.3, 0.3, 0.2, 0.2]), all_pairs.mean - 19.2, 1e-2 * (all_pairs.half_width - half),
        one_stratum.mean - (0.6 * 12.0 + 0.4 * 2.5), 1e-2 * (one_stratum.half_width - half),
        whole.mean - 3.0, whole.half_width,
        expected_half_width(sample, np.array([1.0, 2.0, 1.0, 2.0, 1.0, 2.0, 5.0, 5.0, 5.0, 5.0])) / planned - 1.0,
    ]  # fmt: skip
    return field("19.2", errors, Naive("equal weights", 21.0, 1.8))


@case(
    "metered-exposure",
    description="luminance of 0.5 in 80 pixels, 1e-6 in 5, 1e6 in 5 and black in 10; then 10 % of pixels with a "
    "channel of 4",
    elsewhere="the sun in a mirror or a black corner moves the log-average",
    here="log-average of the lit pixels between the 10th and 90th percentile goes to 0.18, at most 5 % clip",
    tolerance=1e-12,
    source="float64: exp and log of 80 numbers",
)
def exposure_of_percentiles(bench: Bench) -> Outcome:
    gray = np.concatenate([np.full(80, 0.5), np.full(5, 1e-6), np.full(4, 1e6), np.zeros(10)])[:, None] * np.ones(3)
    red = np.full((100, 3), 0.01)
    red[:10] = (4.0, 0.0, 0.0)
    naive = 0.18 / math.exp(np.log(gray[gray[:, 0] > 0, 0]).mean())
    errors = [
        metered_exposure(gray) / 0.36 - 1.0, metered_exposure(red) / 0.25 - 1.0,
        float(metered_exposure(np.zeros((4, 3))) is not None),
        rounded(0.123456) / 0.1234 - 1.0, rounded(99999.0) / 99990.0 - 1.0,
    ]  # fmt: skip
    return field("0.36 and 0.25", errors, Naive("log-average of all", naive, abs(naive / 0.36 - 1.0)))


@case(
    "scene-statistics",
    description="a scene with 2 moving and 3 still objects, a moving and a still lamp, a sun that turns, a moving "
    "camera",
    elsewhere="children of moving nodes count as still, or lights by their intensity alone",
    here="an object is dynamic if its own or an ancestor's transform changes over the evaluated times",
    source="exact: counts",
)
def scene_statistics(bench: Bench) -> Outcome:
    b = SceneBuilder()
    still = [b.node(mesh=b.mesh(box())) for _ in range(3)]
    moving = b.node(mesh=b.mesh(box()))
    b.node(moving, mesh=b.mesh(box()))
    lamp = b.light(kind="point", intensity=1.0, color=(1.0, 0.0, 0.0))
    b.light(kind="point", intensity=1.0)
    sun = b.light(kind="directional", intensity=1.0)
    camera = b.camera()
    for node in (moving, lamp, camera):
        b.animate(node, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    b.animate(sun, "rotation", [0.0, 1.0], [turn((1.0, 0.0, 0.0), 0.0), turn((1.0, 0.0, 0.0), 60.0)])
    scene = b.build()
    counts = census(scene, (0.0, 0.5, 1.0), Poser(scene))
    expected = {
        "dynamic_rigid_objects": 2, "static_rigid_objects": len(still), "drawn_meshes": 5, "triangles": 60,
        "static_point_lights": 1, "dynamic_point_lights": 1, "dynamic_directional_lights": 1,
        "static_directional_lights": 0, "static_spot_lights": 0, "cameras": 1, "cameras_dynamic": 1, "armatures": 0,
        "bones": 0, "morphs": 0,
    }  # fmt: skip
    wrong = [name for name, value in expected.items() if counts[name] != value]
    wrong += ["moved"] * (counts["lights_per_frame"]["moved"] != [2, 2])
    return Outcome("no difference", ", ".join(wrong) or "no difference", float(len(wrong)))


@case(
    "behind-a-board",
    description="a camera that moves 0.35 m sideways before a board and a wall, exact visibility: pixels in a wrong "
    "class, and visible points whose light changed",
    elsewhere="disocclusion is guessed from depths, which depends on a tolerance",
    here="a ray to every surface point through the frame before; the light of the same points",
    source="exact: the strip that the board hid is known, and no edge of it meets a pixel center",
)
def behind_a_board(bench: Bench) -> Outcome:
    (width, height), half, board, wall, step = (96, 64), 0.4, 2.0, 5.0, 0.35
    b = SceneBuilder()
    matte = b.material(base_color=(0.5, 0.5, 0.5, 1.0), metallic=0.0, roughness=1.0, specular=0.0)
    b.node(mesh=b.mesh(quad(half, 9.0, material=matte)), translation=(0.0, 0.0, -board))
    b.node(mesh=b.mesh(quad(30.0, 30.0, material=matte)), translation=(0.0, 0.0, -wall))
    b.light(translation=(1.0, 2.0, 0.0), kind="point", intensity=40.0)
    camera = b.camera(yfov=math.radians(60.0), znear=0.1)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (step, 0.0, 0.0)])
    run = bench.evaluate(
        b.build(), width=width, height=height, fps=1.0, reprojection="motion", exact=True, shadow_lights=0,
        columns=("frustum", "position", "normal", "direct"),
    )  # fmt: skip
    scale, x = height / 2 / math.tan(math.radians(30.0)), np.arange(width) - (width - 1) / 2
    on_board = np.abs(x / scale * board + step) < half
    outside = x + step / np.where(on_board, board, wall) * scale > (width - 1) / 2
    hidden = ~on_board & (np.abs(x / scale * wall + step) < half * wall / board)
    classes = {
        "exact_outside": outside, "occluded": hidden & ~outside, "visible": ~hidden & ~outside,
        "exact_behind": np.zeros(width, dtype=bool),
    }  # fmt: skip
    (row,) = run.frames
    wrong = sum(abs(row[name] - height * int(columns.sum())) for name, columns in classes.items())
    wrong += sum(row[name] for name in ("exact_new", "exact_invalid", "brightened", "darkened", "view_dependent"))
    block = run.summary["exact"]["occluded"]
    wrong += abs(block["mean_percent"] - 100.0 * (hidden & ~outside).mean()) > 1e-9 or row["missed"] > row["occluded"]
    return count(0, int(wrong))


@case(
    "orbit",
    description="a still box of 2 x 4 x 6 m without a camera: its share of the image, its center, the orbit's step and "
    "place",
    elsewhere="a bounding sphere is framed, so a long object fills a part of the image; speed depends on the distance",
    here="the posed corners fill 80 % of the image and are centered; the camera moves 2 % of the diagonal a frame",
    tolerance=1e-6,
    source="relative; the framing is exact at 25 times or more, the step is that of a root to 1e-12",
)
def orbit(bench: Bench) -> Outcome:
    def boxed(place: tuple[float, float, float]) -> Scene:
        b = SceneBuilder()
        b.node(mesh=b.mesh(box((1.0, 2.0, 3.0))), translation=place)
        return b.build()

    scene, (width, height) = boxed((5.0, 0.0, -7.0)), (160, 90)
    camera, home = (OrbitCamera(one, size=(width, height)) for one in (scene, boxed((0.0, 0.0, 0.0))))
    corners = np.array(list(itertools.product((4.0, 6.0), (-2.0, 2.0), (-10.0, -4.0))))
    low, high, poser, views = np.full(2, np.inf), np.full(2, -np.inf), Poser(scene), []
    for time in camera.times:
        view = camera.view_at(poser.sample(time))
        seen = (corners - view.position) @ view.world_from_view
        at = seen[:, :2] / -seen[:, 2:] / math.tan(math.radians(22.5)) / (width / height, 1.0)
        low, high = np.minimum(low, at.min(axis=0)), np.maximum(high, at.max(axis=0))
        views.append(view)
    steps = [camera.view_at(poser.sample(frame / 24.0)).position for frame in range(3)]
    moved = camera.view_at(poser.sample(0.7)).position - home.view_at(poser.sample(0.7)).position
    filled, centered = high.max(), (low + high)[np.argmax(high)]  # the axis that the box fills
    errors = [
        filled / ORBIT_FILL - 1.0, centered, worst(moved - (5.0, 0.0, -7.0)),
        camera.subject_size / math.sqrt(56.0) - 1.0,
        *(np.linalg.norm(np.diff(steps, axis=0), axis=-1) / (0.02 * math.sqrt(56.0)) - 1.0),
        min(float(np.abs(v.world_from_view[1, 2] - math.sin(math.radians(20.0)))) for v in views),
    ]  # fmt: skip
    return field("80 % and 0.1497 m", errors)
