"""Cases: interpolation of keys, and degenerate or looping times."""

from __future__ import annotations

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import curves
from taubench_gl.scene.builder import SceneBuilder, morphed, quad, turn, turn_y
from taubench_gl.scene.model import Channel, Scene
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.case import Outcome, case, count, field, scalar, worst

Array = np.ndarray
ULPS_OF_180 = "float64: 32 ulps of 180 degrees"


def _channel(path: str, times, values, interpolation: str = "LINEAR") -> Channel:
    return Channel("node", 0, path, interpolation, np.array(times, dtype=float), np.array(values, dtype=float))


def _degrees(a: Array, b: Array) -> float:
    return float(np.degrees(math3d.quat_angle(a, b)))


@case("opposite-hemispheres", tolerance=1e-12, source=ULPS_OF_180)
def opposite_hemispheres(bench: Bench) -> Outcome:
    """Rotation keys 0 and 60 degrees, the second stored as -q: angle from the first key at half time.

    Slerp without a test of the sign takes the long way, through 150 degrees.
    """
    a, b = turn_y(0.0), -turn_y(60.0)
    middle = curves.sample_channel(_channel("rotation", [0, 1], [a, b]), 0.5)
    return scalar(30.0, _degrees(a, middle))


@case("{0}-keys", source="exact: the stored bits", each=(("equal", 1.0, "equal"), ("opposite", -1.0, "q and -q")))
def same_key(bench: Bench, name: str, sign: float, words: str) -> Outcome:
    """Two rotation keys that are {2}: difference of every value between them from the first key.

    The quotient sin(0) / sin(0) is NaN in all child matrices, or rounding noise moves a still camera.
    """
    q = turn((1.0, 2.0, 3.0), 77.0)
    channel = _channel("rotation", [0, 1], [q, sign * q])
    keys = curves.prepare_keys(channel)
    off = [curves.sample_channel(channel, t) - keys[0] for t in np.linspace(0, 0.999, 37)]
    return field("the key", off)


@case("half-turn-keys", tolerance=1e-12, source=ULPS_OF_180)
def half_turn_keys(bench: Bench) -> Outcome:
    """Keys 180 degrees apart whose dot product is +1e-17 or -1e-17: angle between the two results at half time.

    The sign of a rounding error selects the direction, so an object turns left or right at random.
    """
    a = np.array([0.0, 0.0, 0.0, 1.0])
    middles = [curves.slerp(a, np.array([0.0, 1.0, 0.0, w]), np.array(0.5)) for w in (1e-17, -1e-17)]

    off = max(_degrees(*middles), abs(_degrees(a, middles[0]) - 90.0))
    return Outcome(0.0, _degrees(*middles), off)


@case("cubic-still", source="exact: the stored bits")
def cubic_still(bench: Bench) -> Outcome:
    """CUBICSPLINE between equal keys with zero tangents: deviation from the key.

    The sum h00 v0 + h01 v1 with h00 + h01 = 1 - 1e-16 moves a still camera.
    """
    value, zero = [1 / 3, 0.1, 123456.7], [0.0] * 3
    times = np.linspace(0.0, 1.0, 101)
    channel = _channel("translation", [0, 1], [[zero, value, zero]] * 2, "CUBICSPLINE")
    off = [curves.sample_channel(channel, t) - value for t in times]
    return field("the key", off)


@case("denormal-step", source="exact: the values of the keys")
def denormal_step(bench: Bench) -> Outcome:
    """Two keys 5e-324 s apart, sampled at, between and after them: the values are those of the keys.

    The times are equal in float32, and (t - t0) / (t1 - t0) is 0/0.
    """
    tiny = np.nextafter(0.0, 1.0)
    channel = _channel("translation", [0.0, tiny, 1.0], [[1.0, 0, 0], [2.0, 0, 0], [2.0, 0, 0]])
    measured = [curves.sample_channel(channel, t)[0] for t in (0.0, tiny, 2 * tiny, 0.5, 1.0)]
    off = worst(np.array(measured) - [1.0, 2.0, 2.0, 2.0, 2.0])
    return Outcome("1, 2, 2, 2, 2", ", ".join(f"{m:g}" for m in measured), off)


@case("loop-end", tolerance=1e-3, source="px; float32 rounding of coordinates up to 100 px is 1e-5 px")
def loop_end(bench: Bench) -> Outcome:
    """The last pair of a looping walk: motion of the last frame (16 m in 1 s, 8 frames per second).

    A wrapped previous time moves the object back by the whole distance.
    """
    b = SceneBuilder()
    b.node(translation=(0.0, 0.0, -10.0), mesh=b.mesh(quad(100.0, 100.0)))
    camera = b.camera(kind="orthographic", xmag=bench.size[0] / 2, ymag=bench.size[1] / 2, zfar=100.0)
    b.animate(camera, "translation", [0.0, 1.0], [(-8.0, 0.0, 0.0), (8.0, 0.0, 0.0)])
    images = bench.pair(b.build(), (0.875, 1.0))  # 1 m is 1 px
    expected = np.array([2.0, 0.0])
    return field("2 px to the right", images.motion - expected)


@case("frame-rate", source="exact: counts, at times that are powers of two")
def frame_rate(bench: Bench) -> Outcome:
    """A moving, turning and bending plate at 4 frames a second, and four times as slow at 1: counts of the pairs that
    differ.

    The frame before is posed at a time of another rate.
    """

    def plate(seconds: float) -> Scene:
        b = SceneBuilder()
        bent = morphed(quad(1.0, 1.0, cells=(1, 1)), [(0, 0, 1), (0, 0, 0), (0, 0, 0), (0, 0, 1)])
        node = b.node(mesh=b.mesh(bent, weights=[0.0]))
        b.animate(node, "translation", [0.0, seconds], [(-1.0, 0.0, -4.0), (1.0, 0.5, -5.0)])
        b.animate(node, "rotation", [0.0, seconds], [turn_y(-30.0), turn_y(40.0)])
        b.animate(node, "weights", [0.0, seconds], [[0.0], [1.0]])
        b.camera()
        return b.build()

    options = {"columns": ("frustum", "position", "normal"), "reprojection": "motion", "width": 48, "height": 32}
    runs = [bench.evaluate(plate(seconds), fps=rate, **options).frames for seconds, rate in ((1.0, 4.0), (4.0, 1.0))]
    wrong = sum(row[name] != other[name] for row, other in zip(*runs, strict=True) for name in row if name != "time_s")
    return count(0, wrong + (len(runs[0]) != 4) + (not runs[0][1]["position"]))
