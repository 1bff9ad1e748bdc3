"""Why a more exact dial may give a larger error: pixel by pixel, what is judged otherwise than in the reference.

A column is an area: pixels that are wrongly discarded and pixels that are wrongly kept cancel in it, within one
picture.  So the error of an area may rise while fewer and fewer pixels are judged otherwise.  That is measured here,
for the series that are not monotone, and said only where it is so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack
from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.evaluation import Pair, evaluate_scene
from taubench_gl.evaluation_truth import evaluate_truth
from taubench_gl.reference.sequence import PREFIX
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings
from taubench_gl.study.analysis import Sanity
from taubench_gl.study.errors import nearest_pixels
from taubench_gl.study.rungs import Rung, truth_settings

Array = np.ndarray

MASK_PAIRS = 16
"""Pairs, from the middle of the sequence, whose masks are compared pixel by pixel."""

BORDER = 0.5
"""Share of the pixels judged otherwise from which on the border of the picture is named."""


@dataclass(frozen=True, slots=True)
class Apart:
    """How one setting's masks of one column differ from the reference's, percent of w * h, mean over pairs."""

    wrong: float  # discarded here, not there
    missed: float  # discarded there, not here
    border: float  # share of both, 0..1, within one pixel (of the coarser picture) of the picture's border
    left: float  # of both in the column: |wrong - missed| of each pair
    pairs: int

    @property
    def otherwise(self) -> float:
        """Pixels judged otherwise, either way."""
        return self.wrong + self.missed


def masks_of(scene: Scene, camera: CameraTrack, settings: Settings, frames: tuple[int, int]) -> dict[int, Array]:
    """Reason words at pixel centres of every pair within ``frames``: frame -> (h, w) uint32."""
    kept: dict[int, Array] = {}
    plain = replace(settings, frames=frames, pairs="all", samples_per_pixel=1)
    evaluate_scene(scene, plain, camera=camera, on_pair=lambda pair: _keep(pair, kept))
    return kept


def masks_of_rung(rung: Rung, settings: Settings, frames: tuple[int, int]) -> dict[int, Array]:
    """The same of a path-traced render."""
    kept: dict[int, Array] = {}
    settings = replace(truth_settings(settings), frames=frames)
    evaluate_truth(f"{PREFIX}{rung.folder}", settings, rung.options, on_pair=lambda pair: _keep(pair, kept))
    return kept


def _keep(pair: Pair, kept: dict[int, Array]) -> None:
    kept[pair.frame] = pair.mask()


def apart(found: Mapping[int, Array], reference: Mapping[int, Array], column: str) -> Apart:
    """Masks of another size are read at the pixel that each pixel centre of the reference falls into."""
    bits = int(FRUSTUM if column == "frustum" else Reason[column.upper()])
    wrong, missed, border, left = 0.0, 0.0, 0.0, 0.0
    frames = sorted(found.keys() & reference.keys())
    for frame in frames:
        there = (reference[frame] & bits) != 0
        rows, columns = nearest_pixels(found[frame].shape, there.shape)
        here = (found[frame] & bits)[rows[:, None], columns] != 0
        more, less = float(np.mean(here & ~there)), float(np.mean(there & ~here))
        wrong, missed, left = wrong + more, missed + less, left + abs(more - less)
        border += float(np.mean((here != there) & _border(found[frame].shape, there.shape)))
    share = 100.0 / max(len(frames), 1)
    both = wrong + missed
    return Apart(share * wrong, share * missed, border / both if both else 0.0, share * left, len(frames))


def _border(coarse: Sequence[int], shape: Sequence[int]) -> Array:
    """Pixels of a picture of ``shape`` within one pixel of a picture of shape ``coarse`` of the border."""
    edges = []
    for side, few in zip(shape, coarse):
        width = max(1, -(-side // few))
        at = np.arange(side)
        edges.append((at < width) | (at >= side - width))
    return edges[0][:, None] | edges[1][None, :]


def explained(sanity: Sanity, series: Mapping[Any, Apart]) -> str:
    """What the pixels say to every fault of ``sanity``.  ``series``: value of the dial -> its masks' difference."""
    words = []
    for coarse, fine in sanity.faults:
        a, b = series[coarse], series[fine]
        where = f"at pixel centres of {a.pairs} pair{'s' * (a.pairs != 1)}"
        if (a.wrong, a.missed) == (b.wrong, b.missed):  # samples per pixel, sums: what no pixel centre shows
            text = f"not explained: {where} both judge {_percent(a.otherwise)} otherwise than the reference"
        elif b.otherwise < a.otherwise and b.left > a.left:
            text = (
                f"explained: fewer pixels are judged otherwise than in the reference, {_percent(a.otherwise)} at "
                f"{coarse}, {_percent(b.otherwise)} at {fine} ({where}); but at {coarse} more of them cancel "
                f"({_sides(a)}) than at {fine} ({_sides(b)})"
            )
        else:
            text = (
                f"not explained: {where}, {_percent(a.otherwise)} are judged otherwise at {coarse}, "
                f"{_percent(b.otherwise)} at {fine} ({_sides(a)}; {_sides(b)})"
            )
        near = [f"{100 * x.border:.0f} % of them at {v}" for v, x in ((coarse, a), (fine, b)) if x.border >= BORDER]
        words.append(text + (f"; next to the border lie {' and '.join(near)}" if near else ""))
    return "; ".join(words)


def _percent(value: float) -> str:
    return f"{value:.4g} %"


def _sides(x: Apart) -> str:
    return f"{x.wrong:.3g} wrongly discarded, {x.missed:.3g} wrongly kept"
