"""Evaluation of rejection tests on a scene: confusion against exact visibility, curves, strata, milliseconds."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import NOT_COMPARABLE, Visibility
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import open_session
from taubench_gl.evaluation.exact import ExactReasons, changed_light, exact_channels
from taubench_gl.evaluation.session import Readback, Session
from taubench_gl.frame.materials import tests_alpha
from taubench_gl.metrics.classifier import Confusion, Curve
from taubench_gl.metrics.exact_rates import CHANGES
from taubench_gl.provenance import provenance
from taubench_gl.reject.contract import RejectionTest, load_tests
from taubench_gl.reject.differences import CHANNELS, Differences
from taubench_gl.run import Progress
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray
SCHEMA = "taubench-gl/reject/1"
TRUTHS = ("visibility", "visibility_or_shading")
"""What makes a pixel positive: its point was occluded or new; or that, or its light changed past a threshold."""

STRATA: dict[str, tuple[str, tuple[float, ...]]] = {
    "distance": ("m", (2.0, 5.0, 10.0, 20.0, 50.0)),
    "angle": ("degrees from the surface, 0: grazing", (5.0, 15.0, 45.0)),
    "motion": ("pixels of the point", (0.5, 2.0, 8.0)),
    "camera": ("median pixels of motion of the pair", (0.5, 2.0, 8.0)),
}
"""Unit and inner limits of the strata of surface pixels."""

OBJECTS = ("static", "moving", "deforming", "masked")
"""Classes of pixels: still; moved by more than the position threshold; skinned or morphed; of a material with alpha."""


def stratum_names(name: str) -> tuple[str, ...]:
    """Labels of the strata of ``name``, in order."""
    if name == "object":
        return OBJECTS
    limits = [f"{x:g}" for x in STRATA[name][1]]
    return (f"below {limits[0]}", *(f"{a} to {b}" for a, b in itertools.pairwise(limits)), f"{limits[-1]} and more")


@dataclass
class Scores:
    """Of one test: by truth, confusion at the threshold and the curve; the confusion of every stratum by visibility."""

    test: RejectionTest
    confusion: dict[str, Confusion]
    curves: dict[str, Curve]
    strata: dict[str, list[Confusion]] = field(default_factory=dict)

    @classmethod
    def of(cls, test: RejectionTest, truths: Sequence[str]) -> Scores:
        strata = {name: [Confusion() for _ in stratum_names(name)] for name in (*STRATA, "object")}
        return cls(test, {t: Confusion() for t in truths}, {t: Curve() for t in truths}, strata)

    def add(self, values: Array, truth: dict[str, Array], strata: dict[str, Array]) -> None:
        """``values`` (K,); ``truth``: name -> (K,) bool; ``strata``: name -> (K,) row of the stratum."""
        rejected = values > self.test.threshold
        for name, positive in truth.items():
            self.confusion[name].add(rejected, positive)
            self.curves[name].add(values, positive)
        first = truth[self.truth]
        for name, rows in strata.items():
            for row in np.unique(rows):
                at = rows == row
                self.strata[name][row].add(rejected[at], first[at])

    @property
    def truth(self) -> str:
        """The truth that strata and fits refer to: visibility for geometry, both for color."""
        return TRUTHS[1] if self.test.kind == "color" and TRUTHS[1] in self.confusion else TRUTHS[0]

    def block(self, milliseconds: float | None) -> dict[str, Any]:
        """JSON values."""
        test = self.test
        return {
            "title": test.title, "kind": test.kind, "unit": test.unit, "threshold": test.threshold, "cite": test.cite,
            "settings": dict(test.settings), "parts": [p.name for p in test.parts], "milliseconds": milliseconds,
            "truth": self.truth,
            "scores": {name: c.block() for name, c in self.confusion.items()},
            "curves": {name: c.block() for name, c in self.curves.items()},
            "strata": {
                name: {label: c.block() | {"pixels": c.pixels} for label, c in zip(stratum_names(name), rows)}
                for name, rows in self.strata.items()
            },
        }  # fmt: skip


@dataclass(frozen=True)
class Rejection:
    """Results.  ``summary``: JSON values, schema SCHEMA; ``scores`` by test."""

    summary: dict[str, Any]
    scores: dict[str, Scores]


def evaluate_tests(
    scene: Scene | str | Path,
    tests: Sequence[str],
    settings: Settings | None = None,
    *,
    progress: Callable[[Progress], None] | None = None,
) -> Rejection:
    """Score ``tests`` (as ``contract.load_test`` takes them) on every pair of ``settings`` but the first of its frames.

    That pair gives the motion of the history, which velocity tests compare.  Reprojection is ``motion``.  Raises
    TaubenchError.
    """
    loaded = load_tests(tests)
    color = any(test.kind == "color" for test in loaded)
    columns = ("frustum", "position", "normal", *(("direct", "indirect") if color else ()))
    settings = (settings or Settings()).replace(reprojection="motion", sampling="nearest", columns=columns)
    if not settings.metrics.all_pairs:
        raise SettingsError("rejection tests are scored on consecutive pairs", hint="leave pairs at all")
    settings.require_exact()
    readback = Readback(images=True, channels=tuple(dict.fromkeys((*exact_channels(), *CHANNELS))))
    with open_session(scene, settings, readback, every=1) as session, session.gpu:
        if len(session.plan.frames) < 3:
            raise SettingsError("fewer than three frames", hint="give --frames A:B with B - A of at least 3")
        return _Run(session, loaded).evaluate(progress)


class _Run:
    """One evaluation: tests and truth of the pairs of a session."""

    def __init__(self, session: Session, tests: tuple[RejectionTest, ...]):
        self._session, self._source, self._pairs = session, session.source, session.evaluator
        self._given, self._tests = session.plan, tests
        single = {t.name: t for test in tests for t in test.single}
        self._differences = session.own(Differences(session.context, self._source, tuple(single.values())))
        self._single = tuple(single)
        radiance = {"direct", "indirect"} & set(self._source.radiance)
        self._reasons = ExactReasons(session.variant, session.settings, radiance)
        truths = TRUTHS if self._reasons.lit else TRUTHS[:1]
        self._scores = {test.name: Scores.of(test, truths) for test in tests}
        self._apart = dict.fromkeys(("sky", "frustum", "not_classified", "surface"), 0)
        self._changed = dict.fromkeys(CHANGES, 0)

    def evaluate(self, progress: Callable[[Progress], None] | None) -> Rejection:
        total = len(self._given.frames) - 2
        for number, pair in enumerate(self._session.pairs(checked=())):
            if number > 0:
                self._score(pair.frame)
                if progress is not None:
                    progress(Progress(self._given.name, number, total, pair.evaluated.seconds))
            self._differences.keep_motion(self._pairs.motion_texture)
        self._session.gpu.check("the rejection tests")
        return Rejection(self._summary(total), self._scores)

    def _score(self, frame: int) -> None:
        source, settings = self._source, self._given.settings
        mask, bits = self._pairs.mask(), self._reasons.of(source, frame).bits
        position = source.read("position")
        compared, surface = (mask & NOT_COMPARABLE) == 0, position[..., 3] > 0
        scored = compared & surface & ((bits & (Visibility.OUTSIDE | Visibility.BEHIND | Visibility.INVALID)) == 0)
        frustum = (bits & (Visibility.OUTSIDE | Visibility.BEHIND)) != 0
        self._apart["sky"] += int(np.count_nonzero(~surface & ~frustum))
        self._apart["frustum"] += int(np.count_nonzero(frustum))
        self._apart["surface"] += int(np.count_nonzero(scored))
        self._apart["not_classified"] += int(np.count_nonzero(~scored & surface & ~frustum))
        positive = (bits & (Visibility.OCCLUDED | Visibility.NEW)) != 0
        truth = {TRUTHS[0]: positive[scored]}
        if self._reasons.lit:
            for name, bit in CHANGES.items():
                self._changed[name] += int(np.count_nonzero(scored & ((bits & bit) != 0)))
            truth[TRUTHS[1]] = (positive | changed_light(bits))[scored]
        strata = {name: rows[scored] for name, rows in self._strata(position, bits, scored).items()}
        textures = {"mask": self._pairs.mask_texture, "motion": self._pairs.motion_texture}
        forward = -source.renderer.frame.before[1].world_from_view[:, 2]
        exposure = settings.lighting.exposure_factor
        differences = {n: self._differences.run(n, textures, forward, exposure)[scored] for n in self._single}
        for test in self._tests:
            values = [differences[part.name] / (part.threshold or 1e-30) for part in test.parts]
            values = np.maximum.reduce(values) if test.parts else differences[test.name]
            self._scores[test.name].add(np.where(np.isnan(values), np.inf, values), truth, strata)

    def _strata(self, position: Array, bits: Array, scored: Array) -> dict[str, Array]:
        source, scale = self._source, self._given.settings.metrics.unit_scale
        facing = source.read("geometric_normal")[..., :3].astype(np.float64)
        ray = position[..., :3].astype(np.float64)
        size = np.maximum(np.linalg.norm(ray, axis=-1) * np.linalg.norm(facing, axis=-1), 1e-30)
        angle = np.degrees(np.arcsin(np.clip(np.abs((facing * ray).sum(axis=-1)) / size, 0.0, 1.0)))
        motion = np.linalg.norm(self._pairs.motion(), axis=-1)
        speed = float(np.median(motion[scored])) if scored.any() else 0.0
        values = {"distance": position[..., 3] / scale, "angle": angle, "motion": motion}
        values["camera"] = np.full(motion.shape, speed)
        out = {name: np.searchsorted(STRATA[name][1], v, side="right") for name, v in values.items()}
        kinds = [0]
        for draw in source.renderer.draws:
            materials = source.renderer.scene.materials
            masked = draw.material >= 0 and tests_alpha(materials[draw.material])
            kinds.append(2 if draw.posed else 3 if masked else 0)
        kind = np.array(kinds)[source.read("ids")[..., 0]]
        moved = (kind == 0) & ((bits & Visibility.MOVED) != 0)
        return out | {"object": np.where(moved, 1, kind)}

    def _summary(self, pairs: int) -> dict[str, Any]:
        given, described = self._given, self._source.describe()
        timer = self._session.timer
        medians = timer.median_ms()
        total = max(sum(self._apart.values()), 1)
        tests = {}
        for test in self._tests:
            times = [medians.get(part.name) for part in test.single]
            tests[test.name] = self._scores[test.name].block(None if None in times else sum(times))
        first = next(iter(self._scores.values())).confusion[TRUTHS[0]]
        positive, changed = first.true_positive + first.false_negative, self._changed.values()
        scene = given.animated.scene
        return {
            "schema": SCHEMA,
            "scene": {"name": scene.name, "path": None if scene.path is None else str(scene.path),
                      "sha256": scene.sha256, "stand_in": scene.stand_in},
            "settings": given.settings.as_summary(given.frames),
            "lighting": dict(given.lighting.reasons),
            "pairs": pairs,
            "pixels": dict(self._apart),
            "percent": {name: 100.0 * count / total for name, count in self._apart.items()},
            "positive": {TRUTHS[0]: positive, "changed_shading": sum(changed) if self._reasons.lit else None},
            "changed_shading": dict(self._changed) if self._reasons.lit else None,
            "strata": {name: {"unit": unit, "limits": list(limits)} for name, (unit, limits) in STRATA.items()},
            "tests": tests,
            "clock": timer.clock,
            "notes": described["notes"],
            "provenance": provenance(self._session.gpu, timer.clock),
        }  # fmt: skip
