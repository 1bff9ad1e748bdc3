"""Pixels with two histories under path-traced light: the decisions of the better one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from taubench_gl.evaluation.decided_pixels import Decisions, PreviewPair
from taubench_gl.metrics.histories import uses_other_eye

Array = np.ndarray


def chosen_words(pairs: Sequence[PreviewPair]) -> tuple[Array, Mapping[str, Array], Array]:
    """Words, light distances and traced pixels, (h, w) each, of one preview or of the better one of two.

    A pixel is traced if the light of either history can change its word.
    """
    first, last = pairs[0], pairs[-1]
    eye = uses_other_eye(first.words, last.words)
    words = np.where(eye, last.words, first.words)
    distances = {name: np.where(eye, last.distances[name], of) for name, of in first.distances.items()}
    return words, distances, first.traced | last.traced


def merge_histories(
    pairs: Sequence[PreviewPair], found: Sequence[Decisions], traced: Sequence[Array], rows: tuple[Array, Array]
) -> Decisions:
    """The better of two histories of n pixels at ``rows``: what decisions say of those with each history.

    ``traced``: of each history, the places among the n pixels that its ``found`` has; the words of all others do not
    depend on light.  Both histories of a pixel have the same random number for its audit, so that the less probable one
    is the probability of both.
    """
    every = [_of_all(pair, d, at, rows) for pair, d, at in zip(pairs, found, traced, strict=True)]
    (frame, sure_frame), (eye, sure_eye) = every
    taken, first_taken = uses_other_eye(frame.words, eye.words), uses_other_eye(frame.first, eye.first)
    audited = np.minimum(np.where(sure_frame, 1.0, frame.audited), np.where(sure_eye, 1.0, eye.audited))
    audited[sure_frame & sure_eye] = 0.0
    return Decisions(
        np.where(taken, eye.words, frame.words),
        {name: np.where(taken, eye.distances[name], of) for name, of in frame.distances.items()},
        np.where(taken, eye.luminance, frame.luminance),
        frame.samples + eye.samples,
        frame.decided_samples + eye.decided_samples,
        np.where(taken, eye.undecided, frame.undecided) & sure_frame & sure_eye,
        np.where(first_taken, eye.first, frame.first),
        audited,
    )


def _of_all(pair: PreviewPair, found: Decisions, at: Array, rows: tuple[Array, Array]) -> tuple[Decisions, Array]:
    """``found`` with all n pixels, and which of them no audit can change, (n,) bool."""
    words = pair.words[rows]
    count = len(words)

    def filled(values: Array, rest: Array) -> Array:
        out = rest.copy()
        out[at] = values
        return out

    none = np.zeros(count)
    distances = {
        name: filled(found.distances[name] if len(at) else none[:0], of[rows].astype(np.float64))
        for name, of in pair.distances.items()
    }
    undecided = filled(found.undecided, np.zeros(count, bool))
    traced = filled(np.ones(len(at), bool), np.zeros(count, bool))
    whole = Decisions(
        filled(found.words, words), distances, filled(found.luminance, none),
        filled(found.samples, none.astype(np.int64)), filled(found.decided_samples, none.astype(np.int64)), undecided,
        filled(found.first, words), filled(found.audited, none),
    )  # fmt: skip
    return whole, ~traced | undecided
