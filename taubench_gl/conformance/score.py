"""Scores the frames of an engine: first whether the scene was loaded as written, then every vector, then causes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from taubench_gl.conformance.cases import Case
from taubench_gl.conformance.frames import EngineFrame, EngineFrames
from taubench_gl.conformance.hypotheses import HYPOTHESES, Hypothesis, Pair
from taubench_gl.conformance.loaded import agreement, difference
from taubench_gl.conformance.truth import CLASSES, Frame, Truth
from taubench_gl.conventions import Visibility
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.check_vectors import MOST, NOT_JUDGED, RIGHT, TOLERANCE_PX, WRONG

Array = np.ndarray
WRONG_SHARE = 0.005
"""Share of the pixels of a class from which on it is wrong: coverage at silhouettes is never quite the same."""

NO_PLACE, FIRST = "behind", "first"
"""Classes beside those of ``truth.CLASSES``: points that were behind the previous camera, whose vectors must not lead
into the image; and the first frame, which has no previous one, so that its vectors are zero or none."""

UNKNOWN = "none of the known causes"


@dataclass(slots=True)
class ClassScore:
    """The vectors of one class of pixels over all frames of a case.  Errors in pixels; NaN where there is no vector."""

    name: str
    pixels: int
    wrong: int
    median_px: float
    p95_px: float
    max_px: float
    missing: int  # wrong pixels that have no vector
    explained: dict[str, tuple[float, float]] = field(default_factory=dict)  # hypothesis -> share of wrong, error px
    cause: str = ""

    @property
    def failed(self) -> bool:
        """Whether more than WRONG_SHARE of the pixels are wrong."""
        return self.wrong > WRONG_SHARE * self.pixels


@dataclass(frozen=True, slots=True)
class WorstPixel:
    """The pixel with the longest error."""

    frame: int
    column: int
    row: int
    kind: str
    vector: tuple[float, float]
    right: tuple[float, float]  # NaN: none, the point was behind the camera


@dataclass(frozen=True, slots=True)
class CaseScore:
    """The verdict on one case.  ``reason``: why it is not judged; ``rejection``: counts by what was to be rejected."""

    name: str
    status: str
    reason: str = ""
    classes: tuple[ClassScore, ...] = ()
    worst: WorstPixel | None = None
    rejection: Counter | None = None

    @property
    def causes(self) -> dict[str, list[str]]:
        """Texts of the causes -> names of the classes that failed by them."""
        out: dict[str, list[str]] = {}
        for each in self.classes:
            if each.failed:
                out.setdefault(text_of(each.cause), []).append(each.name)
        return out


def text_of(cause: str) -> str:
    """A cause in words."""
    return next((h.text for h in HYPOTHESES if h.key == cause), cause)


def score_case(truth: Truth, engine: Sequence[EngineFrame]) -> CaseScore:
    """Score one case.  Causes are candidates until ``name_causes`` has seen all cases."""
    name = truth.case.name
    if any(frame.motion is None for frame in engine):
        return CaseScore(name, NOT_JUDGED, "there is no motion pass")
    if why := difference(truth, list(engine)):
        return CaseScore(name, NOT_JUDGED, f"scene not loaded as written: {why}")
    collected: dict[str, list[tuple]] = {}
    for frame, shown in zip(truth.frames(), engine, strict=True):
        if frame.number != truth.case.cut:
            _collect(truth, frame, shown, collected)
    classes, worst = [], None
    for kind, parts in collected.items():
        score, farthest = _class_score(truth, kind, parts)
        classes.append(score)
        if score.wrong and (worst is None or farthest[0] > worst[0]):
            worst = farthest
    status = WRONG if any(each.failed for each in classes) else RIGHT
    absent = [each for each in truth.case.about if each not in collected]
    if absent and status == RIGHT:
        return CaseScore(name, NOT_JUDGED, f"no pixel shows the class {', '.join(absent)}", tuple(classes))
    rejection = _rejection(truth, engine)
    return CaseScore(name, status, "", tuple(classes), worst[1] if worst else None, rejection)


def _collect(truth: Truth, frame: Frame, engine: EngineFrame, collected: dict[str, list[tuple]]) -> None:
    """Add the scored pixels of a frame to ``collected``: class -> (frame, pixels, vectors, errors, wrong, step)."""
    where = (frame.edge if truth.case.edges else ~frame.edge) & (frame.kind >= 0) & agreement(frame, engine)
    vectors, right = engine.motion, frame.motion
    step = np.broadcast_to(engine.step_px, vectors.shape)
    placed = np.isfinite(right).all(axis=-1)
    none = ~np.isfinite(vectors).all(axis=-1)
    error = np.linalg.norm(vectors - right, axis=-1)
    slack = np.linalg.norm(step, axis=-1)
    with np.errstate(invalid="ignore"):
        wrong = ~(error <= TOLERANCE_PX + slack)
        wrong |= frame.exact & engine.exact_zero & (slack == 0) & (error != 0) & (frame.number > 0)
    if frame.number == 0:
        _add(collected, FIRST, frame, where, vectors, error, wrong & ~none, step)
        return
    behind = frame.visibility == Visibility.BEHIND
    width, height = truth.size
    at = truth.pixels.reshape(height, width, 2) + np.nan_to_num(vectors, nan=1e9)
    with np.errstate(over="ignore"):
        inside = ((at > -0.5) & (at < np.array([width, height]) - 0.5)).all(axis=-1)
    _add(collected, NO_PLACE, frame, where & behind, vectors, np.where(inside, np.inf, 0.0), inside, step)
    for number, name in enumerate(CLASSES):
        _add(collected, name, frame, where & placed & (frame.kind == number), vectors, error, wrong, step)


def _add(collected, name, frame, where, vectors, error, wrong, step) -> None:
    if where.any():
        at = np.flatnonzero(where)
        parts = (vectors.reshape(-1, 2)[at], error.reshape(-1)[at], wrong.reshape(-1)[at], step.reshape(-1, 2)[at])
        collected.setdefault(name, []).append((frame, at, *parts))


def _class_score(truth: Truth, name: str, parts: list[tuple]) -> tuple[ClassScore, tuple[float, WorstPixel | None]]:
    error, wrong = (np.concatenate([part[i] for part in parts]) for i in (3, 4))
    known = error[np.isfinite(error)]
    median, p95 = np.percentile(known, (50, 95)) if len(known) else (np.nan, np.nan)
    most = float(known.max()) if len(known) else np.nan
    score = ClassScore(name, len(error), int(wrong.sum()), float(median), float(p95), most,
                       int((wrong & ~np.isfinite(error)).sum()) * (name != NO_PLACE))  # fmt: skip
    farthest = (-1.0, None)
    for frame, at, vectors, errors, bad, _ in parts:
        length = np.where(bad, np.nan_to_num(errors, nan=1e6, posinf=1e6), -1.0)
        if len(length) and length.max() > farthest[0]:
            i = int(length.argmax())
            row, column = divmod(int(at[i]), truth.size[0])
            right = frame.motion.reshape(-1, 2)[at[i]]
            pixel = WorstPixel(frame.number, column, row, name, tuple(vectors[i].tolist()), tuple(right.tolist()))
            farthest = (float(length[i]), pixel)
    if score.failed:
        score.explained = _explained(truth, parts)
    return score, farthest


def _explained(truth: Truth, parts: list[tuple]) -> dict[str, tuple[float, float]]:
    """Hypotheses that explain MOST of the wrong pixels -> share of them, and of the right pixels too."""
    found = {}
    for hypothesis in HYPOTHESES:
        share, consistent = _shares(truth, hypothesis, parts)
        if share >= MOST:
            found[hypothesis.key] = (share, consistent)
    return found


def _shares(truth: Truth, hypothesis: Hypothesis, parts: list[tuple]) -> tuple[float, float]:
    """Shares of the wrong pixels, and of all pixels, that ``hypothesis`` explains; gives up early on the former."""
    wrong = explained = everywhere = pixels = 0
    total = sum(int(part[4].sum()) for part in parts)
    for frame, at, vectors, _, bad, step in parts:
        size = truth.size[0] * truth.size[1]
        whole, steps = np.full((size, 2), np.nan), np.zeros((size, 2))
        whole[at], steps[at] = vectors, step
        matches = hypothesis.explains(Pair(truth, frame), whole, steps)[at]
        wrong, explained = wrong + int(bad.sum()), explained + int((matches & bad).sum())
        everywhere, pixels = everywhere + int(matches.sum()), pixels + len(at)
        if wrong - explained > (1 - MOST) * total:
            return 0.0, 0.0
    return explained / total, everywhere / pixels


def name_causes(scores: Sequence[CaseScore]) -> None:
    """Choose the cause of every failed class among those that explain it: the fewest causes for all cases together.

    Of several that explain as many classes the one that also predicts more of the other pixels, then the simplest.
    """
    order = {hypothesis.key: i for i, hypothesis in enumerate(HYPOTHESES)}
    failed = [each for score in scores for each in score.classes if each.failed]
    for each in failed:
        if HYPOTHESES[0].key in each.explained:  # rounding is no sign of the mistake that other classes show
            each.cause = HYPOTHESES[0].key
    left = [each for each in failed if not each.cause]
    while left:
        votes = Counter(key for each in left for key in each.explained)
        if not votes:
            break
        fit = {key: np.mean([each.explained[key][1] for each in left if key in each.explained]) for key in votes}
        best = max(votes, key=lambda key: (votes[key], round(float(fit[key]), 2), -order[key]))
        for each in left:
            each.cause = best if best in each.explained else each.cause
        left = [each for each in left if not each.cause]
    for each in left:
        if each.missing >= MOST * each.wrong:
            each.cause = "pixels have no vector"
        else:
            each.cause = (
                "the first frame has vectors, though there is none before it" if each.name == FIRST else UNKNOWN
            )


def _rejection(truth: Truth, engine: Sequence[EngineFrame]) -> Counter | None:
    """Pixels by (rejected, to be rejected), away from outlines and from the border of the previous image."""
    if any(frame.rejected is None for frame in engine):
        return None
    counts: Counter = Counter()
    for frame, shown in zip(truth.frames()[1:], engine[1:], strict=True):
        where = ~frame.edge & (frame.kind >= 0)
        for rejected, invalid in ((a, b) for a in (True, False) for b in (True, False)):
            counts[rejected, invalid] += int((where & (shown.rejected == rejected) & (~frame.valid == invalid)).sum())
    return counts


def precision_recall(counts: Counter) -> tuple[float | None, float | None]:
    """Share of the rejected pixels that had no history, and of those without history that were rejected."""
    hit, false, missed = (counts[key] for key in ((True, True), (True, False), (False, True)))
    return (hit / (hit + false) if hit + false else None, hit / (hit + missed) if hit + missed else None)


def score_cases(
    cases: Sequence[Case], frames: EngineFrames, begun: Callable[[str, tuple[int, int]], object] = lambda *_: None
) -> list[CaseScore]:
    """Score ``cases`` by the files of an engine.  ``begun`` gets each case that has files, and the size of its frames.

    A case whose files are damaged or not those of the case is not judged, as one without files.
    """
    scores = []
    for case in cases:
        if not frames.has(case.name):
            scores.append(CaseScore(case.name, NOT_JUDGED, "its frames are missing"))
            continue
        try:
            files = frames.open(case.name)
            begun(case.name, files.size)
            truth = Truth(case, files.size)
            scores.append(score_case(truth, files.convert(truth)))
        except PathTracedError as error:
            scores.append(CaseScore(case.name, NOT_JUDGED, str(error)))
    name_causes(scores)
    return scores
