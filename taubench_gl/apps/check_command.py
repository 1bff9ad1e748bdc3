"""``taubench-gl check``: which conventions of an EXR sequence are not those of its mapping."""

from __future__ import annotations

import os
from pathlib import Path

import click

from taubench_gl.apps.options import AS_JSON, command, option_group
from taubench_gl.apps.screen import show_json, show_tables
from taubench_gl.fields import at_least, setting
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.settings import OUTPUT, Settings

EXIT_WRONG = 1


@command(
    settings=option_group(only=("camera", "fps", "frames")),
    files=option_group(PathTracedOptions, without=("lobes", "second_seed")),
    epilog="""\b
Examples:
  taubench-gl check exr:renders --camera-file renders/camera.json
  taubench-gl check exr:engine --mapping unreal --scene-file scene.glb --out checked
  taubench-gl check exr:frames --mapping godot --pairs 8 --json""",
)
@click.argument("spec", metavar="exr:DIR")
def check(
    spec: str,
    settings: Settings,
    files: PathTracedOptions,
    *,
    pairs: int = setting(4, "Most pairs of consecutive frames to check", at_least(1)),
    as_json: bool = AS_JSON,
    out: Path | None = setting(None, "Also write JSON, HTML and an image", group=OUTPUT, metavar="DIR"),
) -> int:
    """Find out which conventions of frames made elsewhere are wrong: camera, positions, depth and motion vectors.

    Names what to set in the mapping, and the share of pixels that each convention explains.  The exit code is 1 if one
    is wrong; missing passes are no fault.  See docs/path-traced.md.
    """
    from taubench_gl.pathtraced.check import check_sequence
    from taubench_gl.pathtraced.check_report import check_summary, check_tables, save_check
    from taubench_gl.pathtraced.evaluation import plan_sequence

    images = plan_sequence(spec, settings, files)
    result = check_sequence(images.sequence, images.camera, images.frames, pairs)
    summary = check_summary(result, images.sequence)
    if as_json:
        show_json(summary)
    else:
        show_tables(check_tables(summary))
    if out is not None:
        save_check(result, images.sequence, out)
        click.echo(f"written to {out}{os.sep}", err=as_json)
    return EXIT_WRONG if result.wrong else 0
