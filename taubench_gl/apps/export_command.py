"""``taubench-gl export``: writes the frames of a scene to files for other programs."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click

from taubench_gl.apps.options import command, option_group
from taubench_gl.fields import REQUIRED, setting
from taubench_gl.option_groups import ExportOptions, TrainingOptions
from taubench_gl.settings import OUTPUT, Settings


@command(settings=option_group(without=("exact", "storage", "samples_per_pixel", "pairs")))
@click.argument("scene_path", metavar="SCENE")
def export(
    scene_path: str,
    settings: Settings,
    options: ExportOptions,
    training: TrainingOptions,
    *,
    out: Path = setting(REQUIRED, "Folder of the files", group=OUTPUT, metavar="DIR"),
    overwrite: bool = setting(False, "Replace an export in DIR that has other settings", group=OUTPUT),
) -> None:
    """Write G-buffers, radiance, motion, masks and cameras of SCENE, frame by frame.

    Row 0 is the top; motion is in pixels, +x right, +y down.  The same command continues an interrupted export.  A
    folder with another export is refused.  See docs/export.md.

    Examples:
      taubench-gl export scene.glb --out gbuffers
      taubench-gl export scene.glb --out frames --format exr --channels gbuffer,radiance,flow,masks
      taubench-gl export scene.glb --out training --format zarr --channels all --size 640x360 --jitter halton
      taubench-gl export a.glb --out pairs --input path-traced@1 --seeds 4 --reference path-traced@1024 --size 320x180
      taubench-gl export scene.glb --out sintel --format sintel --frames 0:50
      taubench-gl export scene.glb --out nss --format nss --input jittered+upscale@2 --reference max --size 1280x720
      taubench-gl evaluate exr:frames

    Channels: gbuffer (position, depth, normal, geometric_normal, base_color, material, emission, ids), radiance
    (direct, indirect, color), lobes (direct_LOBE and indirect_LOBE, for LOBE as in 'evaluate --lobe'), flow
    (motion, motion_forward), masks (mask, mask_forward), prev_position, prev_visibility, path_info, all; exact_reasons.
    """
    from taubench_gl.apps.named_scenes import resolve, row_settings
    from taubench_gl.apps.progress import ProgressBar
    from taubench_gl.apps.screen import note
    from taubench_gl.export.run import export_scene

    options = dataclasses.replace(options, training=training)
    source, row = resolve(scene_path, settings.sequence.animation)
    settings = settings.replace(**row_settings(row))
    with ProgressBar(source, "frames") as progress:
        result = export_scene(source, out, settings, options, overwrite=overwrite, announce=note, progress=progress)
    for name, reason in result.unmeasured.items():
        click.echo(f"note: no {name}: {reason}")
    kept = f", {result.kept} kept" if result.kept else ""
    click.echo(f"{result.written} frames written{kept}: {', '.join(result.names)}")
    click.echo(f"written to {result.out}/")
