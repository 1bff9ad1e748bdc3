"""The session file: what is open in the viewer and how it is shown, as JSON.

Files beside it or below its folder are named relative to it, so that a folder with both can be moved.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec

from taubench_gl.data_files import read_json
from taubench_gl.outputs import write_atomically
from taubench_gl.pathtraced.evaluation import PathTracedOptions
from taubench_gl.pathtraced.sequence import PREFIX
from taubench_gl.settings import Settings
from taubench_gl.viewer.cameras import UserCamera
from taubench_gl.viewer.feeds import OpenRequest
from taubench_gl.viewer.state import CONTROLS, ViewerState, set_variables

SCHEMA = "taubench-gl/viewer/1"
SUFFIX = ".session.json"
Resolve = Callable[[str], tuple[str, dict[str, Any]]]


class _Pose(msgspec.Struct, forbid_unknown_fields=True):
    """The camera of the user: scene units and radians."""

    position: tuple[float, float, float]
    yaw: float
    pitch: float


class _PathTraced(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What the file stores of ``PathTracedOptions``."""

    camera_file: str | None = None
    scene_file: str | None = None
    mapping: str | None = None
    layer: str | None = None
    view: str | None = None


class SessionFile(msgspec.Struct, forbid_unknown_fields=True):
    """Content of a session file.

    ``values``: of controls, by name in scripts; ``camera``: None for the camera of the source; ``lesson``: text of the
    section lesson; ``given``: settings that the user chose, which override those of a run; the rest is as in
    ``OpenRequest``.
    """

    schema: Literal["taubench-gl/viewer/1"]
    source: str
    settings: dict[str, Any]
    given: list[str]
    values: dict[str, str | int | float]
    camera: _Pose | None = None
    lesson: str = ""
    reference: str | None = None
    run: str | None = None
    method: str | None = None
    path_traced: _PathTraced = _PathTraced()

    def apply(self, state: ViewerState, camera: UserCamera) -> list[str]:
        """Set values and camera; the names of values that do not fit what is open."""
        if self.camera is not None:
            camera.position[:] = self.camera.position
            camera.yaw, camera.pitch = self.camera.yaw, self.camera.pitch
        state.lesson = self.lesson
        return set_variables(state, self.values)

    def with_paths(self, change: Callable[[str, Path], str], folder: Path) -> SessionFile:
        """A copy whose paths are ``change(path, folder)``."""

        def changed(struct: Any, names: tuple[str, ...]) -> Any:
            paths = {name: getattr(struct, name) for name in names}
            return msgspec.structs.replace(struct, **{n: p and change(p, folder) for n, p in paths.items()})

        traced = changed(self.path_traced, _PathTraced.__struct_fields__)
        moved = changed(self, ("source", "reference", "run", "method"))
        return msgspec.structs.replace(moved, path_traced=traced)

    def write(self, path: Path) -> None:
        """Write the file; its paths become relative to its folder.  Raises OutputError."""
        data = msgspec.json.encode(self.with_paths(_stored, path.parent))
        write_atomically(path, msgspec.json.format(data, indent=1).decode() + "\n")


def is_session(text: str) -> bool:
    """Whether a file of this name is a session file."""
    return text.endswith(SUFFIX)


def save(path: Path, request: OpenRequest, state: ViewerState, camera: UserCamera) -> None:
    """Write a session file.  Raises OutputError."""
    values = {n: v for c in CONTROLS.values() if c.in_session for n, v in c.read(state).items()}
    implied = {"method"} if state.method == request.method else set()  # the request has its path, relative to the file
    if state.auto_range:  # setting an end of the range would switch the automatic range off
        implied |= {"range.low", "range.high"}
    options = {name: getattr(request.options, name) for name in _PathTraced.__struct_fields__}
    SessionFile(
        schema=SCHEMA,
        source=request.source,
        settings=request.settings.to_dict(),
        given=sorted(request.given),
        values={name: value for name, value in values.items() if name not in implied},
        camera=_Pose(tuple(map(float, camera.position)), float(camera.yaw), float(camera.pitch)),
        lesson=state.lesson,
        reference=request.reference,
        run=request.run,
        method=request.method,
        path_traced=_PathTraced(**{name: None if value is None else str(value) for name, value in options.items()}),
    ).write(path)


def save_lesson(
    path: Path, source: str, settings: Settings, values: Mapping[str, str | int | float], lesson: str
) -> None:
    """Write a session file that opens ``source`` with ``values`` of variables and the text ``lesson``.

    Raises OutputError.
    """
    chosen = [name for name, value in settings.to_dict().items() if value != Settings().to_dict().get(name)]
    SessionFile(SCHEMA, source, settings.to_dict(), chosen, dict(values), lesson=lesson).write(path)


def load(path: str | Path, resolve: Resolve | None = None) -> OpenRequest:
    """The request that a session file stores, with ``restored``.  Raises OutputError and SettingsError."""
    value = read_json(path, SessionFile, hint="save the session with this version")
    file = msgspec.convert(value, SessionFile).with_paths(_found, Path(path).parent)
    options = msgspec.structs.asdict(file.path_traced)
    return OpenRequest(
        file.source,
        Settings.from_dict(file.settings),
        file.reference,
        PathTracedOptions(**{n: Path(v) if v and n.endswith("_file") else v for n, v in options.items()}),
        frozenset(file.given),
        resolve,
        run=file.run,
        method=file.method,
        restored=file,
    )


def _stored(text: str, folder: Path) -> str:
    """``text`` relative to ``folder`` if it is a path that exists."""
    prefix = PREFIX if text.startswith(PREFIX) else ""
    path = Path(text.removeprefix(PREFIX))
    return prefix + os.path.relpath(path, folder) if path.exists() else text


def _found(text: str, folder: Path) -> str:
    """A path that ``_stored`` has made relative to ``folder``, as a path from the current folder."""
    prefix = PREFIX if text.startswith(PREFIX) else ""
    path = folder / text.removeprefix(PREFIX)
    return prefix + str(path) if path.exists() else text
