"""Which convention a motion pass follows: flipped axes, sign, unit, exchanged components, and jitter left in it.

Every hypothesis is a correction of the pass.  The corrected motion is compared with the motion that the geometry of the
frames implies, pixel by pixel: previous positions if there are any, else surfaces that stand still, which most surfaces
do.  Without geometry the previous image is warped by each hypothesis and compared with the current one.  The best
hypothesis is reported with its error and with that of the next one that differs: where both are alike, the files cannot
tell.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import View
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.cameras import FittedCamera, PathTracedCamera, SceneCamera, project, relative_position
from taubench_gl.pathtraced.passes import PathTracedFrame
from taubench_gl.pathtraced.sequence import PathTracedSequence

Array = np.ndarray

MAX_MOTION_PX = 0.1
"""Motion is understood if its median error is at most this."""

MAX_JITTER_PX = 1.5
"""Largest offset that is called jitter: the difference of two sub-pixel offsets, each in [-0.5, 0.5], and a margin."""

MIN_JITTER_PX = 0.02
"""Smaller offsets are rounding of 16-bit passes."""

MIN_MOTION_PX = 0.2
"""Median length below which the motion of a pair shows no convention."""

SIMPLER = 0.8
"""A hypothesis with more corrections must have less than this share of the error of a simpler one."""

FEW_PIXELS = 50
"""Fewest moving pixels that show a convention."""

BLOCK = 6
"""Side, pixels, of the blocks whose mean errors are compared."""

_SIGNS = {(1, 1): "", (-1, -1): "current - previous", (1, -1): "y is flipped", (-1, 1): "x is flipped"}


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """One reading of a motion pass.  ``signs`` of x and y; ``unit``; ``exchanged``: x is in the second component."""

    signs: tuple[int, int] = (1, 1)
    unit: str = ""
    exchanged: bool = False

    @property
    def corrections(self) -> int:
        return (self.signs != (1, 1)) + bool(self.unit) + self.exchanged

    @property
    def text(self) -> str:
        """What is wrong, and the keys of the mapping that correct it; empty if nothing is."""
        keys = {(-1, -1): "motion.direction", (1, -1): "motion.y", (-1, 1): "motion.direction and motion.y"}
        parts = []
        if self.signs != (1, 1):
            parts.append(f"{_SIGNS[self.signs]} (set {keys[self.signs]} in the mapping)")
        if self.unit:
            parts.append(_UNITS[self.unit])
        if self.exchanged:
            parts.append("x and y are exchanged (name the channels in the mapping)")
        return "; ".join(parts)

    def corrected(self, motion: Array, size: tuple[int, int]) -> Array:
        """(..., 2) motion of the pass, as the mapping reads it, in pixels by this hypothesis."""
        motion = motion[..., ::-1] if self.exchanged else motion
        return motion * (np.array(self.signs) * _factor(self.unit, size))


_UNITS = {
    "uv": "it is in fractions of the image size (set motion.unit = 'uv' in the mapping)",
    "ndc": "it is in clip space, -1 to 1 (twice the fractions of the image size)",
    "px": "it is in pixels (set motion.unit = 'px' in the mapping)",
    "half": "it is half as long as it should be",
    "double": "it is twice as long as it should be",
}
"""Units other than the mapping's, and what to do."""


def _factor(unit: str, size: tuple[int, int]) -> Array:
    pixels = np.array(size, dtype=np.float64)
    return {
        "": np.ones(2), "uv": pixels, "ndc": 0.5 * pixels, "px": 1.0 / pixels, "half": np.full(2, 2.0),
        "double": np.full(2, 0.5),
    }[unit]  # fmt: skip


HYPOTHESES = tuple(
    sorted(
        (Hypothesis(signs, unit, exchanged) for signs, unit, exchanged in
         itertools.product(_SIGNS, ("", *_UNITS), (False, True))),
        key=lambda h: h.corrections,
    )
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class MotionVerdict:
    """The motion pass of one frame.

    ``best``: the reading that explains it; ``error_px``: its median error, pixels, after ``jitter_px`` is subtracted
    ((2,), +x right, +y down, zero where there is none); ``jitter_margin_px``: 1.96 standard errors of it; ``as_is_px``:
    median error as the mapping reads the pass; ``next_px``: smallest error of a reading that differs in this motion;
    ``pixels``; ``basis``: previous positions, still surfaces or images (errors are then of radiance, not pixels).
    ``known``: a reading explains the pass.
    """

    best: Hypothesis
    error_px: float
    jitter_px: tuple[float, float]
    jitter_margin_px: float
    as_is_px: float
    next_px: float
    pixels: int
    basis: str
    known: bool

    @property
    def jittered(self) -> bool:
        return self.known and max(map(abs, self.jitter_px)) > max(MIN_JITTER_PX, self.jitter_margin_px)

    @property
    def fault(self) -> str:
        """What is wrong with the pass; empty if nothing is, or nothing explains it."""
        parts = [self.best.text] if self.known and self.best.text else []
        if self.jittered:
            x, y = self.jitter_px
            parts.append(f"jitter is left in the motion: {x:+.3f}, {y:+.3f} px +- {self.jitter_margin_px:.3f}")
        return "; ".join(parts)

    @property
    def detail(self) -> str:
        """The numbers behind the verdict."""
        unit = "" if self.basis == "images" else " px"
        text = f"median error {self.as_is_px:.3g}{unit} as the mapping reads it"
        if self.known and (self.best.text or self.jittered):
            text += f", {self.error_px:.3g}{unit} corrected"
        if np.isfinite(self.next_px):
            text += f", {self.next_px:.3g}{unit} by the next reading"
        return f"{text}; by {self.basis}, {self.pixels} pixels"


def check_pairs(sequence: PathTracedSequence, camera: PathTracedCamera, most: int) -> dict[int, MotionVerdict | str]:
    """The motion pass of at most ``most`` pairs of consecutive frames, by the later frame; see ``check_motion``.

    Raises PathTracedError, also where no two frames are consecutive.
    """
    later = [frame for frame in sequence.frames if frame - 1 in sequence.files][:most]
    if not later:
        raise PathTracedError("no two frames are consecutive", where=str(sequence.path))
    out: dict[int, MotionVerdict | str] = {}
    for frame in later:
        previous, current = (sequence.read(number) for number in (frame - 1, frame))
        try:
            if isinstance(camera, SceneCamera):
                camera.find_offset(frame, current)
            views = [camera.view(n, f) for n, f in ((frame, current), (frame - 1, previous))]
        except PathTracedError:
            if not isinstance(camera, FittedCamera):
                raise
            views = [None, None]  # no camera can be estimated: the images are compared
        out[frame] = check_motion(current, previous, *views)
    return out


def check_motion(
    frame: PathTracedFrame, previous: PathTracedFrame, view: View | None, previous_view: View | None
) -> MotionVerdict | str:
    """The verdict on the motion pass of ``frame``, or as text why there is none.

    ``view``, ``previous_view``: without jitter; None: only the images are compared.
    """
    if frame.motion is None:
        return "there is no motion pass"
    if view is not None and previous_view is not None and (frame.position is not None or frame.depth is not None):
        return _by_geometry(frame, view, previous_view)
    if frame.combined is not None and previous.combined is not None:
        return _by_images(frame, previous)
    return "there is neither a camera with positions or depth, nor a combined pass"


def _by_geometry(frame: PathTracedFrame, view: View, previous: View) -> MotionVerdict | str:
    relative, depth = relative_position(frame, view)
    with np.errstate(invalid="ignore"):
        use = ~frame.sky & (depth > 0) & np.isfinite(relative).all(axis=-1) & np.isfinite(frame.motion).all(axis=-1)
    points = relative[use] + view.position
    before, basis = points, "still surfaces"
    if frame.prev_position is not None:
        before = frame.prev_position[use].astype(np.float64) + (previous.position if frame.relative else 0.0)
        basis = "previous positions"
    # Both ends are projected: the samples of a jittered frame are not at the pixel centers.
    expected = project(previous, before, frame.size) - project(view, points, frame.size)
    stored = frame.motion[use].astype(np.float64)
    visible = np.isfinite(expected).all(axis=-1)
    expected, stored = expected[visible], stored[visible]
    moving = np.linalg.norm(expected, axis=-1) >= MIN_MOTION_PX
    if frame.prev_position is not None and np.count_nonzero(moving) >= FEW_PIXELS:  # objects that move, still camera
        expected, stored = expected[moving], stored[moving]
    if not len(expected) or _median_length(expected) < MIN_MOTION_PX:
        return _still(expected, stored, basis)
    readings = {h: h.corrected(stored, frame.size) for h in HYPOTHESES}
    errors = {h: _median_length(motion - expected) for h, motion in readings.items()}
    best = _best(errors)
    if errors[best] > MAX_MOTION_PX:  # an offset may explain what no reading does
        errors = {h: _residual(motion - expected)[0] for h, motion in readings.items()}
        best = _best(errors)
    error, jitter, margin = _residual(readings[best] - expected)
    others = [e for h, e in errors.items() if _differs(readings[h], readings[best])]
    as_is, rival = _median_length(stored - expected), min(others, default=np.inf)
    return MotionVerdict(
        best, error, jitter, margin, as_is, rival, len(expected), basis, known=error <= MAX_MOTION_PX
    )  # fmt: skip


def _median_length(vectors: Array) -> float:
    return float(np.median(np.linalg.norm(vectors, axis=-1)))


def _still(expected: Array, stored: Array, basis: str) -> MotionVerdict | str:
    """A camera that hardly moves shows a jitter, but neither axes nor units."""
    if not len(expected):
        return "no surface is visible in both frames"
    error, jitter, margin = _residual(stored - expected)
    if error > MAX_MOTION_PX or max(map(abs, jitter)) <= max(MIN_JITTER_PX, margin):
        return "the camera hardly moves between these frames"
    as_is = _median_length(stored - expected)
    return MotionVerdict(Hypothesis(), error, jitter, margin, as_is, np.inf, len(expected), basis, True)


def _residual(difference: Array) -> tuple[float, tuple[float, float], float]:
    """Median length, pixels, after a common offset of at most MAX_JITTER_PX; the offset; 1.96 standard errors of it.

    The offset is the median of each component; its standard error is that of the median of a normal distribution.
    """
    offset = np.median(difference, axis=0)
    spread = 1.4826 * np.median(np.abs(difference - offset), axis=0)
    margin = 1.96 * 1.2533 * float(spread.max()) / np.sqrt(len(difference))
    if np.abs(offset).max() > MAX_JITTER_PX or np.abs(offset).max() <= max(MIN_JITTER_PX, margin):
        return _median_length(difference), (0.0, 0.0), margin
    return _median_length(difference - offset), (float(offset[0]), float(offset[1])), margin


def _best(errors: dict[Hypothesis, float]) -> Hypothesis:
    """The reading with the smallest error, unless a simpler one is nearly as good."""
    best = next(iter(errors))
    for hypothesis, error in errors.items():  # the simplest first
        limit = errors[best] * (SIMPLER if hypothesis.corrections > best.corrections else 1.0)
        if error < limit:
            best = hypothesis
    return best


def _differs(first: Array, second: Array) -> bool:
    """Whether this motion distinguishes two readings."""
    return _median_length(first - second) > MAX_MOTION_PX


def _by_images(frame: PathTracedFrame, previous: PathTracedFrame) -> MotionVerdict | str:
    height, width = frame.motion.shape[:2]
    now, before = (np.log1p(np.clip(np.nan_to_num(f.combined[..., :3].astype(np.float64)), 0, None))
                   for f in (frame, previous))  # fmt: skip
    rows, columns = np.indices((height, width))
    valid = np.isfinite(frame.motion).all(axis=-1)
    motion = np.where(valid[..., None], frame.motion, 0.0).astype(np.float64)
    maps: dict[Hypothesis, Array] = {}
    moved: dict[Hypothesis, Array] = {}
    for hypothesis in HYPOTHESES:
        moved[hypothesis] = hypothesis.corrected(motion, frame.size)
        x = np.clip(columns + moved[hypothesis][..., 0], -1e6, 1e6)
        y = np.clip(rows + moved[hypothesis][..., 1], -1e6, 1e6)
        inside = valid & (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
        if inside.sum() >= 0.25 * inside.size:
            difference = np.abs(_bilinear(before, x, y) - now).mean(axis=-1)
            maps[hypothesis] = np.where(inside, difference, np.nan)
    if Hypothesis() not in maps:
        return "most motion leads out of the image as the mapping reads it"
    errors = {h: float(np.nanmean(m)) for h, m in maps.items()}
    best = min(errors, key=errors.get)
    others = [h for h in errors if _differs(moved[h][valid], moved[best][valid])]
    if not others:
        return "most pixels hardly move: every reading is alike"
    rival = min(others, key=errors.get)
    return MotionVerdict(
        best, errors[best], (0.0, 0.0), 0.0, errors[Hypothesis()], errors[rival],
        int(np.isfinite(maps[best]).sum()), "images", known=all(_clearly_less(maps[best], maps[h]) for h in others),
    )  # fmt: skip


def _clearly_less(first: Array, second: Array) -> bool:
    """Whether the mean of ``first`` is below that of ``second`` by three standard errors.

    Over pixels that both have; neighbors depend on one another, so the means of blocks are taken as the sample.
    """
    difference = second - first
    height, width = (n // BLOCK * BLOCK for n in difference.shape)
    blocks = difference[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK)
    blocks = blocks.transpose(0, 2, 1, 3).reshape(-1, BLOCK * BLOCK)
    blocks = blocks[np.isfinite(blocks).sum(axis=1) > BLOCK * BLOCK // 2]
    means = np.nanmean(blocks, axis=1) if len(blocks) else np.zeros(0)
    return len(means) > 8 and float(means.mean()) > 3.0 * float(means.std(ddof=1)) / np.sqrt(len(means))


def _bilinear(image: Array, x: Array, y: Array) -> Array:
    """``image`` (h, w, c) at pixel coordinates, clamped to its edge."""
    height, width = image.shape[:2]
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    x0, y0 = np.minimum(x.astype(int), max(width - 2, 0)), np.minimum(y.astype(int), max(height - 2, 0))
    x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
    fx, fy = (x - x0)[..., None], (y - y0)[..., None]
    top = image[y0, x0] * (1 - fx) + image[y0, x1] * fx
    return top * (1 - fy) + (image[y1, x0] * (1 - fx) + image[y1, x1] * fx) * fy
