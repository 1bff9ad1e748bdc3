"""The vectorized timeline equals channel-by-channel sampling, bit for bit."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from made_scenes import make_channel

from taubench_gl.animation import curves
from taubench_gl.animation.curves import Timeline

WIDTH = {"translation": 3, "rotation": 4, "scale": 3, "weights": 2, "visible": 1}


def random_channels(seed: int, count: int):
    rng = np.random.default_rng(seed)
    shared = np.sort(rng.uniform(0, 4, 7))
    channels = []
    for i in range(count):
        path = str(rng.choice(list(WIDTH)))
        interpolation = "STEP" if path == "visible" else str(rng.choice(["STEP", "LINEAR", "CUBICSPLINE"]))
        times = shared if rng.random() < 0.5 else np.unique(rng.uniform(0, 4, int(rng.integers(1, 12))))
        shape = (len(times), 3, WIDTH[path]) if interpolation == "CUBICSPLINE" else (len(times), WIDTH[path])
        channels.append(make_channel(i, path, times, rng.normal(size=shape), interpolation))
    return channels


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.lists(st.floats(-1, 6), min_size=1, max_size=5))
def test_equals_the_scalar_reference(seed, count, times):
    channels = random_channels(seed, count)
    timeline = Timeline(channels)
    on_keys = [float(channels[0].times[0]), float(channels[-1].times[-1])]
    for t in times + on_keys:
        seen = 0
        for track, values in timeline.sample(t):
            for index, row in zip(track.index, values):
                assert np.array_equal(row, curves.sample_channel(channels[index], t))
                seen += 1
        assert seen == count


def test_last_channel_of_a_property_is_used():
    first = make_channel(0, "translation", [0], [[1, 1, 1]], "STEP")
    last = make_channel(0, "translation", [0], [[2, 2, 2]], "LINEAR")
    ((_, values),) = Timeline([first, last]).sample(0.0)
    assert values.tolist() == [[2, 2, 2]]


def test_no_channels():
    assert Timeline([]).sample(1.0) == []


def test_visibility_is_not_interpolated():
    channel = make_channel(0, "visible", [0, 1], [[1], [0]], "LINEAR")
    ((_, values),) = Timeline([channel]).sample(0.75)
    assert values.tolist() == [[1]]
    assert curves.sample_channel(channel, 0.75).tolist() == [1]
