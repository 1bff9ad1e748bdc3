"""``taubench-gl reuse evaluate`` and ``reuse fit``: compare methods, and search their settings."""

from __future__ import annotations

import os
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.evaluate_command import out_folders
from taubench_gl.apps.options import (
    List,
    OutPath,
    Words,
    frame_options,
    given_options,
    gpu_options,
    lighting_options,
    of_settings,
    settings_from,
    threshold_option,
    unit_scale_option,
    with_options,
)
from taubench_gl.errors import SettingsError, TaubenchError
from taubench_gl.settings import Settings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taubench_gl.reuse.evaluate import Evaluation, MethodSpec
    from taubench_gl.reuse.evaluate_output import ReuseFolder
    from taubench_gl.reuse.input_kind import InputKind

EXIT_FAILED, EXIT_INTERRUPTED = 2, 130
DEFAULT_METRICS = ("psnr", "ssim", "flip", "relmse", "tpsnr", "flicker", "warp_error")
METRICS_HELP = "Metrics to compute; also hdr_flip, lpips and cvvdp, which need more time or packages."
FIT_METRICS = ("psnr", "ssim", "flip", "relmse", "tpsnr", "flicker")
METHODS_HELP = (
    "Comma-separated: a built-in name, a folder, file.py or module:Class; settings as NAME@alpha=0.1, several values "
    "as @alpha=0.1/0.2 or @alpha=lo:hi:n.  exr:DIR: frames made elsewhere, with settings mapping, layer, offset, "
    "scale, label."
)


def shared_options(command: Any) -> Any:
    """Options of both ``evaluate`` and ``fit``: frames, inputs, reference, light."""
    return with_options(
        command,
        frame_options(size="640x360"),
        click.option(
            "--input",
            "kind",
            default="path-traced@1",
            show_default=True,
            metavar="KIND",
            help="Frames to reuse: path-traced@N: light of N samples per pixel, others in every pixel and frame, each "
            "of one punctual light, with +all-lights of every one; full, or some of jittered, noisy, half, "
            "checkerboard, quarter, and upscale@S (frames S times smaller than the result), joined by +; or exr:DIR, "
            "path-traced frames with the camera of SCENE.",
        ),
        click.option("--light-samples", type=int, default=1, show_default=True, help="noisy: light samples per pixel."),
        click.option("--vpl-samples", type=int, default=4, show_default=True, help="noisy: VPL samples per pixel."),
        click.option(
            "--reference",
            metavar="max|path-traced[@M]|exr:DIR",
            help="path-traced: path-traced light with the samples that fit --reference-time; path-traced@M: of M "
            "samples per pixel; both stored and extended.  max: exact light of the raster method, supersampled.  "
            "exr:DIR: path-traced frames with the same numbers.  [default: path-traced for path-traced input, else "
            "max]",
        ),
        click.option(
            "--reference-time",
            type=float,
            default=120.0,
            show_default=True,
            metavar="SECONDS",
            help="path-traced: time for references that are not stored.",
        ),
        click.option("--reference-samples", type=int, default=16, show_default=True, help="max: samples per pixel."),
        click.option(
            "--mapping",
            metavar="NAME|FILE",
            help="exr: pass names: blender, falcor, mitsuba, taubench, unity, unreal or TOML.  "
            "[default: taubench for an export, else blender]",
        ),
        click.option(
            "--seeds",
            type=int,
            default=1,
            show_default=True,
            help="Repeat the frames with this many seeds, from --seed on; five or more give intervals over seeds.",
        ),
        click.option(
            "--warmup", type=int, default=1, show_default=True, help="First frames that means and intervals leave out."
        ),
        click.option("--cut", "cuts", type=int, multiple=True, help="Frame declared to have no history; repeatable."),
        threshold_option,
        unit_scale_option,
        lighting_options,
        of_settings(
            "--vpls",
            "Virtual point lights (VPLs) of indirect light; noisy light samples them, its reference sums all.",
            field="indirect_samples",
        ),
        gpu_options,
    )


@click.command(
    epilog="""\b
Examples:
  taubench-gl reuse evaluate scene.glb --methods none,accumulate,svgf --frames 0:24 --out results --report
  taubench-gl reuse evaluate scene.glb --methods none,taa_clamp,ideal-masks --input full
  taubench-gl reuse evaluate scene.glb --methods accumulate,svgf --input noisy+jittered --out results
  taubench-gl reuse evaluate scene.glb --methods taa_clamp@alpha=0.05/0.2,svgf@alpha=0.05:0.5:4,./my_method
  taubench-gl reuse evaluate scene.glb --methods svgf --input path-traced@1 --reference path-traced@1024
  taubench-gl reuse evaluate scene.glb --methods svgf --input exr:one-sample --reference exr:many-samples
  taubench-gl reuse evaluate scene.glb --methods svgf,exr:engine@mapping=unreal@label=TSR --out results --save results

\b
DIR receives reuse.json, frames.csv, report.html, tables, plots, side_by_side.png (the worst frame) and a video.
docs/reuse-evaluation.md defines every number."""
)
@click.argument("scenes", nargs=-1, required=True, metavar="SCENE...")
@click.option("--methods", type=List(), required=True, help=METHODS_HELP)
@click.option("--metrics", type=List(), default=",".join(DEFAULT_METRICS), show_default=True, help=METRICS_HELP)
@click.option("--out", type=OutPath(), metavar="DIR", help="Also write the results to this folder.")
@click.option(
    "--video", type=click.Choice(["mp4", "webm", "none"]), default="mp4", show_default=True, help="With --out."
)
@click.option(
    "--save",
    type=Words("results"),
    default="",
    help="With --out, also write results: linear EXR of input, methods and reference, a folder per method and seed.",
)
@click.option("--report", is_flag=True, help="With --out, also store the images that report.html compares.")
@shared_options
def evaluate(
    scenes: tuple[str, ...],
    methods: tuple[str, ...],
    metrics: tuple[str, ...],
    out: Path | None,
    video: str,
    save: tuple[str, ...],
    report: bool,
    **options: Any,
) -> int:
    """Run reuse methods over the same frames of SCENE and compare every image with a reference.

    A method that fails prints one line and does not affect the others; the exit code is then 2.
    """
    from taubench_gl.reuse.fit import expand_methods

    settings, request = split_options(options)
    specs = expand_methods(methods)
    if (save or report) and out is None:
        raise SettingsError("there is no folder to write to", hint="give --out DIR")
    failed = False
    for scene, folder in zip(scenes, out_folders(scenes, out), strict=True):
        try:
            done = _evaluate_one(scene, specs, settings, folder, (video, save, report), request | {"metrics": metrics})
        except TaubenchError as error:
            if len(scenes) == 1:
                raise
            _print_error(f"error: {scene}: {error}")
            failed = True
            continue
        for line in done.failed.values():
            _print_error(f"error: {line}")
        failed = failed or bool(done.failed)
    return EXIT_FAILED if failed else 0


def _evaluate_one(
    scene: str,
    methods: Sequence[MethodSpec],
    settings: Settings,
    folder: Path | None,
    files: tuple[str, tuple[str, ...], bool],
    request: dict[str, Any],
) -> Evaluation:
    from taubench_gl.apps.screen import ProgressBar, show_tables
    from taubench_gl.report.page import REPORT_FILE
    from taubench_gl.report.reuse import reuse_tables
    from taubench_gl.reuse.evaluate import evaluate_methods
    from taubench_gl.reuse.evaluate_output import ReuseFolder

    results = None if folder is None else ReuseFolder(folder, settings.sequence.fps, *files)
    on_frame = None if results is None else results.on_frame
    try:
        with results or nullcontext():
            with ProgressBar(Path(scene).name) as progress:
                done = evaluate_methods(
                    scene, methods, settings, progress=progress, on_frame=on_frame, announce=_announce, **request
                )
            if results is not None:
                results.finish(done)
    except KeyboardInterrupt:
        _print_error(_interrupted(results))
        raise click.exceptions.Exit(EXIT_INTERRUPTED) from None
    if len(done.failed) < len(done.summary["methods"]):
        show_tables(reuse_tables(done.summary))
    if folder is not None:
        click.echo(f"written to {folder}{os.sep}")
        size = (folder / REPORT_FILE).stat().st_size / 1e6
        click.echo(f"report: {folder / REPORT_FILE} ({size:.1f} MB)")
    return done


@click.command(
    epilog="""\b
Examples:
  taubench-gl reuse fit scene.glb --method taa_variance --setting gamma=0.5:4:8 --input noisy
  taubench-gl reuse fit scene.glb --method svgf --setting alpha=0.05:0.5:6 --metric flip --refine 2 --out fit"""
)
@click.argument("path", metavar="SCENE")
@click.option("--method", required=True, help="One method, as in 'reuse evaluate'; settings given with @ stay fixed.")
@click.option(
    "--setting",
    "ranges",
    multiple=True,
    required=True,
    metavar="NAME[=lo:hi[:n]]",
    help="A setting to search and its range; repeatable for a grid.  [default: the range of the setting, 9 values]",
)
@click.option(
    "--metric",
    type=click.Choice(FIT_METRICS),
    default="flip",
    show_default=True,
    help="Metric to optimize; a single bright pixel can dominate relmse.",
)
@click.option("--refine", type=int, default=1, show_default=True, help="Finer grids around the best point.")
@click.option("--out", type=OutPath(), metavar="DIR", help="Write fit.json, curve.csv, tables, a plot.")
@shared_options
def fit(
    path: str, method: str, ranges: tuple[str, ...], metric: str, refine: int, out: Path | None, **options: Any
) -> None:
    """Find the settings of a method, such as rejection thresholds, with the smallest error on SCENE.

    PSNR, SSIM and tPSNR are maximized.  Reports a best value at the edge of its range.
    """
    from taubench_gl.apps.screen import ProgressBar, show_tables
    from taubench_gl.folder_lock import FolderLock
    from taubench_gl.report.reuse import fit_table
    from taubench_gl.reuse.evaluate_output import write_fit
    from taubench_gl.reuse.fit import fit_setting

    settings, request = split_options(options)
    request["announce"] = _announce
    with nullcontext() if out is None else FolderLock(out):
        with ProgressBar(Path(path).name) as progress:
            found = fit_setting(
                path, method, ranges, settings, metric=metric, refine=refine, progress=progress, **request
            )
        if out is not None:
            write_fit(out, found.summary)
    show_tables([fit_table(found.summary)])
    click.echo("best: " + ", ".join(f"{name}={value:g}" for name, value in found.best.items()))
    if out is not None:
        click.echo(f"written to {out}{os.sep}")


def split_options(options: dict[str, Any]) -> tuple[Settings, dict[str, Any]]:
    """Options of ``shared_options`` as Settings and as an ``EvaluationRequest``'s fields."""
    request = {
        name: options.pop(name)
        for name in ("reference", "reference_samples", "cuts", "reference_time", "mapping", "seeds", "warmup")
    }
    request["input"] = kind = _input(options)
    if request["reference"] is None:
        request["reference"] = "path-traced" if kind.path_samples else "max"
    if kind.path_samples:
        _check_path_traced(kind, options)
    return settings_from(options, reprojection="motion"), request


def _check_path_traced(kind: InputKind, options: dict[str, Any]) -> None:
    """Raises SettingsError for given options of light that path-traced input would ignore."""
    ignored = {name: options[name] for name in ("light", "indirect", "spp")}
    ignored = {name: value for name, value in ignored.items() if value not in ("auto", "path-traced", None)}
    for name in sorted(given_options(ignored)):
        what = f"input is {kind.text} and {name} is {ignored[name]}"
        hint = f"leave --{name} out, or give another --input, such as full or path-traced@4"
        raise SettingsError(what, hint=hint, setting=name)


def _input(options: dict[str, Any]) -> InputKind:
    from taubench_gl.reuse.input_kind import parse_input

    lights, vpls = options.pop("light_samples"), options.pop("vpl_samples")
    return parse_input(options.pop("kind"), light_samples=lights, indirect_samples=vpls, seed=options["seed"])


def _interrupted(results: ReuseFolder | None) -> str:
    """One line that lists what was written before an interrupt."""
    if results is None:
        return "interrupted; nothing was written (--out DIR keeps the evaluated frames)"
    count = results.written_frames
    rows = f"the rows of {count} frames are in {results.out / 'frames.csv'}"
    return f"interrupted; {rows if count else 'no frame was evaluated'}"


def _announce(line: str) -> None:
    click.echo(line, err=True)


def _print_error(line: str) -> None:
    click.echo(f"taubench-gl: {line}", file=sys.stderr)
