"""Evaluation of rejection tests on a scene: confusion against exact visibility, curves, strata, milliseconds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import NOT_COMPARABLE, Visibility
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import open_session
from taubench_gl.evaluation.exact import ExactReasons, changed_light, exact_channels
from taubench_gl.evaluation.session import Readback, Session
from taubench_gl.frame.materials import tests_alpha
from taubench_gl.metrics.exact_rates import CHANGES
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.provenance import provenance
from taubench_gl.reject.contract import RejectionTest, load_tests
from taubench_gl.reject.differences import CHANNELS, Differences
from taubench_gl.reject.files import FileRejection
from taubench_gl.reject.scores import REASONS, STRATA, TRUTHS, Scores
from taubench_gl.run import Progress
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray
SCHEMA = "taubench-gl/reject/1"


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
    files: PathTracedOptions | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Rejection:
    """Score ``tests`` (as ``contract.load_test`` takes them) on every pair of ``settings`` but the first of its frames.

    That pair gives the motion of the history, which velocity tests compare.  Reprojection is ``motion``.  ``exr:DIR``,
    read with ``files``, which name the scene: the rejection that the files have is scored too, as the test ``files``,
    on their frames.  Raises TaubenchError.
    """
    stored = None
    if is_sequence(scene):
        files = files or PathTracedOptions()
        stored = FileRejection.open(scene, settings or Settings(), files)
        scene, settings = load_scene(files.scene_file, **stored.settings.sequence.reading), stored.settings
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
        return _Run(session, loaded, stored).evaluate(progress)


class _Run:
    """One evaluation: tests and truth of the pairs of a session."""

    def __init__(self, session: Session, tests: tuple[RejectionTest, ...], stored: FileRejection | None):
        self._session, self._source, self._pairs = session, session.source, session.evaluator
        self._plan, self._tests, self._stored = session.plan, tests, stored
        single = {t.name: t for test in tests for t in test.single}
        self._differences = session.own(Differences(session.context, self._source, tuple(single.values())))
        self._single = tuple(single)
        radiance = {"direct", "indirect"} & set(self._source.radiance)
        self._reasons = ExactReasons(session.variant, session.settings, radiance)
        truths = TRUTHS if self._reasons.lit else TRUTHS[:1]
        scored = (*tests, *(() if stored is None else (stored.test,)))
        self._scores = {test.name: Scores.of(test, truths) for test in scored}
        self._pixel_counts = dict.fromkeys(("sky", "frustum", "not_classified", "surface"), 0)
        self._changed = dict.fromkeys(CHANGES, 0)

    def evaluate(self, progress: Callable[[Progress], None] | None) -> Rejection:
        total = len(self._plan.frames) - 2
        for number, pair in enumerate(self._session.pairs(checked=())):
            if number > 0:
                self._score(pair.frame)
                if progress is not None:
                    progress(Progress(self._plan.name, number, total, pair.evaluated.seconds))
            self._differences.keep_motion(self._pairs.motion_texture)
        self._session.gpu.check("the rejection tests")
        return Rejection(self._summary(total), self._scores)

    def _score(self, frame: int) -> None:
        source, settings = self._source, self._plan.settings
        mask, bits = self._pairs.mask(), self._reasons.of(source, frame).bits
        position = source.read("position")
        compared, surface = (mask & NOT_COMPARABLE) == 0, position[..., 3] > 0
        scored = compared & surface & ((bits & (Visibility.OUTSIDE | Visibility.BEHIND | Visibility.INVALID)) == 0)
        frustum = (bits & (Visibility.OUTSIDE | Visibility.BEHIND)) != 0
        self._pixel_counts["sky"] += int(np.count_nonzero(~surface & ~frustum))
        self._pixel_counts["frustum"] += int(np.count_nonzero(frustum))
        self._pixel_counts["surface"] += int(np.count_nonzero(scored))
        self._pixel_counts["not_classified"] += int(np.count_nonzero(~scored & surface & ~frustum))
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
        if self._stored is not None:
            values = self._stored.difference(frame)[scored]
            known = ~np.isnan(values)
            parts = ({name: rows[known] for name, rows in arrays.items()} for arrays in (truth, strata))
            self._scores[self._stored.test.name].add(values[known], *parts)

    def _strata(self, position: Array, bits: Array, scored: Array) -> dict[str, Array]:
        source, scale = self._source, self._plan.settings.metrics.unit_scale
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
        reasons = [(bits & bit) != 0 for bit in REASONS.values()]
        return out | {
            "object": np.where(moved, 1, kind),
            "reason": np.select(reasons, range(len(reasons)), len(reasons)),
        }

    def _summary(self, pairs: int) -> dict[str, Any]:
        plan, described = self._plan, self._source.describe()
        timer = self._session.timer
        medians = timer.median_ms()
        total = max(sum(self._pixel_counts.values()), 1)
        tests = {}
        for name, scores in self._scores.items():
            times = [medians.get(part.name) for part in scores.test.single]
            tests[name] = scores.block(None if None in times else sum(times))
        first = next(iter(self._scores.values())).confusion[TRUTHS[0]]
        positive, changed = first.true_positive + first.false_negative, self._changed.values()
        scene = plan.animated.scene
        return {
            "schema": SCHEMA,
            "scene": {"name": scene.name, "path": None if scene.path is None else str(scene.path),
                      "sha256": scene.sha256, "stand_in": scene.stand_in},
            "settings": plan.settings.as_summary(plan.frames),
            "lighting": dict(plan.lighting.reasons),
            "pairs": pairs,
            "pixels": dict(self._pixel_counts),
            "percent": {name: 100.0 * count / total for name, count in self._pixel_counts.items()},
            "positive": {TRUTHS[0]: positive, "changed_shading": sum(changed) if self._reasons.lit else None},
            "changed_shading": dict(self._changed) if self._reasons.lit else None,
            "strata": {name: {"unit": unit, "limits": list(limits)} for name, (unit, limits) in STRATA.items()},
            "tests": tests,
            "clock": timer.clock,
            "notes": described["notes"],
            "provenance": provenance(self._session.gpu, timer.clock),
        }  # fmt: skip
