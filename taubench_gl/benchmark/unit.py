"""A unit of work: all methods, or some, on one case.  It needs no other unit, and its result is plain JSON.

Methods of a unit share its frames and reference but nothing else: the result of a method does not depend on which
other methods run beside it, so units merge in any order.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.benchmark.scenes import scene_file
from taubench_gl.benchmark.suite import Case
from taubench_gl.data_files import hashed
from taubench_gl.datasets.scene_cache import sha256_of
from taubench_gl.errors import MethodError, SceneError, SettingsError
from taubench_gl.pathtraced.sequence import PREFIX, is_sequence
from taubench_gl.reuse.chain import LINK
from taubench_gl.reuse.contract import REFERENCE_INPUT, Method
from taubench_gl.reuse.evaluate import EvaluatedFrame, Evaluation, evaluate_methods
from taubench_gl.reuse.inputs import missing_inputs
from taubench_gl.reuse.loading import BUILTIN, MethodSpec, builtin_methods, load_method
from taubench_gl.reuse.quality import MEASURES
from taubench_gl.study.store import content_hash, json_bytes
from taubench_gl.study.unit import Unit, Worker
from taubench_gl.study.worker import open_context

DIVERGED = 100.0
"""A method diverges if the mean absolute radiance of an image is more than this times the largest one of any input or
reference so far.  A blend of input and history is at most 1."""

OTHER_SCENE = "is not the scene of this benchmark"
FAILED, INAPPLICABLE = "failed", "not applicable"

OF_KIND = ("samples", "generated")
"""Blocks that methods of a kind have: those that sample lights, and those that generate frames."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A method of the benchmark.

    ``text``: for MethodSpec.parse, with absolute paths; ``sha256``: of the method's files, None where it has no files
    of its own; ``track``: the only track that it runs in, empty for all.
    """

    label: str
    text: str
    sha256: str | None
    track: str = ""

    @classmethod
    def of(cls, text: str) -> Entry:
        """The entry that ``text`` names.  Raises SettingsError for text that is not a method; one that cannot be loaded
        fails later, alone.
        """
        spec = MethodSpec.parse(text)
        if LINK in text:
            links = [cls.of(part) for part in text.split(LINK)]
            return cls(spec.label, LINK.join(e.text for e in links), content_hash([e.sha256 for e in links]))
        name, at, settings = text.partition("@")
        if is_sequence(name):
            folder = Path(os.path.realpath(name.removeprefix(PREFIX)))
            return cls(spec.label, f"{PREFIX}{folder}{at}{settings}", _files_sha256(folder))
        if name in builtin_methods():
            return cls(spec.label, text, _files_sha256(BUILTIN / name))
        file, colon, of_class = name.rpartition(":")
        path = Path(file if colon and file.endswith(".py") else name)
        if not path.exists():
            return cls(spec.label, text, None)
        class_name = f":{of_class}" if path != Path(name) else ""
        content = path.parent if path.name == "method.toml" else path
        return cls(spec.label, f"{path.resolve()}{class_name}{at}{settings}", _files_sha256(content))


def _files_sha256(path: Path) -> str:
    """Hash of names and contents of a file, or of all files of a folder."""
    digest = hashlib.sha256()
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file() and p.suffix != ".pyc")
    for file in files:
        digest.update(os.fsencode(file.relative_to(path)) + b"\0")
        hashed(file, digest=digest)
    return digest.hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkUnit(Unit):
    """Methods on one case.  ``sha256``: of the scene's file, which the worker checks; ``identity``: of the case."""

    case: Case
    entries: tuple[Entry, ...]
    sha256: str
    identity: str

    @classmethod
    def of(cls, case: Case, entries: tuple[Entry, ...], sha256: str, limit: float | None = None) -> BenchmarkUnit:
        """A unit whose weight is the number of images that it evaluates, without those of references."""
        identity = case.identity(sha256)
        methods = content_hash([[e.label, e.sha256, *([e.track] if e.track else [])] for e in entries])
        return cls(
            job=case.id,
            key=record_key(identity, methods),
            name=f"{len(entries)} methods" if len(entries) > 1 else entries[0].label,
            scene=case.scene.source,
            weight=case.evaluated_frames * case.request.seeds * len(entries),
            limit=limit,
            case=case,
            entries=entries,
            sha256=sha256,
            identity=identity,
        )

    def part(self, entries: tuple[Entry, ...]) -> BenchmarkUnit:
        """The unit with some of its methods."""
        return self.of(self.case, entries, self.sha256, self.limit)

    def run(self, worker: Worker) -> bytes:
        started = time.perf_counter()
        path = scene_file(self.case.scene)
        if sha256_of(path) != self.sha256:
            hint = "the files or versions of this machine are other ones; clear its cache, or run everything on one"
            raise SceneError(OTHER_SCENE, where=str(path), hint=hint)
        open_context(self.case.settings)
        result = evaluate_case(self.case, self.entries, path, lambda: worker.done(len(self.entries)))
        for entry in self.entries:
            result["methods"][entry.label]["sha256"] = entry.sha256
        result["times"]["seconds"] = time.perf_counter() - started
        return json_bytes(result)


def record_key(identity: str, methods: str) -> str:
    """Key of the record of a result.  ``identity``: of the case; ``methods``: hash of the methods, or a pattern."""
    return f"{identity[:16]}-{methods}"


@dataclass(slots=True)
class _Divergence:
    """Finds methods that diverge, frame by frame.  ``reasons``: why a method diverges, by label."""

    reasons: dict[str, str] = field(default_factory=dict)
    _largest: float = 0.0

    def add(self, evaluated: EvaluatedFrame) -> None:
        means = {name: float(np.mean(np.abs(np.nan_to_num(image)))) for name, image in evaluated.radiance.items()}
        # Of all frames so far: a method may keep history that is brighter than the current frame.
        self._largest = max(self._largest, means.pop("input"), means.pop("reference"))
        for label, mean in means.items():
            if mean > DIVERGED * self._largest > 0:
                factor = f"in frame {evaluated.frame} its mean radiance is {mean / self._largest:.3g} times"
                self.reasons.setdefault(label, f"diverges: {factor} the largest of any input or reference")


def evaluate_case(
    case: Case, entries: Sequence[Entry], path: Path, on_frame: Callable[[], None] = lambda: None
) -> dict[str, Any]:
    """The result of ``entries`` on a case, as JSON holds it.  All times are in the block ``times``.

    ``on_frame`` is called after every frame.
    """
    refused = {entry.label: why for entry in entries if (why := inapplicable(case, entry))}
    methods: dict[str, Any] = {label: {"state": INAPPLICABLE, "reason": why} for label, why in refused.items()}
    out: dict[str, Any] = {"case": case.id, "methods": methods, "times": {"methods": {}}}
    specs = applicable(case, entries)
    if not specs:
        return out
    divergence = _Divergence()

    def look(evaluated: EvaluatedFrame) -> None:
        on_frame()
        divergence.add(evaluated)

    try:
        done = evaluate_methods(path, specs, case.settings, on_frame=look, **asdict(case.request))
    except MethodError as error:  # none could be loaded
        if len(specs) > 1:
            raise
        methods[specs[0].label] = {"state": FAILED, "reason": str(error)}
        return out
    for label in (spec.label for spec in specs):  # present-last stands beside methods that generate frames
        method = done.summary["methods"][label]
        methods[label] = _method(done, label, method, divergence.reasons.get(label))
        out["times"]["methods"][label] = method.get("time_ms")
    summary = done.summary
    reference = summary["reference"]
    out["input"] = {name: summary["input"][name] for name in ("kind", "light_samples", "path_samples", "size")}
    out["reference"] = {n: reference.get(n) for n in ("kind", "samples", "noise", "noise_mse", "noise_db")}
    out["exposure"] = summary["settings"]["exposure"]
    provenance = summary["provenance"]
    out["provenance"] = {
        name: provenance[name] for name in ("version", "definitions", "renderer", "driver", "git", "clock")
    }
    return out


def _method(done: Evaluation, label: str, method: Mapping[str, Any], diverges: str | None) -> dict[str, Any]:
    """The result of one method.  ``method``: its block of reuse.json; ``diverges``: why, None if it does not."""
    facts = {name: method[name] for name in ("title", "cite", "settings", "memory_bytes")}
    if method["failed"] or diverges:
        return {"state": FAILED, "reason": method["failed"] or diverges, **facts}
    names = ("seed", "frame", *(name for name in MEASURES))
    rows = [{name: row[name] for name in names} for row in done.rows if row["method"] == label]
    blocks = {n: method[n] for n in ("mean", "tail_percent", "emitters", "classes", "bound", "reuse", "reasons")}
    warmup = done.summary["warmup"]
    blocks |= {name: method[name] for name in OF_KIND if name in method}
    blocks["response"] = {
        event: {k: v for k, v in e.items() if k != "curve"} for event, e in method["response"].items()
    }
    return {"state": "done", "reason": None, **facts, **blocks, "warmup": warmup, "rows": rows}


def inapplicable(case: Case, entry: Entry) -> str | None:
    """Why a method does not apply to a case: its input is missing there.  None: it applies, or fails for another
    reason."""
    if entry.track not in ("", case.track):
        return f"runs in track {entry.track} alone unless it is named"
    method, name = loaded(entry), entry.text.partition("@")[0]
    generates = method is not None and method.generates is not None
    if generates != case.generated and (method or is_sequence(name)):
        return "generates frames" if generates else "generates no frames"
    if is_sequence(name):
        return None if _frames_of(case, name).is_dir() else f"has no frames in {_frames_of(case, name)}"
    missing = missing_inputs(case.kind, traced=bool(case.kind.path_samples))
    if case.kind.upscale != 1:
        missing[REFERENCE_INPUT] = "the reference has the size of the output"
    lost = [name for name in (method.reads if method else ()) if name in missing]
    return f"no {', '.join(lost)}: {missing[lost[0]]}" if lost else None


def applicable(case: Case, entries: Sequence[Entry]) -> list[MethodSpec]:
    """The methods that a case evaluates."""
    return [_spec(case, entry) for entry in entries if inapplicable(case, entry) is None]


def _frames_of(case: Case, text: str) -> Path:
    """Folder of the frames of a case made elsewhere: ``exr:DIR`` has one folder per case."""
    return Path(text.removeprefix(PREFIX)) / case.id.replace("/", "_")


def _spec(case: Case, entry: Entry) -> MethodSpec:
    """The method of an entry as a case evaluates it."""
    spec = MethodSpec.parse(entry.text)
    if is_sequence(str(spec.method)):
        return replace(spec, label=entry.label, method=f"{PREFIX}{_frames_of(case, str(spec.method))}")
    return replace(spec, label=entry.label)


@cache
def loaded(entry: Entry) -> Method | None:
    """The method of ``entry``, read once; None where it cannot be loaded, which the evaluation reports, and for frames
    made elsewhere.
    """
    try:
        return load_method(MethodSpec.parse(entry.text).method)
    except (MethodError, SettingsError):
        return None
