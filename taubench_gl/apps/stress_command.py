"""``taubench-gl stress``: writes a scene with a camera of given statistics, or sweeps the camera's speed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.options import CAMERA_PATH, GPU, command, given_options, option_group
from taubench_gl.errors import SettingsError
from taubench_gl.fields import REQUIRED, Check, at_least, setting, value_text
from taubench_gl.settings import OUTPUT, Settings

if TYPE_CHECKING:
    from taubench_gl.datasets.camera_path import CameraSpec

CAMERAS = ("fps", "vr", "still")
AXES = ("translation", "yaw", "pitch", "roll")
_STATISTICS = Check(
    "mean, variance and maximum such as 3.4,8.9,20; the mean is enough",
    lambda name, numbers: None if 1 <= len(numbers) <= 3 else value_text(name, numbers),
)


def _count(text: Any) -> Any:
    """The number that a text spells, -1 for ``all``.  Raises SettingsError."""
    if text == "all":
        return -1
    if not str(text).isdecimal():
        raise SettingsError(f"{text!r} is neither a number nor all", hint="give 2, or all")
    return int(text)


def _sweep_range(text: Any) -> Any:
    """(axis, low, high, count) of a text such as ``yaw=0:12:7``.  Raises SettingsError."""
    axis, _, numbers = text.partition("=")
    try:
        low, high, count = numbers.split(":")
        return axis.strip(), float(low), float(high), int(count)
    except ValueError:
        raise SettingsError(f"{text!r} is not a sweep", hint="give one such as yaw=0:12:7") from None


def _statistics(default: tuple[float, ...] | None, meaning: str) -> Any:
    """An option whose value is mean, variance and maximum of a motion per frame; ``meaning``: its help."""
    return setting(default, meaning, _STATISTICS, metavar="M,V[,MAX]", short=default is None)


def _moved(meaning: str) -> Any:
    """An option whose value is how many lights or objects move, or ``all``; ``meaning``: its help."""
    return setting(0, meaning, read=_count, metavar="N|all", shown="none")


@command(
    settings=option_group(
        only=("size", "columns", "strict", *CAMERA_PATH[1:], *GPU),
        size="480x270",
        columns="frustum,position,normal,direct",
        camera_path_place="world",
    ),
)
@click.argument("scene", metavar="SCENE")
def stress(
    scene: str,
    settings: Settings,
    *,
    camera: str | None = setting(
        None,
        "Camera statistics of the paper's EternalValley rows, a still camera, or a recorded camera",
        metavar="fps|vr|still|FILE",
        shown="fps; with --sweep still",
    ),
    translation: tuple[float, ...] | None = _statistics(None, "Meters per frame: mean, variance and maximum"),
    yaw: tuple[float, ...] | None = _statistics(None, "Degrees per frame, likewise"),
    pitch: tuple[float, ...] | None = _statistics(None, "Degrees per frame, likewise"),
    roll: tuple[float, ...] | None = _statistics(None, "Degrees per frame, likewise"),
    seconds: float | None = setting(None, "Length", shown="6; with --sweep 0.5"),
    fps: float | None = setting(None, "Frames per second of the statistics", shown="60"),
    seed: int = setting(0, "Seed of the camera's path", at_least(0)),
    move_lights: int = _moved("Also move this many lights"),
    move_objects: int = _moved("Also move this many small rigid objects"),
    motion: tuple[float, ...] = _statistics((0.05, 0.001), "Their motion, meters per frame"),
    sweep: tuple[str, float, float, int] | None = setting(
        None,
        "Evaluate N constant speeds; write a table and a plot to --out.  --size and --columns are for it",
        read=_sweep_range,
        metavar="AXIS=LO:HI:N",
    ),
    out: Path = setting(REQUIRED, "The scene, or the folder of a sweep", group=OUTPUT, metavar="OUT.glb|DIR"),
) -> None:
    """Write a scene as glTF with a camera of given motion statistics, or with a recorded camera.

    SCENE is any scene that 'evaluate' accepts, except path-traced files.  The camera's change per frame has exactly the
    given mean, variance and maximum; the seed chooses its path through free space.  Everything else in a glTF file is
    kept; other formats are converted to glTF.  The output selects the new camera by default.

    Examples:
      taubench-gl stress scene.glb --camera vr --out hard.glb
      taubench-gl stress scene.glb --camera fps --translation 0.1,0.003 --seed 4 --out fast.glb
      taubench-gl stress scene.glb --camera headset.csv --move-lights all --out recorded.glb
      taubench-gl stress scene.glb --sweep yaw=0:12:7 --out results

    A recorded camera is any file that --camera-path of the other commands reads (docs/camera-paths.md), such as CSV
    with the header time,x,y,z,qx,qy,qz,qw.  The presets have the paper's rows of Tables 2 and 3, taken as of
    60 fps: the paper does not state their rate.
    """
    from taubench_gl.apps.named_scenes import resolve

    options = {
        "camera": camera, "seconds": seconds, "fps": fps, "seed": seed,
        "translation": translation, "yaw": yaw, "pitch": pitch, "roll": roll,
    }  # fmt: skip
    moving = bool(move_lights or move_objects)
    _require_effect(sweep is not None, moving=moving)
    scene = resolve(scene, settings.sequence.animation)[0]
    if sweep is not None:
        if moving:
            raise click.UsageError("--sweep moves only the camera: write the moving scene first, then sweep it")
        _sweep(scene, out, sweep, settings, options)
        return
    _write(scene, out, camera or "fps", settings, options, (move_lights, move_objects, motion))


def _write(
    scene: str,
    out: Path,
    choice: str,
    settings: Settings,
    options: dict[str, Any],
    moving: tuple[int, int, tuple[float, ...]],
) -> None:
    """Write the scene with a camera; ``moving``: numbers of lights and of objects, and statistics of their motion."""
    from taubench_gl.datasets.camera_path import PRESETS
    from taubench_gl.datasets.motion_stats import MotionStats
    from taubench_gl.datasets.stress import Moves
    from taubench_gl.datasets.stress import stress as write

    if choice not in PRESETS and Path(choice).is_file():
        without_effect = [name for name in (*AXES, "seconds", "fps") if options[name] is not None]
        if without_effect:
            raise click.UsageError(f"--{without_effect[0]} is for generated cameras, {choice} is a recorded one")
        path = settings.replace(camera_path=choice).sequence
    else:
        path = _spec(choice, options, 6.0)
    moves = Moves(*moving[:2], MotionStats(*moving[2]))
    done = write(scene, out, path, moves, options["seed"], strict=settings.sequence.strict)
    moved = f", {done.lights} lights and {done.objects} objects moving" if done.lights or done.objects else ""
    click.echo(f"written to {done.file}: {done.seconds:.6g} s at {done.fps:.6g} fps{moved}")
    if done.taken:
        click.echo(done.taken)
    click.echo(f"Tables 1 to 4: taubench-gl evaluate {done.file} --fps {done.fps:.6g}")


def _require_effect(sweep: bool, *, moving: bool) -> None:
    """Refuse options without effect.  Raises SettingsError."""
    by_user = given_options(("size", "columns", "motion"))
    for name in ("size", "columns"):
        if name in by_user and not sweep:
            raise SettingsError(f"--{name} has no effect here", hint="it is for --sweep; leave it out")
    if "motion" in by_user and not moving:
        hint = "a sweep moves only the camera; leave it out" if sweep else "it is for --move-lights and --move-objects"
        raise SettingsError("--motion has no effect here", hint=hint)


def _spec(choice: str, options: dict[str, Any], seconds: float) -> CameraSpec:
    import dataclasses

    from taubench_gl.datasets.camera_path import CAPTURE_FPS, PRESETS
    from taubench_gl.datasets.motion_stats import MotionStats
    from taubench_gl.datasets.stress import with_stats

    if choice not in PRESETS:
        raise SettingsError(f"no camera is named {choice!r}", hint=f"choose from {', '.join(CAMERAS)}, or a file")
    fps = CAPTURE_FPS if options["fps"] is None else options["fps"]
    seconds = seconds if options["seconds"] is None else options["seconds"]
    if not 0 < seconds * fps < 1e6:
        hint = "give a length and a rate above 0, and less than 1,000,000 frames"
        raise SettingsError(f"{seconds:g} s at {fps:g} fps", hint=hint)
    changed = {name: MotionStats(*options[name]) for name in AXES if options[name] is not None}
    spec = dataclasses.replace(PRESETS[choice], frames=round(seconds * fps) + 1, fps=fps, seed=options["seed"])
    return with_stats(spec, **changed)


def _sweep(
    scene: str, out: Path, sweep: tuple[str, float, float, int], settings: Settings, options: dict[str, Any]
) -> None:
    from taubench_gl.apps.progress import StudyScreen
    from taubench_gl.datasets.sweep import Sweep, run_sweep

    if sweep[0] in AXES and options[sweep[0]] is not None:
        raise click.UsageError(f"--{sweep[0]} conflicts with --sweep {sweep[0]}")
    base = _spec(options["camera"] or "still", options, 0.5)
    plan = Sweep(*sweep)
    with StudyScreen("speeds") as screen:
        rows = run_sweep(scene, plan, base, settings, out, screen)
    columns = settings.metrics.columns
    measured = [name for name in columns if any(row[f"{name}_percent"] is not None for row in rows)]
    click.echo("  ".join([f"{plan.axis:>12}", *(f"{name:>9}" for name in measured)]))
    for row in rows:
        speed = f"{row[f'mean_{plan.axis}_{plan.unit}']:>10.3f} {'m' if plan.unit == 'm' else '°'}"
        cells = ("–" if row[f"{n}_percent"] is None else f"{row[f'{n}_percent']:.2f} %" for n in measured)
        click.echo("  ".join([speed, *(f"{cell:>9}" for cell in cells)]))
    click.echo(f"written to {out}: sweep.csv, sweep.png, sweep.svg")
