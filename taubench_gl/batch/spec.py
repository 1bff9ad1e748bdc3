"""Reads a batch spec (TOML) and expands it to jobs: scenes x settings.  All errors of a file are reported together."""

from __future__ import annotations

import dataclasses
import glob
import hashlib
import itertools
import json
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl.data_files import read_toml
from taubench_gl.errors import SettingsError, TaubenchError
from taubench_gl.fields import Setting
from taubench_gl.report.labels import differing, flat_settings, labelled, phrase, range_text
from taubench_gl.settings import KEYS, Settings, read_key, unknown_setting

Resolver = Callable[[str], tuple[str, dict[str, Any]]]
"""Maps the name of a scene to an argument of ``load_scene`` and the settings of its registry entry."""


def _takes_list(field: Setting) -> bool:
    """Whether a value itself may be a list: a tuple of any length, or a tuple among other types."""
    arguments = typing.get_args(field.kind)
    return Ellipsis in arguments or any(typing.get_origin(kind) is tuple for kind in arguments)


LISTS = tuple(name for name, field in KEYS.items() if _takes_list(field))
"""Settings whose value is itself a list: only a list of lists sweeps them."""

OWN_KEYS = ("name", "scenes")
SCENE_KEY = "path"


@dataclass(frozen=True, slots=True)
class Job:
    """One evaluation: a scene with settings.  ``id`` names its folder and is the same on every machine."""

    id: str
    scene: str  # argument of ``load_scene``; paths are absolute
    settings: Settings
    sweep: Mapping[str, Any]  # the settings that the spec sweeps, with this job's values
    differences: Mapping[str, str] = dataclasses.field(default_factory=dict)
    # other settings in which the jobs of this scene differ, as text
    lobes: tuple[str, ...] = ()  # of direct and indirect, measured apart as by ``evaluate_scene``

    def labelled(self, name: str) -> str:
        """``name`` followed by the settings that distinguish this job from the other jobs of its scene."""
        swept = [f"{key} {value}" for key, value in self.sweep.items()]
        return labelled(name, [*swept, *(phrase(*item) for item in self.differences.items())])

    @property
    def label(self) -> str:
        """The scene's file name followed by the settings that distinguish this job, for messages and progress."""
        return self.labelled(Path(self.scene).name)


@dataclass(frozen=True, slots=True)
class BatchSpec:
    """A named list of jobs with unique ids."""

    name: str
    jobs: tuple[Job, ...]


def read_spec(path: str | Path, resolve: Resolver = lambda text: (text, {})) -> BatchSpec:
    """Read and check a spec file.  Raises SettingsError that lists every error: key, value and what is allowed."""
    path = Path(path)
    values = read_toml(path, fault=SettingsError, hint="see docs/batch.md for an example")
    errors: list[str] = []
    choices = read_choices({k: v for k, v in values.items() if k not in ("name", "scenes")}, "", errors)
    scenes = list(_scenes(values.get("scenes"), path.parent, resolve, errors))
    name = values.get("name", path.stem)
    if not isinstance(name, str):
        errors.append(f"name is {name!r}, expected text")
    if errors:
        raise SettingsError(
            f"{len(errors)} error{'s' if len(errors) > 1 else ''}: {'; '.join(errors)}", where=str(path)
        )
    jobs: dict[str, Job] = {}
    for entry in scenes:
        choices_here = choices | entry.choices
        # Frame numbers of a registry entry count at its own rate.
        row = {
            k: v
            for k, v in entry.row.items()
            if k not in choices_here and not (k == "frames" and "fps" in choices_here)
        }
        for job in _combine(entry.written, entry.scene, row, choices_here):
            jobs.setdefault(job.id, job)
    return BatchSpec(str(name), with_differences(jobs.values()))


def with_differences(jobs: Iterable[Job]) -> tuple[Job, ...]:
    """``jobs`` with ``differences`` set: the settings, other than the swept ones, that differ within a scene."""
    out = list(jobs)
    of_scene: dict[str, list[int]] = {}
    for i, job in enumerate(out):
        of_scene.setdefault(job.scene, []).append(i)
    for indices in of_scene.values():
        flat = differing([flat_settings(out[i].settings.to_dict()) for i in indices])
        for i, different in zip(indices, flat, strict=True):
            kept = {key: text for key, text in different.items() if key.partition(".")[0] not in out[i].sweep}
            out[i] = dataclasses.replace(out[i], differences=kept)
    return tuple(out)


def read_choices(values: Mapping[str, Any], where: str, errors: list[str]) -> dict[str, list[dict[str, Any]]]:
    """Alternatives per key, each a dict of Settings fields (``size`` sets two).  A sweep has more than one."""
    out: dict[str, list[dict[str, Any]]] = {}
    for key, value in values.items():
        field = key.replace("-", "_")
        name = f"{where}{key}"
        if field not in KEYS:
            errors.append(f"{name}: {unknown_setting(field, OWN_KEYS)}")
            continue
        if field == "thresholds" and isinstance(value, dict):
            out[field] = _sweep_table(name, value, errors)
            continue
        # A list is a sweep, except where the setting itself is one: there a list of lists is.
        sweeps = isinstance(value, list) and (field not in LISTS or (value and all(isinstance(v, list) for v in value)))
        alternatives = value if sweeps else [value]
        if not alternatives:
            errors.append(f"{name} is empty (leave it out, or give at least one value)")
        settings = [
            _checked(field, alternative, f"{name}[{i}]" if sweeps else name, errors)
            for i, alternative in enumerate(alternatives)
        ]
        out[field] = [fields for fields in settings if fields is not None]
    return out


def _sweep_table(name: str, table: Mapping[str, Any], errors: list[str]) -> list[dict[str, Any]]:
    """Alternatives of ``thresholds``; each entry is a number or a list of numbers to sweep."""
    lists = [value if isinstance(value, list) else [value] for value in table.values()]
    out = [_checked("thresholds", dict(zip(table, row)), name, errors) for row in itertools.product(*lists)]
    return [fields for fields in out if fields is not None]


def _checked(field: str, value: Any, name: str, errors: list[str]) -> dict[str, Any] | None:
    """The Settings fields that one value sets, after a check of type and range; None if the value is invalid."""
    if field == "animation" and isinstance(value, str):
        value = [word.strip() for word in value.split(",") if word.strip()]
    try:
        return read_key(field, value)
    except TaubenchError as error:
        errors.append(f"{name}: {error}")
        return None


@dataclass(frozen=True, slots=True)
class _SceneEntry:
    """One scene of the spec."""

    written: str  # as the spec writes it, patterns expanded
    scene: str  # argument of ``load_scene``
    row: dict[str, Any]  # settings of its registry entry
    choices: dict[str, list[dict[str, Any]]]  # alternatives that the spec gives for this scene alone


def _scenes(values: Any, folder: Path, resolve: Resolver, errors: list[str]) -> Iterator[_SceneEntry]:
    """Every scene that exists; those that do not are appended to ``errors``."""
    if not isinstance(values, list) or not values:
        fault = "missing" if values is None else "empty" if values == [] else f"{values!r}, not a list"
        errors.append(f'scenes is {fault} (give paths, patterns or names: scenes = ["a.glb", "more/*.glb"])')
        return
    for i, entry in enumerate(values):
        where = f"scenes[{i}]"
        own: dict[str, list[dict[str, Any]]] = {}
        if isinstance(entry, dict) and isinstance(entry.get(SCENE_KEY), str):
            own = read_choices({k: v for k, v in entry.items() if k != SCENE_KEY}, f"{where}.", errors)
            entry = entry[SCENE_KEY]
        if not isinstance(entry, str) or not entry:
            errors.append(f'{where} is {entry!r} (give text, or a table such as {{ path = "a.glb", camera = "Top" }})')
            continue
        try:
            for written, scene, row in _one_scene(entry, folder, resolve):
                yield _SceneEntry(written, scene, row, own)
        except TaubenchError as error:
            errors.append(f"{where}: {error}")


def _one_scene(text: str, folder: Path, resolve: Resolver) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """(as written, argument of ``load_scene``, settings of its registry entry) of each scene that ``text`` matches."""
    if text.startswith("exr:"):
        message = f"{text} names path-traced files, which a batch cannot evaluate"
        raise SettingsError(message, hint="use taubench-gl evaluate exr:DIR")
    plain = text.partition("@")[0]
    if plain.lower().endswith(".obj") and any(c in plain for c in "*%?["):  # numbered files are one animated scene
        yield text, str(folder.absolute() / text), {}
        return
    if any(c in text for c in "*?["):
        files = sorted(p for p in glob.glob(text, root_dir=folder, recursive=True) if (folder / p).is_file())
        if not files:
            raise SettingsError(f"no file matches {text!r}", where=str(folder))
        for file in files:
            yield file, str((folder / file).absolute()), {}
        return
    if (folder / plain).exists():
        yield text, str((folder / text).absolute()), {}
        return
    scene, row = resolve(text)
    if scene == text:
        raise SettingsError(f"{text!r} is neither a file nor the name of a known scene", where=str(folder))
    yield text, scene, row


def _combine(
    written: str, scene: str, row: dict[str, Any], choices: Mapping[str, list[dict[str, Any]]]
) -> Iterator[Job]:
    """One job per element of the Cartesian product of all sweeps, in the order of the file."""
    swept = [key for key, alternatives in choices.items() if len(alternatives) > 1]
    for picks in itertools.product(*choices.values()):
        fields = row | {name: value for pick in picks for name, value in pick.items()}
        settings = Settings(**fields)
        sweep = {key: _sweep_value(key, pick) for key, pick in zip(choices, picks) if key in swept}
        yield Job(job_id(written, settings), scene, settings, sweep)


def _sweep_value(key: str, pick: Mapping[str, Any]) -> Any:
    """The value of one swept key, as labels and tables show it."""
    if key == "size":
        return f"{pick['width']}x{pick['height']}"
    value = next(iter(pick.values()))
    if key == "frames":
        return range_text(value)
    if isinstance(value, dict):
        return " ".join(f"{name}={number:g}" for name, number in value.items())
    return list(value) if isinstance(value, tuple) else value


def job_id(written: str, settings: Settings) -> str:
    """Name of a job's folder: the scene's name, and a hash of the scene (as the spec writes it) and the settings."""
    text = json.dumps([written, settings.to_dict()], sort_keys=True)
    return f"{_safe(Path(written).stem) or 'scene'}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def _safe(text: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "_" for c in text).strip("._")[:60]
