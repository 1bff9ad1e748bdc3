"""A study file (TOML) -> the jobs it asks for: scenes x settings.  Everything is checked, all faults told at once."""

from __future__ import annotations

import dataclasses
import difflib
import glob
import hashlib
import itertools
import json
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from taubench_gl.errors import SettingsError, TaubenchError
from taubench_gl.report.labels import differing, flat_settings, labelled, phrase, range_text
from taubench_gl.settings import FIELD_TYPES, FIELDS, Settings

Resolver = Callable[[str], tuple[str, dict[str, Any]]]
"""A scene's name -> what ``load_scene`` takes, and the settings that belong to the scene (a registry's row)."""

LISTS = ("columns", "sky", "animation")
"""Settings whose value is a list: a list of lists sweeps them."""

OWN_KEYS = ("name", "scenes", "size")
SCENE_KEY = "path"


@dataclass(frozen=True, slots=True)
class Job:
    """One evaluation: a scene with settings.  ``id`` names its folder and is the same on every machine."""

    id: str
    scene: str  # absolute path, or what else ``load_scene`` takes
    settings: Settings
    sweep: Mapping[str, Any]  # of the settings, those that the study sweeps
    apart: Mapping[str, str] = dataclasses.field(default_factory=dict)  # others that differ between jobs of this scene

    def labelled(self, name: str) -> str:
        """``name`` with what sets this job apart from the others of the study."""
        swept = [f"{key} {value}" for key, value in self.sweep.items()]
        return labelled(name, [*swept, *(phrase(*item) for item in self.apart.items())])

    @property
    def label(self) -> str:
        """For people: the scene's name, and what sets this job apart from the others of the study."""
        return self.labelled(Path(self.scene).name)


@dataclass(frozen=True, slots=True)
class Study:
    name: str
    jobs: tuple[Job, ...]


def read_study(path: str | Path, resolve: Resolver = lambda text: (text, {})) -> Study:
    """Read and check a study file.  Raises SettingsError with every fault: key, value, what is allowed."""
    path = Path(path)
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"cannot be read: {error.strerror}", where=str(path), hint="give a study file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"is no TOML: {error}", where=str(path), hint="see docs/batch.md for an example") from None
    faults: list[str] = []
    choices = read_choices({k: v for k, v in values.items() if k not in ("name", "scenes")}, "", faults)
    scenes = list(_scenes(values.get("scenes"), path.parent, resolve, faults))
    name = values.get("name", path.stem)
    if not isinstance(name, str):
        faults.append(f"name is {name!r}, expected text")
    if faults:
        raise SettingsError(
            f"{len(faults)} fault{'s' if len(faults) > 1 else ''}: {'; '.join(faults)}", where=str(path)
        )
    jobs: dict[str, Job] = {}
    for written, scene, row, own in scenes:
        given = choices | own
        fill = {
            key: value for key, value in row.items() if key not in given and not (key == "frames" and "fps" in given)
        }
        for job in _combine(written, scene, fill, given):
            jobs.setdefault(job.id, job)
    return Study(str(name), set_apart(jobs.values()))


def set_apart(jobs: Iterable[Job]) -> tuple[Job, ...]:
    """``jobs``, each with the settings, not swept, in which it differs from another job of its scene."""
    out = list(jobs)
    places: dict[str, list[int]] = {}
    for i, job in enumerate(out):
        places.setdefault(job.scene, []).append(i)
    for at in places.values():
        for i, apart in zip(at, differing([flat_settings(out[i].settings.to_dict()) for i in at]), strict=True):
            told = {key: text for key, text in apart.items() if key.partition(".")[0] not in out[i].sweep}
            out[i] = dataclasses.replace(out[i], apart=told)
    return tuple(out)


def read_choices(values: Mapping[str, Any], where: str, faults: list[str]) -> dict[str, list[dict[str, Any]]]:
    """Key -> its alternatives, each a dict of Settings fields (``size`` is two of them); more than one is a sweep."""
    out: dict[str, list[dict[str, Any]]] = {}
    for key, value in values.items():
        field = key.replace("-", "_")
        name = f"{where}{key}"
        if field not in FIELDS and field != "size":
            near = difflib.get_close_matches(field, [*FIELDS, *OWN_KEYS], 1)
            meant = f"did you mean {near[0]}?" if near else f"there are {', '.join([*OWN_KEYS, *FIELDS])}"
            faults.append(f"{name} is no setting ({meant})")
            continue
        if field == "thresholds" and isinstance(value, dict):
            out[field] = _sweep_table(name, value, faults)
            continue
        sweeps = isinstance(value, list) and (field not in LISTS or (value and all(isinstance(v, list) for v in value)))
        alternatives = value if sweeps else [value]
        if not alternatives:
            faults.append(f"{name} is empty (leave it out, or give at least one value)")
        found = [_checked(field, one, f"{name}[{i}]" if sweeps else name, faults) for i, one in enumerate(alternatives)]
        out[field] = [one for one in found if one is not None]
    return out


def _sweep_table(name: str, table: Mapping[str, Any], faults: list[str]) -> list[dict[str, Any]]:
    """``thresholds``: each entry a number, or a list of numbers to sweep."""
    lists = [value if isinstance(value, list) else [value] for value in table.values()]
    out = [_checked("thresholds", dict(zip(table, row)), name, faults) for row in itertools.product(*lists)]
    return [one for one in out if one is not None]


def _checked(field: str, value: Any, name: str, faults: list[str]) -> dict[str, Any] | None:
    """Settings fields of one value, alone judged by its type and by ``Settings`` itself; None where it is at fault."""
    try:
        if field == "size":
            return _try(_size(value))
        if field == "frames":
            value = _frames(value)
        elif field in LISTS and isinstance(value, str):
            value = [word.strip() for word in value.split(",") if word.strip()]
        return _try({field: msgspec.convert(value, FIELD_TYPES[field])})
    except msgspec.ValidationError as error:
        faults.append(f"{name} is {value!r}: {str(error).replace('`', '')}")
    except TaubenchError as error:
        faults.append(f"{name}: {error}")
    return None


def _try(fields: dict[str, Any]) -> dict[str, Any]:
    Settings.of(**fields)
    return fields


def _size(value: Any) -> dict[str, int]:
    width, by, height = value.lower().partition("x") if isinstance(value, str) else ("", "", "")
    if not (by and width.isdecimal() and height.isdecimal()):
        raise SettingsError(f"{value!r} is not a size such as '1920x1080'")
    return {"width": int(width), "height": int(height)}


def _frames(value: Any) -> list[int | None]:
    first, colon, stop = value.partition(":") if isinstance(value, str) else ("", "", "")
    try:
        if not colon:
            raise ValueError
        return [int(end) if end.strip() else None for end in (first, stop)]
    except ValueError:
        raise SettingsError(f"{value!r} is not a range of frames such as '0:24', '100:' or ':-1'") from None


def _scenes(
    values: Any, folder: Path, resolve: Resolver, faults: list[str]
) -> Iterator[tuple[str, str, dict[str, Any], dict[str, list[dict[str, Any]]]]]:
    """(as written, what to load, settings of its registry row, its own choices) of every scene there is."""
    if not isinstance(values, list) or not values:
        what = "missing" if values is None else "empty" if values == [] else f"{values!r}, no list"
        faults.append(f'scenes is {what} (give paths, patterns or names: scenes = ["a.glb", "more/*.glb"])')
        return
    for i, entry in enumerate(values):
        where = f"scenes[{i}]"
        own: dict[str, list[dict[str, Any]]] = {}
        if isinstance(entry, dict) and isinstance(entry.get(SCENE_KEY), str):
            own = read_choices({k: v for k, v in entry.items() if k != SCENE_KEY}, f"{where}.", faults)
            entry = entry[SCENE_KEY]
        if not isinstance(entry, str) or not entry:
            faults.append(f'{where} is {entry!r} (give text, or a table such as {{ path = "a.glb", camera = "Top" }})')
            continue
        try:
            for written, scene, row in _one_scene(entry, folder, resolve):
                yield written, scene, row, own
        except TaubenchError as error:
            faults.append(f"{where}: {error}")


def _one_scene(text: str, folder: Path, resolve: Resolver) -> Iterator[tuple[str, str, dict[str, Any]]]:
    if text.startswith("exr:"):
        raise SettingsError(f"{text} is path-traced; a batch renders", hint="use taubench-gl evaluate exr:DIR")
    plain = text.partition("@")[0]
    sequence = plain.lower().endswith(".obj") and any(c in plain for c in "*%?[")  # numbered files are one scene
    if sequence:
        yield text, str(folder.absolute() / text), {}
        return
    if any(c in text for c in "*?["):
        found = sorted(p for p in glob.glob(text, root_dir=folder, recursive=True) if (folder / p).is_file())
        if not found:
            raise SettingsError(f"no file matches {text!r}", where=str(folder))
        for one in found:
            yield one, str((folder / one).absolute()), {}
        return
    if (folder / plain).exists():
        yield text, str((folder / text).absolute()), {}
        return
    scene, row = resolve(text)
    if scene == text:
        raise SettingsError(f"there is no file {text!r}, and no known scene of that name", where=str(folder))
    yield text, scene, row


def _combine(
    written: str, scene: str, row: dict[str, Any], choices: Mapping[str, list[dict[str, Any]]]
) -> Iterator[Job]:
    """The cartesian product of all sweeps, in the order of the file."""
    swept = [key for key, alternatives in choices.items() if len(alternatives) > 1]
    for picks in itertools.product(*choices.values()):
        fields = row | {name: value for pick in picks for name, value in pick.items()}
        settings = Settings.of(**fields)
        sweep = {key: _shown(key, pick) for key, pick in zip(choices, picks) if key in swept}
        yield Job(job_id(written, settings), scene, settings, sweep)


def _shown(key: str, pick: Mapping[str, Any]) -> Any:
    if key == "size":
        return f"{pick['width']}x{pick['height']}"
    value = next(iter(pick.values()))
    if key == "frames":
        return range_text(value)
    if isinstance(value, dict):
        return " ".join(f"{name}={number:g}" for name, number in value.items())
    return list(value) if isinstance(value, tuple) else value


def job_id(written: str, settings: Settings) -> str:
    """Name of a job's folder: the scene's, and a hash of scene (as the study writes it) and settings."""
    text = json.dumps([written, settings.to_dict()], sort_keys=True)
    return f"{_safe(Path(written).stem) or 'scene'}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def _safe(text: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "_" for c in text).strip("._")[:60]
