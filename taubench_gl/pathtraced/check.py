"""Which conventions of an EXR sequence are not those of its mapping, and which of its motion vectors are right.

*Camera*: which readings of rows, axes, origin, unit, camera matrices and frame order put the points of the position
pass on their pixels.  *Motion*: with each reading that is left, which reading of the motion pass agrees with the motion
of the points: of all surfaces by the scene or by previous positions, and of surfaces that stand still.  Of the readings
that explain as many pixels as the best one, the simplest wins; equally simple ones are equivalent: the files cannot
tell them apart.  *Depth*: how it follows from the points.  *Vectors*: read that way, each class is judged
(``check_vectors``).
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from taubench_gl.animation import View
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced import cameras as cams
from taubench_gl.pathtraced.cameras import PathTracedCamera, points_at, project
from taubench_gl.pathtraced.check_files import PREVIOUS, SAME_POINT, SCENE, STILL, Files, Samples, Truth
from taubench_gl.pathtraced.check_vectors import (
    ENOUGH,
    FEW_PIXELS,
    MIN_MOTION_PX,
    MOST,
    NOT_JUDGED,
    TOLERANCE_PX,
    WRONG,
    ClassVerdict,
    PairVectors,
    class_verdicts,
    length,
    overall,
    simple_faults,
    tolerance,
)
from taubench_gl.pathtraced.passes import PathTracedFrame
from taubench_gl.pathtraced.readings import (
    BACKWARDS,
    GEOMETRY,
    MOTION,
    Reading,
    geometry_readings,
    geometry_values,
    motion_readings,
    text_of,
    value_in,
)
from taubench_gl.pathtraced.sequence import PathTracedSequence

Array = np.ndarray
log = logging.getLogger(__name__)

SAME = 0.02  # readings whose shares of explained pixels differ by less cannot be distinguished
MARGIN = 0.1  # by which more a reading must explain that scores other pixels or other axes
MAX_JITTER_PX = 1.5  # largest jitter: the difference of two offsets, each in [-0.5, 0.5], and a margin
MIN_JITTER_PX = 0.02  # smaller offsets are rounding of 16-bit passes; largest spread of jitter
CENTERED_PX = 0.05  # largest offset of positions from the pixel centers that is not mentioned
MAX_SHIFT_PX = 0.45  # offset, per axis, from which on positions are those of other points than pixel centers
MAX_TILT = 2.0  # degrees, median, between normals and the slopes of positions
DEPTH_TOLERANCE = 0.001  # relative error up to which depth is explained
_OTHERS = ("jitter", "cuts")


@dataclass(frozen=True, slots=True)
class Verdict:
    """One convention.

    ``status``: ok, wrong, note (differs, but no mapping has such a key) or "not checked"; ``text``: what was found and
    what to set; ``as_read``, ``explained``: share of pixels, 0 to 1, that this convention as the mapping has it and the
    corrected one explain, all others being corrected; ``equivalent``: other corrections that explain as many;
    ``value``: what corrects it, as in ``Reading``.
    """

    convention: str
    status: str
    text: str
    as_read: float | None = None
    explained: float | None = None
    equivalent: tuple[str, ...] = ()
    value: str = ""


@dataclass(frozen=True, slots=True)
class Check:
    """Verdicts, in the order of the tables; ``reading`` corrects the files; ``basis``: what motion is compared with."""

    verdicts: tuple[Verdict, ...]
    reading: Reading
    basis: str = ""
    pairs: tuple[PairVectors, ...] = ()
    classes: tuple[ClassVerdict, ...] = ()

    @property
    def wrong(self) -> tuple[Verdict, ...]:
        """The conventions that are wrong."""
        return tuple(v for v in self.verdicts if v.status == "wrong")

    @property
    def answer(self) -> str:
        """Wrong if a convention or a class is, else not judged if a class is not, else right.

        Files without vectors are right if their camera is.
        """
        answers = {WRONG} if self.wrong else {verdict.answer for verdict in self.classes}
        if not self.classes and self["camera"].status == "not checked":
            answers |= {NOT_JUDGED}
        return overall(answers)

    def __getitem__(self, convention: str) -> Verdict:
        return next(v for v in self.verdicts if v.convention == convention)

    def of(self, name: str) -> ClassVerdict | None:
        """The verdict on a class of ``check_vectors.CLASSES``; None where it has no pixels."""
        return next((verdict for verdict in self.classes if verdict.name == name), None)


@np.errstate(invalid="ignore", divide="ignore", over="ignore")  # files may hold any value
def check_sequence(
    sequence: PathTracedSequence,
    camera: PathTracedCamera,
    frames: Sequence[int] | None = None,
    pairs: int = 4,
    truth: Truth | None = None,
) -> Check:
    """Check at most ``pairs`` pairs of consecutive files among ``frames``, None: all.

    ``truth``: what the scene shows at the frames of files, None: not known.  A ``FittedCamera`` shows neither axes nor
    units.  Raises PathTracedError for files that cannot be read.
    """
    chosen = sequence.frames if frames is None else frames
    starts = [n for n in chosen if n + 1 in chosen][:pairs]
    numbers = sorted({n + step for n in starts for step in (0, 1)}) or chosen[:1]
    log.info("checking the conventions of %d frames", len(numbers))
    geometry = "motion" not in sequence.index  # without it the scene may do
    files = Files(sequence, camera, {n: sequence.read(n, geometry=geometry) for n in numbers}, starts, truth)
    for number, frame in files.frames.items():
        camera.place(number, frame)
    names = sorted(name for name in sequence.mapping.passes if name in sequence.index)
    missing = "; ".join(f"{column}: {why}" for column, why in sequence.missing().items())
    text = f"{len(names)} found with the mapping {sequence.mapping.name}: {', '.join(names)}"
    passes = Verdict("passes", "note" if missing else "ok", f"{text}; missing: {missing}" if missing else text)
    if not files.geometry:
        why = "there is neither a position nor a depth pass"
    elif not files.fitted or any(files.view(numbers[0], Reading(rows=rows)) for rows in ("", "bottom first")):
        return _by_geometry(files, passes)
    else:
        why = "no camera is given, and none can be estimated from positions"
    skipped = [passes, *_skipped(("camera", *GEOMETRY, "centers", "normals"), why)]
    return _by_vectors(files, skipped)


def _skipped(names: Iterable[str], why: str) -> list[Verdict]:
    return [Verdict(name, "not checked", why) for name in names]


def _explained(difference: Array, limit: float | Array, shifted: bool = False) -> Array:
    """Share of the vectors (..., N, 2) that are at most ``limit`` long, (...); ``shifted``: less their offset.

    NaN vectors do not count; no vector at all explains nothing.
    """
    difference = difference - _offset(difference) if shifted else difference
    lengths = length(difference)
    return (lengths <= limit).sum(axis=-1) / np.maximum(np.isfinite(lengths).sum(axis=-1), 1)


def _offset(difference: Array) -> Array:
    """Median of vectors (..., N, 2) where it can be a jitter, else 0: (..., 1, 2)."""
    offset = np.median(np.nan_to_num(difference, nan=1e9), axis=-2, keepdims=True)
    return np.where(np.abs(offset).max(axis=-1, keepdims=True) <= MAX_JITTER_PX, offset, 0.0)


# ------------------------------------------------------------------------------------------------------------ search
def _by_geometry(files: Files, passes: Verdict) -> Check:
    kinds = {cams.SidecarCamera: "sidecar", cams.SceneCamera: "scene", cams.FittedCamera: "fitted"}
    limit = TOLERANCE_PX
    values = geometry_values(files.sequence.mapping, files.positions, kinds[type(files.camera)])
    left = geometry_readings(values)
    if files.positions:
        shares, limit = _placed(files, left)
        left = [r for r, share in zip(left, shares, strict=True) if share >= max(ENOUGH, shares.max() - SAME)]
        if files.shifted(left[0] if left else None):
            return _by_geometry(files, passes)
        if not left:
            text, share = f"{files.camera.describe()}: it did not render these files", float(shares.max())
            others = _skipped((*GEOMETRY, "centers", "normals"), "no reading of the camera explains the files")
            return _by_vectors(files, [passes, Verdict("camera", "wrong", text, share, share), *others])
    checked = _search(files, left, limit)
    if files.shifted(checked.best):
        return _by_geometry(files, passes)
    verdicts = [*(checked.verdict(name, name in values) for name in GEOMETRY[:-1]), checked.centers()]
    verdicts += [checked.depth(), checked.normals()]
    return checked.result([passes, checked.camera(), *verdicts])


def _by_vectors(files: Files, verdicts: list[Verdict]) -> Check:
    """Vectors against the scene's, whatever the camera and the points of the files are."""
    files.frames = {n: replace(f, position=None, depth=None, prev_position=None) for n, f in files.frames.items()}
    return _search(files, [Reading()], TOLERANCE_PX).result(verdicts)


def _placed(files: Files, readings: Sequence[Reading]) -> tuple[Array, float]:
    """Mean share over the files of pixels that each reading puts in place, (R,); and the tolerance, pixels."""
    shares = np.full((len(files.frames), len(readings)), np.nan)
    for limit in (TOLERANCE_PX, cams.MAX_MISMATCH_PX):  # passes that are averaged over a pixel need the second
        for row, number in enumerate(files.frames):
            off = [files.misplaced(number, reading, few=True) for reading in readings]
            for shifted in (False, True):  # samples may be jittered
                shares[row] = [np.nan if d is None else _explained(d, limit, shifted) for d in off]
                if np.nanmax(shares[row], initial=0.0) >= ENOUGH:
                    break
        covered = np.isfinite(shares)
        mean = np.where(covered, shares, 0.0).sum(axis=0) / np.maximum(covered.sum(axis=0), 1)
        if mean.max() >= ENOUGH:
            break
    return mean, limit


_Explained = dict[str, dict[int, bool]]
"""What motion can be compared with -> first files of pairs that are explained -> whether only with an offset."""


def _search(files: Files, left: Sequence[Reading], limit_px: float) -> _Checked:
    """The simplest combination of the readings ``left`` with those of motion that explains the files."""
    motion, starts = motion_readings(files.sequence.mapping), [] if files.any_frame.motion is None else files.starts
    bases: _Explained = {}
    total = []
    for basis in files.bases:
        found = {}
        for first in starts:
            stored = {n: files.motion(files.few[n], motion) for n in (first, first + 1)}
            moved = [files.moved(first, reading, basis, few=True) for reading in left]
            # An offset may explain what no reading does.  Jitter is the same everywhere, animation is not.
            for shifted, limit in ((False, TOLERANCE_PX), (True, MIN_JITTER_PX)):
                share = np.zeros((len(left), len(motion)))
                for row, expected in enumerate(moved):
                    if expected is not None and np.isfinite(expected[:, 0]).sum() >= FEW_PIXELS:
                        off = stored[files.pair(first, left[row])[0]] - expected
                        share[row] = _explained(off, limit if shifted else tolerance(expected), shifted)
                        # Where no motion (and an offset) explains about as much, no correction is shown.
                        shown = share[row] > _explained(expected, limit, shifted) + MARGIN
                        shown[0] |= not left[row].values or left[row] == left[0]
                        share[row] *= shown
                if share.max() >= ENOUGH:
                    found[first] = share, shifted
                    break
        if found:
            total.append(np.mean([share for share, _ in found.values()], axis=0))
            bases[basis] = {first: shifted for first, (_, shifted) in found.items()}
    if not total:
        return _Checked(files, limit_px, left[0], [r for r in left[1:] if not starts], bases)
    # Previous positions hold for what moves; still surfaces also show the unit and the place of the camera.
    total = np.mean(total, axis=0)
    lowered = total - MARGIN * np.array([[reading.order in BACKWARDS] for reading in left])
    first = lowered >= lowered.max() - SAME
    alike = [(not first[g, m], replace(left[g], **motion[m].values), total[g, m])
             for g, m in np.argwhere(first | (total >= total.max() - SAME))]  # fmt: skip
    best, *others = (r for _, r, _ in sorted(alike, key=_simplicity))
    return _Checked(files, limit_px, best, others, bases)


def _simplicity(each: tuple[bool, Reading, float]) -> tuple[bool, int, float, list[int]]:
    """Order of readings, the preferred first; equal shares: by the order of conventions."""
    lower, reading, share = each
    return lower, len(reading.values), -round(share, 2), [(*GEOMETRY, *MOTION).index(name) for name in reading.values]


# ---------------------------------------------------------------------------------------------------------- verdicts
@dataclass
class _Checked:
    """What the search found, as verdicts."""

    files: Files
    limit: float  # largest accepted error of positions, pixels
    best: Reading
    alike: list[Reading]  # others that explain as many pixels
    bases: _Explained

    def __post_init__(self) -> None:
        # Every verdict compares with the best reading.
        self._placed, self._moved = cache(self._placed), cache(self._moved)

    @property
    def basis(self) -> str:
        """What motion is compared with: the first of those that explain it, else of those that there are."""
        return next((b for b in (*self.bases, *self.files.bases)), STILL)

    def result(self, verdicts: list[Verdict]) -> Check:
        """The check with the verdicts on motion and on its classes."""
        if self.files.any_frame.motion is None or not self.files.starts:
            why = "there is no motion pass" if self.files.starts else "no two frames are consecutive"
            classes = () if self.files.any_frame.motion is None else (ClassVerdict("vectors", NOT_JUDGED, why, 1.0),)
            return Check((*verdicts, *_skipped((*MOTION, *_OTHERS), why)), self.best, classes=classes)
        pairs = [pair for first in self.files.starts if (pair := self.vectors(first)) is not None]
        for pair in pairs:
            pair.faults |= simple_faults(pair, self.late(pair, {p.frame: p for p in pairs}))
        classes = class_verdicts(pairs) or (ClassVerdict("vectors", NOT_JUDGED, "nothing to compare them with", 1.0),)
        # A fault that is named explains pairs that the conventions do not.
        good = [pair for pair in pairs if pair.good or any(verdict.fault for verdict in classes)]
        return Check((*verdicts, *self.motion(pairs, good)), self.best, self.basis, tuple(pairs), classes)

    def camera(self) -> Verdict:
        """Whether the camera put the positions of every file on their pixels."""
        text = self.files.camera.describe()
        if not self.files.positions:
            return Verdict("camera", "not checked", f"{text}: there is no position pass")
        share = self._placed(self.best)
        if not self.best.without(*MOTION).values:
            try:
                for number, frame in self.files.frames.items():
                    cams.checked_view(self.files.camera, number, frame)
            except PathTracedError as error:
                return Verdict("camera", "wrong", f"{error.what}: {error.hint}", share, share)
        return Verdict("camera", "ok", f"{text}: positions within {self.limit:g} px", share, share)

    def verdict(self, name: str, tried: bool = True) -> Verdict:
        """The verdict on a convention of ``Reading``."""
        best, mapping = self.best, self.files.sequence.mapping
        if not tried:
            why = "there is no camera to compare with" if self.files.fitted else "these files do not have it"
            return Verdict(name, "not checked", why)
        value, read, size = getattr(best, name), best.without(name), len(best.values)
        measures = [(self._placed(read), self._placed(best))] if name not in MOTION and self.files.positions else []
        measures += [(self._moved(read, basis), self._moved(best, basis)) for basis in self.bases]
        shares = next((m for m in measures if m[1] - m[0] > SAME), measures[0] if measures else (None, None))
        if value:
            others = [r.values.items() - best.values.items() for r in self.alike
                      if len(r.values) == size and getattr(r, name) != value]  # fmt: skip
            texts = ["; ".join(text_of(*each, mapping) for each in sorted(other)) for other in others]
            if name == "rows" and self.files.fitted:
                texts.append("axes have the other handedness: set up")
            return Verdict(name, "wrong", text_of(name, value, mapping), *shares, tuple(texts), value)
        others = [getattr(r, name) for r in self.alike if len(r.values) == size + 1 and r.without(name) == best]
        if others:
            texts = tuple(text_of(name, other, mapping) for other in others)
            return Verdict(name, "not checked", "these files do not show it", *shares, texts)
        return Verdict(name, "ok", value_in(mapping, name), *shares)

    def centers(self) -> Verdict:
        """Whether positions are those of pixel centers."""
        numbers = self.files.frames if self.files.positions else ()
        off = [d for n in numbers if (d := self.files.misplaced(n, self.best)) is not None and np.isfinite(d).any()]
        if not off:
            why = "no position is in front of the camera" if numbers else "there is no position pass"
            return Verdict("centers", "not checked", why)
        offsets = np.array([_offset(d)[0] for d in off])
        x, y = offsets[np.abs(offsets).max(axis=1).argmax()]
        spread = max(float(np.nanmedian(length(d - _offset(d)))) for d in off)
        if max(abs(x), abs(y), spread) <= CENTERED_PX:
            return Verdict("centers", "ok", "positions are those of pixel centers")
        if spread > CENTERED_PX:
            why = "rounded to half floats" if self.files.any_frame.half_position else "filtered"
            text = f"positions lie beside the pixel centers, each by another offset (median {spread:.2g} px): {why}"
            return Verdict("centers", "note", text)
        text = f"positions are {x:+.2f}, {y:+.2f} px off the pixel centers"
        if np.ptp(offsets, axis=0).max() > MIN_JITTER_PX:
            return Verdict("centers", "note", f"{text}, in each frame by another offset: samples are jittered")
        whole = np.rint((x, y))
        if np.abs((x, y) - whole).max() <= CENTERED_PX:
            text += f": the image is shifted by {-whole[0]:+g} columns and {-whole[1]:+g} rows"
        status = "wrong" if max(abs(x), abs(y)) > MAX_SHIFT_PX else "note"
        return Verdict("centers", status, text, value=f"{x:.3f}, {y:.3f}")

    def normals(self) -> Verdict:
        """Whether normals have the axes that the mapping says, by the slopes between neighboring points."""
        files, read = self.files, self.files.sequence.mapping.normals
        found: dict[str, list[Array]] = {"world": [], "view": []}
        for number, frame in files.frames.items():
            samples, view = files.placed[number], files.view(number, self.best)
            if frame.normal is None or view is None or not len(samples.at):
                continue
            points = files.image(samples, files.points(samples, self.best, view, samples.position), 3)
            points = points.reshape(*frame.sky.shape, 3)
            slopes = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
            across, normal = np.cross(*slopes), frame.normal[1:-1, 1:-1].astype(np.float64)
            across = across / np.linalg.norm(across, axis=-1, keepdims=True)
            for axes, turned in (("world", files.turned(normal, self.best)), ("view", normal @ view.world_from_view.T)):
                along = np.abs(np.einsum("...i,...i", across, turned)).clip(0.0, 1.0)
                found[axes].append(np.degrees(np.arccos(along[np.isfinite(along)])))
        if not found[read] or not np.concatenate(found[read]).size:
            return Verdict("normals", "not checked", "there are no normals, or no surface")
        angles = {axes: float(np.median(np.concatenate(each))) for axes, each in found.items()}
        other = "view" if read == "world" else "world"
        text = f"normals are {angles[read]:.2g} degrees off the surfaces (median)"
        if angles[read] > MAX_TILT and angles[other] < 0.5 * angles[read]:
            why = f"{text}, with {other} axes {angles[other]:.2g}: set normals = '{other}'"
            return Verdict("normals", "wrong", why, value=other)
        return Verdict("normals", "ok", read) if angles[read] < 5 * MAX_TILT else Verdict("normals", "note", text)

    def depth(self) -> Verdict:
        """How the depth of all files follows from positions, or, without them, which kind motion shows."""
        files, kind = self.files, self.files.any_frame.depth_kind
        if not self.files.positions:
            return self.verdict("depth")
        stored, planar, distance = [], [], []
        for number, samples in files.placed.items():
            view = files.view(number, self.best)
            if samples.depth is not None and view is not None and len(samples.at):
                points = files.points(samples, self.best, view, samples.position)
                stored.append(samples.depth * self.best.factor)
                planar.append(points @ -view.world_from_view[:, 2])
                distance.append(np.linalg.norm(points, axis=-1))
        if not stored:
            return Verdict("depth", "not checked", "there is no depth pass, or no surface")
        stored, planar, distance = map(np.concatenate, (stored, planar, distance))
        slack = max((3.0 * cams.rounding_m(f) for f in files.frames.values() if f.half_position), default=0.0)
        kinds, offset = {"planar": planar, "distance": distance}, files.any_frame.depth_offset * self.best.factor
        return _depth_verdict(stored, kinds, kind, offset, slack)

    def vectors(self, first: int) -> PairVectors | None:
        """The vectors of a pair by the best reading; None without a vector or anything to compare it with."""
        files, best = self.files, self.best
        current, _ = files.pair(first, best)
        samples, frame = files.every[current], files.frames[current]
        still, truth = files.moved(first, best, STILL) if files.geometry else None, None
        if SCENE in files.bases:
            truth, of_scene = (files.of_scene(name, current, samples, best) for name in ("motion", "still"))
            if truth is not None and files.positions and still is not None:
                there = files.of_scene("position", current, samples, best)
                points = files.points(samples, best, files.view(current, best), samples.position)
                away = np.linalg.norm(points - there, axis=-1) > SAME_POINT * np.linalg.norm(points, axis=-1)
                truth = np.where(away[:, None], np.nan, truth)
            still = of_scene
        elif frame.prev_position is not None:
            truth = files.moved(first, best, PREVIOUS)
        if still is None or not len(samples.at):
            return None
        read, right = files.motion(samples, [best.without(*MOTION), best])
        off = right - (still if truth is None else truth)
        off = off[np.isfinite(off[:, 0])]
        jitter = np.zeros(2)
        if len(off) and _explained(off, MIN_JITTER_PX, shifted=True) >= ENOUGH:
            jitter += _offset(off)[0] * (np.abs(_offset(off)).max() > MIN_JITTER_PX)
        vectors = {"stored": read, "corrected": right - jitter, "still": still, "truth": truth, "far": None}
        images = {name: files.image(samples, values) for name, values in vectors.items()}
        pair = PairVectors(current, files.sequence.size, **images, jitter_px=jitter)
        self._add_sky(pair, frame, *(files.view(number, best) for number in files.pair(first, best)))
        return pair

    def _add_sky(self, pair: PairVectors, frame: PathTracedFrame, view: View | None, before: View | None) -> None:
        """Vectors of the sky, and what they are of what is infinitely far away."""
        files = self.files
        sky = frame.sky if files.geometry or pair.frame not in files.truth else files.truth[pair.frame].sky
        samples = Samples.of(frame, sky)
        if view is None or before is None or view.camera.parallel or not len(samples.at):
            return
        pixels = files.pixels(samples, self.best)
        # Without the position of the camera: infinitely far away.
        directions = points_at(view, pixels, np.ones(len(pixels)), "distance", files.sequence.size)
        pair.far[samples.at] = project(before, directions, files.sequence.size, relative=True) - pixels
        read, right = files.motion(samples, [self.best.without(*MOTION), self.best])
        pair.stored[samples.at], pair.corrected[samples.at] = read, right - pair.jitter_px

    def late(self, pair: PairVectors, others: dict[int, PairVectors]) -> dict[str, Array]:
        """What vectors of a pair would be by the frames and cameras before and after it, where these are known."""
        step = 1 if self.best.order in BACKWARDS else -1
        beside = {"late": others.get(pair.frame + step), "early": others.get(pair.frame - step)}
        out = {name: np.where(np.isfinite(p.truth), p.truth, p.still) for name, p in beside.items() if p is not None}
        files, samples, size = self.files, self.files.every[pair.frame], pair.size
        numbers = (pair.frame + n * step for n in range(3))
        now, then, before = (files.view(n, self.best) if n in files.frames else None for n in numbers)
        for name, start in (("camera late", then), ("two", now)):
            if files.positions and now is not None and start is not None and before is not None:
                points = files.points(samples, self.best, now, samples.position) + now.position
                out[name] = files.image(samples, project(before, points, size) - project(start, points, size))
        return out

    def motion(self, pairs: Sequence[PairVectors], good: Sequence[PairVectors]) -> list[Verdict]:
        """Verdicts on MOTION, jitter and cuts.  ``good``: the pairs that are explained."""
        if not self.bases or not good:
            share = max([pair.as_read for pair in pairs], default=None)
            why = "no reading explains the motion"
            return [replace(verdict, as_read=share) for verdict in _skipped((*MOTION, *_OTHERS), why)]
        if max(pair.expected_px for pair in good) < MIN_MOTION_PX:
            verdicts = _skipped(MOTION, "surfaces hardly move between these frames")
        else:
            verdicts = [self.verdict(name) for name in MOTION]
        return [*verdicts, _jitter(good), _cuts(pairs, good)]

    def _placed(self, reading: Reading) -> float:
        """Share of positions in place, mean over the files."""
        off = [self.files.misplaced(number, reading) for number in self.files.frames]
        return float(np.mean([_explained(d, self.limit, shifted=True) for d in off if d is not None] or [0.0]))

    def _moved(self, reading: Reading, basis: str) -> float:
        """Share of explained motion, mean over the explained pairs."""
        shares = [0.0]
        for first, shifted in self.bases[basis].items():
            expected = self.files.moved(first, reading, basis)
            if expected is not None:
                stored = self.files.motion(self.files.every[self.files.pair(first, reading)[0]], [reading])
                shares.append(float(_explained(stored[0] - expected, tolerance(expected), shifted)))
        return sum(shares) / len(self.bases[basis])


def _depth_verdict(stored: Array, kinds: dict[str, Array], kind: str, offset: float, slack: float) -> Verdict:
    """``stored`` depth (N,) against the depth by each kind (N,), of which the mapping says ``kind`` and ``offset``.

    ``slack``: rounding of positions, meters.
    """
    planar = kinds["planar"]

    def share(expected: Array) -> float:
        return float((np.abs(stored - expected) <= DEPTH_TOLERANCE * np.abs(expected) + slack).mean())

    as_read = share(kinds[kind] * (1.0 - offset / planar))
    found = {"as read": (as_read, kind)}
    for other, expected in kinds.items():
        # Depth may be scaled, negative, and begin at the near plane, which a view ray meets at near / cos(angle).
        for terms in ((expected,), (expected, expected / planar)):
            (scale, *rest), values = _fit(stored, *terms)
            near = -sum(rest) / scale if scale else -1.0
            if 0.0 <= near < np.nanmin(planar):
                scaled = f" x {scale:.4g}" * bool(abs(scale - 1) > DEPTH_TOLERANCE)
                found[f"{other}{scaled}" + f", depth_offset = {near:.3g}" * bool(rest)] = share(values), other
    best = max(found, key=lambda text: found[text][0] - SAME * text.count(",") - SAME * text.count(" x "))
    explained, other = found[best]
    if as_read >= ENOUGH and (best == "as read" or explained <= as_read + SAME):
        return Verdict("depth", "ok", kind, as_read, as_read)
    (a, b), values = _fit(stored, np.ones_like(planar), 1.0 / planar)
    if explained >= MOST:
        keys = [f"depth = '{other}'"] * (other != kind) + [best.partition(", ")[2]] * ("," in best)
        keys = f": set {' and '.join(keys)}" if keys else ""
        text = f"depth is {best}{keys}" + ", in the unit of positions" * (" x " in best)
    elif (explained := share(values)) >= MOST:
        best = f"buffer, {'reversed' if b > 0 else 'not reversed'}"
        text = f"depth is that of a depth {best}, {a:.4g} {b:+.4g} / z: write planar depth z"
    else:
        text, explained, best = "depth is neither planar nor a distance nor of a depth buffer", as_read, ""
    return Verdict("depth", "wrong", text, as_read, explained, value=best)


def _fit(stored: Array, *terms: Array) -> tuple[Array, Array]:
    """Factors of ``terms`` (N,) whose sum is nearest to ``stored`` (N,) relative to it, but for outliers; the sum."""
    use = np.isfinite(stored) & (stored != 0)
    matrix = np.column_stack(terms)
    for _ in range(3):
        scaled = matrix[use] / np.abs(stored[use])[:, None]
        factors = np.linalg.lstsq(scaled, np.sign(stored[use]), rcond=1e-9)[0]
        error = np.abs(matrix @ factors - stored) / np.maximum(np.abs(stored), 1e-30)
        use = np.isfinite(error) & (error <= max(1e-6, 3.0 * float(np.median(error[np.isfinite(error)]))))
    return factors, matrix @ factors


def _jitter(good: Sequence[PairVectors]) -> Verdict:
    each = [f"frame {p.frame}: {p.jitter_px[0]:+.3f}, {p.jitter_px[1]:+.3f} px" for p in good if any(p.jitter_px)]
    if not each:
        return Verdict("jitter", "ok", "none is left")
    text = f"jitter is left in the motion: subtract the difference of the offsets of both frames ({', '.join(each)})"
    as_read, explained = (float(np.mean([getattr(p, name) for p in good])) for name in ("as_read", "explained"))
    return Verdict("jitter", "wrong", text, as_read, explained, value="left in")


def _cuts(pairs: Sequence[PairVectors], good: Sequence[PairVectors]) -> Verdict:
    """Pairs whose motion no reading explains, beside others that are explained."""
    bad = [pair for pair in pairs if pair.frame not in {p.frame for p in good}]
    if len(pairs) == 1 or not bad:
        return Verdict("cuts", "ok", "none") if len(pairs) > 1 else Verdict("cuts", "not checked", "there is one pair")
    share, frames = float(np.mean([pair.explained for pair in bad])), ", ".join(str(pair.frame) for pair in bad)
    lengths = [float(np.median([pair.expected_px for pair in group])) for group in (bad, good)]
    text = f"nothing explains the motion into frame {frames}; surfaces move by {lengths[0]:.3g} px, elsewhere by "
    return Verdict("cuts", "wrong", f"{text}{lengths[1]:.3g} px: a cut? leave it out", share, share, value=frames)
