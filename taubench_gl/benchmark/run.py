"""Runs a suite: units on an engine of ``batch``, their results in a folder, resumed by running it again.

run.json             suite and methods of the folder
units/CASE-METHODS.json    result of a unit; appears complete or not at all; .failed: the reason.  Those of several
                           folders can be copied into one.
logs/                output of worker processes
benchmark.json, report.html, tables.*, speeds.*    written at the end (``output``)
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from taubench_gl import __version__
from taubench_gl.batch.engines import available_cores
from taubench_gl.batch.run import make_engine
from taubench_gl.batch.units import ATTEMPTS, Engine, Event, Failed, Finished, Lost, NoGraphics
from taubench_gl.benchmark.merge import merge
from taubench_gl.benchmark.output import write_results
from taubench_gl.benchmark.scenes import SceneRecipe, scene_file
from taubench_gl.benchmark.speed import BASELINE
from taubench_gl.benchmark.suite import Suite
from taubench_gl.benchmark.unit import FAILED, OTHER_SCENE, BenchmarkUnit, Entry
from taubench_gl.data_files import read_json
from taubench_gl.datasets.scene_cache import sha256_of
from taubench_gl.errors import GraphicsError, OutputError, SceneError, SettingsError
from taubench_gl.folder_lock import FolderLock
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.pathtraced.references import duration_text
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.reuse.fit import expand_methods
from taubench_gl.reuse.loading import builtin_methods

LIMIT_SIGNAL = "SIGALRM"
"""What ends a worker process at the limit (``BenchmarkUnit.limit``)."""

RUN_FILE, UNITS, LOGS = "run.json", "units", "logs"
Say = Callable[[str], None]


def entries_of(methods: Sequence[str]) -> tuple[Entry, ...]:
    """Methods of a benchmark: those given and ``none``; all built-in ones if none is given.  Raises SettingsError."""
    entries = [Entry.of(one) for text in methods or builtin_methods() for one in _expanded(text)]
    labels = [entry.label for entry in entries]
    if twice := next((label for label in labels if labels.count(label) > 1), None):
        raise SettingsError(f"method {twice!r} is given twice", hint="use other settings, NAME@setting=value")
    return tuple(entries if BASELINE in labels else [Entry.of(BASELINE), *entries])


def _expanded(text: str) -> list[str]:
    """The methods that one argument names: settings can have several values."""
    return [text] if is_sequence(text) else [spec.label for spec in expand_methods([text])]


def run_benchmark(
    suite: Suite,
    methods: Sequence[str],
    out: str | Path,
    *,
    engine: str | Engine | None = None,
    workers: int | None = None,
    limit: float | None = None,
    say: Say = lambda line: None,
) -> dict[str, Any]:
    """Run the missing units of ``suite`` in the folder ``out`` and write the results.  -> benchmark.json.

    Results do not depend on engine, workers or the order of units.  ``engine``: as for ``run_batch``, or an Engine;
    ``workers`` None: one process per core; ``limit``: seconds that a frame of all methods may take in a worker
    process.  Raises TaubenchError.
    """
    entries, folder = entries_of(methods), Path(out)
    workers = available_cores() if workers is None and engine is None else workers
    named = engine is None or isinstance(engine, str)
    made = make_engine(engine, workers, folder / LOGS, lambda event: None) if named else engine
    _require_own(folder, suite, entries, writing=False)
    output_folder(folder)
    with FolderLock(folder):
        _require_own(folder, suite, entries, writing=True)
        for entry in entries:
            if entry.label in builtin_methods() and Path(entry.label).exists():
                say(f"{entry.label} is the built-in method; write ./{entry.label} for the files of this folder")
        units, results = plan(suite, entries, say), Results(folder)
        units = [replace(unit, limit=limit if named else None) for unit in units]
        with made as running:
            say(f"{suite.name}: {len(suite.cases)} cases in {len(units)} units on {running.describe()}")
            _Driver(units, results, say).run(running)
        stored = {unit.identity: results.of(unit) for unit in units}
        summary = merge(suite, entries, stored, _scene_hashes(suite))
        write_results(summary, folder)
    return summary


def plan(suite: Suite, entries: Sequence[Entry], say: Say = lambda line: None) -> list[BenchmarkUnit]:
    """One unit per different case with all methods, those of most seeds first.  Writes scenes to the cache."""
    units: dict[str, BenchmarkUnit] = {}
    hashes = _scene_hashes(suite, say)
    for case in suite.cases:
        unit = BenchmarkUnit(case, tuple(entries), hashes[case.scene])
        units.setdefault(unit.identity, unit)
    return sorted(units.values(), key=lambda unit: -unit.case.seeds * unit.case.frames)


def _scene_hashes(suite: Suite, say: Say = lambda line: None) -> dict[SceneRecipe, str]:
    """sha256 of the file of every scene; missing ones are made."""
    recipes = list(dict.fromkeys(case.scene for case in suite.cases))
    say(f"{suite.name}: {len(recipes)} scenes")
    return {recipe: sha256_of(scene_file(recipe)) for recipe in recipes}


class Results:
    """Results of units in a folder, by case and method: it does not matter which methods a unit had."""

    def __init__(self, folder: Path):
        self._folder = folder / UNITS

    def path(self, unit: BenchmarkUnit, suffix: str = ".json") -> Path:
        return self._folder / f"{'-'.join(unit.key)}{suffix}"

    def save(self, unit: BenchmarkUnit, data: bytes) -> None:
        write_atomically(self.path(unit), data, parents=True)

    def fail(self, unit: BenchmarkUnit, reason: str) -> None:
        """A unit without a result: its methods have failed in this case.  It is run again with the next run."""
        methods = {entry.label: {"sha256": entry.sha256, "state": FAILED, "reason": reason} for entry in unit.entries}
        values = {"case": unit.job, "methods": methods, "times": {"methods": {}}}
        write_atomically(self.path(unit, ".failed"), json.dumps(values) + "\n", parents=True)

    def clear_failures(self) -> None:
        for path in self._folder.glob("*.failed"):
            path.unlink()

    def of(self, unit: BenchmarkUnit) -> dict[str, Any]:
        """What is stored of the unit's case, its methods in the order of ``unit``: facts, ``methods`` and ``times``.

        Files that cannot be read are removed, and their methods run again.
        """
        facts: dict[str, Any] = {}
        found: dict[tuple[str, str | None], Any] = {}
        times: dict[str, Any] = {}
        seconds = 0.0
        for path in sorted(self._folder.glob(f"{unit.key[0]}-*.*")):
            if path.suffix not in (".json", ".failed"):
                continue
            try:
                one = read_json(path, dict[str, Any])
            except OutputError:
                path.unlink(missing_ok=True)
                continue
            facts |= {name: value for name, value in one.items() if name not in ("methods", "times", "case")}
            found |= {(label, method["sha256"]): method for label, method in one["methods"].items()}
            times |= one["times"]["methods"]
            seconds += one["times"].get("seconds", 0.0)
        wanted = {entry.label: (entry.label, entry.sha256) for entry in unit.entries}
        methods = {label: found[key] for label, key in wanted.items() if key in found}
        spent = {"seconds": seconds, "methods": {label: times.get(label) for label in methods}}
        return {**facts, "methods": methods, "times": spent}

    def missing(self, unit: BenchmarkUnit) -> tuple[Entry, ...]:
        """Methods of a unit without a result."""
        known = self.of(unit)["methods"]
        return tuple(entry for entry in unit.entries if entry.label not in known)


def _require_own(folder: Path, suite: Suite, entries: Sequence[Entry], *, writing: bool) -> None:
    """Raises OutputError unless the folder is new, or of the same version and suite."""
    path = folder / RUN_FILE
    values = {"version": __version__, "suite": suite.describe()}
    if path.is_file():
        found = read_json(path, dict[str, Any])
        if any(found.get(name) != value for name, value in values.items()):
            given = found.get("suite") or {}
            what = f"holds suite {given.get('name')} ({given.get('sha256', '')[:8]}) of version {found.get('version')}"
            raise OutputError(what, where=str(folder), hint="give a new --out")
    elif folder.is_dir() and any(p.name not in (UNITS, LOGS) and not p.name.startswith(".") for p in folder.iterdir()):
        raise OutputError("holds other files and no benchmark", where=str(folder), hint="give --out a new folder")
    if writing:
        values["methods"] = [entry.label for entry in entries]
        write_atomically(path, json.dumps(values, indent=2) + "\n")


@dataclass(slots=True)
class _Driver:
    """Submits units until every one has a result."""

    units: Sequence[BenchmarkUnit]
    results: Results
    say: Say
    _pending: deque[BenchmarkUnit] = field(default_factory=deque)
    _in_flight: int = 0
    _lost: dict[tuple[str, str], int] = field(default_factory=dict)
    _alone: set[str] = field(default_factory=set)
    _done: int = 0
    _seconds: float = 0.0
    _measured: int = 0  # images that took ``_seconds``
    _left: int = 0  # images of units that are not finished

    def run(self, engine: Engine) -> None:
        """Raises GraphicsError if no worker with OpenGL is left, SceneError if one has another scene; finished units
        are kept."""
        self.results.clear_failures()
        for unit in self.units:
            if missing := self.results.missing(unit):
                self._pending.append(replace(unit, entries=missing))
                self._left += self._pending[-1].images
            else:
                self._done += 1
        if self._done:
            self.say(f"{self._done} units are stored")
        why = "all workers have ended"
        while self._pending or self._in_flight:
            for slot in engine.idle():
                if not self._pending:
                    break
                engine.submit(slot, self._next())
                self._in_flight += 1
            if not self._in_flight:
                hint = "finished units are kept; run it again on a machine with OpenGL"
                raise GraphicsError(f"no worker with OpenGL is left: {why}", hint=hint)
            for event in engine.wait():
                if isinstance(event, NoGraphics):
                    why = event.message
                self._handle(event, engine.width())

    def _next(self) -> BenchmarkUnit:
        """The next unit; methods that have ended a worker are in units of their own."""
        unit = self._pending.popleft()
        alone = [entry for entry in unit.entries if entry.label in self._alone]
        if not alone or len(unit.entries) == 1:
            return unit
        others = tuple(entry for entry in unit.entries if entry not in alone)
        parts = [(entry,) for entry in alone] + ([others] if others else [])
        self._pending.extendleft(replace(unit, entries=part) for part in parts)
        return self._pending.popleft()

    def _handle(self, event: Event, width: int) -> None:
        unit = event.unit
        if unit is None:
            return
        if isinstance(event, Lost) and LIMIT_SIGNAL in event.reason:
            reason = f"a frame took longer than {unit.limit:g} s (--time-limit)"
            event = replace(event, reason=reason, attempts=ATTEMPTS)
        if isinstance(event, Lost) and len(unit.entries) == 1:
            self._alone.add(unit.entries[0].label)
        self._in_flight -= 1
        if isinstance(event, Failed) and OTHER_SCENE in event.message:
            raise SceneError(event.message)  # the fault of a machine, not of the methods
        if isinstance(event, Finished):
            self.results.save(unit, event.data)
            self._finished(unit, json.loads(event.data)["times"].get("seconds", 0.0), width)
        elif isinstance(event, NoGraphics):
            self._pending.append(unit)
        elif isinstance(event, Lost) and len(unit.entries) > 1:
            self.say(f"{unit.job}: {event.reason}; its methods are repeated one by one")
            self._pending.extend(replace(unit, entries=(entry,)) for entry in unit.entries)
        elif isinstance(event, Lost) and self._attempt(unit, event) < ATTEMPTS:
            self._pending.append(unit)
        elif isinstance(event, Lost | Failed):
            reason = event.reason if isinstance(event, Lost) else event.message
            self._left -= unit.images
            self._done += 1
            self.results.fail(unit, reason)
            self.say(f"{self._count()} {unit.job}, {unit.name}: failed: {reason}")

    def _attempt(self, unit: BenchmarkUnit, event: Lost) -> int:
        self._lost[unit.key] = self._lost.get(unit.key, 0) + event.attempts
        return self._lost[unit.key]

    def _finished(self, unit: BenchmarkUnit, seconds: float, width: int) -> None:
        self._done, self._seconds, self._measured = (
            self._done + 1,
            self._seconds + seconds,
            self._measured + unit.images,
        )
        self._left -= unit.images
        left = self._seconds / self._measured * self._left / max(width, 1)
        rest = f"; about {duration_text(left)} left" if self._pending or self._in_flight else ""
        self.say(f"{self._count()} {unit.job}, {unit.name}: {seconds:.1f} s{rest}")

    def _count(self) -> str:
        """``3/14``: finished and all units."""
        return f"{self._done}/{self._done + len(self._pending) + self._in_flight}"
