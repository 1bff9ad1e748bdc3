"""``taubench-gl export``: writes the frames of a scene to files for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import (
    List,
    OutPath,
    frame_options,
    gpu_options,
    light_options,
    pair_options,
    settings_from,
)


@click.command(
    epilog="""\b
Examples:
  taubench-gl export scene.glb --out gbuffers
  taubench-gl export scene.glb --out frames --format exr --channels gbuffer,radiance,flow,masks
  taubench-gl export scene.glb --out training --format zarr --channels all --size 640x360 --jitter halton
  taubench-gl export scene.glb --out pairs --noisy-spp 1 --seeds 4 --reference-spp 1024 --size 320x180
  taubench-gl export scene.glb --out sintel --format sintel --frames 0:50
  taubench-gl evaluate exr:frames
\b
Channels: gbuffer (position, depth, normal, geometric_normal, base_color, material, emission, ids), radiance (direct,
indirect, color), lobes (direct_diffuse, direct_glossy, indirect_diffuse, indirect_glossy), flow (motion,
motion_forward), masks (mask, mask_forward), prev_position,
prev_visibility, path_info, all; exact_reasons."""
)
@click.argument("scene_path", metavar="SCENE")
@click.option("--out", type=OutPath(), required=True, metavar="DIR", help="Folder of the files.")
@click.option(
    "--format",
    type=click.Choice(["exr", "npz", "zarr", "sintel"]),
    default="exr",
    show_default=True,
    help="exr: multilayer OpenEXR.  npz: NumPy.  zarr: Zarr v3, one chunk per frame.  sintel: the MPI-Sintel layout.",
)
@click.option(
    "--channels",
    type=List("no channel is named; leave the option out for gbuffer,flow,masks"),
    default=(),
    help="Names and groups, see below.  [default: gbuffer,flow,masks]",
)
@click.option(
    "--precision",
    type=click.Choice(["native", "float", "half"]),
    default="native",
    show_default=True,
    help="native: as on the GPU.  float: 32 bits.  half: 16 bits except for positions, depth and motion.",
)
@click.option(
    "--jitter",
    type=click.Choice(["none", "halton"]),
    default="none",
    show_default=True,
    help="Sub-pixel offset of the samples of each frame; not part of motion.",
)
@click.option("--noisy-spp", type=click.IntRange(min=1), metavar="N", help="Also export path-traced light of N samples "
              "per pixel, per lobe: noisy0_direct_diffuse, ...")  # fmt: skip
@click.option("--seeds", type=int, default=1, show_default=True, metavar="S",
              help="Noisy images of each frame: noisy0_*, noisy1_*, ...")  # fmt: skip
@click.option("--reference-spp", type=click.IntRange(min=1), metavar="M", help="Also export path-traced light of M "
              "samples per pixel, per lobe: clean_direct_diffuse, ...; stored, see 'reference list'.")  # fmt: skip
@click.option("--overwrite", is_flag=True, help="Replace an export in DIR that has other settings.")
@frame_options()
@pair_options(
    reprojection="Of the mask, as in 'evaluate'; motion always includes object motion.", sampling="Of the mask."
)
@light_options
@gpu_options
def export(
    scene_path: str,
    out: Path,
    format: str,
    channels: tuple[str, ...],
    precision: str,
    jitter: str,
    noisy_spp: int | None,
    seeds: int,
    reference_spp: int | None,
    overwrite: bool,
    **options: Any,
) -> None:
    """Write G-buffers, radiance, motion, masks and cameras of SCENE, frame by frame.

    Row 0 is the top; motion is in pixels, +x right, +y down.  The same command continues an interrupted export.  A
    folder with another export is refused.  See docs/export.md.
    """
    from taubench_gl.apps.named_scenes import resolve, row_settings
    from taubench_gl.apps.screen import ProgressBar
    from taubench_gl.export.run import ExportOptions, export_scene
    from taubench_gl.export.training import TrainingOptions

    settings = settings_from(options)
    training = TrainingOptions(noisy_spp or 0, seeds, reference_spp or 0)
    source, row = resolve(scene_path)
    settings = settings.replace(**row_settings(row))
    with ProgressBar(Path(source).name, "frames") as progress:
        result = export_scene(
            source,
            out,
            settings,
            ExportOptions(format, channels, precision, jitter, training),
            overwrite=overwrite,
            announce=lambda line: click.echo(line, err=True),
            progress=progress,
        )
    for name, reason in result.unmeasured.items():
        click.echo(f"note: no {name}: {reason}")
    kept = f", {result.kept} kept" if result.kept else ""
    click.echo(f"{result.written} frames written{kept}: {', '.join(result.names)}")
    click.echo(f"written to {result.out}/")
