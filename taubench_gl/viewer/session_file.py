"""The session file: what is open in the viewer and how it is shown, as JSON.

Files beside it or below its folder are named relative to it, so that a folder with both can be moved.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from taubench_gl.data_files import read_json
from taubench_gl.errors import OutputError, TaubenchError
from taubench_gl.outputs import write_atomically
from taubench_gl.pathtraced.evaluation import PathTracedOptions
from taubench_gl.pathtraced.sequence import PREFIX
from taubench_gl.settings import Settings
from taubench_gl.viewer.cameras import UserCamera
from taubench_gl.viewer.feeds import OpenRequest
from taubench_gl.viewer.state import ViewerState, set_variable, variable_names, variables

SCHEMA = "taubench-gl/viewer/1"
SUFFIX = ".session.json"
_OPTIONS = ("camera_file", "scene_file", "mapping", "layer")
"""Of PathTracedOptions."""
_NOT_KEPT = ("playing", "help")
Resolve = Callable[[str], tuple[str, dict[str, Any]]]


class _Pose(msgspec.Struct, forbid_unknown_fields=True):
    position: tuple[float, float, float]
    yaw: float
    pitch: float


class _File(msgspec.Struct, forbid_unknown_fields=True):
    schema: str
    source: str
    settings: dict[str, Any]
    given: list[str]
    values: dict[str, str | int | float]
    camera: _Pose | None = None
    lesson: str = ""
    reference: str | None = None
    run: str | None = None
    method: str | None = None
    path_traced: dict[str, str | None] = {}


@dataclass(frozen=True, slots=True)
class Restored:
    """How the viewer showed a source: values of variables, and the camera of the user, None for that of the source.

    ``lesson``: text of the section lesson.
    """

    values: Mapping[str, str | int | float]
    camera: _Pose | None = None
    lesson: str = ""

    def apply(self, state: ViewerState, camera: UserCamera) -> list[str]:
        """Set values and camera; the names of values that do not fit what is open."""
        if self.camera is not None:
            camera.position[:] = self.camera.position
            camera.yaw, camera.pitch = self.camera.yaw, self.camera.pitch
        state.lesson = self.lesson
        left = []
        for name, value in self.values.items():
            try:
                set_variable(state, name, str(value))
            except TaubenchError:
                left.append(name)
        return left


def is_session(text: str) -> bool:
    return text.endswith(SUFFIX)


def save(path: Path, request: OpenRequest, state: ViewerState, camera: UserCamera) -> None:
    """Write a session file.  Raises OutputError."""
    folder, now = path.parent, variables(state)
    named = {"method"} if state.method == request.method else set()  # the request has its path, relative to the file
    options = {name: getattr(request.options, name) for name in _OPTIONS}
    file = _File(
        SCHEMA,
        _stored(request.source, folder),
        request.settings.to_dict(),
        sorted(request.given),
        {name: now[name] for name in variable_names(state) if name not in {*_NOT_KEPT, *named}},
        _Pose(tuple(map(float, camera.position)), float(camera.yaw), float(camera.pitch)),
        state.lesson,
        None if request.reference is None else _stored(request.reference, folder),
        None if request.run is None else _stored(request.run, folder),
        None if request.method is None else _stored(request.method, folder),
        {name: None if value is None else _stored(str(value), folder) for name, value in options.items()},
    )
    write_atomically(path, json.dumps(msgspec.to_builtins(file), indent=1) + "\n")


def save_lesson(
    path: Path, source: str, settings: Settings, values: Mapping[str, str | int | float], lesson: str
) -> None:
    """Write a session file that opens ``source`` with ``values`` of variables and the text ``lesson``.

    Raises OutputError.
    """
    given = [name for name, value in settings.to_dict().items() if value != Settings().to_dict().get(name)]
    file = _File(SCHEMA, _stored(source, path.parent), settings.to_dict(), given, dict(values), None, lesson)
    write_atomically(path, json.dumps(msgspec.to_builtins(file), indent=1) + "\n")


def load(path: str | Path, resolve: Resolve | None = None) -> OpenRequest:
    """The request that a session file stores, with ``restored``.  Raises OutputError and SettingsError."""
    value = read_json(path, _File)
    if value["schema"] != SCHEMA:
        message = f"schema is {value['schema']!r}, expected {SCHEMA!r}"
        raise OutputError(message, where=str(path), hint="save the session with this version")
    file, folder = msgspec.convert(value, _File), Path(path).parent
    if unknown := sorted(set(file.path_traced) - set(_OPTIONS)):
        raise OutputError(f"there is no option {unknown[0]!r} of path-traced files", where=str(path))
    paths = {name: value and _found(value, folder) for name, value in file.path_traced.items()}
    options = {n: Path(v) if v and n.endswith("_file") else v for n, v in paths.items()}
    return OpenRequest(
        _found(file.source, folder),
        Settings.from_dict(file.settings),
        file.reference and _found(file.reference, folder),
        PathTracedOptions(**options),
        frozenset(file.given),
        resolve,
        run=file.run and _found(file.run, folder),
        method=file.method and _found(file.method, folder),
        restored=Restored(file.values, file.camera, file.lesson),
    )


def _stored(text: str, folder: Path) -> str:
    """``text`` relative to ``folder`` if it is a path that exists."""
    prefix = PREFIX if text.startswith(PREFIX) else ""
    path = Path(text.removeprefix(PREFIX))
    return prefix + os.path.relpath(path, folder) if path.exists() else text


def _found(text: str, folder: Path) -> str:
    """The inverse of ``_stored``."""
    prefix = PREFIX if text.startswith(PREFIX) else ""
    path = folder / text.removeprefix(PREFIX)
    return prefix + str(path) if path.exists() else text
