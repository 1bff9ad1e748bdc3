"""Scores of one method: numbers per frame, errors per pixel class, and their summary."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.metrics.blending import channels
from taubench_gl.reuse import quality
from taubench_gl.reuse.bound import EXACT, NO_HISTORY, Blended, BoundRecord, bound_of_frame
from taubench_gl.reuse.comparison import over_frames
from taubench_gl.reuse.perceptual import LPIPS_SIDE, Perceptual, to_8_bit
from taubench_gl.reuse.response import ResponseRecord

Array = np.ndarray

ROW_COLUMNS = (
    "seed", "frame", "method", *quality.MEASURES, "reused_percent", "mean_weight", "effective_weight",
    "wrongly_reused_percent", "wrongly_rejected_percent", "bound_linear_mse", "headroom_db", "bound_clipped_mse",
    "clipped_headroom_db", "bound_weight", "blended_percent", "emitter_percent", "emitter_linear_mse", "time_ms",
    "invalid_pixels",
)  # fmt: skip
"""frames.csv, one row per seed, frame and method.  An empty cell was not measured."""

NO_WEIGHT = "the method does not report the weight of history (alpha of its result is -1)"
NO_EXACT_MASK = "there is no exact mask of these frames"
NOT_REQUESTED = "not requested"
EQUAL = "equal to the reference: infinite"
BLACK = "image and reference are black"
NOT_IN_TURN = "generated frames have rendered ones between them"

CLASSES: dict[str, tuple[int, str]] = {
    "not_classified": (int(Reason.FIRST | Reason.CUT | Reason.INVALID), "no history: first frame, cut, or invalid"),
    "frustum": (int(FRUSTUM), "was off-screen or behind the camera in the previous frame"),
    "disoccluded": (int(Reason.DISOCCLUDED), "was hidden in the previous frame"),
    "occluding": (int(Reason.OCCLUDING), "covers the surface of the previous frame"),
    "geometry": (int(Reason.POSITION | Reason.NORMAL), "another position or normal, for any other reason"),
    "lit": (int(Reason.LIT), "direct light increased"),
    "shadowed": (int(Reason.SHADOWED), "direct light decreased"),
    "light": (int(Reason.DIRECT | Reason.INDIRECT | Reason.COLOR), "any other change of light or color"),
    "sky": (int(Reason.SKY), "sky in both frames"),
    "rest": (0, "none of these: history is valid"),
}
"""Name -> (reason bits, meaning).  A pixel belongs to the first class with one of its bits; classes are disjoint."""


def classify(mask: Array) -> Array:
    """Index into CLASSES of every pixel.  (h, w) uint32 reason words -> (h, w) int8."""
    out = np.full(mask.shape, len(CLASSES) - 1, dtype=np.int8)
    for index, (bits, _) in reversed(list(enumerate(CLASSES.values()))):
        if bits:
            out[(mask & np.uint32(bits)) != 0] = index
    return out


@dataclass(slots=True)
class ClassErrors:
    """Sums of per-pixel errors by class, over frames."""

    pixels: Array = field(default_factory=lambda: np.zeros(len(CLASSES), dtype=np.int64))
    scored: Array = field(default_factory=lambda: np.zeros(len(CLASSES), dtype=np.int64))  # of measures in LINEAR
    sums: dict[str, Array] = field(default_factory=dict)

    def add(self, classes: Array, errors: dict[str, Array], scored: Array) -> None:
        """Add one frame: ``classes``, ``scored`` (h, w), and ``errors``, name -> (h, w), the same names every time."""
        self.pixels += np.bincount(classes.ravel(), minlength=len(CLASSES))
        self.scored += np.bincount(classes[scored], minlength=len(CLASSES))
        everywhere = np.full(scored.shape, True)
        for name, values in errors.items():
            which = scored if name in quality.LINEAR else everywhere
            weights = values[which].astype(np.float64)
            total = np.bincount(classes[which], weights=weights, minlength=len(CLASSES))
            self.sums[name] = self.sums.get(name, 0.0) + total

    def summary(self) -> dict[str, dict[str, Any]]:
        """Class -> ``percent`` of all pixels and the mean of each error, None for an empty class."""
        total, out = int(self.pixels.sum()), {}
        for index, name in enumerate(CLASSES):
            count, means = int(self.pixels[index]), {}
            for measure, sums in self.sums.items():
                of = int(self.scored[index]) if measure in quality.LINEAR else count
                means[measure] = float(sums[index] / of) if of else None
            out[name] = {"pixels": count, "percent": 100.0 * count / total if total else None, **means}
        return out


@dataclass(slots=True)
class ErrorParts:
    """Squared error of linear radiance, of every counted frame, apart: variance over seeds, and squared bias.

    ``most_bytes``: of the sums of images that are kept; frames beyond it are left out.
    """

    most_bytes: int = 0
    _errors: dict[int, Array] = field(default_factory=dict)  # by frame: sum over seeds of the error of every pixel
    _squares: dict[int, list[tuple[float, float]]] = field(default_factory=dict)  # and of each seed the mean squares

    def add(self, frame: int, error: Array, linear_mse: float) -> None:
        """Add the next seed of a frame: ``error`` (n, 3) of its pixels, and ``linear_mse`` without the noise of the
        reference."""
        if frame not in self._errors:
            if (len(self._errors) + 1) * error.nbytes > self.most_bytes:
                return
            self._errors[frame], self._squares[frame] = np.zeros_like(error), []
        self._errors[frame] += error
        self._squares[frame].append((linear_mse, float(np.mean(error**2, dtype=np.float64))))

    def summary(self) -> dict[str, Any] | None:
        """The block ``error_parts`` of reuse.json, intervals over frames; None for one seed."""
        table = []
        for frame, squares in self._squares.items():
            if (n := len(squares)) > 1:
                mse, square = np.mean(squares, axis=0)
                mean_square = float(np.mean((self._errors[frame] / n) ** 2, dtype=np.float64))
                table.append((mse, (square - mean_square) * n / (n - 1)))
        if not table:
            return None
        out: dict[str, Any] = {"frames": len(table)}
        for name, part in (("variance", lambda m: m[..., 1]), ("bias_squared", lambda m: m[..., 0] - m[..., 1])):
            ends = over_frames(np.array(table), part, part(np.array(table)))
            out[name] = {"mean": float(part(np.mean(table, axis=0))), "low": ends["low"], "high": ends["high"]}
        return out


@dataclass(frozen=True, slots=True)
class Displayed:
    """One image: linear radiance and display colors, (h, w, 3), finite."""

    radiance: Array
    colors: Array
    valid: Array  # (h, w) bool: finite in the image and in its reference; black elsewhere

    @classmethod
    def of(cls, radiance: Array, valid: Array, curve: str) -> Displayed:
        """``radiance`` with invalid pixels black, and its display colors under tone map ``curve``."""
        radiance = np.where(valid[..., None], radiance, 0.0)
        return cls(radiance, quality.display(radiance, curve), valid)

    def masked(self, valid: Array) -> Displayed:
        """This image, black where another one is invalid: such a pixel has no error and is counted separately."""
        if valid.all():
            return self
        keep = valid[..., None]
        return Displayed(np.where(keep, self.radiance, 0.0), np.where(keep, self.colors, 0.0), valid)


@dataclass(frozen=True)
class FrameTruth:
    """What all methods of one frame are compared with.  Arrays (h, w, ...), row 0 at the top."""

    frame: int
    image: Displayed
    previous: Displayed | None  # reference image of the previous frame; None for the first
    mask: Array  # (h, w) uint32 reason words
    classes: Array  # (h, w) int8, of ``classify``
    motion_px: Array  # (h, w, 2) previous - current, +y down
    gain: float | None = 1.0  # of ``relmse_trimmed``, one for the evaluation; None: the first reference is black
    emitters: Array | None = None  # (h, w) bool: the visible surface emits; None: none does, or it is not known
    halves: tuple[Array, Array] | None = None  # (h, w, 3) linear radiance of two independent halves of the reference
    events: Array | None = None  # (h, w) int of ``EventTracker``
    measured: list[tuple[Displayed, dict[str, Any], dict[str, Array]]] = field(default_factory=list)
    """Images of methods, with the same metrics, their measures and their map of FLIP."""

    @cached_property
    def scored(self) -> Array:
        """Pixels that measures of linear radiance count, (h, w) bool: all where every pixel shows an emitter."""
        if self.emitters is None or self.emitters.all():
            return np.full(self.mask.shape, True)
        return ~self.emitters


@dataclass(slots=True)
class MethodRecord:
    """Scores of one method, frame by frame, seed by seed.

    ``metrics`` of option_groups.METRICS; ``exact_mask``: whether the masks are those of the exact frames; ``warmup``:
    first frames of every seed that means leave out, at least the first, which has no history; ``perceptual``: measures
    of other packages; ``in_turn``: whether the frames follow one another.
    """

    label: str
    metrics: frozenset[str]
    exact_mask: bool
    in_turn: bool = True
    warmup: int = 1
    perceptual: Perceptual = field(default_factory=Perceptual)
    rows: list[dict[str, Any]] = field(default_factory=list)
    counted: list[dict[str, Any]] = field(default_factory=list)  # the rows that means are over
    classes: ClassErrors = field(default_factory=ClassErrors)
    bounds: BoundRecord = field(default_factory=BoundRecord)
    eye_bounds: BoundRecord = field(default_factory=BoundRecord)
    responses: ResponseRecord = field(default_factory=ResponseRecord)
    parts: ErrorParts = field(default_factory=ErrorParts)
    failed: str | None = None
    _seed: int = 0
    _index: int = 0
    _mse: list[float] = field(default_factory=list)
    _temporal_mse: list[float] = field(default_factory=list)
    _previous: Displayed | None = None
    _video: list[tuple[Array, Array]] = field(default_factory=list)  # display colors of the counted frames of a seed
    _tails: dict[str, Array] = field(default_factory=dict)  # measure -> sums of ``quality.tail``

    def begin(self, seed: int) -> None:
        """The next frame is the first of the sequence of ``seed``."""
        self._seed, self._index, self._previous = seed, 0, None
        self._video.clear()

    def end(self) -> None:
        """The sequence of a seed is complete: measures of whole sequences go into all its counted rows."""
        self.responses.end()
        if self.perceptual.cvvdp is None or not self._video:
            return
        test, reference = (np.stack(images) for images in zip(*self._video, strict=True))
        self._video.clear()
        if not test.any() and not reference.any():
            return
        value = self.perceptual.cvvdp(test, reference)
        for row in self.counted:
            if row["seed"] == self._seed:
                row["cvvdp_jod"] = value

    def add(
        self,
        reference: FrameTruth,
        result: Array,
        curve: str,
        time_ms: float | None,
        blended: Blended | None = None,
        of_eye: Blended | None = None,
    ) -> tuple[Array, Array]:
        """Evaluate one frame.  ``result`` (h, w, 4): radiance and weight of history; ``blended``: what it blended;
        ``of_eye``: with the other eye.

        -> display colors (h, w, 3) and an error map (h, w) in [0, 1]: FLIP, or without it 4 |error|.
        """
        valid = reference.image.valid & channels(np.logical_and, np.isfinite(result))
        shown, expected = Displayed.of(result[..., :3], valid, curve), reference.image.masked(valid)
        errors = {"mse": quality.squared_error(shown.colors, expected.colors)}
        errors |= quality.linear_errors(shown.radiance, expected.radiance)
        tails = {name: quality.tail(errors[name][reference.scored]) for name in errors if name in quality.LINEAR}
        emitters = self._emitters(reference, errors["linear_mse"])
        if reference.halves is not None:
            first, second = (np.where(valid[..., None], half, 0.0) for half in reference.halves)
            errors["linear_mse"] = quality.independent_squared_error(shown.radiance, first, second)
        if reference.events is not None:
            self.responses.add(reference.events, errors["linear_mse"])
        counted = self._index >= self.warmup
        row: dict[str, Any] = dict.fromkeys(ROW_COLUMNS)
        row |= {"seed": self._seed, "frame": reference.frame, "method": self.label, "time_ms": time_ms}
        row["invalid_pixels"] = int(np.count_nonzero(~valid))
        row |= emitters
        if not (_black(shown) and _black(expected)):
            row |= self._image_measures(shown, expected, errors, reference)
        if blended is not None:
            bound = bound_of_frame(blended, result, expected.radiance, valid, reference.emitters)
            row |= bound.row
            if counted:
                self.bounds.seeds.setdefault(self._seed, []).append(bound)
        if of_eye is not None and counted:
            bound = bound_of_frame(of_eye, result, expected.radiance, valid, reference.emitters)
            self.eye_bounds.seeds.setdefault(self._seed, []).append(bound)
        if self._previous is not None and reference.previous is not None:  # the first frame has no history
            allowed = quality.reusable(reference.mask)
            row |= self._temporal(shown, expected, reference, allowed, counted)
            row |= weights(result[..., 3], allowed if self.exact_mask else None)
        if counted:
            if row["relmse"] is not None:  # not black against black
                self._mse.append(float(errors["mse"].mean()))
                error = (shown.radiance - expected.radiance)[reference.scored]
                self.parts.add(reference.frame, error, row["linear_mse"])
                self.classes.add(reference.classes, errors, reference.scored)
                for name, sums in tails.items():
                    self._tails[name] = self._tails.get(name, 0.0) + np.array(sums)
            self.counted.append(row)
            if self.perceptual.cvvdp is not None:
                self._video.append(tuple(to_8_bit(image.colors) for image in (shown, expected)))
        self._previous, self._index = shown, self._index + 1
        self.rows.append(row)
        return shown.colors, errors.get("flip", np.clip(4.0 * np.sqrt(errors["mse"]), 0.0, 1.0))

    def _emitters(self, reference: FrameTruth, error: Array) -> dict[str, float | None]:
        """Share of the pixels that show an emitting surface, and their mean ``error``."""
        if reference.emitters is None or not reference.emitters.any():
            return {"emitter_percent": None if reference.emitters is None else 0.0, "emitter_linear_mse": None}
        mean = float(error[reference.emitters].mean())
        return {"emitter_percent": _percent(reference.emitters), "emitter_linear_mse": mean}

    def _image_measures(
        self, shown: Displayed, expected: Displayed, errors: dict[str, Array], reference: FrameTruth
    ) -> dict[str, Any]:
        """Measures of one image; adds the map of FLIP to ``errors``."""
        for image, known, flip in reference.measured:  # frames without history are the input in most methods
            if np.array_equal(image.radiance, shown.radiance) and np.array_equal(image.valid, shown.valid):
                errors |= flip
                return known
        scored = reference.scored
        out: dict[str, Any] = {n: float(errors[n][scored].mean()) for n in errors if n in quality.LINEAR}
        out["psnr_db"] = quality.psnr(float(errors["mse"].mean()))
        if "ssim" in self.metrics:
            out["ssim"] = quality.ssim(shown.colors, expected.colors)
        if "flip" in self.metrics:
            errors["flip"] = quality.flip_map(shown.colors, expected.colors)
            out["flip"] = float(errors["flip"].mean())
            points = np.percentile(errors["flip"], quality.FLIP_PERCENTILES)
            out |= {f"flip_p{p}": float(v) for p, v in zip(quality.FLIP_PERCENTILES, points, strict=True)}
        if "hdr_flip" in self.metrics:
            out["hdr_flip"] = quality.hdr_flip(shown.radiance, expected.radiance)
        if reference.gain is not None:
            images = (image.radiance[scored] for image in (shown, expected))
            out["relmse_trimmed"] = quality.trimmed_relative_error(*images, reference.gain)
        if self.perceptual.lpips is not None:
            out["lpips"] = self.perceptual.lpips(shown.colors, expected.colors)
        reference.measured.append((shown, out, {name: errors[name] for name in ("flip",) if name in errors}))
        return out

    def _temporal(
        self, shown: Displayed, expected: Displayed, reference: FrameTruth, allowed: Array, counted: bool
    ) -> dict[str, float | None]:
        out: dict[str, float | None] = {}
        before, expected_before = self._previous, reference.previous
        if all(_black(image) for image in (shown, before, expected, expected_before)):
            return out
        images = shown.colors, before.colors, expected.colors, expected_before.colors
        if "tpsnr" in self.metrics:
            error = quality.temporal_squared_error(*images)
            mse = float(np.where(shown.valid & before.valid, error, 0.0).mean())
            out["tpsnr_db"] = quality.psnr(mse)
            if counted:
                self._temporal_mse.append(mse)
        if "flicker" in self.metrics:
            valid = shown.valid & quality.history_of(before.valid, reference.motion_px)
            out["flicker"] = quality.flicker(*images, reference.motion_px, allowed & valid)
        if "warp_error" in self.metrics:
            valid = shown.valid & quality.history_of(before.valid, reference.motion_px)
            out["warp_error"] = quality.warp_error(shown.colors, before.colors, reference.motion_px, allowed & valid)
        return out

    def summary(self) -> dict[str, Any]:
        """Means over the counted frames of all seeds; ``reasons`` explains every None."""
        rows = self.counted
        if self.failed is not None or not rows:
            return {"failed": self.failed or "fewer than two frames", "frames": len(self.rows)}
        mean = {name: _mean(rows, name) for name in quality.MEASURES}
        if mean["relmse"] is not None:  # else all frames are black
            mean["psnr_db"] = quality.psnr(float(np.mean(self._mse)))
            mean["tpsnr_db"] = quality.psnr(float(np.mean(self._temporal_mse))) if self._temporal_mse else None
        reuse = {n: _mean(rows, n) for n in REUSE}
        bound = self.bounds.summary()
        times = [row["time_ms"] for row in rows if row["time_ms"] is not None]
        return {
            "failed": None,
            "frames": len(self.rows),
            "mean": mean,
            "reuse": reuse,
            "tail_percent": {n: 100.0 * float(s[0] / s[1]) if s[1] > 0 else None for n, s in self._tails.items()},
            "emitters": {"percent": _mean(rows, "emitter_percent"), "linear_mse": _mean(rows, "emitter_linear_mse")},
            "bound": bound,
            "eye_bound": self.eye_bounds.summary(),
            "response": self.responses.summary(),
            "error_parts": self.parts.summary(),
            "classes": self.classes.summary(),
            "time_ms": statistics.median(times) if times else None,
            "invalid_pixels": sum(row["invalid_pixels"] for row in self.rows),
            "black_frames": sum(row["relmse"] is None for row in self.rows),
            "reasons": self._reasons(mean, reuse, bound),
        }

    def _reasons(self, mean: dict[str, Any], reuse: dict[str, Any], bound: dict[str, Any] | None) -> dict[str, str]:
        out = {}
        for name, value in mean.items():
            if value is None:
                metric = quality.MEASURES[name].metric
                small = f"the image is smaller than SSIM's window of {quality.SSIM_SIDE} pixels"
                change = "no pixel is reusable by the exact mask" if self.in_turn else NOT_IN_TURN
                reasons = {"ssim": small, "flicker": change, "warp_error": change}
                reasons["tpsnr_db"] = EQUAL if self.in_turn else NOT_IN_TURN
                reasons["lpips"] = f"the image is smaller than {LPIPS_SIDE} pixels, the least for LPIPS"
                reasons["relmse_trimmed"] = "the first reference image is black: it gives no exposure"
                reasons["hdr_flip"] = "no reference frame has light, which gives the exposures"
                black = all(row["relmse"] is None for row in self.counted)
                measured = BLACK if black else reasons.get(name, EQUAL)
                out[name] = NOT_REQUESTED if metric and metric not in self.metrics else measured
        for name, value in reuse.items():
            if value is None:
                out[name] = NO_WEIGHT if reuse["mean_weight"] is None else NO_EXACT_MASK
        if bound is None:
            out |= {"bound": NO_HISTORY}
            if reuse["mean_weight"] is not None:
                out["effective_weight"] = NO_HISTORY
        elif bound["headroom_db"] is None:
            out["bound.headroom_db"] = EXACT
        return out


REUSE = ("reused_percent", "mean_weight", "effective_weight", "wrongly_reused_percent", "wrongly_rejected_percent")
"""Columns of a method's block ``reuse``."""


def _black(image: Displayed) -> bool:
    return not image.radiance.any()


def weights(weight: Array, allowed: Array | None) -> dict[str, float | None]:
    """Reuse of one frame from the weights of history (h, w) of a method, percent of w·h; None if it reports none.

    A pixel is *reused* if its weight is above 0, *wrongly reused* if the exact mask does not allow it, and *wrongly
    rejected* if it is not reused although the exact mask allows it.  ``allowed`` (h, w) bool; None: no exact mask.
    """
    names = ("reused_percent", "mean_weight", "wrongly_reused_percent", "wrongly_rejected_percent")
    if (weight < 0).any():
        return dict.fromkeys(names)
    weight = np.where(np.isfinite(weight), weight, 0.0)  # NaN where the radiance is NaN: no history
    reused, wrong = weight > 0, (None, None)
    if allowed is not None:
        wrong = _percent(wrongly_reused(weight, allowed)), _percent(~reused & allowed)
    return dict(zip(names, (_percent(reused), float(weight.mean()), *wrong), strict=True))


def wrongly_reused(weight: Array, allowed: Array) -> Array:
    """Pixels whose weight of history is above 0 although the exact mask does not allow it: ghosts.  (h, w) bool."""
    return (weight > 0) & ~allowed


def _percent(which: Array) -> float:
    return 100.0 * float(np.count_nonzero(which)) / which.size


def _mean(rows: list[dict[str, Any]], name: str) -> float | None:
    """Mean of a column over the frames that have a value."""
    values = [row[name] for row in rows if row[name] is not None]
    return float(np.mean(values)) if values else None
