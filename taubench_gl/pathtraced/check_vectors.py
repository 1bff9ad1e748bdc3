"""Which motion vectors of a sequence are right, by class: still surfaces, moving surfaces and sky.

Where the motion of every surface is known (by the scene or by previous positions), both classes of surfaces are judged.
Otherwise the camera's motion is all that is known: surfaces whose vectors agree with it are still, and what moves is
not judged.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray

TOLERANCE_PX = 0.1
"""A vector within this distance of the expected one is explained; half a step of a 16-bit value is added."""

ENOUGH = 0.5
"""Share of a pair's surfaces that the camera must explain where nothing else is known."""

MOST = 0.95
"""Share of a class that must be explained; share of the wrong vectors that a named fault explains."""

MARGIN = 0.05
"""Share by which a fault must explain more surfaces than the camera, where nothing else is known."""

FEW_PIXELS = 50
"""Fewest pixels that show anything: of a class, of a fault, of surfaces that move."""

MIN_MOTION_PX = 0.2
"""Median length below which motion shows nothing."""

RIGHT, WRONG, NOT_JUDGED, ABSENT = ANSWERS = ("right", "wrong", "not judged", "absent")
EXIT_CODES = {RIGHT: 0, WRONG: 1, NOT_JUDGED: 3}
"""Exit codes of `check` and `conformance score` by their answer."""

STILL, MOVING, SKY = CLASSES = ("still surfaces", "moving surfaces", "sky")

FAULTS = {
    "zero": "vectors are zero", "constant": "every vector is the same", "still": "object motion is missing",
    "late": "vectors are late by one frame", "early": "vectors are early by one frame",
    "camera late": "vectors are of the previous frame's camera", "two": "vectors lead two frames back",
    "half": "object motion has half its length", "double": "object motion has twice its length",
    "negative": "object motion has the wrong sign", "random": "vectors are random",
}  # fmt: skip
"""Key of a fault -> what is said of it."""

_NOTHING = "vectors equal the camera's everywhere: object motion is missing, or nothing moves"
_DIFFERENT = "vectors differ from the camera's: give --scene-file or previous positions"


@dataclass(frozen=True, slots=True)
class ClassVerdict:
    """The answer on the vectors of one class.

    ``answer``: of ANSWERS, ``absent`` for pixels without vectors; ``pixels``: the class's share of the picture;
    ``judged``: share of its pixels whose motion is known; ``as_read``, ``explained``: share of these within
    TOLERANCE_PX as the mapping reads them and corrected.  Shares from 0 to 1.  ``fault``: key of FAULTS.
    """

    name: str
    answer: str
    text: str
    pixels: float
    judged: float = 0.0
    as_read: float | None = None
    explained: float | None = None
    fault: str = ""


@dataclass(slots=True)
class PairVectors:
    """Vectors into file ``frame``: arrays over its pixels, (h * w, 2), previous - current, +y down; NaN: none.

    ``stored``: as the mapping reads them; ``corrected``: by the best reading, without jitter; ``still``: of surfaces
    that do not move; ``truth``: of every surface; ``far``: of the sky; ``faults``: by key of FAULTS;
    ``jitter_px`` (2,): left in ``stored``; ``size``: width, height.
    """

    frame: int
    size: tuple[int, int]
    stored: Array
    corrected: Array
    still: Array
    truth: Array
    far: Array
    jitter_px: Array
    faults: dict[str, Array] = field(default_factory=dict)

    @property
    def known(self) -> bool:
        """Whether the motion of surfaces is known."""
        return bool(np.isfinite(self.truth).any())

    @property
    def reference(self) -> Array:
        """What vectors of surfaces are compared with: the truth or, where it is not known, ``still``."""
        return self.truth if self.known else self.still

    @property
    def surfaces(self) -> Array:
        """Pixels with a surface, a vector and something to compare with, (h * w,) bool."""
        return np.isfinite(self.corrected[:, 0] + self.reference[:, 0])

    def near(self, expected: Array, vectors: Array | None = None) -> Array:
        """Where ``vectors``, None: ``corrected``, are within the tolerance of ``expected``, (h * w,) bool."""
        return length(self.corrected if vectors is None else vectors, expected) <= tolerance(expected)

    @property
    def good(self) -> bool:
        """Whether camera or truth explain enough."""
        return self._right(self.corrected, self.reference) >= ENOUGH

    @property
    def expected(self) -> Array:
        """What is known of each pixel: vectors (h * w, 2), NaN where nothing is."""
        if self.known:
            return np.where(np.isfinite(self.truth), self.truth, self.far)
        judged = self.surfaces & (self.near(self.still) | (not self.good))
        return np.where(judged[:, None], self.still, self.far)

    @property
    def judged(self) -> float:
        """Share of the surfaces with a vector whose motion is known, 0 to 1."""
        return float(np.isfinite(self.expected[self.surfaces, 0]).mean()) if self.surfaces.any() else 0.0

    @property
    def as_read(self) -> float:
        """Share of the judged surfaces that are right as the mapping reads them, 0 to 1."""
        return self._right(self.stored, self.expected)

    @property
    def explained(self) -> float:
        """Share of the judged surfaces that are right once corrected, 0 to 1."""
        return self._right(self.corrected, self.expected)

    def _right(self, vectors: Array, expected: Array) -> float:
        known = self.surfaces & np.isfinite(expected[:, 0])
        return float(self.near(expected, vectors)[known].mean()) if known.any() else 0.0

    @property
    def expected_px(self) -> float:
        """Median length of the motion of surfaces, pixels."""
        motion = length(self.reference[self.surfaces])
        return float(np.median(motion)) if len(motion) else 0.0

    @property
    def errors(self) -> tuple[Array, ...]:
        """Errors (h, w) as read and corrected, pixels, NaN where nothing is known."""
        return tuple(length(v, self.expected).reshape(self.size[::-1]) for v in (self.stored, self.corrected))


@np.errstate(invalid="ignore", over="ignore")
def length(vectors: Array, others: Array | float = 0.0) -> Array:
    """Lengths (...) of vectors (..., 2) less ``others``, without warnings for infinite values."""
    off = vectors - others
    return np.hypot(off[..., 0], off[..., 1])


def tolerance(expected: Array) -> Array:
    """Largest accepted error, pixels, of vectors that should be ``expected`` (..., 2)."""
    return TOLERANCE_PX + np.nan_to_num(np.abs(expected)).max(axis=-1) * 2.0**-11


def overall(answers: Collection[str]) -> str:
    """The answer on the whole from those on all parts: wrong if any is, else not judged if any is, else right."""
    return next((answer for answer in (WRONG, NOT_JUDGED) if answer in answers), RIGHT)


def exit_code(answer: str, allow_unjudged: bool) -> int:
    """The exit code of an ``overall`` answer; ``allow_unjudged``: that of right where nothing is judged."""
    return EXIT_CODES[RIGHT if allow_unjudged and answer == NOT_JUDGED else answer]


def class_verdicts(pairs: Sequence[PairVectors]) -> tuple[ClassVerdict, ...]:
    """The verdict on each class that has pixels.  No pair: none."""
    return tuple(verdict for verdict in (*_surfaces(pairs), _sky(pairs)) if verdict is not None) if pairs else ()


def _surfaces(pairs: Sequence[PairVectors]) -> Iterator[ClassVerdict | None]:
    if not any(pair.surfaces.any() for pair in pairs):
        text = "no vector of a surface can be compared: no geometry, or no finite vectors"
        yield ClassVerdict(STILL, NOT_JUDGED, text, 0.0)
    elif known := [pair for pair in pairs if pair.known]:
        for name in (STILL, MOVING):
            masks = [p.surfaces & ((length(p.truth, p.still) > TOLERANCE_PX) == (name == MOVING)) for p in known]
            yield _judged(name, known, masks, "truth")
    else:
        yield from _by_camera(pairs)


def _by_camera(pairs: Sequence[PairVectors]) -> Iterator[ClassVerdict | None]:
    good, surfaces = [p for p in pairs if p.good], [(p, p.surfaces) for p in pairs]
    shares = _fault_shares(surfaces)
    explained = shares.pop("still")
    fault = max(shares, key=shares.get)
    if not good and shares[fault] < ENOUGH:
        fault = "random" if all(_random(*each) for each in surfaces) else ""
    elif shares[fault] < max(ENOUGH, explained + MARGIN):
        fault = ""
    if fault or not good:
        why = "no convention explains the vectors: surfaces move, or the pass is no motion"
        yield ClassVerdict(STILL, WRONG if fault else NOT_JUDGED, FAULTS.get(fault, why),
                           _share([mask for _, mask in surfaces], pairs), float(bool(fault)),
                           explained, explained, fault)  # fmt: skip
        yield ClassVerdict(MOVING, NOT_JUDGED, "not known: give --scene-file or previous positions", 0.0)
        return
    yield _judged(STILL, good, [p.surfaces & p.near(p.still) for p in good], "still")
    others = [p.surfaces & ~p.near(p.still) for p in good]
    few = _share(others, good) < 1.0 - MOST and sum(map(np.count_nonzero, others)) < FEW_PIXELS * len(good)
    yield ClassVerdict(MOVING, NOT_JUDGED, _NOTHING if few else _DIFFERENT, _share(others, good))


def _judged(name: str, pairs: Sequence[PairVectors], masks: Sequence[Array], expected: str) -> ClassVerdict | None:
    """The verdict on the pixels of ``masks``, whose vectors should be the field ``expected``; None for too few."""
    if sum(map(np.count_nonzero, masks)) < FEW_PIXELS:
        return None
    used = [(p, m, getattr(p, expected)) for p, m in zip(pairs, masks, strict=True) if m.any()]
    read, right = ([p.near(e, getattr(p, reading))[m] for p, m, e in used] for reading in ("stored", "corrected"))
    shares = (_share(masks, pairs), 1.0, *(float(np.concatenate(each).mean()) for each in (read, right)))
    wrong = [(p, m & ~p.near(e)) for p, m, e in used]
    bad = [w for w, near in zip(wrong, right, strict=True) if near.size >= FEW_PIXELS and near.mean() < MOST]
    if not bad and shares[3] >= MOST:
        return ClassVerdict(name, RIGHT, "", *shares)
    bad = bad or wrong
    explained = _fault_shares(bad)
    explained["still"] *= name != STILL
    fault = max(explained, key=explained.get)
    if explained[fault] < MOST:
        fault = "random" if all(_random(*each) for each in bad) else ""
    text = FAULTS.get(fault, "no known fault explains them")
    text += f" (frame {', '.join(str(p.frame) for p, _ in bad)})" * (len(bad) < len(pairs))
    return ClassVerdict(name, WRONG, text, *shares, fault=fault)


def _fault_shares(masks: Sequence[tuple[PairVectors, Array]]) -> dict[str, float]:
    """Key of FAULTS -> share of the pixels of ``masks`` that it explains, of those it says something of; 0: of few."""
    shares = dict.fromkeys(FAULTS, 0.0)
    for fault in FAULTS:
        known = [(p, m & np.isfinite(p.faults[fault][:, 0])) for p, m in masks if fault in p.faults]
        count = sum(np.count_nonzero(m) for _, m in known)
        if count >= FEW_PIXELS:
            shares[fault] = sum(np.count_nonzero(p.near(p.faults[fault]) & m) for p, m in known) / count
    return shares


def _random(pair: PairVectors, mask: Array) -> bool:
    """Whether vectors of ``mask`` (h * w,) differ from their neighbors' mean about as much as from each other."""
    width, height = pair.size
    field = np.where(mask[:, None], pair.corrected, np.nan).reshape(height, width, 2)
    around = (field[:-2, 1:-1] + field[2:, 1:-1] + field[1:-1, :-2] + field[1:-1, 2:]) / 4
    off, field = field[1:-1, 1:-1] - around, field[1:-1, 1:-1]
    if not np.isfinite(off).any():
        return False
    off = np.nanmedian(length(off))
    return off > 2 * TOLERANCE_PX and off > 0.5 * np.nanmedian(length(field - np.nanmedian(field, axis=(0, 1))))


def _sky(pairs: Sequence[PairVectors]) -> ClassVerdict | None:
    masks = [np.isfinite(pair.far[:, 0]) for pair in pairs]
    if sum(map(np.count_nonzero, masks)) < FEW_PIXELS:
        return None
    vectors, far = (np.concatenate([getattr(p, name)[mask] for p, mask in zip(pairs, masks, strict=True)])
                    for name in ("stored", "far"))  # fmt: skip
    absent = ""
    if not np.isfinite(vectors).all(axis=-1).mean() >= ENOUGH:
        absent = "NaN"
    elif np.nanmedian(length(far)) >= MIN_MOTION_PX and (length(vectors) <= 1e-6).mean() >= MOST:
        absent = "zero although the camera turns"
    if absent:
        text = f"the sky has no vectors ({absent}): reproject it by the camera"
        return ClassVerdict(SKY, ABSENT, text, _share(masks, pairs))
    return _judged(SKY, pairs, masks, "far")


def _share(masks: Sequence[Array], pairs: Sequence[PairVectors]) -> float:
    """Share of all pixels of ``pairs`` that ``masks``, (h * w,) bool for each pair, have set, 0 to 1."""
    return sum(map(np.count_nonzero, masks)) / sum(len(pair.still) for pair in pairs)


def simple_faults(pair: PairVectors, late: Mapping[str, Array]) -> dict[str, Array]:
    """What vectors would be by each of FAULTS, (h * w, 2).  ``late``: those that other frames give."""
    shown, still = pair.corrected[pair.surfaces], pair.still
    middle = np.median(shown, axis=0) if len(shown) else np.full(2, np.nan)
    out = {"zero": np.zeros_like(still), "constant": np.broadcast_to(middle, still.shape), "still": still, **late}
    if pair.known:
        moved = pair.truth - still
        out |= {name: still + factor * moved for name, factor in (("half", 0.5), ("double", 2.0), ("negative", -1.0))}
    return out
