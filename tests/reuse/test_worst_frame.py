"""side_by_side.png: the worst frame of those in which methods can differ."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.reuse.evaluate import JudgedFrame
from taubench_gl.reuse.evaluate_output import ReuseFolder, side_by_side

METHODS = ("none", "mine")


def judged(frame: int, error: float) -> JudgedFrame:
    """A frame whose pictures say which it is, and whose methods are all off by ``error``."""
    picture, errors = np.full((4, 8, 3), 0.1 * (frame + 1)), np.full((4, 8), error)
    rows = {name: {"frame": frame, "method": name, "flip": error} for name in METHODS}
    return JudgedFrame(frame, picture, picture, dict.fromkeys(METHODS, picture), dict.fromkeys(METHODS, errors), rows)


@pytest.mark.parametrize(
    ("errors", "worst"), [([0.9, 0.1, 0.3, 0.2], 2), ([0.9, 0.4, 0.3], 1), ([0.1, 0.0, 0.0], 1), ([0.9], 0)]
)
def test_the_first_frame_has_no_history_and_is_not_the_worst(tmp_path, errors, worst):
    frames = [judged(i, error) for i, error in enumerate(errors)]
    with ReuseFolder(tmp_path / "run", 24.0, "none") as folder:
        for frame in frames:
            folder.on_frame(frame)
        np.testing.assert_array_equal(folder._worst_picture, side_by_side(frames[worst], crop=True))
