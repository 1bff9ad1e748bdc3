"""Frames as an engine would write them: made from the truth, and spoiled."""

from __future__ import annotations

from functools import cache

import numpy as np

from taubench_gl.conformance.cases import CASES
from taubench_gl.conformance.frames import EngineFrame
from taubench_gl.conformance.score import CaseScore, name_causes, score_case
from taubench_gl.conformance.truth import Truth

SIZE = (64, 36)


@cache
def truth_of(name: str, size: tuple[int, int] = SIZE) -> Truth:
    return Truth(CASES[name], size)


def right_frames(truth: Truth) -> list[EngineFrame]:
    """What an engine without a fault writes, in single precision."""
    return [
        EngineFrame(
            sky=~np.isfinite(frame.position).all(axis=-1),
            motion=frame.motion.astype(np.float32).astype(float),
            points=(frame.position - frame.view.position).astype(np.float32).astype(float),
            normal=frame.normal,
        )
        for frame in truth.frames()
    ]


def scored(spoil, *names: str) -> dict[str, CaseScore]:
    """Scores of cases whose frames ``spoil`` (truth, frames) has changed."""
    scores = []
    for name in names:
        truth = truth_of(name)
        scores.append(score_case(truth, spoil(truth, right_frames(truth))))
    name_causes(scores)
    return {score.name: score for score in scores}
