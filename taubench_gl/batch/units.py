"""Units of a job: its head, all that needs no pair, and its pairs in chunks; and the records that they write.

    head     {"stamp", "frames", "facts", "lighting", "positions", "rotations"}
    pairs    {"report": of the worker, "pairs": [{"position", "words", "bins", "lobes", "added": columns of adders}]}

Counts are sparse, [places, counts]: of reason words in ``words`` and in each of ``lobes``; of histogram bins in
``bins``, feature * bins + bin in the order of ``features.FEATURES``.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taubench_gl.animation import camera_of_run
from taubench_gl.batch.spec import Job
from taubench_gl.conventions import HISTOGRAM_BINS
from taubench_gl.errors import SceneError
from taubench_gl.evaluation import (
    LightVisits,
    ResolvedLighting,
    SceneInput,
    Session,
    Wants,
    checked_frames,
    environment_image,
    file_hashes,
    files_identity,
    frame_range,
    frame_schedule,
    open_scene,
    pair_schedule,
    scene_facts,
)
from taubench_gl.features import FEATURES, MASK_WORDS
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.metrics.counts import Counts
from taubench_gl.provenance import provenance
from taubench_gl.scene import load_scene
from taubench_gl.settings import AUTO, Settings
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
    """All of a job that needs no pair.  ``stamp``: ``file_stamp`` of the scene before it is read."""

    of: Job
    stamp: list[int] | None

    def run(self, worker: Worker) -> bytes:
        worker.release()  # the scene may have changed
        loaded = _loaded(worker, self.of)
        if self.of.settings.lighting.exposure == AUTO:
            open_context(self.of.settings)  # its exposure may have to be metered
        return json_bytes(_head_record(loaded, self.of.settings, self.stamp))


@dataclass(frozen=True, slots=True, kw_only=True)
class PairsUnit(Unit):
    """Pairs of a job whose lighting is resolved.

    ``positions``: ascending, among the job's pairs; empty for a job without pairs, whose frames are rendered all the
    same.  ``sha256``: of the files when the head was made (``evaluation.files_identity``).
    """

    of: Job
    positions: tuple[int, ...]
    sha256: str | None

    def run(self, worker: Worker) -> bytes:
        started = time.perf_counter()
        loaded = _unchanged(worker, self.of, self.sha256)
        pairs, report = self._count(loaded, worker)
        report["provenance"] |= {"host": platform.node(), "pid": os.getpid(), "seconds": time.perf_counter() - started}
        return json_bytes({"report": report, "pairs": pairs})

    def _count(self, loaded: _Loaded, worker: Worker) -> tuple[list[dict[str, Any]], dict[str, Any]]:
        session, settings = loaded.opened(self.of), self.of.settings
        session.timer.reset()
        frames = session.given.frames
        schedule = pair_schedule(frames, self.positions) if self.positions else frame_schedule(frames, settings)
        evaluated = []
        checked = checked_frames(frame_schedule(frames, settings))
        for pair in session.pairs(schedule, checked, continued=True):
            evaluated.append(pair.evaluated)
            worker.done()
        pairs = [
            pair_record(position, pair.counts, pair.lobes, {name: row[name] for name in session.added_columns})
            for position, pair, row in zip(self.positions, evaluated, session.rows, strict=True)
        ]
        return pairs, _report(session)


@dataclass(frozen=True, slots=True, kw_only=True)
class LightUnit(Unit):
    """One visit of sampled light: ``visit``, the position of its pair and the number of the visit."""

    of: Job
    visit: tuple[int, int]
    sha256: str | None

    def run(self, worker: Worker) -> bytes:
        loaded = _unchanged(worker, self.of, self.sha256)
        return json_bytes(loaded.visits(self.of).visit(*self.visit).record())


def head_unit(job: Job, stamp: list[int] | None) -> HeadUnit:
    return HeadUnit(job=job.id, key=head_key(job.id), name="head", scene=job.scene, of=job, stamp=stamp)


def pairs_unit(job: Job, positions: tuple[int, ...], head: Mapping[str, Any]) -> PairsUnit:
    """``job``: with the lighting of its ``head``."""
    ends = f"{positions[0]:06d}-{positions[-1]:06d}" if positions else "none"
    name = f"pairs {positions[0]} to {positions[-1]}" if positions else "frames without pairs"
    sha256 = files_identity(head["facts"]["scene"])
    return PairsUnit(job=job.id, key=pairs_key(job.id, ends, head), name=name, scene=job.scene, weight=len(positions),
                     of=job, positions=positions, sha256=sha256)  # fmt: skip


def light_unit(job: Job, visit: tuple[int, int], head: Mapping[str, Any]) -> LightUnit:
    """``job``: with the lighting of its ``head``."""
    name = f"light of pair {visit[0]}"
    return LightUnit(job=job.id, key=light_key(job.id, visit, head), name=name, scene=job.scene, weight=0, of=job,
                     visit=visit, sha256=files_identity(head["facts"]["scene"]))  # fmt: skip


def light_key(job: str, visit: tuple[int, int], head: Mapping[str, Any]) -> str:
    """Of the record of a visit."""
    return f"{job}/light-{visit[0]:06d}-{visit[1]:04d}-{head_hash(head)}"


def head_key(job: str) -> str:
    """Of the record of a job's head."""
    return f"{job}/head"


def pairs_key(job: str, ends: str, head: Mapping[str, Any]) -> str:
    """Of a record of pairs.  ``ends``: first and last position, or a pattern."""
    return f"{job}/pairs-{ends}-{head_hash(head)}"


def head_hash(head: Mapping[str, Any]) -> str:
    """Of everything in a head that the counts of pairs depend on."""
    return content_hash([head[name] for name in ("frames", "facts", "lighting")])


@dataclass(slots=True)
class _Loaded:
    """A scene and, once it renders, its session: what a worker keeps for the next unit of a job."""

    animated: AnimatedScene
    session: Session | None = None
    light: LightVisits | None = None

    def opened(self, job: Job) -> Session:
        """The session of a job whose lighting is resolved."""
        if self.session is None:
            frames = frame_range(self.animated.scene, self.animated.camera, job.settings)
            scene_input = SceneInput(self.animated, frames, ResolvedLighting(job.settings))
            self.session = Session(scene_input, Wants(lobes=job.lobes, sampled=True))
        return self.session

    def visits(self, job: Job) -> LightVisits:
        """The sampled light of a job whose lighting is resolved."""
        session = self.opened(job)
        if self.light is None:
            self.light = session.open_light()
        return self.light

    def release(self) -> None:
        if self.session is not None:
            self.session.release()


def _unchanged(worker: Worker, job: Job, sha256: str | None) -> _Loaded:
    """The scene of a job whose lighting is resolved.  Raises SceneError if its files have changed since its head."""
    open_context(job.settings)
    loaded = _loaded(worker, job)
    if sha256 != files_identity(file_hashes(loaded.animated.scene, job.settings)):
        raise SceneError("changed while the batch was running", where=job.scene, hint="run the batch again")
    return loaded


def _loaded(worker: Worker, job: Job) -> _Loaded:
    sequence = job.settings.sequence

    def load() -> _Loaded:
        scene = load_scene(job.scene, **sequence.reading)
        return _Loaded(AnimatedScene(scene, camera_of_run(scene, sequence), fps=sequence.fps))

    return worker.kept((job.id, job.scene, *sequence.reading.values(), sequence.camera), load)


def _head_record(loaded: _Loaded, settings: Settings, stamp: list[int] | None) -> dict[str, Any]:
    """All of the summary that needs no pair, and the camera poses of all frames in full precision.

    ``lighting``: the settings of ``LIGHTING``, resolved for all units of the job.
    """
    scene = loaded.animated.scene
    given = open_scene(scene, settings, loaded.animated.camera, sampled=True)
    frames, animated, resolved = given.frames, given.animated, given.lighting
    views = [animated.view_at(frame / settings.sequence.fps) for frame in frames]
    # A .glb may refer to images and buffers in other files, whose changes its stamp does not show.
    one_file = scene.files == 1 and environment_image(resolved.settings) is None
    return {
        "stamp": stamp if one_file else None,
        "frames": [frames.start, frames.stop],
        "facts": scene_facts(animated, frames, resolved),
        "lighting": {name: resolved.settings.to_dict()[name] for name in LIGHTING},
        "positions": [view.position for view in views],
        "rotations": [view.world_from_view for view in views],
    }


def resolved_job(job: Job, head: Mapping[str, Any]) -> Job:
    """``job`` with the lighting that its head resolved."""
    lighting = {name: tuple(v) if isinstance(v, list) else v for name, v in head["lighting"].items()}
    return replace(job, settings=job.settings.replace(**lighting))


def _report(session: Session) -> dict[str, Any]:
    """What a session measured besides the counts."""
    with session.gpu:
        session.gpu.check("a chunk of a batch")
        return {
            "source": session.source.describe(),
            "brightness": session.brightness.as_dict(),
            "depths": session.depths,
            "unmeasured": dict(session.source.unmeasured),
            "added": session.added_columns,
            "reprojection": session.source.reprojection,
            "provenance": provenance(session.gpu, session.timer.clock),
            "passes_ms": session.timer.median_ms(),
        }


# --------------------------------------------------------------------------------------------------------------- counts
def pair_record(position: int, counts: Counts, lobes: Mapping[str, Array], added: Mapping[str, Any]) -> dict[str, Any]:
    """A counted pair as its record has it.  ``added``: the columns of column adders."""
    return {
        "position": position,
        "words": _sparse(counts.mask_histogram),
        "bins": _sparse(counts.histograms),
        "lobes": {lobe: _sparse(histogram) for lobe, histogram in lobes.items()},
        "added": dict(added),
    }


def counts_of_record(pair: Mapping[str, Any]) -> Counts:
    """The inverse of ``pair_record``.  Raises IndexError or ValueError for counts in places that there are not."""
    bins = _dense(pair["bins"], len(FEATURES) * HISTOGRAM_BINS)
    return Counts(_dense(pair["words"], MASK_WORDS), bins.reshape(len(FEATURES), HISTOGRAM_BINS))


def lobes_of_record(pair: Mapping[str, Any]) -> dict[str, Array]:
    """Lobe -> mask histogram."""
    return {lobe: _dense(words, MASK_WORDS) for lobe, words in pair["lobes"].items()}


def _sparse(counts: Array) -> tuple[Array, Array]:
    flat = np.asarray(counts, dtype=np.int64).ravel()
    used = np.flatnonzero(flat)
    return used, flat[used]


def _dense(sparse: Sparse, size: int) -> Array:
    counts = np.zeros(size, dtype=np.int64)
    counts[sparse[0]] = sparse[1]
    return counts
