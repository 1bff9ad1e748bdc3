"""The driver with a scripted engine: workers that die, units that fail, workers without OpenGL.  Needs no OpenGL."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from batch_tools import spec_of

from taubench_gl.batch.driver import Driver, Listener
from taubench_gl.batch.partition import PairRecord, decode, encode, frames_table, require_pyarrow
from taubench_gl.batch.store import Store
from taubench_gl.batch.units import ATTEMPTS, Event, Failed, Finished, Lost, NoGraphics, Slot, Unit
from taubench_gl.batch.worker import Worker
from taubench_gl.conventions import HISTOGRAM_BINS, Reason
from taubench_gl.errors import GraphicsError
from taubench_gl.features import COLUMNS, FEATURES, MASK_WORDS
from taubench_gl.metrics.counts import Counts, counts_of
from taubench_gl.run_schema import CAMERA_COLUMNS, EXACT_COLUMNS

PIXELS = 40  # 8x5
FRAMES = 20


def record(position: int) -> PairRecord:
    mask_histogram = np.zeros(MASK_WORDS, dtype=np.uint32)
    mask_histogram[0], mask_histogram[int(Reason.OUTSIDE)] = PIXELS - position, position
    histograms = np.zeros((len(FEATURES), HISTOGRAM_BINS), dtype=np.uint32)
    histograms[1, 30 + position] = 5
    camera = dict.fromkeys(CAMERA_COLUMNS, 0.0) | {"translation_m": 1.0}
    row = {"frame": position + 1, "time_s": (position + 1) / 24, **counts_of(mask_histogram), **camera, "gimbal": False}
    row |= {"direct": None, "lit": None, "shadowed": None}
    return PairRecord(position, row, Counts(mask_histogram, histograms))


def answer(unit: Unit) -> bytes:
    if unit.positions is None:
        facts = {
            "scene": {"name": "made", "sha256": "x"},
            "census": {},
            "lighting": {},
            "camera_source": "c",
            "notes": [],
        }
        views = {"positions": [[0.0, 0, i] for i in range(FRAMES)], "rotations": [np.eye(3).tolist()] * FRAMES}
        return json.dumps({"frames": [0, FRAMES], "facts": facts, **views}).encode()
    report = {
        "source": {"effects": {}, "memory": {"gpu_bytes": 1}, "notes": []},
        "brightness": {},
        "depths": [],
        "unmeasured": {c: "not requested" for c in COLUMNS if c not in ("frustum", "position")},
        "provenance": {"host": "h"},
        "passes_ms": {},
    }
    return encode([record(p) for p in unit.positions], report)


class Scripted:
    """``slots`` workers.  ``script(worker, unit)`` may return an event; otherwise the unit is finished."""

    def __init__(self, slots: int, script: Callable[[int, Unit], Event | None] = lambda worker, unit: None):
        self.script, self.in_flight, self.alive = script, {}, list(range(slots))
        self.seen: list[tuple[int, Unit]] = []
        self.last: dict[int, str] = {}

    def width(self) -> int:
        return max(len(self.alive), 1)

    def idle(self) -> list[Slot]:
        return [Slot(w, self.last.get(w)) for w in self.alive if w not in self.in_flight]

    def submit(self, slot: Slot, unit: Unit) -> None:
        assert slot.key not in self.in_flight
        self.in_flight[slot.key], self.last[slot.key] = unit, unit.job
        self.seen.append((slot.key, unit))

    def wait(self) -> list[Event]:
        worker, unit = self.in_flight.popitem()
        event = self.script(worker, unit) or Finished(unit, answer(unit))
        if isinstance(event, NoGraphics):
            self.alive.remove(worker)
        return [event]


class Recorder(Listener):
    def __init__(self):
        self.lines, self.pairs = [], {}

    def message(self, line):
        self.lines.append(line)

    def job_known(self, job, done, total):
        self.pairs[job.id] = done

    def pairs_done(self, job, pairs):
        self.pairs[job.id] += pairs


@pytest.fixture
def spec(tmp_path):
    for name in ("a.glb", "b.glb"):
        (tmp_path / name).write_text(name)
    return spec_of(tmp_path, 'scenes = ["a.glb", "b.glb"]\nsize = "8x5"')


@pytest.fixture
def drive(tmp_path, spec):
    def run(engine, out="out", chunk=4, listener=None):
        store = Store(tmp_path / out)
        store.save_spec(spec)
        return Driver(spec, store, listener, chunk).run(engine), store

    return run


def test_partitions_preserve_every_count():
    """Counts that are not measured are null."""
    records = [record(p) for p in (3, 5)]
    data = encode(records, {"host": "h"})
    back, report = decode(data)
    assert report == {"host": "h"}
    for ours, theirs in zip(records, back, strict=True):
        assert theirs.position == ours.position and theirs.row == dict.fromkeys(EXACT_COLUMNS) | ours.row
        np.testing.assert_array_equal(theirs.counts.mask_histogram, ours.counts.mask_histogram)
        np.testing.assert_array_equal(theirs.counts.histograms, ours.counts.histograms)
    table = require_pyarrow().parquet.read_table(io.BytesIO(data))
    for name in ("frame", "pixels", "translation_m"):  # a number changed by another program, with whole metadata
        place, values = table.column_names.index(name), table[name].to_pylist()
        wrong = require_pyarrow().array([values[0] + 1, *values[1:]], type=table.schema.field(name).type)
        sink = io.BytesIO()
        require_pyarrow().parquet.write_table(table.set_column(place, table.schema.field(name), wrong), sink)
        with pytest.raises(ValueError, match="written"):
            decode(sink.getvalue())
    for broken in (data[:-10], data[: len(data) // 2], b"", b"PAR1"):
        with pytest.raises(ValueError, match="partition"):
            decode(broken)
    table = frames_table([])
    assert table[:4] == b"PAR1" and require_pyarrow()


def test_every_unit_runs_once(drive, spec):
    recorder = Recorder()
    engine = Scripted(2)
    outcome, _ = drive(engine, listener=recorder)
    assert outcome.failed == {} and outcome.summary["done"] == 2
    assert recorder.pairs == {job.id: FRAMES - 1 for job in spec.jobs}
    assert len(engine.seen) == len({unit.key for _, unit in engine.seen}) == 2 * (1 + 5)
    for job in spec.jobs:
        counted = [p for _, unit in engine.seen if unit.job == job.id for p in unit.positions or ()]
        assert sorted(counted) == list(range(FRAMES - 1))
    # Run again: nothing to do.
    engine = Scripted(1)
    drive(engine)
    assert engine.seen == []


def test_a_unit_whose_worker_died_is_repeated(drive):
    deaths = iter([True, False, True])
    recorder = Recorder()
    script = lambda worker, unit: Lost(unit, "killed") if unit.positions and next(deaths, False) else None  # noqa: E731
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


def test_a_worker_without_opengl_is_reported_once(drive):
    recorder = Recorder()
    engine = Scripted(3, lambda w, unit: NoGraphics("worker 2", "no context", unit) if w == 2 else None)
    outcome, _ = drive(engine, listener=recorder)
    assert outcome.summary["done"] == 2
    (line,) = (line for line in recorder.lines if "OpenGL" in line)
    assert "worker 2" in line and "no context" in line


def test_no_worker_with_opengl_is_an_error(drive):
    with pytest.raises(GraphicsError, match="no context"):
        drive(Scripted(2, lambda w, unit: NoGraphics(f"worker {w}", "no context", unit)))


def test_pairs_of_a_damaged_partition_are_counted_again(drive, spec):
    _, store = drive(Scripted(1))
    before = (store.out / "summary.json").read_bytes()
    job = spec.jobs[0].id
    (store.job(job) / "summary.json").unlink()
    broken = sorted(store.pairs_folder(job).iterdir())[1]
    broken.write_bytes(broken.read_bytes()[:100])
    engine = Scripted(1)
    drive(engine)
    assert [unit.positions for _, unit in engine.seen] == [(4, 5, 6, 7)]
    assert (store.out / "summary.json").read_bytes() == before


def test_a_changed_scene_is_evaluated_from_scratch(drive, spec, tmp_path):
    drive(Scripted(1))
    (tmp_path / "a.glb").write_text("another scene")
    engine = Scripted(1)
    drive(engine)
    # Its head is the same here, so its pairs are kept; only the head is made again.
    assert [unit.positions for _, unit in engine.seen] == [None]

    def other(worker, unit):
        head = json.loads(answer(unit)) if unit.positions is None else None
        if head is None:
            return None
        head["facts"]["scene"]["sha256"] = "y"
        return Finished(unit, json.dumps(head).encode())

    (tmp_path / "a.glb").write_text("a third scene")
    engine = Scripted(1, other)
    drive(engine)
    assert sorted(p for _, unit in engine.seen for p in unit.positions or ()) == list(range(FRAMES - 1))


def test_a_scene_that_changes_while_its_head_is_computed_gets_a_new_head(drive, tmp_path):
    def meanwhile(worker, unit):
        if unit.positions is None:
            Path(unit.scene).write_text("another scene")

    drive(Scripted(1, meanwhile))
    for heads in (2, 0):  # of both scenes; then they are as they were
        engine = Scripted(1)
        drive(engine)
        assert [unit.positions for _, unit in engine.seen] == [None] * heads


def test_a_scene_that_changes_after_its_head_is_refused(tmp_path):
    from batch_tools import DEMO

    from taubench_gl.errors import SceneError
    from taubench_gl.settings import Settings

    settings = Settings(width=8, height=8, columns=("frustum",))
    with pytest.raises(SceneError) as caught:
        Worker().run(Unit("j", str(DEMO), settings, (0,), "another"))
    assert caught.value.where == str(DEMO)
