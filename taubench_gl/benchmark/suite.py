"""Suites: TOML files that list cases.  A case is a scene, its frames, an input, seeds and a reference.

``schema = "suite/1"`` fixes what the keys mean.  A table of ``cases`` with one of ``SERIES`` is a series: one case per
value.  Everything that a result depends on is part of ``Case.identity``.
"""

from __future__ import annotations

import fnmatch
import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec

from taubench_gl.benchmark.scenes import STRESS, SceneRecipe, known_source
from taubench_gl.data_files import hashed, read_toml
from taubench_gl.datasets.stress import CAMERA_NAME
from taubench_gl.errors import SettingsError
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.reuse.evaluate import EvaluationRequest
from taubench_gl.reuse.input_kind import InputKind, parse_input
from taubench_gl.reuse.quality import DEFAULT_METRICS
from taubench_gl.reuse.references import FITTED
from taubench_gl.settings import Settings, parse_size

SCHEMA = "suite/1"
SUITES = Path(__file__).resolve().parent / "suites"
BUILTIN = ("quick", "full")

CUT = "cut"
SERIES = (*STRESS, CUT)
"""What a series changes from case to case: camera, lights or objects (``scenes.STRESS``), or frames between cuts."""

HINT = "see docs/benchmark.md"
Positive = Annotated[int, msgspec.Meta(ge=1)]


class _Evaluated(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """What a table of ``cases`` and each of its cases share."""

    track: str
    input: str
    first: Annotated[int, msgspec.Meta(ge=0)] = 0
    fps: Annotated[float, msgspec.Meta(gt=0)] = 24.0
    seeds: Positive = 1
    light_samples: Positive = 1
    vpl_samples: Positive = 4
    reference: str = "max"
    reference_samples: Positive = 16
    environment: tuple[float, float, float] | None = None
    exposure: Annotated[float, msgspec.Meta(gt=0)] | None = None


class _Cases(_Evaluated, frozen=True):
    scene: str
    frames: Annotated[int, msgspec.Meta(ge=2)] | None = None
    still: bool = False
    rotation: list[float] | None = None
    translation: list[float] | None = None
    light_speed: list[float] | None = None
    object_speed: list[float] | None = None
    cut: list[int] | None = None


class _Suite(msgspec.Struct, forbid_unknown_fields=True):
    schema: str
    name: Annotated[str, msgspec.Meta(min_length=1)]
    size: str
    frames: Annotated[int, msgspec.Meta(ge=2)]
    cases: Annotated[list[_Cases], msgspec.Meta(min_length=1)]
    warmup: Positive = 1
    shadow_size: Annotated[int, msgspec.Meta(ge=16, le=4096)] = 1024
    metrics: tuple[str, ...] = DEFAULT_METRICS


class Case(_Evaluated, frozen=True):
    """One evaluation.  ``series`` and ``value``: the axis and step of a series, None for a single case.

    ``first``: number of the first frame; ``cuts``: frames declared to have no history.
    """

    id: str
    series: str | None
    value: float | None
    scene: SceneRecipe
    size: tuple[int, int]
    frames: int
    cuts: tuple[int, ...]
    warmup: int
    shadow_size: int
    metrics: tuple[str, ...]

    @property
    def kind(self) -> InputKind:
        return parse_input(self.input, light_samples=self.light_samples, indirect_samples=self.vpl_samples)

    @property
    def settings(self) -> Settings:
        """Every setting of light is given: the result does not depend on defaults."""
        return Settings(
            width=self.size[0],
            height=self.size[1],
            fps=self.fps,
            frames=(self.first, self.first + self.frames),
            reprojection="motion",
            light="path-traced" if self.kind.path_samples else "raster",
            light_unit="auto",
            exposure=self.exposure or "auto",
            shadow_size=self.shadow_size,
            environment=self.environment or "auto",
            # Where nothing moves, the default is an orbit.
            camera=CAMERA_NAME if self.scene.axis in STRESS else None,
        )

    @property
    def request(self) -> dict[str, Any]:
        """Arguments of ``evaluate_methods``."""
        return {
            "input": self.kind,
            "reference": self.reference,
            "reference_samples": self.reference_samples,
            "exact_samples": True,
            "metrics": self.metrics,
            "cuts": self.cuts,
            "seeds": self.seeds,
            "warmup": self.warmup,
        }

    def identity(self, scene_sha256: str) -> str:
        """Hash of what is evaluated, 64 hexadecimal digits; labels are no part of it."""
        labels = ("id", "track", "series", "value")
        values = {name: value for name, value in msgspec.structs.asdict(self).items() if name not in labels}
        values["scene"] = scene_sha256
        return hashlib.sha256(json.dumps([SCHEMA, values], sort_keys=True).encode()).hexdigest()


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
    if values.get("schema") != SCHEMA:
        raise SettingsError(f"schema is {values.get('schema')!r}, expected {SCHEMA!r}", where=str(path), hint=HINT)
    suite = msgspec.convert(read_toml(path, _Suite, SettingsError, hint=HINT), _Suite)
    try:
        cases = tuple(case for table in suite.cases for case in _expanded(suite, table, path.parent))
    except SettingsError as error:
        raise SettingsError(error.what, where=str(path), hint=error.hint) from None
    ids = [case.id for case in cases]
    if repeated := next((name for name in ids if ids.count(name) > 1), None):
        raise SettingsError(f"two cases are {repeated}", where=str(path), hint="leave one out")
    return Suite(suite.name, hashed(path, SettingsError).hexdigest(), cases)


def _expanded(suite: _Suite, table: _Cases, folder: Path) -> list[Case]:
    """The cases of one table.  Raises SettingsError."""
    axes = [axis for axis in SERIES if getattr(table, axis) is not None]
    if len(axes) > 1:
        raise SettingsError(f"a series has {' and '.join(axes)}", hint="give one of them")
    if not axes:
        return [_case(suite, table, folder, None, None)]
    values = getattr(table, axes[0])
    if not values or values != sorted(set(values)) or not all(math.isfinite(v) and v >= 0 for v in values):
        raise SettingsError(f"{axes[0]} is {values}", hint="give different numbers of at least 0, ascending")
    return [_case(suite, table, folder, axes[0], value) for value in values]


def _input_name(table: _Cases) -> str:
    """The input and, of noisy light, the number of lights that are sampled, if it is not one."""
    noisy = parse_input(table.input).noisy and table.light_samples > 1
    return f"{table.input}@{table.light_samples}" if noisy else table.input


def _case(suite: _Suite, table: _Cases, folder: Path, axis: str | None, value: float | None) -> Case:
    frames = table.frames or suite.frames
    source = known_source(table.scene, folder)
    stressed = axis in STRESS
    if stressed and table.first:
        raise SettingsError(f"first is {table.first}", hint=f"a series of {axis} begins with frame 0: leave it out")
    if table.still and not stressed:
        raise SettingsError("still is true without a series", hint=f"give one of {', '.join(STRESS)}, or leave it out")
    recipe = SceneRecipe(source)
    if stressed:
        recipe = SceneRecipe(source, axis, float(value), frames, table.fps, table.still)
    cuts: tuple[int, ...] = ()
    if axis == CUT and value:
        cuts = tuple(range(table.first + int(value), table.first + frames, int(value)))
    step = "" if axis is None else f"/{axis}={value:g}"
    case = Case(
        **{name: getattr(table, name) for name in _Evaluated.__struct_fields__},
        id=f"{Path(table.scene).stem}{step}/{_input_name(table)}",
        series=axis,
        value=None if value is None else float(value),
        scene=recipe,
        size=parse_size(suite.size),
        frames=frames,
        cuts=cuts,
        warmup=suite.warmup,
        shadow_size=suite.shadow_size,
        metrics=suite.metrics,
    )
    if case.kind.files is not None or is_sequence(case.reference):
        raise SettingsError(f"{case.id}: files are no part of a suite", hint="give a rendered input and reference")
    if case.reference == FITTED:
        raise SettingsError(f"{case.id}: the reference depends on the machine", hint="give path-traced@M")
    if frames <= suite.warmup:
        raise SettingsError(f"{case.id}: warmup is {suite.warmup}, frames {frames}", hint="give more frames")
    EvaluationRequest(**case.request).check()
    case.kind.input_size(case.size)
    case.settings  # noqa: B018  checks the values
    return case
