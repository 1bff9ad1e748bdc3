"""Which conventions of an EXR sequence are not those of its mapping, and what to set.

The search has three steps.  *Camera*: which readings of rows, axes, origin, unit, camera matrices and frame order put
the points of the position pass on their pixels.  *Motion*: with each reading that is left, which reading of the motion
pass agrees with the motion of the points: of all surfaces if there is a pass of previous positions, and of surfaces
that stand still.  Of the readings that explain as many pixels as the best one, the simplest wins; equally simple ones
are equivalent: the files cannot tell them apart.  *Depth*: how it follows from the points.  Without geometry the images
decide on motion.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import View
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced import cameras as cams
from taubench_gl.pathtraced.cameras import PathTracedCamera, points_at, project
from taubench_gl.pathtraced.image_motion import compare_images
from taubench_gl.pathtraced.passes import PathTracedFrame, to_y_up
from taubench_gl.pathtraced.readings import (
    BACKWARDS,
    GEOMETRY,
    MOTION,
    Reading,
    corrected_motion,
    geometry_readings,
    geometry_values,
    motion_readings,
    text_of,
    value_in,
)
from taubench_gl.pathtraced.sequence import PathTracedSequence

Array = np.ndarray
log = logging.getLogger(__name__)

TOLERANCE_PX = 0.1  # a vector or position within this distance of the expected one is explained
ENOUGH = 0.5  # share of pixels that a reading must explain
SAME = 0.02  # readings whose shares of explained pixels differ by less cannot be distinguished
MAX_JITTER_PX = 1.5  # largest jitter: the difference of two offsets, each in [-0.5, 0.5], and a margin
MIN_JITTER_PX = 0.02  # smaller offsets are rounding of 16-bit passes; largest spread of jitter
MIN_MOTION_PX = 0.2  # median length below which the motion of a pair shows no convention
MAX_SHIFT_PX = 0.25  # largest accepted offset of positions from the pixel centers, per axis
FEW_PIXELS = 50  # fewest pixels that show a convention
DEPTH_TOLERANCE = 0.01  # relative error up to which depth is explained
_OTHERS = ("jitter", "cuts", "sky")
_BASES = ("previous positions", "still surfaces")
_SEARCHED = 300  # pixels of each frame in the search; shares are then counted over all


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
class PairVerdict:
    """Motion of file ``frame``: shares explained as the mapping reads it and corrected; ``jitter_px`` left in it.

    Pixels, +x right, +y down.  ``expected_px``: median length of the motion of surfaces; ``errors``: (h, w), as read
    and corrected, NaN where nothing is expected.
    """

    frame: int
    as_read: float
    explained: float
    jitter_px: tuple[float, float]
    expected_px: float
    errors: tuple[Array, Array]


@dataclass(frozen=True, slots=True)
class Check:
    """Verdicts, in the order of the tables; ``reading`` corrects the files; ``basis``: what motion is compared with."""

    verdicts: tuple[Verdict, ...]
    reading: Reading
    basis: str = ""
    pairs: tuple[PairVerdict, ...] = ()

    @property
    def wrong(self) -> tuple[Verdict, ...]:
        return tuple(v for v in self.verdicts if v.status == "wrong")

    def __getitem__(self, convention: str) -> Verdict:
        return next(v for v in self.verdicts if v.convention == convention)


def check_sequence(
    sequence: PathTracedSequence, camera: PathTracedCamera, frames: Sequence[int] | None = None, pairs: int = 4
) -> Check:
    """Check at most ``pairs`` pairs of consecutive files among ``frames``, None: all.

    A ``FittedCamera`` shows neither axes nor units.  Raises PathTracedError for files that cannot be read.
    """
    chosen = sequence.frames if frames is None else frames
    starts = [n for n in chosen if n + 1 in chosen][:pairs]
    numbers = sorted({n + step for n in starts for step in (0, 1)}) or chosen[:1]
    log.info("checking the conventions of %d frames", len(numbers))
    geometry = "motion" not in sequence.index  # with motion, images may do
    files = _Files(sequence, camera, {n: sequence.read(n, geometry=geometry) for n in numbers})
    if isinstance(camera, cams.SceneCamera):
        camera.place(numbers[0], files.some)
    names = sorted(name for name in sequence.mapping.passes if name in sequence.index)
    missing = "; ".join(f"{column}: {why}" for column, why in sequence.missing().items())
    text = f"{len(names)} found with the mapping {sequence.mapping.name}: {', '.join(names)}"
    passes = Verdict("passes", "note" if missing else "ok", f"{text}; missing: {missing}" if missing else text)
    if files.some.position is None and files.some.depth is None:
        why = "there is neither a position nor a depth pass"
    elif not files.fitted or any(files.view(numbers[0], Reading(rows=rows)) for rows in ("", "bottom first")):
        return _by_geometry(files, starts, passes)
    else:
        why = "no camera is given, and none can be estimated from positions"
    return _by_images(files, starts, [passes, *_skipped(("camera", *GEOMETRY, "centers"), why)])


def _skipped(names: Iterable[str], why: str) -> list[Verdict]:
    return [Verdict(name, "not checked", why) for name in names]


# ------------------------------------------------------------------------------------------------------------- files
@dataclass(frozen=True, slots=True)
class _Samples:
    """Pixels of one file.  Arrays (N, ...) float64, as the mapping reads them."""

    at: Array  # flat indices into the image
    pixels: Array  # column, row
    position: Array | None
    depth: Array | None
    prev_position: Array | None
    motion: Array | None

    @classmethod
    def of(cls, frame: PathTracedFrame, mask: Array, most: int | None = None) -> _Samples:
        at = np.random.default_rng(0).permutation(np.flatnonzero(mask))[:most]
        named = (frame.position, frame.depth, frame.prev_position, frame.motion)
        taken = (None if a is None else a.reshape(mask.size, *a.shape[2:])[at].astype(np.float64) for a in named)
        return cls(at, np.stack([at % frame.size[0], at // frame.size[0]], axis=-1).astype(np.float64), *taken)


@dataclass(slots=True)
class _Files:
    """The files that are checked, each read once, and what any reading makes of them."""

    sequence: PathTracedSequence
    camera: PathTracedCamera
    frames: dict[int, PathTracedFrame]
    few: dict[int, _Samples] = field(default_factory=dict)
    every: dict[int, _Samples] = field(default_factory=dict)
    views: dict[tuple[int, int, Reading], View | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for number, frame in self.frames.items():
            use = ~frame.sky
            for values in (frame.position, frame.motion):
                use = use if values is None else use & np.isfinite(values).all(axis=-1)
            if frame.position is None and frame.depth is not None:
                use &= np.isfinite(frame.depth) & (frame.depth > 0)
            self.every[number] = _Samples.of(frame, use)
            if frame.prev_position is not None and frame.motion is not None:
                moving = use & frame.motion.any(axis=-1)  # objects that move before a still camera
                use = moving if moving.sum() >= FEW_PIXELS else use
            self.few[number] = _Samples.of(frame, use, _SEARCHED)

    @property
    def some(self) -> PathTracedFrame:
        """The first file's frame: all files have the same passes."""
        return next(iter(self.frames.values()))

    @property
    def fitted(self) -> bool:
        return isinstance(self.camera, cams.FittedCamera)

    def view(self, number: int, reading: Reading) -> View | None:
        """The camera of file ``number`` by ``reading``; None where the camera file has none for it."""
        shown = number + {"ahead": -1, "behind": 1}.get(reading.order, 0)
        if "backwards" in reading.order:
            shown = self.sequence.frames[0] + self.sequence.frames[-1] - number
        key = (number, shown, Reading(rows=reading.rows * self.fitted, matrix=reading.matrix, lens=reading.lens))
        if key not in self.views:
            try:
                self.views[key] = self._view(*key)
            except PathTracedError:
                self.views[key] = None
        return self.views[key]

    def _view(self, number: int, shown: int, reading: Reading) -> View | None:
        if reading.rows and self.view(number, Reading()) is not None:  # one of both row orders is right
            return None
        view = self.camera.view(shown, flipped(self.frames[number]) if reading.rows else self.frames[number])
        if reading.matrix:
            matrix = self.camera.file.matrices[shown]
            if reading.matrix == "rotation transposed":
                matrix = math3d.affine(matrix[:3, :3].T, matrix[:3, 3])
            elif reading.matrix == "y down, z forward":
                matrix = matrix @ np.diag([1.0, -1.0, -1.0, 1.0])
            else:
                matrix = matrix.T if "transposed" in reading.matrix else matrix
                matrix = np.linalg.inv(matrix) if "inverse" in reading.matrix else matrix
            view = replace(view, position=matrix[:3, 3].copy(), world_from_view=math3d.orthonormal(matrix[:3, :3]))
        if reading.lens and view.camera.kind == "perspective":
            width, height = self.sequence.size
            yfov = 2.0 * math.atan(math.tan(0.5 * view.camera.yfov) * height / width)
            view = replace(view, camera=replace(view.camera, yfov=yfov))
        return view

    def pixels(self, samples: _Samples, reading: Reading) -> Array:
        """Column and row, row 0 at the top, (N, 2)."""
        # A file whose first row is the bottom one: row r of the array is row height - 1 - r of the image.
        return samples.pixels * [1, -1] + [0, self.sequence.size[1] - 1] if reading.rows else samples.pixels

    def points(self, samples: _Samples, reading: Reading, view: View, position: Array | None) -> Array:
        """Surface points, relative to the camera of ``view``, world axes, (N, 3) meters; no ``position``: of depth."""
        mapping = self.sequence.mapping
        if position is None:
            depth, kind = samples.depth * reading.factor, reading.depth or mapping.depth
            return points_at(view, self.pixels(samples, reading), depth, kind, self.sequence.size)
        points = position * reading.factor
        if reading.up:
            points = points @ to_y_up(np.eye(3), mapping.up).T @ to_y_up(np.eye(3), reading.up)
        space = reading.positions or mapping.positions
        if space == "view":
            return points @ view.world_from_view.T
        return points - view.position if space == "world" else points

    def misplaced(self, number: int, reading: Reading, *, few: bool = False) -> Array | None:
        """Projections of the position pass minus their pixels, (N, 2); None without a view."""
        view, samples = self.view(number, reading), (self.few if few else self.every)[number]
        if view is None:
            return None
        points = self.points(samples, reading, view, samples.position)
        return project(view, points, self.sequence.size, relative=True) - self.pixels(samples, reading)

    def pair(self, first: int, reading: Reading) -> tuple[int, int]:
        """Current and previous file of files ``first`` and ``first + 1``."""
        return (first, first + 1) if reading.order in BACKWARDS else (first + 1, first)

    def moved(self, first: int, reading: Reading, basis: str, *, few: bool = False) -> Array | None:
        """Motion of the surface points of a pair, (N, 2) pixels; None without views."""
        current, previous = self.pair(first, reading)
        view, before = self.view(current, reading), self.view(previous, reading)
        if view is None or before is None:
            return None
        samples, size = (self.few if few else self.every)[current], self.sequence.size
        points = self.points(samples, reading, view, samples.position)
        if basis == _BASES[0]:
            there = self.points(samples, reading, before, samples.prev_position)
        else:
            there = points + (view.position - before.position)
        # Both ends are projected: the samples of a jittered frame are not at the pixel centers.
        return project(before, there, size, relative=True) - project(view, points, size, relative=True)

    def motion(self, samples: _Samples, readings: Sequence[Reading]) -> Array:
        """The motion pass by each reading, (K, N, 2) pixels."""
        return corrected_motion(samples.motion, readings, self.sequence.mapping, self.sequence.size)


def flipped(frame: PathTracedFrame) -> PathTracedFrame:
    """The frame's geometry with its rows in reverse order."""
    names = [name for name in ("position", "depth", "sky") if getattr(frame, name) is not None]
    return replace(frame, **{name: getattr(frame, name)[::-1] for name in names})


def _explained(difference: Array, tolerance: float, shifted: bool = False) -> Array:
    """Share of the vectors (..., N, 2) that are at most ``tolerance`` long, (...); ``shifted``: less their offset."""
    if not difference.shape[-2]:
        return np.ones(difference.shape[:-2])
    difference = difference - _offset(difference) if shifted else difference
    return (np.einsum("...i,...i", difference, difference) <= tolerance**2).mean(axis=-1)


def _offset(difference: Array) -> Array:
    """Median of vectors (..., N, 2) where it can be a jitter, else 0: (..., 1, 2)."""
    offset = np.median(np.nan_to_num(difference, nan=1e9), axis=-2, keepdims=True)
    return np.where(np.abs(offset).max(axis=-1, keepdims=True) <= MAX_JITTER_PX, offset, 0.0)


# ------------------------------------------------------------------------------------------------------------ search
def _by_geometry(files: _Files, starts: list[int], passes: Verdict) -> Check:
    kinds = {cams.SidecarCamera: "sidecar", cams.SceneCamera: "scene", cams.FittedCamera: "fitted"}
    positions, tolerance = files.some.position is not None, TOLERANCE_PX
    values = geometry_values(files.sequence.mapping, positions, kinds[type(files.camera)])
    left = geometry_readings(values)
    if positions:
        shares, tolerance = _placed(files, left)
        left = [r for r, share in zip(left, shares, strict=True) if share >= max(ENOUGH, shares.max() - SAME)]
        if not left:
            text, share = f"{files.camera.describe()}: it did not render these files", float(shares.max())
            others = _skipped((*GEOMETRY, "centers", *MOTION, *_OTHERS), "no reading of the camera explains the files")
            return Check((passes, Verdict("camera", "wrong", text, share, share), *others), Reading())
    motion = motion_readings(files.sequence.mapping) if files.some.motion is not None and starts else []
    checked = _Checked(files, positions, tolerance, *_search(files, starts if motion else [], left, motion))
    verdicts = [passes, *(checked.verdict(name, name in values) for name in GEOMETRY[:-1]), checked.depth()]
    verdicts[1:1], verdicts[-1:-1] = [checked.camera()], [checked.centers()]
    if not motion:
        why = "there is no motion pass" if starts else "no two frames are consecutive"
        return Check((*verdicts, *_skipped((*MOTION, *_OTHERS), why)), checked.best)
    pairs = [pair for first in starts if (pair := checked.pair(first)) is not None]
    return Check((*verdicts, *checked.motion(pairs)), checked.best, checked.basis, tuple(pairs))


def _placed(files: _Files, readings: Sequence[Reading]) -> tuple[Array, float]:
    """Mean share over the files of pixels that each reading puts in place, (R,); and the tolerance, pixels."""
    shares = np.full((len(files.frames), len(readings)), np.nan)
    for tolerance in (TOLERANCE_PX, cams.MAX_MISMATCH_PX):  # passes that are averaged over a pixel need the second
        for row, number in enumerate(files.frames):
            off = [files.misplaced(number, reading, few=True) for reading in readings]
            for shifted in (False, True):  # samples may be jittered
                shares[row] = [np.nan if d is None else _explained(d, tolerance, shifted) for d in off]
                if np.nanmax(shares[row], initial=0.0) >= ENOUGH:
                    break
        covered = np.isfinite(shares)
        mean = np.where(covered, shares, 0.0).sum(axis=0) / np.maximum(covered.sum(axis=0), 1)
        if mean.max() >= ENOUGH:
            break
    return mean, tolerance


_Explained = dict[str, dict[int, bool]]
"""What motion can be compared with -> first files of pairs that are explained -> whether only with an offset."""


def _search(
    files: _Files, starts: list[int], left: Sequence[Reading], motion: Sequence[Reading]
) -> tuple[Reading, list[Reading], _Explained]:
    """The simplest combination of geometry and motion that explains the files; others that explain as many pixels."""
    bases: _Explained = {}
    total = []
    for basis in _BASES[files.some.prev_position is None :]:
        found = {}
        for first in starts:
            stored = {n: files.motion(files.few[n], motion) for n in (first, first + 1)}
            moved = [files.moved(first, reading, basis, few=True) for reading in left]
            # An offset may explain what no reading does.  Jitter is the same everywhere, animation is not.
            for shifted, tolerance in ((False, TOLERANCE_PX), (True, MIN_JITTER_PX)):
                share = np.zeros((len(left), len(motion)))
                for row, expected in enumerate(moved):
                    if expected is not None and len(expected) >= FEW_PIXELS:
                        off = stored[files.pair(first, left[row])[0]] - expected
                        share[row] = _explained(off, tolerance, shifted)
                        if shifted and _explained(expected, tolerance, shifted) >= ENOUGH:
                            share[row, 1:] = 0.0  # where no motion and an offset explain as much, no reading is shown
                if share.max() >= ENOUGH:
                    found[first] = share, shifted
                    break
        if found:
            total.append(np.mean([share for share, _ in found.values()], axis=0))
            bases[basis] = {first: shifted for first, (_, shifted) in found.items()}
    if not total:
        return left[0], [r for r in left[1:] if not starts], bases
    # Previous positions hold for what moves; still surfaces also show the unit and the place of the camera.
    total = np.mean(total, axis=0)
    alike = [(replace(left[g], **motion[m].values), total[g, m]) for g, m in np.argwhere(total >= total.max() - SAME)]
    best, *others = (reading for reading, _ in sorted(alike, key=lambda each: (len(each[0].values), -each[1])))
    return best, others, bases


# ---------------------------------------------------------------------------------------------------------- verdicts
@dataclass(slots=True)
class _Checked:
    """What the search found, as verdicts."""

    files: _Files
    positions: bool  # there is such a pass
    tolerance: float  # of positions, pixels
    best: Reading
    alike: list[Reading]
    bases: _Explained

    @property
    def basis(self) -> str:
        """What the reported shares of motion are compared with: previous positions or still surfaces."""
        return next(iter(self.bases), _BASES[1])

    def camera(self) -> Verdict:
        text = self.files.camera.describe()
        if not self.positions:
            return Verdict("camera", "not checked", f"{text}: there is no position pass")
        share = self._placed(self.best)
        return Verdict("camera", "ok", f"{text}: positions within {self.tolerance:g} px", share, share)

    def verdict(self, name: str, tried: bool = True) -> Verdict:
        """The verdict on a convention of ``Reading``."""
        best, mapping = self.best, self.files.sequence.mapping
        if not tried:
            why = "there is no camera to compare with" if self.files.fitted else "these files do not have it"
            return Verdict(name, "not checked", why)
        value, read, size = getattr(best, name), best.without(name), len(best.values)
        measures = [(self._placed(read), self._placed(best))] if name not in MOTION and self.positions else []
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
        if not self.positions:
            return Verdict("centers", "not checked", "there is no position pass")
        off = [self.files.misplaced(number, self.best) for number in self.files.frames]
        offsets = np.array([_offset(d)[0] for d in off if d is not None and len(d)] or [[0.0, 0.0]])
        x, y = offsets[np.abs(offsets).max(axis=1).argmax()]
        if max(abs(x), abs(y)) <= MAX_SHIFT_PX:
            return Verdict("centers", "ok", "positions are those of pixel centers")
        text = f"positions are {x:+.2f}, {y:+.2f} px off the pixel centers"
        if np.ptp(offsets, axis=0).max() > MIN_JITTER_PX:
            return Verdict("centers", "note", f"{text}, in each frame by another offset: samples are jittered")
        return Verdict("centers", "wrong", text, value=f"{x:.3f}, {y:.3f}")

    def depth(self) -> Verdict:
        """How depth follows from positions, or, without them, which kind motion shows."""
        number, files = next(iter(self.files.frames)), self.files
        samples, view = files.every[number], files.view(number, self.best)
        if not self.positions:
            return self.verdict("depth")
        if samples.depth is None or view is None or not len(samples.at):
            return Verdict("depth", "not checked", "there is no depth pass, or no surface")
        points, stored = files.points(samples, self.best, view, samples.position), samples.depth * self.best.factor
        planar, kind = points @ -view.world_from_view[:, 2], files.some.depth_kind
        kinds = {"planar": planar, "distance": np.linalg.norm(points, axis=-1)}

        def share(expected: Array) -> float:
            return float((np.abs(stored - expected) <= DEPTH_TOLERANCE * np.abs(expected)).mean())

        as_read = share(kinds[kind])
        if as_read >= max(ENOUGH, max(map(share, kinds.values())) - SAME):
            return Verdict("depth", "ok", kind, as_read, as_read)
        for other, expected in kinds.items():
            scale = float(np.median(stored / expected))
            if share(scale * expected) >= ENOUGH:
                scaled = f" x {scale:.4g}" * (abs(scale - 1) > DEPTH_TOLERANCE)
                text = f"depth is {other}{scaled}: set depth = '{other}'" + ", in the unit of positions" * bool(scaled)
                return Verdict("depth", "wrong", text, as_read, share(scale * expected), value=other + scaled)
        (a, b), *_ = np.linalg.lstsq(np.column_stack([np.ones_like(planar), 1.0 / planar]), stored, rcond=None)
        if share(a + b / planar) >= ENOUGH:
            value = f"buffer, {'reversed' if b > 0 else 'not reversed'}"
            text = f"depth is that of a depth {value}, {a:.4g} {b:+.4g} / z: write planar depth z"
            return Verdict("depth", "wrong", text, as_read, share(a + b / planar), value=value)
        return Verdict(
            "depth", "wrong", "depth is neither planar nor a distance nor of a depth buffer", as_read, as_read
        )

    def pair(self, first: int) -> PairVerdict | None:
        """The motion of a pair by the best reading; None where nothing can be compared."""
        current, size = self.files.pair(first, self.best)[0], self.files.sequence.size
        expected, samples = self.files.moved(first, self.best, self.basis), self.files.every[current]
        if expected is None or not len(expected):
            return None
        off = self.files.motion(samples, [self.best.without(*MOTION), self.best]) - expected
        jitter = _offset(off[1])[0] * (_explained(off[1], MIN_JITTER_PX, shifted=True) >= ENOUGH)
        jitter = jitter * (np.abs(jitter).max() > MIN_JITTER_PX)
        errors = np.full((2, size[0] * size[1]), np.nan)
        errors[:, samples.at] = np.linalg.norm(off - np.stack([0 * jitter, jitter])[:, None], axis=-1)
        shares = ((errors[:, samples.at] <= TOLERANCE_PX).mean(axis=1)).tolist()
        length = float(np.nanmedian(np.linalg.norm(expected, axis=-1)))
        return PairVerdict(
            current, *shares, tuple((jitter + 0.0).tolist()), length, tuple(errors.reshape(2, *size[::-1]))
        )

    def motion(self, pairs: list[PairVerdict]) -> list[Verdict]:
        """Verdicts on MOTION, jitter, cuts and the sky."""
        good = [pair for pair in pairs if pair.explained >= ENOUGH]
        if not self.bases or not good:
            share = max([pair.as_read for pair in pairs], default=None)
            why = "no reading explains the motion: surfaces are animated, or the pass is no motion"
            return [replace(verdict, as_read=share) for verdict in _skipped((*MOTION, *_OTHERS), why)]
        if max(pair.expected_px for pair in good) < MIN_MOTION_PX:
            verdicts = _skipped(MOTION, "the camera hardly moves between these frames")
        else:
            verdicts = [self.verdict(name) for name in MOTION]
        return [*verdicts, _jitter(good), _cuts(pairs, good), self._sky(good)]

    def _sky(self, good: list[PairVerdict]) -> Verdict:
        files, size = self.files, self.files.sequence.size
        far, zero, moved = [], [], []
        for pair in good:
            frame, step = files.frames[pair.frame], 1 if self.best.order in BACKWARDS else -1
            samples = _Samples.of(frame, frame.sky & np.isfinite(frame.motion).all(axis=-1))
            view, before = files.view(pair.frame, self.best), files.view(pair.frame + step, self.best)
            if len(samples.at) >= FEW_PIXELS and not view.camera.parallel:
                pixels = files.pixels(samples, self.best)
                # Without the position of the camera: infinitely far away.
                directions = points_at(view, pixels, np.ones(len(pixels)), "distance", size)
                expected = project(before, directions, size, relative=True) - pixels
                off = files.motion(samples, [self.best])[0] - pair.jitter_px - expected
                far.append(_explained(off, TOLERANCE_PX))
                zero.append(_explained(samples.motion, 1e-6))
                moved.append(np.nanmedian(np.linalg.norm(expected, axis=-1)))
        if not far or max(moved) < MIN_MOTION_PX:
            return Verdict("sky", "not checked", "the camera hardly turns" if far else "there is hardly any sky")
        share, still = float(np.mean(far)), float(np.mean(zero))
        if share >= ENOUGH:
            return Verdict("sky", "ok", "as if infinitely far", share, share)
        if still >= ENOUGH:
            text = "motion of the sky is zero although the camera turns: reproject sky by the camera"
            return Verdict("sky", "note", text, share, still, value="zero")
        return Verdict("sky", "note", "motion of the sky is neither zero nor that of the camera", share, share)

    def _placed(self, reading: Reading) -> float:
        """Share of positions in place, mean over the files."""
        off = [self.files.misplaced(number, reading) for number in self.files.frames]
        return float(np.mean([_explained(d, self.tolerance, shifted=True) for d in off if d is not None] or [0.0]))

    def _moved(self, reading: Reading, basis: str) -> float:
        """Share of explained motion, mean over the explained pairs."""
        shares = [0.0]
        for first, shifted in self.bases[basis].items():
            expected = self.files.moved(first, reading, basis)
            if expected is not None:
                stored = self.files.motion(self.files.every[self.files.pair(first, reading)[0]], [reading])
                shares.append(float(_explained(stored[0] - expected, TOLERANCE_PX, shifted)))
        return sum(shares) / len(self.bases[basis])


def _jitter(good: list[PairVerdict]) -> Verdict:
    each = [f"frame {p.frame}: {p.jitter_px[0]:+.3f}, {p.jitter_px[1]:+.3f} px" for p in good if any(p.jitter_px)]
    if not each:
        return Verdict("jitter", "ok", "none is left")
    text = f"jitter is left in the motion: subtract the difference of the offsets of both frames ({', '.join(each)})"
    as_read, explained = (float(np.mean([getattr(p, name) for p in good])) for name in ("as_read", "explained"))
    return Verdict("jitter", "wrong", text, as_read, explained, value="left in")


def _cuts(pairs: list[PairVerdict], good: list[PairVerdict]) -> Verdict:
    """Pairs whose motion no reading explains, beside others that are explained."""
    bad = [pair for pair in pairs if pair not in good]
    if len(pairs) == 1 or not bad:
        return Verdict("cuts", "ok", "none") if len(pairs) > 1 else Verdict("cuts", "not checked", "there is one pair")
    share, frames = float(np.mean([pair.explained for pair in bad])), ", ".join(str(pair.frame) for pair in bad)
    lengths = [float(np.median([pair.expected_px for pair in some])) for some in (bad, good)]
    text = f"nothing explains the motion into frame {frames}; surfaces move by {lengths[0]:.3g} px, elsewhere by "
    return Verdict("cuts", "wrong", f"{text}{lengths[1]:.3g} px: a cut? leave it out", share, share, value=frames)


def _by_images(files: _Files, starts: list[int], verdicts: list[Verdict]) -> Check:
    """Verdicts on the motion pass from images alone."""
    mapping, why, found = files.sequence.mapping, "no two frames are consecutive", []
    for first in starts:
        compared = compare_images(files.frames[first + 1], files.frames[first], mapping)
        if isinstance(compared, str):
            why = compared
        else:
            found.append(compared)
    if len({best for best, _ in found}) != 1:
        why = "pairs support different readings" if found else why
        return Check((*verdicts, *_skipped((*MOTION, *_OTHERS), why)), Reading(), "images")
    best, errors = found[0][0], np.mean([errors for _, errors in found], axis=0)
    detail = " (difference of images {:.3g}, corrected {:.3g}, next reading {:.3g})".format(*errors)
    for name in MOTION[:-1]:
        text = text_of(name, best.values[name], mapping) if name in best.values else value_in(mapping, name)
        status = "wrong" if name in best.values else "ok"
        verdicts.append(Verdict(name, status, text + detail, value=best.values.get(name, "")))
    return Check((*verdicts, *_skipped((MOTION[-1], *_OTHERS), "this needs geometry")), best, "images")
