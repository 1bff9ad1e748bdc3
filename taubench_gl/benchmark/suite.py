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
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from taubench_gl.benchmark.scenes import STRESS, SceneRecipe, known_source
from taubench_gl.camera_path_settings import CameraPathSettings
from taubench_gl.data_files import convert, hashed, one_line, read_toml
from taubench_gl.datasets.stress import CAMERA_NAME
from taubench_gl.errors import SettingsError
from taubench_gl.fields import declared, from_values, unknown_field
from taubench_gl.option_groups import REUSE_SETTINGS, ReuseOptions
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.reuse.evaluate import EvaluationRequest
from taubench_gl.reuse.generated import check_rendered, generated_frames
from taubench_gl.reuse.input_kind import InputKind
from taubench_gl.reuse.references import FITTED
from taubench_gl.settings import AUTO, Settings

SCHEMA = "suite/1"
SUITES = Path(__file__).resolve().parent / "suites"
BUILTIN = ("quick", "full")

CUT, SPEED = "cut", "camera_path_speed"
SERIES = (*STRESS, CUT, SPEED)
"""Axes of a series, what changes from case to case: camera, lights or objects (``scenes.STRESS``), cuts, or the speed
of a recorded camera."""

HINT = "see docs/benchmark.md"

_FIXED = ("light", "reference_time", "mapping")
"""Settings that no suite has: they follow from its input, or results would depend on the machine or on files."""

_SETTINGS = tuple(name for name in (*REUSE_SETTINGS, *declared(CameraPathSettings)) if name not in _FIXED)
_OPTIONS = tuple(name for name in declared(ReuseOptions) if name not in _FIXED)
_HASHED = (
    "cuts", "environment", "exposure", "fps", "input", "light_samples", "metrics", "reference", "reference_samples",
    "seeds", "shadow_size", "size", "vpl_samples", "warmup",
)  # fmt: skip
"""Settings and options that are part of every hash of a case.  The others are part of it where they have not their
default: a new one changes no hash."""


Speeds = tuple[Annotated[float, Meta(ge=0)], ...] | None


class _File(msgspec.Struct):
    """Keys of a suite beside those that hold for all its cases."""

    schema: Literal["suite/1"]
    name: Annotated[str, Meta(min_length=1)]
    cases: Annotated[list[dict[str, Any]], Meta(min_length=1)]


class _Table(msgspec.Struct):
    """Keys of a table of ``cases`` besides settings and options.  A table with one of ``SERIES`` is a series."""

    scene: str  # demo, a scene made by code or a file beside the suite
    track: str  # the cases within which methods are ranked
    frames: Annotated[int, Meta(ge=2)]
    first: Annotated[int, Meta(ge=0)] = 0  # number of the first frame
    still: bool = False  # a series without the scene's own animations
    rotation: Speeds = None  # yaw of the camera, degrees per frame
    translation: Speeds = None  # speed of the camera, meters per frame
    light_speed: Speeds = None  # speed of all lights, meters per frame
    object_speed: Speeds = None  # speed of all small rigid objects, meters per frame
    cut: tuple[Annotated[int, Meta(ge=0)], ...] | None = None  # frames from cut to cut
    camera_path_speed: Speeds = None  # factors on the speed of a recorded camera


@dataclass(frozen=True, slots=True)
class Case:
    """One evaluation of the suite.

    ``series`` and ``value``: the axis and step of a series, None for a single case; ``first``: number of the first
    frame; ``settings``: of the frames; ``request``: what methods are evaluated on; ``generated``: for
    methods that generate frames; one of ``request.render_every`` is rendered.
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
    generated: bool = False

    @property
    def evaluated_frames(self) -> int:
        """Number of frames of a seed that have scores.  Raises SettingsError for too few to generate some."""
        shown = range(self.first, self.first + self.frames)
        return len(generated_frames(shown, self.request.render_every) if self.generated else shown)

    @property
    def kind(self) -> InputKind:
        """Kind of the frames that methods get."""
        return self.request.kind(self.settings.lighting.seed)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the result in pixels."""
        return self.settings.sequence.width, self.settings.sequence.height

    def identity(self, scene_sha256: str) -> str:
        """Hash of what is evaluated, 64 hexadecimal digits; labels are no part of it."""
        values = {"scene": scene_sha256, "first": self.first, "frames": self.frames}
        # Stored results are found by this hash: it must not change where what is evaluated does not.
        default = _values(Settings(), EvaluationRequest())
        for name, value in _values(self.settings, self.request).items():
            if name in _HASHED or value != default[name] or (name == "render_every" and self.generated):
                values[name] = None if value == AUTO else value
        if path := self.settings.sequence.camera_path:
            values["camera_path"] = hashed(path, SettingsError).hexdigest()
        return hashlib.sha256(json.dumps([SCHEMA, values], sort_keys=True).encode()).hexdigest()


def _values(settings: Settings, request: EvaluationRequest) -> dict[str, Any]:
    """The values of all keys that a suite can set, by name."""
    values = {name: settings.get(name) for name in _SETTINGS if name != "size"}
    values["size"] = settings.sequence.width, settings.sequence.height
    return values | {name: getattr(request, name) for name in _OPTIONS}


@dataclass(frozen=True, slots=True)
class Suite:
    """A named list of cases; ``sha256``: of its file."""

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
    """Read a built-in suite by name, or a file.  Raises SettingsError."""
    path = SUITES / f"{text}.toml" if str(text) in BUILTIN else Path(text)
    if not path.is_file():
        hint = f"choose from {', '.join(BUILTIN)}, or give a .toml file"
        raise SettingsError(f"there is no suite {str(text)!r}", hint=hint)
    values = read_toml(path, fault=SettingsError, hint=HINT)
    with one_line(path, SettingsError, hint=HINT):
        file = convert(values, _File)
    common = {name: value for name, value in values.items() if name not in _File.__struct_fields__}
    try:
        cases = [case for table in file.cases for case in _cases(common | table, path)]
    except SettingsError as error:
        raise SettingsError(error.what, where=str(path), hint=error.hint) from None
    ids = [case.id for case in cases]
    if repeated := next((name for name in ids if ids.count(name) > 1), None):
        raise SettingsError(f"two cases are {repeated}", where=str(path), hint="leave one out")
    return Suite(file.name, hashed(path, SettingsError).hexdigest(), tuple(cases))


def _cases(values: Mapping[str, Any], path: Path) -> list[Case]:
    """The cases of one table of the suite ``path``; ``values`` of the table and of the suite.  Raises SettingsError."""
    allowed = (*_Table.__struct_fields__, *_SETTINGS, *_OPTIONS)
    if unknown := next((name for name in values if name not in allowed), None):
        raise unknown_field(unknown, allowed)
    with one_line(path, SettingsError, hint=HINT):
        table = convert(values, _Table)
    evaluated = {name: value for name, value in values.items() if name not in _Table.__struct_fields__}
    axes = [axis for axis in SERIES if getattr(table, axis) is not None]
    if len(axes) > 1:
        raise SettingsError(f"a series has {' and '.join(axes)}", hint="give one of them")
    if not axes:
        return [_case(table, evaluated, path.parent, None, None)]
    steps = getattr(table, axes[0])
    if not steps or list(steps) != sorted(set(steps)) or not all(map(math.isfinite, steps)):
        raise SettingsError(f"{axes[0]} is {list(steps)}", hint="give different numbers of at least 0, ascending")
    return [_case(table, evaluated, path.parent, axes[0], value) for value in steps]


def _case(table: _Table, evaluated: Mapping[str, Any], folder: Path, axis: str | None, value: float | None) -> Case:
    """One case of a table.  Raises SettingsError.

    ``evaluated``: settings and options by name; ``axis`` and ``value``: of a series, None for a single case.
    """
    options = {name: option for name, option in evaluated.items() if name in _OPTIONS}
    chosen = {name: setting for name, setting in evaluated.items() if name in _SETTINGS}
    if path := chosen.get("camera_path"):
        chosen["camera_path"] = str(folder / path)
    if axis == SPEED:
        chosen[SPEED] = value
    if axis == CUT and value:  # 0: no cut
        options["cuts"] = tuple(range(table.first + int(value), table.first + table.frames, int(value)))
    request = from_values(EvaluationRequest, options | {"statistics": False, "exact_samples": True})
    settings = Settings(
        **chosen,
        frames=(table.first, table.first + table.frames),
        reprojection="motion",
        light="path-traced" if request.kind().path_samples else "raster",
        # Where nothing moves, the default is an orbit.
        camera=CAMERA_NAME if axis in STRESS else None,
    )
    step = "" if axis is None else f"/{axis}={value:g}"
    trace = f"+{Path(path).stem}@{settings.sequence.fps:g}" if path else ""
    case = Case(
        id=f"{Path(table.scene).stem}{trace}{step}/{_input_name(request)}",
        track=table.track,
        series=axis,
        value=None if value is None else float(value),
        scene=_recipe(table, settings.sequence.fps, folder, axis, value),
        first=table.first,
        frames=table.frames,
        settings=settings,
        request=request,
        generated="render_every" in options,
    )
    if case.kind.files is not None or is_sequence(request.reference):
        raise SettingsError(f"{case.id}: files are no part of a suite", hint="give a rendered input and reference")
    if request.reference == FITTED:
        raise SettingsError(f"{case.id}: the reference depends on the machine", hint="give path-traced@M")
    if case.generated:
        check_rendered(case.kind, settings.metrics.history, request.cuts)
    # Of generated frames, the first intervals between rendered ones are left out.
    if case.evaluated_frames <= request.warmup * (request.render_every - 1 if case.generated else 1):
        raise SettingsError(f"{case.id}: warmup is {request.warmup}, frames {case.frames}", hint="give more frames")
    request.check(settings.lighting.seed)
    case.kind.input_size(case.size)
    return case


def _recipe(table: _Table, fps: float, folder: Path, axis: str | None, value: float | None) -> SceneRecipe:
    """The scene of a case.  Raises SettingsError."""
    source = known_source(table.scene, folder)
    if axis == SPEED and table.still:  # the place of a still camera
        axis, value = "rotation", 0.0
    if axis in STRESS:
        if table.first:
            raise SettingsError(f"first is {table.first}", hint=f"a series of {axis} begins with frame 0: leave it out")
        return SceneRecipe(source, axis, float(value), table.frames, fps, table.still)
    if table.still:
        raise SettingsError("still is true without a series", hint=f"give one of {', '.join(STRESS)}, or leave it out")
    return SceneRecipe(source)


def _input_name(request: EvaluationRequest) -> str:
    """The input as part of a case's name: noisy light with the number of sampled lights, if it is not one."""
    several = request.kind().noisy and request.light_samples > 1
    return f"{request.input}@{request.light_samples}" if several else request.input
