"""Units of a job: its head (all that needs no pair), its pairs in chunks and its sampled light; and their records.

    JOB/head                   {"stamp", "frames", "facts", "lighting", "positions", "rotations"}
    JOB/pairs-FIRST-LAST-HASH  {"report": what the worker measured, "pairs": [{"position", "words", "bins", "other",
                               "lobes", "added": columns of column groups}]}
    JOB/light-PAIR-VISIT-HASH  a visit of sampled light

HASH is of everything in the head that counts depend on.  Counts are sparse, [places, counts]: of reason words in
``words``, in ``other`` (under the other reprojection; null where that is not counted) and in each of ``lobes``; of
histogram bins in ``bins``, feature * bins + bin in the order of ``features.FEATURES``.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taubench_gl.batch.spec import Job
from taubench_gl.conventions import HISTOGRAM_BINS
from taubench_gl.evaluation import (
    Readback,
    ScenePlan,
    Session,
    file_hashes,
    files_identity,
    frame_range,
    frame_schedule,
    light_plan,
    plan_scene,
)
from taubench_gl.evaluation.brightness import checked_frames
from taubench_gl.evaluation.lighting import ResolvedLighting
from taubench_gl.evaluation.sampled_light import LightVisits
from taubench_gl.evaluation.schedule import pair_schedule
from taubench_gl.evaluation.summary import static_summary
from taubench_gl.features import FEATURES, MASK_WORDS
from taubench_gl.metrics.counts import Counts
from taubench_gl.provenance import provenance
from taubench_gl.settings import AUTO, Settings
from taubench_gl.study.scene import LoadedScene
from taubench_gl.study.store import content_hash, json_bytes
from taubench_gl.study.unit import Unit, Worker
from taubench_gl.study.worker import open_context

Array = np.ndarray
Sparse = tuple[list[int], list[int]]
"""Places of the counts that are not zero, and these counts."""

LIGHTING = ("light_unit", "exposure", "environment", "spp", "pairs")
"""Settings that are resolved once for all units of a job."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadUnit(Unit):
    """The unit that makes the head of a job: all that needs no pair.  ``stamp``: ``file_stamp`` of the scene before it
    is read.
    """

    of: Job
    stamp: list[int] | None

    def run(self, worker: Worker) -> bytes:
        worker.release()  # the scene may have changed
        loaded = _JobScene.of(worker, self.of)
        if self.of.settings.lighting.exposure == AUTO:
            open_context(self.of.settings)  # its exposure may have to be metered
        return json_bytes(_head_record(loaded, self.of.settings, self.stamp))


@dataclass(frozen=True, slots=True, kw_only=True)
class _RenderedUnit(Unit):
    """A unit of a job whose lighting is resolved; ``sha256``: of the files when the head was made."""

    of: Job
    sha256: str | None

    def opened(self, worker: Worker) -> _JobScene:
        """The scene of the job, in a current context.  Raises SceneError if its files have changed since the head."""
        open_context(self.of.settings)
        loaded = _JobScene.of(worker, self.of)
        loaded.require_unchanged(self.sha256, self.of.settings, "run the batch again")
        return loaded


@dataclass(frozen=True, slots=True, kw_only=True)
class PairsUnit(_RenderedUnit):
    """Some pairs of a job.

    ``positions``: ascending, among the job's pairs; empty for a job without pairs, whose frames are rendered all the
    same.
    """

    positions: tuple[int, ...]

    def run(self, worker: Worker) -> bytes:
        started = time.perf_counter()
        pairs, report = self._count(self.opened(worker), worker)
        report["provenance"] |= {"host": platform.node(), "pid": os.getpid(), "seconds": time.perf_counter() - started}
        return json_bytes({"report": report, "pairs": pairs})

    def _count(self, loaded: _JobScene, worker: Worker) -> tuple[list[dict[str, Any]], dict[str, Any]]:
        session, settings = loaded.session(self.of), self.of.settings
        session.timer.reset()
        frames = session.plan.frames
        schedule = pair_schedule(frames, self.positions) if self.positions else frame_schedule(frames, settings)
        evaluated = []
        checked = checked_frames(frame_schedule(frames, settings))
        for pair in session.pairs(schedule, checked, continued=True):
            evaluated.append(pair.evaluated)
            worker.done()
        pairs = [
            pair_record(position, pair.counts, pair.lobes, {name: row[name] for name in session.added_columns})
            for position, pair, row in zip(self.positions, evaluated, session.tally.rows, strict=True)
        ]
        return pairs, _report(session)


@dataclass(frozen=True, slots=True, kw_only=True)
class LightUnit(_RenderedUnit):
    """One visit of sampled light: ``visit``, the position of its pair and the number of the visit."""

    visit: tuple[int, int]

    def run(self, worker: Worker) -> bytes:
        return json_bytes(self.opened(worker).light(self.of).visit(*self.visit).record())


def head_unit(job: Job, stamp: list[int] | None) -> HeadUnit:
    """The unit that makes the head of ``job``; ``stamp``: of its file now (``file_stamp``)."""
    return HeadUnit(job=job.id, key=head_key(job.id), name="head", scene=job.scene, of=job, stamp=stamp)


def pairs_unit(job: Job, positions: tuple[int, ...], head: Mapping[str, Any]) -> PairsUnit:
    """The unit that counts the pairs at ``positions``.  ``job``: with the lighting of its ``head``."""
    ends = f"{positions[0]:06d}-{positions[-1]:06d}" if positions else "none"
    name = f"pairs {positions[0]} to {positions[-1]}" if positions else "frames without pairs"
    sha256 = files_identity(head["facts"]["scene"])
    return PairsUnit(job=job.id, key=pairs_key(job.id, ends, head), name=name, scene=job.scene, weight=len(positions),
                     of=job, positions=positions, sha256=sha256)  # fmt: skip


def light_unit(job: Job, visit: tuple[int, int], head: Mapping[str, Any]) -> LightUnit:
    """The unit of one visit of sampled light.  ``job``: with the lighting of its ``head``."""
    return LightUnit(job=job.id, key=light_key(job.id, visit, head), name=f"light of pair {visit[0]}", scene=job.scene,
                     of=job, visit=visit, sha256=files_identity(head["facts"]["scene"]))  # fmt: skip


def light_key(job: str, visit: tuple[int, int], head: Mapping[str, Any]) -> str:
    """Key of the record of a visit: (position of the pair, number of the visit)."""
    return f"{job}/light-{visit[0]:06d}-{visit[1]:04d}-{head_hash(head)}"


def head_key(job: str) -> str:
    """Key of the record of a job's head."""
    return f"{job}/head"


def pairs_key(job: str, ends: str, head: Mapping[str, Any]) -> str:
    """Key of a record of pairs.  ``ends``: first and last position, or a pattern."""
    return f"{job}/pairs-{ends}-{head_hash(head)}"


def head_hash(head: Mapping[str, Any]) -> str:
    """Hash of everything in a head that the counts of pairs depend on."""
    return content_hash([head[name] for name in ("frames", "facts", "lighting")])


class _JobScene(LoadedScene):
    """The scene of a job and, once it renders, its session."""

    def __init__(self, path: str, settings: Settings):
        super().__init__(path, settings)
        self._session: Session | None = None
        self._light: LightVisits | None = None

    @classmethod
    def of(cls, worker: Worker, job: Job) -> _JobScene:
        """The scene of ``job`` that ``worker`` keeps."""
        return cls.kept(worker, job.scene, job.settings, job.id)

    def session(self, job: Job) -> Session:
        """The session of a job whose lighting is resolved."""
        if self._session is None:
            frames = frame_range(self.animated.scene, self.animated.camera, job.settings)
            light = light_plan(job.settings, sampled=True)
            plan = ScenePlan(self.animated, frames, ResolvedLighting(job.settings), light)
            self._session = Session(plan, Readback(lobes=job.lobes))
        return self._session

    def light(self, job: Job) -> LightVisits:
        """The sampled light of a job whose lighting is resolved."""
        session = self.session(job)
        self._light = self._light or session.open_light()
        return self._light

    def release(self) -> None:
        if self._session is not None:
            self._session.release()


def _head_record(loaded: _JobScene, settings: Settings, stamp: list[int] | None) -> dict[str, Any]:
    """All of the summary that needs no pair, and the camera poses of all frames in full precision.

    ``lighting``: the settings of ``LIGHTING``, resolved for all units of the job; ``stamp``: of the scene's file.
    """
    scene = loaded.animated.scene
    plan = plan_scene(scene, settings, loaded.animated.camera, sampled=True)
    frames, animated, resolved = plan.frames, plan.animated, plan.lighting
    views = [animated.view_at(frame / settings.sequence.fps) for frame in frames]
    # A .glb may refer to images and buffers in other files, whose changes its stamp does not show.
    one_file = scene.files == 1 and len(file_hashes(scene, resolved.settings)) == 1
    return {
        "stamp": stamp if one_file else None,
        "frames": [frames.start, frames.stop],
        "facts": static_summary(animated, frames, resolved),
        "lighting": {name: resolved.settings.to_dict()[name] for name in LIGHTING},
        "positions": [view.position for view in views],
        "rotations": [view.world_from_view for view in views],
    }


def resolved_job(job: Job, head: Mapping[str, Any]) -> Job:
    """The job with the settings of LIGHTING that its head resolved."""
    lighting = {name: tuple(v) if isinstance(v, list) else v for name, v in head["lighting"].items()}
    return replace(job, settings=job.settings.replace(**lighting))


def _report(session: Session) -> dict[str, Any]:
    """What a session measured besides the counts: facts of its source, brightness, depths, times."""
    with session.gpu:
        session.gpu.check("a chunk of a batch")
        return {
            "source": session.source.describe(),
            "brightness": session.tally.brightness.as_dict(),
            "depths": session.tally.depths,
            "unmeasured": dict(session.source.unmeasured),
            "added": session.added_columns,
            "reprojection": session.source.reprojection,
            "other": session.source.other,
            "provenance": provenance(session.gpu, session.timer.clock),
            "passes_ms": session.timer.median_ms(),
        }


# --------------------------------------------------------------------------------------------------------------- counts
def pair_record(position: int, counts: Counts, lobes: Mapping[str, Array], added: Mapping[str, Any]) -> dict[str, Any]:
    """A counted pair as its record has it.  ``added``: values of the columns that column groups add."""
    return {
        "position": position,
        "words": _sparse(counts.mask_histogram),
        "bins": _sparse(counts.histograms),
        "other": None if counts.other is None else _sparse(counts.other),
        "lobes": {lobe: _sparse(histogram) for lobe, histogram in lobes.items()},
        "added": dict(added),
    }


def counts_of_record(pair: Mapping[str, Any]) -> Counts:
    """The counts that ``pair_record`` stored.  Raises IndexError or ValueError for places that do not exist."""
    bins = _dense(pair["bins"], len(FEATURES) * HISTOGRAM_BINS)
    other = None if pair["other"] is None else _dense(pair["other"], MASK_WORDS)
    return Counts(_dense(pair["words"], MASK_WORDS), bins.reshape(len(FEATURES), HISTOGRAM_BINS), other)


def lobes_of_record(pair: Mapping[str, Any]) -> dict[str, Array]:
    """The mask histogram of each lobe that ``pair_record`` stored, (MASK_WORDS,) int64."""
    return {lobe: _dense(words, MASK_WORDS) for lobe, words in pair["lobes"].items()}


def _sparse(counts: Array) -> tuple[Array, Array]:
    """Places of the counts that are not zero, and these counts."""
    flat = np.asarray(counts, dtype=np.int64).ravel()
    used = np.flatnonzero(flat)
    return used, flat[used]


def _dense(sparse: Sparse, size: int) -> Array:
    """The inverse of ``_sparse``: (size,) int64."""
    counts = np.zeros(size, dtype=np.int64)
    counts[sparse[0]] = sparse[1]
    return counts
