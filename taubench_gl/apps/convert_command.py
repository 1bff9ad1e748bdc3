"""``taubench-gl convert``: FBX and .blend files -> glTF."""

from __future__ import annotations

from pathlib import Path

import click

from taubench_gl.errors import note_renamed


@click.command(
    epilog="""\b
Examples:
  taubench-gl convert scene.fbx scene.glb
  taubench-gl convert scene.blend scene.glb
\b
Needs Blender as a Python module (bpy), best in an environment of its own; TAUBENCH_BLENDER_PYTHON names the
interpreter that has it.  Scripts inside .blend files are not run."""
)
@click.argument("source", metavar="SCENE")
@click.argument("target", type=click.Path(path_type=Path), metavar="OUT.glb")
@click.option(
    "--lights",
    type=click.Choice(["spec", "watts"]),
    hidden=True,
)
def convert(source: str, target: Path, lights: str | None) -> None:
    """Write an FBX or .blend file as glTF, with its animations, cameras and lights.

    Lights are in candela and lux, 683 lm for each watt; the other commands divide them by 683 (--light-unit auto).
    """
    from taubench_gl.pathtraced.blender.convert import convert as convert_file
    from taubench_gl.scene import load_scene

    if lights is not None:
        note_renamed(f"--lights {lights}", "candela, always; see --light-unit of evaluate")
    made = convert_file(source, target)
    listed = ", ".join(f"{made[name]} {name}" for name in ("meshes", "cameras", "lights", "armatures", "actions"))
    click.echo(f"Blender {made['blender']} read {listed}")
    scene = load_scene(target)
    for note in scene.notes[:10]:
        click.echo(f"note: {note}")
    animated = f"{len(scene.animations)} animations, {scene.duration:g} s"
    lights_and_cameras = f"{len(scene.cameras)} cameras, {len(scene.lights)} lights"
    click.echo(f"{target}: {len(scene.mesh_nodes)} meshes, {lights_and_cameras}, {animated}")
