"""``taubench-gl reuse evaluate`` and ``reuse fit``: compare methods, and search their settings."""

from __future__ import annotations

import dataclasses
import os
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.options import FRAMES, GPU, command, given_options, option_group
from taubench_gl.apps.screen import for_each_scene, interruptible, note, warn
from taubench_gl.errors import SettingsError
from taubench_gl.fields import REQUIRED, one_of, setting, some_of
from taubench_gl.option_groups import REUSE_SETTINGS, FitOptions, ReuseOptions
from taubench_gl.settings import OUTPUT, STEREO, Settings

if TYPE_CHECKING:
    from taubench_gl.reuse.evaluate_output import ReuseFolder

SETTINGS = option_group(only=(*FRAMES, *REUSE_SETTINGS, *STEREO, *GPU))


@command(settings=SETTINGS)
@click.argument("scenes", nargs=-1, required=True, metavar="SCENE...")
def evaluate(
    scenes: tuple[str, ...],
    settings: Settings,
    reuse: ReuseOptions,
    *,
    methods: tuple[str, ...] = setting(
        REQUIRED,
        "Comma-separated: a built-in name, a folder, file.py or module:Class; settings as NAME@alpha=0.1, several "
        "values as @alpha=0.1/0.2 or @alpha=lo:hi:n; 'A>B' filters the image of A by B.  exr:DIR: frames made "
        "elsewhere, with settings mapping, layer, view, offset, scale, label",
    ),
    out: Path | None = setting(None, "Also write the results to this folder", group=OUTPUT, metavar="DIR"),
    video: str = setting("mp4", "Video of the frames, with --out", one_of(("mp4", "webm", "none")), group=OUTPUT),
    save: tuple[str, ...] = setting(
        (),
        "With --out, also write results: linear EXR of input, methods and reference, a folder per method and seed",
        some_of(("results",)),
        group=OUTPUT,
        short=False,
    ),
    report: bool = setting(False, "With --out, also store the images that report.html compares", group=OUTPUT),
) -> int:
    """Run reuse methods over the same frames of SCENE and compare every image with a reference.

    A method that fails prints one line and does not affect the others; the exit code is then 2.

    Examples:
      taubench-gl reuse evaluate scene.glb --methods none,accumulate,svgf --frames 0:24 --out results --report
      taubench-gl reuse evaluate scene.glb --methods none,taa_clamp,ideal-masks --input full
      taubench-gl reuse evaluate scene.glb --methods accumulate,svgf --input noisy+jittered --out results
      taubench-gl reuse evaluate scene.glb --methods taa_clamp@alpha=0.05/0.2,svgf@alpha=0.05:0.5:4,./my_method
      taubench-gl reuse evaluate scene.glb --methods svgf --input path-traced@1 --reference path-traced@1024
      taubench-gl reuse evaluate scene.glb --methods svgf --input exr:one-sample --reference exr:many-samples
      taubench-gl reuse evaluate a.glb --methods svgf,exr:engine@mapping=unreal@label=TSR --out results --save results

    DIR receives reuse.json, frames.csv, report.html, tables, plots, side_by_side.png (the worst frame) and a video.
    docs/reuse-evaluation.md defines every number.
    """
    from taubench_gl.reuse.fit import expand_methods

    settings, request = _of_input(settings, reuse), dataclasses.asdict(reuse)
    specs = expand_methods(methods)
    if (save or report) and out is None:
        raise SettingsError("there is no folder to write to", hint="give --out DIR")
    failures: list[str] = []

    def run(scene: str, folder: Path | None) -> None:
        failures.extend(_evaluate_one(scene, specs, settings, folder, (video, save, report), request))

    failed = for_each_scene(scenes, out, run)
    return 2 if failed or failures else 0


def _evaluate_one(
    scene: str,
    methods: Any,
    settings: Settings,
    folder: Path | None,
    files: tuple[str, tuple[str, ...], bool],
    request: dict[str, Any],
) -> list[str]:
    """Evaluate and show one scene; returns a line for each method that failed, which is printed too."""
    from taubench_gl.apps.progress import ProgressBar
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.report.page import REPORT_FILE
    from taubench_gl.report.reuse import reuse_tables, verdict
    from taubench_gl.reuse.evaluate import evaluate_methods
    from taubench_gl.reuse.evaluate_output import ReuseFolder

    results = None if folder is None else ReuseFolder(folder, settings.sequence.fps, *files)
    on_frame = None if results is None else results.on_frame
    with interruptible(lambda: _kept(results)), results or nullcontext():
        with ProgressBar(scene) as progress:
            done = evaluate_methods(
                scene, methods, settings, progress=progress, on_frame=on_frame, announce=note, **request
            )
        if results is not None:
            results.finish(done)
    if len(done.failed) < len(done.summary["methods"]):
        if text := verdict(done.summary):
            click.echo(f"{text}\n")
        show_tables(reuse_tables(done.summary))
    if folder is not None:
        click.echo(f"written to {folder}{os.sep}")
        size = (folder / REPORT_FILE).stat().st_size / 1e6
        click.echo(f"report: {folder / REPORT_FILE} ({size:.1f} MB)")
    for line in done.failed.values():
        warn(f"error: {line}")
    return list(done.failed.values())


@command(
    search=option_group(FitOptions),
    settings=SETTINGS,
    reuse=option_group(ReuseOptions, without=("metrics",)),
)
@click.argument("path", metavar="SCENE")
def fit(
    path: str,
    settings: Settings,
    reuse: ReuseOptions,
    search: FitOptions,
    *,
    method: str = setting(REQUIRED, "One method, as in 'reuse evaluate'; settings given with @ stay fixed"),
    ranges: tuple[str, ...] = setting(
        REQUIRED,
        "A setting to search and its range; may be repeated for a grid",
        flag="--setting",
        metavar="NAME[=lo:hi[:n]]",
        shown="the range of the setting, 9 values",
        repeats=True,
    ),
    out: Path | None = setting(None, "Write fit.json, curve.csv, tables, a plot", group=OUTPUT, metavar="DIR"),
) -> None:
    """Find the settings of a method, such as rejection thresholds, with the smallest error on SCENE.

    PSNR, SSIM and tPSNR are maximized.  Reports a best value at the edge of its range.

    Examples:
      taubench-gl reuse fit scene.glb --method taa_variance --setting gamma=0.5:4:8 --input noisy
      taubench-gl reuse fit scene.glb --method svgf --setting alpha=0.05:0.5:6 --metric flip --refine 2 --out fit
    """
    from taubench_gl.apps.progress import ProgressBar
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.folder_lock import FolderLock
    from taubench_gl.report.reuse import fit_table
    from taubench_gl.reuse.evaluate_output import write_fit
    from taubench_gl.reuse.fit import fit_setting

    settings = _of_input(settings, reuse)
    request = dataclasses.asdict(reuse) | dataclasses.asdict(search) | {"announce": note}
    with nullcontext() if out is None else FolderLock(out):
        with ProgressBar(path) as progress:
            fitted = fit_setting(path, method, ranges, settings, progress=progress, **request)
        if out is not None:
            write_fit(out, fitted.summary)
    show_tables([fit_table(fitted.summary)])
    click.echo("best: " + ", ".join(f"{name}={value:g}" for name, value in fitted.best.items()))
    if out is not None:
        click.echo(f"written to {out}{os.sep}")


def _of_input(settings: Settings, reuse: ReuseOptions) -> Settings:
    """``settings`` with motion reprojection.  Raises SettingsError for given options of light that path-traced input
    ignores.
    """
    from taubench_gl.reuse.input_kind import parse_input

    kind = parse_input(reuse.input)
    for name in sorted(given_options(("light", "indirect", "spp"))) if kind.path_samples else ():
        value = settings.get(name)
        if value not in ("auto", "path-traced", None):
            hint = f"leave --{name} out, or give another --input, such as full or path-traced@4"
            raise SettingsError(f"input is {kind.text} and {name} is {value}", hint=hint, setting=name)
    return settings.replace(reprojection="motion")


def _kept(results: ReuseFolder | None) -> str:
    """Which results are kept after an interrupt, in words."""
    if results is None:
        return "nothing was written (--out DIR keeps the evaluated frames)"
    count = results.written_frames
    return f"the rows of {count} frames are in {results.out / 'frames.csv'}" if count else "no frame was evaluated"
