"""Runs a suite as a study: a job per case with all methods, and what its records give together.

Records are by case and methods; it does not matter which methods a unit had.  Those of several folders can be copied
into one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from taubench_gl.benchmark.merge import merge
from taubench_gl.benchmark.output import write_results
from taubench_gl.benchmark.scenes import SceneRecipe, not_run, scene_file
from taubench_gl.benchmark.scores import BASELINE
from taubench_gl.benchmark.suite import Suite
from taubench_gl.benchmark.unit import FAILED, OTHER_SCENE, BenchmarkUnit, Entry, loaded, record_key
from taubench_gl.datasets.scene_cache import sha256_of
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.reuse.fit import expand_methods
from taubench_gl.reuse.generated import LAST_RENDERED
from taubench_gl.reuse.loading import builtin_methods, method_text
from taubench_gl.study.driver import run_study
from taubench_gl.study.engines import available_cores
from taubench_gl.study.progress import Listener
from taubench_gl.study.store import Store
from taubench_gl.study.study import Study

SCHEMA = "taubench-gl/benchmark-study/2"

SAMPLES = "samples"
"""The track of methods that sample lights where none is named."""

FILTERED = "restir-di>svgf"
"""A filter of a sampled image, which runs in the track SAMPLES too."""


def entries_of(methods: Sequence[str]) -> tuple[Entry, ...]:
    """The named methods and ``none``, beside methods that generate frames ``present-last``; without a name all built-in
    methods.  Raises SettingsError."""
    names = methods or (*builtin_methods(), FILTERED)
    entries = [Entry.of(method) for text in names for method in _expanded(text)]
    if not methods:
        entries = [replace(entry, track=SAMPLES) if loaded(entry).own_light else entry for entry in entries]
    labels = [entry.label for entry in entries]
    if twice := next((label for label in labels if labels.count(label) > 1), None):
        raise SettingsError(f"method {twice!r} is given twice", hint="use other settings, NAME@setting=value")
    generates = any(method.generates for method in map(loaded, entries) if method)
    baselines = (BASELINE, LAST_RENDERED) if generates else (BASELINE,)
    return (*(Entry.of(name) for name in baselines if name not in labels), *entries)


def _expanded(text: str) -> list[str]:
    """The methods that one argument names: settings can have several values."""
    if is_sequence(text):
        return [text]
    name = text.partition("@")[0]
    return [method_text(name, spec.settings) for spec in expand_methods([text])]


class BenchmarkStudy(Study):
    """The cases of a suite in a folder."""

    def __init__(self, suite: Suite, entries: Sequence[Entry], out: str | Path, limit: float | None = None):
        """A benchmark in the folder ``out``; ``limit``: seconds that a frame of all methods may take in a worker."""
        super().__init__(Store(out, "benchmark", SCHEMA))
        self.suite, self.entries, self._limit = suite, tuple(entries), limit
        self._deadly: set[str] = set()  # methods in which a worker has died: they run alone
        self._failed: dict[tuple[str, str], str] = {}  # job and method -> why it failed

    @cached_property
    def scenes(self) -> dict[SceneRecipe, str]:
        """sha256 of the file of every scene; missing ones are made."""
        recipes = dict.fromkeys(case.scene for case in self.suite.cases)
        return {recipe: sha256_of(scene_file(recipe)) for recipe in recipes}

    @cached_property
    def units(self) -> dict[str, BenchmarkUnit]:
        """One unit per different case with all methods, by job; units of most images first."""
        units: dict[str, BenchmarkUnit] = {}
        for case in self.suite.cases:
            unit = BenchmarkUnit.of(case, self.entries, self.scenes[case.scene], self._limit)
            units.setdefault(unit.identity, unit)
        return {unit.job: unit for unit in sorted(units.values(), key=lambda unit: -unit.weight)}

    def missing(self, job: str, width: int) -> tuple[Sequence[BenchmarkUnit], int]:
        unit = self.units[job]
        stored = self.result(unit)["methods"]
        left = tuple(entry for entry in unit.entries if entry.label not in stored)
        return [unit.part(left)] if left else [], unit.weight

    def instead(self, unit: BenchmarkUnit, died: bool) -> Sequence[BenchmarkUnit]:
        # A dead worker does not say which method ended it: all methods of its unit run alone, and the one that ends a
        # worker again is kept apart in all later units, which would lose the results of the others with it.
        if len(unit.entries) == 1:
            self._deadly |= {unit.name} if died else set()
            return (unit,)
        alone = [entry for entry in unit.entries if died or entry.label in self._deadly]
        others = tuple(entry for entry in unit.entries if entry not in alone)
        return [unit.part(part) for part in (*((entry,) for entry in alone), others) if part]

    def fail(self, unit: BenchmarkUnit, message: str, details: str) -> bool:
        if OTHER_SCENE in message:
            raise SceneError(message)  # the fault of a machine, not of the methods
        self.store.log_failure(unit.key, message, details)
        self._failed |= {(unit.job, entry.label): message for entry in unit.entries}
        return True

    def merge(self) -> dict[str, Any]:
        stored = {unit.identity: self.result(unit) for unit in self.units.values()}
        summary = merge(self.suite, self.entries, stored, self.scenes)
        write_results(summary, self.store.out)
        return summary

    def result(self, unit: BenchmarkUnit) -> dict[str, Any]:
        """What records tell about the unit's case: its facts, ``methods`` in the order of the unit, and ``times``."""
        facts: dict[str, Any] = {}
        methods: dict[tuple[str, str | None], Any] = {}
        times: dict[str, Any] = {}
        seconds = 0.0
        # Earlier runs, and other folders, have had other methods: every record of the case counts.
        for record in self.store.find(record_key(unit.identity, "*")):
            facts |= {name: value for name, value in record.items() if name not in ("methods", "times", "case")}
            methods |= {(label, method["sha256"]): method for label, method in record["methods"].items()}
            times |= record["times"]["methods"]
            seconds += record["times"].get("seconds", 0.0)
        results = {}
        for entry in unit.entries:
            if (reason := self._failed.get((unit.job, entry.label))) is not None:
                results[entry.label] = {"sha256": entry.sha256, "state": FAILED, "reason": reason}
            elif (entry.label, entry.sha256) in methods:
                results[entry.label] = methods[entry.label, entry.sha256]
        return {**facts, "methods": results,
                "times": {"seconds": seconds, "methods": {label: times.get(label) for label in results}}}  # fmt: skip


def runnable(suite: Suite, say: Callable[[str], None]) -> Suite:
    """The cases whose scenes this machine can make; ``say`` gets a line for each other scene."""
    reasons = {recipe: not_run(recipe) for recipe in dict.fromkeys(case.scene for case in suite.cases)}
    for recipe, reason in reasons.items():
        if reason is not None:
            say(f"{recipe.source}: not run: {reason}")
    return suite.part([case.id for case in suite.cases if reasons[case.scene] is None])


def run_benchmark(
    suite: Suite,
    methods: Sequence[str],
    out: str | Path,
    *,
    workers: int | None = None,
    limit: float | None = None,
    listener: Listener | None = None,
) -> dict[str, Any]:
    """Run the missing units of ``suite`` in the folder ``out`` and write the results.  -> the values of benchmark.json.

    Results do not depend on workers or the order of units.  ``workers``: as of ``run_study``, None: one process per
    core; ``limit``: seconds that a frame of all methods may take in a worker process.  Raises
    TaubenchError.
    """
    entries, listener = entries_of(methods), listener or Listener()
    suite = runnable(suite, listener.message)
    workers = available_cores() if workers is None else workers
    about = {"suite": suite.describe(), "methods": [entry.label for entry in entries]}
    for entry in entries:
        if entry.label in builtin_methods() and Path(entry.label).exists():
            line = f"{entry.label} is the built-in method; write ./{entry.label} for the files of this folder"
            listener.message(line)
    study = BenchmarkStudy(suite, entries, out, limit)
    return run_study(study, about, ("suite",), workers=workers, listener=listener)
