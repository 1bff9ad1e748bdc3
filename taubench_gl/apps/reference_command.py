"""``taubench-gl reference``: render path-traced reference images, check their conventions, compare a run with them."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import OutPath, culling_option, environment_options, frame_options, settings_from
from taubench_gl.settings import FIXED_LIGHTING, Settings


@click.group()
def reference() -> None:
    """Path-traced reference images: render them, check their conventions, compare runs with them.

    'reuse evaluate --reference path-traced@M' and 'export --reference-spp M' trace references themselves and store them
    in the cache folder (TAUBENCH_CACHE); 'list' and 'clear' are for those.
    """


@reference.command(
    epilog="""\b
Examples:
  taubench-gl reference render scene.glb --out renders --size 480x270 --samples 256
  taubench-gl reference render scene.glb --out crisp --crisp --samples 1 --frames 0:10
  taubench-gl evaluate exr:renders --camera-file renders/camera.json
\b
Needs Blender as a Python module (bpy), best in an environment of its own; TAUBENCH_BLENDER_PYTHON names the
interpreter that has it.  An interrupted render continues with the first missing frame."""
)
@click.argument("scene_path", metavar="SCENE")
@click.option("--out", type=OutPath(), required=True, metavar="DIR", help="Folder for the frames.")
@frame_options()
@click.option("--samples", type=click.IntRange(1), default=64, show_default=True, help="Samples per pixel.")
@click.option("--bounces", type=click.IntRange(0), default=12, show_default=True, help="Longest path.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the noise.")
@click.option(
    "--seed-per-frame/--one-seed",
    default=True,
    show_default=True,
    help="Independent noise in every frame, or the same pattern in all frames.",
)
@click.option("--crisp", is_flag=True, help="Sample pixel centers only, as a rasterizer does.")
@culling_option
@environment_options
@click.option("--threads", type=click.IntRange(0), default=0, help="CPU threads of Blender.  [default: all cores]")
def render(scene_path: str, out: Path, **options: Any) -> None:
    """Render SCENE with Cycles: multilayer EXR files, a camera sidecar, provenance and a log."""
    from taubench_gl.animation import camera_of_run
    from taubench_gl.effects.lighting import environment_of
    from taubench_gl.evaluation import environment_image, frame_range, resolve_lighting
    from taubench_gl.pathtraced.blender.job import Quality
    from taubench_gl.pathtraced.blender.render import render_reference
    from taubench_gl.pathtraced.cameras import CAMERA_FILE
    from taubench_gl.scene import load_scene

    names = (
        "camera",
        "scene",
        "animations",
        "strict",
        "fps",
        "frames",
        "size",
        "culling",
        "light_unit",
        "exposure",
        "environment",
    )
    settings = settings_from({name: options[name] for name in names})
    scene = load_scene(scene_path, **settings.sequence.reading)
    camera = camera_of_run(scene, settings.sequence)
    frames = frame_range(scene, camera, settings)
    resolved = resolve_lighting(scene, settings, camera, frames=frames)
    settings = resolved.settings
    environment = environment_of(settings)
    image = environment_image(settings)
    quality = Quality(
        **{name: options[name] for name in ("samples", "bounces", "seed", "seed_per_frame", "crisp", "threads")},
        cull_back_faces=settings.sequence.culling == "gltf",
        sky=environment.radiance,
        sun=environment.sun,
        image=None if image is None else str(image.path.resolve()),
        image_sha256=None if image is None else image.sha256,
        light_unit=settings.lighting.light_unit,
    )
    notes = render_reference(
        scene,
        camera,
        frames,
        out,
        fps=settings.sequence.fps,
        size=options["size"],
        quality=quality,
        lighting={name: settings.to_dict()[name] for name in FIXED_LIGHTING},
        progress=_ProgressLines(),
    )
    for note in notes[:10]:
        click.echo(f"note: {note}")
    factor = settings.lighting.exposure_factor
    exposure = "" if factor == 1.0 else f" --exposure {factor:g}"
    command = f"taubench-gl evaluate exr:{out} --camera-file {out / CAMERA_FILE}{exposure}"
    click.echo(f"{len(frames)} frames in {out}; next: {command}")


class _ProgressLines:
    """One line per frame with the remaining time; on a terminal also the finished share of the current frame."""

    def __init__(self) -> None:
        self._seconds: list[float] = []
        self._done = -1

    def __call__(self, progress: Any) -> None:
        if progress.done == self._done:
            if sys.stderr.isatty() and progress.share > 0:
                click.echo(f"\rframe {progress.done + 1}/{progress.total}: {progress.share:4.0%}", nl=False, err=True)
            return
        first, self._done = self._done < 0, progress.done
        if progress.seconds is not None:
            self._seconds.append(progress.seconds)
        if first:
            kept = f", {progress.done} are complete" if progress.done else ""
            click.echo(f"rendering {progress.total} frames{kept}", err=True)
            return
        left = sum(self._seconds) / len(self._seconds) * (progress.total - progress.done)
        line = f"frame {progress.done}/{progress.total}: {progress.seconds:.1f} s, {left:.0f} s left"
        click.echo(("\r" if sys.stderr.isatty() else "") + line, err=True)


@reference.command(
    epilog="""\b
Examples:
  taubench-gl reference check exr:renders --camera-file renders/camera.json
  taubench-gl reference check exr:renders --scene-file scene.glb --mapping falcor"""
)
@click.argument("spec", metavar="exr:DIR")
@click.option("--camera-file", metavar="JSON", help="Camera sidecar.  [default: that of an export, else estimated]")
@click.option("--scene-file", metavar="SCENE", help="glTF file with the camera of the frames.")
@click.option("--camera", metavar="NAME|INDEX", help="Camera of the scene file.  [default: the first]")
@click.option(
    "--mapping",
    metavar="NAME|FILE",
    help="Pass names: a preset (blender, falcor, mitsuba, taubench, unity, unreal) or a TOML file.  "
    "[default: taubench for an export, else blender]",
)
@click.option("--layer", metavar="NAME", help="View layer.  [default: the one with most passes]")
@click.option("--fps", type=float, default=Settings().sequence.fps, show_default=True, help="Frames per second.")
def check(spec: str, **options: Any) -> int:
    """Find wrong axes, units, row order, motion direction, and a camera that did not render these images.

    Checks the first two frames.  The exit code is 2 if a fault is found; missing passes are listed and are no fault.
    """
    from taubench_gl.pathtraced.cameras import FittedCamera
    from taubench_gl.pathtraced.check import check_sequence
    from taubench_gl.pathtraced.evaluation import PathTracedOptions, open_input

    names = ("camera_file", "scene_file", "mapping", "layer")
    settings = Settings(fps=options["fps"], camera=options["camera"])
    given = open_input(spec, settings, PathTracedOptions(**{name: options[name] for name in names}))
    camera = None if isinstance(given.camera, FittedCamera) else given.camera
    first = given.sequence.frames[0]
    frames = range(first, first + (2 if first + 1 in given.sequence.files else 1))
    faults = 0
    for finding in check_sequence(given.sequence, camera, frames):
        faults += bool(finding.fault)
        verdict = f"WRONG: {finding.fault}" if finding.fault else "ok"
        if finding.absent:
            verdict = f"missing: {finding.absent}"
        click.echo(f"{finding.subject}: {verdict} ({finding.detail})")
    return 2 if faults else 0


@reference.command(
    epilog="""\b
Examples:
  taubench-gl evaluate scene.glb --size 320x180 --out raster --save masks,channels
  taubench-gl evaluate exr:renders --out traced --save masks,channels
  taubench-gl reference compare raster traced
  taubench-gl reference compare raster traced --out comparison"""
)
@click.argument("first", metavar="RUN")
@click.argument("second", metavar="REFERENCE")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--out", type=OutPath(), metavar="DIR", help="Also write text, JSON, HTML and an image.")
def compare(first: str, second: str, as_json: bool, out: Path | None) -> None:
    """Compare RUN with REFERENCE, two folders written by 'taubench-gl evaluate --out'.

    Shows differences of every column in percentage points, noise floors, and seconds per frame.  With saved masks: also
    their overlap and the worst pair.  With saved channels: also the error distribution of every feature.
    """
    from taubench_gl.pathtraced.compare import compare_runs, save_comparison
    from taubench_gl.pathtraced.compare_report import comparison_text

    result = compare_runs(first, second)
    if as_json:
        click.echo(json.dumps(result, indent=2, allow_nan=False))
    else:
        click.echo("\n".join(comparison_text(result)))
    if out is not None:
        save_comparison(result, out)
        click.echo(f"written to {out}{os.sep}", err=as_json)


@reference.command(
    "list",
    epilog="""\b
Examples:
  taubench-gl reference list
  taubench-gl reference list --json""",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def list_references(as_json: bool) -> None:
    """List the stored path-traced references: scene, size, frames, fewest samples of a frame, bytes."""
    from taubench_gl.pathtraced.references import listed, references_folder

    found = listed()
    if as_json:
        rows = [{"key": one.key, "frames": one.frames, "samples": one.samples, "bytes": one.bytes,
                 "current": one.current, "about": dict(one.about)} for one in found]  # fmt: skip
        click.echo(json.dumps(rows, indent=2))
        return
    for one in found:
        size = f"{one.about.get('width', '?')}x{one.about.get('height', '?')}"
        what = f"{one.about.get('name', '?')}, {size}, {one.frames} frames, {one.samples} samples per pixel"
        other = "" if one.current else ", of another version of the path tracer"
        click.echo(f"{one.key}  {what}, {one.bytes / 2**20:.1f} MiB{other}")
    total = sum(one.bytes for one in found)
    click.echo(f"{len(found)} references, {total / 2**20:.1f} MiB in {references_folder()}")


@reference.command(
    epilog="""\b
Examples:
  taubench-gl reference clear --old
  taubench-gl reference clear 3fa2b40c1de85f77
  taubench-gl reference clear --all"""
)
@click.argument("keys", nargs=-1, metavar="[KEY...]")
@click.option("--old", is_flag=True, help="Those that another version of the path tracer made.")
@click.option("--all", "everything", is_flag=True, help="All.")
def clear(keys: tuple[str, ...], old: bool, everything: bool) -> None:
    """Delete stored path-traced references by their KEY in 'reference list'."""
    from taubench_gl.errors import SettingsError
    from taubench_gl.pathtraced.references import clear as delete
    from taubench_gl.pathtraced.references import listed

    found = {one.key: one for one in listed()}
    if unknown := [key for key in keys if key not in found]:
        raise SettingsError(f"no reference has the key {unknown[0]}", hint="see 'taubench-gl reference list'")
    if not (keys or old or everything):
        raise click.UsageError("give keys, --old or --all")
    chosen = [key for key, one in found.items() if everything or key in keys or (old and not one.current)]
    delete(chosen)
    click.echo(f"{len(chosen)} references deleted")
