"""``taubench-gl view``: the interactive viewer."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import (
    Size,
    exr_options,
    frame_options,
    given_options,
    light_options,
    pair_options,
    settings_from,
    with_options,
)
from taubench_gl.errors import SettingsError

LIBRARIES = {"glfw": "glfw", "imgui_bundle": "imgui-bundle"}
"""Module -> name of its distribution."""


@click.command(
    epilog="""\b
Examples:
  taubench-gl view scene.glb
  taubench-gl view scene.glb --size 960x540 --reprojection motion --lighting
  taubench-gl view results
  taubench-gl view exr:renders --camera-file renders/camera.json
  taubench-gl view scene.glb --reference exr:renders --scene-file scene.glb
  taubench-gl view scene.glb --script steps.txt
\b
Press ? in the window for the keys; docs/viewer.md lists them, and the script commands."""
)
@click.argument("source", metavar="SCENE")
@frame_options(size="640x360", fps=24.0)
@pair_options()
@light_options
@click.option(
    "--lighting/--no-lighting",
    " /--no-light",
    "lit",
    default=None,
    help="Start with light enabled.  [default: only on a GPU]",
)
@click.option(
    "--reference", metavar="exr:DIR", help="Path-traced reference frames for comparison (split view, difference)."
)
@click.option("--compare", metavar="RUN", help="Another run: its scene with its settings, for comparison.")
@lambda command: with_options(command, *exr_options)
@click.option("--script", type=click.Path(path_type=Path), metavar="FILE", help="Run a script of viewer commands.")
@click.option(
    "--window",
    type=Size(),
    help="Window size, screen points.  [default: the last one, else fits the image, at least 1280x720]",
)
@click.option("--screenshots", type=click.Path(path_type=Path, file_okay=False), default=".", metavar="DIR",
              help="Folder of screenshots and clips.  [default: the current one]")  # fmt: skip
@click.option("--bench", type=click.IntRange(min=1), metavar="N", help="Play N frames, print frames per second, quit.")
def view(source: str, script: Path | None, bench: int | None, **options: Any) -> None:
    """Show a scene, path-traced files or a finished run interactively: masks, thresholds, values of each pixel.

    SCENE is what evaluate takes: a file, a name of the registry, or exr:DIR.  A folder of results opens the run's
    scene with its settings at the worst frame.  A session file of the viewer (.session.json) restores what was open.
    Needs a display and pip install taubench-gl[viewer].
    """
    missing = [pip for module, pip in LIBRARIES.items() if importlib.util.find_spec(module) is None]
    if missing:
        raise SettingsError(f"the viewer needs {' and '.join(missing)}", hint="run: pip install 'taubench-gl[viewer]'")
    request = _restored(source, options) if source.endswith(".session.json") else _open_request(source, options)
    _require_source(request.source, request.reference)
    from taubench_gl.viewer.window import Session, run_session

    run_session(
        Session(
            request=request,
            light=options["lit"],
            window=options["window"],
            screenshots=options["screenshots"],
            script=script,
            bench=bench,
            # A script starts from the same state on every machine and stores no preferences.
            folder=None if script is not None or bench is not None else Path(click.get_app_dir("taubench-gl")),
            report=click.echo,
        )
    )


def _open_request(source: str, options: dict[str, Any]) -> Any:
    from taubench_gl.pathtraced.evaluation import PathTracedOptions
    from taubench_gl.viewer.feeds import OpenRequest

    names = ("size", "frames", "camera", "scene", "animations", "strict", "fps", "reprojection", "sampling",
             "thresholds", "unit_scale", "culling", "blend", "textures", "columns", "effects", "light_unit", "exposure",
             "environment", "light", "spp", "bounces", "bidirectional", "pattern", "seed",
             "tone_map", "shadow_size", "shadow_lights", "shadow_filter", "light_error", "indirect")  # fmt: skip
    settings = settings_from({name: options[name] for name in names})
    path_traced = {name: options[name] for name in ("camera_file", "scene_file", "mapping", "layer")}
    return OpenRequest(
        source, settings, options["reference"], PathTracedOptions(**path_traced), given_options(options), _resolve,
        run=options["compare"],
    )  # fmt: skip


def _restored(source: str, options: dict[str, Any]) -> Any:
    """The request of a session file.  Raises SettingsError for options that it has itself."""
    from taubench_gl.viewer.session_file import load

    given = sorted(given_options(options)) + [name for name in ("reference", "compare") if options[name] is not None]
    if given:
        what = f"a session file has its own {given[0].replace('_', ' ')}"
        raise SettingsError(what, hint=f"leave --{given[0].replace('_', '-')} out")
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
