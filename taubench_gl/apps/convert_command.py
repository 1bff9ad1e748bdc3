"""``taubench-gl convert``: files that Blender reads -> glTF."""

from __future__ import annotations

from pathlib import Path

import click

from taubench_gl.apps.options import CAMERA_PATH, command, option_group
from taubench_gl.apps.screen import show_notes
from taubench_gl.errors import SettingsError
from taubench_gl.fields import one_of, setting
from taubench_gl.settings import Settings


@command(settings=option_group(only=CAMERA_PATH))
@click.argument("source", metavar="SCENE")
@click.argument("target", type=click.Path(path_type=Path), metavar="OUT.glb")
def convert(
    source: str,
    target: Path,
    settings: Settings,
    *,
    take: str | None = setting(
        None,
        "Take of an FBX file, or action of a .blend file, to play",
        metavar="NAME",
        shown="the first take; the scene as it is",
    ),
    up_axis: str | None = setting(
        None, "Axis that points up in a PLY or STL file, which names none", one_of(("Y", "Z")), shown="Z"
    ),
) -> None:
    """Write a file that Blender reads as glTF: meshes as they are evaluated, motion, cameras and lights.

    Lists what glTF has no form for.  Lights are in candela and lux, 683 lm for each watt; the other commands divide
    them by 683 (--light-unit auto).  The world is written as an environment image beside OUT.glb and used by default.
    With --camera-path, SCENE is any scene that 'stress' accepts, and OUT.glb has the recorded camera as an animation.

    Examples:
      taubench-gl convert scene.blend scene.glb
      taubench-gl convert scene.fbx scene.glb --take Run
      taubench-gl convert scene.usdc scene.glb
      taubench-gl convert scene.glb --camera-path head.csv walked.glb

    Reads .blend .fbx .usd .usda .usdc .usdz .abc .ply .stl .dae.  The other commands convert such files on the fly and
    keep the result in the cache.  Needs Blender as a Python module (bpy), best in an environment of its own;
    TAUBENCH_BLENDER_PYTHON names the interpreter that has it.  Scripts inside .blend files are not run.
    """
    if settings.sequence.camera_path is not None:
        from taubench_gl.datasets.stress import stress

        if take or up_axis:
            hint = "convert the file first, then the result with --camera-path"
            raise SettingsError("--take and --up-axis have no effect with --camera-path", hint=hint)
        done = stress(source, target, settings.sequence)
        click.echo(f"{done.taken}\n{done.file}: {done.seconds:.6g} s of its camera at {done.fps:.6g} fps")
        return
    from taubench_gl.pathtraced.blender.convert import convert as convert_file
    from taubench_gl.scene import load_scene

    made = convert_file(source, target, take=take, up_axis=up_axis)
    listed = ", ".join(f"{number} {name}" for name, number in made.counts.items())
    click.echo(f"Blender {made.blender} read {listed}")
    for line in made.lost:
        click.echo(f"lost: {line}")
    if not made.lost:
        click.echo("nothing that Blender draws was found to be lost")
    scene = load_scene(target)
    show_notes([note for note in scene.notes if "lost in the conversion" not in note.message])
    animated = f"{len(scene.animations)} animations, {scene.duration:g} s"
    lights_and_cameras = f"{len(scene.cameras)} cameras, {len(scene.lights)} lights"
    click.echo(f"{target}: {len(scene.mesh_nodes)} meshes, {lights_and_cameras}, {animated}")
    if isinstance(made.environment, Path):
        click.echo(f"{made.environment}: the world, an environment image")
