"""The driver with a scripted engine: workers that die, units that fail.  Needs no OpenGL."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from batch_tools import DEMO, LIGHTING, spec_of
from fixed import fixed_settings

from taubench_gl.batch.merge import frames_table
from taubench_gl.batch.spec import Job
from taubench_gl.batch.study import BatchStudy, about_batch, batch_store
from taubench_gl.batch.units import HeadUnit, PairsUnit, counts_of_record, pair_record, pairs_unit
from taubench_gl.conventions import HISTOGRAM_BINS, Reason
from taubench_gl.errors import SceneError
from taubench_gl.features import COLUMNS, FEATURES, MASK_WORDS
from taubench_gl.metrics.counts import Counts
from taubench_gl.study.driver import Driver
from taubench_gl.study.progress import Listener
from taubench_gl.study.store import json_bytes
from taubench_gl.study.unit import ATTEMPTS, Event, Failed, Finished, Lost, Unit, Worker

PIXELS = 40  # 8x5
FRAMES = 20


def counts(position: int) -> Counts:
    mask_histogram = np.zeros(MASK_WORDS, dtype=np.uint32)
    mask_histogram[0], mask_histogram[int(Reason.OUTSIDE)] = PIXELS - position, position
    histograms = np.zeros((len(FEATURES), HISTOGRAM_BINS), dtype=np.uint32)
    histograms[1, 30 + position] = 5
    return Counts(mask_histogram, histograms)


FACTS = {"scene": {"name": "made", "sha256": "x"}, "census": {}, "lighting": {}, "camera_source": "c", "notes": []}
REPORT = {
    "source": {"effects": {}, "memory": {"gpu_bytes": 1}, "notes": []}, "brightness": {}, "depths": [],
    "unmeasured": {c: "not requested" for c in COLUMNS if c not in ("frustum", "position")},
    "provenance": {"host": "h"}, "passes_ms": {}, "added": [], "reprojection": "camera", "other": "equal",
}  # fmt: skip


def answer(unit: Unit) -> bytes:
    if isinstance(unit, HeadUnit):
        views = {"positions": [[0.0, 0, i] for i in range(FRAMES)], "rotations": [np.eye(3)] * FRAMES}
        return json_bytes({"stamp": unit.stamp, "frames": [0, FRAMES], "facts": FACTS, "lighting": {}} | views)
    return json_bytes({"report": REPORT, "pairs": [pair_record(p, counts(p), {}, {}) for p in unit.positions]})


def positions(unit: Unit) -> tuple[int, ...]:
    return unit.positions if isinstance(unit, PairsUnit) else ()


class Scripted:
    """``slots`` workers.  ``script(worker, unit)`` may return an event; otherwise the unit is finished."""

    def __init__(self, slots: int, script: Callable[[int, Unit], Event | None] = lambda worker, unit: None):
        self.script, self.in_flight, self.slots = script, {}, slots
        self.seen: list[tuple[int, Unit]] = []
        self.last: dict[int, str] = {}

    def width(self) -> int:
        return self.slots

    def idle(self) -> dict[int, str | None]:
        return {w: self.last.get(w) for w in range(self.slots) if w not in self.in_flight}

    def submit(self, worker: int, unit: Unit) -> None:
        assert worker not in self.in_flight
        self.in_flight[worker], self.last[worker] = unit, unit.job
        self.seen.append((worker, unit))

    def wait(self, advanced) -> list[Event]:
        worker, unit = self.in_flight.popitem()
        return [self.script(worker, unit) or Finished(unit, answer(unit))]


class Recorder(Listener):
    def __init__(self):
        self.lines, self.pairs = [], {}

    def message(self, line):
        self.lines.append(line)

    def job_known(self, job, label, done, total):
        self.pairs[job] = done

    def advanced(self, job, weight):
        self.pairs[job] = self.pairs.get(job, 0) + weight


@pytest.fixture
def spec(tmp_path):
    for name in ("a.glb", "b.glb"):
        (tmp_path / name).write_text(name)
    return spec_of(tmp_path, f'scenes = ["a.glb", "b.glb"]\nsize = "8x5"\n{LIGHTING}')


@pytest.fixture
def drive(tmp_path, spec):
    def run(engine, out="out", chunk=4, listener=None):
        store = batch_store(tmp_path / out)
        store.write_about(about_batch(spec))
        study = BatchStudy(spec, store, chunk)
        Driver(study, engine, listener or Listener()).run()
        return study.merge(), store

    return run


def test_records_preserve_every_count_and_damaged_ones_are_removed(tmp_path):
    store = batch_store(tmp_path)
    before = counts(3)
    data = json_bytes(pair_record(3, before, {}, {}))
    store.save("a/b", data)
    after = counts_of_record(store.load("a/b"))
    np.testing.assert_array_equal(after.mask_histogram, before.mask_histogram)
    np.testing.assert_array_equal(after.histograms, before.histograms)
    (file,) = tmp_path.glob("records/a/b.json")
    whole = file.read_bytes()
    # A number changed by another program, and files that a disk error cut.
    for broken in (whole.replace(b"37", b"38"), whole[:-10], whole[: len(whole) // 2], b"", b"{}"):
        assert broken != whole
        file.write_bytes(broken)
        assert store.load("a/b", remove=False) is None and file.exists()
        assert store.load("a/b") is None and not file.exists()
    assert frames_table([])[:4] == b"PAR1"


def test_every_unit_runs_once(drive, spec):
    recorder = Recorder()
    engine = Scripted(2)
    outcome, _ = drive(engine, listener=recorder)
    assert outcome.failed == {} and outcome.summary["done"] == 2
    assert recorder.pairs == {job.id: FRAMES - 1 for job in spec.jobs}
    assert len(engine.seen) == len({unit.key for _, unit in engine.seen}) == 2 * (1 + 5)
    for job in spec.jobs:
        counted = [p for _, unit in engine.seen if unit.job == job.id for p in positions(unit)]
        assert sorted(counted) == list(range(FRAMES - 1))
    # Run again: nothing to do.
    engine = Scripted(1)
    drive(engine)
    assert engine.seen == []


def test_a_unit_whose_worker_died_is_repeated(drive):
    deaths = iter([True, False, True])
    recorder = Recorder()
    script = lambda worker, unit: Lost(unit, "killed") if positions(unit) and next(deaths, False) else None  # noqa: E731
    outcome, _ = drive(Scripted(2, script), "lost", listener=recorder)
    expected, _ = drive(Scripted(1), "plain", chunk=7)
    assert outcome == expected
    assert sum("killed" in line for line in recorder.lines) == 2


def test_a_unit_that_kills_every_worker_fails_its_job(drive, spec):
    bad = spec.jobs[0].id
    engine = Scripted(2, lambda worker, unit: Lost(unit, "killed", "end of its output") if unit.job == bad else None)
    outcome, store = drive(engine)
    assert list(outcome.failed) == [bad] and outcome.summary["done"] == 1
    assert sum(unit.job == bad for _, unit in engine.seen) == ATTEMPTS
    assert "3 times" in outcome.failed[bad] and "end of its output" in store.log_file(bad).read_text()


def test_a_failing_scene_fails_alone_and_is_repeated_in_the_next_run(drive, spec):
    bad = spec.jobs[1].id
    engine = Scripted(2, lambda w, unit: Failed(unit, "x.glb: broken", "Traceback") if unit.job == bad else None)
    outcome, store = drive(engine)
    assert outcome.failed == {bad: "x.glb: broken"}
    assert [job["state"] for job in outcome.summary["jobs"]] == ["done", "failed"]
    assert outcome.summary["jobs"][1]["reason"] == "x.glb: broken"
    engine = Scripted(1)
    outcome, store = drive(engine)
    assert outcome.failed == {} and {unit.job for _, unit in engine.seen} == {bad}
    assert store.failure(bad) is None


def test_pairs_of_a_damaged_partition_are_counted_again(drive, spec):
    _, store = drive(Scripted(1))
    before = (store.out / "summary.json").read_bytes()
    job = spec.jobs[0].id
    (store.out / "jobs" / job / "summary.json").unlink()
    broken = sorted((store.out / "records" / job).glob("pairs-*"))[1]
    broken.write_bytes(broken.read_bytes()[:100])
    engine = Scripted(1)
    drive(engine)
    assert [positions(unit) for _, unit in engine.seen] == [(4, 5, 6, 7)]
    assert (store.out / "summary.json").read_bytes() == before


def test_a_changed_scene_is_evaluated_from_scratch(drive, spec, tmp_path):
    drive(Scripted(1))
    (tmp_path / "a.glb").write_text("another scene")
    engine = Scripted(1)
    drive(engine)
    # Its head is the same here, so its pairs are kept; only the head is made again.
    assert [unit.name for _, unit in engine.seen] == ["head"]

    def other(worker, unit):
        if not isinstance(unit, HeadUnit):
            return None
        head = json.loads(answer(unit))
        head["facts"]["scene"]["sha256"] = "y"
        return Finished(unit, json_bytes(head))

    (tmp_path / "a.glb").write_text("a third scene")
    engine = Scripted(1, other)
    drive(engine)
    assert sorted(p for _, unit in engine.seen for p in positions(unit)) == list(range(FRAMES - 1))


def test_a_scene_that_changes_while_its_head_is_computed_gets_a_new_head(drive, tmp_path):
    def meanwhile(worker, unit):
        if isinstance(unit, HeadUnit):
            Path(unit.scene).write_text("another scene")

    drive(Scripted(1, meanwhile))
    for heads in (2, 0):  # of both scenes; then they are as they were
        engine = Scripted(1)
        drive(engine)
        assert [unit.name for _, unit in engine.seen] == ["head"] * heads


def test_a_scene_that_changes_after_its_head_is_refused():
    job = Job("j", str(DEMO), fixed_settings(width=8, height=8, columns=("frustum",)), {})
    head = {"frames": [0, 2], "facts": {"scene": {"sha256": "another"}}, "lighting": {}}
    unit = pairs_unit(job, (0,), head)
    with pytest.raises(SceneError) as caught:
        unit.run(Worker())
    assert caught.value.where == str(DEMO)
