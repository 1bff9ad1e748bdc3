"""``taubench-gl check``: which conventions of an EXR sequence are not those of its mapping."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from taubench_gl.apps.options import AS_JSON, command, option_group
from taubench_gl.apps.screen import show_json, show_tables
from taubench_gl.fields import at_least, setting
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.settings import OUTPUT, Settings

if TYPE_CHECKING:
    from taubench_gl.pathtraced.check import Check
    from taubench_gl.pathtraced.evaluation import PathTracedPlan


@command(
    settings=option_group(only=("camera", "fps", "frames")),
    files=option_group(PathTracedOptions, without=("lobes", "second_seed")),
)
@click.argument("spec", metavar="exr:DIR")
def check(
    spec: str,
    settings: Settings,
    files: PathTracedOptions,
    *,
    pairs: int = setting(4, "Most pairs of consecutive frames to check", at_least(1)),
    allow_unjudged: bool = setting(False, "Exit with 0 where vectors cannot be judged but nothing is wrong"),
    write_mapping: Path | None = setting(
        None,
        "Write a mapping: passes by the names of their channels unless --mapping is given, conventions as found; the "
        "check is then made with it",
        group=OUTPUT,
        metavar="FILE",
    ),
    as_json: bool = AS_JSON,
    out: Path | None = setting(None, "Also write JSON, HTML and an image", group=OUTPUT, metavar="DIR"),
) -> int:
    """Find out whether frames of another program are right: camera, positions, depth and motion vectors.

    Names what to set in the mapping.  The vectors of still surfaces, moving surfaces and the sky are each right,
    wrong or not judged; moving surfaces are judged with --scene-file or previous positions.  The exit code is 1 if
    something is wrong, else 3 if vectors are not judged; missing passes are no fault.  See docs/check-your-engine.md.

    Examples:
      taubench-gl check exr:renders --camera-file renders/camera.json
      taubench-gl check exr:engine --mapping unreal --scene-file scene.glb --out checked
      taubench-gl check exr:engine --camera-file camera.json --write-mapping engine.toml
      taubench-gl check exr:frames --mapping godot --pairs 8 --json
    """
    from taubench_gl.pathtraced.check_report import check_summary, check_tables, save_check
    from taubench_gl.pathtraced.check_vectors import exit_code
    from taubench_gl.pathtraced.sequence import PathTracedSequence
    from taubench_gl.pathtraced.write_mapping import write_found, write_guess

    if write_mapping is not None and files.mapping is None:
        write_guess(write_mapping, PathTracedSequence.open(spec).index.names)
        files = replace(files, mapping=write_mapping)
    images, result = _checked(spec, settings, files, pairs)
    if write_mapping is not None:
        write_found(write_mapping, images.sequence.index, result)
        images, result = _checked(spec, settings, replace(files, mapping=write_mapping), pairs)
    summary = check_summary(result, images.sequence)
    if as_json:
        show_json(summary)
    else:
        show_tables(check_tables(summary))
    if out is not None:
        save_check(result, images.sequence, out)
        click.echo(f"written to {out}{os.sep}", err=as_json)
    if write_mapping is not None:
        click.echo(f"written to {write_mapping}", err=as_json)
    return exit_code(result.answer, allow_unjudged)


def _checked(spec: str, settings: Settings, files: PathTracedOptions, pairs: int) -> tuple[PathTracedPlan, Check]:
    """The opened files and their check, with the truth of a scene file.  Raises TaubenchError."""
    from taubench_gl.pathtraced.cameras import SceneCamera
    from taubench_gl.pathtraced.check import check_sequence
    from taubench_gl.pathtraced.evaluation import plan_sequence
    from taubench_gl.pathtraced.scene_truth import render_truth

    images = plan_sequence(spec, settings, files)
    scene = isinstance(images.camera, SceneCamera)
    truth = partial(render_truth, images.camera, images.settings) if scene else None
    return images, check_sequence(images.sequence, images.camera, images.frames, pairs, truth)
