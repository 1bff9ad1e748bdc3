"""Two histories of every pixel, the last frame and the other eye: its mask is that of the better one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.evaluation.decided_light import DecidedLight, counts_of_images
from taubench_gl.evaluation.pairs import Pair
from taubench_gl.metrics.histories import takes_eye
from taubench_gl.metrics.masks import PixelDistances

if TYPE_CHECKING:
    from taubench_gl.evaluation.session import Input, Session

Array = np.ndarray


class BothHistories:
    """Compares every pair with the other eye too, and replaces mask, counts and distances by those of the better."""

    columns, distances = (), True

    def __init__(self, session: Session, of_eye: Input, decides: bool):
        """``of_eye``: the session's scene with history ``eye``; ``decides``: whether every pixel's light is decided."""
        self._source = of_eye.open_source(session, session.timer, session.wants)
        how = {"timed": False, "images": True, "distances": True}
        self._evaluator = session.open_evaluator(self._source, of_eye.settings, **how)
        self._decided = DecidedLight(session, self._source, of_eye.settings) if decides else None

    def blocks(self, session: Session) -> dict[str, Any]:
        """None: the mask histogram has it all."""
        return {}

    def complete(self, pair: Pair) -> None:
        """Compare the frame of ``pair`` with the other eye."""
        [evaluated] = self._evaluator.step(pair.frame)[1]
        other = Pair(evaluated, {}, self._evaluator)
        if self._decided is not None:
            self._decided.complete(other)
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
