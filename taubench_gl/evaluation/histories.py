"""Pixels with two histories under path-traced light: the decisions of the better one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from taubench_gl.evaluation.decided_pixels import Decisions, PreviewPair
from taubench_gl.metrics.histories import uses_other_eye
from taubench_gl.metrics.sampled_light import PixelMasks

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
    every = [of_all(pair, d, at, rows) for pair, d, at in zip(pairs, found, traced, strict=True)]
    (frame, sure_frame), (eye, sure_eye) = every
    taken = uses_other_eye(frame.end.words, eye.end.words)
    audited = np.minimum(np.where(sure_frame, 1.0, frame.audited), np.where(sure_eye, 1.0, eye.audited))
    audited[sure_frame & sure_eye] = 0.0
    return Decisions(
        _better_masks(frame.first, eye.first),
        _better_masks(frame.end, eye.end),
        np.where(taken, eye.luminance, frame.luminance),
        frame.samples + eye.samples,
        frame.decided_samples + eye.decided_samples,
        np.where(taken, eye.undecided, frame.undecided) & sure_frame & sure_eye,
        audited,
    )


def other_decisions(chosen: Decisions, found: Decisions, differs: Array) -> Decisions:
    """Decisions of n pixels under the other reprojection: ``found`` where it ``differs`` (n,) bool, else ``chosen``."""
    same = np.flatnonzero(~differs)
    for masks, of in ((found.first, chosen.first), (found.end, chosen.end)):
        masks.put(same, of.take(same))
    return replace(found, audited=np.where(differs, found.audited, chosen.audited))


def _better_masks(frame: PixelMasks, eye: PixelMasks) -> PixelMasks:
    def chosen(taken: Array, of_frame: Mapping[str, Array], of_eye: Mapping[str, Array]) -> dict[str, Array]:
        return {name: np.where(taken, of_eye[name], of) for name, of in of_frame.items()}

    taken, half_taken = uses_other_eye(frame.words, eye.words), uses_other_eye(frame.half_words, eye.half_words)
    return PixelMasks(
        np.where(taken, eye.words, frame.words),
        chosen(taken, frame.distances, eye.distances),
        np.where(half_taken, eye.half_words, frame.half_words),
        chosen(half_taken, frame.half_distances, eye.half_distances),
    )


def of_all(pair: PreviewPair, found: Decisions, at: Array, rows: tuple[Array, Array]) -> tuple[Decisions, Array]:
    """``found`` with all n pixels at ``rows``, and which of them no audit can change, (n,) bool.

    ``at``: places among the n pixels that ``found`` has; the words of all others are those of the preview ``pair``.
    """
    words = pair.words[rows]
    count, halves = len(words), found.first.half_words.shape[1]

    def filled(values: Array, dtype: type = np.int64) -> Array:
        out = np.zeros(count, dtype)
        out[at] = values
        return out

    known = {name: of[rows].astype(np.float64) for name, of in pair.distances.items()}
    both = []
    for masks in (found.first, found.end):
        whole = PixelMasks.blank(words, tuple(masks.distances), halves)
        for name, distance in known.items():
            whole.distances[name][:], whole.half_distances[name][:] = distance, distance[:, None]
        whole.put(at, masks)
        both.append(whole)
    undecided, traced = filled(found.undecided, bool), filled(np.ones(len(at), bool), bool)
    of_pixels = Decisions(
        *both, filled(found.luminance, float), filled(found.samples), filled(found.decided_samples), undecided,
        filled(found.audited, float),
    )  # fmt: skip
    return of_pixels, ~traced | undecided
