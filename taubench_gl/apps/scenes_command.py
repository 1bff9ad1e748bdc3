"""``taubench-gl scenes``: named scenes, and stand-ins for the paper's scenes."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.options import AS_JSON, Commands, command
from taubench_gl.apps.screen import note, show_json, show_list
from taubench_gl.fields import setting

STAND_IN_NAMES = ("eternal-valley-fps", "eternal-valley-vr")
ARENA_NAMES = ("arena-oa-dm6", "arena-oa-shouse", "arena-aggressor", "arena-human", "cube2-two-towers")


@click.group(cls=Commands)
def scenes() -> None:
    """Named scenes, such as the paper's, and procedural stand-ins."""


REGISTRIES = setting(
    (),
    "A TOML file with further scenes; may be repeated",
    flag="--registry",
    shown="those of TAUBENCH_SCENES",
    repeats=True,
)
CACHE = setting(None, "Cache folder", shown="TAUBENCH_CACHE, else the user's cache")


def _entries(registries: tuple[Path, ...]) -> dict[str, Any]:
    from taubench_gl.datasets.scene_cache import registry_entries

    return registry_entries(registries)


@command("list")
def list_scenes(*, registries: tuple[Path, ...] = REGISTRIES, as_json: bool = AS_JSON) -> None:
    """List the named scenes.

    Examples:
      taubench-gl scenes list
      taubench-gl scenes list --registry mine.toml --json
    """
    import msgspec

    entries = _entries(registries)
    if as_json:
        show_json({name: msgspec.to_builtins(e) for name, e in entries.items()}, finite=False)
        return
    show_list({name: f"{entry.format:12}  {entry.title}" for name, entry in entries.items()})


@command()
@click.argument("name")
def show(name: str, *, registries: tuple[Path, ...] = REGISTRIES, as_json: bool = AS_JSON) -> None:
    """Show license, homepage, units, rate, camera and the paper's rows of scene NAME.

    Examples:
      taubench-gl scenes show eternal-valley-fps
    """
    import msgspec

    from taubench_gl.apps.screen import show_pairs
    from taubench_gl.datasets.registry import find_entry

    name, entry = find_entry(_entries(registries), name)
    facts = msgspec.to_builtins(entry)
    if as_json:
        show_json({"name": name, **facts}, finite=False)
        return
    show_pairs(f"Scene {name}", {key: value if value not in ("", None) else None for key, value in facts.items()})
    if entry.options():
        click.echo(f"  evaluate with      {entry.options()}")
    if entry.camera_options():
        click.echo(f"  Tables 2 and 3     {entry.camera_options()}")


@command()
@click.argument("name")
def get(
    name: str,
    *,
    source: Path | None = setting(
        None, "The file, downloaded from the scene's homepage", flag="--from", metavar="FILE"
    ),
    scene: str | None = setting(None, "Scene file of the archive, if it holds several", metavar="FILE"),
    accept_license: bool = setting(False, "Accept the license without a question"),
    registries: tuple[Path, ...] = REGISTRIES,
    cache: Path | None = CACHE,
) -> None:
    """Unpack the file of scene NAME into the cache, and print the scene's path.

    Examples:
      taubench-gl scenes get bart-museum --from museum.zip
      taubench-gl scenes get zero-day --from zeroday.zip --scene MEASURE_ONE.fbx
      taubench-gl scenes get my-scene --registry mine.toml --from my-scene.zip --accept-license
      taubench-gl evaluate bart-museum

    'show NAME' prints the homepage to download the file from.  A file is refused if the registry has another checksum.
    Afterwards NAME can be used in place of a path; its frame rate, frames, camera and units are the defaults of the
    options.
    """
    from taubench_gl.datasets.registry import find_entry
    from taubench_gl.datasets.scene_cache import CachedScene
    from taubench_gl.errors import DatasetError

    name, entry = find_entry(_entries(registries), name)
    if entry.recording is not None:
        hint = f"evaluate {name}, or scenes make {name} OUT.glb"
        raise DatasetError(f"{name} is made from a recorded game, not from a file", hint=hint)
    if source is None:
        place = entry.url or entry.homepage or "its homepage"
        raise DatasetError("the file of the scene is not given", hint=f"download it from {place}, then: --from FILE")
    note(f"{entry.title}, by {entry.authors or 'unknown'}; license: {entry.license or 'not stated'}")
    if not accept_license:
        if not sys.stdin.isatty():
            raise DatasetError("the license is not accepted", hint="add --accept-license to accept it")
        click.confirm("Do you accept the license?", abort=True, err=True)
    click.echo(CachedScene(name, entry, cache).take(source, scene))
    if entry.format in ("fbx", "blend"):
        note("the first evaluation converts it with Blender as a Python module (see: convert --help)")
    defaults = f"  (defaults: {entry.options()})" if entry.options() else ""
    note(f"Tables 1 to 4: taubench-gl evaluate {name}{defaults}")
    if registries or cache is not None:
        note("  with TAUBENCH_SCENES and TAUBENCH_CACHE set to the values of --registry and --cache")


@command()
@click.argument("name", type=click.Choice((*STAND_IN_NAMES, *ARENA_NAMES)))
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.glb")
def make(name: str, out: Path) -> None:
    """Write a procedural stand-in for one of the paper's EternalValley scenes (CC0), or a recorded game.

    A stand-in is not the dataset.  It has exactly the paper's counts (Table 1), and its camera statistics (Tables 2
    and 3) at 60 fps, the rate of the paper's captures: the paper does not state the rate of these tables.  Its geometry
    and its Table 4 row differ from the paper's; with path-traced light and the exposure that the file records, the
    columns of direct and indirect light are near it.  A recorded game (arena-..., cube2-...) needs the game's data
    files.

    Examples:
      taubench-gl scenes make eternal-valley-fps valley.glb
      taubench-gl scenes make arena-oa-shouse arena.glb
      taubench-gl evaluate valley.glb
    """
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.report import paper_tables
    from taubench_gl.scene import load_scene

    if name in ARENA_NAMES:
        from taubench_gl.capture.arena import arena_scenes, make_arena

        click.echo(f"{make_arena(name, out)}: {out} ({out.stat().st_size:,} bytes, {arena_scenes()[name].license})")
        click.echo(f"Tables 1 to 4: taubench-gl evaluate {out}")
        return
    from taubench_gl.data_files import read_bytes
    from taubench_gl.datasets.camera_path import CAPTURE_FPS
    from taubench_gl.datasets.stand_ins import STAND_INS
    from taubench_gl.errors import SettingsError
    from taubench_gl.outputs import write_atomically

    if out.suffix.lower() != ".glb":
        raise SettingsError(f"{out.name} does not end in .glb", hint="stand-ins are written as one binary file")
    write_atomically(out, read_bytes(STAND_INS[name]))
    scene = load_scene(out)
    show_tables(paper_tables([describe(scene, CAPTURE_FPS)])[:3])
    click.echo(f"note: {scene.stand_in}")
    click.echo(f"written to {out} ({out.stat().st_size:,} bytes, CC0)")
    click.echo(f"Table 4: taubench-gl evaluate {out}, or all tables beside the paper's: taubench-gl paper {name}")


def describe(scene: Any, fps: float) -> dict[str, Any]:
    """The part of summary.json that needs no OpenGL: census and camera of all frames at ``fps``."""
    import numpy as np

    from taubench_gl.animation import Poser, choose_camera
    from taubench_gl.effects.census import census
    from taubench_gl.metrics.activity import camera_activity, detect_cuts, summarize
    from taubench_gl.settings import Settings

    poser, camera = Poser(scene, fps), choose_camera(scene)
    times = [i / fps for i in range(Settings(fps=fps).sequence.frame_count(scene.duration))]
    views = [camera.view_at(poser.sample(t)) for t in times]
    activity = camera_activity(np.array([v.position for v in views]), np.array([v.world_from_view for v in views]))
    return {
        "scene": {"name": scene.name, "stand_in": scene.stand_in},
        "settings": {"fps": fps},
        "pairs": len(activity),
        "census": census(scene, times, poser),
        "camera": summarize(activity, detect_cuts(activity), fps) | {"source": camera.describe()},
    }


for member in (list_scenes, show, get, make):
    scenes.add_command(member)
