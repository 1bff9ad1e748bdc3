"""Scores the frames of an engine: first whether the scene was loaded as written, then every vector, then causes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from taubench_gl.conformance.cases import Case
from taubench_gl.conformance.frames import EngineFrame, EngineFrames
from taubench_gl.conformance.hypotheses import HYPOTHESES, Pair
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
STARTED = "the first frame has vectors, though there is none before it"


@dataclass(frozen=True, slots=True)
class WorstPixel:
    """The pixel with the longest error."""

    frame: int
    column: int
    row: int
    kind: str
    vector: tuple[float, float]
    right: tuple[float, float]  # NaN: none, the point was behind the camera
    error_px: float  # infinite: no vector, or one that must not be there


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
    worst: WorstPixel
    explained: dict[str, float] = field(default_factory=dict)  # hypothesis -> share of all pixels that it explains
    cause: str = ""

    @property
    def failed(self) -> bool:
        """Whether more than WRONG_SHARE of the pixels are wrong."""
        return self.wrong > WRONG_SHARE * self.pixels

    @property
    def text(self) -> str:
        """The cause of wrong vectors in words."""
        return next((h.text for h in HYPOTHESES if h.key == self.cause), self.cause)


@dataclass(frozen=True, slots=True)
class CaseScore:
    """The verdict on one case.  ``reason``: why it is not judged; ``rejection``: counts by what was to be rejected."""

    name: str
    status: str
    reason: str = ""
    classes: tuple[ClassScore, ...] = ()
    rejection: Counter | None = None

    @property
    def worst(self) -> WorstPixel | None:
        """The pixel with the longest error of all classes; None: no pixel is wrong."""
        return max((each.worst for each in self.classes if each.wrong), key=lambda w: w.error_px, default=None)

    @property
    def precision_recall(self) -> tuple[float | None, float | None]:
        """Share of the rejected pixels that had no history, and of those without history that were rejected."""
        counts = self.rejection or Counter()
        hit, false, missed = (counts[key] for key in ((True, True), (True, False), (False, True)))
        return (hit / (hit + false) if hit + false else None, hit / (hit + missed) if hit + missed else None)

    @property
    def causes(self) -> dict[str, list[str]]:
        """Texts of the causes -> names of the classes that failed by them."""
        out: dict[str, list[str]] = {}
        for each in self.classes:
            if each.failed:
                out.setdefault(each.text, []).append(each.name)
        return out

    @property
    def why(self) -> str:
        """Why the case is not right, "" where it is."""
        return self.reason or "; ".join(f"{', '.join(names)}: {cause}" for cause, names in self.causes.items())


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
    classes = tuple(_class_score(truth, kind, parts) for kind, parts in collected.items())
    status = WRONG if any(each.failed for each in classes) else RIGHT
    absent = [each for each in truth.case.about if each not in collected]
    if absent and status == RIGHT:
        return CaseScore(name, NOT_JUDGED, f"no pixel shows the class {', '.join(absent)}", classes)
    return CaseScore(name, status, "", classes, _rejection(truth, engine))


def _collect(truth: Truth, frame: Frame, engine: EngineFrame, collected: dict[str, list[tuple]]) -> None:
    """Add the scored pixels of a frame to ``collected``: class -> (frame, pixels, errors, wrong, vectors, step)."""
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

    def add(name: str, of_class: Array, error: Array, wrong: Array) -> None:
        at = np.flatnonzero(where & of_class)
        if len(at):
            parts = (error.reshape(-1)[at], wrong.reshape(-1)[at], vectors.reshape(-1, 2)[at], step.reshape(-1, 2)[at])
            collected.setdefault(name, []).append((frame, at, *parts))

    if frame.number == 0:
        add(FIRST, where, error, wrong & ~none)
        return
    width, height = truth.size
    at = truth.pixels.reshape(height, width, 2) + np.nan_to_num(vectors, nan=1e9)
    with np.errstate(over="ignore"):
        inside = ((at > -0.5) & (at < np.array([width, height]) - 0.5)).all(axis=-1)
    add(NO_PLACE, frame.visibility == Visibility.BEHIND, np.where(inside, np.inf, 0.0), inside)
    for number, name in enumerate(CLASSES):
        add(name, placed & (frame.kind == number), error, wrong)


def _class_score(truth: Truth, name: str, parts: list[tuple]) -> ClassScore:
    error, wrong = (np.concatenate([part[i] for part in parts]) for i in (2, 3))
    known = error[np.isfinite(error)]
    errors = (*np.percentile(known, (50, 95)).tolist(), float(known.max())) if len(known) else (np.nan,) * 3
    missing = int((wrong & ~np.isfinite(error)).sum()) * (name != NO_PLACE)
    worst = max((_worst(truth, name, *part[:5]) for part in parts), key=lambda w: w.error_px)
    score = ClassScore(name, len(error), int(wrong.sum()), *errors, missing, worst)
    if score.failed:
        score.explained = _explained(truth, parts)
    return score


def _worst(truth: Truth, name: str, frame: Frame, at: Array, error: Array, wrong: Array, vectors: Array) -> WorstPixel:
    length = np.where(wrong, np.nan_to_num(error, nan=np.inf, posinf=np.inf), -1.0)
    i = int(length.argmax())
    row, column = divmod(int(at[i]), truth.size[0])
    right = frame.motion[row, column].tolist()
    return WorstPixel(frame.number, column, row, name, tuple(vectors[i].tolist()), tuple(right), float(length[i]))


def _explained(truth: Truth, parts: list[tuple]) -> dict[str, float]:
    """Hypotheses that explain MOST of the wrong pixels -> share of all pixels that they explain."""
    found, total = {}, sum(int(part[3].sum()) for part in parts)
    for hypothesis in HYPOTHESES:
        matches, left = [], (1 - MOST) * total
        for frame, at, _, wrong, vectors, step in parts:
            matches.append(hypothesis.explains(Pair(truth, frame), at, vectors, step))
            left -= int((wrong & ~matches[-1]).sum())
            if left < 0:
                break
        else:
            found[hypothesis.key] = float(np.concatenate(matches).mean())
    return found


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
        fit = {key: np.mean([each.explained[key] for each in left if key in each.explained]) for key in votes}
        best = max(votes, key=lambda key: (votes[key], round(float(fit[key]), 2), -order[key]))
        for each in left:
            each.cause = best if best in each.explained else each.cause
        left = [each for each in left if not each.cause]
    for each in left:
        if each.missing >= MOST * each.wrong:
            each.cause = "pixels have no vector"
        else:
            each.cause = STARTED if each.name == FIRST else UNKNOWN


def _rejection(truth: Truth, engine: Sequence[EngineFrame]) -> Counter | None:
    """Pixels by (rejected, to be rejected), away from outlines and from the border of the previous image."""
    if any(frame.rejected is None for frame in engine):
        return None
    counts: Counter = Counter()
    for frame, shown in zip(truth.frames()[1:], engine[1:], strict=True):
        where = ~frame.edge & (frame.kind >= 0)
        counts.update(zip(shown.rejected[where].tolist(), (~frame.valid[where]).tolist(), strict=True))
    return counts


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
            truth, engine = frames.open(case)
            begun(case.name, truth.size)
            scores.append(score_case(truth, engine))
        except PathTracedError as error:
            scores.append(CaseScore(case.name, NOT_JUDGED, str(error)))
    name_causes(scores)
    return scores
