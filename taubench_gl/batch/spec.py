"""Reads a batch spec (TOML) and expands it to jobs: scenes x settings.  All wrong settings and scenes are reported."""

from __future__ import annotations

import dataclasses
import glob
import hashlib
import itertools
import json
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec

from taubench_gl.data_files import one_line, read_toml, schema_fault
from taubench_gl.errors import SettingsError, TaubenchError
from taubench_gl.fields import Setting
from taubench_gl.report.labels import differing, flat_settings, labelled, phrase, range_text
from taubench_gl.settings import KEYS, Settings, read_key, unknown_setting

Resolver = Callable[[str], tuple[str, dict[str, Any]]]
"""Maps the name of a scene to an argument of ``load_scene`` and the settings of its registry entry."""

Alternatives = dict[str, list[dict[str, Any]]]
"""Key of a batch spec -> what each of its values sets, as fields of Settings (``size`` sets two)."""


class _File(msgspec.Struct):
    """The keys of a batch spec that are no settings."""

    scenes: Annotated[list[str | dict[str, Any]], msgspec.Meta(min_length=1)]
    name: str = ""


class _SceneTable(msgspec.Struct):
    """The key of a scene with settings of its own that is no setting."""

    path: Annotated[str, msgspec.Meta(min_length=1)]


def _takes_list(field: Setting) -> bool:
    """Whether the value of a setting may itself be a list: a tuple of any length, or a tuple among other types."""
    arguments = typing.get_args(field.kind)
    return Ellipsis in arguments or any(typing.get_origin(kind) is tuple for kind in arguments)


LISTS = tuple(name for name, field in KEYS.items() if _takes_list(field))
"""Settings whose value is itself a list: only a list of lists sweeps them."""


@dataclass(frozen=True, slots=True)
class Job:
    """One evaluation: a scene with settings.  ``id`` names its folder and is the same on every machine."""

    id: str
    scene: str  # argument of ``load_scene``; paths are absolute
    settings: Settings
    sweep: Mapping[str, Any]  # the settings that the spec sweeps, with this job's values
    differences: Mapping[str, str] = dataclasses.field(default_factory=dict)
    # other settings in which the jobs of this scene differ, as text
    lobes: tuple[str, ...] = ()  # lobes whose direct and indirect light is measured apart, as by ``evaluate_scene``

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
    """Read and check a spec file.  Raises SettingsError that lists every wrong key and scene, and what is allowed."""
    path, hint = Path(path), "see docs/batch.md for an example"
    values = read_toml(path, fault=SettingsError, hint=hint)
    with one_line(path, SettingsError, hint=hint):
        file = msgspec.convert(values, _File)
    errors: list[str] = []
    common = _alternatives({k: v for k, v in values.items() if k not in _File.__struct_fields__}, "", errors)
    jobs: dict[str, Job] = {}
    for i, entry in enumerate(file.scenes):
        where, specific = f"scenes[{i}]", Alternatives()
        try:
            if isinstance(entry, dict):
                specific = _alternatives({k: v for k, v in entry.items() if k != "path"}, f"{where}.", errors)
                entry = msgspec.convert(entry, _SceneTable).path
            for job in _jobs(entry, path.parent, resolve, common | specific):
                jobs.setdefault(job.id, job)
        except msgspec.ValidationError as error:
            errors.append(f"{where}: {schema_fault(error)}")
        except TaubenchError as error:
            errors.append(f"{where}: {error}")
    if errors:
        count = f"{len(errors)} error{'s' if len(errors) > 1 else ''}"
        raise SettingsError(f"{count}: {'; '.join(errors)}", where=str(path))
    return BatchSpec(file.name or path.stem, with_differences(jobs.values()))


def with_differences(jobs: Iterable[Job]) -> tuple[Job, ...]:
    """Set ``differences`` of all jobs: the settings, other than the swept ones, that differ within a scene."""
    out = list(jobs)
    of_scene: dict[str, list[int]] = {}
    for i, job in enumerate(out):
        of_scene.setdefault(job.scene, []).append(i)
    for indices in of_scene.values():
        flat = differing([flat_settings(out[i].settings.to_dict()) for i in indices])
        for i, different in zip(indices, flat, strict=True):
            kept = {key: text for key, text in different.items() if key.partition(".")[0] not in out[i].sweep}
            out[i] = replace(out[i], differences=kept)
    return tuple(out)


def _alternatives(values: Mapping[str, Any], where: str, errors: list[str]) -> Alternatives:
    """The values of every key of a table of settings, two or more where the key is swept.

    ``where`` begins the names of keys in ``errors``, to which faults are appended.
    """
    out: Alternatives = {}
    for key, value in values.items():
        field, name = key.replace("-", "_"), f"{where}{key}"
        if field not in KEYS:
            errors.append(f"{name}: {unknown_setting(field, _File.__struct_fields__)}")
            continue
        # A list is a sweep, except where the setting itself is one: there a list of lists is.
        sweeps = isinstance(value, list) and (field not in LISTS or (value and all(isinstance(v, list) for v in value)))
        named = [(f"{name}[{i}]", each) for i, each in enumerate(value)] if sweeps else [(name, value)]
        if field == "thresholds" and isinstance(value, dict):  # each threshold can be swept
            lists = [each if isinstance(each, list) else [each] for each in value.values()]
            named = [(name, dict(zip(value, row))) for row in itertools.product(*lists)]
        if not named:
            errors.append(f"{name} is empty (leave it out, or give at least one value)")
        out[field] = []
        for place, each in named:
            if field == "animation" and isinstance(each, str):
                each = [word.strip() for word in each.split(",") if word.strip()]
            try:
                out[field].append(read_key(field, each))
            except TaubenchError as error:
                errors.append(f"{place}: {error}")
    return out


def _jobs(text: str, folder: Path, resolve: Resolver, alternatives: Alternatives) -> Iterator[Job]:
    """One job per scene that ``text`` names and element of the product of all sweeps, in the order of the file."""
    swept = [key for key, values in alternatives.items() if len(values) > 1]
    for written, scene, registered in _scenes(text, folder, resolve):
        # Frame numbers of a registry entry count at its own rate.
        replaced = {*alternatives, *(("frames",) if "fps" in alternatives else ())}
        fields = {name: value for name, value in registered.items() if name not in replaced}
        for picks in itertools.product(*alternatives.values()):
            settings = Settings(**fields | {name: value for pick in picks for name, value in pick.items()})
            sweep = {key: _sweep_value(key, pick) for key, pick in zip(alternatives, picks) if key in swept}
            name, path = job_id(written, settings), settings.sequence.camera_path
            if path is not None:
                settings = settings.replace(camera_path=str((folder / path).absolute()))
            yield Job(name, scene, settings, sweep)


def _scenes(text: str, folder: Path, resolve: Resolver) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """(name with patterns expanded, argument of ``load_scene``, settings of its registry entry) of matching scenes.

    Raises SettingsError where none matches.
    """
    if text.startswith("exr:"):
        message = f"{text} names path-traced files, which a batch cannot evaluate"
        raise SettingsError(message, hint="use taubench-gl evaluate exr:DIR")
    plain = text.partition("@")[0]
    numbered = plain.lower().endswith(".obj") and any(c in plain for c in "*%?[")  # one animated scene
    if numbered or (folder / plain).exists():
        yield text, str((folder / text).absolute()), {}
    elif any(c in text for c in "*?["):
        files = sorted(p for p in glob.glob(text, root_dir=folder, recursive=True) if (folder / p).is_file())
        if not files:
            raise SettingsError(f"no file matches {text!r}", where=str(folder))
        yield from ((file, str((folder / file).absolute()), {}) for file in files)
    else:
        scene, registered = resolve(text)
        if scene == text:
            raise SettingsError(f"{text!r} is neither a file nor the name of a known scene", where=str(folder))
        yield text, scene, registered


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
    stem = "".join(c if c.isalnum() or c in "._-" else "_" for c in Path(written).stem).strip("._")[:60]
    return f"{stem or 'scene'}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
