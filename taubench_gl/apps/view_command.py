"""``taubench-gl view``: the interactive viewer.  Everything that needs its libraries is imported when it runs."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.aliases import former_option
from taubench_gl.apps.option_types import Size
from taubench_gl.apps.options import frame_options, given_options, light_options, pair_options, settings_from
from taubench_gl.errors import SettingsError

LIBRARIES = {"glfw": "glfw", "imgui_bundle": "imgui-bundle"}
MORE_WIDTH, MORE_HEIGHT = 300, 64


@click.command(
    epilog="""\b
Examples:
  taubench-gl view scene.glb
  taubench-gl view scene.glb --size 960x540 --reprojection motion --light
  taubench-gl view results
  taubench-gl view exr:renders --camera-file renders/camera.json
  taubench-gl view scene.glb --reference exr:renders --scene-file scene.glb
  taubench-gl view scene.glb --script steps.txt
\b
Press ? in the window for the keys; docs/viewer.md lists them, and the commands of scripts."""
)
@click.argument("source", metavar="SCENE")
@frame_options(size="640x360", fps=24.0)
@pair_options()
@light_options
@click.option("--light/--no-light", default=None, help="Start with light simulated.  [default: where a GPU does it]")
@click.option(
    "--reference", metavar="exr:DIR", help="Path-traced reference frames to compare with (split, difference)."
)
@former_option("--truth", "--reference")
@click.option("--camera-file", metavar="JSON", help="exr: camera sidecar.  [default: estimated]")
@click.option("--scene-file", metavar="SCENE", help="exr: glTF file whose camera took the pictures.")
@click.option("--mapping", metavar="NAME|FILE", help="exr: pass names; blender, mitsuba, falcor, taubench or TOML.")
@click.option("--layer", metavar="NAME", help="exr: view layer.  [default: the one with most passes]")
@click.option(
    "--script", type=click.Path(path_type=Path), metavar="FILE", help="Drive the viewer by a file of commands."
)
@click.option("--window", type=Size(), help="Window, in screen points.  [default: as last time, or to fit the picture]")
@click.option("--shots", type=click.Path(path_type=Path, file_okay=False), default=".", metavar="DIR",
              help="Where screenshots and clips go.  [default: here]")  # fmt: skip
@click.option("--bench", type=click.IntRange(min=1), metavar="N", help="Play N frames, print frames/s, and quit.")
def view(source: str, script: Path | None, bench: int | None, **options: Any) -> None:
    """Look at a scene, path-traced files or a finished run: masks, thresholds and pixels, live.

    SCENE is what evaluate takes: a file, a registry's name, or exr:DIR.  A folder that evaluate wrote opens its scene
    with its settings, at the most discarded pair.  Needs a display, and pip install taubench-gl[viewer].
    """
    missing = [pip for module, pip in LIBRARIES.items() if importlib.util.find_spec(module) is None]
    if missing:
        raise SettingsError(f"the viewer needs {' and '.join(missing)}", hint="run: pip install 'taubench-gl[viewer]'")
    _require_there(source, options["reference"])
    from taubench_gl.viewer.window import Session, run_session

    run_session(
        Session(
            asked=_asked(source, options),
            light=options["light"],
            window=options["window"],
            shots=options["shots"],
            script=script,
            bench=bench,
            # A script starts from the same state on every machine, and leaves nothing behind.
            folder=None if script is not None or bench is not None else Path(click.get_app_dir("taubench-gl")),
            say=click.echo,
        )
    )


def _asked(source: str, options: dict[str, Any]) -> Any:
    from taubench_gl.pathtraced.evaluation import PathTracedOptions
    from taubench_gl.viewer.feeds import Asked

    names = ("size", "frames", "camera", "scene", "animations", "fps", "reprojection", "sampling", "thresholds",
             "unit_scale", "culling", "textures", "columns", "effects", "sky", "exposure", "tone_map", "shadow_size",
             "shadow_lights", "shadow_filter", "light_error", "indirect")  # fmt: skip
    settings = settings_from({name: options[name] for name in names})
    path_traced = {name: options[name] for name in ("camera_file", "scene_file", "mapping", "layer")}
    return Asked(
        source, settings, options["reference"], PathTracedOptions(**path_traced), given_options(options), _resolve
    )


def _require_there(source: str, reference: str | None) -> None:
    """A name that nothing has is told before a display is asked for.  Raises TaubenchError as opening it would."""
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
        load_scene(path)  # says what is amiss


def _resolve(text: str) -> tuple[str, dict[str, Any]]:
    from taubench_gl.apps.named_scenes import asked_for, resolve

    path, row = resolve(text)
    return path, asked_for(row)
