"""``taubench-gl evaluate``: statistics of one scene or of several."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.accuracy_options import accuracy_options, preset_option, with_preset
from taubench_gl.apps.options import (
    OutPath,
    Words,
    frame_options,
    given_options,
    gpu_options,
    light_options,
    pair_options,
    path_traced_options,
    settings_from,
)
from taubench_gl.errors import SettingsError, TaubenchError
from taubench_gl.glossary import COLUMNS, definitions

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
  taubench-gl evaluate scene.glb --out results --report-full --frames 0:24
  taubench-gl evaluate a.glb b.gltf --out results --size 1280x720 --fps 60
  taubench-gl evaluate scene.glb --frames 0:25 --reprojection motion --threshold normal=0.05
  taubench-gl evaluate scene.glb --exact --reprojection motion
  taubench-gl evaluate scene.glb --columns frustum,position,direct --environment 0.2,0.3,0.5 --exposure 0.5
  taubench-gl evaluate scene.glb --preset study/preset.toml
  taubench-gl evaluate bart-museum --size 960x540
  taubench-gl evaluate exr:renders --camera-file renders/camera.json --lobe glossy
\b
With --out, DIR receives summary.json, frames.csv (one row per finished pair, also after an interrupt), tables as
text, Markdown, CSV and LaTeX, and plots.  Several scenes get one folder each in DIR.
\b
Columns of Table 4 (all terms: docs/glossary.md):
"""
    + definitions(COLUMNS)
)
@click.argument("scenes", nargs=-1, required=True, metavar="SCENE...")
@frame_options()
@pair_options()
@click.option("--out", type=OutPath(), metavar="DIR", help="Also write the results to this folder.")
@click.option(
    "--save", type=Words(*SAVE), default="", help="Also write masks and/or channels of each pair, comma-separated."
)
@click.option("--report", is_flag=True, help="Also write report.html and its images.")
@click.option(
    "--report-full",
    is_flag=True,
    help="As --report, with the distances of every pixel: in the page thresholds repaint the masks.",
)
@click.option(
    "--exact",
    is_flag=True,
    help="Compare the masks with exact visibility, a ray to every surface point: Table 4 gains the columns visible and "
    "occluded, and the share of each column that is misregistration (docs/reject.md).",
)
@preset_option
@light_options
@accuracy_options
@path_traced_options
@gpu_options
def evaluate(
    scenes: tuple[str, ...],
    out: Path | None,
    save: tuple[str, ...],
    report: bool,
    report_full: bool,
    **options: Any,
) -> int:
    """Measure how much of each frame the next one can reuse, and print the paper's Tables 1 to 4.

    SCENE is a glTF 2.0 file (.glb or .gltf), an .obj, .aff or .nff file, a folder or a quoted pattern of numbered OBJ
    files ("name*.obj@30"), exr:DIR (a folder of path-traced OpenEXR frames), or the name of a scene that 'scenes get'
    downloaded (also scene:NAME), with its frame rate, frames, camera and units.  If one of several scenes fails, the
    others are still evaluated and the exit code is 2.
    """
    if save and out is None:
        raise click.UsageError("--save needs --out DIR")
    if (report or report_full) and out is None:
        raise click.UsageError(f"{'--report-full' if report_full else '--report'} needs --out DIR")
    kind = "full" if report_full else report
    path_traced = {
        name: options.pop(name) for name in ("camera_file", "scene_file", "mapping", "layer", "lobes", "second_seed")
    }
    settings = settings_from(with_preset(options, options.pop("preset")))
    _require_used(scenes, scene_file=path_traced["scene_file"])
    folders = out_folders(scenes, out)
    runs: list[Run] = []
    failed = 0
    for scene, folder in zip(scenes, folders, strict=True):
        try:
            runs.append(_evaluate_one(scene, settings, folder, save, path_traced, report=kind))
        except TaubenchError as error:
            if len(scenes) == 1:
                raise
            _message(f"error: {error}")
            failed += 1
        except KeyboardInterrupt:
            _message(_interrupted(folder, runs))
            raise click.exceptions.Exit(130) from None
        except Exception:
            # An internal error in one of several scenes: print the traceback, evaluate the other scenes.
            if len(scenes) == 1:
                raise
            traceback.print_exc()
            _message(f"error: {scene}: internal error, see above")
            failed += 1
    if runs:
        _show(runs, report=bool(kind))
    if failed:
        _message(f"{failed} of {len(scenes)} scenes failed")
    return 2 if failed else 0


def _require_used(scenes: Sequence[str], *, scene_file: str | None) -> None:
    """Check that no option was given that path-traced files ignore: they have their own size and camera.

    With a rasterized scene among ``scenes`` such an option applies to that scene.  Raises SettingsError.
    """
    from taubench_gl.pathtraced.sequence import is_sequence

    if not all(is_sequence(scene) for scene in scenes):
        return
    given = given_options(("size", "camera"))
    if "size" in given:
        raise SettingsError("--size has no effect", where=scenes[0], hint="leave it out: the files have a size")
    if "camera" in given and scene_file is None:
        hint = "leave it out, or give --scene-file SCENE to choose among its cameras"
        raise SettingsError("--camera has no effect", where=scenes[0], hint=hint)


def out_folders(scenes: Sequence[str], out: Path | None) -> list[Path | None]:
    """Folder of each scene's results: ``out`` itself for one scene, else a folder in it named after the file.

    Equal names get -2, -3, ..., never the name of another scene.  Case is ignored, as some file systems do.
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
    **how: bool | str,
) -> Run:
    from taubench_gl.api import evaluate as evaluate_scene
    from taubench_gl.apps.named_scenes import resolve, row_settings
    from taubench_gl.apps.screen import ProgressBar
    from taubench_gl.pathtraced.sequence import is_sequence

    more: dict[str, Any] = {}
    scene, row = resolve(scene)
    settings = settings.replace(**row_settings(row))
    if is_sequence(scene):
        from taubench_gl.pathtraced.evaluation import PathTracedOptions

        more["path_traced"] = PathTracedOptions(**path_traced)
    else:
        more["lobes"] = path_traced["lobes"]
        given = next((name for name, value in path_traced.items() if value and name != "lobes"), None)
        if given is not None:
            what = f"--{given.replace('_', '-')} is for path-traced files"
            raise SettingsError(what, where=scene, hint="give them as exr:DIR")
    with ProgressBar(Path(scene).name) as progress:
        run = evaluate_scene(scene, settings, out=folder, save=save, progress=progress, **how, **more)
    if not run.summary["pairs"]:
        raise SettingsError("there is one frame and no pair", where=scene, hint=_way_to_a_pair(run, settings))
    return run


def _way_to_a_pair(run: Run, settings: Settings) -> str:
    """What to change so that a run without a pair has one."""
    from taubench_gl.animation.views import ORBIT

    sequence = settings.sequence
    if run.summary.get("path_traced"):
        return "give a folder or --frames with two consecutive frames"
    if run.summary["scene"]["duration_s"] == 0 and sequence.camera not in (None, ORBIT):
        return f"the scene and camera {sequence.camera!r} are still: leave --camera out, or give --camera {ORBIT}"
    if sequence.frames != (None, None):
        return "give --frames A:B with two frames or more"
    return f"the animation lasts {run.summary['scene']['duration_s']:.3g} s: give a higher --fps"


def _show(runs: list[Run], *, report: bool) -> None:
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.report import run_tables
    from taubench_gl.report.page import REPORT_FILE

    show_tables(run_tables([run.summary for run in runs]))
    for run in runs:
        name = run.summary["scene"]["name"]
        # At most 10: a broken exporter can produce one note per node.  summary.json has all of them.
        notes = [str(note) for note in run.summary.get("notes", ())]
        for note in notes[:10]:
            click.echo(f"note: {name}: {note}")
        if len(notes) > 10:
            click.echo(f"note: {name}: and {len(notes) - 10} more, see summary.json")
        if run.out is not None:
            click.echo(f"written to {run.out}{os.sep}")
            if report:
                click.echo(f"report: {run.out / REPORT_FILE}")


def _interrupted(folder: Path | None, runs: list[Run]) -> str:
    """One line that names the results kept after an interrupt."""
    from taubench_gl.run import FRAMES_FILE, read_frames

    if folder is None:
        return "interrupted; nothing was written (--out DIR keeps finished pairs)"
    frames = folder / FRAMES_FILE
    kept = f"{len(read_frames(frames))} finished pairs are in {frames}" if frames.is_file() else "no pair was finished"
    whole = f"; {len(runs)} finished scenes are in {folder.parent}" if runs else ""
    return f"interrupted; {kept}{whole}"


def _message(line: str) -> None:
    click.echo(f"taubench-gl: {line}", file=sys.stderr)
