"""``taubench-gl evaluate``: statistics of one scene or of several."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.options import command, given_options, require_used
from taubench_gl.apps.screen import for_each_scene, interruptible, note, warn
from taubench_gl.errors import SettingsError
from taubench_gl.fields import setting, some_of
from taubench_gl.glossary import COLUMNS, definitions
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.settings import OUTPUT, SCENE, Settings

if TYPE_CHECKING:
    from taubench_gl.run import Run

SAVE = ("masks", "channels")
PRESET = setting(
    None,
    "Settings recommended by 'taubench-gl cost', without scene, camera and frames of its study; options given beside "
    "it take precedence",
    group=SCENE,
    short=False,
    metavar="FILE",
)


@command(epilog="\b\nColumns of Table 4 (all terms: docs/glossary.md):\n" + definitions(COLUMNS))
@click.argument("scenes", nargs=-1, required=True, metavar="SCENE...")
def evaluate(
    scenes: tuple[str, ...],
    settings: Settings,
    path_traced: PathTracedOptions,
    *,
    out: Path | None = setting(None, "Also write the results to this folder", group=OUTPUT, metavar="DIR"),
    save: tuple[str, ...] = setting(
        (), "Also write masks and/or channels of each pair, comma-separated", some_of(SAVE), group=OUTPUT
    ),
    report: bool = setting(False, "Also write report.html and its images", group=OUTPUT),
    report_full: bool = setting(
        False,
        "As --report, with the distances of every pixel: in the page thresholds repaint the masks",
        group=OUTPUT,
        short=False,
    ),
    verbose: bool = setting(False, "Print all tables, with the paper's rows and the notes of each", group=OUTPUT),
    preset: Path | None = PRESET,
) -> int:
    """Measure how much of each frame the next one can reuse: the share, its reasons, and the paper's Tables 1 to 4.

    SCENE is a glTF 2.0 file (.glb or .gltf), an .obj, .aff or .nff file, a folder or a quoted pattern of numbered OBJ
    files ("name*.obj@30"), exr:DIR (a folder of path-traced OpenEXR frames), or the name of a scene that 'scenes get'
    unpacked (also scene:NAME), with its frame rate, frames, camera and units.  If one of several scenes fails, the
    others are still evaluated and the exit code is 2.

    Examples:
      taubench-gl evaluate scene.glb
      taubench-gl evaluate scene.glb --out results --save masks
      taubench-gl evaluate scene.glb --out results --report
      taubench-gl evaluate scene.glb --out results --report-full --frames 0:24
      taubench-gl evaluate a.glb b.gltf --out results --size 1280x720 --fps 60
      taubench-gl evaluate scene.glb --frames 0:25 --reprojection motion --threshold normal=0.05
      taubench-gl evaluate scene.glb --exact --reprojection motion
      taubench-gl evaluate scene.glb --columns frustum,position,direct --environment 0.2,0.3,0.5 --exposure 0.5
      taubench-gl evaluate scene.glb --preset study/within-60s.toml
      taubench-gl evaluate bart-museum --size 960x540
      taubench-gl evaluate exr:renders --camera-file renders/camera.json --lobe glossy

    With --out, DIR receives summary.json, frames.csv (one row per finished pair, also after an interrupt), tables as
    text, Markdown, CSV and LaTeX, and plots.  Several scenes get one folder each in DIR.
    """
    for name, wanted in (("save", save), ("report-full", report_full), ("report", report)):
        if wanted and out is None:
            raise click.UsageError(f"--{name} needs --out DIR")
    kind = "full" if report_full else report
    settings = with_preset(settings, preset)
    _require_used(scenes, path_traced)
    runs: list[Run] = []

    def run(scene: str, folder: Path | None) -> None:
        with interruptible(lambda: _kept(folder, runs)):
            runs.append(_evaluate_one(scene, settings, path_traced, folder, save, kind))

    failed = for_each_scene(scenes, out, run)
    if runs:
        _show(runs, report=bool(kind), verbose=verbose)
    if failed:
        warn(f"{failed} of {len(scenes)} scenes failed")
    return 2 if failed else 0


def with_preset(settings: Settings, file: Path | None) -> Settings:
    """``settings`` with those of a preset that the user did not give to the running command.  Raises SettingsError."""
    if file is None:
        return settings
    from taubench_gl.preset import load_preset

    values, by_user = load_preset(file), given_options()
    if "size" in by_user:
        by_user |= {"width", "height"}
    changed = {name: value for name, value in values.items() if name not in by_user}
    if "thresholds" in values:
        changed["thresholds"] = values["thresholds"] | click.get_current_context().params["thresholds"]
    settings = settings.replace(**changed)
    require_used(settings)
    if not by_user & {"frames", "camera"}:
        note(f"preset {file}: its settings, with camera and frames of this command; [measured] has those of its study")
    return settings


def _require_used(scenes: Sequence[str], path_traced: PathTracedOptions) -> None:
    """Check that no option was given that all ``scenes`` ignore: path-traced files have their own size and camera.

    Options for path-traced files do not concern rasterized scenes beside them, nor the other way around.  Raises
    SettingsError.
    """
    from taubench_gl.pathtraced.sequence import is_sequence

    if not any(is_sequence(scene) for scene in scenes):
        for name in ("camera_file", "scene_file", "mapping", "layer", "view", "second_seed"):
            if getattr(path_traced, name):
                message = f"--{name.replace('_', '-')} is for path-traced files"
                raise SettingsError(message, where=scenes[0], hint="give them as exr:DIR")
    if not all(is_sequence(scene) for scene in scenes):
        return
    by_user = given_options(("size", "camera"))
    if "size" in by_user:
        raise SettingsError("--size has no effect", where=scenes[0], hint="leave it out: the files have a size")
    if "camera" in by_user and path_traced.scene_file is None:
        hint = "leave it out, or give --scene-file SCENE to choose among its cameras"
        raise SettingsError("--camera has no effect", where=scenes[0], hint=hint)


def _evaluate_one(
    scene: str,
    settings: Settings,
    path_traced: PathTracedOptions,
    out: Path | None,
    save: tuple[str, ...],
    report: bool | str,
) -> Run:
    """Evaluate one scene or sequence as ``api.evaluate`` does.  Raises SettingsError where it has no pair."""
    from taubench_gl.api import evaluate as evaluate_scene
    from taubench_gl.apps.named_scenes import resolve, row_settings
    from taubench_gl.apps.progress import ProgressBar
    from taubench_gl.pathtraced.sequence import is_sequence

    scene, row = resolve(scene, settings.sequence.animation)
    settings = settings.replace(**row_settings(row))
    options: dict[str, Any] = {"path_traced": path_traced}
    if not is_sequence(scene):
        options = {"lobes": path_traced.lobes}
    with ProgressBar(scene) as progress:
        run = evaluate_scene(scene, settings, out=out, save=save, report=report, progress=progress, **options)
    if not run.summary["pairs"]:
        raise SettingsError("there is one frame and no pair", where=scene, hint=_hint_without_pair(run, settings))
    return run


def _hint_without_pair(run: Run, settings: Settings) -> str:
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


def _show(runs: list[Run], *, report: bool, verbose: bool) -> None:
    from taubench_gl.apps.screen import show_notes, show_tables
    from taubench_gl.report import run_tables, short_tables
    from taubench_gl.report.page import REPORT_FILE

    show_tables((run_tables if verbose else short_tables)([run.summary for run in runs]))
    for run in runs:
        show_notes(run.summary.get("notes", ()), run.summary["scene"]["name"])
        if run.out is not None:
            tables = "" if verbose else " (tables.txt: Tables 1 to 4 with the paper's rows)"
            click.echo(f"written to {run.out}{os.sep}{tables}")
            if report:
                click.echo(f"report: {run.out / REPORT_FILE}")


def _kept(folder: Path | None, runs: list[Run]) -> str:
    """Which results are kept after an interrupt, in words."""
    from taubench_gl.run import FRAMES_FILE, read_frames

    if folder is None:
        return "nothing was written (--out DIR keeps finished pairs)"
    frames = folder / FRAMES_FILE
    kept = f"{len(read_frames(frames))} finished pairs are in {frames}" if frames.is_file() else "no pair was finished"
    whole = f"; {len(runs)} finished scenes are in {folder.parent}" if runs else ""
    return f"{kept}{whole}"
