"""Cases: functions in float64 against closed forms, laws and second implementations."""

from __future__ import annotations

import itertools
import math

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import Poser, curves
from taubench_gl.animation.jitter import grid_offsets, halton_jitter, radical_inverse
from taubench_gl.animation.surface import previous_point
from taubench_gl.conventions import HISTOGRAM_BINS, Reason
from taubench_gl.features import MASK_WORDS
from taubench_gl.frame.materials import texels_at
from taubench_gl.metrics import activity, blending, environment
from taubench_gl.metrics.counts import Counts, discarded_above, edges
from taubench_gl.metrics.pair_sample import PER_STRATUM, sample_pairs
from taubench_gl.metrics.reuse_rate import ReuseStats
from taubench_gl.metrics.sequence_stats import sensitivity
from taubench_gl.scene.gltf import meshes
from taubench_gl.scene.model import Channel, Sampler, Texture
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, field, worst
from taubench_gl.selftest.scenes import SceneBuilder, quad, turn, turn_x
from taubench_gl.srgb import srgb_decode, srgb_encode

Array = np.ndarray
DOUBLE = "float64: sums and products of a few numbers"


def _rotations(count: int = 40) -> Array:
    """Random unit quaternions, and those with the largest component at each place and sign.  (n, 4)."""
    rng = np.random.default_rng(1)
    near = np.concatenate([np.eye(4), -np.eye(4)]) + 0.1 * rng.normal(size=(8, 4))
    return math3d.normalize(np.concatenate([rng.normal(size=(count, 4)), near]))


@case(
    "rotations-and-projections",
    description="quaternions, matrices, normals and projections of random arguments: largest difference from "
    "Rodrigues' formula, cofactors, and corners of the view",
    elsewhere="one sign of twelve terms is wrong where no axis-aligned example shows it",
    here="each function is compared with another formula",
    tolerance=1e-12,
    source=DOUBLE,
)
def rotations_and_projections(bench: Bench) -> Outcome:
    rng = np.random.default_rng(2)
    errors: list[float] = []
    for q in _rotations():
        axis, angle = math3d.normalize(q[:3]), 2.0 * math.atan2(np.linalg.norm(q[:3]), q[3])
        cross = np.cross(np.eye(3), axis)
        matrix = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
        other = math3d.normalize(rng.normal(size=4))
        product = math3d.quat_multiply(q, other)
        back = math3d.quat_from_mat3(matrix)
        turned = math3d.quat_multiply(math3d.quat_from_axis_angle(3.0 * axis, 0.7), q)
        errors += [
            worst(math3d.mat3_from_quat(2.5 * q) - matrix), worst(back - q * (1 if q[3] >= 0 else -1)),
            min(back[3], 0.0),
            worst(math3d.mat3_from_quat(product) - matrix @ math3d.mat3_from_quat(other)),
            worst(math3d.quat_from_axis_angle(2.0 * axis, angle) - q), math3d.quat_angle(q, -turned) - 0.7,
        ]  # fmt: skip
        m = matrix @ np.diag(rng.normal(size=3)) @ math3d.mat3_from_quat(other)
        scaled = np.linalg.inv(m).T * abs(np.linalg.det(m))
        place, point = rng.normal(size=3), rng.normal(size=3)
        whole = math3d.trs(place, q, np.array([1.0, -2.0, 3.0]))
        errors += [
            worst(math3d.normal_matrix(m) - scaled) / worst(scaled),
            worst(math3d.transform_points(whole, point) - (matrix @ (point * [1.0, -2.0, 3.0]) + place)),
            worst(whole[3] - [0, 0, 0, 1]),
        ]
        frame = math3d.orthonormal(m)
        up = m[:, 1] - frame[:, 2] * (m[:, 1] @ frame[:, 2])
        errors += [
            worst(frame.T @ frame - np.eye(3)), np.linalg.det(frame) - 1.0,
            worst(frame[:, 2] - math3d.normalize(m[:, 2])), worst(frame[:, 1] - math3d.normalize(up)),
        ]  # fmt: skip
    flat = math3d.orthonormal(np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, 0]]))
    errors += [worst(flat - np.eye(3)), worst(math3d.orthonormal(np.zeros((3, 3))) - np.eye(3))]
    tangent = math.tan(0.35)
    for far in (50.0, math.inf):
        lens = math3d.perspective_reversed(0.7, 1.5, 0.5, far)
        for depth, z in ((0.5, 1.0), (50.0, 0.0 if far == 50.0 else 0.01)):
            clip = lens @ [1.5 * tangent * depth, -tangent * depth, -depth, 1.0]
            errors.append(worst(clip / clip[3] - [1.0, -1.0, z, 1.0]))
    for depth, z in ((0.5, 1.0), (50.0, 0.0)):
        errors.append(worst(math3d.orthographic_reversed(3.0, 2.0, 0.5, 50.0) @ [3, -2, -depth, 1] - [1, -1, z, 1]))
    return field("the other formula", errors)


def _de_casteljau(v0: Array, out0: Array, in1: Array, v1: Array, u: float, dt: float) -> Array:
    """The cubic of glTF as a Bezier curve."""
    points = [v0, v0 + dt * out0 / 3.0, v1 - dt * in1 / 3.0, v1]
    while len(points) > 1:
        points = [a + u * (b - a) for a, b in itertools.pairwise(points)]
    return points[0]


@case(
    "curves-by-other-formulas",
    description="random keys of every interpolation at times before, on, between and after them: largest difference "
    "from de Casteljau's construction and rotations about one axis",
    elsewhere="a tangent of the other key, a segment too far, the long way round",
    here="one function interpolates; it is compared with geometry",
    tolerance=1e-12,
    source=DOUBLE,
)
def curves_by_other_formulas(bench: Bench) -> Outcome:
    rng = np.random.default_rng(4)
    times = np.array([0.5, 0.75, 2.0, 2.25, 4.0])
    values, cubic = rng.normal(size=(5, 3)), rng.normal(size=(5, 3, 3))
    shown = np.array([1.0, 0.0, 1.0, 1.0, 0.0])
    angles = np.array([0.0, 2.0, -0.5, 2.5, 2.5])
    turns = np.array([turn((1.0, 2.0, -0.5), math.degrees(a)) for a in angles]) * [[1], [-1], [1], [-1], [1]]
    errors = []
    for t in (0.0, 0.5, 0.6, 0.75, 1.0, 1.9, 2.0, 2.1, 3.0, 3.999, 4.0, 9.0):
        i = int(np.clip((times <= t).sum() - 1, 0, 4))
        j = min(i + 1, 4) if t >= times[0] else i
        dt = times[j] - times[i]
        u = (t - times[i]) / dt if dt else 0.0
        angle = angles[i] + u * (angles[j] - angles[i])
        bent = _de_casteljau(cubic[i, 1], cubic[i, 2], cubic[j, 0], cubic[j, 1], u, dt)
        long_way = abs(angles[j] - angles[i]) > math.pi
        samples = {
            ("translation", "LINEAR"): (values, (1 - u) * values[i] + u * values[j]),
            ("translation", "STEP"): (values, values[i]), ("scale", "CUBICSPLINE"): (cubic, bent),
            ("rotation", "LINEAR"): (turns, None if long_way else turn((1.0, 2.0, -0.5), math.degrees(angle))),
            ("rotation", "STEP"): (turns, turns[i]), ("visible", "LINEAR"): (shown[:, None], shown[i : i + 1]),
            ("visible", "CUBICSPLINE"): (np.stack([1 - shown, shown, 1 - shown], axis=1)[..., None], shown[i : i + 1]),
        }  # fmt: skip
        for (path, interpolation), (keys, expected) in samples.items():
            sampled = curves.sample_channel(Channel("node", 0, path, interpolation, times, keys), t)
            if path == "rotation" and expected is not None:
                sampled = sampled * np.sign(sampled @ expected)
            errors.append(worst(sampled - expected) if expected is not None else abs(np.linalg.norm(sampled) - 1.0))
        around = curves.segment(times, t)
        errors += [float(around[0] != i), around[2] - u, around[3] - dt]
    return field("the other formula", errors)


@case(
    "bound-of-blends",
    description="colors on and off the segment between input and history: weights, blends, used history",
    elsewhere="a projection without its clamp, or a history that equals the input gives 0 / 0",
    here="closed forms of metrics.blending for known weights",
    tolerance=1e-12,
    source=DOUBLE,
)
def bound_of_blends(bench: Bench) -> Outcome:
    now, history = np.array([1.0, 2.0, 3.0]), np.array([3.0, 1.0, 3.5])
    off = np.array([1.0, 2.0, 0.0])  # at right angles to history - now
    at = now + 0.25 * (history - now)
    moved = history + 0.5 * np.linalg.norm(history - now) * off / math.sqrt(5.0)
    weights = [
        blending.nearest_weight(x, now, history) for x in (at + off, 3 * now - 2 * history, 3 * history - 2 * now)
    ]
    # A rectification of less than ON_SEGMENT counts as rounding.
    edge = 2.0 * blending.ON_SEGMENT * 3.5 / np.linalg.norm(history - now)
    used = [blending.effective_weight(0.8, now, history, x) for x in (history, moved, now, 5 * moved)]
    both = np.tile([[now], [history]], (1, 6, 1))
    colors = at, now, history, at + 1e-3 * off, at + 2e-6 * off, 1.001 * history - 0.001 * now
    errors = [
        worst(np.subtract(weights, [0.25, 0.0, 1.0])), float(blending.nearest_weight(at, now, now)),
        worst(blending.blend(now, history, np.array(0.25)) - at),
        worst(np.subtract(used, [0.8, 0.4 + 0.4 * edge, 0.4 * edge, 0.0])),
        worst(blending.used_history(at, now, history, np.array(0.25)) - history),
        worst(blending.used_history(at, now, history, np.array(0.0)) - history),
        float(blending.effective_weight(0.8, now, now, now)) - 0.8,
        float(blending.on_segment(np.stack(colors), *both).tolist() != [True, True, True, False, True, False]),
        float(not blending.on_segment(5e-10 * np.ones(3), np.zeros(3), np.zeros(3))),
    ]  # fmt: skip
    return field("known weights", errors)


def _linear_sky(direction: Array) -> Array:
    """Radiance that is linear in the direction: every lobe of it has a closed form.  (..., 3) -> (..., 3)."""
    return 1.0 + direction @ np.array([[0.3, 0.1, -0.2], [0.2, -0.4, 0.1], [-0.1, 0.2, 0.3]])


@case(
    "lobes-of-a-linear-sky",
    description="a sky 1 + a . d: lookups, its mean over larger pixels, its diffuse irradiance 1 + 2/3 a . n, a GGX "
    "lobe by quadrature, and the probability of its directions",
    elsewhere="an image turned by a quarter, weights without the solid angle of a row, a kernel that is not normalized",
    here="a linear function stays linear under every lobe around the normal",
    tolerance=2e-3,
    source="relative to 1; maps of 64 rows: midpoint rule, (pi / 64)^2",
)
def lobes_of_a_linear_sky(bench: Bench) -> Outcome:
    height = 64
    d = environment.directions(height)
    theta, phi = (np.arange(height) + 0.5) * np.pi / height, (np.arange(2 * height) + 0.5) * np.pi / height - np.pi
    expected = np.stack([np.outer(np.sin(theta), np.cos(phi)), np.outer(np.cos(theta), np.ones(2 * height)),
                         np.outer(np.sin(theta), np.sin(phi))], axis=-1)  # fmt: skip
    sky = _linear_sky(expected)
    middle = math3d.normalize(0.5 * (expected[20:40, :-1] + expected[20:40, 1:]))
    between = 0.5 * (sky[20:40, :-1] + sky[20:40, 1:])
    across = math3d.normalize(expected[10, 0] + expected[10, -1])
    omega = environment.solid_angles(height)
    errors = [
        worst(d - expected), omega.sum() * 2 * height / (4.0 * np.pi) - 1.0,
        worst(environment.lookup(sky, expected) - sky), worst(environment.lookup(sky, middle) - between),
        worst(environment.lookup(sky, across) - 0.5 * (sky[10, 0] + sky[10, -1])),
        worst(environment.lookup(sky, np.array([0.0, 1.0, 0.0])) - sky[0].mean(axis=0)) - 0.02,
        worst(environment.lookup(sky, np.array([1e-9, -1.0, 0.0])) - 0.5 * (sky[-1, 63] + sky[-1, 64])),
    ]  # fmt: skip
    errors[5] = max(errors[5], 0.0)
    # Means over 2 x 2 and 3 x 3 pixels, weighted by solid angle.
    for smaller in (32, 24):
        parts = (np.arange(height * 6) + 0.5) * np.pi / (height * 6)
        block = np.repeat(np.repeat(sky, 6, axis=0), 3, axis=1) * np.sin(parts)[:, None, None]
        rows, columns = 6 * height // smaller, 6 * height // (2 * smaller)
        means = block.reshape(smaller, rows, 2 * smaller, columns, 3).sum(axis=(1, 3))
        means /= np.sin(parts).reshape(smaller, rows).sum(axis=1)[:, None, None] * columns
        errors.append(worst(environment.resized(sky, smaller) - means))
    diffuse = environment.zonal_filter(sky, environment.cosine_lobe, 32)
    errors.append(worst(diffuse - (1.0 + 2.0 / 3.0 * (_linear_sky(environment.directions(32)) - 1.0))))
    for roughness in (0.5, 0.9):
        mu = (np.arange(4000) + 0.5) / 4000
        a2 = roughness**4
        lobe = mu / ((0.5 * (1.0 + mu)) * (a2 - 1.0) + 1.0) ** 2
        share = float((lobe * mu).sum() / lobe.sum())
        blurred = environment.zonal_filter(sky, environment.ggx_lobe(roughness), 32)
        errors.append(worst(blurred - (1.0 + share * (_linear_sky(environment.directions(32)) - 1.0))))
    choice = environment.direction_choice(sky).astype(np.float64)
    power = sky @ np.array([0.2126, 0.7152, 0.0722])
    pdf = power / (power * omega[:, None]).sum()
    rows = np.cumsum((power * omega[:, None]).sum(axis=1))
    columns = np.cumsum(power, axis=1) / power.sum(axis=1)[:, None]
    errors += [
        worst(choice[:, :-1, 1] / pdf - 1.0) - 0.01, worst(choice[:, -1, 0] - rows / rows[-1]),
        worst(choice[:, :-1, 0] - columns), (choice[:, :-1, 1] * omega[:, None]).sum() - 1.0,
    ]  # fmt: skip
    errors[-4] = max(errors[-4], 0.0)
    sun = np.zeros((16, 32, 3))
    sun[4, 7] = 1.0
    lit = environment.direction_choice(sun)[:, :-1, 1] > 0
    errors += [float(lit.sum() != 9), float(not lit[3:6, 6:9].all())]
    dark = environment.direction_choice(np.zeros((16, 32, 3)))[:, :-1, 1] * (4.0 * np.pi)
    return field("closed forms", [*errors, worst(dark - 1.0)])


@case(
    "samples-of-a-pixel",
    description="Halton's sequence, grids of 1 to 12 samples, sampled pairs of three schemes, cuts among two to four "
    "pairs, and texels of wrapped coordinates: differences from their definitions",
    elsewhere="a sequence that starts in the corner of the pixel, grids with another mean, the last pair left out",
    here="radical inverses digit by digit; cell centers; strata of equal length",
    tolerance=1e-15,
    source="exact, or the last digit",
)
def samples_of_a_pixel(bench: Bench) -> Outcome:
    inverses = [radical_inverse(n, 2) for n in (1, 2, 3, 4, 6)] + [radical_inverse(n, 3) for n in (1, 2, 3, 5)]
    fractions = [1 / 2, 1 / 4, 3 / 4, 1 / 8, 3 / 8, 1 / 3, 2 / 3, 1 / 9, 7 / 9]
    errors = [worst(np.subtract(inverses, fractions)), worst(halton_jitter(0) - [0.0, 1 / 3 - 0.5])]
    errors += [worst(halton_jitter(17) - [-0.25, 2 / 3 - 0.5]), worst(halton_jitter(5, 4) - [-0.25, 2 / 3 - 0.5])]
    for samples, (columns, rows) in {1: (1, 1), 2: (2, 1), 4: (2, 2), 6: (3, 2), 12: (4, 3)}.items():
        grid = {((i + 0.5) / columns - 0.5, (j + 0.5) / rows - 0.5) for i in range(columns) for j in range(rows)}
        there = {tuple(offset) for offset in grid_offsets(samples).tolist()}
        errors += [float(len(there) != samples), float(there != grid)]
    every = [sample_pairs(10, "every", n).positions for n in (1, 3, 4, 40)]
    errors += [float(every != [tuple(range(10)), (1, 4, 7), (1, 5, 9), (4,)])]
    whole = [sample_pairs(10, "all"), sample_pairs(1, "every", 3), sample_pairs(0, "strata", 2)]
    errors += [float([s.strata for s in whole] != [((10, tuple(range(10))),), ((1, (0,)),), ((0, ()),)])]
    strata = sample_pairs(11, "strata", 3).strata
    errors += [float([size for size, _ in strata] != [4, 4, 3]), float(any(len(s) != PER_STRATUM for _, s in strata))]
    first = 0
    for size, sampled in strata:
        errors.append(float(not all(first <= p < first + size for p in sampled)))
        first += size
    steps = np.array([0.1, 9.0, 0.1, 0.1])
    for pairs in (2, 3, 4):
        path = np.zeros((pairs + 1, 3))
        path[1:, 0] = np.cumsum(steps[:pairs])
        moved = activity.camera_activity(path, np.tile(np.eye(3), (pairs + 1, 1, 1)))
        errors.append(float(activity.detect_cuts(moved).tolist() != [pairs > 2 and k == 1 for k in range(pairs)]))
    uv = np.array([[-0.3, 0.3], [0.05, 1.9], [1.2, -0.7], [2.7, 0.99], [np.nan, 1.0]])
    for wrap, columns, rows in (
        (10497, [2, 0, 0, 2, 0], [1, 4, 1, 4, 0]), (33071, [0, 0, 3, 3, 0], [1, 4, 0, 4, 4]),
        (33648, [1, 0, 3, 2, 0], [1, 0, 3, 4, 4]),
    ):  # fmt: skip
        at = texels_at(Texture(0, Sampler(wrap_s=wrap, wrap_t=wrap)), uv, (4, 5))
        errors.append(float([x.tolist() for x in at] != [columns, rows]))
    return field("definitions", errors)


@case(
    "shares-at-other-exposures",
    description="curves with all distances at one edge: discards at half and twice the exposure, and residuals of a "
    "ratio",
    elsewhere="the threshold is multiplied where it is divided, or a share is of compared pixels",
    here="the curve at the threshold over the factor, of all pixels; residuals add up to 0",
    tolerance=1e-9,
    source=DOUBLE,
)
def shares_at_other_exposures(bench: Bench) -> Outcome:
    counts, errors = np.zeros(HISTOGRAM_BINS, dtype=np.int64), []
    bounds = edges()
    place = HISTOGRAM_BINS // 2
    counts[0], counts[place] = 90, 10
    errors.append(worst(discarded_above(counts) - np.where(np.arange(HISTOGRAM_BINS - 1) < place, 10, 0)))
    limit = float(bounds[place - 1])
    discards = sensitivity({"direct": {"counts": counts}}, {"direct": limit}, 200)
    errors += [discards["direct"]["at_twice_exposure_percent"] - 5.0, discards["direct"]["at_half_exposure_percent"]]
    beyond = sensitivity({"indirect": {"counts": counts}}, {"indirect": float(bounds[-1])}, 200)["indirect"]
    errors.append(float(beyond["at_half_exposure_percent"] is not None))
    errors.append(float(discards["indirect"] != dict.fromkeys(beyond)))
    stats = ReuseStats({})
    for words in ({0: 30, Reason.POSITION: 10, Reason.SKY | Reason.HISTORY_SKY: 60}, {0: 20, Reason.DIRECT: 60}):
        histogram = np.zeros(MASK_WORDS, dtype=np.uint32)
        for word, pixels in words.items():
            histogram[int(word)] = pixels
        stats.add(histogram)
    weights = np.array([0.75, 0.25])
    for rate, reusable in (("surface", [30, 80]), ("shading", [30, 20])):
        share, mean = (weights @ reusable) / (weights @ [40, 80]), weights @ [40, 80]
        expected = [100.0 * (y - share * x) / mean for y, x in zip(reusable, (40, 80), strict=True)]
        errors += [worst(stats.residuals(rate, weights) - expected), weights @ stats.residuals(rate, weights)]
    half = Counts(np.arange(MASK_WORDS, dtype=np.uint32), np.ones((3, 4), dtype=np.int64))
    twice = half + half
    errors += [worst(twice.mask_histogram - 2.0 * np.arange(MASK_WORDS)), worst(twice.histograms - 2.0)]
    codes = np.arange(256) / 255.0
    linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    errors += [worst(srgb_decode(codes) - linear), 1e-4 * worst(srgb_encode(linear) - codes)]
    return field("closed forms", errors)


@case(
    "point-on-a-moving-triangle",
    description="points above, beside and off the corners of triangles that move, turn and repeat: where they were "
    "before",
    elsewhere="the nearest vertex moves instead of the nearest point, or the nearest box counts as the nearest surface",
    here="the point of the nearest triangle that is drawn, by its barycentric weights",
    tolerance=1e-9,
    source="meters; float64 of float32 vertices",
)
def point_on_a_moving_triangle(bench: Bench) -> Outcome:
    b, origin = SceneBuilder(), np.array([100.0, -70.0, 40.0])
    root = b.node(translation=origin)
    plate = b.node(root, mesh=b.mesh(quad(1.0, 1.0)))
    b.animate(plate, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (4.0, 0.0, 0.0)])
    b.animate(plate, "rotation", [0.0, 1.0], [turn_x(0.0), turn_x(90.0)])
    copies = np.tile(np.eye(4), (2, 1, 1))
    copies[:, 0, 3] = -4.0, -8.0
    row = b.node(root, mesh=b.mesh(quad(1.0, 1.0)), instances=copies)
    b.animate(row, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (0.0, 3.0, 0.0)])
    hidden = b.node(root, mesh=b.mesh(quad(20.0, 20.0)), translation=(0.0, 0.0, 0.25))
    b.animate(hidden, "visible", [0.0, 1.0], [[1.0], [0.0]], "STEP")
    scene = b.build()
    poser = Poser(scene)
    before, state = poser.sample(0.0), poser.sample(1.0)
    errors = []
    # The plate is now in the plane y = 0 around (4, 0, 0): its local (x, y) is at (4 + x, 0, y).
    for local, off in (((0.3, -0.2), (0.0, 0.5, 0.0)), ((-0.9, 0.9), (0.0, -0.1, 0.0)), ((1.0, 0.5), (0.7, 0.0, 0.0)),
                       ((-0.5, -1.0), (0.0, 0.2, -0.4)), ((1.0, 1.0), (0.5, 0.3, 0.2))):  # fmt: skip
        on_it = origin + [4.0 + local[0], 0.0, local[1]]
        was = origin + [local[0], local[1], 0.0]
        errors.append(worst(previous_point(scene, state, before, on_it + off) - (was + off)))
    for x in (-4.2, -8.4):
        moved = previous_point(scene, state, before, origin + [x, 3.1, 0.2]) - origin - [x, 0.1, 0.2]
        errors.append(worst(moved))
    return field("along the motion of the triangle", errors)


@case(
    "repaired-vectors",
    description="normals too long, zero and NaN on a roof of two triangles, tangents too long and without a sign: the "
    "repaired ones, and corners and segments of every primitive mode",
    elsewhere="a mean of normals that is not weighted by area, or the sign of a tangent that is scaled",
    here="normalized where there is a direction, else the mean of the faces by area, else +Z",
    tolerance=1e-6,
    source="float32: 16 ulps of 1",
)
def repaired_vectors(bench: Bench) -> Outcome:
    positions = np.float32([[0, 0, 0], [0, 2, 0], [-1, 0, 0], [3, 0, 4], [9, 9, 9]])
    triangles = np.uint32([[0, 1, 2], [0, 3, 1]])
    normals = np.float32([[0, 0, 0], [0, 0, 5], [np.nan, 0, 1], [0, 1, 0], [0, 0, 0]])
    bad = np.array([True, True, True, False, True])
    face = np.array([[0.0, 0.0, 2.0], [-8.0, 0.0, 6.0]])  # twice the areas
    expected = [math3d.normalize(face.sum(axis=0)), [0, 0, 1], [0, 0, 1], [0, 1, 0], [0, 0, 1]]
    tangents = np.float32([[3, 0, 4, 0.5], [0, -2, 0, -7]])
    errors = [
        worst(meshes.repaired_normals(normals, bad, positions, triangles) - expected),
        worst(meshes.repaired_tangents(tangents) - [[0.6, 0, 0.8, 1], [0, -1, 0, -1]]),
        *(float(meshes.repaired_tangents(np.float32(row)) is not None)
          for row in ([[1, 0, 0, 0]], [[0, 0, 0, 1]], [[np.nan, 0, 1, 1]])),
        *np.subtract([meshes.line_count(mode, n) for mode in (1, 2, 3) for n in (0, 1, 2, 5)],
                     [0, 0, 1, 2, 0, 0, 2, 5, 0, 0, 1, 4]),
        *(float(meshes.triangle_list(mode, np.arange(n)).tolist() != triangles) for mode, n, triangles in (
            (4, 5, [[0, 1, 2]]), (5, 2, []), (5, 5, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]), (6, 4, [[1, 2, 0], [2, 3, 0]]),
        )),
    ]  # fmt: skip
    return field("by their definition", errors)
