"""``taubench-gl reference``: render path-traced reference images, compare a run with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from taubench_gl.apps.options import AS_JSON, FRAMES, Commands, command, option_group
from taubench_gl.apps.screen import TABLE_FORMATS, show_json, show_notes, show_tables
from taubench_gl.errors import SettingsError
from taubench_gl.fields import REQUIRED, one_of, setting
from taubench_gl.option_groups import RenderOptions
from taubench_gl.settings import FIXED_LIGHTING, OUTPUT, Settings

if TYPE_CHECKING:
    from taubench_gl.apps.progress import ProgressBar
    from taubench_gl.pathtraced.blender.render import RenderProgress


@click.group(cls=Commands)
def reference() -> None:
    """Path-traced reference images: render them, compare runs with them; 'taubench-gl check' checks their conventions.

    'reuse evaluate' and 'export' with --reference path-traced@M trace references themselves and store them in the
    cache folder (TAUBENCH_CACHE); 'list' and 'clear' are for those.
    """


@command(settings=option_group(only=(*FRAMES, "culling", *FIXED_LIGHTING)))
@click.argument("scene_path", metavar="SCENE")
def render(
    scene_path: str,
    settings: Settings,
    options: RenderOptions,
    *,
    out: Path = setting(REQUIRED, "Folder for the frames", group=OUTPUT, metavar="DIR"),
) -> None:
    """Render SCENE with Cycles: multilayer EXR files, a camera sidecar, provenance and a log.

    Examples:
      taubench-gl reference render scene.glb --out renders --size 480x270 --samples 256
      taubench-gl reference render scene.glb --out crisp --crisp --samples 1 --frames 0:10
      taubench-gl evaluate exr:renders --camera-file renders/camera.json

    Needs Blender as a Python module (bpy), best in an environment of its own; TAUBENCH_BLENDER_PYTHON names the
    interpreter that has it.  An interrupted render continues with the first missing frame.
    """
    from taubench_gl.apps.progress import ProgressBar
    from taubench_gl.effects.lighting import environment_of
    from taubench_gl.evaluation import environment_image, plan_scene
    from taubench_gl.pathtraced.blender.job import Quality
    from taubench_gl.pathtraced.blender.render import render_reference
    from taubench_gl.pathtraced.cameras import CAMERA_FILE

    opened = plan_scene(scene_path, settings)
    settings = opened.settings
    environment = environment_of(settings)
    image = environment_image(settings)
    quality = Quality(
        **asdict(options),
        cull_back_faces=settings.sequence.culling == "gltf",
        sky=environment.radiance,
        sun=environment.sun,
        image=None if image is None else str(image.path.resolve()),
        image_sha256=None if image is None else image.sha256,
        light_unit=settings.lighting.light_unit,
    )
    with ProgressBar(scene_path, "frames") as bar:
        notes = render_reference(
            opened.animated.scene,
            opened.animated.camera,
            opened.frames,
            out,
            fps=settings.sequence.fps,
            size=(settings.sequence.width, settings.sequence.height),
            quality=quality,
            lighting={name: settings.to_dict()[name] for name in FIXED_LIGHTING},
            progress=_shown_by(bar),
        )
    show_notes(notes)
    factor = settings.lighting.exposure_factor
    exposure = "" if factor == 1.0 else f" --exposure {factor:g}"
    command = f"taubench-gl evaluate exr:{out} --camera-file {out / CAMERA_FILE}{exposure}"
    click.echo(f"{len(opened.frames)} frames in {out}; next: {command}")


def _shown_by(bar: ProgressBar) -> Callable[[RenderProgress], None]:
    """Shows a render in ``bar``: finished frames, the share of the current one, and what the others will take."""
    seconds: list[float] = []

    def show(progress: RenderProgress) -> None:
        if progress.done > bar.done and progress.seconds is not None:
            seconds.append(progress.seconds)
        rest = (progress.total - progress.done) * sum(seconds) / max(len(seconds), 1)
        left = f"{seconds[-1]:.1f} s a frame, {rest:.0f} s left" if seconds else ""
        bar.step(progress.done, progress.total, f"{progress.share:.0%} of the next", left)

    return show


@command()
@click.argument("first", metavar="RUN")
@click.argument("second", metavar="REFERENCE")
def compare(
    first: str,
    second: str,
    *,
    as_json: bool = AS_JSON,
    form: str = setting("text", "Format of the tables", one_of(TABLE_FORMATS), flag="--format"),
) -> None:
    """Compare RUN with REFERENCE, two folders written by 'taubench-gl evaluate --out'.

    Shows differences of every column in percentage points, noise floors, and seconds per frame.  With saved masks: also
    their overlap and the worst pair.  With saved channels: also the error distribution of every feature.

    Examples:
      taubench-gl evaluate scene.glb --size 320x180 --out raster --save masks,channels
      taubench-gl evaluate exr:renders --out traced --save masks,channels
      taubench-gl reference compare raster traced
      taubench-gl reference compare raster traced --format html > comparison.html

    A page that shows both runs side by side: 'taubench-gl report RUN REFERENCE --out both.html'.
    """
    from taubench_gl.pathtraced.compare import compare_runs
    from taubench_gl.pathtraced.compare_report import comparison_tables

    if as_json and form != "text":
        raise SettingsError("--format has no effect with --json", hint="leave out one of them")
    result = compare_runs(first, second)
    if as_json:
        show_json(result)
    else:
        show_tables(comparison_tables(result), form)


@command("list")
def list_references(*, as_json: bool = AS_JSON) -> None:
    """List the stored path-traced references: scene, size, frames, fewest samples of a frame, bytes.

    Each is a folder of its own, which can be deleted.

    Examples:
      taubench-gl reference list
      taubench-gl reference list --json
    """
    from taubench_gl.pathtraced.references import listed, references_folder

    stored = listed()
    if as_json:
        rows = [{"key": entry.key, "frames": entry.frames, "samples": entry.samples, "bytes": entry.bytes,
                 "current": entry.current, "about": dict(entry.about)} for entry in stored]  # fmt: skip
        show_json(rows)
        return
    for entry in stored:
        size = f"{entry.about.get('width', '?')}x{entry.about.get('height', '?')}"
        frames = f"{entry.about.get('name', '?')}, {size}, {entry.frames} frames, {entry.samples} samples per pixel"
        other = "" if entry.current else ", of another version of the path tracer"
        click.echo(f"{entry.key}  {frames}, {entry.bytes / 2**20:.1f} MiB{other}")
    total = sum(entry.bytes for entry in stored)
    click.echo(f"{len(stored)} references, {total / 2**20:.1f} MiB in {references_folder()}")


for member in (render, compare, list_references):
    reference.add_command(member)
