"""Two histories of every pixel, the last frame and the other eye: its mask is that of the better one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.evaluation.decided_light import DecidedLight, counts_of_images
from taubench_gl.evaluation.lighting import LightPlan
from taubench_gl.evaluation.pairs import Pair
from taubench_gl.metrics.histories import takes_eye
from taubench_gl.metrics.masks import PixelDistances

if TYPE_CHECKING:
    from taubench_gl.evaluation.session import Plan, Session

Array = np.ndarray


class BothHistories:
    """Compares every pair with the other eye too, and replaces mask, counts and distances by those of the better."""

    columns, distances = (), True

    def __init__(self, session: Session, of_eye: Plan):
        """``of_eye``: the plan of the session with history ``eye``."""
        self._source = of_eye.open_source(session, session.timer, session.readback)
        self._evaluator = session.open_evaluator(
            self._source, of_eye.settings, timed=False, images=True, distances=True
        )
        decided = of_eye.light is LightPlan.DECIDED
        self._decided = DecidedLight(session.variant, self._source, of_eye.settings) if decided else None

    def fill_row(self, pair: Pair) -> None:
        """Compare the frame of ``pair`` with the other eye."""
        [evaluated] = self._evaluator.step(pair.frame)[1]
        other = Pair(evaluated, {}, self._evaluator)
        if self._decided is not None:
            self._decided.fill_row(other)
            pair.row |= {name: pair.row[name] + other.row[name] for name in other.row}
        eye = takes_eye(pair.mask, other.mask)
        distances = _chosen_distances(eye, pair.distances, other.distances)
        words = np.where(eye, other.mask, pair.mask)
        pair.replace(words, distances, counts_of_images(words, distances.features))
        pair.add_eye(other, eye)


def _chosen_distances(eye: Array, frame: PixelDistances, other: PixelDistances) -> PixelDistances:
    def both(a: Array, b: Array) -> Array:
        return np.where(eye, b, a)

    features = {name: both(values, other.features[name]) for name, values in frame.features.items()}
    return PixelDistances(features, both(frame.depth, other.depth), both(frame.luminance, other.luminance))
