"""Which motion vectors of a sequence are right, by class: still surfaces, moving surfaces and sky.

Where the motion of every surface is known (by the scene or by previous positions), both classes of surfaces are judged.
Otherwise the camera's motion is all that is known: surfaces whose vectors agree with it are still, and what moves is
not judged.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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
"""Fewest pixels of a class."""

MIN_MOTION_PX = 0.2
"""Median length below which motion shows nothing."""

RIGHT, WRONG, NOT_JUDGED, ABSENT = ANSWERS = ("right", "wrong", "not judged", "absent")
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
    def surfaces(self) -> Array:
        """Pixels with a surface, a vector and something to compare with, (h * w,) bool."""
        return np.isfinite(self.corrected[:, 0] + (self.truth if self.known else self.still)[:, 0])

    def near(self, expected: Array, vectors: Array | None = None) -> Array:
        """Where ``vectors``, None: ``corrected``, are within the tolerance of ``expected``, (h * w,) bool."""
        return length(difference(expected, self.corrected if vectors is None else vectors)) <= tolerance(expected)

    @property
    def good(self) -> bool:
        """Whether camera or truth explain enough."""
        surfaces = self.surfaces
        return bool(surfaces.any()) and float(self.near(self.truth if self.known else self.still)[surfaces].mean()) >= (
            ENOUGH
        )

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
        return self._right(self.stored)

    @property
    def explained(self) -> float:
        """Share of the judged surfaces that are right once corrected, 0 to 1."""
        return self._right(self.corrected)

    def _right(self, vectors: Array) -> float:
        known = self.surfaces & np.isfinite(self.expected[:, 0])
        return float(self.near(self.expected, vectors)[known].mean()) if known.any() else 0.0

    @property
    def expected_px(self) -> float:
        """Median length of the motion of surfaces, pixels."""
        motion = length((self.truth if self.known else self.still)[self.surfaces])
        return float(np.median(motion)) if len(motion) else 0.0

    @property
    def errors(self) -> tuple[Array, ...]:
        """Errors (h, w) as read and corrected, pixels, NaN where nothing is known."""
        given = (self.stored, self.corrected)
        return tuple(length(difference(v, self.expected)).reshape(self.size[::-1]) for v in given)


def difference(a: Array, b: Array) -> Array:
    """``a`` - ``b`` without warnings for infinite values."""
    with np.errstate(invalid="ignore", over="ignore"):
        return a - b


def length(vectors: Array) -> Array:
    """Lengths (...) of vectors (..., 2)."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.hypot(vectors[..., 0], vectors[..., 1])


def tolerance(expected: Array) -> Array:
    """Largest accepted error, pixels, of vectors that should be ``expected`` (..., 2)."""
    return TOLERANCE_PX + np.nan_to_num(np.abs(expected)).max(axis=-1) * 2.0**-11


def class_verdicts(pairs: Sequence[PairVectors]) -> tuple[ClassVerdict, ...]:
    """The verdict on each class that has pixels.  No pair: none."""
    return tuple(verdict for verdict in (*_surfaces(pairs), _sky(pairs)) if verdict is not None) if pairs else ()


def _surfaces(pairs: Sequence[PairVectors]) -> Iterator[ClassVerdict | None]:
    if not any(pair.surfaces.any() for pair in pairs):
        text = "no vector of a surface can be compared: no geometry, or no finite vectors"
        yield ClassVerdict(STILL, NOT_JUDGED, text, 0.0)
    elif any(pair.known for pair in pairs):
        yield from _by_truth([pair for pair in pairs if pair.known])
    else:
        yield from _by_camera(pairs)


def _by_truth(pairs: Sequence[PairVectors]) -> Iterator[ClassVerdict | None]:
    for name in (STILL, MOVING):
        masks = [pair.surfaces & ((length(difference(pair.truth, pair.still)) > TOLERANCE_PX) == (name == MOVING))
                 for pair in pairs]  # fmt: skip
        yield _judged(name, pairs, masks, [pair.truth for pair in pairs])


def _by_camera(pairs: Sequence[PairVectors]) -> Iterator[ClassVerdict | None]:
    good, masks = [pair for pair in pairs if pair.good], [pair.surfaces for pair in pairs]
    surfaces, explained = _share(masks, pairs), _explained([(p, p.surfaces) for p in pairs], "still") or 0.0
    shares = {key: _explained([(p, p.surfaces) for p in pairs], key) or 0.0 for key in FAULTS if key != "still"}
    fault = max(shares, key=shares.get)
    if not good and shares[fault] < ENOUGH:
        fault = "random" if all(_random(pair, pair.surfaces) for pair in pairs) else ""
    elif shares[fault] < max(ENOUGH, explained + MARGIN):
        fault = ""
    if fault or not good:
        why = "no convention explains the vectors: surfaces move, or the pass is no motion"
        yield ClassVerdict(STILL, WRONG if fault else NOT_JUDGED, FAULTS.get(fault, why), surfaces, float(bool(fault)),
                           explained, explained, fault)  # fmt: skip
        yield ClassVerdict(MOVING, NOT_JUDGED, "not known: give --scene-file or previous positions", 0.0)
        return
    still = [pair.surfaces & pair.near(pair.still) for pair in good]
    yield _judged(STILL, good, still, [pair.still for pair in good])
    others = [pair.surfaces & ~mask for pair, mask in zip(good, still, strict=True)]
    if _share(others, good) < 1.0 - MOST and sum(map(np.count_nonzero, others)) < FEW_PIXELS * len(good):
        yield ClassVerdict(MOVING, NOT_JUDGED, _NOTHING, _share(others, good))
    else:
        text = "vectors differ from the camera's: give --scene-file or previous positions"
        yield ClassVerdict(MOVING, NOT_JUDGED, text, _share(others, good))


def _judged(
    name: str, pairs: Sequence[PairVectors], masks: Sequence[Array], expected: Sequence[Array]
) -> ClassVerdict | None:
    """The verdict on the pixels of ``masks``, whose vectors should be ``expected``; None for too few pixels."""
    if sum(map(np.count_nonzero, masks)) < FEW_PIXELS:
        return None
    used = [(p, m, e) for p, m, e in zip(pairs, masks, expected, strict=True) if m.any()]
    read, right = ([p.near(e, vectors)[m] for (p, m, e), vectors in zip(used, given, strict=True)]
                   for given in ([p.stored for p, *_ in used], [p.corrected for p, *_ in used]))  # fmt: skip
    shares = (_share(masks, pairs), 1.0, *(float(np.concatenate(each).mean()) for each in (read, right)))
    bad = [(p, m & ~p.near(e)) for (p, m, e), each in zip(used, right, strict=True)
           if each.size >= FEW_PIXELS and each.mean() < MOST]  # fmt: skip
    if not bad and shares[3] >= MOST:
        return ClassVerdict(name, RIGHT, "", *shares)
    bad = bad or [(p, m & ~p.near(e)) for p, m, e in used]
    fault = _named(bad, name)
    frames = ", ".join(str(p.frame) for p, _ in bad)
    text = FAULTS.get(fault, "no known fault explains them") + f" (frame {frames})" * (len(bad) < len(pairs))
    return ClassVerdict(name, WRONG, text, *shares, fault=fault)


def _named(bad: Sequence[tuple[PairVectors, Array]], name: str) -> str:
    """The key of FAULTS that explains most of the wrong vectors, if it explains MOST of them; "" for none."""
    shares = {key: _explained(bad, key) or 0.0 for key in FAULTS if not (key == "still" and name == STILL)}
    if shares[best := max(shares, key=shares.get)] >= MOST:
        return best
    return "random" if all(_random(pair, mask) for pair, mask in bad) else ""


def _explained(masks: Sequence[tuple[PairVectors, Array]], fault: str) -> float | None:
    """Share of the pixels of ``masks`` that a fault explains, of those for which it is known; None for few pixels."""
    known = [(p, m & np.isfinite(p.faults[fault][:, 0])) for p, m in masks if fault in p.faults]
    count = sum(np.count_nonzero(m) for _, m in known)
    if count < FEW_PIXELS:
        return None
    return sum(np.count_nonzero(p.near(p.faults[fault]) & m) for p, m in known) / count


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
    pixels = _share(masks, pairs)
    vectors = np.concatenate([pair.stored[mask] for pair, mask in zip(pairs, masks, strict=True)])
    far = np.concatenate([pair.far[mask] for pair, mask in zip(pairs, masks, strict=True)])
    if not np.isfinite(vectors).all(axis=-1).mean() >= ENOUGH:
        return ClassVerdict(SKY, ABSENT, "the sky has no vectors (NaN): reproject it by the camera", pixels)
    if np.nanmedian(length(far)) >= MIN_MOTION_PX and (length(vectors) <= 1e-6).mean() >= MOST:
        text = "the sky has no vectors (zero although the camera turns): reproject it by the camera"
        return ClassVerdict(SKY, ABSENT, text, pixels)
    return _judged(SKY, pairs, masks, [pair.far for pair in pairs])


def _share(masks: Sequence[Array], pairs: Sequence[PairVectors]) -> float:
    """Pixels of ``masks`` over those of ``pairs``."""
    return sum(map(np.count_nonzero, masks)) / sum(len(pair.still) for pair in pairs)


def simple_faults(pair: PairVectors, late: Mapping[str, Array | None]) -> dict[str, Array]:
    """What vectors would be by each of FAULTS, (h * w, 2).  ``late``: those that other frames give; None: unknown."""
    shown, still = pair.corrected[pair.surfaces], pair.still
    middle = np.median(shown, axis=0) if len(shown) else np.full(2, np.nan)
    out = {"zero": np.zeros_like(still), "constant": np.broadcast_to(middle, still.shape), "still": still}
    out |= {name: values for name, values in late.items() if values is not None}
    if pair.known:
        moved = pair.truth - still
        out |= {name: still + factor * moved for name, factor in (("half", 0.5), ("double", 2.0), ("negative", -1.0))}
    return out
