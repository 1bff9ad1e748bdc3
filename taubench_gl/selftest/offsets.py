"""Cases: the same scene far from the origin and at other scales gives the same masks."""

from __future__ import annotations

import numpy as np

from taubench_gl.selftest.bench import Bench, PairImages
from taubench_gl.selftest.case import Outcome, case, count
from taubench_gl.selftest.scenes import busy_room

Array = np.ndarray
MODES = ("camera", "motion")
TIMES = (0.5, 0.625)


def _both(bench: Bench, offset=(0.0, 0.0, 0.0), scale: float = 1.0):
    scene = busy_room(offset, scale)
    return [bench.pair(scene, TIMES, reprojection=mode, unit_scale=scale) for mode in MODES]


def _different(a: list[PairImages], b: list[PairImages]) -> int:
    return sum(int((x.mask != y.mask).sum()) for x, y in zip(a, b, strict=True))


@case(
    "offset-{0}",
    source="exact: all keys are dyadic, so float64 holds every difference without rounding",
    each=(("1e3", 1e3), ("1e6", 1e6), ("1e9", 1e9)),
)
def offset(bench: Bench, name: str, meters: float) -> Outcome:
    """The busy room {1:g} m from the origin: pixels whose mask differs from that at the origin.

    Float32 world positions have steps of 6e-5 m at 1e3 m, 6 cm at 1e6 m and 64 m at 1e9 m.
    """
    return count(0, _different(_both(bench), _both(bench, (meters, -meters, 0.5 * meters))))


@case("still-far-away", source="exact: the same arithmetic is done twice")
def still_far_away(bench: Bench) -> Outcome:
    """A still camera in the still room at 1e9 m: pixels with a reason bit or motion.

    A few pixels flicker, so a still sequence never has 0 % discards.
    """
    there = [bench.pair(busy_room((1e9, 1e9, 1e9)), (0.3, 0.3), reprojection=mode) for mode in MODES]
    return count(0, sum(int((i.mask > 0).sum()) + int((i.motion != 0).sum()) for i in there))


def _scaled(bench: Bench, scale: float) -> Outcome:
    return count(0, _different(_both(bench), _both(bench, scale=scale)))


@case("scale-2^{0}", source="exact: a power of two changes exponents only", each=((-20,), (20,)))
def scale_of_a_power_of_two(bench: Bench, exponent: int) -> Outcome:
    """The busy room at scale 2^{0} with the same unit_scale: pixels whose mask differs.

    Absolute tolerances in meters (1e-3, 1e-4) are too large at one scale and too small at another.
    """
    return _scaled(bench, 2.0**exponent)


@case(
    "scale-1e{0}",
    tolerance=24.0,
    source="0.2 % of 2 x 6144 pixels: rounded positions move edges by 1e-5 px and change pixels at a limit",
    each=((-6,), (6,)),
)
def scale_of_a_power_of_ten(bench: Bench, exponent: int) -> Outcome:
    """The busy room at scale 1e{0} with the same unit_scale: pixels whose mask differs.

    Absolute tolerances in meters (1e-3, 1e-4) are too large at one scale and too small at another.
    """
    return _scaled(bench, 10.0**exponent)
