"""``taubench-gl evaluate``: the main job, for one scene or several in turn."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.accuracy_options import accuracy_options, preset_option, with_preset
from taubench_gl.apps.option_types import OutPath, Words
from taubench_gl.apps.options import (
    frame_options,
    given_options,
    gpu_options,
    light_options,
    pair_options,
    path_traced_options,
    settings_from,
)
from taubench_gl.errors import SettingsError, TaubenchError

if TYPE_CHECKING:
    from taubench_gl.run import Run
    from taubench_gl.settings import Settings

SAVE = ("masks", "channels")


@click.command(
    epilog="""\b
Examples:
  taubench-gl evaluate scene.glb
  taubench-gl evaluate scene.glb --out results --save masks
  taubench-gl evaluate scene.glb --out results --report
  taubench-gl evaluate a.glb b.gltf --out results --size 1280x720 --fps 60
  taubench-gl evaluate scene.glb --frames 0:25 --reprojection motion --threshold normal=0.05
  taubench-gl evaluate scene.glb --columns frustum,position,direct --sky 0.2,0.3,0.5 --exposure 0.5
  taubench-gl evaluate scene.glb --preset study/preset.toml
  taubench-gl evaluate bart-museum --size 960x540
  taubench-gl evaluate exr:renders --camera-file renders/camera.json --lobe glossy
\b
With --out, DIR holds summary.json and frames.csv (one row per finished pair, also after an interrupt),
tables as text, Markdown, CSV and LaTeX, and plots.  Several scenes get one folder each inside DIR."""
)
@click.argument("scenes", nargs=-1, required=True, metavar="SCENE...")
@frame_options()
@pair_options()
@click.option("--out", type=OutPath(), metavar="DIR", help="Write results here, not only print.")
@click.option("--save", type=Words(*SAVE), default="", help="Also write masks, channels (comma-separated) per pair.")
@click.option("--report", is_flag=True, help="Also write report.html, one page to look at, and its pictures.")
@preset_option
@light_options
@accuracy_options
@path_traced_options
@gpu_options
def evaluate(scenes: tuple[str, ...], out: Path | None, save: tuple[str, ...], report: bool, **options: Any) -> int:
    """Measure how much of each frame can be reused in the next, and print the paper's Tables 1 to 4.

    SCENE is a glTF 2.0 file (.glb or .gltf), an .obj, .aff or .nff file, a folder or pattern of numbered OBJ files
    ("name*.obj@30", quoted), exr:DIR, a folder of path-traced OpenEXR frames, or the name of a scene that 'scenes get'
    brought (also as scene:NAME), with its rate, frames, camera and units.  One scene that fails does not stop the
    others; the exit code is then 2.
    """
    if save and out is None:
        raise click.UsageError("--save needs --out DIR to write to")
    if report and out is None:
        raise click.UsageError("--report needs --out DIR to write to")
    path_traced = {
        name: options.pop(name) for name in ("camera_file", "scene_file", "mapping", "layer", "lobes", "second_seed")
    }
    settings = settings_from(with_preset(options, options.pop("preset")))
    _require_effect(scenes, scene_file=path_traced["scene_file"])
    folders = out_folders(scenes, out)
    runs: list[Run] = []
    failed = 0
    for scene, folder in zip(scenes, folders, strict=True):
        try:
            runs.append(_evaluate_one(scene, settings, folder, save, path_traced, report))
        except TaubenchError as error:
            if len(scenes) == 1:
                raise
            _say(f"error: {error}")
            failed += 1
        except KeyboardInterrupt:
            _say(_interrupted(folder, runs))
            raise click.exceptions.Exit(130) from None
        except Exception:
            # A fault of ours in one scene of a batch: shown in full, and the night's other scenes still run.
            if len(scenes) == 1:
                raise
            traceback.print_exc()
            _say(f"error: {scene}: internal error, see above")
            failed += 1
    if runs:
        _show(runs)
    if failed:
        _say(f"{failed} of {len(scenes)} scenes failed")
    return 2 if failed else 0


def _require_effect(scenes: Sequence[str], *, scene_file: str | None) -> None:
    """Refuse what was given for nothing: path-traced files have their size, and the camera that took them.

    Beside a scene that is drawn such an option is for that one.  Raises SettingsError.
    """
    from taubench_gl.pathtraced.sequence import is_sequence

    if not all(is_sequence(scene) for scene in scenes):
        return
    given = given_options(("size", "camera"))
    if "size" in given:
        raise SettingsError("--size does nothing here", where=scenes[0], hint="leave it out: the size is the files'")
    if "camera" in given and scene_file is None:
        hint = "leave it out: it chooses among the cameras of --scene-file SCENE"
        raise SettingsError("--camera does nothing here", where=scenes[0], hint=hint)


def out_folders(scenes: Sequence[str], out: Path | None) -> list[Path | None]:
    """Where each scene's results go: ``out`` itself for one scene, else a folder in it named after the file.

    Equal names get -2, -3 and so on, never one that another scene has (compared without case, as some disks do).
    """
    if out is None:
        return [None] * len(scenes)
    if len(scenes) == 1:
        return [out]
    taken: set[str] = set()
    stems = [Path(scene).stem or "scene" for scene in scenes]
    folders: list[Path | None] = []
    for i, stem in enumerate(stems):
        others = {other.lower() for j, other in enumerate(stems) if j != i}
        name, number = stem, 1
        while name.lower() in taken or (number > 1 and name.lower() in others):
            number += 1
            name = f"{stem}-{number}"
        taken.add(name.lower())
        folders.append(out / name)
    return folders


def _evaluate_one(
    scene: str,
    settings: Settings,
    folder: Path | None,
    save: tuple[str, ...],
    path_traced: dict[str, Any],
    report: bool,
) -> Run:
    from taubench_gl.api import evaluate as evaluate_scene
    from taubench_gl.apps.named_scenes import asked_for, resolve
    from taubench_gl.apps.screen import ProgressBar
    from taubench_gl.pathtraced.sequence import is_sequence

    more: dict[str, Any] = {}
    scene, row = resolve(scene)
    settings = settings.replace(**asked_for(row))
    if is_sequence(scene):
        from taubench_gl.pathtraced.evaluation import PathTracedOptions

        more["path_traced"] = PathTracedOptions(**path_traced)
    elif any(path_traced.values()):
        given = next(name for name, value in path_traced.items() if value).replace("_", "-").removesuffix("s")
        raise SettingsError(f"--{given} is for path-traced files", where=scene, hint="name them exr:DIR")
    with ProgressBar(Path(scene).name) as progress:
        return evaluate_scene(scene, settings, out=folder, save=save, progress=progress, report=report, **more)


def _show(runs: list[Run]) -> None:
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.report import paper_tables

    show_tables(paper_tables([run.summary for run in runs]))
    for run in runs:
        name = run.summary["scene"]["name"]
        # Capped: a broken exporter can produce one note per node, and all of them are in summary.json.
        notes = [str(note) for note in run.summary.get("notes", ())]
        for note in notes[:10]:
            click.echo(f"note: {name}: {note}")
        if len(notes) > 10:
            click.echo(f"note: {name}: and {len(notes) - 10} more, see summary.json")
        if run.out is not None:
            click.echo(f"written to {run.out}{os.sep}")


def _interrupted(folder: Path | None, runs: list[Run]) -> str:
    """What is left after an interrupt, said in one line."""
    from taubench_gl.run import FRAMES_FILE, read_frames

    if folder is None:
        return "interrupted; nothing was written (--out DIR keeps finished pairs)"
    frames = folder / FRAMES_FILE
    kept = f"{len(read_frames(frames))} finished pairs are in {frames}" if frames.is_file() else "no pair was finished"
    whole = f"; {len(runs)} finished scenes are in {folder.parent}" if runs else ""
    return f"interrupted; {kept}{whole}"


def _say(line: str) -> None:
    click.echo(f"taubench-gl: {line}", file=sys.stderr)
