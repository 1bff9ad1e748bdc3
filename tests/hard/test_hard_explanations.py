"""Explanations of pixels agree with the masks, distances and channels that they explain."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.features import FEATURE_BIT
from taubench_gl.selftest.scenes import busy_room

WIDTH, HEIGHT = 64, 36


def check(pair: Any, x: int, y: int, channels: dict[str, np.ndarray]) -> None:
    found, word, motion = pair.explain(x, y), int(pair.mask[y, x]), pair.motion[y, x]
    compared = not word & int(NOT_COMPARABLE)
    assert (found.word, found.pixel) == (word, (x, y)) and found.motion_px == pytest.approx(motion, abs=1e-3)
    if found.at is not None:
        assert found.at == pytest.approx((x + motion[0], y + motion[1]), abs=1e-3)
    for name, values in found.features.items():
        assert values.discarded == bool(word & FEATURE_BIT[name]), name
        if name in channels:
            assert values.current == pytest.approx(channels[name][y, x, :3], abs=1e-3)
        if not compared or word & (Reason.SKY | Reason.HISTORY_SKY):
            assert values.distance is None or compared
        elif np.isfinite(values.distance):
            assert values.distance == pytest.approx(float(pair.distances.features[name][y, x]), abs=1e-3), name


@pytest.mark.parametrize(
    ("reprojection", "sampling"), [("camera", "nearest"), ("camera", "bilinear"), ("motion", "bilinear")]
)
def test_explanations_are_those_of_the_masks(reprojection: str, sampling: str) -> None:
    words = set()

    def look(pair: Any) -> None:
        channels = {name: pair.read(name) for name in ("position", "normal", "direct")}
        for y in range(1, HEIGHT, 4):
            for x in range(1, WIDTH, 3):
                check(pair, x, y, channels)
                words.add(int(pair.mask[y, x]))

    settings = fixed_settings(
        width=WIDTH, height=HEIGHT, fps=2.0, reprojection=reprojection, sampling=sampling,
        light="raster", indirect="none", shadow_lights=0, columns=("frustum", "position", "normal", "direct", "color"),
    )  # fmt: skip
    evaluate_scene(busy_room(lamps=2), settings, Observers(on_pair=look, distances=True))
    assert len(words) > 4
