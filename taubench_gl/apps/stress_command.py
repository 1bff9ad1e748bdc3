"""``taubench-gl stress``: writes a scene with a camera of given statistics, or sweeps the camera's speed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.options import List, OutPath, Size, given_options, gpu_options, strict_option
from taubench_gl.errors import SettingsError

if TYPE_CHECKING:
    from taubench_gl.datasets.camera_path import CameraSpec

CAMERAS = ("fps", "vr", "still")
AXES = ("translation", "yaw", "pitch", "roll")


class Stats(click.ParamType):
    """``M,V`` or ``M,V,MAX`` -> numbers, which MotionStats checks."""

    name = "M,V[,MAX]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(","))
            if not 1 <= len(numbers) <= 3:
                raise ValueError
            return numbers
        except ValueError:
            self.fail(f"{value!r} is not a mean and variance such as 3.4,8.9", param, ctx)


class Count(click.ParamType):
    """A number of things, or ``all`` -> -1."""

    name = "N|all"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, int):
            return value
        if value == "all":
            return -1
        if not value.isdecimal():
            self.fail(f"{value!r} is neither a number nor all", param, ctx)
        return int(value)


class SweepRange(click.ParamType):
    """``yaw=0:12:7`` -> (axis, low, high, count)."""

    name = "AXIS=LO:HI:N"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        axis, equals, numbers = value.partition("=")
        try:
            low, high, count = numbers.split(":")
            if not equals:
                raise ValueError
            return axis.strip(), float(low), float(high), int(count)
        except ValueError:
            self.fail(f"{value!r} is not a sweep such as yaw=0:12:7", param, ctx)


@click.command(
    epilog="""\b
Examples:
  taubench-gl stress scene.glb --camera vr --out hard.glb
  taubench-gl stress scene.glb --camera fps --translation 0.1,0.003 --seed 4 --out fast.glb
  taubench-gl stress scene.glb --camera headset.csv --move-lights all --out recorded.glb
  taubench-gl stress scene.glb --sweep yaw=0:12:7 --out results

\b
A recorded camera is CSV with the header time,x,y,z,qx,qy,qz,qw (seconds, meters, +Y up, quaternion
world_from_view of a camera that looks along -Z), or JSON: a list of objects with those keys, or an object
of lists time, position, rotation.  The presets have the paper's rows of Tables 2 and 3 at 60 fps."""
)
@click.argument("scene", metavar="SCENE")
@click.option("--camera", default=None, metavar="fps|vr|still|FILE",
              help="Camera statistics of the paper's EternalValley rows, a still camera, or a recorded path (.csv, "
                   ".json).  [default: fps; with --sweep still]")  # fmt: skip
@click.option("--translation", type=Stats(), help="Meters per frame: mean, variance and maximum.")
@click.option("--yaw", type=Stats(), help="Degrees per frame, likewise.")
@click.option("--pitch", type=Stats(), help="Degrees per frame, likewise.")
@click.option("--roll", type=Stats(), help="Degrees per frame, likewise.")
@click.option("--seconds", type=float, help="Length.  [default: 6; with --sweep 0.5]")
@click.option("--fps", type=float, help="Frames per second of the statistics.  [default: 60]")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--move-lights", type=Count(), default="0", help="Also move this many lights.")
@click.option("--move-objects", type=Count(), default="0", help="Also move this many small rigid objects.")
@click.option("--motion", type=Stats(), default="0.05,0.001", show_default=True, help="Their motion, meters per frame.")
@click.option("--sweep", type=SweepRange(), help="Evaluate N constant speeds; write a table and a plot to --out.")
@click.option("--size", type=Size(), default="480x270", show_default=True, help="--sweep: pixels.")
@click.option(
    "--columns", type=List(), default="frustum,position,normal,direct", show_default=True, help="--sweep: columns."
)
@click.option("--out", type=OutPath(), required=True, metavar="OUT.glb|DIR")
@strict_option
@gpu_options
def stress(scene: str, out: Path, sweep: tuple[str, float, float, int] | None, **options: Any) -> None:
    """Write a scene as glTF with a camera of given motion statistics, or with a recorded camera.

    SCENE is any scene that 'evaluate' accepts, except path-traced files.  The camera's change per frame has exactly the
    given mean, variance and maximum; the seed chooses its path through free space.  Everything else in a glTF file is
    kept; other formats are converted to glTF.  The output selects the new camera by default.
    """
    from taubench_gl.apps.named_scenes import resolve

    _require_effect(sweep is not None, moving=bool(options["move_lights"] or options["move_objects"]))
    scene = resolve(scene)[0]
    if sweep is not None:
        _sweep(scene, out, sweep, options)
        return
    from taubench_gl.datasets.motion_stats import MotionStats
    from taubench_gl.datasets.recorded import SUFFIXES, read_recorded
    from taubench_gl.datasets.stress import Moves
    from taubench_gl.datasets.stress import stress as write

    choice = options["camera"] or "fps"
    if Path(choice).suffix.lower() in SUFFIXES:
        given = [name for name in (*AXES, "seconds", "fps") if options[name] is not None]
        if given:
            raise click.UsageError(f"--{given[0]} is for generated cameras, {choice} is a recorded one")
        camera = read_recorded(choice)
    else:
        camera = _spec(choice, options, 6.0)
    moves = Moves(options["move_lights"], options["move_objects"], MotionStats(*options["motion"]))
    done = write(scene, out, camera, moves, options["seed"], strict=options["strict"])
    moved = f", {done.lights} lights and {done.objects} objects moving" if done.lights or done.objects else ""
    click.echo(f"written to {done.file}: {done.seconds:.6g} s at {done.fps:.6g} fps{moved}")
    click.echo(f"Tables 1 to 4: taubench-gl evaluate {done.file} --fps {done.fps:.6g}")


def _require_effect(sweep: bool, *, moving: bool) -> None:
    """Refuse options without effect.  Raises SettingsError."""
    given = given_options(("size", "columns", "motion"))
    for name in ("size", "columns"):
        if name in given and not sweep:
            raise SettingsError(f"--{name} has no effect here", hint="it is for --sweep; leave it out")
    if "motion" in given and not moving:
        hint = "a sweep moves only the camera; leave it out" if sweep else "it is for --move-lights and --move-objects"
        raise SettingsError("--motion has no effect here", hint=hint)


def _spec(choice: str, options: dict[str, Any], seconds: float) -> CameraSpec:
    import dataclasses

    from taubench_gl.datasets.camera_path import CAPTURE_FPS, PRESETS
    from taubench_gl.datasets.motion_stats import MotionStats
    from taubench_gl.datasets.stress import with_stats

    if choice not in PRESETS:
        raise SettingsError(f"no camera is named {choice!r}", hint=f"choose from {', '.join(CAMERAS)}, .csv or .json")
    fps = CAPTURE_FPS if options["fps"] is None else options["fps"]
    seconds = seconds if options["seconds"] is None else options["seconds"]
    if not 0 < seconds * fps < 1e6:
        hint = "give a length and a rate above 0, and less than 1,000,000 frames"
        raise SettingsError(f"{seconds:g} s at {fps:g} fps", hint=hint)
    given = {name: MotionStats(*options[name]) for name in AXES if options[name] is not None}
    spec = dataclasses.replace(PRESETS[choice], frames=round(seconds * fps) + 1, fps=fps, seed=options["seed"])
    return with_stats(spec, **given)


def _sweep(scene: str, out: Path, sweep: tuple[str, float, float, int], options: dict[str, Any]) -> None:
    from taubench_gl.apps.study_screen import StudyScreen
    from taubench_gl.datasets.sweep import Sweep, run_sweep
    from taubench_gl.settings import Settings

    if options[sweep[0]] is not None if sweep[0] in AXES else False:
        raise click.UsageError(f"--{sweep[0]} conflicts with --sweep {sweep[0]}")
    if options["move_lights"] or options["move_objects"]:
        raise click.UsageError("--sweep moves only the camera: write the moving scene first, then sweep it")
    base = _spec(options["camera"] or "still", options, 0.5)
    width, height = options["size"]
    settings = Settings(
        width=width,
        height=height,
        columns=options["columns"],
        strict=options["strict"],
        backend=options["backend"],
        device=options["device"],
    )
    plan = Sweep(*sweep)
    with StudyScreen("speeds") as screen:
        rows = run_sweep(scene, plan, base, settings, out, screen)
    measured = [name for name in options["columns"] if any(row[f"{name}_percent"] is not None for row in rows)]
    click.echo("  ".join([f"{plan.axis:>12}", *(f"{name:>9}" for name in measured)]))
    for row in rows:
        speed = f"{row[f'mean_{plan.axis}_{plan.unit}']:>10.3f} {'m' if plan.unit == 'm' else '°'}"
        cells = ("–" if row[f"{n}_percent"] is None else f"{row[f'{n}_percent']:.2f} %" for n in measured)
        click.echo("  ".join([speed, *(f"{cell:>9}" for cell in cells)]))
    click.echo(f"written to {out}: sweep.csv, sweep.png, sweep.svg")
