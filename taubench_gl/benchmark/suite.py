"""Suites: TOML files that list cases.  A case is a scene, its frames, an input, seeds and a reference.

``schema = "suite/1"`` fixes what the keys mean.  A table of ``cases`` has keys of its own (``_Table``), settings, and
options of ``reuse evaluate``; those beside the tables hold for all.  A table with one of ``SERIES`` is a series: one
case per value.  Everything that a result depends on is part of ``Case.identity``.
"""

from __future__ import annotations

import fnmatch
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl.benchmark.scenes import STRESS, SceneRecipe, known_source
from taubench_gl.data_files import hashed, read_toml
from taubench_gl.datasets.stress import CAMERA_NAME
from taubench_gl.errors import SettingsError
from taubench_gl.fields import REQUIRED, Checked, at_least, declared, from_values, setting, unknown_field
from taubench_gl.option_groups import REUSE_SETTINGS, ReuseOptions
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.reuse.evaluate import EvaluationRequest
from taubench_gl.reuse.input_kind import InputKind
from taubench_gl.reuse.references import FITTED
from taubench_gl.settings import AUTO, Settings

SCHEMA = "suite/1"
SUITES = Path(__file__).resolve().parent / "suites"
BUILTIN = ("quick", "full")

CUT = "cut"
SERIES = (*STRESS, CUT)
"""What a series changes from case to case: camera, lights or objects (``scenes.STRESS``), or frames between cuts."""

HINT = "see docs/benchmark.md"

_FIXED = ("light", "reference_time", "mapping")
"""What follows from the input, or would make a result depend on the machine or on files."""

_SETTINGS = tuple(name for name in REUSE_SETTINGS if name not in _FIXED)
_OPTIONS = tuple(name for name in declared(ReuseOptions) if name not in _FIXED)
_HASHED = (
    "cuts", "environment", "exposure", "fps", "input", "light_samples", "metrics", "reference", "reference_samples",
    "seeds", "shadow_size", "size", "vpl_samples", "warmup",
)  # fmt: skip
"""Settings and options that are part of every hash of a case.  The others are part of it where they have not their
default: a new one changes no hash."""


def _speeds(meaning: str) -> Any:
    """The key of a series."""
    return setting(None, f"Series: {meaning}")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table(Checked):
    """Keys of a table of ``cases`` besides settings and options."""

    scene: str = setting(REQUIRED, "demo, a scene made by code or a file beside the suite")
    track: str = setting(REQUIRED, "Cases within which methods are ranked")
    first: int = setting(0, "Number of the first frame", at_least(0))
    frames: int = setting(REQUIRED, "Number of frames", at_least(2))
    still: bool = setting(False, "Of a series: without the scene's own animations")
    rotation: tuple[float, ...] | None = _speeds("yaw of the camera, degrees per frame")
    translation: tuple[float, ...] | None = _speeds("speed of the camera, meters per frame")
    light_speed: tuple[float, ...] | None = _speeds("speed of all lights, meters per frame")
    object_speed: tuple[float, ...] | None = _speeds("speed of all small rigid objects, meters per frame")
    cut: tuple[int, ...] | None = _speeds("frames from cut to cut")


@dataclass(frozen=True, slots=True)
class Case:
    """One evaluation.  ``series`` and ``value``: the axis and step of a series, None for a single case.

    ``first``: number of the first frame; ``settings``: of the frames; ``request``: what methods are evaluated on.
    """

    id: str
    track: str
    series: str | None
    value: float | None
    scene: SceneRecipe
    first: int
    frames: int
    settings: Settings
    request: EvaluationRequest

    @property
    def kind(self) -> InputKind:
        return self.request.kind(self.settings.lighting.seed)

    @property
    def size(self) -> tuple[int, int]:
        return self.settings.sequence.width, self.settings.sequence.height

    def identity(self, scene_sha256: str) -> str:
        """Hash of what is evaluated, 64 hexadecimal digits; labels are no part of it."""
        values = {"scene": scene_sha256, "first": self.first, "frames": self.frames}
        # Stored results are found by this hash: it must not change where what is evaluated does not.
        default = _values(Settings(), EvaluationRequest())
        for name, value in _values(self.settings, self.request).items():
            if name in _HASHED or value != default[name]:
                values[name] = None if value == AUTO else value
        return hashlib.sha256(json.dumps([SCHEMA, values], sort_keys=True).encode()).hexdigest()


def _values(settings: Settings, request: EvaluationRequest) -> dict[str, Any]:
    """What a suite can set, by name."""
    values = {name: settings.get(name) for name in _SETTINGS if name != "size"}
    values["size"] = settings.sequence.width, settings.sequence.height
    return values | {name: getattr(request, name) for name in _OPTIONS}


@dataclass(frozen=True, slots=True)
class Suite:
    """``sha256``: of its file."""

    name: str
    sha256: str
    cases: tuple[Case, ...]

    def describe(self) -> dict[str, Any]:
        """The block ``suite`` of benchmark.json."""
        return {"version": SCHEMA, "name": self.name, "sha256": self.sha256, "cases": len(self.cases)}

    def part(self, patterns: Sequence[str]) -> Suite:
        """The cases whose names match one of ``patterns``, such as ``demo/rotation=*``; no pattern: all.

        A part is another suite: its name and hash tell.  Raises SettingsError for a pattern without a case.
        """
        ids = [case.id for case in self.cases]
        if lost := next((pattern for pattern in patterns if not fnmatch.filter(ids, pattern)), None):
            hint = "see 'taubench-gl benchmark plan'"
            raise SettingsError(f"suite {self.name} has no case {lost!r}", hint=hint)
        cases = tuple(case for case in self.cases if any(fnmatch.fnmatchcase(case.id, pattern) for pattern in patterns))
        if not patterns or len(cases) == len(self.cases):
            return self
        digest = hashlib.sha256(json.dumps([self.sha256, [case.id for case in cases]]).encode()).hexdigest()
        return Suite(f"part of {self.name}", digest, cases)


def read_suite(text: str | Path) -> Suite:
    """A built-in suite by name, or a file.  Raises SettingsError."""
    path = SUITES / f"{text}.toml" if str(text) in BUILTIN else Path(text)
    if not path.is_file():
        hint = f"choose from {', '.join(BUILTIN)}, or give a .toml file"
        raise SettingsError(f"there is no suite {str(text)!r}", hint=hint)
    values = read_toml(path, fault=SettingsError, hint=HINT)
    schema = values.pop("schema", None)
    if schema != SCHEMA:
        raise SettingsError(f"schema is {schema!r}, expected {SCHEMA!r}", where=str(path), hint=HINT)
    name, tables = values.pop("name", None), values.pop("cases", None)
    if not (isinstance(name, str) and name and isinstance(tables, list) and all(isinstance(t, dict) for t in tables)):
        raise SettingsError("has no name, or no tables [[cases]]", where=str(path), hint=HINT)
    try:
        cases = [case for table in tables for case in _expanded(values | table, path.parent)]
    except SettingsError as error:
        raise SettingsError(error.what, where=str(path), hint=error.hint) from None
    if not cases:
        raise SettingsError("has no case", where=str(path), hint=HINT)
    ids = [case.id for case in cases]
    if repeated := next((name for name in ids if ids.count(name) > 1), None):
        raise SettingsError(f"two cases are {repeated}", where=str(path), hint="leave one out")
    return Suite(name, hashed(path, SettingsError).hexdigest(), tuple(cases))


def _expanded(values: Mapping[str, Any], folder: Path) -> list[Case]:
    """The cases of one table; ``values`` of it and of the whole suite.  Raises SettingsError."""
    own = declared(_Table)
    for name in values:
        if name not in (*own, *_SETTINGS, *_OPTIONS):
            raise unknown_field(name, (*own, *_SETTINGS, *_OPTIONS))
    table = from_values(_Table, {name: value for name, value in values.items() if name in own})
    evaluated = {name: value for name, value in values.items() if name not in own}
    axes = [axis for axis in SERIES if getattr(table, axis) is not None]
    if len(axes) > 1:
        raise SettingsError(f"a series has {' and '.join(axes)}", hint="give one of them")
    if not axes:
        return [_case(table, evaluated, folder, None, None)]
    steps = getattr(table, axes[0])
    if not steps or list(steps) != sorted(set(steps)) or not all(math.isfinite(v) and v >= 0 for v in steps):
        raise SettingsError(f"{axes[0]} is {list(steps)}", hint="give different numbers of at least 0, ascending")
    return [_case(table, evaluated, folder, axes[0], value) for value in steps]


def _case(table: _Table, evaluated: Mapping[str, Any], folder: Path, axis: str | None, value: float | None) -> Case:
    """``evaluated``: settings and options by name; ``axis`` and ``value`` of a series.  Raises SettingsError."""
    options = {name: option for name, option in evaluated.items() if name in _OPTIONS}
    if axis == CUT and value:  # 0: no cut
        options["cuts"] = tuple(range(table.first + int(value), table.first + table.frames, int(value)))
    request = from_values(EvaluationRequest, options | {"statistics": False, "exact_samples": True})
    settings = Settings(
        **{name: setting for name, setting in evaluated.items() if name in _SETTINGS},
        frames=(table.first, table.first + table.frames),
        reprojection="motion",
        light="path-traced" if request.kind().path_samples else "raster",
        # Where nothing moves, the default is an orbit.
        camera=CAMERA_NAME if axis in STRESS else None,
    )
    step = "" if axis is None else f"/{axis}={value:g}"
    case = Case(
        id=f"{Path(table.scene).stem}{step}/{_input_name(request)}",
        track=table.track,
        series=axis,
        value=None if value is None else float(value),
        scene=_recipe(table, settings.sequence.fps, folder, axis, value),
        first=table.first,
        frames=table.frames,
        settings=settings,
        request=request,
    )
    if case.kind.files is not None or is_sequence(request.reference):
        raise SettingsError(f"{case.id}: files are no part of a suite", hint="give a rendered input and reference")
    if request.reference == FITTED:
        raise SettingsError(f"{case.id}: the reference depends on the machine", hint="give path-traced@M")
    if case.frames <= request.warmup:
        raise SettingsError(f"{case.id}: warmup is {request.warmup}, frames {case.frames}", hint="give more frames")
    request.check(settings.lighting.seed)
    case.kind.input_size(case.size)
    return case


def _recipe(table: _Table, fps: float, folder: Path, axis: str | None, value: float | None) -> SceneRecipe:
    """The scene of a case.  Raises SettingsError."""
    source = known_source(table.scene, folder)
    if axis in STRESS:
        if table.first:
            raise SettingsError(f"first is {table.first}", hint=f"a series of {axis} begins with frame 0: leave it out")
        return SceneRecipe(source, axis, float(value), table.frames, fps, table.still)
    if table.still:
        raise SettingsError("still is true without a series", hint=f"give one of {', '.join(STRESS)}, or leave it out")
    return SceneRecipe(source)


def _input_name(request: EvaluationRequest) -> str:
    """The input and, of noisy light, the number of lights that are sampled, if it is not one."""
    several = request.kind().noisy and request.light_samples > 1
    return f"{request.input}@{request.light_samples}" if several else request.input
