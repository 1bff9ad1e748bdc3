"""Cases: interpolation of keys, and degenerate or looping times."""

from __future__ import annotations

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import Poser, curves
from taubench_gl.conventions import DEFAULT_FPS
from taubench_gl.scene.model import Channel, Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Naive, Outcome, case, count, difference, field, scalar, worst
from taubench_gl.selftest.scenes import SceneBuilder, box, morphed, quad, turn, turn_y

Array = np.ndarray
ULPS_OF_180 = "float64: 32 ulps of 180 degrees"


def _channel(path: str, times, values, interpolation: str = "LINEAR") -> Channel:
    return Channel("node", 0, path, interpolation, np.array(times, dtype=float), np.array(values, dtype=float))


def _degrees(a: Array, b: Array) -> float:
    return float(np.degrees(math3d.quat_angle(a, b)))


def plain_slerp(a: Array, b: Array, u: float) -> Array:
    """Slerp with acos and a division by sin(angle), without a choice of hemisphere.  (4,), (4,) unit xyzw -> (4,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = np.arccos(np.dot(a, b))
        return (np.sin((1 - u) * angle) * a + np.sin(u * angle) * b) / np.sin(angle)


@case(
    "opposite-hemispheres",
    description="rotation keys 0 and 60 degrees, the second stored as -q: angle from the first key at half time",
    elsewhere="slerp without a test of the sign takes the long way, through 150 degrees",
    here="the second key is taken on the hemisphere of the first",
    tolerance=1e-12,
    source=ULPS_OF_180,
)
def opposite_hemispheres(bench: Bench) -> Outcome:
    a, b = turn_y(0.0), -turn_y(60.0)
    middle = curves.sample_channel(_channel("rotation", [0, 1], [a, b]), 0.5)
    long_way = _degrees(a, plain_slerp(a, b, 0.5))
    return scalar(30.0, _degrees(a, middle), Naive("slerp without the flip", long_way, abs(long_way - 30.0)))


def _same_key(name: str, sign: float, words: str) -> None:
    @case(
        name,
        description=f"two rotation keys that are {words}: difference of every value between them from the first key",
        elsewhere="sin(0) / sin(0) is NaN in all child matrices, or rounding noise moves a still camera",
        here="equal keys return the first key; close keys use normalized lerp",
        source="exact: the stored bits",
    )
    def same_key(bench: Bench) -> Outcome:
        q = turn((1.0, 2.0, 3.0), 77.0)
        channel = _channel("rotation", [0, 1], [q, sign * q])
        keys = curves.prepare_keys(channel)
        off = [curves.sample_channel(channel, t) - keys[0] for t in np.linspace(0, 0.999, 37)]
        naive = plain_slerp(keys[0], keys[1], 0.3)
        return field("the key", off, Naive("plain slerp", str(np.round(naive, 3)), worst(naive - keys[0])))


_same_key("equal-keys", 1.0, "equal")
_same_key("opposite-keys", -1.0, "q and -q")


@case(
    "half-turn-keys",
    description="keys 180 degrees apart whose dot product is +1e-17 or -1e-17: angle between the two results at half "
    "time",
    elsewhere="the sign of a rounding error selects the direction, so an object turns left or right at random",
    here="if the dot product is within 1e-12 of 0, the keys are used as the file stores them",
    tolerance=1e-12,
    source=ULPS_OF_180,
)
def half_turn_keys(bench: Bench) -> Outcome:
    a = np.array([0.0, 0.0, 0.0, 1.0])
    middles = [curves.slerp(a, np.array([0.0, 1.0, 0.0, w]), np.array(0.5)) for w in (1e-17, -1e-17)]

    def flipping(w: float) -> Array:
        b = np.array([0.0, 1.0, 0.0, w])
        return plain_slerp(a, b if a @ b >= 0 else -b, 0.5)

    naive = _degrees(flipping(1e-17), flipping(-1e-17))
    off = max(_degrees(*middles), abs(_degrees(a, middles[0]) - 90.0))
    return Outcome(0.0, _degrees(*middles), off, Naive("flip where the dot product < 0", naive, naive))


@case(
    "close-keys",
    description="keys 1e-7 degrees apart, sampled at a quarter of the time: relative error of the angle",
    elsewhere="acos(1 - 1e-18) is 0, so the camera does not move",
    here="the angle is computed from both chords; below 1e-6 rad normalized lerp",
    tolerance=1e-6,
    source="relative; float64: unit quaternions of 1.1e-16 that differ by 1e-9",
)
def close_keys(bench: Bench) -> Outcome:
    a, b = turn_y(10.0), turn_y(10.0 + 1e-7)
    quarter = curves.sample_channel(_channel("rotation", [0, 1], [a, b]), 0.25)
    naive = _degrees(a, plain_slerp(a, b, 0.25))
    plain = Naive("plain slerp", naive, difference(0.25e-7, naive, relative=True))
    return scalar(0.25e-7, _degrees(a, quarter), plain, relative=True)


@case(
    "cubic-overshoot",
    description="CUBICSPLINE from 0 to 1 with tangents 10 and -10: the value at half time is 3, outside the keys",
    elsewhere="tangents are ignored or not scaled by the segment's length, or the result is clamped",
    here="the Hermite form of glTF: tangents times dt, no clamp",
    tolerance=1e-15,
    source="dyadic numbers; 4 ulps",
)
def cubic_overshoot(bench: Bench) -> Outcome:
    keys = [[[0.0] * 3, [0.0] * 3, [5.0] * 3], [[-5.0] * 3, [1.0] * 3, [0.0] * 3]]
    value = curves.sample_channel(_channel("translation", [0, 2], keys, "CUBICSPLINE"), 1.0)[0]
    return scalar(3.0, value, Naive("tangents not scaled by dt", 1.75, 1.25))


@case(
    "cubic-still",
    description="CUBICSPLINE between equal keys with zero tangents: deviation from the key",
    elsewhere="h00 v0 + h01 v1 with h00 + h01 = 1 - 1e-16 moves a still camera",
    here="v0 + h01 (v1 - v0)",
    source="exact: the stored bits",
)
def cubic_still(bench: Bench) -> Outcome:
    value, zero = [1 / 3, 0.1, 123456.7], [0.0] * 3
    times = np.linspace(0.0, 1.0, 101)
    channel = _channel("translation", [0, 1], [[zero, value, zero]] * 2, "CUBICSPLINE")
    off = [curves.sample_channel(channel, t) - value for t in times]
    h00, h01 = 2 * times**3 - 3 * times**2 + 1, -2 * times**3 + 3 * times**2
    naive = worst(h00[:, None] * value + h01[:, None] * value - value)
    return field("the key", off, Naive("h00 v0 + h01 v1", f"off by {naive:.3g}", naive))


@case(
    "cubic-rotation",
    description="CUBICSPLINE rotation with tangents that pull the quaternion to length 0: is the result a rotation?",
    elsewhere="normalizing a zero quaternion gives NaN",
    here="normalized; the zero quaternion means no rotation",
    tolerance=1e-15,
    source="float64: 4 ulps of 1",
)
def cubic_rotation(bench: Bench) -> Outcome:
    q, zero = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(4)
    channel = _channel("rotation", [0, 1], [[zero, q, zero], [zero, -q, zero]], "CUBICSPLINE")
    middle = curves.sample_channel(channel, 0.5)
    with np.errstate(invalid="ignore"):
        naive = worst(zero / np.linalg.norm(zero))
    return scalar(1.0, np.linalg.norm(middle), Naive("q / |q|", naive, naive))


@case(
    "denormal-step",
    description="two keys 5e-324 s apart, sampled at, between and after them: the values are those of the keys",
    elsewhere="the times are equal in float32, and (t - t0) / (t1 - t0) is 0/0",
    here="times are float64; the fraction is computed only for segments of positive length",
    source="exact: the values of the keys",
)
def denormal_step(bench: Bench) -> Outcome:
    tiny = np.nextafter(0.0, 1.0)
    channel = _channel("translation", [0.0, tiny, 1.0], [[1.0, 0, 0], [2.0, 0, 0], [2.0, 0, 0]])
    measured = [curves.sample_channel(channel, t)[0] for t in (0.0, tiny, 2 * tiny, 0.5, 1.0)]
    with np.errstate(invalid="ignore"):
        naive = float(np.float32(tiny) / np.float32(tiny))
    off = worst(np.array(measured) - [1.0, 2.0, 2.0, 2.0, 2.0])
    return Outcome("1, 2, 2, 2, 2", ", ".join(f"{m:g}" for m in measured), off, Naive("float32 times", naive, naive))


@case(
    "step-on-its-key",
    description="STEP keys at 0, 1, 2 s, sampled at each key, one ulp and a tenth of a frame before it",
    elsewhere="a search on the wrong side returns the previous value at a key",
    here="a key holds from its time on; times within a hundredth of a frame are the key's",
    source="exact: the values of the keys",
)
def step_on_its_key(bench: Bench) -> Outcome:
    channel = _channel("translation", [0, 1, 2], [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]], "STEP")
    tenth = 0.1 / DEFAULT_FPS
    times = [0.0, 1.0 - tenth, np.nextafter(1.0, 0.0), 1.0, 2.0 - tenth, np.nextafter(2.0, 0.0), 2.0, 3.0]
    measured = [curves.sample_channel(channel, t)[0] for t in times]
    left = [float(max(np.searchsorted([0, 1, 2], t, side="left") - 1, 0)) for t in times]
    expected = [0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
    off, naive = worst(np.subtract(measured, expected)), worst(np.subtract(left, expected))
    searched = Naive("search from the left", str(left), naive)
    return Outcome(str(expected), str([float(m) for m in measured]), off, searched)


@case(
    "loop-end",
    description="the last pair of a looping walk: motion of the last frame (16 m in 1 s, 8 frames per second)",
    elsewhere="a wrapped previous time moves the object back by the whole distance",
    here="the previous time is never wrapped; after the last key the pose is constant",
    tolerance=1e-3,
    source="px; float32 rounding of coordinates up to 100 px is 1e-5 px",
)
def loop_end(bench: Bench) -> Outcome:
    b = SceneBuilder()
    b.node(translation=(0.0, 0.0, -10.0), mesh=b.mesh(quad(100.0, 100.0)))
    camera = b.camera(kind="orthographic", xmag=bench.size[0] / 2, ymag=bench.size[1] / 2, zfar=100.0)
    b.animate(camera, "translation", [0.0, 1.0], [(-8.0, 0.0, 0.0), (8.0, 0.0, 0.0)])
    images = bench.pair(b.build(), (0.875, 1.0))  # 1 m is 1 px
    expected = np.array([2.0, 0.0])
    return field("2 px to the right", images.motion - expected, Naive("time modulo 1 s", "-14 px", 16.0))


@case(
    "order-of-sampling",
    description="poses sampled in descending time and alone: matrices that differ",
    elsewhere="a cursor or cache of the last key gives other values if frames are skipped",
    here="the pose is a pure function of (scene, time)",
    source="exact: the bits of every matrix",
)
def order_of_sampling(bench: Bench) -> Outcome:
    b = SceneBuilder()
    node = b.node(mesh=b.mesh(box()))
    b.animate(node, "rotation", [0, 0.3, 0.9], [turn_y(0), turn((1, 1, 0), 100), -turn_y(200)])
    b.animate(node, "translation", [0.1, 0.2, 1.0], np.arange(27.0).reshape(3, 3, 3), "CUBICSPLINE")
    scene, times = b.build(), np.linspace(-0.2, 1.2, 57)
    poser = Poser(scene)
    alone = [Poser(scene).sample(t).world for t in times]
    backwards = [poser.sample(t).world for t in times[::-1]][::-1]
    return count(0, int(np.sum(np.array(alone) != np.array(backwards))))


@case(
    "frame-rate",
    description="a moving, turning and bending plate at 4 frames a second, and four times as slow at 1: counts of the "
    "pairs that differ",
    elsewhere="the frame before is posed at a time of another rate",
    here="frame n is at n / fps, the one before at (n - 1) / fps",
    source="exact: counts, at times that are powers of two",
)
def frame_rate(bench: Bench) -> Outcome:
    def plate(seconds: float) -> Scene:
        b = SceneBuilder()
        bent = morphed(quad(1.0, 1.0, cells=(1, 1)), [(0, 0, 1), (0, 0, 0), (0, 0, 0), (0, 0, 1)])
        node = b.node(mesh=b.mesh(bent, weights=[0.0]))
        b.animate(node, "translation", [0.0, seconds], [(-1.0, 0.0, -4.0), (1.0, 0.5, -5.0)])
        b.animate(node, "rotation", [0.0, seconds], [turn_y(-30.0), turn_y(40.0)])
        b.animate(node, "weights", [0.0, seconds], [[0.0], [1.0]])
        b.camera()
        return b.build()

    own = {"columns": ("frustum", "position", "normal"), "reprojection": "motion", "width": 48, "height": 32}
    runs = [bench.evaluate(plate(seconds), fps=rate, **own).frames for seconds, rate in ((1.0, 4.0), (4.0, 1.0))]
    wrong = sum(row[name] != other[name] for row, other in zip(*runs, strict=True) for name in row if name != "time_s")
    return count(0, wrong + (len(runs[0]) != 4) + (not runs[0][1]["position"]))
