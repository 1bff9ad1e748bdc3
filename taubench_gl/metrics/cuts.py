"""Which pairs are cuts: the camera was put elsewhere instead of moving there.

The rule.  A pair is a cut when it moves, or turns, both more than an absolute floor and more than a multiple of what
the camera does around it:

    d_i > max(MIN_STEP, STEP_RATIO * r_i)    or    angle_i > max(MIN_TURN, TURN_RATIO * r_i),

where r_i, for translation and angle each, is the largest of

- the median of the ``WINDOW`` pairs before it,
- the median of the ``WINDOW`` pairs after it: so the first step of a camera that starts to move is not a cut,
- the upper quartile of all other pairs: so that a chance lull in jittery motion does not make the next step a cut.

Medians and quartiles, because a cut next to this one must not hide it; a quarter of all pairs may be cuts.  Each pair
is left out of its own r_i.  With fewer than ``MIN_PAIRS`` pairs nothing can be called unusual, and no pair is a cut.

Why these constants.  The paper's fast game camera (Table 2: mean 1.892, variance 0.826, max 5.475 a frame) has an upper
quartile near 2.5, so its largest step is about twice that, and 6 times leaves room; the teleport of its VR camera (max
7.163 with mean 0.041) is more than a hundred times its surroundings.  The VR head turns by 8.222 degrees a frame with
variance 72.563 (Table 3), about as exponentially distributed values do, whose tail reaches 4 times the quartile in 360
pairs, and heavier tails 8 times: hence 12.  So a turn alone is no cut for a camera that turns by more than 15 degrees
in a quarter of its pairs: such a jump cannot be told from its motion.  The floors keep small twitches of a still camera
from being cuts: 0.25 m is 6 m/s at the paper's 24 fps, 30 degrees are more than a person's head turns in a frame.
"""

from __future__ import annotations

import numpy as np

from taubench_gl.metrics.activity import Activity

Array = np.ndarray

WINDOW = 5
MIN_PAIRS = 3
MIN_STEP = 0.25  # metres, times the scene's unit_scale
MIN_TURN = 30.0  # degrees
STEP_RATIO = 6.0
TURN_RATIO = 12.0


def detect_cuts(activity: Activity, unit_scale: float = 1.0) -> Array:
    """The rule above on one camera's path, in scene units.  ``unit_scale``: of them per metre.  -> (P,) bool."""
    step, turn = activity.position, activity.angle
    if len(activity) < MIN_PAIRS:
        return np.zeros(len(activity), dtype=bool)
    return (step > np.maximum(MIN_STEP * unit_scale, STEP_RATIO * surroundings(step))) | (
        turn > np.maximum(MIN_TURN, TURN_RATIO * surroundings(turn))
    )


def surroundings(values: Array) -> Array:
    """r_i of the rule: what is usual around each value, itself left out.  (P,), P >= 2 -> (P,) float64."""
    values = np.asarray(values, dtype=np.float64)
    count = len(values)
    padded = np.concatenate([np.full(WINDOW, np.nan), values, np.full(WINDOW, np.nan)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)
    before, after = windows[:count], windows[WINDOW + 1 :]
    medians = np.zeros((2, count))
    medians[0, 1:] = np.nanmedian(before[1:], axis=1)
    medians[1, :-1] = np.nanmedian(after[:-1], axis=1)
    return np.maximum(medians.max(axis=0), _quartile_of_others(values))


def _quartile_of_others(values: Array) -> Array:
    """Upper quartile (linear) of all values but each one.  (P,) -> (P,); sorts once instead of P times."""
    order = np.argsort(values, kind="stable")
    ranked = values[order]
    rank = np.empty_like(order)
    rank[order] = np.arange(len(values))
    place = 0.75 * (len(values) - 2)
    low = int(np.floor(place))
    high = min(low + 1, len(values) - 2)
    # Without the value of rank k, place p holds ranked[p] below k and ranked[p + 1] from k on.
    at_low, at_high = ranked[low + (rank <= low)], ranked[high + (rank <= high)]
    return at_low + (place - low) * (at_high - at_low)
