"""Scenes so small that squares of distances vanish in float32: exact above the limit, refused in one line below it."""

from __future__ import annotations

import pytest

from taubench_gl import Settings, evaluate
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.selftest.scenes import busy_room
from taubench_gl.settings import LEAST_LENGTH

pytestmark = pytest.mark.usefixtures("fixed_light")

COUNTS = ("frustum", "position", "normal", "sky")
SMALL = {"size": "96x54", "frames": (0, 3), "fps": 8, "columns": "frustum,position,normal", "environment": "none"}


def rows(scale: float, **changes: object) -> list[dict]:
    return evaluate(busy_room(scale=scale), **SMALL | {"unit_scale": scale} | changes).frames


def test_masks_are_equal_down_to_the_limit_and_refused_below_it():
    """A power of two changes exponents only.  The default threshold is about 2^-3 m."""
    usual, least = rows(1.0), rows(2.0**-57)
    for a, b in zip(usual, least, strict=True):
        assert [a[name] for name in COUNTS] == [b[name] for name in COUNTS]
    assert sum(row["position"] for row in usual) > 0
    for scale in (2.0**-61, 2.0**-70, 1e-22, 1e-30):
        with pytest.raises(SettingsError) as caught:
            rows(scale)
        assert caught.value.setting == "thresholds"


@pytest.mark.parametrize("feature", ["position", "normal", "direct", "indirect"])
def test_thresholds_whose_squares_vanish_are_refused(feature):
    for value in (0.0, LEAST_LENGTH):
        assert Settings(thresholds={feature: value}).metrics.threshold(feature) == value
    for value in (0.999 * LEAST_LENGTH, 1e-30, 1e-300):
        with pytest.raises(SettingsError):
            Settings(thresholds={feature: value})


def test_a_threshold_of_0_needs_a_scene_whose_steps_do_not_vanish():
    zero = {"thresholds": {"position": 0.0}}
    usual, least = rows(1.0, **zero), rows(2.0**-40, **zero)
    for a, b in zip(usual, least, strict=True):
        assert [a[name] for name in COUNTS] == [b[name] for name in COUNTS]
    with pytest.raises(SceneError) as caught:
        rows(2.0**-70, **zero)
    assert "e-21" in caught.value.what or "e-20" in caught.value.what  # the span
