"""side_by_side.png: the worst of the frames that have history."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.reuse.evaluate import EvaluatedFrame
from taubench_gl.reuse.evaluate_output import ReuseFolder, side_by_side

METHODS = ("none", "mine")


def evaluated(frame: int, error: float) -> EvaluatedFrame:
    """A frame with an image of its own and equal errors of all methods."""
    image, errors = np.full((4, 8, 3), 0.1 * (frame + 1)), np.full((4, 8), error)
    rows = {name: {"frame": frame, "method": name, "flip": error} for name in METHODS}
    return EvaluatedFrame(frame, image, image, dict.fromkeys(METHODS, image), dict.fromkeys(METHODS, errors), rows)


@pytest.mark.parametrize(
    ("errors", "worst"), [([0.9, 0.1, 0.3, 0.2], 2), ([0.9, 0.4, 0.3], 1), ([0.1, 0.0, 0.0], 1), ([0.9], 0)]
)
def test_worst_frame_excludes_the_first(tmp_path, errors, worst):
    frames = [evaluated(i, error) for i, error in enumerate(errors)]
    with ReuseFolder(tmp_path / "run", 24.0, "none") as folder:
        for frame in frames:
            folder.on_frame(frame)
        np.testing.assert_array_equal(folder._worst_image, side_by_side(frames[worst], crop=True))
