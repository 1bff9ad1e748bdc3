"""``taubench-gl view``: the interactive viewer."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import GPU, command, given_options, option_group
from taubench_gl.errors import SettingsError
from taubench_gl.fields import setting
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.settings import SIZE, Settings, parse_size

LIBRARIES = {"glfw": "glfw", "imgui_bundle": "imgui-bundle"}
"""Module -> name of its distribution."""

WINDOW = setting(
    None,
    "Window size, screen points",
    SIZE.check,
    read=parse_size,
    metavar="WxH",
    shown="the last one, else fits the image, at least 1280x720",
    short=False,
)


@command(
    settings=option_group(without=("exact", "storage", "samples_per_pixel", "pairs", *GPU)),
    files=option_group(PathTracedOptions, without=("lobes", "second_seed")),
)
@click.argument("source", metavar="SCENE")
def view(
    source: str,
    settings: Settings,
    files: PathTracedOptions,
    *,
    lit: bool | None = setting(
        None, "Start with light enabled", flag="--lighting/--no-lighting| /--no-light", shown="only on a GPU"
    ),
    reference: str | None = setting(
        None, "Path-traced reference frames for comparison (split view, difference)", metavar="exr:DIR"
    ),
    compare: str | None = setting(None, "Another run: its scene with its settings, for comparison", metavar="RUN"),
    method: str | None = setting(
        None,
        "A reuse method, beside the image: as reuse evaluate takes it; its files are read again when they change",
        metavar="METHOD",
    ),
    script: Path | None = setting(None, "Run a script of viewer commands", metavar="FILE", short=False),
    window: tuple[int, int] | None = WINDOW,
    screenshots: Path = setting(
        Path("."), "Folder of screenshots and clips", metavar="DIR", shown="the current one", short=False
    ),
) -> None:
    """Show a scene, path-traced files or a finished run interactively: masks, thresholds, values of each pixel.

    SCENE is what evaluate takes: a file, a name of the registry, or exr:DIR.  A folder of results opens the run's
    scene with its settings at the worst frame.  A session file of the viewer (.session.json) restores what was open.
    Needs a display and pip install taubench-gl[viewer].

    Examples:
      taubench-gl view scene.glb
      taubench-gl view scene.glb --size 960x540 --reprojection motion --lighting
      taubench-gl view results
      taubench-gl view exr:renders --camera-file renders/camera.json
      taubench-gl view scene.glb --reference exr:renders --scene-file scene.glb
      taubench-gl view scene.glb --method ./my_method --lighting
      taubench-gl view scene.glb --script steps.txt

    Press ? in the window for the keys; docs/viewer.md lists them, and the script commands.
    """
    missing = [pip for module, pip in LIBRARIES.items() if importlib.util.find_spec(module) is None]
    if missing:
        raise SettingsError(f"the viewer needs {' and '.join(missing)}", hint="run: pip install 'taubench-gl[viewer]'")
    if source.endswith(".session.json"):
        request = _restored(source)
    else:
        request = _open_request(source, settings, reference, files, compare, method)
    _require_source(request.source, request.reference)
    from taubench_gl.viewer.window import Session, run_session

    # A script starts from the same state on every machine and stores no preferences.
    folder = None if script is not None else Path(click.get_app_dir("taubench-gl"))
    places = {"window": window, "screenshots": screenshots, "folder": folder}
    run_session(Session(request=request, light=lit, script=script, report=click.echo, **places))


def _open_request(
    source: str,
    settings: Settings,
    reference: str | None,
    files: PathTracedOptions,
    compare: str | None,
    method: str | None,
) -> Any:
    from taubench_gl.reuse.loading import load_method
    from taubench_gl.viewer.feeds import OpenRequest

    if method is not None:
        load_method(method)  # a mistake is an error before a window opens
    return OpenRequest(source, settings, reference, files, given_options(), _resolve, run=compare, method=method)


def _restored(source: str) -> Any:
    """The request of a session file.  Raises SettingsError for options that it has itself."""
    from taubench_gl.viewer.session_file import load

    conflicting = sorted(given_options() - {"source", "lit", "window", "screenshots", "script", "bench"})
    if conflicting:
        message = f"a session file has its own {conflicting[0].replace('_', ' ')}"
        raise SettingsError(message, hint=f"leave --{conflicting[0].replace('_', '-')} out")
    return load(source, _resolve)


def _require_source(source: str, reference: str | None) -> None:
    """Check that the files exist before a display is needed.  Raises TaubenchError as opening them would."""
    from taubench_gl.pathtraced.sequence import find_frames, is_sequence
    from taubench_gl.scene import is_sequence as is_obj_sequence
    from taubench_gl.scene import load_scene
    from taubench_gl.viewer.feeds import is_run

    for spec in (text for text in (source, reference) if text and is_sequence(text)):
        find_frames(spec)
    if is_sequence(source) or is_run(source):
        return
    path = _resolve(source)[0]
    if not (is_obj_sequence(path) or os.path.exists(path)):
        load_scene(path)  # raises the error of a missing file


def _resolve(text: str) -> tuple[str, dict[str, Any]]:
    from taubench_gl.apps.named_scenes import resolve, row_settings

    path, row = resolve(text)
    return path, row_settings(row)
